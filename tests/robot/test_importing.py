"""Importing published arms: what each kind of feature becomes, held against the file in plain MuJoCo and by hand."""

from __future__ import annotations

import dataclasses
import math
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest

from torquebench import load_model
from torquebench.errors import ModelError
from torquebench.robot.importing import Options, RefusedArmError, import_arm, with_flags
from torquebench.robot.importing.folder import write_folder

LINK = '<inertial mass="{mass}" pos="0.2 0 0" diaginertia="0.01 0.02 0.02"/>'
MOTORS = '<actuator><motor joint="a" ctrlrange="-50 50"/><motor joint="b" ctrlrange="-20 20"/></actuator>'
TWO = """<mujoco>{settings}<worldbody>
  <body name="one" pos="0 0 0.3" {turn}>{link}<joint name="a" axis="0 1 0" {a}/>
    <body name="two" pos="0.5 0 0">{link}<joint name="b" axis="0 1 0" {b}/>{inside}</body>
  </body></worldbody>{rest}</mujoco>"""


def two(
    settings: str = "", turn: str = "", a: str = "", b: str = "", inside: str = "", rest: str = MOTORS, mass: float = 2
) -> str:
    """Return a planar arm of two links with more in some places."""
    return TWO.format(settings=settings, turn=turn, a=a, b=b, inside=inside, rest=rest, link=LINK.format(mass=mass))


@pytest.fixture
def put(tmp_path: Path):
    """Return a function that writes a file and returns its path."""

    def write(text: str, name: str = "arm.xml") -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


def bare(m):
    """Return a model without damping, friction and constraints."""
    m.dof_damping[:] = m.dof_frictionloss[:] = m.jnt_stiffness[:] = 0.0
    m.actuator_damping[:] = 0.0
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return m


def torques(m, qs, qds, qdds, places=None, home=None):
    """Return inverse dynamics torques of the joints at `places`, all others at home and at rest."""
    d, found = mujoco.MjData(m), []
    places = list(range(m.nv)) if places is None else places
    for q, qd, qdd in zip(qs, qds, qdds, strict=True):
        d.qpos[:] = m.qpos0 if home is None else home
        d.qvel[:] = d.qacc[:] = 0.0
        d.qpos[places], d.qvel[places], d.qacc[places] = q, qd, qdd
        mujoco.mj_inverse(m, d)
        found.append(d.qfrc_inverse[places].copy())
    return np.array(found)


def states(n: int):
    """Return random positions, velocities and accelerations, (20, n) each."""
    random = np.random.default_rng(1)
    return random.uniform(-2, 2, (20, n)), random.normal(0, 1, (20, n)), random.normal(0, 3, (20, n))


def assert_same(path: Path, arm, places=None, home=None) -> None:
    """Hold an imported arm against the file as MuJoCo reads it, to some hundred roundings of the largest torque."""
    published = bare(mujoco.MjModel.from_xml_path(str(path)))
    there = torques(published, *states(len(arm.joints)), places, home)
    here = torques(bare(mujoco.MjModel.from_xml_string(arm.mjcf)), *states(len(arm.joints)))
    assert np.max(np.abs(there - here)) <= 1e-13 * np.max(np.abs(there))


def verdicts(findings) -> set[tuple[str, str]]:
    """Return what became of which kind of part."""
    return {(part.verdict, part.what) for part in findings}


