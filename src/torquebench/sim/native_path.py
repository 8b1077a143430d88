"""The native path: whether a run can be compiled, and running it."""

from __future__ import annotations

import threading
from collections import deque
from functools import lru_cache
from typing import Any

from numba.core import config
from numba.core.errors import NumbaError

from torquebench.dialect import compiler_message, complaints
from torquebench.laws.law import Law
from torquebench.packing import Table
from torquebench.sim.calling import replay
from torquebench.sim.closed_loop import RAISED
from torquebench.sim.native_law import compile_law
from torquebench.sim.native_loop import compiled_loop
from torquebench.sim.plant import NativeError, NativePlant, Plant
from torquebench.sim.setup import Setup


def obstacle(plant: Plant, law: Law) -> str:
    """Return why a run of `law` on `plant` cannot be compiled; an empty text when it can."""
    if config.DISABLE_JIT:
        return "numba is switched off (NUMBA_DISABLE_JIT)"
    if not hasattr(plant, "native"):
        return f"the plant, a {type(plant).__name__}, has no native form"
    try:
        plant.native()
    except NativeError as error:
        return str(error)
    return law_obstacle(law)


@lru_cache(maxsize=256)
def law_obstacle(law: Law) -> str:
    """Return why a law cannot be compiled; an empty text when it can. Compiles it, or loads it from the cache."""
    found = complaints(law)
    if found:
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return f"law '{law.name}' keeps to Python: {found[0]}{more}"
    try:
        native_law(law)
    except (NumbaError, TypeError) as error:
        return f"law '{law.name}' cannot be compiled: {compiler_message(error, law.function)}"
    return ""


@lru_cache(maxsize=256)
def native_law(law: Law) -> Any:
    """Return a law's native function; see `compile_law`."""
    return compile_law(law)


_tables = threading.local()


def _table_of(gains: Any) -> Table:
    """Return the table of a law's gains: one of this thread's last ones again for the same gains."""
    kept: deque[tuple[Any, Table]] | None = getattr(_tables, "kept", None)
    if kept is None:
        kept = _tables.kept = deque(maxlen=16)
    for known, table in kept:
        if known is gains:
            return table
    kept.append((gains, Table(gains)))
    return kept[-1][1]


class NativeRun:
    """A run on the native path: call it with a range of control instants to get how they ended.

    Args:
        setup: The run; its law must have no `obstacle`.
        plant: The plant's native form.
    """

    longest = 20_000
    """Control instants to ask for at once, so that progress and interruption get their turn."""

    def __init__(self, setup: Setup, plant: NativePlant) -> None:
        job = setup.job
        self._kept = setup, plant, _table_of(setup.gains), Table(setup.memory)
        self.detail = ""
        """What went wrong, when something did."""
        job.call[:] = [
            native_law(setup.law).address,
            self._kept[2].address,
            setup.belief.address,
            self._kept[3].address,
            plant.step,
            plant.structure.address,
            len(job.q),
        ]
        self._loop = compiled_loop().ctypes

    def restart(self, plant: NativePlant) -> None:
        """Make the run anew, on the same arrays, without the payload that the plant may have taken up."""
        self.detail = ""
        self._kept[0].job.call[5] = plant.structure.address

    def attach(self) -> None:
        """Have the plant go on with its payload."""
        setup, plant = self._kept[:2]
        setup.plant.attach()  # type: ignore[attr-defined]  # only of a plant with a payload
        if plant.loaded is not None:
            setup.job.call[5] = plant.loaded.address

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1, without holding the interpreter's lock."""
        status = int(self._loop(self._kept[0].job.address, first, last))
        if status == RAISED:  # interpreted, the failing call tells what it was and where
            status, self.detail = replay(self._kept[0])
        return status
