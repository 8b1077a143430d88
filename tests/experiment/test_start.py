"""A run starts at a keyframe of the arm's file, and its reference with it; what is stored is numbers."""

import numpy as np
import pytest

from torquebench.errors import ConfigError
from torquebench.experiment import dump_experiment, parse_experiment
from torquebench.experiment.build import build
from torquebench.references import Quintic, Ramp, Sine, Step
from torquebench.robot.loading import keyframes

ARM = """
<mujoco model="bent"><worldbody>
  <body><inertial mass="2" pos="0.3 0 0" diaginertia="0.01 0.1 0.1"/><joint name="a" axis="0 0 1"/>
    <body pos="0.6 0 0"><inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.05 0.05"/><site name="tool" pos="0.4 0 0"/>
      <joint name="b" axis="0 0 1"/></body>
  </body></worldbody>
  <actuator><motor joint="a" ctrlrange="-9 9"/><motor joint="b" ctrlrange="-5 5"/></actuator>
  <keyframe><key name="home" qpos="0.4 -1.2"/><key name="up" qpos="1.5 0"/><key qpos="1 1"/></keyframe></mujoco>"""

TEXT = """\
name: own
plant: {model: bent}
controllers: [{law: computed-torque, gains: {lam: 10, kv: 20, ki: 0}}]
reference: {kind: quintic, target: [1.0, -1.0], rise_time: 1.0}
run: {duration: 3, initial_q: "key:home"}
"""
MOTIONS = {
    "quintic": "{kind: quintic, target: [1.0, -1.0], rise_time: 1.0}",
    "ramp": "{kind: ramp, target: [1.0, -1.0], rise_time: 1.0}",
    "step": "{kind: step, target: [1.0, -1.0], at: 0.2}",
    "sine": "{kind: sine, amplitude: 0.5, frequency_hz: 0.5}",
}


@pytest.fixture(autouse=True)
def bent(tmp_path, monkeypatch):
    """An arm with two keyframes that have names."""
    (tmp_path / "models" / "bent").mkdir(parents=True)
    (tmp_path / "models" / "bent" / "bent.xml").write_text(ARM)
    (tmp_path / "models" / "other").mkdir()
    (tmp_path / "models" / "other" / "other.xml").write_text(ARM.split("<keyframe>")[0] + "</mujoco>")
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))


def test_keyframes_are_those_with_a_name():
    """Positions as the file has them; one without a name cannot be asked for."""
    assert {name: pose.tolist() for name, pose in keyframes("bent").items()} == {"home": [0.4, -1.2], "up": [1.5, 0.0]}


@pytest.mark.parametrize("kind", MOTIONS)
def test_plant_and_reference_start_at_the_keyframe(kind):
    """Arm and reference are at [0.4, -1.2] and at rest at t = 0; what is stored has the numbers and reads back equal.

    Targets stay where they are; a sine swings by its amplitude from there.
    """
    experiment = parse_experiment(TEXT.replace(MOTIONS["quintic"], MOTIONS[kind]))
    loop = build(experiment)
    assert loop.initial_q.tolist() == [0.4, -1.2]
    assert loop.reference.q[0].tolist() == [0.4, -1.2]
    end = [0.9, -0.7] if kind == "sine" else [1.0, -1.0]
    at = 1000 if kind == "sine" else -1
    assert loop.reference.q[at] == pytest.approx(end, abs=1e-12)
    assert experiment.run.initial_q == experiment.reference.origin == (0.4, -1.2)
    text = dump_experiment(experiment)
    assert "key:" not in text
    assert parse_experiment(text) == experiment


@pytest.mark.parametrize(
    "make",
    [
        lambda **origin: Sine((0.5, -0.3), (0.5, 0.7), **origin),
        lambda **origin: Quintic((1.0, -1.0), 1.0, **origin),
        lambda **origin: Ramp((1.0, -1.0), 1.0, **origin),
        lambda **origin: Step((1.0, -1.0), 0.2, **origin),
    ],
)
def test_an_origin_moves_positions_and_scales_rates_as_the_way_does(make):
    """From 0.4 to 1.0 is 0.6 of the way from 0 to 1: so are the rates of a motion to a target; not a sine's."""
    t = np.linspace(0.0, 1.5, 301)
    plain, moved = make().sample(t, 2), make(origin=(0.4, -0.4)).sample(t, 2)
    share = 1.0 if isinstance(make(), Sine) else 0.6
    for own, other in zip(plain[1:], moved[1:], strict=True):
        assert other == pytest.approx(share * own, abs=1e-12)
    assert moved.q == pytest.approx(np.array([0.4, -0.4]) + share * plain.q, abs=1e-12)
    assert make(origin=0.0).sample(t, 2).q == pytest.approx(plain.q, abs=1e-15)


def test_a_reference_with_an_origin_of_its_own_keeps_it():
    """The arm starts at the keyframe, the reference where it says; numbers for initial_q move no reference."""
    own = parse_experiment(TEXT.replace("kind: quintic", "kind: quintic, origin: 0"))
    assert build(own).reference.q[0].tolist() == [0.0, 0.0]
    assert build(own).initial_q.tolist() == [0.4, -1.2]
    numbers = parse_experiment(TEXT.replace('"key:home"', "[0.4, -1.2]"))
    assert build(numbers).reference.q[0].tolist() == [0.0, 0.0]
    assert "origin" not in dump_experiment(numbers)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("key:home", "key:hom"), "the arm's file has no keyframe 'hom' (did you mean 'key:home'?)"),
        (("key:home", "key:x"), "one of key:home, key:up"),
        (("model: bent", "model: other"), "numbers, or home: it has none at all"),
        (("model: bent", "model: nothing"), "unknown model 'nothing'"),
    ],
)
def test_a_keyframe_that_is_not_there_is_told(change, words):
    """Each once, with the nearest name, or those that there are; an arm that is not there is told as such alone."""
    with pytest.raises(ConfigError) as caught:
        parse_experiment(TEXT.replace(*change))
    assert len(caught.value.problems) == 1
    assert words in str(caught.value)
    if "model" not in words:
        assert "run.initial_q" in str(caught.value)


def test_a_path_of_the_tool_begins_at_a_keyframe():
    """``start: key:home`` is the numbers of the file, stored as such; a wrong name is told at its own key."""
    line = "{kind: tool-line, to: [0, 0.02, 0], period: 2, orientation: free, start: 'key:home'}"
    text = TEXT.replace(MOTIONS["quintic"], line).replace(', initial_q: "key:home"', "")
    with pytest.raises(
        ConfigError, match=r"reference.start: the arm's file has no keyframe 'hom' \(did you mean 'key:"
    ):
        parse_experiment(text.replace("key:home", "key:hom"))
    numbers = text.replace("'key:home'", "[0.4, -1.2]")
    found, wanted = parse_experiment(text), parse_experiment(numbers)
    assert found == wanted
    assert found.reference.start == (0.4, -1.2)