KINDS = {
    "degrees": {"settings": '<compiler angle="degree"/>', "a": 'range="-90 45"', "turn": 'euler="0 30 10"'},
    "radians": {"settings": '<compiler angle="radian"/>', "a": 'range="-1.5 0.7"', "turn": 'euler="0 0.5 0.1"'},
    "euler order": {"settings": '<compiler eulerseq="ZYX"/>', "turn": 'euler="20 30 40"'},
    "reference": {"a": 'ref="30"', "b": 'ref="-50" pos="0.1 0 0.05"'},
    "anchor off the axis": {"a": 'pos="0.1 0.02 0"', "b": 'pos="0 0 0.2"'},
    "childclass": {
        "settings": '<default><default class="own"><joint armature="0.3" damping="2"/></default></default>',
        "turn": 'childclass="own"',
    },
    "welded load": {
        "inside": '<body pos="0.3 0.1 0" euler="10 20 30"><inertial mass="1" pos="0 0 1" diaginertia="3 2 2"/></body>'
    },
    "mass of shapes": {"inside": '<body pos="0.3 0 0"><geom size="0.1"/><geom type="box" size="0.1 0.2 0.1"/></body>'},
    "compiler settings": {"settings": '<compiler boundmass="3" boundinertia="0.05" balanceinertia="true"/>'},
    "slide": {"b": 'type="slide" ref="0.2"'},
    "gravity elsewhere": {"settings": '<option gravity="1 -2 3"/>'},
    "two joints of a body": {
        "inside": f'<body name="three" pos="0.3 0 0"><joint name="c" axis="0 0 1"/><joint name="d" axis="1 0 0" '
        f'pos="0 0.1 0"/>{LINK.format(mass=1)}</body>',
        "rest": MOTORS.replace(
            "</actuator>", '<motor joint="c" ctrlrange="-5 5"/><motor joint="d" ctrlrange="-5 5"/></actuator>'
        ),
    },
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_file_becomes_the_same_arm(put, kind: str) -> None:
    """Inverse dynamics at the published positions are those of the file, whatever it is written in."""
    path = put(two(**KINDS[kind]))
    arm = import_arm(path)
    assert_same(path, arm)
    assert arm.proof.holds
    text = arm.mjcf
    assert not any(word in text for word in ("ref=", "class", "degree"))


def test_the_proof_would_find_a_change(put, monkeypatch) -> None:
    """One inertia changed by 1e-9 of its size on the way ends in an error, not in an arm."""
    from torquebench.robot import importing

    write = importing.write
    monkeypatch.setattr(
        importing, "write", lambda *args: write(*args).replace("0.01 0.02 0.02", "0.01 0.02000000002 0.02")
    )
    with pytest.raises(importing.UnprovedArmError, match="differs by"):
        import_arm(put(two()))


def test_numbers_are_those_of_the_file(put) -> None:
    """The file of a plain arm keeps its numbers digit for digit, and importing it again gives the same text."""
    path = put(two(a='armature="0.1" damping="1.25" frictionloss="0.3" range="-90 90"', mass=1.7))
    arm = import_arm(path)
    numbers = ('mass="1.7"', 'diaginertia="0.01 0.02 0.02"', 'pos="0.5 0 0"', 'armature="0.1" damping="1.25"')
    assert all(text in arm.mjcf for text in numbers)
    again = import_arm(put(arm.mjcf, "again.xml"), Options(name="arm"))
    assert again.mjcf.partition("\n")[2] == arm.mjcf.partition("\n")[2]
    assert import_arm(path).mjcf == arm.mjcf


def test_included_files_are_read(put) -> None:
    """An arm whose body is in another file is that of one file."""
    body = f'<body name="two" pos="0.5 0 0">{LINK.format(mass=2)}<joint name="b" axis="0 1 0"/></body>'
    put(f"<mujocoinclude>{body}</mujocoinclude>", "part.xml")
    whole = two().replace(body.replace('0"/></body>', '0" /></body>'), '<include file="part.xml"/>')
    path = put(whole)
    assert "include" in whole
    assert_same(path, import_arm(path))


SERVOS = {
    "position": ('<position joint="{j}" kp="100" forcerange="-{x} {x}"/>', "servo actuators"),
    "velocity": ('<velocity joint="{j}" kv="10" forcerange="-{x} {x}"/>', "servo actuators"),
    "general": (
        '<general joint="{j}" gainprm="5" biastype="affine" biasprm="0 -5 -1" forcerange="-{x} {x}"/>',
        "servo actuators",
    ),
    "geared": ('<motor joint="{j}" gear="10" ctrlrange="-{y} {y}"/>', "motors"),
    "gain": ('<general joint="{j}" gainprm="10" ctrlrange="-{y} {y}"/>', "motors"),
    "filtered": ('<general joint="{j}" dyntype="filter" dynprm="0.1" forcerange="-{x} {x}"/>', "motors with a lag"),
}


@pytest.mark.parametrize("kind", SERVOS)
def test_actuators_become_motors_of_their_force(put, kind: str) -> None:
    """Whatever drives a joint, its largest force times its gear is the torque limit."""
    text, what = SERVOS[kind]
    rest = "".join(text.format(j=j, x=x, y=x / 10) for j, x in (("a", 50), ("b", 20)))
    arm = import_arm(put(two(rest=f"<actuator>{rest}</actuator>")))
    assert ("mapped", what) in verdicts(arm.findings)
    m = mujoco.MjModel.from_xml_string(arm.mjcf)
    assert m.actuator_ctrlrange.tolist() == [[-50, 50], [-20, 20]]
    assert np.all(m.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
    assert not np.any(m.actuator_biasprm)


def test_actuatorfrcrange_bounds_and_skewed_ranges_give_their_smaller_side(put) -> None:
    """Of a joint's own range and its motor's the smaller holds; of -30 20 it is 20."""
    rest = '<actuator><position joint="a" kp="9"/><motor joint="b" ctrlrange="-30 20"/></actuator>'
    arm = import_arm(put(two(a='actuatorfrcrange="-12 12"', rest=rest)))
    m = mujoco.MjModel.from_xml_string(arm.mjcf)
    assert m.actuator_ctrlrange.tolist() == [[-12, 12], [-20, 20]]
    assert ("mapped", "force ranges that are not symmetric") in verdicts(arm.findings)


def test_rotors_and_dampers_of_actuators_are_the_joints(put) -> None:
    """An actuator's armature and damping count by the square of its gear: 0.1 + 9 x 0.5 and 0.2 + 9 x 0.7."""
    rest = MOTORS.replace(
        'joint="a" ctrlrange="-50 50"', 'joint="a" gear="3" armature="0.5" damping="0.7" ctrlrange="-9 9"'
    )
    path = put(two(a='armature="0.1" damping="0.2"', rest=rest))
    arm = import_arm(path)
    m = mujoco.MjModel.from_xml_string(arm.mjcf)
    assert [m.dof_armature[0], m.dof_damping[0]] == pytest.approx([4.6, 6.5], rel=1e-15)
    assert_same(path, arm)


QUICK = """<robot name="r"><link name="base"/>
  <link name="one"><inertial><origin xyz="0 0 0.4"/><mass value="1.5"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="two"><inertial><origin xyz="0 0 0.4"/><mass value="1.5"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 1 0"/>
    <limit effort="40" velocity="2.5" lower="-3" upper="3"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit effort="40" velocity="0" lower="-3" upper="3"/></joint>
</robot>"""


def test_speed_limits_are_kept(put) -> None:
    """A URDF's velocity above zero, and what a velocity servo can ask at most; read again they are the same."""
    servo = '<actuator><velocity joint="a" kv="3" gear="2" ctrlrange="-4 5" forcerange="-9 9"/>' + MOTORS.replace(
        "<actuator>", ""
    ).replace('joint="a"', 'joint="b"', 1)
    for path, speeds in ((put(QUICK, "arm.urdf"), (2.5, np.inf)), (put(two(rest=servo)), (2.5, np.inf))):
        arm = import_arm(path)
        assert ("kept", "speed limits") in verdicts(arm.findings)
        assert load_model(path).passive.speed == speeds
        flat = put(arm.mjcf, "flat.xml")
        assert load_model(flat).passive.speed == speeds
        assert import_arm(flat).mjcf.count("speed_limits") == 1
        wrong = put(arm.mjcf.replace('data="2.5 0"', 'data="2.5"'), "wrong.xml")
        with pytest.raises(ModelError, match="<numeric speed_limits>; wants a number for each of 2 joints"):
            load_model(wrong)


def test_mistakes_have_the_place_in_the_file(put) -> None:
    """Line and column of the first element that has a name; in an included file it is that file's."""
    put("<mujocoinclude>\n <joint name='b' stiffness='3' axis='0 1 0'/></mujocoinclude>", "joint.xml")
    text = two(a='stiffness="3"').replace('<joint name="b" axis="0 1 0" />', '<include file="joint.xml"/>')
    path = put(text)
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path)
    (problem,) = caught.value.problems
    line = text.splitlines()[1]
    assert (problem.source, problem.line, problem.column) == (str(path), 2, line.index("<joint") + 1)
    put(text.replace('stiffness="3"', ""))
    with pytest.raises(RefusedArmError, match=r"joint.xml:2:2: springs of joints of b; "):
        import_arm(path)
    put(text.replace("<joint", "<jiont", 1))
    with pytest.raises(ModelError, match=r"arm.xml: MuJoCo does not read it: .*line 2"):  # it may be the other file's
        import_arm(path)
    with pytest.raises(ModelError, match=r"arm.xml:2: MuJoCo does not read it: .*jiont"):
        import_arm(put(two().replace("<joint", "<jiont", 1)))


def test_a_negative_mass_is_refused(put) -> None:
    """MuJoCo turns it into zero without a word; all such numbers are told at once, each at its place."""
    with pytest.raises(ModelError) as caught:
        import_arm(put(two(mass=-2)))
    assert [problem.line for problem in caught.value.problems] == [2, 3]


def test_torque_limits_can_be_given(put) -> None:
    """A table takes the place of the file's; without either, the refusal names the joints and the flag."""
    path = put(two(rest=""))
    with pytest.raises(RefusedArmError, match=r"torque limits of a, b; .*--torque-limits"):
        import_arm(path)
    for limits in ((7.0, 3.0), {"b": 3.0, "a": 7.0}):
        m = mujoco.MjModel.from_xml_string(import_arm(path, Options(torque_limits=limits)).mjcf)
        assert m.actuator_ctrlrange[:, 1].tolist() == [7, 3]
    with pytest.raises(RefusedArmError, match="3 numbers for 2 joints"):
        import_arm(path, Options(torque_limits=(1.0, 2.0, 3.0)))
    with pytest.raises(RefusedArmError, match=r"no kept joint is called so \(did you mean"):
        import_arm(path, Options(torque_limits={"aa": 3.0}))


GRIPPER = (
    '<body name="hand" pos="0.4 0 0"><inertial mass="0.5" pos="0 0 0" diaginertia="0.01 0.01 0.01"/>'
    '<body name="left"><inertial mass="0.1" pos="0 0.05 0" diaginertia="1e-4 1e-4 1e-4"/>'
    '<joint name="l" type="slide" axis="0 1 0" range="0 0.04"/></body>'
    '<body name="right"><inertial mass="0.1" pos="0 -0.05 0" diaginertia="1e-4 1e-4 1e-4"/>'
    '<joint name="r" type="slide" axis="0 -1 0" range="0 0.04"/></body></body>'
)
MIMIC = (
    '<equality><joint joint1="r" joint2="l"/></equality>'
    '<keyframe><key name="open" qpos="0 0 0 0"/><key name="home" qpos="0.1 0.2 0.03 0.02"/></keyframe>'
)


def test_a_gripper_is_refused_with_the_flag_that_welds_it(put) -> None:
    """The flags named by the refusal make the arm; the fingers then weigh where the keyframe home has them."""
    path = put(two(inside=GRIPPER, rest=MOTORS + MIMIC))
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path)
    assert caught.value.flags == ("--fix", "left,right")
    arm = import_arm(path, with_flags(Options(), caught.value.flags))
    assert (arm.joints, arm.home.tolist()) == (("a", "b"), [0.1, 0.2])
    assert_same(path, arm, [0, 1], [0.1, 0.2, 0.03, 0.02])
    assert ("dropped", "equality constraints") in verdicts(arm.findings)
    assert 'key name="home" qpos="0.1 0.2"' in arm.mjcf


