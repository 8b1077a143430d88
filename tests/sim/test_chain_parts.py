"""Rounded, unfiltered and late measurements, against their definitions in numpy, on every plant and path."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.arms import pack
from tests.sim.loops import PLANTS, arm, go, law_of, plant_of, spring
from tests.sim.test_native_chain import N_STEPS, T, job_of, measure, motion
from torquebench.chain import CHAINS, Chain, Drawn
from torquebench.chain.sensors import nearest_multiple
from torquebench.kernel import Array
from torquebench.sim.closed_loop import hold_back

QUANTUM = 0.003
"""Large against the motion of one control period, so that rounding shows."""


def measured(chain: Chain, noise: Array | Drawn | None = None) -> tuple[Array, Array]:
    """Return what the law sees at each instant of a motion, (N, 2) each, step by step through the loop's kernels."""
    job, q, qd = job_of(chain, noise), np.zeros((N_STEPS, 2)), np.zeros((N_STEPS, 2))
    for k in range(N_STEPS):
        job.q[:], job.qd[:] = motion(k)
        measure(job, k)
        if len(job.late):
            hold_back(job, k)
        q[k], qd[k] = job.measured_q, job.measured_qd
    return q, qd


def true() -> tuple[Array, Array]:
    """Return that motion itself."""
    q, qd = zip(*(motion(k) for k in range(N_STEPS)), strict=True)
    return np.array(q), np.array(qd)


@pytest.mark.parametrize("quantum", [QUANTUM, 2.0 * math.pi / 4000, 1.0, 1e-9])
def test_rounding_is_to_the_nearest_multiple(quantum: float) -> None:
    """Each position is a whole number of steps, and none is nearer; the exact velocity is not touched.

    Whole to 1e-15 of the position over the step, the rounding of the product and of this division.
    """
    q, qd = measured(Chain(quantisation=quantum))
    steps = q / quantum
    assert np.abs(steps - np.round(steps)) == pytest.approx(0.0, abs=1e-15 * np.max(np.abs(true()[0])) / quantum)
    assert np.max(np.abs(q - true()[0])) <= 0.5 * quantum * (1.0 + 1e-9)
    assert np.max(np.abs(q - true()[0])) > 0.4 * quantum
    assert qd.tobytes() == true()[1].tobytes()


@pytest.mark.parametrize(
    ("x", "wanted"),
    [
        (0.0, 0.0),
        (0.124, 0.0),
        (0.126, 0.25),
        (-0.124, 0.0),
        (-0.126, -0.25),
        (0.125, 0.25),
        (-0.125, 0.0),
        (7.6, 7.5),
        (1e300, 1e300),
        (-1e300, -1e300),
        (2.0**50, 2.0**50),
        (2.0**50 - 0.125, 2.0**50),
    ],
)
def test_rounding_by_hand(x: float, wanted: float) -> None:
    """Multiples of 1/4; halves go up; where floats lie no closer than the multiples, x is left alone."""
    assert nearest_multiple(x, 0.25) == wanted


def test_an_unfiltered_velocity_is_the_backward_difference() -> None:
    """v_0 = 0, then (y_k - y_(k-1))/T; of rounded positions, so that v is a whole number of quantum/T."""
    q, qd = measured(Chain(velocity="differentiated", quantisation=QUANTUM))
    wanted = np.vstack([np.zeros((1, 2)), np.diff(q, axis=0) / T])
    assert qd == pytest.approx(wanted, rel=1e-13, abs=1e-13)
    steps = qd / (QUANTUM / T)
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert len(np.unique(np.round(steps))) > 3


