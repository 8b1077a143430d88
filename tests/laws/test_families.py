"""The families of the paper's introduction: their equations at points, what they carry at rest, how they follow."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.arms import pendulum, still, two_link, two_link_terms
from tests.fuzzy.independent import exact_output
from tests.laws.family_equations import EQUATIONS, NINE, TWENTY_FIVE, Joints, Rules, State, rules_of, sat
from torquebench.experiment import load_experiment
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference, Sine
from torquebench.robot import Puma560, RobotModel, load_model
from torquebench.robot.library import data_root
from torquebench.sim.plants import Plant
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

T = 0.002
"""Control period of single calls [s]; not the default, so that a law that ignores it is found."""
EXACT = 1e-11
"""Relative tolerance: a few dozen roundings of 1e-16, of terms up to a hundred times their sum."""
LAYER, ESTIMATOR, SUPERVISED, ADAPTIVE, ONE, TWO = EQUATIONS
GAINS: dict[str, dict[str, Any]] = {
    LAYER: {"lam": [10.0, 4.0], "k": [0.3, 0.55], "phi": [0.6, 1.5], "gds": [200.0, 300.0]},
    ESTIMATOR: {
        "lam": [10.0, 4.0],
        "k": [0.3, 0.55],
        "phi": [0.6, 1.5],
        "kf": [0.2, 0.35],
        "ge": [0.2, 0.5],
        "gd": [2.0, 5.0],
    },
    SUPERVISED: {
        "lam": [10.0, 4.0],
        "k": [0.3, 0.45],
        "phi": [0.6, 1.5],
        "gis": [0.01, 0.02],
        "boost": [0.5, 0.8],
        "ge": [0.1, 0.4],
        "gd": [0.5, 3.0],
    },
    ADAPTIVE: {"lam": [10.0, 4.0], "kv": [20.0, 7.0], "kis": [50.0, 90.0], "phi": [0.6, 1.5], "gamma": [4e3, 9e3]},
    ONE: {"lam": [10.0, 4.0], "k": [0.3, 0.55], "phi": [0.6, 1.5]},
    TWO: {"lam": [10.0, 4.0], "k": [0.3, 0.55], "phi": [0.6, 1.5], "gis": [0.01, 0.02], "forget": [20.0, 30.0]},
}
"""Gains that differ between the joints."""
WITH_MODEL = (LAYER, ESTIMATOR, SUPERVISED)


class Motion(NamedTuple):
    """States of the two-joint arm at successive instants, and what is wanted there, (N, 2)."""

    q: Array
    qd: Array
    e: Array
    de: Array
    qdd_ref: Array


def motion() -> Motion:
    """Return 60 instants in which s wanders inside the bands, through them and far outside, with both signs."""
    t = np.arange(60)[:, None]
    q = np.array([0.4, -0.9]) + 0.3 * np.sin(0.11 * t + np.array([0.0, 1.0]))
    qd = 0.5 * np.cos(0.07 * t + np.array([0.3, 0.0]))
    e = np.array([0.05, -0.3]) * np.cos(0.09 * t + np.array([0.0, 0.4]))
    de = np.array([0.8, 2.4]) * np.sin(0.13 * t + np.array([0.5, 0.0]))
    return Motion(q, qd, e, de, 1.5 * np.sin(0.2 * t + np.array([0.0, 0.7])))


def equivalent(m: Motion, k: int, lam: Array, pull: float) -> Array:
    """Return M (qdd_ref + lam de [+ (lam/2)^2 e]) + C qd + g of the textbook's two-joint arm."""
    M, velocity, gravity = two_link_terms(m.q[k], m.qd[k])
    return M @ (m.qdd_ref[k] + lam * m.de[k] + pull * lam * lam * m.e[k]) + velocity + gravity


def step(
    arm: RobotModel, controller: Controller, memory: Any, q: Array, qd: Array, ref: Reference, T: float = T
) -> Array:
    """Return the torque of one call."""
    tau = np.full(arm.n, 99.0)
    controller.law.function(
        controller.gains, replace(arm.flat, control_period=T), 0.7, q.copy(), qd.copy(), ref, memory, tau
    )
    return tau


