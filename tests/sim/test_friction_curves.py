"""Friction that is more than a line: Stribeck's curve, load and LuGre's bristles, against closed forms and MuJoCo."""

from __future__ import annotations

import re
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arms import slider
from tests.sim.protocol import differing_bytes
from tests.sim.test_friction import COULOMB, VISCOUS, plants, rubbing
from tests.sim.test_joints import SOFT, pendulum
from torquebench.kernel import Array
from torquebench.kernel.twin import on_numbers
from torquebench.robot import Puma560
from torquebench.robot.library import ArmFile
from torquebench.sim.friction import FRICTIONS, Friction, FrictionError, SteepError, drag_along, steady
from torquebench.sim.joints import SpringError, Transmission
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant

STRIBECK = Friction(0.5, 2.0, 0.01, breakaway=3.0, stribeck_speed=0.1)
LUGRE = Friction(0.4, 1.0, breakaway=1.5, stribeck_speed=0.01, bristle_stiffness=1e4, bristle_damping=50.0)
"""Of the size of Canudas de Wit's own example: mass 1 kg, sigma_0 = 1e5 N/m, F_C = 1 N, F_S = 1.5 N."""
ALL = Friction(
    VISCOUS,
    COULOMB,
    breakaway=tuple(1.5 * x for x in COULOMB),
    load=0.05,
    bristle_stiffness=300.0,
    bristle_damping=0.02,
)


def rates_of(friction: Friction, mass: float, push: Any) -> Any:
    """Return the rates of (position, velocity, bristle) of a mass on bristles, written down from the paper."""
    s0, s1, s2 = friction.bristle_stiffness, friction.bristle_damping, friction.viscous
    C, B, vs = friction.coulomb, friction.breakaway, friction.stribeck_speed

    def rates(t: float, y: Array) -> list[float]:
        x, v, z = y
        slip = v - s0 * abs(v) * z / (C + (B - C) * np.exp(-((v / vs) ** 2)))
        return [v, (push(t, x, v) - s0 * z - s1 * slip - s2 * v) / mass, slip]

    return rates


@pytest.mark.parametrize("bristles", [0.0, 5e3])
def test_steady_sliding_is_stribeck_s_curve_under_load(bristles: float) -> None:
    """Friction is viscous v + sgn(v) (C + (B - C) exp(-(v/vs)^2) + load |tau|), bristles or not, to round-off."""
    friction = Friction(0.5, 2.0, breakaway=3.0, stribeck_speed=0.1, load=0.1, bristle_stiffness=bristles)
    v, torque = np.array([[0.02], [-0.05], [0.3], [-2.0]]), np.array([[4.0], [-7.0], [0.0], [9.0]])
    curve = 0.5 * v + np.sign(v) * (2.0 + np.exp(-((v / 0.1) ** 2)) + 0.1 * np.abs(torque))
    assert steady(friction.of_joints(1), v, torque) == pytest.approx(curve, rel=1e-14)


def test_gears_that_are_driven_from_behind_have_another_efficiency() -> None:
    """Power out is eta times power in, whichever side drives: load 1 - eta, and 1/eta - 1 where the torque holds back.

    Of a motor's torque that drives eta is left at the joint; one that holds the joint back is eta times what it bears.
    """
    forth, back = 0.8, 0.5
    gears = Friction(speed=1e-6, load=1.0 - forth, load_backdriving=1.0 / back - 1.0).of_joints(1)
    v, torque = np.array([[0.3], [-0.3], [0.3], [-0.3]]), np.array([[5.0], [-5.0], [-5.0], [5.0]])
    net = torque - steady(gears, v, torque)
    assert net[:2] == pytest.approx(forth * torque[:2], rel=1e-14)
    assert back * net[2:] == pytest.approx(torque[2:], rel=1e-14)
    alike = Friction(1.0, 2.0, load=0.1)
    assert alike.of_joints(1).held == alike.of_joints(1).load == 0.1


