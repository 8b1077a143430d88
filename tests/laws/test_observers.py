"""Laws with observers, with adaptation and of least cost: equations, points by hand, and what each does in the loop."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from tests.arms import G, chain, pack, pendulum, slider, still, two_link
from tests.laws.observer_equations import EQUATIONS, TRUE, At, planar, sizes
from tests.laws.test_families import motion, packed, step
from torquebench.disturbances.bias import Bias
from torquebench.errors import ConfigError
from torquebench.experiment import parse_experiment
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference, Sine
from torquebench.robot import Puma560, RobotModel
from torquebench.robot.payload import Payload
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

T = 0.002
"""Control period of single calls [s]; not the default, so that a law that ignores it is found."""
GAINS: dict[str, dict[str, Any]] = {
    "time-delay": {"lam": [10.0, 4.0], "kv": [20.0, 7.0], "m": [0.15, 0.3]},
    "disturbance-observer": {"lam": [10.0, 4.0], "kv": [20.0, 7.0], "wo": [30.0, 90.0]},
    "adrc": {"lam": [10.0, 4.0], "kv": [20.0, 7.0], "wo": [50.0, 90.0], "m": [0.8, 1.3]},
    "lqr": {"error": [0.2, 0.1], "rate": [4.0, 3.0]},
    "slotine-li": {"lam": [3.0, 2.0], "kv": [20.0, 30.0], "gamma": [0.4, 0.9], "bound": [0.06, 0.2]},
}
"""Gains that differ between the joints."""
SINE = {
    "puma560": Sine([1.2, -1.0, 1.0, 1.0, 1.0, 1.0], [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
    "two": Sine([1.0, -0.8], [0.5, 0.7]),
}


@cache
def arm_of(name: str) -> RobotModel:
    """Return the PUMA or the two-joint arm."""
    return Puma560() if name == "puma560" else two_link()


def run(
    arm: RobotModel,
    law: str,
    reference: Any,
    duration: float,
    *,
    T: float = 0.001,
    load: Any = None,
    payload: Payload | None = None,
    belief: RobotModel | None = None,
    **gains: Any,
) -> Trajectory:
    """Run a law on an arm with a constant torque on it; gains that are not given are chosen."""
    found = find_law(law).choose_gains(belief or arm, T, given=gains)
    return simulate(
        AnalyticPlant(arm, timestep=T, payload=payload),
        pack(law, arm.n, {}, **found),
        belief or arm,
        reference,
        duration=duration,
        control_period=T,
        disturbances=[] if load is None else [Bias(load)],
    )


@pytest.mark.parametrize("law", EQUATIONS)
def test_each_law_is_its_equation(law: str) -> None:
    """Torque and memory over 60 instants on two joints with gains of their own, some of them beyond a limit.

    The observer's C' qd is good to 1e-6 here, and its sum over T: differences of 1e-5 of the torque.
    """
    arm, m = two_link(), motion()
    controller = packed(law, 2, GAINS[law])
    memory, kept = controller.law.new_memory(2), {}
    gains = {name: np.array(value) for name, value in GAINS[law].items()}
    loose = law == "disturbance-observer"
    beyond = 0
    for k in range(len(m.q)):
        at = At(m.q[k], m.qd[k], m.e[k], m.de[k], m.qdd_ref[k], arm.flat.tau_max, arm.flat.inertia_scale, T)
        wanted, kept = EQUATIONS[law](gains, at, kept)
        ref = Reference(m.q[k] + m.e[k], m.qd[k] + m.de[k], m.qdd_ref[k])
        tau = step(arm, controller, memory, m.q[k], m.qd[k], ref)
        beyond += bool(np.any(np.abs(wanted) > arm.flat.tau_max))
        assert tau == pytest.approx(wanted, rel=1e-5 if loose else 1e-9, abs=1e-4 if loose else 1e-9), k
        for name in memory._fields if law != "disturbance-observer" else ("residual",):
            if name in kept:
                assert getattr(memory, name) == pytest.approx(kept[name], rel=1e-5, abs=1e-4 if loose else 1e-9), name
    assert 0 < beyond < len(m.q)


def hand(law: str, e: float, de: float, gains: dict[str, Any], qd: float = 0.0, q: float = 0.0, **memory: float) -> Any:
    """Return the torque [N m] on a pendulum of 40 N m, Mbar = 0.5, M = 0.6, m g l = 9.81, and the memory after it."""
    arm, controller = pendulum(), packed(law, 1, gains)
    state = controller.law.new_memory(1)
    for name, value in memory.items():
        getattr(state, name)[0] = value
    ref = Reference(np.array([q + e]), np.array([qd + de]), np.array([1.5]))
    return float(step(arm, controller, state, np.array([q]), np.array([qd]), ref)[0]), state


def test_time_delay_by_hand() -> None:
    """1.5 + 20 (0.1 + 10 x 0.04) = 11.5 is wanted, 0.01 / 0.002 = 5 was had: 7 + 0.2 x 0.5 x 6.5 = 7.65 N m.

    Of a torque beyond 40 N m, the limit is kept.
    """
    gains = {"lam": 10, "kv": 20, "m": 0.2}
    tau, memory = hand("time-delay", 0.04, 0.1, gains, qd=0.31, torque=7.0, velocity=0.3)
    assert tau == pytest.approx(7.65, rel=1e-12)
    assert (memory.torque[0], memory.velocity[0]) == (tau, 0.31)
    tau, memory = hand("time-delay", 0.04, 0.1, gains, qd=0.31, torque=40.0, velocity=0.3)
    assert (tau, memory.torque[0]) == (pytest.approx(40.65), 40.0)


def test_observers_by_hand() -> None:
    """With momentum 0.6 x 0.31 where 0.6 x 0.3 + T x 9.81/2 less was to be, 3 N m was met beside the model.

    A joint that hangs out flat has rate -9.81: at the same pose before, expected is 0.18 - T 9.81 / 2 and momentum
    0.186, so met = 3 + 4.905 + 4.905 - ... by the two halves of the rate: 0.006 / 0.002 + 9.81 = 12.81 N m. With
    wo = 500 ln 2 half of what it is beyond r = 2.81 is taken: r = 7.81. M wanted is 0.6 x 11.5: 6.9 + 9.81 - 7.81.
    """
    gains = {"lam": 10, "kv": 20, "wo": 500.0 * np.log(2.0)}
    was = 0.18 - T * 9.81 / 2.0
    tau, memory = hand("disturbance-observer", 0.04, 0.1, gains, qd=0.31, residual=2.81, expected=was, seen=1.0)
    assert memory.residual[0] == pytest.approx(7.81, rel=1e-9)
    assert tau == pytest.approx(8.9, rel=1e-9)
    assert memory.expected[0] == pytest.approx(0.186 + T * (8.9 - 9.81 / 2.0), rel=1e-9)
    # an observer that has seen nothing starts with no residual
    assert hand("disturbance-observer", 0.04, 0.1, gains, qd=0.31)[1].residual[0] == 0.0


def test_extended_state_observer_by_hand() -> None:
    """Inertia 0.4, torque 1 N m and z3 = 1.5: z moves by 4 rad/s^2; z1 = 0.1 + 1e-3 + 8e-6, z2 = 0.5 + 8e-3, T = 2 ms.

    With half as pole, 8e-6 rad that are missed give 7/8 of it, 3/8 x 3/2 / T and 1/8 / T^2: z1 + 7e-6,
    z2 + 2.25e-3, z3 + 0.25.
    """
    gains = {"lam": 10, "kv": 20, "wo": 500.0 * np.log(2.0), "m": 0.8}
    memory = {"position": 0.1, "velocity": 0.5, "disturbance": 1.5, "torque": 1.0, "seen": 1.0}
    tau, after = hand("adrc", 0.0, 0.0, gains, q=0.101016, **memory)
    assert after.position[0] == pytest.approx(0.101015, rel=1e-9)
    assert after.velocity[0] == pytest.approx(0.508 + 0.375 * 8e-6 / 0.002 * 1.5, rel=1e-9)
    assert after.disturbance[0] == pytest.approx(1.75, rel=1e-9)
    z2 = after.velocity[0]
    assert tau == pytest.approx(0.4 * (1.5 + 20.0 * (-z2 + 10.0 * 1e-6) - 1.75), rel=1e-9)
    first = hand("adrc", 0.01, 0.2, gains, q=0.3, qd=0.4)[1]
    assert (first.position[0], first.velocity[0], first.disturbance[0]) == (0.3, 0.4, 0.0)


def test_slotine_li_by_hand() -> None:
    """S = 0.1 + 10 x 0.04 = 0.5, qddr = 1.5 + 10 x 0.1 = 2.5: 0.6 x 2.5 + 9.81 + 20 x 0.5 x 0.5 = 16.31 N m.

    Of one link of 2 kg and I_zz 0.53, with I_yy the same and I_xx 0, l0^2 = 0.53 / 2: first moments along the link
    learn 0.002 gamma (2^2 l0^2) 9.81 s, across it nothing at q = 0; I_zz learns 0.53^2 2.5 s, the rotor 0.5^2 2.5 s.
    """
    gains = {"lam": 10, "kv": 20, "gamma": 0.1, "bound": 1}
    tau, memory = hand("slotine-li", 0.04, 0.1, gains)
    assert tau == pytest.approx(16.31, rel=1e-12)
    rate = 0.002 * 0.1
    assert memory.moment_x[0] == pytest.approx(rate * 4.0 * 0.265 * 9.81 * 0.5, rel=1e-12)
    assert memory.inertia_zz[0] == pytest.approx(rate * 0.53**2 * 2.5 * 0.5, rel=1e-12)
    assert memory.rotor[0] == pytest.approx(rate * 0.25 * 2.5 * 0.5, rel=1e-12)
    others = [x for x in memory._fields if x not in ("s", "moment_x", "inertia_zz", "rotor")]
    assert all(abs(getattr(memory, name)[0]) < 1e-15 for name in others)
    # a rotor of 0.07 cannot lose more than it has; a link gains no more than bound; nothing moves beyond 40 N m
    fast = gains | {"gamma": 1e4}
    assert hand("slotine-li", -0.04, -0.1, fast)[1].rotor[0] == pytest.approx(-0.07, abs=1e-15)
    assert hand("slotine-li", 0.04, 0.1, fast | {"bound": 0.3})[1].moment_x[0] == pytest.approx(0.3 * 2.0 * 0.265**0.5)
    tau, frozen = hand("slotine-li", 0.4, 0.1, gains)
    assert tau > 40.0
    assert frozen.s[0] == pytest.approx(4.1)
    assert all(getattr(frozen, name)[0] == 0.0 for name in memory._fields[1:])


def test_lqr_solves_the_riccati_equation() -> None:
    """Its gains are those of scipy's Riccati solver for M_ii dde = -tau at each pose of the two-joint arm."""
    arm, gains = two_link(), {"error": np.array([0.2, 0.1]), "rate": np.array([4.0, 3.0])}
    for q in ([0.3, 0.2], [0.3, 2.5]):
        at = At(np.array(q), np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), *(np.zeros(2),) * 2, T)
        controller, M = packed("lqr", 2, gains), np.diag(arm.mass_matrix(at.q))

        def torque(e: Array, de: Array, q: Array = at.q, controller: Any = controller) -> Array:
            return step(arm, controller, object(), q - e, -de, Reference(q, np.zeros(2), np.zeros(2)))

        for i in range(2):
            A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [-1.0 / M[i]]])
            Q = np.diag([1.0 / gains["error"][i] ** 2, 1.0 / gains["rate"][i] ** 2])
            R = np.array([[1.0 / arm.flat.tau_max[i] ** 2]])
            K = -np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))[0]
            unit, none = np.eye(2)[i], np.zeros(2)
            found = [torque(0.01 * unit, none) - torque(none, none), torque(none, 0.01 * unit) - torque(none, none)]
            assert [x[i] / 0.01 for x in found] == pytest.approx(K, rel=1e-8)
            assert [x[1 - i] for x in found] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("wo", [5.0, 40.0])