def packed(law: str, n: int, gains: dict[str, Any], options: dict[str, Any] | None = None) -> Controller:
    """Return a controller with the law's own rules."""
    found = find_law(law)
    return Controller(law, found, found.pack_gains(n, gains, options or {}))


def compare(law: str, options: dict[str, Any], gains: dict[str, Any], form: dict[str, Any]) -> Any:
    """Hold a law to its equation over the motion, torque and memory, and return its memory at the end."""
    arm, m = two_link(), motion()
    controller = packed(law, 2, gains, options)
    memory = controller.law.new_memory(2)
    flat, state = arm.flat, {}
    rules = rules_of(TWENTY_FIVE if law == SUPERVISED else None)
    joints = Joints(flat.tau_max, flat.inertia_scale, T, rules, rules_of(NINE))
    numbers = {name: np.array(value) for name, value in gains.items()} | form
    for k in range(len(m.q)):
        ref = Reference(m.q[k] + m.e[k], m.qd[k] + m.de[k], m.qdd_ref[k])
        tau_eq = np.zeros(2)
        if options.get("equivalent_control"):
            tau_eq = equivalent(m, k, numbers["lam"], 0.25 if law == ESTIMATOR else 0.0)
        wanted, state = EQUATIONS[law](numbers, joints, m.e[k], m.de[k], state, tau_eq)
        tau = step(arm, controller, memory, m.q[k], m.qd[k], ref)
        # the rates of s are differences over T of numbers near 1, so good to 1e-13; scaled by K slope / gds, to 1e-11
        assert tau == pytest.approx(wanted, rel=EXACT, abs=1e-10), k
        assert memory.s == pytest.approx(state["s"], rel=EXACT, abs=1e-13)
        for name in memory._fields:
            if name.startswith("theta_"):
                assert getattr(memory, name) == pytest.approx(state["theta"][int(name[-1]) - 1], rel=EXACT, abs=1e-12)
            elif name in state:
                assert getattr(memory, name) == pytest.approx(state[name], rel=EXACT, abs=1e-14)
    return memory


@pytest.mark.parametrize("law", EQUATIONS)
def test_each_law_is_its_equation(law: str) -> None:
    """Torque, s and all of memory over 60 instants on two joints with gains of their own, without a model."""
    options: dict[str, Any] = {"equivalent_control": False} if law in WITH_MODEL else {}
    compare(law, options | ({"switching": "saturation"} if law == ESTIMATOR else {}), GAINS[law], {})


@pytest.mark.parametrize("law", WITH_MODEL)
def test_the_model_adds_its_equivalent_control(law: str) -> None:
    """The same with tau_eq from the textbook's mass matrix, velocity torque and gravity."""
    options = {"equivalent_control": True} | ({"switching": "saturation"} if law == ESTIMATOR else {})
    compare(law, options, GAINS[law], {})


@pytest.mark.parametrize("surface", ["pid", "pi"])
def test_the_estimators_choices(surface: str) -> None:
    """Sgn(s) for sat(s/phi), and the surface without de."""
    gains = {name: value for name, value in GAINS[ESTIMATOR].items() if name != "phi"}
    compare(ESTIMATOR, {"switching": "sign", "surface": surface}, gains, {"sign": True, "pi": surface == "pi"})


def hand(
    law: str, e: float, de: float, gains: dict[str, Any], options: dict[str, Any] | None = None, **memory: float
) -> tuple[float, Any]:
    """Return the torque [N m] on a pendulum of 40 N m and Mbar = 0.5, and the memory after it."""
    arm, controller = pendulum(gravity=0.0), packed(law, 1, gains, options)
    state = controller.law.new_memory(1)
    for name, value in memory.items():
        getattr(state, name)[0] = value
    ref = Reference(np.array([e]), np.array([de]), np.zeros(1))
    return float(step(arm, controller, state, np.zeros(1), np.zeros(1), ref)[0]), state


