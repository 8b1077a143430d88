"""Joints that give, against closed forms and integrations that share nothing with the plants' own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arms import INERTIA, LENGTH, MASS, chain, pack, pendulum
from tests.sampled import simulate_sampled
from tests.sim.arm_files import REFUSED, start_of
from tests.sim.protocol import differing_bytes
from tests.sim.test_native_refused import anything
from torquebench.chain import Chain
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.references import Sine
from torquebench.robot import RobotModel, load_model
from torquebench.sim.friction import Friction
from torquebench.sim.joints import SpringError, Transmission
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.trajectory import load_trajectory

J = INERTIA + MASS * LENGTH * LENGTH
"""Inertia of the pendulum's link alone, 0.53 kg m^2."""
LINK = np.array([2.788, 2.064, 0.3355, 0.00164, 0.000642, 4e-5])
"""Inertia of the PUMA's links at home without their motors [kg m^2]."""
SOFT = Transmission(tuple(LINK * (30.0 * math.pi) ** 2), tuple(0.06 * LINK * 30.0 * math.pi))
START = np.array([0.1, 0.5, -0.3, 0.2, 0.4, 0.1])
TORQUE = np.array([5.0, 40.0, 3.0, 0.1, 0.2, 0.1])


def floating(**keys: Any) -> RobotModel:
    """Return the pendulum's link without gravity, with a rotor of 0.07 kg m^2."""
    one = np.ones(1)
    rotor = np.array([0.07])
    return chain(0 * one, MASS * one, LENGTH * one, INERTIA * one, rotor, 1e3 * one, one, gravity=0.0, **keys)


def motion(plant: Any, tau: Array, steps: int, q: Array) -> Array:
    """Return q, qd, th, thd after each of so many steps from rest at `q`, (steps, 4 n)."""
    plant.native()  # compiled, as thousands of steps are asked for
    plant.reset(q, np.zeros(plant.n))
    out = []
    for _ in range(steps):
        plant.step(tau, 1)
        out.append(np.concatenate([*plant.state(), *plant.motors()]))
    return np.array(out)


def test_a_free_pair_rings_and_dies_away_as_the_formula_says() -> None:
    """X = th - q of motor and link under a torque from rest at balance: the step response of a damped oscillator.

    w^2 = k (1/J + 1/B), 2 zeta w = d (1/J + 1/B); RK4's error at w h = 0.04 is (w h)^4/120 a radian, 2e-8.
    """
    k, d, B, h = 400.0, 0.8, 0.07, 2e-4
    plant = AnalyticPlant(floating(), h, transmission=Transmission(k, d))
    seen = motion(plant, np.array([3.0]), 5000, np.zeros(1))
    t = h * np.arange(1, 5001)
    both = 1.0 / J + 1.0 / B
    w, half = math.sqrt(k * both), 0.5 * d * both
    wd = math.sqrt(w * w - half * half)
    final = 3.0 / B / (w * w)
    expected = final * (1.0 - np.exp(-half * t) * (np.cos(wd * t) + half / wd * np.sin(wd * t)))
    assert np.max(np.abs(seen[:, 2] - seen[:, 0] - expected)) < 2e-7 * final
    # what the spring does inside changes nothing of the sum of momenta
    np.testing.assert_allclose(J * seen[:, 1] + B * seen[:, 3], 3.0 * t, rtol=1e-12)


def test_without_damping_energy_is_kept_but_for_the_integrator() -> None:
    """Kinetic, potential and the spring's energy of a pendulum let go at .9 rad; RK4 loses (w h)^6/72 a step: 1e-8."""
    k, h = 200.0, 1e-4
    plant = AnalyticPlant(pendulum(), h, transmission=Transmission(k, inertia=0.07))
    q, qd, th, thd = motion(plant, np.zeros(1), 5000, np.array([0.9])).T
    g = np.array([pendulum().gravity([x])[0] for x in (0.0, math.pi / 2)])
    height = g[0] * np.sin(q) - g[1] * np.cos(q)  # gravity torque g0 cos q + g1 sin q
    energy = 0.5 * J * qd**2 + 0.5 * 0.07 * thd**2 + 0.5 * k * (th - q) ** 2 + height
    assert np.ptp(qd) > 1.0
    assert np.ptp(energy) < 1e-8 * np.ptp(0.5 * J * qd**2)