def test_a_tip_leaves_out_what_hangs_from_it(put) -> None:
    """With the tip at the second link the arm is the one without the gripper."""
    path = put(two(inside=GRIPPER, rest=MOTORS + MIMIC))
    arm = import_arm(path, Options(tip="two"))
    assert_same(put(two(), "bare.xml"), arm)


def test_a_base_cuts_one_arm_out_of_two(put) -> None:
    """Of two arms on a turning torso, one is kept, standing where the torso is at home."""
    side = TWO.format(settings="", turn="", a="", b="", inside="", rest="", link=LINK.format(mass=2))
    body = side[side.index('<body name="one"') : side.index("</worldbody>")]
    other = body.replace('"one"', '"uno"').replace('"two"', '"duo"').replace('"a"', '"c"').replace('"b"', '"d"')
    torso = (
        f'<mujoco><worldbody><body name="torso"><joint name="t"/>{LINK.format(mass=9)}<body name="stand" pos="0 1 0">'
        f'{body}</body>{other}</body></worldbody>{MOTORS}<keyframe><key qpos="0.5 0 0 0 0"/></keyframe></mujoco>'
    )
    path = put(torso)
    with pytest.raises(RefusedArmError, match="they part at torso: --fix uno welds the smaller"):
        import_arm(path)
    arm = import_arm(path, Options(base="stand"))
    assert arm.joints == ("a", "b")
    m = mujoco.MjModel.from_xml_path(str(path))
    d = mujoco.MjData(m)
    d.qpos[0] = 0.5
    mujoco.mj_kinematics(m, d)
    plain = mujoco.MjModel.from_xml_string(arm.mjcf)
    assert np.max(np.abs(plain.body_pos[1] - d.body("one").xpos)) <= 1e-15
    assert_same(path, arm, [1, 2], [0.5, 0, 0, 0, 0])