def test_fuzzy_layer_by_hand() -> None:
    """s/phi = ds/gds = 1/4 is FIS = 31/69 (Z-Z, Z-PS, PS-Z at 1/4 and PS-PS at 3/4); 0.3 of 40 N m times that.

    s = 0.1 + 10 x 0.04 = 0.5 of phi = 2; it was 0.4, 2 ms ago: ds = 50 of gds = 200. At the first instant ds is zero.
    """
    gains, off = {"lam": 10, "k": 0.3, "phi": 2, "gds": 200}, {"equivalent_control": False}
    assert hand(LAYER, 0.04, 0.1, gains, off, s=0.4, seen=1.0)[0] == pytest.approx(12.0 * 31.0 / 69.0, rel=1e-10)
    at_first, memory = hand(LAYER, 0.04, 0.1, gains, off)
    assert at_first == pytest.approx(12.0 * exact_output(0.25, 0.0), rel=EXACT)
    assert (memory.s[0], memory.seen[0]) == (pytest.approx(0.5), 1.0)
    # s returns: the rule of PS and NS is Z
    assert hand(LAYER, 0.04, 0.1, gains, off, s=0.6, seen=1.0)[0] == pytest.approx(0.0, abs=1e-9)


def test_estimator_by_hand() -> None:
    """S = 0.1 + 0.4 + 25 x 0.02 = 1 is half of phi: 6 N m; e/ge = de/gd = 1/4: 0.2 x 40 x 31/69."""
    gains = {"lam": 10, "k": 0.3, "phi": 2, "kf": 0.2, "ge": 0.16, "gd": 0.4}
    tau, memory = hand(ESTIMATOR, 0.04, 0.1, gains, {"switching": "saturation"}, integral=0.02)
    assert tau == pytest.approx(6.0 + 8.0 * 31.0 / 69.0, rel=EXACT)
    assert memory.integral[0] == pytest.approx(0.02 + T * 0.04, rel=EXACT)


@pytest.mark.parametrize(("e", "de", "w"), [(0.0, 0.3, -0.5), (0.1, 0.0, 0.0), (0.05, 0.25, 0.0), (0.3, -2.0, 1.0)])
def test_supervisor_by_hand(e: float, de: float, w: float) -> None:
    """Of ge = 0.1 and gd = 0.5: none and more than half of the rate, all and none, half and half, more than all.

    The supervisor, pd-9: no error is N and rate 1/5 is Z to 4/5, P to 1/5: N-Z is N and N-P is Z. The outermost terms
    are N alone, P alone (x = y = -1 or 1), and N with P, or Z with Z, is Z. The gain goes from K to K (1 + boost).
    """
    gains = {"lam": 10, "k": 0.3, "phi": 2, "gis": 0.1, "boost": 0.6, "ge": 0.1, "gd": 0.5}
    if w == -0.5:  # N to 4/5, Z to 1/5: whole triangles of half-width 1 cut at these heights, around -1 and 0
        w = exact_output(-1.0, 0.2, NINE)
        assert -1.0 < w < -0.5
    s, off = de + 10.0 * e, {"equivalent_control": False}
    tau, memory = hand(SUPERVISED, e, de, gains, off, s_integral=0.05)
    pushed = exact_output(s / 2.0, 0.5, TWENTY_FIVE)
    assert tau == pytest.approx(12.0 * (1.0 + 0.3 * (1.0 + w)) * pushed, rel=1e-10)
    assert memory.s_integral[0] == pytest.approx(0.05 + T * s, rel=EXACT)


def test_the_supervised_integral_stops_at_its_scale() -> None:
    """Beyond gis it may only come back."""
    gains = {"lam": 10, "k": 0.3, "phi": 2, "gis": 0.1, "boost": 0, "ge": 0.1, "gd": 0.5}
    off = {"equivalent_control": False}
    assert hand(SUPERVISED, 0.1, 0.0, gains, off, s_integral=0.1)[1].s_integral[0] == 0.1
    assert hand(SUPERVISED, -0.1, 0.0, gains, off, s_integral=0.1)[1].s_integral[0] == pytest.approx(0.1 - T)


ADAPT = {"lam": 10, "kv": 20, "kis": 40, "phi": 1, "gamma": 300}
THETA = {f"theta_{k + 1}": v for k, v in enumerate([-7.0, -5.0, -3.0, 1.0, 4.0, 6.0, 9.0])}


