"""Where the paper's laws and fuzzy controllers come to rest, and what carries the arm there."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from tests.arms import MGL, pack, pendulum, slider, still, two_link, two_link_terms
from tests.fuzzy.independent import exact_output
from tests.laws.forms import Options, acting, default_form
from torquebench.references import ReferenceSource
from torquebench.robot import RobotModel
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

TARGET = np.array([0.4, -0.6])
TAU_MAX, MBAR = np.array([80.0, 25.0]), np.array([2.5, 0.4])
GAINS = {"lam": 5.0, "k": 0.3, "phi": 1.0, "kv": 20.0, "kf": 0.2, "gd": 0.5, "ki": 100.0}
BLIND: Options = {"equivalent_control": False}


def run(
    arm: RobotModel, law: str, target: ReferenceSource, duration: float, options: Options | None = None, **gains: Any
) -> Trajectory:
    """Run a law on the analytic plant, from rest at zero."""
    return simulate(AnalyticPlant(arm), pack(law, arm.n, options, **gains), arm, target, duration=duration)


@pytest.mark.parametrize(
    "options",
    [
        {"integral": False},
        {"compensation": "clipped-sum"},
        {"compensation": "clipped-sum", "integral": False},
        {"compensation": "off"},
        {"band": "off"},
        {"band": "off", "integral": False},
        {"linear": False},
        {"compensation": "off", "band": "off", "integral": False},
        {"compensation": "off", "linear": False, "integral": False},
    ],
    ids=str,
)
def test_what_carries_gravity_when_parts_are_out(options: Options) -> None:
    """At rest s = lambda e, and the parts that are left carry g(q) together; an integral carries all of it.

    K/phi s + Kd s + KF FIS(lambda e/gd, 0) or KF clip(lambda e/gd) + KI int e, without those that are out.
    """
    form = default_form("fuzzy-linear-band-smc") | BLIND | options
    gains = {name: GAINS[name] for name in acting("fuzzy-linear-band-smc", form)}
    rest = run(two_link(), "fuzzy-linear-band-smc", still(TARGET), 50.0, form, **gains)
    e, s = (rest.q_ref - rest.q)[-1], rest.s[-1]
    assert np.max(np.abs(rest.qd[-1])) < 1e-7
    assert s == pytest.approx(5.0 * e, abs=1e-6)
    assert np.max(np.abs(s)) < 1.0  # inside the band, where sat(s/phi) = s
    rules = {
        "fuzzy": np.array([exact_output(x, 0.0) for x in 5.0 * e / 0.5]),
        "off": np.zeros(2),
        "clipped-sum": np.clip(5.0 * e / 0.5, -1.0, 1.0),
    }[str(form["compensation"])]
    carried = 0.2 * TAU_MAX * rules
    carried = carried + (0.3 * TAU_MAX * s if form["band"] == "saturation" else 0.0)
    carried = carried + (20.0 * MBAR * s if form["linear"] else 0.0)
    carried = carried + (100.0 * MBAR * rest.extra["integral"][-1] if form["integral"] else 0.0)
    gravity = two_link_terms(rest.q[-1], np.zeros(2))[2]
    assert carried == pytest.approx(gravity, rel=1e-5)
    if form["integral"]:
        assert np.max(np.abs(e)) < 1e-5
    else:
        assert np.min(np.abs(e)) > 0.01


def test_the_pid_surface_carries_gravity_in_its_integral() -> None:
    """In the band and without a model K (lambda/2)^2 int e / phi = g(q) at rest, without an error; (86) and (127)."""
    options: Options = {**BLIND, "surface": "pid", "switching": "saturation"}
    rest = run(pendulum(), "smc", still(np.array([0.4])), 8.0, options, lam=10, k=0.6, phi=0.6)
    assert abs(rest.q_ref[-1, 0] - rest.q[-1, 0]) < 1e-6
    held = 0.6 * 40.0 / 0.6 * 25.0 * rest.extra["integral"][-1, 0]
    assert held == pytest.approx(MGL * np.cos(0.4), rel=1e-5)
    droops = run(pendulum(), "smc", still(np.array([0.4])), 8.0, options | {"surface": "pd"}, lam=10, k=0.6, phi=0.6)
    assert droops.q_ref[-1, 0] - droops.q[-1, 0] > 0.01


def test_the_fuzzy_pd_controller_droops() -> None:
    """At rest KF FIS(e/ge, 0) = g(q): what the rules give at zero rate."""
    rest = run(two_link(), "fuzzy-pd", still(TARGET), 8.0, kf=0.9, ge=0.2, gd=1.5)
    e, q = (rest.q_ref - rest.q)[-1], rest.q[-1]
    assert np.max(np.abs(rest.qd[-1])) < 1e-7
    carried = 0.9 * TAU_MAX * np.array([exact_output(x, 0.0) for x in e / 0.2])
    assert carried == pytest.approx(two_link_terms(q, np.zeros(2))[2], rel=1e-5)
    assert np.min(np.abs(e)) > 0.01


def test_the_fuzzy_pid_controller_does_not_droop() -> None:
    """At rest without an error KF/2 FIS(0, int e/gi) = g(q): the integral alone holds the arm."""
    rest = run(two_link(), "fuzzy-pid", still(TARGET), 20.0, kf=0.9, ge=0.2, gd=1.0, gi=0.05)
    assert np.max(np.abs(rest.q_ref[-1] - rest.q[-1])) < 1e-5
    carried = 0.45 * TAU_MAX * np.array([exact_output(0.0, z) for z in rest.extra["integral"][-1] / 0.05])
    assert carried == pytest.approx(two_link_terms(TARGET, np.zeros(2))[2], rel=1e-3)


def test_the_fuzzy_pi_controller_never_comes_to_rest() -> None:
    """A mass under a force of e and int e alone has m p^3 + kp p + ki = 0: two roots grow, whatever the gains.

    The real root is negative and the three add up to zero. Each swing past the target is wider than the one before.
    """
    swing = run(slider(), "fuzzy-pi", still(np.array([0.01])), 4.0, kf=0.02, ge=0.2, gi=0.05)
    e = (swing.q_ref - swing.q)[:, 0]
    crossings = np.flatnonzero(e[1:] * e[:-1] < 0.0)
    peaks = np.array([np.max(np.abs(e[a:b])) for a, b in itertools.pairwise(crossings)])
    assert len(peaks) >= 4
    assert np.all(np.diff(peaks) > 0.0)
    assert peaks[0] > 0.01