def test_of_two_arms_on_a_torso_one_is_proposed(put) -> None:
    """Where the largest branches have as many joints, more than what carries them, the flag takes one of them whole."""
    joint = '<joint name="{0}" axis="0 1 0"/>' + LINK.format(mass=1)

    def chain(name: str, count: int) -> str:
        start = "".join(f'<body name="{name}{i}" pos="0.2 0 0">{joint.format(f"{name}{i}")}' for i in range(count))
        return start + "</body>" * count

    torso = f'<body name="torso">{joint.format("lift")}{chain("head", 1)}{chain("left", 3)}{chain("right", 3)}</body>'
    path = put(f"<mujoco><worldbody>{torso}</worldbody></mujoco>")
    with pytest.raises(RefusedArmError, match="stand on torso: --tip left2 or --tip right2 takes one") as caught:
        import_arm(path)
    options = with_flags(Options(torque_limits=(9.0,) * 4), caught.value.flags)
    assert import_arm(path, options).joints == ("lift", "left0", "left1", "left2")


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_where_a_torso_slides_the_arm_is_offered_without_it(put, kind: str) -> None:
    """The head is welded, and --base beside that flag leaves the slide out; a torso that turns is part of the arm."""
    joint = '<joint name="{0}" axis="0 1 0" type="{1}"/>' + LINK.format(mass=1)
    arm = "".join(f'<body name="{n}" pos="0.2 0 0">{joint.format(n, "hinge")}' for n in "abcd") + "</body>" * 4
    head = f'<body name="head">{joint.format("pan", "hinge")}</body>'
    torso = f'<body name="torso">{joint.format("lift", kind)}{head}{arm}</body>'
    path = put(f"<mujoco><worldbody>{torso}</worldbody></mujoco>")
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path)
    assert ("--base torso" in str(caught.value)) is (kind == "slide")
    options = with_flags(Options(base="torso", torque_limits=(9.0,) * 4), caught.value.flags)
    assert import_arm(path, options).joints == tuple("abcd")


