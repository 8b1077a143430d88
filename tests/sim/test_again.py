"""Runs in the memory of the run before: the same bytes as in memory of their own, whatever came before."""

from __future__ import annotations

import numpy as np
import pytest

from tests.arms import pack
from torquebench.kernel import Array
from torquebench.references import Reference, sine
from torquebench.robot import Puma560
from torquebench.robot.payload import Payload
from torquebench.robot.puma560.mismatch import mismatched
from torquebench.sim.again import Again
from torquebench.sim.analytic_plant import AnalyticPlant
from torquebench.sim.batch import Trial, run_trial
from torquebench.sim.chain import CHAINS, Chain
from torquebench.sim.mujoco_plant import MujocoPlant
from torquebench.sim.trajectory import Outcome

STEPS = 60
GAINS = {"lam": 10.0, "k": 0.3, "phi": 0.3, "kv": 20.0}
CONDITIONS = [CHAINS["ideal"], CHAINS["fast"], Chain("late", position_sigma=1e-4, delay=0.003), Chain(quantum=1e-3)]


def fixed() -> Reference:
    """A motion that nobody can write to, as sweeps have it."""
    found = sine(np.ones(6), np.ones(6))(np.arange(STEPS) * 0.001)
    for array in found:
        array.setflags(write=False)
    return found


def trials(seed: int) -> list[Trial]:
    """Draws of belief, noise and disturbance; every third is pushed out of bounds, some noise is left out."""
    rng, right, found = np.random.default_rng(seed), Puma560("corrected", "printed"), []
    controllers, reference = (
        [pack("linear-band-smc", 6, **GAINS), pack("smc", 6, lam=10, k=0.3)],
        fixed(),
    )
    for i in range(40):
        push: Array = rng.normal(size=(STEPS, 6))
        if i % 3 == 2:
            push[int(rng.integers(STEPS)), int(rng.integers(6))] = 1e300
        found.append(
            Trial(
                controllers[i // 20],
                mismatched(right, 0.1 * (i % 4), rng)[0],
                reference,
                0.001 * STEPS,
                chain=CONDITIONS[i // 5 % 4],
                position_noise=1e-4 * rng.normal(size=(STEPS, 6)) if i % 7 else None,
                disturbance=push,
            )
        )
    return found


@pytest.mark.parametrize(
    "plant",
    [
        MujocoPlant("puma560", integrator="euler"),
        AnalyticPlant(Puma560()),
        MujocoPlant("puma560", payload=Payload(2.0, at=0.02)),
    ],
    ids=["mujoco", "analytic", "payload taken up"],
)
def test_runs_are_equal_in_every_byte_to_runs_in_memory_of_their_own(plant: MujocoPlant | AnalyticPlant) -> None:
    """Through all chains, failures among them, with and without noise: digest, outcome and detail are the same."""
    again, ended = Again(), set()
    for trial in trials(1):
        alone = run_trial(plant, trial, "native")
        found = run_trial(plant, trial, "native", again=again)
        ended.add(found.outcome)
        assert found.digest() == alone.digest()
        assert (found.outcome, found.failed_at, found.detail) == (alone.outcome, alone.failed_at, alone.detail)
    assert ended == {Outcome.COMPLETED, Outcome.DIVERGED}


def test_the_next_run_of_a_kind_has_the_memory_of_the_last() -> None:
    """That is what it is for: the trajectory returned before shows the new run; without it each keeps its own."""
    plant, again = MujocoPlant("puma560"), Again()
    first, second = trials(2)[15:17]
    alone = [run_trial(plant, trial) for trial in (first, second)]
    assert alone[0].digest() != alone[1].digest()
    before = run_trial(plant, first, again=again)
    assert before.digest() == alone[0].digest()
    run_trial(plant, second, again=again)
    assert before.digest() == alone[1].digest()


def test_a_reference_that_can_be_written_to_is_read_anew() -> None:
    """A motion in an array that its owner may change: the next run follows what is in it then."""
    plant, again, trial = MujocoPlant("puma560"), Again(), trials(3)[1]
    motion = Reference(*(array.copy() for array in trial.reference))  # type: ignore[union-attr]
    other = Trial(trial.controller, trial.model, motion, trial.duration)
    run_trial(plant, other, again=again)
    motion.q[:] += 0.1
    assert run_trial(plant, other, again=again).digest() == run_trial(plant, other).digest()
