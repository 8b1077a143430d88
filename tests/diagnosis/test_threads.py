"""Eight complaints that people have had of real arms, rebuilt small: the cause that each ended on is named.

Sources: the issue threads whose repository and number stand beside each case; the words and numbers here are our own.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.diagnosis.test_causes import BIAS, FRICTION, NOISE, PLANT, SINE, experiment, pd
from torquebench.diagnosis import diagnose

WRONG_SIGN = '''
"""A PD law whose torque has the wrong sign."""
from typing import Annotated, NamedTuple
from torquebench import Array, Gain, Reference, controller

class Gains(NamedTuple):
    """Gains."""
    kp: Annotated[Array, Gain("position gain", "N m/rad")]
    kd: Annotated[Array, Gain("rate gain", "N m s/rad")]

@controller("turned-pd", gains=Gains)
def turned(gains, model, t, q, qd, ref, memory, tau):
    """Push the joint the wrong way."""
    for i in range(len(tau)):
        tau[i] = -gains.kp[i] * (ref.q[i] - q[i]) + gains.kd[i] * (ref.qd[i] - qd[i])
'''
STEP = {"kind": "step", "target": [0.6, -0.4], "at": 0.2}

THREADS: list[tuple[str, str, dict[str, Any], dict[str, Any]]] = [
    # fan-ziqi/robot_lab#51: trained on an ideal motor, shakes on one with delay
    ("command_delay", "command delay of 15 ms", pd(80), {"chain": {"command_delay": 0.015}}),
    # mujoco_ros2_control_examples#6, HOVER#38: gains that 1 kHz bears, at 50 Hz
    ("control_period", "control period of 20 ms", pd(80), {"run": {"control_period": 0.02}}),
    # unitree_rl_gym#89: velocity differenced from encoders, times the rate gain
    ("noise", "sensor noise", pd(30), {"chain": NOISE}),
    # IsaacLab#2139: the motion takes more than the motors give
    ("torque_limit", "torque limit", pd(20), {"reference": {**SINE, "amplitude": [1.5, -1.5], "frequency_hz": 1.5}}),
    # mujoco_menagerie#251: position servos sag
    ("gravity", "gravity", pd(10, "pd"), {"reference": STEP, "run": {"duration": 4.0}}),
    # Universal_Robots_Client_Library#352, franka_ros#249: friction that the law does not know
    ("friction", "friction", pd(10), {"plant": FRICTION}),
    # strands-labs/robots#168: one of 25 steps is run, so that a command is held 25 times too long
    ("control_period", "control period of 25 ms", pd(60), {"run": {"control_period": 0.025}}),
    # choreonoid#26, intrinsic-dev/aic#419: what hangs on the arm is not in the model
    ("payload", "payload of 5 kg", pd(10), {"plant": {**PLANT, "payload": {"mass": 5.0}}}),
]


@pytest.mark.parametrize(("key", "words", "controller", "sections"), THREADS)
def test_the_cause_that_a_complaint_ended_on(
    key: str, words: str, controller: dict[str, Any], sections: dict[str, Any]
) -> None:
    """The sentence names what the thread ended on, and it is the first cause."""
    found = diagnose(experiment(controller, **sections))
    assert found.causes[0].key == key
    assert words in found.sentence


def test_a_torque_of_the_wrong_sign(tmp_path: Any) -> None:
    """A law that pushes the wrong way is blamed itself, and in words."""
    from torquebench.laws.plugin import load_plugin

    (tmp_path / "turned.py").write_text(WRONG_SIGN)
    load_plugin(tmp_path / "turned.py")
    controller = {"name": "c", "law": "turned-pd", "gains": {"kp": 50.0, "kd": 5.0}}
    found = diagnose(experiment(controller))
    assert found.causes[0].key == "law"
    assert "wrong sign" in found.sentence


def test_every_number_is_json() -> None:
    """What ``--json`` prints holds plain values alone."""
    import json

    found = diagnose(experiment(pd(60), chain={"command_delay": 0.02}, disturbances=BIAS))
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["causes"][0]["key"] == "command_delay"