@pytest.mark.parametrize("friction", [None, Friction(viscous=(2.0, 2.0, 1.0, 0.1, 0.1, 0.1))])
def test_the_puma_moves_as_an_independent_integration_says(friction: Friction | None) -> None:
    """DOP853 of Spong's equations with M and bias of the model agrees, at a tolerance of 1e-12, over 0.1 s.

    RK4 at 0.1 ms differs by 1e-9 rad at most, and by a sixteenth of what it does at 0.2 ms, as its order says.
    """
    arm = load_model("puma560")
    B = arm.flat.armature
    k, d = np.array(SOFT.stiffness), np.array(SOFT.damping)
    drag = np.zeros(6) if friction is None else np.array(friction.viscous)

    def rates(t: float, x: Array) -> Array:
        q, qd, th, thd = x.reshape(4, 6)
        through = k * (th - q) + d * (thd - qd)
        qdd = np.linalg.solve(arm.mass_matrix(q) - np.diag(B), through - arm.bias_forces(q, qd))
        return np.concatenate([qd, qdd, thd, (TORQUE - drag * thd - through) / B])

    start = np.concatenate([START, np.zeros(6), START + arm.gravity(START) / k, np.zeros(6)])
    true = solve_ivp(rates, (0.0, 0.1), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1].reshape(4, 6)
    off = []
    for steps in (1000, 500):
        plant = AnalyticPlant(arm, 0.1 / steps, transmission=SOFT, friction=friction or Friction())
        seen = motion(plant, TORQUE, steps, START)[-1].reshape(4, 6)
        off.append(np.max(np.abs(seen - true)[[0, 2]]))
    assert off[0] < 1e-9
    assert 10.0 < off[1] / off[0] < 25.0


def test_backlash_is_crossed_as_an_integration_with_events_says() -> None:
    """A rotor swings between the flanks of a gap of 20 mrad; DOP853, begun anew at each crossing, agrees.

    The tolerance, 1e-6 rad, is the step's error at a corner of the spring (h^3 k w).
    """
    k, B, b, h = 900.0, 0.07, 0.02, 5e-5
    plant = AnalyticPlant(floating(), h, transmission=Transmission(k, backlash=b))
    plant.native()
    plant.reset(np.zeros(1), np.zeros(1))
    plant.motors()[1, 0] = 0.5
    seen, inside = [], 0
    for _ in range(8000):
        plant.step(np.zeros(1), 1)
        seen.append(np.concatenate([*plant.state(), *plant.motors()]))
        inside += abs(seen[-1][2] - seen[-1][0]) < b / 2
    assert 1000 < inside < 7000

    x, t, end = np.array([0.0, 0.0, 0.0, 0.5]), 0.0, 8000 * h
    upper: Any = lambda t, x: x[2] - x[0] - b / 2  # noqa: E731
    lower: Any = lambda t, x: x[2] - x[0] + b / 2  # noqa: E731
    upper.terminal = lower.terminal = True
    crossings = 0
    while t < end:
        wound, speed = x[2] - x[0], x[3] - x[1]
        at = b / 2 - 1e-12
        side = (1.0 if speed > 0 else 0.0) if wound >= at else (-1.0 if speed < 0 else 0.0) if wound <= -at else 0.0

        def rates(t: float, x: Array, side: float = side) -> Array:
            through = k * (x[2] - x[0] - side * b / 2) if side else 0.0
            return np.array([x[1], through / J, x[3], -through / B])

        upper.direction, lower.direction = (-1.0, 1.0) if side else (1.0, -1.0)
        piece = solve_ivp(rates, (t, end), x, "DOP853", rtol=1e-12, atol=1e-14, events=(upper, lower))
        t, x = piece.t[-1], piece.y[:, -1]
        crossings += piece.status == 1
    assert crossings >= 8
    assert np.max(np.abs(seen[-1] - x)[[0, 2]]) < 1e-6


