"""Surfaces are closed, face outwards, enclose the volume that they must, and stand where the arm's geoms are."""

import collections

import mujoco
import numpy as np
import pytest

from torquebench.robot.puma560.puma import Puma560
from torquebench.scene import shapes
from torquebench.scene.arm import body_of, read_arm
from torquebench.scene.look import build_scene

N = shapes.SIDES
PRISM = N / 2.0 * np.sin(2.0 * np.pi / N) / np.pi
"""Area of the regular N-gon over that of its circle."""


def volume(shape):
    """Volume by the divergence theorem: a sixth of the sum of a . (b x c) over the triangles."""
    a, b, c = np.moveaxis(shape.corners, 1, 0)
    return float(np.sum(a * np.cross(b, c)) / 6.0)


CASES = {
    "box": (shapes.box(np.array([0.1, 0.2, 0.3])), 8 * 0.1 * 0.2 * 0.3, 1.0),
    "cylinder": (shapes.cylinder(0.2, 0.3), np.pi * 0.2**2 * 0.6 * PRISM, 1.0),
    "sphere": (shapes.capsule(0.2, 0.0), 4 / 3 * np.pi * 0.2**3, 0.95),
    "capsule": (shapes.capsule(0.2, 0.3), 4 / 3 * np.pi * 0.2**3 + np.pi * 0.2**2 * 0.6, 0.95),
    "ellipsoid": (shapes.ellipsoid(np.array([0.1, 0.2, 0.3])), 4 / 3 * np.pi * 0.1 * 0.2 * 0.3, 0.95),
}
"""Shape, volume in closed form, and how much of it at least is enclosed: round ones are drawn inscribed."""


@pytest.mark.parametrize("name", CASES)
def test_volume(name):
    """Prisms to round-off; balls, inscribed, between 95 % of the volume and all of it. Inside out it is negative."""
    shape, exact, least = CASES[name]
    assert exact * least * (1 - 1e-12) <= volume(shape) <= exact * (1 + 1e-12)


