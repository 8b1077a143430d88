"""The native path: whether a run can be compiled, and running it."""

from __future__ import annotations

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


class NativeRun:
    """A run on the native path: call it with a range of control instants to get how they ended.

    Args:
        setup: The run; its law must have no `obstacle`.
        plant: The plant's native form.
        gains: The table of its law's gains, where there is one already.
    """

    longest = 20_000
    """Control instants to ask for at once, so that progress and interruption get their turn."""

    def __init__(self, setup: Setup, plant: NativePlant, gains: Table | None = None) -> None:
        job = setup.job
        self.setup, self._plant = setup, plant
        self._tables = gains or Table(setup.gains), Table(setup.memory)
        self.detail = ""
        """What went wrong, when something did."""
        job.call[:] = [
            native_law(setup.law).address,
            self._tables[0].address,
            setup.belief.address,
            self._tables[1].address,
            plant.step,
            plant.structure.address,
            len(job.q),
        ]
        self._loop = compiled_loop().ctypes

    def restart(self, plant: NativePlant) -> None:
        """Make the run anew, on the same arrays, without the payload that the plant may have taken up."""
        self.detail, self._plant = "", plant
        self.setup.job.call[5] = plant.structure.address

    def attach(self) -> None:
        """Have the plant go on with its payload."""
        self.setup.plant.attach()  # type: ignore[attr-defined]  # only of a plant with a payload
        if self._plant.loaded is not None:
            self.setup.job.call[5] = self._plant.loaded.address

    def __call__(self, first: int, last: int) -> int:
        """Run control instants `first` .. `last` - 1, without holding the interpreter's lock."""
        status = int(self._loop(self.setup.job.address, first, last))
        if status == RAISED:  # interpreted, the failing call tells what it was and where
            status, self.detail = replay(self.setup)
        return status