def test_what_flags_would_leave_is_told_too(put) -> None:
    """Welding joints that are called as their bodies leaves what is beyond: all is told at once, with all flags."""
    finger = (
        '<body name="{0}"><joint name="{0}"/>{2}<body name="{1}" pos="0.1 0 0"><joint name="{1}"/>{2}</body></body>'
    )
    hand = "".join(finger.format(name, f"{name}tip", LINK.format(mass=0.1)) for name in ("thumb", "finger"))
    path = put(two(inside=hand))
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path)
    assert caught.value.flags == ("--fix", "thumb,finger", "--fix", "thumbtip,fingertip")
    assert import_arm(path, with_flags(Options(), caught.value.flags)).joints == ("a", "b")


def test_all_that_is_wrong_comes_at_once(put) -> None:
    """Spring, fluid, ball joint, missing limit and unknown names are refused together, each with its flag."""
    ball = (
        '<body name="head"><joint name="neck" type="ball"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body>'
    )
    path = put(two(settings='<option density="1.2"/>', a='stiffness="3"', inside=ball, rest=""))
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path, Options(fix=("hed",)))
    text = str(caught.value)
    assert "ball joint of neck" in text
    assert "'head'" in text
    with pytest.raises(RefusedArmError) as caught:
        import_arm(path)
    refused = {what for verdict, what in verdicts(caught.value.findings) if verdict == "refused"}
    assert refused == {"ball joint", "springs of joints", "a fluid around the arm", "torque limits"}
    options = dataclasses.replace(with_flags(Options(), caught.value.flags), torque_limits=(5.0, 6.0))
    assert (options.fix, options.drop) == (("neck",), ("springs", "fluid"))
    assert import_arm(path, options).joints == ("a", "b")


def test_constraints_and_tendons_on_kept_joints_are_refused(put) -> None:
    """A coupling of two driven joints is told; one that the file's flag switches off is not."""
    couple = MOTORS + '<equality><joint joint1="b" joint2="a"/></equality>'
    both = '<joint joint="a" coef="1"/><joint joint="b" coef="1"/>'
    pull = f'<tendon><fixed name="rope" stiffness="5">{both}</fixed></tendon>'
    with pytest.raises(RefusedArmError) as caught:
        import_arm(put(two(rest=couple + pull)))
    assert caught.value.flags == ("--drop", "tendons", "--fix", "b")
    flag = '<option><flag equality="disable" spring="disable"/></option>'
    assert import_arm(put(two(settings=flag, rest=couple, a='stiffness="3"'))).joints == ("a", "b")


def test_gravity_compensation_is_less_gravity_or_refused(put) -> None:
    """Where every link compensates 0.75 of its weight gravity is a quarter; else nothing short of --drop takes it."""
    text = two().replace('<body name="one"', '<body gravcomp="0.75" name="one"')
    even = text.replace('<body name="two"', '<body gravcomp="0.75" name="two"')
    m = mujoco.MjModel.from_xml_string(import_arm(put(even)).mjcf)
    assert m.opt.gravity.tolist() == [0, 0, -9.81 / 4]
    with pytest.raises(RefusedArmError, match="not the same on all links"):
        import_arm(put(text))
    whole = mujoco.MjModel.from_xml_string(import_arm(put(text), Options(drop=("gravcomp",))).mjcf)
    assert whole.opt.gravity.tolist() == [0, 0, -9.81]


URDF = """<robot name="u"><mujoco><compiler balanceinertia="false"/></mujoco><link name="floor"/>
<link name="one"><inertial><origin xyz="0.2 0 0" rpy="0.3 0.2 0.1"/><mass value="2"/>
 <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial>
 <visual><geometry><mesh filename="package://nowhere/look.dae"/></geometry></visual>
 <collision><geometry><box size="1 1 1"/></geometry></collision></link>
<link name="cover"><collision><geometry><box size="1 1 1"/></geometry></collision></link>
<link name="sensor"><inertial><mass value="0.1"/>
 <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="two"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
 <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="a" type="revolute"><parent link="floor"/><child link="one"/><origin xyz="0 0 1" rpy="0.1 0 0"/>
 <axis xyz="0 1 0"/><limit lower="0.5" upper="2" effort="40" velocity="1"/>
 <dynamics damping="0.3" friction="0.2"/></joint>
<joint name="w" type="fixed"><parent link="one"/><child link="cover"/></joint>
<joint name="s" type="fixed"><parent link="one"/><child link="sensor"/><origin xyz="0 0 0.1"/></joint>
<joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
 <limit effort="15" velocity="1"/>{mimic}</joint>
<joint name="t" type="fixed"><parent link="two"/><child link="tool"/><origin xyz="0.4 0 0"/></joint></robot>"""