@pytest.mark.parametrize("periods", [1, 3, N_STEPS - 1, N_STEPS, 5 * N_STEPS])
def test_a_delay_shows_the_measurement_of_then(periods: int) -> None:
    """The law sees at k what was measured at k - d, and until d what was measured at 0; noise, filter and all."""
    noise = 0.01 * np.random.default_rng(3).normal(size=(N_STEPS, 2))
    parts: dict[str, Any] = {"velocity": "differentiated", "velocity_filter": 300.0, "quantisation": QUANTUM}
    prompt, late = measured(Chain(**parts), noise), measured(Chain(**parts, measurement_delay=periods * T), noise)
    then = np.maximum(np.arange(N_STEPS) - periods, 0)
    for at_once, seen in zip(prompt, late, strict=True):
        assert seen.tobytes() == at_once[then].tobytes()
    assert len(np.unique(prompt[1], axis=0)) == N_STEPS


def test_noise_is_added_before_rounding() -> None:
    """Y = round((q + noise)/quantum) quantum: noise of a tenth of a step does not show but near a half."""
    noise = 0.1 * QUANTUM * np.random.default_rng(4).uniform(-1.0, 1.0, size=(N_STEPS, 2))
    q, _ = measured(Chain(quantisation=QUANTUM), noise)
    clean = true()[0] / QUANTUM
    far_from_half = np.abs(clean - np.floor(clean) - 0.5) > 0.11
    assert np.array_equal(q[far_from_half], measured(Chain(quantisation=QUANTUM))[0][far_from_half])
    assert np.max(np.abs(q - np.round((true()[0] + noise) / QUANTUM) * QUANTUM)) < 1e-15
    assert np.count_nonzero(far_from_half) > N_STEPS


@pytest.mark.parametrize("path", ["python", "native"])
@pytest.mark.parametrize("plant", PLANTS)
def test_a_whole_run_sees_late_what_was(plant: str, path: Any) -> None:
    """Of a delay alone q_meas and qd_meas are the true state of then, byte for byte, while the arm does move."""
    run = go(
        plant_of(plant),
        pack("pd", 2, lam=8, kv=12),
        0.3,
        chain=Chain(measurement_delay=0.02),
        path=path,
        control_period=0.002,
    )
    then = np.maximum(np.arange(len(run.t)) - 10, 0)
    assert run.path == path
    assert run.q_meas.tobytes() == run.q[then].tobytes()
    assert run.qd_meas.tobytes() == run.qd[then].tobytes()
    assert np.all(np.ptp(run.q, axis=0) > 0.01)


def test_a_delay_can_cost_stability() -> None:
    """The same law on the same plant: still within 1 mrad of its target without the delay, far off with 60 ms."""
    gaps = []
    for delay in (0.0, 0.06):
        run = go(plant_of("analytic"), spring, 2.0, chain=Chain(measurement_delay=delay))
        gaps.append(float(np.ptp(run.qd[-500:, 1])))
    assert gaps[1] > 20.0 * gaps[0]


@pytest.mark.parametrize(
    "key", ["encoder_noise", "velocity_filter", "actuator_lag", "quantisation", "measurement_delay"]
)
@pytest.mark.parametrize("value", [-1e-3, math.nan, math.inf])
def test_meaningless_sizes_are_refused(key: str, value: float) -> None:
    """Negative, NaN and infinite: the key and the value are named, and what was wanted."""
    with pytest.raises(ValueError, match=rf"chain: {key} is {value}, wanted (a finite number|at least 0|more than 0)"):
        Chain(**{key: value})


def test_a_delay_between_two_instants_is_refused() -> None:
    """A delay that is no whole number of control periods is a ValueError that names the nearest."""
    with pytest.raises(ValueError, match=r"measurement_delay 0\.003 s is not a whole multiple of"):
        go(plant_of("analytic"), law_of(spring), 0.1, chain=Chain(measurement_delay=0.003), control_period=0.002)


@pytest.mark.parametrize("name", ["ideal", "fast", "slow"])
def test_the_first_chains_have_neither_rounding_nor_delay(name: str) -> None:
    """What results were made with stays what it was."""
    assert (CHAINS[name].quantisation, CHAINS[name].measurement_delay) == (0.0, 0.0)
    assert arm().n == 2