def test_adaptation_by_hand() -> None:
    """S = phi/2 lies midway between the rules at 1/3 and 2/3, the fifth and sixth: half of 4 and of 6 N m.

    With Kd = 10, KI = 20 and int s = 0.1 the torque is 5 + 2 + 5 N m; both rules learn 0.002 x 300 x 0.5 x 0.5 x 0.5,
    the others nothing.
    """
    tau, memory = hand(ADAPTIVE, 0.04, 0.1, ADAPT, None, s_integral=0.1, **THETA)
    assert tau == pytest.approx(12.0, rel=EXACT)
    learnt = [getattr(memory, name)[0] - value for name, value in THETA.items()]
    assert learnt == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.075, 0.075, 0.0], abs=1e-12)
    assert memory.s_integral[0] == pytest.approx(0.1 + T * 0.5, rel=EXACT)


def test_adaptation_is_bounded_and_waits() -> None:
    """A rule stops at 40 N m; beyond 40 N m along s nothing is learnt, against s it is, and backwards."""
    more = ADAPT | {"gamma": 1e6}
    assert hand(ADAPTIVE, 0.1, 0.0, more, None, theta_7=35.0, s_integral=-1.0)[1].theta_7[0] == 40.0
    assert hand(ADAPTIVE, -0.1, 0.0, more, None, theta_1=-35.0, s_integral=1.0)[1].theta_1[0] == -40.0
    tau, waits = hand(ADAPTIVE, 0.1, 0.0, ADAPT, None, theta_7=35.0)
    assert tau == pytest.approx(45.0)  # 35 + Kd s
    assert (waits.theta_7[0], waits.s_integral[0]) == (35.0, 0.0)
    tau, goes = hand(ADAPTIVE, 0.1, 0.0, ADAPT, None, theta_7=35.0, s_integral=-5.0)
    assert tau == pytest.approx(-55.0)
    assert (goes.theta_7[0], goes.s_integral[0]) == (pytest.approx(35.3), pytest.approx(-5.0 + T))


@pytest.mark.parametrize("rule", range(1, 8))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_rule_stops_at_the_torque_limit(rule: int, side: float) -> None:
    """However fast it learns, no rule holds more than 40 N m: each where it fires, pushed to either side."""
    s = (rule - 4) / 3.0
    s = side * 0.05 if rule == 4 else s
    if s * side < 0.0:
        return  # a rule is pushed to the side of s alone
    name = f"theta_{rule}"
    start = {name: side * 35.0, "s_integral": -side}
    _, memory = hand(ADAPTIVE, s / 10.0, 0.0, ADAPT | {"gamma": 1e6}, None, **start)
    assert getattr(memory, name)[0] == side * 40.0


@pytest.mark.parametrize(
    ("x", "y"), [(0.0, 0.0), (1 / 6, 1 / 6), (1 / 3, 1 / 3), (-0.5, -0.5), (2 / 3, 2 / 3), (1, 1), (3, 1)]
)
def test_one_input_by_hand(x: float, y: float) -> None:
    """Seven rules, s -> s: at a term's middle that term alone, between two the middle of both, beyond phi all of K."""
    assert hand(ONE, 0.0, 2.0 * x, {"lam": 10, "k": 0.3, "phi": 2})[0] == pytest.approx(12.0 * y, abs=1e-12)


def test_one_input_has_seven_rules() -> None:
    """The torque is that of a system with one rule for each of the seven terms of s, and no others."""
    table = np.full((7, 7), -1)
    table[:, 3] = np.arange(7)
    for x in np.linspace(-1.2, 1.2, 41):
        seven_rules = exact_output(x, 0.0, table=table)
        assert hand(ONE, 0.0, 2.0 * x, {"lam": 10, "k": 0.3, "phi": 2})[0] == pytest.approx(12 * seven_rules, abs=1e-11)


