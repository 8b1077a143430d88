"""Each MJCF feature is either modelled right by the analytic side or refused by name; none is quietly wrong."""

import numpy as np
import pytest

from torquebench import AnalyticPlant, MujocoPlant, load_model
from torquebench.comparison import compare_terms, random_states
from torquebench.errors import ModelError
from torquebench.robot.library import ArmFile
from torquebench.sim.plants.mujoco import MujocoModel

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="RK4" gravity="0.5 0 -9.81"/>
  <worldbody>
    <body name="one">
      <inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.1 0.1"/>
      <joint name="a" type="hinge" axis="0 1 0"/>
      <body name="two" pos="0.6 0 0.1">
        <inertial mass="1" pos="0.2 0.1 0" diaginertia="0.01 0.03 0.03"/>
        <joint name="b" type="hinge" axis="1 1 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="ma" joint="a" ctrllimited="true" ctrlrange="-50 50"/>
    <motor name="mb" joint="b" ctrllimited="true" ctrlrange="-30 30"/>
  </actuator>
</mujoco>"""

B = '<joint name="b" type="hinge" axis="1 1 0"/>'
MB = '<motor name="mb" joint="b" ctrllimited="true" ctrlrange="-30 30"/>'
OPTION = '<option timestep="0.001" integrator="RK4" gravity="0.5 0 -9.81"/>'
WORLD = "<worldbody>"
LIMITS = 'ctrllimited="true" ctrlrange="-30 30"'

GEOM = '<geom size="0.05" mass="0.1"/>'
JOINT = '<joint name="{}" axis="0 0 1" armature="0.1" actuatorfrcrange="-5 5" actuatorfrclimited="true"/>'

RIGHT = {
    "as it is": ("", ""),
    "reference angle": (B, '<joint name="b" type="hinge" axis="1 1 0" ref="0.4"/>'),
    "slide with a reference": (B, '<joint name="b" type="slide" axis="1 1 0" ref="0.4"/>'),
    "spring reference without a spring": (B, '<joint name="b" type="hinge" axis="1 1 0" springref="0.4"/>'),
    "two joints on a body": (B, B + '<joint name="c" axis="0 0 1" actuatorfrcrange="-5 5" actuatorfrclimited="true"/>'),
    "gravity switched off": (OPTION, OPTION.replace("/>", '><flag gravity="disable"/></option>')),
    "actuation switched off": (OPTION, OPTION.replace("/>", '><flag actuation="disable"/></option>')),
    "geoms that add mass": (B, B + '<geom size="0.05" density="500" pos="0.1 0 0" contype="0" conaffinity="0"/>'),
    "total mass set": ('angle="radian"', 'angle="radian" settotalmass="5"'),
    "frame": (B, B + '<frame euler="0.3 0 0"><site name="tool" pos="0.1 0 0"/></frame>'),
    "default armature": (WORLD, '<default><joint armature="0.2"/></default>' + WORLD),
    "wind without a medium": (OPTION, OPTION.replace("/>", ' wind="5 0 0"/>')),
    "a table after the arm": (
        "</worldbody>",
        '<body pos="1 1 0"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body></worldbody>',
    ),
    "sleep": (OPTION, OPTION.replace("/>", ' sleep_tolerance="1"><flag sleep="enable"/></option>')),
    "discrete inverse dynamics": (OPTION, OPTION.replace("/>", '><flag invdiscrete="enable"/></option>')),
    "names that look like numbers": (B, B + '<site name="nan"/><frame name="inf"/>'),
    "degrees": ('angle="radian"', 'angle="degree"'),
    "geoms of neighbours": (B, B + GEOM + f"<body pos='1 0 0'>{JOINT.format('c')}{GEOM}</body>"),
    "a force in the parent's frame": (MB, f'<motor name="mb" jointinparent="b" {LIMITS}/>'),
    "numbers that are none": (WORLD, '<custom><numeric name="x" data="nan inf"/></custom>' + WORLD),
}

REFUSED = {
    "position servo": (MB, f'<position name="mb" joint="b" kp="100" {LIMITS}/>', "not a plain motor"),
    "velocity servo": (MB, f'<velocity name="mb" joint="b" kv="10" {LIMITS}/>', "not a plain motor"),
    "affine bias": (
        MB,
        f'<general name="mb" joint="b" biastype="affine" biasprm="0 -5 0" {LIMITS}/>',
        "not a plain motor",
    ),
    "filter": (MB, f'<general name="mb" joint="b" dyntype="filter" dynprm="0.1" {LIMITS}/>', "actuator|motor"),
    "site actuator": (
        B,
        B + '<site name="s"/>',
        "not a plain motor",
    ),
    "motor armature": (MB, MB.replace("/>", ' armature="0.3"/>'), "actuator armature"),
    "motor damping": (MB, MB.replace("/>", ' damping="0.3"/>'), "actuator damping"),
    "damping polynomial": (B, B.replace("/>", ' damping="0 1"/>'), "joint damping that grows"),
    "stiffness polynomial": (B, B.replace("/>", ' stiffness="0 2"/>'), "joint stiffness"),
    "reference on a body with two joints": (
        B,
        B + '<joint name="c" axis="0 0 1" ref="0.5" actuatorfrcrange="-5 5" actuatorfrclimited="true"/>',
        "reference angle",
    ),
    "equality": (
        "<actuator>",
        '<equality><joint joint1="a" joint2="b"/></equality><actuator>',
        "equality constraints",
    ),
    "tendon": (
        "<actuator>",
        '<tendon><fixed><joint joint="a" coef="1"/></fixed></tendon><actuator>',
        "tendons",
    ),
    "colliding geom": (
        B,
        B + GEOM + f"<body>{JOINT.format('c')}{GEOM}<body pos='1 0 0'>{JOINT.format('d')}{GEOM}</body></body>",
        "colliding geoms",
    ),
    "contact pair": (
        WORLD,
        '<contact><pair geom1="g" geom2="h"/></contact>'
        + WORLD
        + '<geom name="g" size="0.1" contype="0" conaffinity="0"/>',
        "colliding geoms",
    ),
    "flexible body": (
        WORLD,
        WORLD + '<flexcomp name="f" type="grid" dim="2" count="3 3 1" spacing=".1 .1 .1" mass="1" rigid="true"/>',
        "flexcomp .* is refused",
    ),
    "tool on another link": (
        '<body name="two"',
        '<site name="tool"/><frame name="frame"/><body name="two"',
        "'tool' is not on the last link",
    ),
    "another file": (WORLD, '<asset><material name="x"/></asset><keyframe file="y"/>' + WORLD, "stand alone"),
    "mocap body": (WORLD, WORLD + '<body mocap="true"/>', "mocap bodies"),
}


def variant(tmp_path, old, new):
    """The arm with one replacement, as a file."""
    text = ARM.replace(old, new) if old else ARM
    if "<site name=" in new and "<frame" not in new:
        text = text.replace("</actuator>", f'<general site="s" biastype="affine" biasprm="3 0 0" {LIMITS}/></actuator>')
    if "geom2" in new:
        text = text.replace(B, B + '<geom name="h" size="0.1" mass="0.1" contype="0" conaffinity="0"/>')
    path = tmp_path / "arm.xml"
    path.write_text(text)
    return path


def text_of(tmp_path, old, new):
    """The arm with one replacement, as a text that no file stands behind, so that nothing is made of it."""
    return ArmFile("arm", variant(tmp_path, old, new).read_text())


@pytest.mark.parametrize("name", RIGHT)
def test_modelled_right(tmp_path, name):
    """All terms agree to 1e-12, and so do 0.3 s of motion under a constant torque."""
    path = variant(tmp_path, *RIGHT[name])
    arm = load_model(path)
    rows = compare_terms(MujocoModel(path), arm, random_states(arm.n, 20, seed=1), 1e-12)
    assert all(row.agrees for row in rows), [(row.term, row.relative) for row in rows]
    ends = []
    for plant in (MujocoPlant(path), AnalyticPlant(arm)):
        plant.reset(np.full(arm.n, 0.3), np.full(arm.n, -0.5))
        plant.step(np.linspace(1.0, 2.0, arm.n), 300)
        ends.append(plant.state()[0])
    assert np.max(np.abs(ends[0] - ends[1])) <= 1e-12


@pytest.mark.parametrize("name", REFUSED)
def test_refused_by_name(tmp_path, name):
    """What the analytic side does not model is an error that names it."""
    old, new, message = REFUSED[name]
    with pytest.raises(ModelError, match=message):
        load_model(text_of(tmp_path, old, new))


@pytest.mark.parametrize("name", ["position servo", "affine bias"])
def test_actuators_that_act_by_themselves_are_refused_by_the_plant_too(tmp_path, name):
    """With its control at zero a servo still pulls; a plant that let it would not do what the law commands."""
    old, new, message = REFUSED[name]
    with pytest.raises(ModelError, match=message):
        MujocoPlant(text_of(tmp_path, old, new))


@pytest.mark.parametrize(
    ("motor", "limit"),
    [
        (f'<motor joint="b" {LIMITS} gear="-2"/>', 60.0),
        (
            '<motor joint="b" ctrllimited="true" ctrlrange="-1 1" gear="3" forcelimited="true" forcerange="-0.5 0.5"/>',
            1.5,
        ),
        ('<general joint="b" gainprm="50" ctrllimited="true" ctrlrange="-1 1"/>', 50.0),
        (f'<motor joint="b" {LIMITS}/><motor joint="b" ctrllimited="true" ctrlrange="-20 20"/>', 50.0),
    ],
)
def test_torque_limits(tmp_path, motor, limit):
    """Gear (of either sign), gain and force range count, and motors on one joint add up."""
    path = variant(tmp_path, MB, motor)
    assert load_model(path).flat.tau_max[1] == limit
    assert MujocoPlant(path).tau_max[1] == limit


def test_the_smaller_of_motor_and_joint_limit_holds(tmp_path):
    """A joint's own force range caps its motor."""
    path = variant(tmp_path, B, B.replace("/>", ' actuatorfrcrange="-7 7" actuatorfrclimited="true"/>'))
    assert load_model(path).flat.tau_max[1] == 7.0
