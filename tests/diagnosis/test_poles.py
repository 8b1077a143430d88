"""Poles of the sampled loop against closed forms, and against how closed loops grow."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.diagnosis.test_causes import PLANT, experiment
from torquebench.diagnosis.margins import slopes_of
from torquebench.diagnosis.poles import Pole, poles_of
from torquebench.experiment.build import build
from torquebench.experiment.run import trial_of
from torquebench.experiment.schema import Experiment
from torquebench.sim.session import Session

KV, LAM = 20.0, 10.0
WHERE = [0.5, -0.4]
FINE = {**PLANT, "timestep": 0.0005}
SPRINGS = {"stiffness": [14930.0, 1415.0], "damping": [200.0, 20.0], "inertia": [1.11, 0.105]}


def at_rest(ki: float, chain: dict[str, Any], period: float = 0.002, **plant: Any) -> Experiment:
    """Return computed torque with an integral that holds the two-joint arm, begun 1e-7 rad from there."""
    law = {"name": "c", "law": "computed-torque", "gains": {"lam": LAM, "kv": KV, "ki": ki}}
    return experiment(
        law,
        plant={**FINE, **plant},
        chain=chain,
        reference={"kind": "sine", "amplitude": 1e-15, "frequency_hz": 0.5, "origin": WHERE},
        run={"duration": 4.0, "control_period": period, "initial_q": [x + 1e-7 for x in WHERE]},
    )


def first_pole(built: Experiment) -> Pole:
    """Return the pole that grows fastest, of those that swing."""
    loop = build(built)
    return next(pole for pole in poles_of(built, loop, slopes_of(built, loop)) if pole.frequency > 1.0)


@pytest.mark.parametrize(("ki", "is_stable"), [(3900.0, True), (4100.0, False)])
def test_an_integral_is_unstable_where_routh_says(ki: float, is_stable: bool) -> None:
    """s^3 + kv s^2 + kv lambda s + ki, of which ki > lambda kv^2 grows, to half a period of hold, 0.1 ms: 1 % of it."""
    pole = first_pole(at_rest(ki, {}, 1e-4, timestep=1e-4))
    roots = np.roots([1.0, KV, KV * LAM, ki])
    root = roots[np.argmax(roots.real + 1e-6 * roots.imag)]
    assert (pole.rate < 0.0) == is_stable
    assert pole.rate == pytest.approx(root.real, abs=0.02)
    assert pole.frequency == pytest.approx(root.imag / (2.0 * np.pi), rel=0.01)


def test_commands_that_are_drawn_late_are_late_by_their_mean() -> None:
    """A jitter of 2 ms is 1 ms, and half of the deadlines missed one period, T p/(1 - p), for poles and reaction.

    To the rounding of eigenvalues; a millisecond more is 0.05 1/s.
    """
    drawn, fixed = (
        at_rest(5200.0, chain) for chain in ({"jitter": 0.002, "missed_deadlines": 0.5}, {"torque_delay": 0.003})
    )
    a, b = first_pole(drawn), first_pole(fixed)
    assert (a.rate, a.frequency) == pytest.approx((b.rate, b.frequency), rel=1e-6)
    assert b.rate > first_pole(at_rest(5200.0, {"torque_delay": 0.002})).rate + 0.04
    assert drawn.chain.reaction(0.002) == pytest.approx(fixed.chain.reaction(0.002), rel=1e-12)


@pytest.mark.parametrize(
    ("ki", "chain", "plant"),
    [
        (5200.0, {}, {}),
        (5200.0, {"command_delay": 0.004, "actuator_lag": 0.003}, {}),
        (5200.0, {"torque_delay": 0.0015, "current_loop": {"frequency": 300.0, "damping": 0.6}}, {}),
        (5200.0, {"velocity": "differentiated", "velocity_filter": 200.0, "measurement_delay": 0.002}, {}),
        (5200.0, {"velocity": "tachometer", "velocity_filter": 100.0, "velocity_noise": 1e-15}, {}),
        (5600.0, {"velocity": "kalman", "kalman_acceleration": 1e-11, "encoder_noise": 1e-15}, {}),
        (5200.0, {"command_filter": 500.0}, {}),
        (4000.0, {"actuator_lag": 0.002}, {"transmission": SPRINGS}),
        (4000.0, {"actuator_lag": 0.002}, {"transmission": {**SPRINGS, "sensor": "link"}}),
    ],
    ids=["hold", "late", "current-loop", "difference", "tachometer", "kalman", "filter", "motor", "link"],
)
def test_loops_grow_and_swing_as_the_first_pole_says(ki: float, chain: dict[str, Any], plant: dict[str, Any]) -> None:
    """Velocities of a run from 0.5 to 1.3 s are two swings with the roots of a difference equation of fourth order.

    The first pole has the rate and the frequency of the larger within 4 %: what is left is other poles, and the arm's
    bend where springs begin it 5 mrad off.
    """
    built = at_rest(ki, chain, **plant)
    pole = first_pole(built)
    assert pole.rate > 0.3
    loop = build(built)
    run = Session().run(loop.plant, trial_of(built, loop, loop.controllers[0]))
    order, apart = (4, 30) if plant else (2, 30)
    qd = run.qd[250:650, pole.joint]
    rows = np.column_stack([qd[i * apart : len(qd) - (order - i) * apart] for i in range(order)])
    found = np.linalg.lstsq(rows, qd[order * apart :], rcond=None)[0]
    roots = np.roots([1.0, *-found[::-1]]).astype(complex)
    root = np.log(roots[np.argmax(np.abs(roots))]) / (apart * built.run.control_period)
    assert root.real == pytest.approx(pole.rate, rel=0.04)
    assert abs(root.imag) / (2.0 * np.pi) == pytest.approx(pole.frequency, rel=0.04)