def test_flanks_press_and_never_pull() -> None:
    """A rotor bounces between the flanks of a damped gap: the link is never drawn back to a flank that leaves it.

    With torque max(0, k w + d w') towards the flank, DOP853 in steps of 20 us agrees; RK4 meets its jumps, of up to d
    times the speed, somewhere within a step: its error is of first order, 2e-5 rad at 50 us.
    """
    k, d, B, b, h = 900.0, 3.0, 0.07, 0.02, 5e-5
    plant = AnalyticPlant(floating(), h, transmission=Transmission(k, d, backlash=b))
    plant.native()
    plant.reset(np.zeros(1), np.zeros(1))
    plant.motors()[1, 0] = 0.5
    seen = []
    for _ in range(4000):
        plant.step(np.zeros(1), 1)
        seen.append(np.concatenate([*plant.state(), *plant.motors()]))
    q, qd, th, _ = np.array(seen).T
    touching = np.abs(th - q) > b / 2
    pushed = np.diff(qd) * np.sign(th - q)[1:]
    assert 50 < np.count_nonzero(touching) < 3950
    assert np.min(pushed) >= 0.0

    def rates(t: float, x: Array) -> Array:
        w, dw = x[2] - x[0], x[3] - x[1]
        side = np.sign(w) * (abs(w) > b / 2)
        through = side * max(0.0, side * (k * (w - side * b / 2) + d * dw)) if side else 0.0
        return np.array([x[1], through / J, x[3], -through / B])

    true = solve_ivp(rates, (0.0, 4000 * h), [0.0, 0.0, 0.0, 0.5], "DOP853", rtol=1e-9, atol=1e-12, max_step=2e-5)
    assert np.max(np.abs(seen[-1] - true.y[:, -1])[[0, 2]]) < 2e-5


def test_a_stiffer_joint_comes_nearer_to_the_rigid_arm_as_one_over_k() -> None:
    """The deflection of a pendulum that is accelerated is tau_J/k: four times the stiffness, a quarter of the error."""
    rigid = AnalyticPlant(pendulum(), 1e-4)
    rigid.native()
    rigid.reset(np.zeros(1), np.zeros(1))
    off = []
    for _ in range(3000):
        rigid.step(np.array([12.0]), 1)
    for k in (2000.0, 8000.0, 32000.0):
        soft = AnalyticPlant(pendulum(), 1e-4, transmission=Transmission(k, 0.06 * math.sqrt(k * 0.06), inertia=0.07))
        off.append(abs(motion(soft, np.array([12.0]), 3000, np.zeros(1))[-1, 0] - rigid.state()[0][0]))
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.3)
    assert off[1] / off[2] == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize("backlash", [0.0, 2e-4])
def test_plants_and_paths_agree(backlash: float) -> None:
    """MuJoCo and the analytic plant differ by less than 1e-10 after 3 s; compiled and interpreted by no byte.

    The arm is pushed and swings freely, by radians; so rounding grows, to 1e-11. Held by a law it does not:
    see below.
    """
    given = Transmission(SOFT.stiffness, SOFT.damping, backlash=backlash)
    friction = Friction(5.0, 3.0, 0.05)
    plants = [
        AnalyticPlant(load_model("puma560"), transmission=given, friction=friction),
        MujocoPlant("puma560", transmission=given, friction=friction),
    ]
    ends = []
    for plant in plants:
        plant.reset(START, np.zeros(6))
        native: Any = plant.native()
        rows = np.tile(TORQUE, (3, 1))
        for steps in (300, 2700):
            native.step.call(native.structure.address, rows.ctypes.data, steps, 0)
            ends.append(np.concatenate([*plant.state(), *plant.motors()]))
    assert np.max(np.abs(ends[1] - ends[3])) < 1e-10
    assert np.max(np.abs(ends[1] - ends[0])[:6]) > 1.0
    interpreted = plants[1]
    last = motion(interpreted, TORQUE, 300, START)[-1]  # MuJoCo's plant steps in Python
    assert last.tobytes() == ends[2].tobytes()


@pytest.mark.parametrize("backlash", [0.0, 2e-4])
def test_under_a_law_plants_agree_for_as_long_as_it_runs(backlash: float, figure: Any) -> None:
    """5 s of a sine under PD with gravity: 1e-12 rad, as a law that pulls both to one motion lets no rounding grow."""
    given, arm = Transmission(SOFT.stiffness, SOFT.damping, backlash=backlash), load_model("puma560")
    law = pack("pd-gravity", 6, lam=8, kv=12)
    plants = (AnalyticPlant(arm, transmission=given), MujocoPlant("puma560", transmission=given))
    a, b = (simulate_sampled(plant, law, arm, Sine(0.4, 1.0), duration=5.0, path="native") for plant in plants)
    gap = float(np.max(np.abs(a.q - b.q)))
    figure(f"joints that give, backlash {backlash:g} rad, MuJoCo against analytic over 5 s [rad]", gap, "<= 1e-12")
    assert gap <= 1e-12
    assert np.all(np.ptp(a.q, axis=0) > 0.3)


