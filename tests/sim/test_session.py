"""Sessions: runs in memory that earlier runs have left give the same bytes as runs in memory of their own."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from tests.arms import pack
from tests.sampled import sampled_trial
from torquebench.chain import CHAINS, Chain, Drawn
from torquebench.kernel import Array
from torquebench.references import Reference, Sine
from torquebench.robot import Puma560
from torquebench.robot.payload import Payload
from torquebench.robot.puma560.mismatch import mismatched
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import PathName, SampledTrial, Session
from torquebench.sim.trajectory import Outcome

STEPS = 60
PATHS: tuple[PathName, ...] = ("native", "python")
GAINS = {"lam": 10.0, "k": 0.3, "phi": 0.3, "kv": 20.0}
CONDITIONS = [
    CHAINS["ideal"],
    CHAINS["fast"],
    Chain(encoder_noise=1e-4, measurement_delay=0.003, name="late"),
    Chain(quantisation=1e-3),
]


def fixed() -> Reference:
    """A motion that nobody can write to, as sweeps have it."""
    found = Sine(np.ones(6), np.ones(6))(np.arange(STEPS) * 0.001)
    for array in found:
        array.setflags(write=False)
    return found


def trials(seed: int) -> list[SampledTrial]:
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
            sampled_trial(
                controllers[i // 20],
                mismatched(right, 0.1 * (i % 4), rng)[0],
                reference,
                0.001 * STEPS,
                chain=CONDITIONS[i // 5 % 4],
                drawn=Drawn(1e-4 * rng.normal(size=(STEPS, 6)) if i % 7 else None),
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
    sessions, ended = [Session(overwrite=True), Session()], set()
    for trial in trials(1):
        alone = Session().run(plant, trial, "native")
        ended.add(alone.outcome)
        for session in sessions:
            found = session.run(plant, trial, "native")
            assert found.digest() == alone.digest()
            assert (found.outcome, found.failed_at, found.detail) == (alone.outcome, alone.failed_at, alone.detail)
    assert ended == {Outcome.COMPLETED, Outcome.DIVERGED}


def test_gains_are_written_over_those_of_the_run_before() -> None:
    """New gains, options and fuzzy systems give the bytes of a session of their own; given gains stay as they are."""
    plant, session, base = MujocoPlant("puma560", integrator="euler"), Session(overwrite=True), trials(5)[0]
    packed = [
        *(pack("smc", 6, lam=lam, k=0.3) for lam in (10.0, 9.0, 11.0)),
        pack("smc", 6, options={"switching": "saturation"}, lam=10.0, k=0.3, phi=0.2),
        *(pack("fuzzy-boundary-layer", 6, lam=lam, k=0.3, phi=0.3, gds=10.0) for lam in (10.0, 9.0)),
    ]
    before = copy.deepcopy([controller.gains for controller in packed])
    for controller in (*packed, *packed[::-1]):
        trial = replace(base, controller=controller)
        assert session.run(plant, trial).digest() == Session().run(plant, trial).digest()
    assert str([controller.gains for controller in packed]) == str(before)


def test_a_trajectory_stays_as_it_was_returned() -> None:
    """Whatever a session runs later, on either path, unless it was asked to overwrite."""
    plant, session = MujocoPlant("puma560"), Session()
    kept = [(run := session.run(plant, trial, path), run.digest()) for path in PATHS for trial in trials(2)[13:19]]
    assert [run.digest() for run, _ in kept] == [digest for _, digest in kept]


def test_a_session_that_overwrites_has_the_next_run_in_the_memory_of_the_last() -> None:
    """That is what it is for: the trajectory returned before shows the new run."""
    plant, session = MujocoPlant("puma560"), Session(overwrite=True)
    first, second = trials(2)[15:17]
    alone = [Session().run(plant, trial).digest() for trial in (first, second)]
    assert alone[0] != alone[1]
    before = session.run(plant, first)
    assert before.digest() == alone[0]
    session.run(plant, second)
    assert before.digest() == alone[1]


def test_a_reference_that_can_be_written_to_is_read_anew() -> None:
    """A motion in an array that its owner may change: the next run follows what is in it then."""
    for session in (Session(), Session(overwrite=True)):
        plant, trial = MujocoPlant("puma560"), trials(3)[1]
        motion = Reference(*(array.copy() for array in trial.reference))
        other = SampledTrial(trial.controller, trial.model, motion)
        session.run(plant, other)
        motion.q[:] += 0.1
        assert session.run(plant, other).digest() == Session().run(plant, other).digest()
        motion.q[3, 2] = np.nan
        with pytest.raises(ValueError, match="reference q has values that are not finite"):
            session.run(plant, other)


def test_a_session_serves_one_thread_at_a_time() -> None:
    """A second run in the same session, from another thread or from a callback, is refused; the first goes on."""
    plant, session, trial = MujocoPlant("puma560"), Session(), trials(4)[1]
    refused = []

    def again(k: int) -> None:
        with pytest.raises(RuntimeError, match="the session is in use: wanted one for each thread"):
            session.run(MujocoPlant("puma560"), trial)
        refused.append(k)

    assert session.run(plant, trial, "python", again).digest() == session.run(plant, trial).digest()
    assert len(refused) == STEPS