def test_the_residual_is_of_first_order_with_its_pole_at_the_gain(wo: float) -> None:
    """On a mass under 3 N, r after k instants is 3 (1 - exp(-wo k T)) to rounding: momentum is exact there."""
    found = run(slider(), "disturbance-observer", still(np.zeros(1)), 0.5, load=3.0, lam=5.0, kv=20.0, wo=wo)
    k = np.arange(len(found.t))
    assert found.extra["residual"][:, 0] == pytest.approx(3.0 * (1.0 - np.exp(-wo * k * 0.001)), abs=1e-10)


@pytest.mark.parametrize("arm", ["puma560", "two"])
def test_the_residual_is_that_on_arms_in_motion(arm: str) -> None:
    """Along a sine r of every joint is 1 - exp(-wo t) of its torque: the rest of the momentum is known to T^2.

    The third derivative of the momentum, some 1e3 N m/s^2, makes T^2 / 12 of it 1e-4 N m; the loop starts with a jump.
    """
    load = 1.0
    found = run(arm_of(arm), "disturbance-observer", SINE[arm], 1.0, load=load, wo=20.0)
    wanted = load * (1.0 - np.exp(-20.0 * found.t))[:, None]
    assert np.max(np.abs(found.extra["residual"] - wanted)) < 3e-3