@pytest.mark.parametrize("name", ["a fluid", "gravity compensation", "contacts", "a stiff tendon"])
def test_joints_that_give_on_arms_without_the_lean_step(name: str, tmp_path: Path) -> None:
    """Where MuJoCo's own forward dynamics is called at each stage, both paths leave the same bytes, too."""
    file = tmp_path / "arm.xml"
    file.write_text(REFUSED[name](), encoding="utf-8")
    plant = MujocoPlant(file, transmission=Transmission(400.0, 2.0, inertia=0.3, backlash=1e-3))
    native: Any = plant.native()
    assert not native.structure.lean
    law, start = pack("pd", 3, lam=8, kv=12), start_of(3)[0]
    runs = [
        simulate_sampled(
            plant,
            law,
            anything(3),
            Sine(0.8, 2.0),
            duration=0.2,
            initial_q=start,
            path=path,
            chain=Chain(actuator_lag=0.004),
        )
        for path in ("python", "native")
    ]
    assert [run.path for run in runs] == ["python", "native"]
    assert differing_bytes(*runs) == 0
    assert np.all(np.ptp(runs[0].q, axis=0) > 0.01)


def test_an_arm_at_rest_stays_where_its_motors_hold_it() -> None:
    """Under the torque of gravity nothing moves, with the gap taken up: no transient at the start of a run."""
    arm, given = load_model("puma560"), Transmission(SOFT.stiffness, SOFT.damping, backlash=1e-3)
    for plant in (AnalyticPlant(arm, transmission=given), MujocoPlant("puma560", transmission=given)):
        moved = motion(plant, arm.gravity(START), 200, START)
        assert np.max(np.abs(moved[:, 12:18] - moved[0, 12:18])) < 1e-9
        assert np.max(np.abs(moved[:, :6] - START)) < 1e-9


def test_what_the_integrator_cannot_follow_is_refused_with_the_step_that_does() -> None:
    """The message names the joint; the time step that it wants is accepted, and twice that is not."""
    arm = load_model("puma560")
    stiff = Transmission(1e5)
    with pytest.raises(SpringError, match=r"joint 6 rings at .* wanted a plant.timestep of at most") as caught:
        AnalyticPlant(arm, transmission=stiff)
    largest = float(str(caught.value).split("at most ")[1].split(" s")[0])
    AnalyticPlant(arm, largest, transmission=stiff)
    with pytest.raises(SpringError):
        MujocoPlant("puma560", 2.0 * largest, transmission=stiff)


def test_what_cannot_have_joints_that_give_is_refused() -> None:
    """Euler's method, closed forms, an arm without armature, and numbers for another count of joints."""
    with pytest.raises(ValueError, match="wanted 'rk4'"):
        AnalyticPlant(pendulum(), 1e-3, "euler", transmission=Transmission(100.0))
    with pytest.raises(ModelError, match="closed forms"):
        AnalyticPlant(load_model("puma560", "corrected"), transmission=SOFT)
    with pytest.raises(ValueError, match="stiffness has shape"):
        AnalyticPlant(pendulum(), transmission=Transmission((1.0, 2.0)))
    one = np.ones(1)
    bare = chain(0 * one, MASS * one, LENGTH * one, INERTIA * one, 0 * one, one, one)
    with pytest.raises(SpringError, match="joints 1 no armature"):
        AnalyticPlant(bare, transmission=Transmission(100.0))
    with pytest.raises(ValueError, match="transmission: stiffness is 0"):
        Transmission(0.0)


@pytest.mark.parametrize("sensor", ["motor", "link"])
def test_a_run_shows_the_law_the_side_of_its_sensors_and_keeps_both(sensor: Any, tmp_path: Path) -> None:
    """Both paths leave the same bytes; the law sees the motors' or the links' state; a file gives all back."""
    given = Transmission(300.0, 1.0, sensor=sensor)
    plant, law = MujocoPlant("two-link", transmission=given), pack("pd", 2, lam=8, kv=12)
    arm = load_model("two-link")
    runs = [
        simulate_sampled(plant, law, arm, Sine(0.4, 1.0), duration=0.1, path=path, throw=False)
        for path in ("python", "native")
    ]
    assert differing_bytes(*runs) == 0
    run = runs[1]
    assert run.motor_q is not None
    assert run.motor_qd is not None
    assert np.max(np.abs(run.motor_q - run.q)) > 1e-3
    seen = (run.motor_q, run.motor_qd) if sensor == "motor" else (run.q, run.qd)
    assert np.array_equal(run.q_meas, seen[0])
    assert np.array_equal(run.qd_meas, seen[1])
    path = tmp_path / "trajectory.npz"
    path.write_bytes(run.to_bytes())
    assert load_trajectory(path).digest() == run.digest()
