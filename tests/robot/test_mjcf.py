"""Any serial arm of hinges and slides becomes an analytic model; anything else is refused by name."""

import numpy as np
import pytest

from torquebench import load_model
from torquebench.comparison import compare_terms, random_states
from torquebench.errors import ModelError
from torquebench.robot.library import MAX_BYTES
from torquebench.robot.mjcf import compile_arm
from torquebench.sim.plants.mujoco import MujocoModel, MujocoPlant

MOTORS = (
    '<actuator><motor joint="a" ctrllimited="true" ctrlrange="-5 5" gear="2"/>'
    '<motor joint="b" ctrllimited="true" ctrlrange="-3 3"/></actuator>'
)
ODD_ARM = f"""
<mujoco>
  <compiler angle="radian"/>
  <option gravity="1 -2 -9"><flag contact="disable"/></option>
  <worldbody>
    <body pos="0.1 0.2 0.3" euler="0.3 -0.2 0.5">
      <inertial mass="2" pos="0.1 0.05 -0.02" fullinertia="0.03 0.04 0.05 0.002 -0.003 0.001"/>
      <joint name="a" type="hinge" axis="1 2 -1" pos="0.02 -0.03 0.04" armature="0.02"/>
      <joint name="b" type="slide" axis="0 1 1" pos="0.01 0 0"/>
      <body pos="0.2 0 0.1" euler="0.1 0.7 0">
        <inertial mass="0.5" pos="0 0 0.1" diaginertia="0.01 0.01 0.002"/>
        <body pos="0 0.1 0.2" euler="0 0 1">
          <inertial mass="1.5" pos="0.05 0 0.1" fullinertia="0.02 0.02 0.01 0.001 0 0"/>
          <joint name="c" type="hinge" axis="0 0 1" pos="0 0.02 0" actuatorfrcrange="-7 7" actuatorfrclimited="true"/>
          <body name="hand" pos="0 0 0.3"><inertial mass="0.2" pos="0 0 0" diaginertia="0.001 0.001 0.001"/>
            <site name="tool" pos="0 0.1 0" euler="0.4 0 0"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  {MOTORS}
</mujoco>"""


def write(tmp_path, text):
    """The text as a file."""
    path = tmp_path / "arm.xml"
    path.write_text(text)
    return path


def test_an_arm_with_everything_that_is_allowed(tmp_path):
    """Skew axes, off-centre anchors, two joints on a body, a slide, welded bodies, tilted gravity: all terms agree."""
    path = write(tmp_path, ODD_ARM)
    arm = load_model(path)
    assert arm.n == 3
    rows = compare_terms(MujocoModel(path), arm, random_states(3, 200, seed=1), 1e-12)
    assert all(row.agrees for row in rows), [(row.term, row.relative) for row in rows]


def test_torque_limits_come_from_gear_and_ranges(tmp_path):
    """Motor range times gear, or the joint's own force range; the plant and the analytic model read the same."""
    path = write(tmp_path, ODD_ARM)
    assert np.array_equal(load_model(path).flat.tau_max, [10.0, 3.0, 7.0])
    assert np.array_equal(MujocoPlant(path).tau_max, [10.0, 3.0, 7.0])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('armature="0.02"', 'armature="0.02" damping="0 1"', "joint damping that grows with speed .'a'."),
        ('armature="0.02"', 'armature="0.02" stiffness="1"', "joint stiffness .'a'.: leave it out, or"),
        ('name="hand"', 'name="hand" gravcomp="1"', "gravity compensation"),
        ('type="slide" axis="0 1 1" pos="0.01 0 0"', 'type="ball"', "joints other than hinges and slides"),
        ('<option gravity="1 -2 -9">', '<option gravity="1 -2 -9" density="1000">', "a fluid"),
        (
            '<site name="tool"',
            '<body><joint name="d" type="hinge"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body>'
            '<body><joint name="e" type="hinge"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body>'
            '<site name="tool"',
            "branches",
        ),
        ('ctrlrange="-3 3"', 'ctrlrange="-3 4"', "not symmetric"),
        (' actuatorfrcrange="-7 7" actuatorfrclimited="true"', "", "no torque limit for c"),
    ],
)
def test_what_the_analytic_side_lacks_is_refused_by_name(tmp_path, old, new, message):
    """Each feature without an analytic counterpart is named in the error."""
    text = ODD_ARM.replace(old, new)
    if "ball" in new:
        text = text.replace(MOTORS, "")
    assert text != ODD_ARM
    with pytest.raises(ModelError, match=message):
        load_model(write(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody/></mujoco>", "no joint at all"),
        ("<mujoco><include file='/etc/passwd'/></mujoco>", '<include file="/etc/passwd"> is refused'),
        ("<mujoco><extension><plugin plugin='x'/></extension></mujoco>", "<plugin> is refused: it runs code"),
        ("<mujoco><size memory='900G'/></mujoco>", "<size> is refused: it asks for memory"),
        ("<mujoco><asset><texture builtin='flat' width='90000' height='9'/></asset></mujoco>", "at most 4096 is read"),
        ("<mujoco><custom><numeric name='x' size='99999999'/></custom></mujoco>", "at most 65536 is read"),
        ("<mujoco>" + "<body>" * 300 + "</body>" * 300 + "</mujoco>", "nested more than 200 deep"),
        ("<svg/>", "<svg> is no arm"),
        ("<!DOCTYPE x [<!ENTITY a 'b'>]><mujoco/>", "entities are refused"),
        ("not xml", "not a readable MJCF"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "does not compile"),
        (ODD_ARM.replace('mass="2"', 'mass="-2"'), "mass=.-2.> is negative"),
        (ODD_ARM.replace("<option ", '<option timestep="-1" '), "timestep is -1"),
        (ODD_ARM.replace("<option ", '<option timestep="nan" '), "timestep=.nan.> is negative or not finite"),
        (ODD_ARM.replace("0.03 0.04 0.05", "0.03 0.04 0.5"), "does not compile"),
    ],
)
def test_malformed_or_reaching_out_is_refused(tmp_path, text, message):
    """A model must be readable, stand alone and compile."""
    with pytest.raises(ModelError, match=message):
        load_model(write(tmp_path, text))


def test_too_large_a_file_is_refused_unread(tmp_path):
    """The size is checked before the file is parsed."""
    with pytest.raises(ModelError, match="larger than"):
        compile_arm(write(tmp_path, "<mujoco>" + " " * MAX_BYTES + "</mujoco>"))


@pytest.mark.parametrize("name", ["../../etc/passwd", "puma560/../puma560", "/etc", "", "puma56O"])
def test_names_outside_the_models_folder_are_refused(name):
    """A model's name is a plain name; paths are not names, and a misspelt one gets the nearest."""
    with pytest.raises(ModelError, match="puma560"):
        load_model(name)


@pytest.mark.parametrize("timestep", [0.0, -0.001, float("nan"), float("inf")])
def test_plants_refuse_a_bad_timestep(timestep):
    """MuJoCo's compiler accepts 0, -1 and NaN; the plant does not."""
    with pytest.raises(ValueError, match="finite positive"):
        MujocoPlant("puma560", timestep)