@pytest.mark.parametrize(("rate", "level"), [(0.5, 1.5365), (5.0, 1.595)])
def test_a_joint_breaks_away_near_its_breakaway_torque(rate: float, level: float, figure: Any) -> None:
    """A force rising at `rate` [N/s] on 1 kg, beside LSODA at 1e-9: the way within 1e-4 of it up to 1.9 N.

    The mass exceeds 0.01 m/s at `level`, a little above the 1.5 N of its break-away, the more the quicker the force
    rises, because it has to gather speed meanwhile.
    """
    h = 0.001
    t = h * np.arange(round(1.9 / rate / h))
    plant = AnalyticPlant(slider(1.0), h, friction=LUGRE)
    plant.reset(np.zeros(1), np.zeros(1))
    states = []
    for now in t:
        states.append(np.concatenate(plant.state()))
        plant.step(np.array([rate * (now + 0.5 * h)]), 1)
    q, qd = np.array(states).T
    rates = rates_of(LUGRE, 1.0, lambda t, x, v: rate * t)
    exact = solve_ivp(rates, (0.0, t[-1]), np.zeros(3), method="LSODA", rtol=1e-9, atol=1e-13, t_eval=t).y
    gap = float(np.max(np.abs(q - exact[0])) / exact[0, -1])
    figure(f"way of a mass on bristles under {rate:g} N/s, against LSODA [share]", gap, "<= 1e-4")
    assert gap <= 1e-4
    for v in (qd, exact[1]):
        assert rate * t[np.argmax(v > 0.01)] == pytest.approx(level, abs=2.0 * rate * h)


def test_bristles_keep_second_order(figure: Any) -> None:
    """A push of 1.4 N at 2 Hz for 0.2 s: halving the step divides the error by 2^2, the order within 0.1."""
    ends = []
    for h in (0.002, 0.001, 0.0005, 0.0000625):
        plant = AnalyticPlant(slider(1.0), h, friction=LUGRE)
        plant.reset(np.zeros(1), np.zeros(1))
        for k in range(round(0.2 / h)):
            push = [1.4 * np.sin(4.0 * np.pi * h * (k + part)) for part in (0.0, 0.5, 1.0)]
            plant.step(np.array(push)[:, None], 1)
        ends.append(plant.state()[0][0])
    errors = np.abs(np.array(ends[:-1]) - ends[-1])
    order = float(np.polyfit(np.log([4.0, 2.0, 1.0]), np.log(errors), 1)[0])
    figure("order of a mass on bristles", order, "2 within 0.1")
    assert order == pytest.approx(2.0, abs=0.1)


def test_the_loop_of_presliding_has_dahl_s_area(figure: Any) -> None:
    """Slow strokes of +-a on bristles enclose 4 a g - 4 (g^2/sigma_0) tanh(a sigma_0/g), within 1e-4 at 2000 steps.

    It follows from dz/dq = 1 - sgn(qd) sigma_0 z/g, Dahl's equation, at steady strokes; (a, g, sigma_0) are 1e-4 m, 1 N
    and 1e4 N/m.
    """
    a, g, stiffness, steps = 1e-4, 1.0, 1e4, 2000
    bristles = Friction(coulomb=g, bristle_stiffness=stiffness).of_joints(1)
    area, h = 0.0, 1.0 / steps
    for k in range(4 * steps):
        velocity = np.array([a * np.pi * 2.0 * np.cos(2.0 * np.pi * k * h)])
        on_numbers(drag_along)(bristles, velocity, np.zeros(1), h)
        ahead = 0.5 * (velocity[0] + a * np.pi * 2.0 * np.cos(2.0 * np.pi * (k + 1) * h))
        area += stiffness * bristles.bristles[0] * ahead * h if k >= 3 * steps else 0.0
    exact = 4.0 * a * g - 4.0 * g * g / stiffness * np.tanh(a * stiffness / g)
    figure("area of presliding's loop against Dahl's [share]", abs(area / exact - 1.0), "<= 1e-4")
    assert area == pytest.approx(exact, rel=1e-4)


