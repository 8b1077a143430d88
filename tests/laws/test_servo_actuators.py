"""The position servo beside MuJoCo's own servo actuators."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.arms import pack
from torquebench.kernel import Array
from torquebench.references import Reference
from torquebench.robot import load_model
from torquebench.robot.flat_model import own_copy
from torquebench.robot.library import ArmFile
from torquebench.sim.interpreted import Call

KP, KD, KI, H, N = 60.0, 6.0, 90.0, 1e-3, 1500
ARM = """<mujoco><option timestep="0.001" integrator="Euler"/><worldbody><body><inertial mass="2" pos="0.3 0 0"
diaginertia="0.002 0.05 0.05"/><joint name="a" axis="0 1 0" armature="0.1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""
MOTOR = ARM.format('<motor joint="a" ctrlrange="-40 40"/>')


def followed(actuator: str, command: Array) -> Array:
    """Return position of MuJoCo's arm under an actuator that is told positions, (N,) [rad]."""
    m = mujoco.MjModel.from_xml_string(ARM.format(actuator))
    d, q = mujoco.MjData(m), np.zeros(len(command))
    for k, target in enumerate(command):
        q[k], d.ctrl[0] = d.qpos[0], target
        mujoco.mj_step(m, d)
    return q


@pytest.mark.parametrize(
    ("actuator", "ki"),
    [
        (f'<pid joint="a" kp="{KP}" kv="{KD}" ki="{KI}"/>', KI),
        (f'<position joint="a" kp="{KP}" kv="{KD}"/>', 0.0),
    ],
    ids=["pid", "position"],
)
def test_the_servo_is_mujocos(actuator: str, ki: float) -> None:
    """The law on a motor, called at each step, moves the arm as MuJoCo's actuator does, to rounding of 1500 steps."""
    command = 0.4 * np.sin(2.0 * np.pi * 0.7 * H * np.arange(N))
    theirs = followed(actuator, command)
    model = load_model(ArmFile("servo", MOTOR))
    controller = pack("position-servo", 1, kp=KP, kd=KD, ki=ki)
    belief = own_copy(model.flat, control_period=H)
    call = Call(controller.law, controller.gains, belief, controller.law.new_memory(1))
    m = mujoco.MjModel.from_xml_string(MOTOR)
    d, zero = mujoco.MjData(m), np.zeros(1)
    for k in range(N):
        assert d.qpos[0] == pytest.approx(theirs[k], abs=1e-12)
        tau, _, _ = call(k * H, d.qpos.copy(), d.qvel.copy(), Reference(command[k : k + 1], zero, zero))
        d.ctrl[0] = tau[0]
        mujoco.mj_step(m, d)
    assert np.max(np.abs(theirs - command)) > 0.02