def test_a_urdf_agrees_with_pinocchio(put) -> None:
    """Effort is the torque limit, links without inertia weigh nothing, and Pinocchio gets the same torques."""
    pinocchio = pytest.importorskip("pinocchio")
    path = put(URDF.format(mimic=""), "u.urdf")
    arm = import_arm(path)
    m = mujoco.MjModel.from_xml_string(arm.mjcf)
    assert m.actuator_ctrlrange[:, 1].tolist() == [40, 15]
    assert (m.dof_damping.tolist(), m.dof_frictionloss.tolist()) == ([0.3, 0], [0.2, 0])
    assert arm.home.tolist() == [0.5, 0]  # zero, moved into the range
    assert ("mapped", "links without inertia") in verdicts(arm.findings)
    assert ("dropped", "mesh files") in verdicts(arm.findings)
    other = pinocchio.buildModelFromUrdf(str(path))
    data, (qs, qds, qdds) = other.createData(), states(2)
    there = []
    for q, qd, qdd in zip(qs, qds, qdds, strict=True):
        turned = np.array([q[0], np.cos(q[1]), np.sin(q[1])])  # a continuous joint is a point of the circle there
        there.append(pinocchio.rnea(other, data, turned, qd, qdd).copy())
    here = torques(bare(m), qs, qds, qdds)
    assert np.max(np.abs(here - np.array(there))) <= 1e-13 * np.max(np.abs(here))


def random_urdf(random: np.random.Generator) -> tuple[str, int]:
    """Return a chain of revolute, prismatic and fixed joints with random frames and links, and how many move."""

    def numbers(size: float) -> str:
        return " ".join(f"{x:.6f}" for x in random.uniform(-size, size, 3))

    kinds = [*random.choice(["revolute", "revolute", "prismatic", "fixed"], random.integers(3, 8)), "revolute"]
    parts = ['<link name="l0"/>']
    for i, kind in enumerate(kinds, 1):
        low, middle = sorted(random.uniform(0.01, 0.05, 2))
        moments = f'ixx="{middle:.6f}" iyy="{low:.6f}" izz="{0.9 * (low + middle):.6f}" ixy="0" ixz="0" iyz="0"'
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="{numbers(0.2)}" rpy="{numbers(3)}"/>'
            f'<mass value="{random.uniform(0.1, 3):.4f}"/><inertia {moments}/></inertial></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{numbers(0.4)}" rpy="{numbers(3)}"/><axis xyz="{numbers(1)}"/>'
            '<limit lower="-3" upper="3" effort="20" velocity="2"/></joint>'
        )
    return f'<robot name="r">{"".join(parts)}</robot>', sum(kind != "fixed" for kind in kinds)


@pytest.mark.parametrize("seed", range(10))
def test_random_urdfs_agree_with_pinocchio(put, seed: int) -> None:
    """Ten chains: Pinocchio, which reads the file itself, gets the torques of the imported arm, to its roundings."""
    pinocchio = pytest.importorskip("pinocchio")
    text, n = random_urdf(np.random.default_rng(seed))
    path = put(text, "u.urdf")
    here = torques(bare(mujoco.MjModel.from_xml_string(import_arm(path).mjcf)), *states(n))
    other = pinocchio.buildModelFromUrdf(str(path))
    data = other.createData()
    there = np.array([pinocchio.rnea(other, data, *state).copy() for state in zip(*states(n), strict=True)])
    assert np.max(np.abs(here - there)) <= 1e-13 * np.max(np.abs(there))


def test_a_mimic_joint_is_told(put) -> None:
    """A joint that follows another is refused, with the flag that welds it."""
    with pytest.raises(RefusedArmError) as caught:
        import_arm(put(URDF.format(mimic='<mimic joint="a" multiplier="2"/>'), "u.urdf"))
    assert caught.value.flags == ("--fix", "b")


