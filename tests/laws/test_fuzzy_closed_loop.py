"""The fuzzy linear-band law in the loop: where it comes to rest, what its integral carries, what rules are worth."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.arms import pack, still, two_link, two_link_terms
from tests.fuzzy.independent import exact_output
from torquebench import AnalyticPlant, Puma560, simulate
from torquebench.fuzzy import Rule, builtin_system, prepare
from torquebench.kernel import Array
from torquebench.references import Sine
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import Trajectory

LAW = "fuzzy-linear-band-smc"
SINE = Sine(np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0]), np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))
SET_M = {"lam": 20.0, "k": 0.3, "phi": 1.0, "kv": 60.0, "kf": 0.3, "gd": 4.0, "ki": 15000.0}
"""The recommended gains of the proposed law."""
TARGET = np.array([0.4, -0.6])


@pytest.mark.parametrize("ki", [0.0, 400.0])
def test_rest_on_the_two_joint_arm(ki: float) -> None:
    """At rest the parts carry gravity: all of it without an integral, which leaves an error; the integral, none.

    Without: (K/phi + Kd) lambda e + KF FIS(lambda e/gd, 0) = g(q), with 6 and 8 N m of gravity at most and K = 24, 7.5.
    """
    gains = {"lam": 5.0, "k": 0.3, "phi": 1.0, "kv": 20.0, "kf": 0.2, "gd": 0.5, "ki": ki}
    run = simulate(
        AnalyticPlant(two_link()),
        pack(LAW, 2, {"equivalent_control": False}, **gains),
        two_link(),
        still(TARGET),
        duration=12.0,
    )
    e, q = (run.q_ref - run.q)[-1], run.q[-1]
    assert np.max(np.abs(run.qd[-1])) < 1e-8
    gravity = two_link_terms(q, np.zeros(2))[2]
    tau_max, mbar = np.array([80.0, 25.0]), np.array([2.5, 0.4])
    rules = np.array([exact_output(x, 0.0) for x in 5.0 * e / 0.5])
    carried = (0.3 * tau_max + 20.0 * mbar) * 5.0 * e + 0.2 * tau_max * rules + ki * mbar * run.extra["integral"][-1]
    assert np.max(np.abs(run.s[-1])) < 1.0  # inside the band, where sat(s/phi) = s
    assert carried == pytest.approx(gravity, rel=1e-6)
    if ki > 0.0:
        assert np.max(np.abs(e)) < 1e-6
        assert ki * mbar * run.extra["integral"][-1] == pytest.approx(gravity, rel=1e-4)
    else:
        assert np.min(np.abs(e)) > 0.01
        assert np.min(np.abs(0.2 * tau_max * rules / gravity)) > 0.1  # the rules carry a part worth mentioning


@cache
def puma(with_model: bool, kf: float, system: str = "pd-49") -> Trajectory:
    """Return 2 s of the paper's motion on the PUMA with the recommended gains."""
    controller = pack(LAW, 6, {"equivalent_control": with_model}, **{**SET_M, "kf": kf})
    gains = controller.law.pack_gains(6, {**SET_M, "kf": kf}, {"equivalent_control": with_model}, system)
    return simulate(
        AnalyticPlant(Puma560()),
        Controller(LAW, controller.law, gains),
        Puma560("corrected", "printed"),
        SINE,
        duration=2.0,
    )


def rmse(run: Trajectory) -> float:
    """Return the root mean square of all joints' errors from 1 s on [rad]."""
    return float(np.sqrt(np.mean(np.square((run.q_ref - run.q)[1000:]))))


def test_the_proposed_law_on_the_puma_without_a_model() -> None:
    """The recommended gains follow the paper's motion to 3.23 mrad, as on the paper's frozen-wrist equations."""
    run = puma(False, 0.3)
    assert run.completed
    assert rmse(run) == pytest.approx(3.23e-3, rel=0.05)
    assert np.array_equal(run.tau, run.tau_law)  # never at a limit


def test_what_the_rules_are_worth() -> None:
    """Without the rules the error is 3 % larger, as on the frozen-wrist equations: 3.338 against 3.228 mrad."""
    ratio = rmse(puma(False, 0.0)) / rmse(puma(False, 0.3))
    assert ratio == pytest.approx(3.338 / 3.228, abs=0.01)


def test_any_number_of_rules_is_worth_about_the_same() -> None:
    """The controller is near the origin all the time, where 49, 25 and 9 rules differ by their slope alone."""
    errors = [rmse(puma(False, 0.3, name)) for name in ("pd-49", "pd-25", "pd-9")]
    assert len(set(errors)) == 3
    assert max(errors) < 1.01 * min(errors)


def test_a_model_takes_most_of_the_error_away() -> None:
    """With the equivalent control of a nearly right model the error is a hundred times smaller."""
    assert rmse(puma(True, 0.3)) < 0.01 * rmse(puma(False, 0.3))


def test_rules_with_the_wrong_sign_are_worse_than_none() -> None:
    """A rule base that pushes the other way, -(i + j), makes the error larger."""
    system = builtin_system("pd-49")
    names = system.inputs[0].names
    turned = {name: names[len(names) - 1 - k] for k, name in enumerate(names)}
    wrong = [Rule(rule.when, turned[rule.then]) for rule in system.rules]
    gains: Any = pack(LAW, 6, {"equivalent_control": False}, **SET_M).gains
    fis = prepare(type(system)("turned", system.inputs, system.output, tuple(wrong))).fis
    law = pack(LAW, 6, {"equivalent_control": False}, **SET_M).law
    run = simulate(
        AnalyticPlant(Puma560()),
        Controller(LAW, law, gains._replace(fis=fis)),
        Puma560("corrected", "printed"),
        SINE,
        duration=2.0,
    )
    assert rmse(run) > 1.02 * rmse(puma(False, 0.0))


def test_the_integral_waits_in_the_loop() -> None:
    """On a step far beyond the torque limits each joint's integral stands still while it saturates along its error."""
    run = simulate(
        AnalyticPlant(two_link()),
        pack(LAW, 2, {"equivalent_control": False}, lam=10.0, k=0.3, phi=0.3, kv=20.0, kf=0.3, gd=1.0, ki=100.0),
        two_link(),
        still(np.array([1.5, -1.0])),
        duration=1.0,
    )
    integral, e = run.extra["integral"], run.q_ref - run.q
    before: Array = np.vstack([np.zeros(2), integral[:-1]])
    waits = (np.abs(run.tau_law) > np.array([80.0, 25.0])) & (run.tau_law * e > 0.0)
    assert np.all(np.count_nonzero(waits, axis=0) > 20)
    assert np.array_equal(integral[waits], before[waits])
    # differences of a running sum below 1 are good to 1e-16
    assert integral[~waits] - before[~waits] == pytest.approx(0.001 * e[~waits], abs=1e-15)
