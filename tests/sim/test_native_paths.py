"""The native path and the readable path give the same bytes: laws, plants, references, chains, periods."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.arms import pack
from tests.sampled import simulate_sampled
from tests.sim import loops
from tests.sim.loops import TARGET, arm, go
from tests.sim.protocol import PLANTS, Case, cases, differing_bytes, variants
from torquebench.chain import Drawn
from torquebench.kernel import Array
from torquebench.laws import law_names
from torquebench.laws.law import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.native import NativeRun
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import Outcome

STRIDE = 173
"""The small size takes every 173rd case: prime to the length of each axis, so that all values of all axes occur."""


def chosen(plant: str, everything: bool) -> list[Case]:
    """Return the cases to run on a plant."""
    return list(itertools.islice(cases(plant), PLANTS.index(plant), None, 1 if everything else STRIDE))


@pytest.mark.parametrize("plant", PLANTS)
def test_both_paths_give_the_same_bytes(
    plant: str, large: bool, size: Any, figure: Any, tell: Callable[[str], None]
) -> None:
    """Every array, the outcome and the failing step of each run; and nearly all runs complete, so that they count."""
    runs, completed, wrong, bytes_apart = chosen(plant, large), 0, [], 0
    n_steps = size(40, 1000)
    for i, case in enumerate(runs):
        readable, native = case.run(n_steps, "python"), case.run(n_steps, "native")
        assert (readable.path, native.path, native.path_reason) == ("python", "native", "")
        apart = differing_bytes(readable, native)
        bytes_apart += apart
        completed += readable.completed
        if apart or readable.digest() != native.digest():
            wrong.append(f"{case}: {apart} bytes, {readable.outcome.name} {native.outcome.name}")
        if i % 100 == 99:
            tell(f"{plant}: {i + 1} of {len(runs)} cases, {bytes_apart} bytes differ")
    figure(f"bytes that differ between the paths, {plant}, {len(runs)} runs of {n_steps} instants", bytes_apart, "0")
    assert wrong == []
    assert completed >= 0.9 * len(runs)


def test_the_small_size_meets_every_value() -> None:
    """Each law with each option, reference, integrator, condition and period is among the cases of the small size."""
    for axis in range(1, len(Case._fields)):
        for plant in PLANTS:
            met = {case[axis] for case in chosen(plant, everything=False)}
            assert met == {case[axis] for case in cases(plant)}, (plant, Case._fields[axis])
    assert {variant.law for variant in variants()} == set(law_names())


def test_the_count_of_bytes_sees_one_bit() -> None:
    """The lowest bit of one number of one signal, another length, and another channel are counted."""
    run = next(cases("analytic two-link")).run(20, "native")
    assert run.outcome is Outcome.COMPLETED
    assert differing_bytes(run, run) == 0
    other = run.tau.copy()
    other.view(np.uint64)[3, 1] ^= 1
    assert differing_bytes(run, dataclasses.replace(run, tau=other)) == 1
    assert differing_bytes(run, dataclasses.replace(run, tau=other[:-1].copy())) == run.tau.nbytes
    assert differing_bytes(run, dataclasses.replace(run, extra={"x": run.q})) >= run.q.nbytes


@pytest.mark.parametrize("at_once", [1, 7, 40, 50, 51, 10_000])
@pytest.mark.parametrize("condition", ["ideal", "slow, noisy"])
def test_a_run_in_pieces_is_the_same_run(condition: str, at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many instants are asked for at once, lag and filter go on where they were; progress counts to the end."""
    for plant in ("mujoco two-link", "analytic two-link"):
        case = next(c for c in cases(plant) if c.condition == condition and c.substeps == 4)
        whole = case.run(50, "native")
        told: list[int] = []
        with monkeypatch.context() as patch:
            patch.setattr(NativeRun, "longest", at_once * case.substeps)
            patch.setattr("tests.sim.protocol.simulate_sampled", partial(simulate_sampled, progress=told.append))
            assert case.run(50, "native").digest() == whole.digest()
        assert told == [min(k, 50) - 1 for k in range(at_once, 50 + at_once, at_once)]


class HoardGains(NamedTuple):
    """One gain."""

    step: Array


def hoarding(
    gains: HoardGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array
) -> None:
    """Count the calls in the model's working memory, and ask for that much torque."""
    for i in range(len(tau)):
        model.scratch.free[i] += gains.step[i]
        tau[i] = model.scratch.free[i]


@pytest.mark.parametrize("path", ["python", "native"])
@pytest.mark.parametrize("plant", ["analytic", "mujoco"])
def test_nothing_is_left_of_the_run_before(plant: str, path: Any) -> None:
    """A law that misuses the model's working memory as its own finds zeros there at the start of each run."""
    law = Law("hoarding", hoarding, HoardGains, None, {}, {})
    mine = Controller("hoarding", law, HoardGains(np.array([1.0, 0.5])))
    model = arm()
    for _ in range(3):
        run = go(loops.plant_of(plant), mine, 0.01, model=model, path=path)
        assert run.path == path
        assert run.tau_law.tolist() == [[k, 0.5 * k] for k in range(1, 11)]


@pytest.mark.parametrize("path", ["python", "native"])
@pytest.mark.parametrize("plant", ["analytic", "mujoco"])
def test_what_the_caller_passes_stays_the_callers(plant: str, path: Any) -> None:
    """A run neither locks nor changes the arrays it was given, and writing to them later does not change the run."""
    samples, rng = TARGET(np.arange(50) * 0.001), np.random.default_rng(1)
    given = [*samples, 1e-4 * rng.normal(size=(50, 2)), rng.normal(size=(50, 2)), np.array([0.1, 0.2])]
    before = [array.copy() for array in given]
    run = go(
        loops.plant_of(plant),
        pack("pd", 2, lam=8, kv=12),
        reference=samples,
        drawn=Drawn(given[3]),
        disturbance=given[4],
        initial_q=given[5],
        path=path,
    )
    digest = run.digest()
    for array, kept in zip(given, before, strict=True):
        assert array.flags.writeable
        assert array.tobytes() == kept.tobytes()
        array[:] = 7.0
    assert run.digest() == digest