def test_two_inputs_by_hand() -> None:
    """S = phi/4 and z = 1/4: 12 x 31/69 N m; z grows by 2 ms of 0.5/0.1 - 4 x 0.25, and stops at 1 and -1."""
    gains = {"lam": 10, "k": 0.3, "phi": 2, "gis": 0.1, "forget": 4}
    tau, memory = hand(TWO, 0.04, 0.1, gains, None, z=0.25)
    assert tau == pytest.approx(12.0 * 31.0 / 69.0, rel=EXACT)
    assert memory.z[0] == pytest.approx(0.25 + 0.002 * 4.0, rel=EXACT)
    assert hand(TWO, 0.1, 0.0, gains | {"gis": 1e-4}, None, z=0.25)[1].z[0] == 1.0
    assert hand(TWO, -0.1, 0.0, gains | {"gis": 1e-4}, None, z=0.25)[1].z[0] == -1.0


PUMA: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    LAYER: ({"lam": 20, "k": 0.6, "phi": 0.3, "gds": 1000}, {"equivalent_control": False}),
    ESTIMATOR: ({"lam": 20, "k": 0.6, "phi": 0.4, "kf": 0.3, "ge": 0.2, "gd": 4}, {"switching": "saturation"}),
    SUPERVISED: (
        {"lam": 20, "k": 0.6, "phi": 0.6, "gis": 0.05, "boost": 1, "ge": 0.05, "gd": 1},
        {"equivalent_control": False},
    ),
    ADAPTIVE: ({"lam": 20, "kv": 60, "kis": 600, "phi": 1, "gamma": 1000}, {}),
    ONE: ({"lam": 20, "k": 0.6, "phi": 0.4}, {}),
    TWO: ({"lam": 20, "k": 0.8, "phi": 0.8, "gis": 0.06, "forget": 1}, {}),
}
"""The gains of configs/paper/families.yaml, but without a model everywhere, which for the first law takes more of K."""


def test_the_gains_are_those_of_the_config() -> None:
    """What is held to its equation in the loop below is what the config runs."""
    listed = {keys.law: keys.gains for keys in load_experiment(data_root() / "configs/paper/families.yaml").controllers}
    assert list(listed) == list(EQUATIONS)
    assert {law: listed[law] for law in EQUATIONS if law != LAYER} == {
        law: gains for law, (gains, _) in PUMA.items() if law != LAYER
    }


def run_of(law: str, plant: Plant, belief: RobotModel, target: Any, duration: float) -> Trajectory:
    """Run a law with those gains."""
    gains, options = PUMA[law]
    return simulate(plant, packed(law, belief.n, gains, options), belief, target, duration=duration)


@pytest.mark.parametrize("law", EQUATIONS)
def test_at_rest_on_the_two_link_arm_each_carries_gravity_its_own_way(law: str) -> None:
    """In MuJoCo, without a model: what must hold at rest is read off the equation, and gravity from the textbook.

    Laws with an integral leave no error, and what they remember carries gravity; the others leave the error for which
    K FIS(lam e/phi, ..) is gravity. The joints of this arm turn about +y, so that gravity has the other sign.
    """
    arm, target = load_model("two-link"), np.array([0.4, -0.6])
    run = run_of(law, MujocoPlant("two-link"), arm, still(target), 8.0)
    gains = PUMA[law][0]
    e, q = (run.q_ref - run.q)[-1], run.q[-1]
    held = {name: values[-1] for name, values in run.extra.items()}
    assert np.max(np.abs(run.qd[-1])) < 1e-6
    gravity = -two_link_terms(q, np.zeros(2))[2]
    assert np.min(np.abs(gravity)) > 3.0
    K, phi, lam = gains.get("k", 0.0) * np.array([80.0, 25.0]), gains["phi"], gains["lam"]
    zero, rules, some = np.zeros(2), rules_of(), rules_of(TWENTY_FIVE)
    if law == LAYER:
        carried = K * rules(lam * e / phi, zero)
    elif law == ESTIMATOR:
        carried = K * sat(0.25 * lam * lam * held["integral"] / phi)
    elif law == SUPERVISED:  # no error and no rate: the supervisor's rule N, which leaves K as it is
        carried = K * some(zero, held["s_integral"] / gains["gis"])
    elif law == ADAPTIVE:  # the middle rule alone fires
        carried = gains["kis"] * arm.flat.inertia_scale * held["s_integral"] + held["theta_4"]
    elif law == ONE:
        carried = K * rules(lam * e / phi, zero)
    else:  # z forgets what s adds: s/gis = forget z
        carried = K * rules(lam * e / phi, lam * e / (gains["gis"] * gains["forget"]))
    # an error of 1e-7 rad, left by the slowest part, is 1e-4 N m at the stiffest of them
    assert carried == pytest.approx(gravity, rel=1e-4)
    if law in (ESTIMATOR, SUPERVISED, ADAPTIVE):
        assert np.max(np.abs(e)) < 1e-6
    else:
        assert np.min(np.abs(e)) > 1e-4


