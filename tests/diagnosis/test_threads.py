"""Complaints that people have had of real arms, rebuilt small in configs/shaking: what each ended on is named."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.diagnosis.test_causes import BIAS, experiment, pd
from torquebench.diagnosis import diagnose
from torquebench.experiment import load_experiment

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
FOLDER = Path("configs/shaking")
ENDED_ON = {
    "camera-on-hand": ("payload", "setLoad of a Franka"),
    "delayed-motor": ("command_delay", "gains.kv <="),
    "effort-at-100-hz": ("control_period", "gains.kv <="),
    "elastic-joints": ("transmission", "gains.kv <="),
    "gains-at-50-hz": ("control_period", "gains.kv <="),
    "noisy-velocity": ("noise", "chain.velocity_filter <="),
    "sagging-servo": ("gravity", "law pd-gravity"),
    "stair-steps": ("friction", "law gravity-friction"),
    "torque-discontinuity": ("torque_rate", "gains.kv <="),
}
"""Config -> the cause on which its thread ended, and what the cure is about."""


MANY_LOOPS = {"camera-on-hand", "delayed-motor", "noisy-velocity", "torque-discontinuity"}
"""Take seconds each, for causes that `test_causes` seeds on shorter runs."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in MANY_LOOPS)) for name in sorted(ENDED_ON)]
)
def test_the_cause_that_a_complaint_ended_on(name: str) -> None:
    """It is the only cause, the sentence names it, and a cure is offered, which was tried where it is a number."""
    key, cure = ENDED_ON[name]
    found = diagnose(load_experiment(FOLDER / f"{name}.yaml"))
    assert [cause.key for cause in found.causes] == [key], found.sentence
    assert found.causes[0].title.rstrip(",") in found.sentence
    assert cure in " ".join(one.text for one in (*found.cures, found.causes[0].remedy))
    assert key == "payload" or found.remedy.settings, "but for what the robot is told, it was tried"
    assert found.remedy.cures


def test_stick_slip_is_called_so() -> None:
    """Its frequency is that at which the error swings, to a third; without break-away there is none."""
    given = load_experiment(FOLDER / "stair-steps.yaml")
    found = diagnose(given)
    often = re.search(r"stick-slip of joint ([\w-]+) at ([\d.]+) Hz, by friction", found.sentence)
    assert often is not None, found.sentence
    assert float(often[2]) == pytest.approx(found.seen.swings[found.joints.index(f"joint {often[1]}")], rel=0.34)
    friction = given.plant.friction
    assert friction is not None
    smooth = replace(given, plant=replace(given.plant, friction=replace(friction, breakaway=0.0)))
    assert all("stick-slip" not in cause.title for cause in diagnose(smooth).causes)


def test_hunting_takes_an_integral() -> None:
    """A joint that is to stand hunts by break-away and integral together: both are named, and no others."""
    step = "reference={kind: step, target: [0.5, -0.5], at: 0.2}"
    changes = [step, "run.duration=12", "run.metrics_from=2", "controllers.teleop.gains.ki=800"]
    causes = {
        cause.key: cause.title for cause in diagnose(load_experiment(FOLDER / "stair-steps.yaml", changes)).causes
    }
    assert set(causes) == {"integral", "friction"}
    assert "stick-slip" in causes["friction"]
    assert "and the law's integral" in causes["friction"]


def test_every_complaint_has_its_thread_and_a_row() -> None:
    """Each config says its complaint and the thread's address in its first line, and docs/why.md has a row for each."""
    files = {path.stem: path.read_text() for path in FOLDER.glob("*.yaml")}
    assert set(files) == set(ENDED_ON)
    for text in files.values():
        assert re.match(r"# .+[.?!] https://github\.com/[\w.-]+/[\w.-]+/(issues|pull)/\d+\n", text)
    rows = re.findall(r"^\| `([\w-]+)` \|", Path("docs/why.md").read_text(), re.MULTILINE)
    assert sorted(rows) == sorted(ENDED_ON)


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