def test_a_joint_on_bristles_sticks(figure: Any) -> None:
    """Under 0.9 of Coulomb friction it comes to rest and stays; without them it creeps at 0.9/(C/speed + b)."""
    moved = []
    for friction in (LUGRE, Friction(0.4, 1.0)):
        plant = AnalyticPlant(slider(1.0), 0.001, friction=friction)
        plant.reset(np.zeros(1), np.zeros(1))
        plant.step(np.array([0.9]), 1000)
        start = plant.state()[0][0]
        plant.step(np.array([0.9]), 1000)
        moved.append(float(plant.state()[0][0] - start))
    figure("way in the 2nd second on bristles under 0.9 N [m]", abs(moved[0]), "<= 1e-12")
    assert abs(moved[0]) <= 1e-12
    assert moved[1] == pytest.approx(0.9 / 100.4, rel=1e-9)


def test_stick_slip_is_what_another_integrator_makes_of_it(figure: Any) -> None:
    """A mass drawn through a spring at 0.1 m/s for 6 s, beside LSODA at 1e-8: peaks of its force within 2 mN."""
    k, speed, h = 8.0, 0.1, 0.001
    plant = AnalyticPlant(slider(1.0), h, friction=LUGRE)
    plant.reset(np.zeros(1), np.zeros(1))
    ours = []
    for i in range(6000):
        x = plant.state()[0][0]
        ours.append(k * (speed * i * h - x))
        plant.step(np.array([ours[-1]]), 1)
    exact = solve_ivp(
        rates_of(LUGRE, 1.0, lambda t, x, v: k * (speed * t - x)),
        (0.0, 6.0),
        np.zeros(3),
        method="LSODA",
        rtol=1e-8,
        atol=1e-11,
        t_eval=h * np.arange(6000),
    )
    theirs = k * (speed * exact.t - exact.y[0])
    gap = abs(max(ours) - float(theirs.max()))
    figure("greatest force of stick-slip, against LSODA [N]", gap, "<= 0.002")
    assert gap <= 0.002
    assert min(ours[4000:]) == pytest.approx(float(theirs[4000:].min()), abs=0.1)
    assert max(ours) - min(ours[4000:]) > 0.5  # it does stick and slip


def test_bristles_are_those_of_mujoco_s_dcmotor(figure: Any) -> None:
    """A swing of 0.5 s beside a passive ``dcmotor`` with ``lugre`` at 10 us: within 5e-4 of the way that it makes."""
    text = """<mujoco><option timestep="1e-5" gravity="0 0 0" integrator="Euler"/><worldbody><body>
    <inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><joint name="a" type="slide" axis="1 0 0"/></body></worldbody>
    <actuator><dcmotor joint="a" input="none" motorconst="0 0" resistance="1" damping="0.4"
    lugre="1e4 50 1 1.5 0.01"/></actuator></mujoco>"""
    m = mujoco.MjModel.from_xml_string(text)
    d = mujoco.MjData(m)
    plant = AnalyticPlant(slider(1.0), 0.001, friction=LUGRE)
    plant.reset(np.zeros(1), np.zeros(1))
    ours, theirs = [], []
    for k in range(500):
        force = 2.5 * np.sin(2.0 * np.pi * 2.0 * 0.001 * k)
        plant.step(np.array([force]), 1)
        d.qfrc_applied[:] = force
        mujoco.mj_step(m, d, 100)
        ours.append(plant.state()[0][0])
        theirs.append(d.qpos[0])
    gap = float(np.max(np.abs(np.array(ours) - theirs))) / float(np.ptp(theirs))
    figure("LuGre at 1 ms against MuJoCo's dcmotor at 10 us [share of the way]", gap, "<= 5e-4")
    assert gap <= 5e-4


