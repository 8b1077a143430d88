"""`simulate` draws its own noise: the same numbers as an experiment of the same seed and draw, and no array to fit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.arms import pack
from tests.experiment.examples import parse
from tests.sampled import Torque
from torquebench.chain import CHAINS, IDEAL, Chain
from torquebench.disturbances import BandLimitedNoise, Bias
from torquebench.errors import SimulationError
from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment
from torquebench.kernel import Array
from torquebench.references import Sine
from torquebench.robot import Puma560
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import Trial, simulate, simulate_many
from torquebench.sim.trajectory import Trajectory

N_STEPS = 50


CONFIG = """
name: drawn
plant: {engine: analytic, model: puma560, timestep: 0.001}
model: {structure: corrected, constants: printed}
run: {duration: 0.5, control_period: 0.001, seed: SEED, draw: DRAW, metrics_from: 0.0}
reference: {kind: sine, amplitude: 1.0, frequency_hz: 1.0}
chain: CHAIN
disturbances: DISTURBANCES
controllers: [{name: pd, law: pd, gains: {lam: 8, kv: 12}}]
"""
TEXTS = {
    "none": ("[]", ()),
    "noise, bias, noise": (
        "[{kind: band-limited-noise, channel: torque, sigma: 3.0, hold: 0.002},"
        " {kind: bias, channel: torque, value: 0.7},"
        " {kind: band-limited-noise, channel: torque, sigma: 1.0, hold: 0.004}]",
        (BandLimitedNoise(3.0, 0.002), Bias(0.7), BandLimitedNoise(1.0, 0.004)),
    ),
}


def run(**options: Any) -> Trajectory:
    """Run 50 ms of PD on the PUMA."""
    return simulate(
        AnalyticPlant(Puma560()),
        pack("pd", 6, lam=8, kv=12),
        Puma560("corrected", "printed"),
        Sine(1.0, 1.0),
        **{"duration": 0.05, **options},
    )


def test_a_chain_with_encoder_noise_is_noisy() -> None:
    """`chain=CHAINS["fast"]` alone: the measured position carries noise of the chain's size, the ideal one none."""
    ideal, fast, noise = run(), run(chain=CHAINS["fast"]), Chain(encoder_noise=1e-4)
    assert np.array_equal(ideal.q_meas, ideal.q)
    for noisy in (fast, run(chain=noise)):
        error = noisy.q_meas - noisy.q
        assert np.count_nonzero(error) == error.size
        assert np.std(error) == pytest.approx(1e-4, rel=0.15)


@pytest.mark.parametrize(("seed", "draw", "path"), [(0, 0, "native"), (7, 3, "python")])
@pytest.mark.parametrize("disturbances", TEXTS)
@pytest.mark.parametrize("chain", CHAINS)
def test_the_same_bytes_as_the_experiment(chain: str, disturbances: str, seed: int, draw: int, path: Any) -> None:
    """One seed and one draw: a YAML experiment, `simulate`, and `simulate_many` give one digest."""
    text, objects = TEXTS[disturbances]
    config = CONFIG.replace("SEED", str(seed)).replace("DRAW", str(draw)).replace("CHAIN", chain)
    experiment = parse(config.replace("DISTURBANCES", text))
    wanted = run_experiment(experiment, path=path).runs["pd"]
    found = run(duration=0.5, chain=CHAINS[chain], disturbances=objects, seed=seed, draw=draw, path=path)
    assert found.digest() == wanted.digest()
    loop = build(experiment)
    trial = Trial(
        loop.controllers[0], loop.model, Sine(1.0, 1.0), 0.5, 0.001, CHAINS[chain], objects, seed=seed, draw=draw
    )
    many = simulate_many(loop.plant, [trial] * 2, workers=2, path=path)
    assert [x.digest() for x in many] == [wanted.digest()] * 2


