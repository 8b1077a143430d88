"""Many rollouts cost what one costs, times their number: neither time nor memory grows on the way."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sampled import sampled_trial
from tests.sim.protocol import CONDITIONS, HOME, REFERENCES, Variant, belief_of, plant_of
from torquebench.chain import Drawn
from torquebench.references import Reference
from torquebench.sim.session import SampledTrial
from torquebench.sim.simulate import simulate_many

N_STEPS = 1000
STATM = Path("/proc/self/statm")


def resident() -> float:
    """Return the memory this process holds [MB]."""
    return int(STATM.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def rollouts(plant: str, count: int) -> Iterator[SampledTrial]:
    """Yield that many trials of 1,000 instants; each starts elsewhere and has a disturbance of its own."""
    n, chain = plant_of(plant).n, CONDITIONS["slow"].chain
    controller = Variant("linear-band-smc", (("equivalent_control", True),), None).controller(n)
    reference: Reference = REFERENCES["sine"](n)(np.arange(N_STEPS) * 0.001)
    for i in range(count):
        rng = np.random.default_rng(i)
        yield sampled_trial(
            controller,
            belief_of(plant),
            reference,
            0.001 * N_STEPS,
            chain=chain,
            drawn=Drawn(1e-4 * rng.normal(size=(N_STEPS, n))),
            disturbance=rng.normal(size=(N_STEPS, n)),
            initial_q=np.array(HOME[:n]) + 0.1 * rng.normal(size=n),
        )


@pytest.mark.skipif(not STATM.exists(), reason="reads the memory in use from /proc")
@pytest.mark.parametrize("workers", [1, 4])
@pytest.mark.parametrize("plant", ["mujoco puma560", "analytic corrected"])
def test_rollouts_do_not_grow_in_cost(
    plant: str, workers: int, size: Any, figure: Any, tell: Callable[[str], None]
) -> None:
    """Memory grows by less than 1 MB in 1,000 rollouts once the first hundred have run; time is shown, not judged.

    Judged from two halves of the last batch, so that what allocators keep after their first need does not count. The
    small size has too few rollouts for a rate, and is held to 2 MB in all: a leak of one record would be 2.4 MB.
    """
    batches = size([50, 100], [100, 1000, 10_000] if workers > 1 else [100, 1000, 10_000, 100_000])
    seconds, held = [], [0.0, 0.0]
    for count in batches:
        start = time.perf_counter()
        for i, run in enumerate(simulate_many(plant_of(plant), rollouts(plant, count), workers=workers)):
            assert run.completed
            assert run.path == "native"
            if i == count // 2:
                held[0] = resident()
        held[1] = resident()
        seconds.append((time.perf_counter() - start) / count)
        tell(f"{plant}, {workers} threads: {count} rollouts, {1e3 * seconds[-1]:.3f} ms each, {held[1]:.1f} MB held")
    growth = (held[1] - held[0]) / (batches[-1] / 2 / 1000)
    name = f"{plant}, {workers} threads"
    figure(f"memory per 1,000 rollouts, {name}, {batches[-1]} rollouts [MB]", growth, "< 1 at the large size")
    figure(f"time per rollout of 1,000 instants, {name} [ms]", 1e3 * seconds[-1], "shown only")
    if size(False, True):
        figure(f"time per rollout, last batch over the one before, {name}", seconds[-1] / seconds[-2], "0.95 .. 1.05")
    assert growth < 1.0 or held[1] - held[0] < size(2.0, 0.0)