def tetrahedron() -> bytes:
    """Return an STL file of a body with volume."""
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.3]], dtype="<f4")
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    records = b"".join(struct.pack("<3f", 0, 0, 0) + corners[list(face)].tobytes() + b"\0\0" for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + records


def test_a_mesh_gives_mass_or_looks(put, tmp_path: Path) -> None:
    """The mass that a mesh gives is taken; one that only looks is in the folder, where the picture has it."""
    (tmp_path / "m.stl").write_bytes(tetrahedron())
    assets = '<asset><mesh name="m" file="m.stl"/></asset>'
    heavy = '<body pos="0.3 0 0"><geom type="mesh" mesh="m"/></body>'
    path = put(two(settings=assets, inside=heavy))
    assert_same(path, import_arm(path))
    look = '<geom type="mesh" mesh="m" pos="0.1 0 0" euler="0 0 30" contype="0" conaffinity="0" rgba="1 0 0 1"/>'
    path = put(two(settings=assets, inside=look))
    arm = import_arm(path)
    out = tmp_path / "arms" / "arm"
    files = write_folder(arm, out, "torquebench import arm.xml")
    assert {"arm.xml", "scene.xml", "meshes/m.stl", "README.md"} == set(files)
    scene = mujoco.MjModel.from_xml_path(str(out / "scene.xml"))
    published = mujoco.MjModel.from_xml_path(str(path))
    a, b = mujoco.MjData(scene), mujoco.MjData(published)
    for m, d in ((scene, a), (published, b)):
        d.qpos[:] = 0.4, -0.3
        mujoco.mj_kinematics(m, d)

    def corners(m, d):
        return m.mesh_vert @ d.geom_xmat[0].reshape(3, 3).T + d.geom_xpos[0]

    here, there = (x[np.lexsort(np.round(x, 5).T)] for x in (corners(scene, a), corners(published, b)))
    assert np.max(np.abs(here - there)) <= 1e-6  # meshes are of single precision
    assert scene.geom_rgba[0].tolist() == [1, 0, 0, 1]
    with pytest.raises(ModelError, match="not empty"):
        write_folder(arm, out, "")
    touching = '<geom name="hull" type="box" size="0.1 0.1 0.1" mass="0"/>'
    path = put(
        two(settings=assets, inside=look + touching).replace("<joint", f"{touching.replace('hull', 'far')}<joint", 1)
    )
    write_folder(import_arm(path), tmp_path / "arms" / "two", "")
    scene = mujoco.MjModel.from_xml_path(str(tmp_path / "arms" / "two" / "scene.xml"))
    kinds = dict(zip(scene.geom_bodyid.tolist(), scene.geom_type.tolist(), strict=True))  # one shape of each link
    assert kinds == {1: int(mujoco.mjtGeom.mjGEOM_BOX), 2: int(mujoco.mjtGeom.mjGEOM_MESH)}
    (tmp_path / "m.stl").unlink()
    assert ("dropped", "mesh files") in verdicts(import_arm(path).findings)
    files = write_folder(import_arm(path), tmp_path / "arms" / "three", "")
    assert set(files) == {"arm.xml", "README.md"}  # the boxes alone would be odd pieces: each link is a capsule then
    with pytest.raises(ModelError, match="mass of some bodies comes from mesh files that are not there"):
        import_arm(put(two(settings=assets, inside=heavy)))


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("no xml", "does not read it"),
        ("<mujoco><worldbody/></mujoco>", "nothing that is left moves"),
        (two().replace('mass="2"', 'mass="0"'), "without inertia|mjMINVAL"),
        ('<mujoco><worldbody/><actuator><plugin plugin="x" joint="a"/></actuator></mujoco>', "plugin"),
    ],
    ids=["no xml", "no joint", "no mass", "plugin"],
)
def test_what_is_no_arm_is_refused(put, text: str, word: str) -> None:
    """Files without an arm, or with code, end in one message."""
    with pytest.raises((ModelError, RefusedArmError), match=word):
        import_arm(put(text))


@pytest.mark.parametrize("joint", ["ball", "free"])
def test_flags_that_leave_nothing_are_no_cure(put, joint: str) -> None:
    """A body that one joint carries alone, of a kind that no torque drives: refused, and no flag is offered."""
    text = f'<mujoco><worldbody><body><joint type="{joint}"/><geom size="1"/></body></worldbody></mujoco>'
    with pytest.raises(RefusedArmError, match=f"{joint} joint") as caught:
        import_arm(put(text))
    assert caught.value.flags == ()


def test_numbers_that_are_no_limits_are_refused(put) -> None:
    """NaN, zero and negative limits are refused by the joint's name, in a list as by names."""
    for limits, name in (((math.nan, 1.0), "a"), ({"b": math.nan}, "b"), ((1.0, -1.0), "b"), ((0.0, 1.0), "a")):
        with pytest.raises(RefusedArmError) as caught:
            import_arm(put(two()), Options(torque_limits=limits))
        wrong = [part for part in caught.value.findings if part.what == "--torque-limits" and part.verdict == "refused"]
        assert [part.places for part in wrong] == [(name,)], limits


def test_a_tool_that_is_not_there_is_refused(put) -> None:
    """Also where the file has a site by one of the usual names: what was asked for is not passed over."""
    with pytest.raises(RefusedArmError, match="no site or body of the last link is called so"):
        import_arm(put(two(inside='<site name="attachment_site"/>')), Options(tool="nosuch"))


def test_a_run_is_drawn_with_the_looks_of_its_arm_while_they_are_there(put, tmp_path: Path) -> None:
    """The scene file beside an imported arm is found from a run's folder; without its meshes the links are drawn."""
    from torquebench.experiment.folder import _with_meshes
    from torquebench.robot.library import ArmFile, scene_path
    from torquebench.scene.look import build_scene

    (tmp_path / "m.stl").write_bytes(tetrahedron())
    look = '<geom type="mesh" mesh="m" contype="0" conaffinity="0"/>'
    arm = import_arm(put(two(settings='<asset><mesh name="m" file="m.stl"/></asset>', inside=look)))
    home, run = tmp_path / "arms" / "arm", tmp_path / "runs" / "one"
    write_folder(arm, home, "")
    run.mkdir(parents=True)
    (run / "arm.xml").write_text(arm.mjcf, encoding="utf-8")
    scene = scene_path(home / "arm.xml")
    assert scene == home / "scene.xml"
    (run / "scene.xml").write_bytes(_with_meshes(scene, run))
    zero = np.zeros((1, 2))
    for file in (home / "arm.xml", run / "arm.xml"):
        assert build_scene(file, zero).model.nmesh == 1
        assert build_scene(file, zero, bare=True).model.nmesh == 0
    (home / "meshes" / "m.stl").unlink()
    assert build_scene(run / "arm.xml", zero).model.nmesh == 0
    assert scene_path(ArmFile("arm", arm.mjcf, origin=run / "arm.xml")) == run / "scene.xml"
    (run / "scene.xml").write_text("<mujoco/>", encoding="utf-8")  # somebody else's
    assert scene_path(ArmFile("arm", arm.mjcf, origin=run / "arm.xml")) is None