def test_the_observers_error_has_a_triple_pole() -> None:
    """Of a disturbance of 3 N on 2 kg known to the observer, z3 - 1.5 is -1.5 times a known polynomial of k and pole^k.

    The error's recursion is written out with the observer's matrix, whose characteristic polynomial is (x - pole)^3.
    """
    wo, h = 60.0, 0.001
    found = run(slider(), "adrc", still(np.zeros(1)), 0.3, load=3.0, lam=5.0, kv=20.0, wo=wo, m=1.0)
    b = np.exp(-wo * h)
    F = np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    correct = np.array([[1.0 - b**3], [1.5 * (1.0 - b) ** 2 * (1.0 + b) / h], [(1.0 - b) ** 3 / h**2]])
    step_ = (np.eye(3) - correct @ [[1.0, 0.0, 0.0]]) @ F
    assert np.poly(step_) == pytest.approx([1.0, -3.0 * b, 3.0 * b * b, -(b**3)], abs=1e-9)
    error = np.array([0.0, 0.0, -1.5])
    for z3 in found.extra["disturbance"][:, 0]:
        assert z3 - 1.5 == pytest.approx(error[2], abs=1e-7)
        error = step_ @ error


@pytest.mark.parametrize("arm", ["puma560", "two"])
@pytest.mark.parametrize("law", ["time-delay", "adrc", "disturbance-observer", "lqr"])
def test_a_constant_load_leaves_no_error_but_of_lqr(arm: str, law: str) -> None:
    """At rest under gravity and 2 N m more, laws with an estimate have no error; LQR's is the load over P."""
    model = arm_of(arm)
    found = run(model, law, still(np.full(model.n, 0.2)), 3.0, load=2.0)
    e = (found.q_ref - found.q)[-1]
    if law == "lqr":
        P = model.flat.tau_max / np.array(find_law(law).choose_gains(model)["error"])
        # the feed-forward's gravity is that of q_ref, not q: within the slope of gravity over P
        assert e == pytest.approx(-2.0 / P, rel=0.05)
    else:
        assert np.max(np.abs(e)) < 1e-8


