"""Any serial arm of hinges and slides becomes an analytic model; anything else is refused by name."""

import mujoco
import numpy as np
import pytest

from torquebench import load_model
from torquebench.comparison import compare_terms, random_states
from torquebench.errors import ModelError
from torquebench.robot.library import MAX_BYTES, ArmFile
from torquebench.robot.mjcf import compile_arm, features, read_arm
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
def test_what_the_analytic_side_lacks_is_refused_by_name(old, new, message):
    """Each feature without an analytic counterpart is named in the error."""
    text = ODD_ARM.replace(old, new)
    if "ball" in new:
        text = text.replace(MOTORS, "")
    assert text != ODD_ARM
    with pytest.raises(ModelError, match=message):
        load_model(ArmFile("arm", text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody/></mujoco>", "no joint at all"),
        ("<mujoco><include file='/etc/passwd'/></mujoco>", '<include file="/etc/passwd"> is refused'),
        ("<mujoco><extension><plugin plugin='x'/></extension></mujoco>", "<plugin> is refused: it runs code"),
        ("<mujoco><size memory='900G'/></mujoco>", "more memory than any arm needs"),
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
def test_malformed_or_reaching_out_is_refused(text, message):
    """A model must be readable, stand alone and compile."""
    with pytest.raises(ModelError, match=message):
        load_model(ArmFile("arm", text))


UNSOUND = {
    "mass": (("mass='1'", "mass='1e308'"), "not finite"),
    "bound": (("<mujoco>", "<mujoco><compiler boundmass='1e308'/>"), "mass matrix at zero"),
    "no mass": (("<mujoco>", "<mujoco><compiler settotalmass='1e-300'/>"), "rad/s"),
    "gravity": (("<mujoco>", "<mujoco><option gravity='0 0 1e308'/>"), "gravity.s torque"),
    "limit": (("'-10 10'", "'-1e308 1e308'"), "torque limit is 1e.308"),
    "one axis": (("axis='1 0 0'", "axis='0 1 0'"), "is singular"),
    "heights": (
        ("<asset/>", "<asset><hfield name='h' nrow='50000' ncol='50000' size='1 1 1 1'/></asset>"),
        "at most 2048",
    ),
    "classes": (
        ("<asset/>", "<default>" + "<default class='c'/>" * 1500 + "</default>"),
        "at most 1000 default classes",
    ),
}
SOUND = (
    "<mujoco><asset/><worldbody><body><joint name='a' axis='0 1 0' actuatorfrcrange='-10 10'/>"
    "<joint name='b' axis='1 0 0' actuatorfrcrange='-10 10'/>"
    "<geom size='.1' pos='.2 .1 0' mass='1' contype='0' conaffinity='0'/></body></worldbody></mujoco>"
)


@pytest.mark.parametrize("name", UNSOUND)
def test_what_no_simulation_can_use_is_refused_by_both_sides(name):
    """Finite numbers may make an arm that is none: no finite or definite mass matrix, or no end of memory and time."""
    (old, new), message = UNSOUND[name]
    compile_arm(ArmFile("sound", SOUND))
    arm = ArmFile("unsound", SOUND.replace(old, new))
    assert arm.text != SOUND
    for read in (load_model, lambda arm: MujocoPlant(arm, timestep=0.001)):
        with pytest.raises(ModelError, match=message):
            read(arm)


LINK = '<body><inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.03 0.03"/>{}</body>'
PUBLISHED = f"""<mujoco><compiler angle="radian" meshdir="assets"/>
<asset><mesh name="shell" file="shell.stl"/><texture name="t" file="t.png" type="2d"/>
<material name="m" texture="t"/></asset>
<worldbody>{LINK}</worldbody><actuator>{{}}</actuator></mujoco>"""
JOINT = '<joint name="a" axis="0 1 0" damping="1.5" frictionloss="0.4" range="-2 2"/>'
LOOK = '<geom name="look" type="mesh" mesh="shell" material="m" contype="0" conaffinity="0"/>'
MOTOR = '<motor name="m" joint="a" ctrlrange="-60 60"/>'


def published(look=LOOK, motor=MOTOR, joint=JOINT):
    """An arm as they are published, whose mesh and texture are not there."""
    return PUBLISHED.format(joint + look, motor)


def test_looks_in_files_are_left_out_and_told():
    """What neither touches nor weighs is left out; friction and limits are the plant's, and no part of the belief."""
    arm = read_arm(ArmFile("arm", published()))
    assert arm.remarks == ("left out, as they only look: mesh shell, texture t",)
    assert read_arm(ArmFile("arm", arm.text)).text == arm.text  # kept beside results it is read as it is
    model = load_model(arm)
    assert model.passive == ((1.5,), (0.4,), (-2.0,), (2.0,), (np.inf,))
    bare = load_model(ArmFile("arm", published("", joint='<joint name="a" axis="0 1 0"/>')))
    assert model.inverse_dynamics([0.3], [1.0], [2.0]) == bare.inverse_dynamics([0.3], [1.0], [2.0])


def test_all_reasons_come_at_once():
    """A geom that touches, one that weighs, a spring and a servo: four reasons, each with its element and a way out."""
    text = published(
        '<geom name="hard" type="mesh" mesh="shell"/>',
        '<position name="servo" joint="a" kp="9" ctrlrange="-1 1"/>',
        JOINT.replace("damping", 'stiffness="3" damping'),
    )
    text = text.replace("</worldbody>", LINK.format(JOINT.replace('"a"', '"b"') + LOOK) + "</worldbody>")
    text = text.replace(
        '<inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.03 0.03"/><joint name="b"', '<joint name="b"'
    )
    with pytest.raises(ModelError) as refused:
        load_model(ArmFile("arm", text))
    for told in ("mesh file (hard), as they collide", "mesh file (look), as the mass of their bodies comes from them"):
        assert told in str(refused.value)
    text = published("", '<position name="servo" joint="a" kp="9"/>', JOINT.replace("damping", 'stiffness="3" damping'))
    with pytest.raises(ModelError) as refused:
        load_model(ArmFile("arm", text))
    assert len(refused.value.problems) == 2


@pytest.mark.parametrize("flag", ["damper", "spring", "limit", "frictionloss", "constraint", "contact"])
def test_what_a_flag_switches_off_is_not_there(flag):
    """Each flag takes away just what MuJoCo takes away: its passive forces and constraints at a random state."""
    geoms = '<geom size="0.1"/><body pos="0 0 0.05"><joint name="b"/><geom size="0.1"/></body>'
    joint = JOINT.replace("damping", 'stiffness="3" damping')
    text = f"""<mujoco><option><flag {flag}="disable"/></option><worldbody>{LINK.format(joint)}{LINK.format(geoms)}
    </worldbody><actuator>{MOTOR}{MOTOR.replace('"m"', '"n"').replace('"a"', '"b"')}</actuator></mujoco>"""
    m = mujoco.MjModel.from_xml_string(text)
    d = mujoco.MjData(m)
    d.qpos[0], d.qvel[0] = 2.5, 1.0
    mujoco.mj_forward(m, d)
    compiled, passive = compile_arm(ArmFile("arm", text))
    assert (passive.viscous[0] > 0) == (d.qfrc_damper[0] != 0)
    assert (features(compiled)["joint stiffness"] != []) == (d.qfrc_spring[0] != 0)
    assert (passive.coulomb[0] > 0) == (mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF in d.efc_type.tolist())
    assert (passive.high[0] < np.inf) == (mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT in d.efc_type.tolist())
    assert (features(compiled)["colliding geoms"] != []) == (d.ncon > 0)


def test_a_urdf_with_words_for_other_programs(tmp_path):
    """Plug-ins that Gazebo would run are nothing to MuJoCo; those that the file gives to MuJoCo itself are refused."""
    text = """<robot name="r"><gazebo><plugin name="g" filename="g.so"/></gazebo>{}<link name="base"/><link name="rod">
    <visual><geometry><mesh filename="package://r/rod.dae"/></geometry></visual><inertial><mass value="1.5"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="swing" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    <dynamics damping="0.7" friction="0.2"/><limit effort="40" velocity="5" lower="-3" upper="3"/></joint></robot>"""
    model = load_model(write(tmp_path, text.format("")))
    assert model.passive == ((0.7,), (0.2,), (-3.0,), (3.0,), (5.0,))
    assert model.flat.tau_max == [40.0]
    with pytest.raises(ModelError, match="<plugin> is refused: it runs code"):
        load_model(write(tmp_path, text.format("<mujoco><extension><plugin plugin='x'/></extension></mujoco>")))


def test_an_import_does_not_mend_what_is_wrong(tmp_path):
    """A servo alone is imported; beside a negative mass, code or a wish for memory the file is refused.

    A file elsewhere is refused unread: nothing is told of what it includes in turn.
    """
    servo = '<position name="servo" joint="a" kp="9" forcerange="-60 60"/>'
    arm = read_arm(write(tmp_path, published(motor=servo)))
    assert load_model(arm).flat.tau_max == [60.0]
    assert any("servo" in remark or "plain chain" in remark for remark in arm.remarks)
    for old, new in (
        ('mass="2"', 'mass="-2"'),
        ("<asset>", '<size memory="90G"/><asset>'),
        ("<asset>", "<extension/><asset>"),
    ):
        with pytest.raises(ModelError, match=r"negative|memory|code"):
            load_model(write(tmp_path, published(motor=servo).replace(old, new)))
    (tmp_path / "arms").mkdir()
    (tmp_path / "far.xml").write_text('<mujoco><include file="farther.xml"/></mujoco>')
    with pytest.raises(ModelError, match="at or below") as caught:
        load_model(write(tmp_path / "arms", '<mujoco><include file="../far.xml"/></mujoco>'))
    assert "farther" not in str(caught.value)


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