def test_moments_that_no_body_has(put) -> None:
    """A link with them is refused, or gets their mean when asked; one that is welded to a link need not be possible."""
    odd = two().replace("0.01 0.02 0.02", "0.01 0.02 0.04", 1)
    with pytest.raises(RefusedArmError, match=r"impossible inertia of one; .*0.01 0.02 0.04") as caught:
        import_arm(put(odd))
    assert caught.value.flags == ("--drop", "impossible-inertia")
    arm = import_arm(put(odd), with_flags(Options(), caught.value.flags))
    mean = (0.01 + 0.02 + 0.04) / 3
    assert mujoco.MjModel.from_xml_string(arm.mjcf).body_inertia[1] == pytest.approx([mean] * 3, rel=1e-15)
    welded = '<body><inertial mass="0.1" pos="0 0 0" diaginertia="0.001 0.002 0.004"/></body>'
    m = mujoco.MjModel.from_xml_string(import_arm(put(two(inside=welded))).mjcf)
    rod = 0.004 + 0.02 + 2 * 0.2**2 - (2 * 0.2) ** 2 / 2.1  # about the z axis and the common centre
    assert np.sort(m.body_inertia[2])[-1] == pytest.approx(rod, rel=1e-14)


def test_the_tool_is_where_the_last_link_branches_or_a_site_of_a_usual_name(put) -> None:
    """Of a hand with two fingers it is the hand, in the middle; a site ``ee`` on it comes first; both are said."""
    fingers = "".join(
        f'<body name="{side}" pos="0 {y} 0.1"><geom type="sphere" size="0.01" mass="0.1"/></body>'
        for side, y in (("left", 0.04), ("right", -0.04))
    )
    hand = f'<body name="hand" pos="0 0 0.2"><geom type="box" size="0.02 0.05 0.02" mass="0.3"/>%s{fingers}</body>'
    for site, what in (("", "body hand"), ('<site name="ee" pos="0 0 0.1"/>', "site ee")):
        arm = import_arm(put(two(inside=hand % site)))
        assert [part.places for part in arm.findings if part.what == "tool"] == [(what,)]


def test_nothing_is_welded_as_asked_where_nobody_asked(put) -> None:
    """What a refusal proposes is told as such; what --fix names is welded."""
    hand = '<body name="%s"><joint name="%s" type="slide" axis="0 1 0"/><geom size="0.02" mass="0.1"/></body>'
    path = put(two(inside=hand % ("left", "l") + hand % ("right", "r")))
    with pytest.raises(RefusedArmError) as refused:
        import_arm(path)
    assert any(part.reason == "would be welded at home" for part in refused.value.findings)
    arm = import_arm(path, Options(fix=("left", "right")))
    assert any(part.reason == "welded at home" for part in arm.findings)


def test_what_is_left_out_is_told_heaviest_first_with_its_mass_and_a_home_at_the_end_of_a_range(put) -> None:
    """4 kg beyond the tip, the 3 kg body first; the joint whose range begins at home is named, the other is not."""

    def link(name: str, mass: float, inner: str, joint: str = "") -> str:
        inertial = f'<inertial pos="0 0 .1" mass="{mass}" diaginertia=".01 .01 .01"/>'
        return f'<body name="{name}" pos="0 0 .3">{inertial}{joint}{inner}</body>'

    hinge = '<joint name="{}" axis="0 1 0" range="{}"/>'
    beyond = link("light", 1, link("heavy", 3, "", '<joint name="claw"/>'))
    arm = link("a", 1, link("b", 1, beyond, hinge.format("j2", "-1 1")), hinge.format("j1", "0 2"))
    motors = "".join(f'<motor joint="j{k}" ctrlrange="-20 20"/>' for k in (1, 2))
    text = f"""<mujoco><compiler angle="radian"/><worldbody>{arm}</worldbody><actuator>{motors}</actuator></mujoco>"""
    found = import_arm(put(text), Options(tip="b")).findings
    (dropped,) = [part for part in found if part.what == "bodies"]
    assert dropped.places == ("heavy", "light")
    assert dropped.reason.endswith("4 kg")
    assert [part.places for part in found if part.what == "home"][1:] == [("j1",)]
