"""The PUMA's look changes nothing but the picture; arms without one are drawn along their kinematics."""

import runpy
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from torquebench.errors import ModelError
from torquebench.robot.library import CAMERAS, camera_names, data_root
from torquebench.robot.puma560.puma import Puma560
from torquebench.scene.look import MARGIN, STILL, build_scene, window

FOLDER = data_root() / "models" / "puma560"
ARM, SCENE = FOLDER / "puma560.xml", FOLDER / "scene.xml"
PHYSICS = ("body_", "dof_", "jnt_", "actuator_", "site_", "qpos", "opt")
"""Beginnings of the names of a model's arrays that its motion depends on."""
UNUSED = ("geomadr", "geomnum", "bvhadr", "bvhnum", "dof_length")
"""Ends of the names of arrays that only list a body's geoms, or say when a body may sleep (none does)."""


def physics(model):
    """Every array of a compiled model that its motion can depend on, by name."""
    names = [n for n in dir(model) if n.startswith(PHYSICS) and not n.endswith(UNUSED)]
    arrays = {n: np.array(getattr(model, n)) for n in names if isinstance(getattr(model, n), np.ndarray)}
    return arrays | {n: np.array(getattr(model.opt, n)) for n in ("timestep", "gravity", "integrator", "disableflags")}


def rollout(model):
    """States of 400 steps under torques that differ from step to step and shake all joints."""
    d = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    out = []
    for _ in range(400):
        d.qfrc_applied[:] = rng.normal(size=model.nv) * [60, 90, 40, 8, 8, 8]
        mujoco.mj_step(model, d)
        out.append(np.concatenate([d.qpos, d.qvel, d.qacc]))
    return np.array(out)


def test_the_scene_is_generated_from_the_arm():
    """models/puma560/scene.xml is what scripts/puma560_scene.py makes of puma560.xml; if not, run it."""
    script = runpy.run_path(str(data_root() / "scripts" / "puma560_scene.py"))
    assert SCENE.read_text(encoding="utf-8") == script["scene"]()


def test_the_look_is_without_mass_and_touches_nothing():
    """Every geom is of a class with mass 0, contype 0 and conaffinity 0, and says nothing else of these."""
    root = ElementTree.parse(SCENE).getroot()
    base = root.find("default/default[@class='look']/geom")
    assert {key: base.get(key) for key in ("mass", "contype", "conaffinity")} == dict.fromkeys(
        ("mass", "contype", "conaffinity"), "0"
    )
    geoms = list(root.find("worldbody").iter("geom"))
    assert len(geoms) > 30
    assert all(
        g.get("class") == "look" and not {"mass", "density", "contype", "conaffinity"} & set(g.keys()) for g in geoms
    )
    m = mujoco.MjModel.from_xml_path(str(SCENE))
    assert not m.geom_contype.any()
    assert not m.geom_conaffinity.any()


def test_physics_is_the_same_bit_for_bit_with_and_without_the_look():
    """All arrays of bodies, joints and motors are equal; mass matrix, bias and 400 steps are equal bits."""
    plain, dressed = (mujoco.MjModel.from_xml_path(str(path)) for path in (ARM, SCENE))
    a, b = physics(plain), physics(dressed)
    assert {"body_mass", "body_inertia", "body_ipos", "dof_armature", "jnt_axis", "site_pos"} <= set(a)
    assert [name for name in a if not np.array_equal(a[name], b[name])] == []
    assert rollout(plain).tobytes() == rollout(dressed).tobytes()
    full = []
    for m in (plain, dressed):
        d, M = mujoco.MjData(m), np.zeros((6, 6))
        d.qpos[:], d.qvel[:] = [0.3, -0.7, 0.9, 0.2, -0.4, 0.5], [1, -2, 1.5, 0.3, 2, -1]
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, M)
        full.append(np.concatenate([M.ravel(), d.qfrc_bias]).tobytes())
    assert full[0] == full[1]


def test_the_comparison_of_physics_sees_a_change():
    """A mass of the scene changed by one part in a million turns the comparison of arrays and of steps red."""
    m = mujoco.MjModel.from_xml_path(str(SCENE))
    m.body_mass[2] *= 1.0 + 1e-6
    plain = mujoco.MjModel.from_xml_path(str(ARM))
    assert not np.array_equal(physics(plain)["body_mass"], physics(m)["body_mass"])
    assert rollout(plain).tobytes() != rollout(m).tobytes()