@pytest.mark.parametrize(("arm", "mass"), [("puma560", 2.0), ("two", 0.5)])
def test_slotine_li_learns_a_load(arm: str, mass: float) -> None:
    """The error under a load that the model does not have falls to two fifths in 12 s; without adaptation it stays."""
    model = arm_of(arm)

    def shares(**gains: float) -> tuple[float, Trajectory]:
        found = run(model, "slotine-li", SINE[arm], 12.0, payload=Payload(mass), **gains)
        e = np.abs(found.q_ref - found.q)
        return float(np.sqrt(np.mean(e[-2000:] ** 2) / np.mean(e[:2000] ** 2))), found

    share, found = shares()
    assert share < 0.4
    assert shares(gamma=0.0)[0] > 0.7
    assert np.all(found.extra["mass"] >= -model.flat.mass - 1e-12)
    assert np.all(np.abs(found.extra["mass"]) <= np.mean(model.flat.mass) + 1e-12)


def test_v_of_slotine_and_li_falls() -> None:
    """On the two-joint arm with a wrong belief V = (s' M s + (a - a*)' Gamma^-1 (a - a*)) / 2 falls all the way.

    It falls by s' Kd s while no number meets its bound, from which the belief's heavy rotors keep all. In samples it
    rises by what is held over T: nowhere by more than 1e-4 of where it began at 0.25 ms.
    """
    true = two_link()
    wrong = chain(
        np.array([0.0, 1.0]), np.array([2.3, 1.4]), np.array([0.6, 0.3]), np.array([0.2, 0.03]), np.array([0.5, 0.2]),
        true.flat.tau_max, true.flat.inertia_scale,
    )  # fmt: skip
    gamma = 0.2
    found = run(true, "slotine-li", SINE["two"], 3.0, T=0.00025, belief=wrong, lam=8.0, kv=20.0, gamma=gamma, bound=3.0)
    assert np.all(np.abs(found.tau) < true.flat.tau_max)
    flat = wrong.flat
    m0 = float(np.mean(flat.mass))
    l0 = float(np.sqrt(0.5 * np.sum(flat.about_origin[:, 4:7]) / np.sum(flat.mass)))
    size = {"mass": m0, "moment_x": m0 * l0, "inertia_zz": m0 * l0 * l0, "rotor": flat.inertia_scale}
    belief = {"mass": flat.mass, "moment_x": flat.about_origin[:, 1], "inertia_zz": flat.about_origin[:, 6]}
    belief["rotor"] = flat.armature
    s = found.s
    assert s is not None
    V = 0.5 * np.einsum("ki,kij,kj->k", s, true.mass_matrix(found.q), s)
    for name, scale in size.items():
        wrong_by = belief[name] + found.extra[name] - TRUE[name]
        V += 0.5 * np.sum((wrong_by / scale) ** 2, axis=1) / gamma
    V += 0.5 * np.sum((found.extra["moment_y"] / (m0 * l0)) ** 2, axis=1) / gamma
    assert np.max(np.diff(V)) < 1e-4 * V[0]
    assert V[-1] < 0.97 * V[0]
    assert V[0] - V[-1] == pytest.approx(
        0.00025 * np.sum(20.0 * flat.inertia_scale * s**2), rel=0.02
    )  # dV/dt = -s' Kd s