@pytest.mark.parametrize("name", CASES)
def test_closed(name):
    """Each edge is run through once in each direction: no gap, no face twice."""
    shape = CASES[name][0]
    edges = collections.Counter()
    for triangle in np.round(shape.corners, 9) + 0.0:
        points = [tuple(p) for p in triangle]
        edges.update(zip(points, points[1:] + points[:1], strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


@pytest.mark.parametrize("name", CASES)
def test_normals(name):
    """Unit vectors, within 30 degrees of the triangle's own outward normal: a side is 360 / 24 = 15 degrees wide."""
    shape = CASES[name][0]
    own = shapes.areas(shape.corners)
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    assert np.allclose(np.linalg.norm(shape.normals, axis=2), 1.0, atol=1e-12)
    assert np.min(np.einsum("tcx,tx->tc", shape.normals, own)) > np.cos(np.deg2rad(30.0))


def distance(kind, size, point):
    """Signed distance of points in a geom's own frame from its surface, for the kinds that the PUMA's look has."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        d = np.abs(point) - size
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        d = np.stack([np.hypot(point[:, 0], point[:, 1]) - size[0], np.abs(point[:, 2]) - size[1]], axis=1)
    else:
        assert kind == mujoco.mjtGeom.mjGEOM_SPHERE
        d = np.linalg.norm(point, axis=1, keepdims=True) - size[0]
    return np.linalg.norm(np.maximum(d, 0.0), axis=1) + np.minimum(np.max(d, axis=1), 0.0)


def test_triangles_stand_where_the_geoms_are():
    """At a pose of all joints every corner, moved with its body as MuJoCo moves it, lies on a geom, within 1 nm.

    Where geoms are is MuJoCo's own ``geom_xpos``.
    """
    q = np.array([0.3, -0.8, 0.6, 1.1, -0.7, 0.4])
    scene = build_scene("puma560", q[None])
    arm, m = read_arm(scene), scene.model
    d = mujoco.MjData(m)
    d.qpos[:] = q
    mujoco.mj_kinematics(m, d)
    seen = [g for g in range(m.ngeom) if m.geom_group[g] <= 2 and m.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    assert sum(body.moves and bool(body.parts) for body in arm.bodies) == 6
    assert sum(len(body.parts) for body in arm.bodies) == len(seen)
    for body, matrix, place in zip(arm.bodies, d.xmat, d.xpos, strict=True):
        for part in body.parts:
            corners = part.surface.corners.reshape(-1, 3) @ matrix.reshape(3, 3).T + place
            nearest = np.full(len(corners), np.inf)
            for g in seen:
                local = (corners - d.geom_xpos[g]) @ d.geom_xmat[g].reshape(3, 3)
                nearest = np.minimum(nearest, np.abs(distance(m.geom_type[g], m.geom_size[g], local)))
            assert np.max(nearest) < 1e-9
            own = shapes.areas(part.surface.corners)
            own /= np.linalg.norm(own, axis=1, keepdims=True)
            assert np.min(np.einsum("tcx,tx->tc", part.surface.normals, own)) > np.cos(np.deg2rad(30.0))
    carrier, offset = arm.tool
    tool = d.xmat[carrier].reshape(3, 3) @ offset + d.xpos[carrier]
    assert np.max(np.abs(tool - Puma560("exact", "fitted").forward_kinematics(q)[:3, 3])) < 1e-9


MOVED = """<mujoco><worldbody>
<body pos="0.1 0.2 0.3" quat="0.8 0.2 0.4 0.4"><joint name="a" type="hinge" axis="0 1 1" pos="0.05 0 0.02"/>
<geom size="0.05"/><body pos="0.3 0 0" quat="0.6 0 0.8 0"><joint name="b" type="slide" axis="1 0 2" ref="0.1"/>
<joint name="c" type="hinge" axis="1 0 0" pos="0 0.1 0" ref="-0.2"/><geom size="0.05"/>
<body pos="0 0.1 0.2"><geom size="0.02"/></body></body></body></worldbody></mujoco>"""
"""Turned bodies, joints off the bodies' origins, two joints in one body, positions that count from elsewhere."""


def matrix_about(axis, angle):
    """Rotation by Rodrigues' formula."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def test_joints_move_the_bodies_as_mujoco_does():
    """Bodies placed by parent, place, turn and joints in order, as `Body` says, are where MuJoCo's kinematics has them.

    Within 1e-12 m: both add a dozen numbers of order 1.
    """
    m = mujoco.MjModel.from_xml_string(MOVED)
    d, q = mujoco.MjData(m), np.array([0.7, 0.25, -1.1])
    d.qpos[:] = q
    mujoco.mj_kinematics(m, d)
    frames = []
    for number in range(m.nbody):
        own = body_of(m, number)
        turn, place = np.empty(9), own.place
        mujoco.mju_quat2Mat(turn, own.turn)
        turn = turn.reshape(3, 3)
        if number:
            above, origin = frames[own.parent]
            turn, place = above @ turn, above @ place + origin
        for joint in own.joints:
            by = q[joint.of_q] - joint.zero
            if joint.slides:
                place = place + turn @ joint.axis * by
            else:
                turned = turn @ matrix_about(joint.axis, by)
                place = place + turn @ joint.place - turned @ joint.place
                turn = turned
        frames.append((turn, place))
        assert np.max(np.abs(turn - d.xmat[number].reshape(3, 3))) < 1e-12
        assert np.max(np.abs(place - d.xpos[number])) < 1e-12


def test_an_arm_without_a_look_can_be_drawn():
    """two-link has neither geoms nor cameras: links, joints, a floor and a view are made."""
    scene = build_scene("two-link", np.zeros((1, 2)))
    arm = read_arm(scene)
    assert sum(body.moves and bool(body.parts) for body in arm.bodies) == 2
    assert arm.floor < -0.1
    assert np.linalg.norm(arm.view.eye - arm.view.target) > scene.reach


def test_long_links_without_a_shape_are_drawn(tmp_path):
    """Of an arm with shapes on some links, one without gets a capsule where it is long; others stay as they are."""
    inertial = '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    inside = f'<body pos="0.01 0 0"><joint/>{inertial}<site name="tool" pos="0.5 0 0"/></body>'
    middle = f'<body pos="0.4 0 0"><joint/>{inertial}{inside}</body>'
    box = '<geom type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0"/>'
    path = tmp_path / "arm.xml"
    path.write_text(
        f"<mujoco><worldbody><body><joint/>{inertial}{box}{middle}</body></worldbody><actuator/></mujoco>".replace(
            "<joint/>", '<joint axis="0 1 0" actuatorfrcrange="-9 9"/>'
        )
    )
    scene = build_scene(path, np.zeros((1, 3)))
    kinds = [scene.model.geom_type[scene.model.geom_bodyid == body].tolist() for body in (1, 2, 3)]
    capsule, drum, cube = (
        int(kind) for kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_BOX)
    )
    assert kinds == [[cube], [], [capsule, drum]]
