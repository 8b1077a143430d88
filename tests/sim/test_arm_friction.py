"""Friction that an arm's file gives its joints: both engines, MuJoCo's own damping, and an independent integration."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from torquebench import AnalyticPlant, MujocoPlant, load_model
from torquebench.kernel import Array
from torquebench.robot.library import ArmFile
from torquebench.sim.friction import Friction

LINK = """<body pos="0 0 0.3"><inertial mass="2" pos="0.1 0 0.2" diaginertia="0.03 0.04 0.02"/>
<joint name="{0}" axis="{1}" armature="0.1" {2}/>{3}</body>"""
ARM = """<mujoco><compiler angle="radian"/><option integrator="RK4" timestep="0.001"/><worldbody>{}</worldbody>
<actuator><motor joint="a" ctrlrange="-50 50"/><motor joint="b" ctrlrange="-50 50"/></actuator></mujoco>"""
DAMPED = 'damping="{}"'
START, SPEEDS = np.array([0.4, -0.7]), np.array([1.5, -2.0])


def arm(first: str, second: str) -> ArmFile:
    """Return an arm of two links whose joints have these attributes."""
    inner = LINK.format("b", "0 1 0", second, "")
    return ArmFile("arm", ARM.format(LINK.format("a", "1 0 0.3", first, inner)))


def moved(plant: Any, seconds: float = 1.0) -> Array:
    """Return where a plant ends without torque."""
    plant.reset(START, SPEEDS)
    plant.step(np.zeros(2), round(seconds / plant.timestep))
    return np.concatenate(plant.state())


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
def test_both_engines_have_the_friction_of_the_file(integrator: str, figure: Any) -> None:
    """1 s of free motion, damping and dry friction: 1e-12 rad apart, the round-off of 1000 steps; without it 0.1."""
    source = arm('damping="1.2" frictionloss="0.5"', 'damping="0.3"')
    ends = [
        moved(plant)
        for plant in (MujocoPlant(source, 0.001, integrator), AnalyticPlant(load_model(source), 0.001, integrator))
    ]
    gap = float(np.max(np.abs(ends[0] - ends[1])))
    figure(f"friction of an arm's file, MuJoCo against analytic, {integrator} [rad, rad/s]", gap, "<= 1e-12")
    assert gap <= 1e-12
    free = moved(MujocoPlant(source, 0.001, integrator, friction=Friction()))
    assert np.max(np.abs(free - ends[0])) > 0.1


def test_damping_is_mujoco_s(figure: Any) -> None:
    """The same file stepped by ``mj_step``, which damps itself: 1e-12 rad, as both take Runge-Kutta's stages."""
    source = arm('damping="1.2"', 'damping="0.3"')
    m = mujoco.MjModel.from_xml_string(source.text)
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:] = START, SPEEDS
    mujoco.mj_step(m, d, 1000)
    gap = float(np.max(np.abs(moved(MujocoPlant(source)) - np.concatenate([d.qpos, d.qvel]))))
    figure("damping of an arm's file against mj_step's own [rad, rad/s]", gap, "<= 1e-12")
    assert gap <= 1e-12


def test_damping_is_what_another_integrator_makes_of_it(figure: Any) -> None:
    """DOP853 at 1e-12 on MuJoCo's mass matrix and bias with -b qd: 1e-8, which Runge-Kutta's step of 1 ms leaves."""
    source = arm('damping="1.2"', 'damping="0.3"')
    m = mujoco.MjModel.from_xml_string(source.text.replace('damping="', 'user="'))
    d, b = mujoco.MjData(m), np.array([1.2, 0.3])

    def rates(_: float, state: Array) -> Array:
        d.qpos[:], d.qvel[:] = state[:2], state[2:]
        mujoco.mj_forward(m, d)
        mass = np.zeros((2, 2))
        mujoco.mj_fullM(m, d, mass)
        return np.concatenate([state[2:], np.linalg.solve(mass, -d.qfrc_bias - b * state[2:])])

    exact = solve_ivp(rates, (0.0, 1.0), np.concatenate([START, SPEEDS]), method="DOP853", rtol=1e-12, atol=1e-12)
    gap = float(np.max(np.abs(moved(AnalyticPlant(load_model(source))) - exact.y[:, -1])))
    figure("damping of an arm's file against DOP853 [rad, rad/s]", gap, "<= 1e-8")
    assert gap <= 1e-8


def test_a_light_joint_gets_a_speed_that_the_integrator_can_follow() -> None:
    """Dry friction of 1 N m on 1e-3 kg m^2 decays at 1e5 1/s above 0.01 rad/s; the least of 1, 2, 5 that does is taken.

    At 1 ms Runge-Kutta follows 2785 1/s: 1 / (s 1e-3) below that is s > 0.36 rad/s, hence 0.5, on both engines.
    """
    text = ARM.format(
        '<body><inertial mass="1" pos="0 0 0" diaginertia="0.001 0.001 0.001"/><joint name="a" axis="0 0 1" '
        'frictionloss="1"/></body>'
    ).replace('<motor joint="b" ctrlrange="-50 50"/>', "")
    source = ArmFile("arm", text)
    plants: tuple[Any, ...] = (MujocoPlant(source), AnalyticPlant(load_model(source)))
    assert [plant.friction.speed for plant in plants] == [0.5, 0.5]
    with pytest.raises(ValueError, match=r"of the arm's own: .* wanted a shorter time step, .* or `friction: none`"):
        MujocoPlant(ArmFile("arm", text.replace('frictionloss="1"', 'damping="9"')))


def test_the_belief_knows_nothing_of_it() -> None:
    """The inverse dynamics, which laws compute with, are those of the same arm without friction, to the last bit."""
    with_it, without = load_model(arm('damping="1.2" frictionloss="0.5"', "")), load_model(arm("", ""))
    state = (START, SPEEDS, np.array([3.0, -1.0]))
    assert with_it.inverse_dynamics(*state).tobytes() == without.inverse_dynamics(*state).tobytes()
    assert (with_it.passive.viscous, with_it.passive.coulomb) == ((1.2, 0.0), (0.5, 0.0))
    assert without.passive.high == (math.inf, math.inf)


def test_a_speed_alone_is_that_of_the_arm_s_own_friction() -> None:
    """Viscous and Coulomb friction stay the file's, on both engines; an arm that has neither refuses it."""
    source, given = arm('damping="1.2" frictionloss="0.5"', 'damping="0.3"'), Friction(speed=2.0)
    for plant in (MujocoPlant(source, friction=given), AnalyticPlant(load_model(source), friction=given)):
        assert plant.friction == Friction((1.2, 0.3), (0.5, 0.0), 2.0)
    with pytest.raises(ValueError, match="neither viscous nor coulomb is given, and the arm's file gives"):
        MujocoPlant(arm("", ""), friction=given)