def test_sizes_are_of_the_arm_of_the_tests() -> None:
    """The textbook's equations have the arm's own gravity and inertias: at rest Y a is gravity's torque."""
    q = np.array([0.4, -0.9])
    zero = np.zeros(2)
    assert planar(TRUE, q, zero, zero, zero) == pytest.approx(two_link().gravity(q), rel=1e-12)
    assert G == 9.81
    assert sizes(np.ones(2))["mass"] == pytest.approx(1.5)


CONFIG = """\
name: own
plant: {model: puma560}
model: {structure: %s}
controllers:
  - {law: slotine-li, gains: auto}
reference: {kind: sine, amplitude: 0.5, frequency_hz: 0.5}
run: {duration: 2}
"""


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_a_model_without_links_is_refused(structure: str) -> None:
    """Slotine and Li's law with the paper's closed forms is a mistake in the config, and of `simulate`'s arguments."""
    with pytest.raises(ConfigError, match=rf"controllers\[0\]\.law: law 'slotine-li'.*links.*{structure}") as caught:
        parse_experiment(CONFIG % structure)
    assert "model.structure exact" in str(caught.value)
    parse_experiment(CONFIG % "exact")
    with pytest.raises(ValueError, match="links of a rigid body"):
        run(Puma560(), "slotine-li", SINE["puma560"], 0.01, belief=Puma560(structure))  # type: ignore[arg-type]