def test_links_reach_from_joint_to_joint():
    """Upper arm and forearm have a round end about each of their joints' axes; the column stands on the floor."""
    root = ElementTree.parse(SCENE).getroot()
    ends = {}
    for body in root.iter("body"):
        cylinders = [g for g in body.findall("geom") if g.get("type") == "cylinder"]
        ends[body.get("name")] = np.array([[float(x) for x in g.get("fromto").split()] for g in cylinders])
    for x in (0.0, 0.4318):  # shoulder and elbow in the upper arm's frame: a2 of Table 2
        assert np.any(np.all(np.abs(ends["link2"][:, [0, 1, 3, 4]] - [x, 0, x, 0]) < 1e-4, axis=1))
    wrist = ends["link3"][:, [1, 4]].min()
    assert -0.43307 < wrist < -0.43307 + 0.06  # the forearm's last part ends just before the wrist's centre: d4
    m = mujoco.MjModel.from_xml_path(str(SCENE))
    floor = m.geom("floor")
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    others = [i for i in range(m.ngeom) if i != floor.id]
    lowest = min(d.geom_xpos[i, 2] - m.geom_rbound[i] for i in others if m.geom_bodyid[i] != 0)
    assert lowest > floor.pos[2]
    column = [i for i in others if m.geom_bodyid[i] == 0]
    assert min(d.geom_xpos[i, 2] - m.geom_size[i, 1] for i in column) == pytest.approx(floor.pos[2], abs=1e-6)


def test_two_cameras_see_the_whole_arm():
    """Overview and side show the tool and the elbow of 500 random poses of the first three joints in a square frame."""
    assert camera_names("puma560") == ("overview", "side")
    m = mujoco.MjModel.from_xml_path(str(SCENE))
    d = mujoco.MjData(m)
    rng = np.random.default_rng(0)
    for name in camera_names("puma560"):
        camera = m.camera(name)
        seen = 0
        for _ in range(500):
            d.qpos[:3] = rng.uniform(-1.5, 1.5, 3)
            mujoco.mj_kinematics(m, d)
            mujoco.mj_camlight(m, d)
            inside = (np.array([d.site("tool").xpos, d.body("link3").xpos]) - d.cam_xpos[camera.id]) @ d.cam_xmat[
                camera.id
            ].reshape(3, 3)
            seen += np.all(np.abs(inside[:, :2]) < -inside[:, 2:] * np.tan(np.deg2rad(camera.fovy[0]) / 2))
        assert seen >= 490  # the arm straight up or at the camera may leave the frame by a hand's breadth


COLUMN = """<mujoco><worldbody><geom type="box" size=".1 .1 {half}" pos="0 0 -{half}" contype="0" conaffinity="0"/>
<body><inertial mass="1" pos=".2 0 0" diaginertia=".01 .01 .01"/><joint name="a" axis="0 1 0"/><geom type="capsule"
fromto="0 0 0 .5 0 0" size=".02" contype="0" conaffinity="0"/><site name="tool" pos=".5 0 0"/></body></worldbody>
<actuator><motor joint="a" ctrlrange="-9 9"/></actuator></mujoco>"""


@pytest.mark.parametrize("aspect", [1.0, 1.8])
def test_of_a_tall_column_the_arm_keeps_most_of_the_picture(tmp_path, aspect):
    """A low one is seen whole; of a tall one STILL of the swept arm's larger side; what moves is always inside.

    One without colour, which nobody sees, changes nothing.
    """
    poses, tall = np.linspace(-0.3, 0.3, 5)[:, None], []
    clear = COLUMN.replace('type="box"', 'type="box" rgba="1 1 1 0"')
    for half, text in ((0.24, clear), (0.05, COLUMN), (0.24, COLUMN)):
        (tmp_path / "c.xml").write_text(text.format(half=half))
        scene = build_scene(tmp_path / "c.xml", poses)
        tall.append(window(scene, 1, poses, aspect))  # from the side
    arm, low, high = ((part[2], part[3]) for part in tall)
    assert low[0] < arm[0] + 1e-9
    assert high[1] - high[0] > arm[1] - arm[0]
    side = max(tall[0][1] - tall[0][0], arm[1] - arm[0]) / (1.0 + 2.0 * MARGIN)
    assert high[1] - high[0] <= (1.0 + 2.0 * MARGIN) * (1.0 + STILL) * side
    for left, right, bottom, top in tall:
        assert (right - left) / (top - bottom) == pytest.approx(aspect)
        d = mujoco.MjData(scene.model)
        for q in poses:
            d.qpos[:] = q
            mujoco.mj_forward(scene.model, d)
            x, y, z = (d.site_xpos[0] - d.cam_xpos[1]) @ d.cam_xmat[1].reshape(3, 3)
            assert left < -x / z < right
            assert bottom < -y / z < top