@cache
def grid_rules(terms: int) -> Rules:
    """Return the output of terms^2 rules interpolated in a table of `exact_output`; a test below says how well."""
    nodes, peaks = np.linspace(-1.0, 1.0, 73), np.linspace(-1.0, 1.0, terms)
    table = np.array([[exact_output(x, y, peaks) for y in nodes] for x in nodes])

    def output(x: Array, y: Array) -> Array:
        a, b = (36.0 * (sat(z) + 1.0) for z in (x, y))
        i, j = (np.minimum(z.astype(int), 71) for z in (a, b))
        u, v = a - i, b - j
        low, high = (table[i + d, j] * (1.0 - v) + table[i + d, j + 1] * v for d in (0, 1))
        return np.asarray(low * (1.0 - u) + high * u)

    return output


def test_the_tables_of_rules_are_near_enough() -> None:
    """Between their nodes, where they are worst, they are off by less than 1 % of the most that the rules ask for."""
    x, y = (np.random.default_rng(3).uniform(-1.0, 1.0, 300) for _ in range(2))
    for peaks in (NINE, TWENTY_FIVE, None):
        terms = 7 if peaks is None else len(peaks)
        assert grid_rules(terms)(x, y[::-1]) == pytest.approx(rules_of(peaks)(x, y[::-1]), abs=0.01)


@pytest.mark.parametrize("law", EQUATIONS)
def test_on_the_puma_each_leaves_the_error_that_its_equation_needs(law: str) -> None:
    """Without a model a law makes torque from error alone, so the error follows from the torque of the motion.

    The desired motion's torque comes from inverse dynamics; at each instant the equation is solved for the de that
    makes it, by bisection, and e = int de. Errors of some mrad hardly change the torque: over 1 s of tracking the
    errors' size agrees to 4 %, and they themselves to 15 % of it, most of that where max-min rules are flat: 20 % with
    25 rules, whose stairs are wider.
    """
    duration, h = 2.0, 0.002
    arm, target = Puma560(), Sine(np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0]), np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))
    wanted = target(np.arange(0.0, duration, h))
    torque = arm.inverse_dynamics(wanted.q, wanted.qd, wanted.qdd)
    rules = grid_rules(5 if law == SUPERVISED else 7)
    joints = Joints(arm.flat.tau_max, arm.flat.inertia_scale, h, rules, grid_rules(3))
    e, errors = np.zeros(6), []
    state: State = {}
    for tau in torque:
        errors.append(e)
        low, high = np.full(6, -20.0), np.full(6, 20.0)
        for _ in range(24):
            de = 0.5 * (low + high)
            short = EQUATIONS[law](PUMA[law][0], joints, e, de, state, np.zeros(6))[0] < tau
            low, high = np.where(short, de, low), np.where(short, high, de)
        state = EQUATIONS[law](PUMA[law][0], joints, e, de, state, np.zeros(6))[1]
        e = e + h * de
    run = run_of(law, AnalyticPlant(arm), arm, target, duration)
    found, predicted = (run.q_ref - run.q)[1000:2000:2], np.array(errors)[500:]
    size = float(np.sqrt(np.mean(found**2)))
    assert float(np.sqrt(np.mean(predicted**2))) == pytest.approx(size, rel=0.04)
    assert float(np.sqrt(np.mean((found - predicted) ** 2))) < (0.2 if law == SUPERVISED else 0.15) * size
    assert 1e-3 < size < 1e-2