def test_a_steeper_line_tends_to_mujoco_s_frictionloss(figure: Any) -> None:
    """A swing of 32 mm beside ``frictionloss`` at 10 us: each halving of `speed` halves the gap, down to 0.7 %."""
    text = """<mujoco><option timestep="1e-5" gravity="0 0 0" integrator="Euler"/><worldbody><body>
    <inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/><joint name="a" type="slide" axis="1 0 0" frictionloss="1"
    solreffriction="2e-5 1"/></body></worldbody></mujoco>"""
    m = mujoco.MjModel.from_xml_string(text)
    d, speeds = mujoco.MjData(m), (0.002, 0.001, 0.0005)
    ours = [AnalyticPlant(slider(1.0), 0.001, friction=Friction(coulomb=1.0, speed=speed)) for speed in speeds]
    for plant in ours:
        plant.reset(np.zeros(1), np.zeros(1))
    ways: list[list[float]] = []
    for k in range(500):
        force = 2.5 * np.sin(2.0 * np.pi * 2.0 * 0.001 * k)
        d.qfrc_applied[:] = force
        mujoco.mj_step(m, d, 100)
        for plant in ours:
            plant.step(np.array([force]), 1)
        ways.append([d.qpos[0], *(plant.state()[0][0] for plant in ours)])
    theirs, *each = np.array(ways).T
    gaps = [float(np.max(np.abs(way - theirs)) / np.ptp(theirs)) for way in each]
    figure("Coulomb friction of 0.0005 m/s against frictionloss [share of the way]", gaps[-1], "<= 0.007")
    assert gaps[-1] <= 0.007
    assert gaps[0] / gaps[1] == pytest.approx(2.0, abs=0.2)
    assert gaps[1] / gaps[2] == pytest.approx(2.0, abs=0.2)


def test_curves_only_take_energy() -> None:
    """Power of the friction is never negative, at 2000 velocities and torques of both signs."""
    rng = np.random.default_rng(0)
    v, torque = rng.normal(0.0, 0.3, (2000, 1)), rng.normal(0.0, 9.0, (2000, 1))
    friction = Friction(0.1, 2.0, breakaway=3.0, load=0.4)
    assert np.min(v * steady(friction.of_joints(1), v, torque)) >= 0.0


def test_bristles_too_stiff_for_the_time_step_are_refused() -> None:
    """1 kg on 4e6 N/m rings at 2000 rad/s, and a step of 1 ms follows 1000: the message says which step would."""
    friction = Friction(coulomb=1.0, bristle_stiffness=4e6)
    with pytest.raises(SteepError, match=r"ring at up to 2e\+03 rad/s, .* plant.timestep of 0.0005 s or less"):
        AnalyticPlant(slider(1.0), 0.001, friction=friction)
    AnalyticPlant(slider(1.0), 0.0005, friction=friction)


def test_what_a_refusal_proposes_is_accepted() -> None:
    """1 N m on 1e-4 kg m^2 at 1 ms: the time step, the speed and the bristles that the message names all do."""
    light = ArmFile(
        "light",
        '<mujoco><worldbody><body><inertial mass="1" pos="0 0 0" diaginertia="1e-4 1e-4 1e-4"/><joint name="a" '
        'axis="0 0 1"/></body></worldbody><actuator><motor joint="a" ctrlrange="-5 5"/></actuator></mujoco>',
    )
    with pytest.raises(SteepError) as refused:
        MujocoPlant(light, friction=Friction(coulomb=1.0))
    step, speed, stiffness = re.search(
        r"plant.timestep of (\S+) s or less, or .* `speed: (\S+)`, or .* `bristle_stiffness: (\S+)`", str(refused.value)
    ).groups()  # type: ignore[union-attr]
    MujocoPlant(light, float(step), friction=Friction(coulomb=1.0))
    MujocoPlant(light, friction=Friction(coulomb=1.0, speed=float(speed)))
    MujocoPlant(light, friction=Friction(coulomb=1.0, bristle_stiffness=float(stiffness)))
    assert (float(step), float(speed), float(stiffness)) == (2e-6, 5.0, 100.0)


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
@pytest.mark.parametrize("name", ["puma560", "puma560-sticking"])
def test_the_friction_of_the_puma_goes_with_1_ms(name: str, integrator: str) -> None:
    """It is accepted on the PUMA, and refused on another arm with both counts of joints."""
    MujocoPlant("puma560", 0.001, integrator, friction=FRICTIONS[name])
    with pytest.raises(FrictionError, match=r"viscous has shape \(6,\), wanted one number or 2"):
        MujocoPlant("two-link", 0.001, integrator, friction=FRICTIONS[name])


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        (Friction(coulomb=2.0, breakaway=1.0), "breakaway of joint 1 is 1, wanted at least its coulomb, 2"),
        (Friction(load=0.1, bristle_stiffness=10.0), "coulomb of joint 1 is 0, wanted more than 0 where bristles bear"),
        (
            Friction(1.0, bristle_stiffness=(0.0,) * 5 + (1.0,)),
            "bristle_stiffness is .*, wanted more than 0 everywhere, or 0",
        ),
    ],
)
def test_friction_that_contradicts_itself_is_refused(friction: Friction, message: str) -> None:
    """A ValueError that names the joint or the numbers."""
    with pytest.raises(ValueError, match=message):
        friction.of_joints(6)


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_all_of_it_is_alike_on_both_paths_and_engines(engine: str, integrator: str) -> None:
    """0 differing bytes between the paths and on a replica after another run; the engines 1e-9 rad apart."""
    plant = plants(ALL, integrator=integrator)[engine]
    first = rubbing(plant, 2)
    for path in ("native", "python"):
        for p in (plant, plant.replica()):
            assert differing_bytes(first, rubbing(p, 2, path)) == 0
    other = plants(ALL, integrator=integrator)["mujoco" if engine == "analytic" else "analytic"]
    assert np.max(np.abs(rubbing(other, 2).q - first.q)) <= 1e-9