def test_an_arm_without_a_look_is_drawn_along_its_joints():
    """Two-link: a capsule from each joint to the next in every pose, a floor below it, and the usual cameras."""
    poses = np.array([[0.0, 0.0], [0.5, 0.5], [1.0, -0.5]])
    scene = build_scene("two-link", poses)
    m = scene.model
    d = mujoco.MjData(m)
    capsules = [i for i in scene.moving if m.geom_type[i] == mujoco.mjtGeom.mjGEOM_CAPSULE]
    assert len(capsules) == 2
    for q in poses:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        elbow = np.array([np.cos(q[0]), 0.0, -np.sin(q[0])])  # links of 1 and 0.8 m that turn about y
        tool = elbow + 0.8 * np.array([np.cos(q.sum()), 0.0, -np.sin(q.sum())])
        for i, (start, end) in zip(capsules, ((np.zeros(3), elbow), (elbow, tool)), strict=True):
            middle, axis, half = d.geom_xpos[i], d.geom_xmat[i].reshape(3, 3)[:, 2], m.geom_size[i, 1]
            found = sorted(
                (tuple(middle - half * axis), tuple(middle + half * axis)), key=lambda p: np.linalg.norm(p - start)
            )
            # the last one stops where its round end touches the tool
            short = 0.0 if i == capsules[0] else m.geom_size[i, 0]
            assert np.allclose(found[0], start, atol=1e-9)
            assert np.allclose(found[1], end - short * (end - start) / np.linalg.norm(end - start), atol=1e-9)
    assert tuple(m.camera(i).name for i in range(m.ncam)) == CAMERAS
    floor = m.geom_pos[m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE][0, 2]
    assert floor < -np.sin(1.0) - 0.8 * np.sin(0.5)  # the lowest the tool gets in these poses


OWN_LOOK = """<mujoco><option><flag contact="disable"/></option><worldbody>
<light name="own" pos="0 0 3"/><camera name="mine" pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>
<body name="bar"><inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.01 0.01"/><joint name="turn" axis="0 1 0"/>
<geom name="stick" type="box" size="0.2 0.02 0.02" pos="0.2 0 0"/><site name="tool" pos="0.4 0 0"/></body></worldbody>
<actuator><motor joint="turn" ctrllimited="true" ctrlrange="-5 5"/></actuator></mujoco>"""


def test_a_users_own_geoms_lights_and_cameras_are_kept(tmp_path):
    """An MJCF with geoms, a light and a camera is shown with these; only a floor and a sky are added."""
    path = tmp_path / "bar.xml"
    path.write_text(OWN_LOOK)
    assert camera_names(str(path)) == ("mine",)
    scene = build_scene(str(path), np.zeros((1, 1)))
    m = scene.model
    assert [m.geom(i).name for i in scene.moving] == ["stick"]
    assert (m.ncam, m.nlight) == (1, 1)
    assert np.count_nonzero(m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) == 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name="turn"', 'name="twist"', "its joints are not those of the arm"),
        ('pos="0.4 0 0"', 'pos="0.5 0 0"', "it shows another arm"),
        ('axis="0 1 0"', 'axis="0 0 1"', "it shows another arm"),
        ("</worldbody>", "</world>", "cannot be drawn"),
    ],
)
def test_a_look_of_another_arm_is_refused(tmp_path, old, new, said):
    """A scene.xml whose joints, tool or axes differ from the arm's would show another motion than the one run."""
    (tmp_path / "bar.xml").write_text(OWN_LOOK)
    (tmp_path / "scene.xml").write_text(OWN_LOOK.replace(old, new))
    if new == 'name="twist"':
        (tmp_path / "scene.xml").write_text(OWN_LOOK.replace("turn", "twist"))
    with pytest.raises(ModelError, match=said):
        build_scene(str(tmp_path / "bar.xml"), np.zeros((1, 1)))


def test_the_scenes_arm_is_the_analytic_one():
    """The tool of the scene is where the analytic PUMA, which reads neither XML, has it, to 1e-12 m."""
    m = mujoco.MjModel.from_xml_path(str(SCENE))
    d = mujoco.MjData(m)
    rng = np.random.default_rng(1)
    for q in rng.uniform(-2, 2, (20, 6)):
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        assert np.allclose(d.site("tool").xpos, Puma560("exact", "fitted").forward_kinematics(q)[:3, 3], atol=1e-12)