def test_seed_and_draw_decide() -> None:
    """Other seed or draw, other noise; the same, the same; without randomness neither changes a byte."""
    noisy = {"chain": CHAINS["slow"], "disturbances": (BandLimitedNoise(1.0, 0.001),)}
    keys = [(0, 0), (0, 1), (1, 0), (1, 1)]
    digests = [run(seed=seed, draw=draw, **noisy).digest() for seed, draw in keys]
    assert len(set(digests)) == 4
    assert digests == [run(seed=seed, draw=draw, **noisy).digest() for seed, draw in keys]
    assert len({run(seed=seed, draw=draw, disturbances=[Bias(1.0)]).digest() for seed, draw in keys}) == 1


def test_what_draws_nothing_changes_no_noise() -> None:
    """A disturbance without randomness, before or behind, leaves a noise its numbers; another noise gets others."""
    sampled = [
        Trial(pack("pd", 6, lam=8, kv=12), Puma560(), Sine(1.0, 1.0), 0.05, disturbances=each).sampled(6).disturbance
        for each in (
            [BandLimitedNoise(1.0, 0.001)],
            [Bias(0.0), BandLimitedNoise(1.0, 0.001)],
            [BandLimitedNoise(1.0, 0.001), Bias(0.0)],
            [BandLimitedNoise(0.0, 0.001), BandLimitedNoise(1.0, 0.001)],
        )
    ]
    assert np.array_equal(sampled[0], sampled[1])
    assert np.array_equal(sampled[0], sampled[2])
    assert not np.array_equal(sampled[0], sampled[3])


ZEROS = np.zeros((N_STEPS, 6))


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (ZEROS, r"disturbances is an array of shape \(50, 6\), wanted a sequence"),
        ([ZEROS], r"disturbances\[0\] is an array of shape \(50, 6\)"),
        ([Bias(1.0), lambda t: ZEROS], r"disturbances\[1\] is a function"),
        ([Bias], r"disturbances\[0\] is the class Bias"),
        (Bias(1.0), r"disturbances is a Bias, wanted a sequence"),
        (3.0, "disturbances is a float"),
    ],
)
def test_what_cannot_sample_itself_is_refused(given: Any, named: str) -> None:
    """Arrays and functions that would have to fit the run: the place, what was got, and what was wanted."""
    wanted = r".*an object with a method sample\(n, t, control_period, rng\) that returns the torque"
    with pytest.raises(TypeError, match=named + wanted):
        run(disturbances=given)


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        (np.zeros((N_STEPS, 5)), r"has shape \(50, 5\), wanted \(50, 6\)"),
        (np.zeros(6), r"has shape \(6,\), wanted \(50, 6\)"),
        (np.full((N_STEPS, 6), math.nan), "has torques that are not finite"),
    ],
)
def test_a_disturbance_of_another_shape_is_refused(bad: Array, what: str) -> None:
    """What a disturbance returns is checked: N rows of n finite numbers."""
    with pytest.raises(ValueError, match=rf"^disturbances\[1\] {what}$"):
        run(disturbances=[Bias(1.0), Torque(bad)])


def test_a_reference_that_does_not_last_as_long_as_the_run_is_refused() -> None:
    """A sampled motion of another length is neither cut nor stretched."""
    samples = Sine(np.ones(6), 1.0)(0.001 * np.arange(N_STEPS - 1))
    trial = Trial(pack("pd", 6, lam=8, kv=12), Puma560(), samples, 0.05)
    with pytest.raises(ValueError, match=r"reference q has shape \(49, 6\), wanted \(50, 6\)"):
        trial.sampled(6)


def test_a_failed_run_is_raised_with_its_trajectory() -> None:
    """Unless asked for, a run that does not complete raises; the error carries what there is of it."""
    push = ZEROS.copy()
    push[20, 1] = 1e300
    with pytest.raises(SimulationError, match="left the bounds") as caught:
        run(disturbances=[Torque(push)], chain=IDEAL)
    assert caught.value.trajectory.failed_at == 20
    assert run(disturbances=[Torque(push)], throw=False).failed_at == 20