def test_motors_on_bristles_are_alike_on_both_paths_and_engines() -> None:
    """Joints that give, their motors on bristles: 0 differing bytes between the paths, the engines 1e-9 rad apart."""
    given: dict[str, Any] = {"friction": ALL, "transmission": SOFT}
    runs = []
    for plant in (MujocoPlant("puma560", **given), AnalyticPlant(Puma560(), **given)):
        runs.append(rubbing(plant, 2))
        assert differing_bytes(runs[-1], rubbing(plant, 2, "python")) == 0
    assert np.max(np.abs(runs[0].q - runs[1].q)) <= 1e-9
    free = rubbing(AnalyticPlant(Puma560(), transmission=SOFT), 2)
    assert np.max(np.abs(free.q - runs[1].q)) > 1e-3


def test_bristles_add_to_the_stiffness_that_a_motor_rings_at() -> None:
    """A motor of 0.07 kg m^2 on a spring of 1e4 and bristles of 7e4 N m/rad rings at 1069 rad/s, too fast for 1 ms.

    On the spring alone, or the bristles alone, it rings at about its root of their stiffness over B, or the link's.
    """
    spring = Transmission(1e4, inertia=0.07)
    with pytest.raises(SpringError, match=r"joint 1 rings at 170 Hz"):
        AnalyticPlant(pendulum(), friction=Friction(coulomb=1.0, bristle_stiffness=7e4), transmission=spring)
    AnalyticPlant(pendulum(), friction=Friction(coulomb=1.0, bristle_stiffness=3e4), transmission=spring)


def test_bent_bristles_are_steepest_where_they_are_bent_back() -> None:
    """By hand: bent to the break-away torque while g is Coulomb's, dz/dt = v + |v| 3/2, of which 4 N m s/rad resist."""
    friction = Friction(viscous=1.0, coulomb=2.0, breakaway=3.0, bristle_stiffness=1e3, bristle_damping=4.0)
    assert friction.of_joints(1).steep == pytest.approx([1.0 + 4.0 * (1.0 + 3.0 / 2.0)], rel=1e-15)


def test_the_line_of_straight_friction_reaches_all_that_the_curve_does() -> None:
    """Its slope is viscous + (break-away + the larger share of the torque limit) / speed, without a share no limit."""
    friction = Friction(1.0, 2.0, 0.01, breakaway=3.0, load=0.1, load_backdriving=0.2)
    assert friction.of_joints(1, 30.0).steep == pytest.approx([1.0 + (3.0 + 0.2 * 30.0) / 0.01], rel=1e-15)
    assert Friction(1.0, 2.0, 0.01).of_joints(1, np.inf).steep == pytest.approx([201.0], rel=1e-15)
