"""The arm's look and cameras: from its ``scene.xml``, or made along its kinematics; the simulation never sees them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.library import CAMERAS, ArmSource, has_imported_looks, scene_path
from torquebench.robot.mjcf import compile_arm, joint_names, read_arm, tool_frame, torque_limits
from torquebench.sim.trajectory import Trajectory

FIELD_OF_VIEW = 32.0
"""Vertical field of view of the cameras made here [deg]."""
FLAT = 0.02
"""An arm that leaves its plane by less than this fraction of its size is seen from across that plane."""
MARGIN = 0.04
"""Space that a film leaves on each side of the arm, as a fraction of what the arm takes."""
STILL = 0.6
"""Part of a column or base that is shown beyond the moving parts, as a fraction of their larger side."""
LONG = 0.1
"""Links without a shape are drawn beside links that have one if they are so long, over the arm's length."""
VISIBLE_GROUPS = 2
"""Geoms of higher groups are hidden by the arm's files."""
MOST_DRAWN = 1.0
"""An exaggerated error is drawn no larger than this [rad, or m where a joint slides]."""
POSES = 100
"""Poses of each run from which a camera is placed if the arm's files have none."""
SHELL, DARK = (0.96, 0.94, 0.88, 1.0), (0.17, 0.18, 0.20, 1.0)
_UNSEEN: dict[str, Any] = {"contype": 0, "conaffinity": 0, "mass": 0.0, "group": 2}
_SAME = 1e-9  # m; poses of the two files of one arm agree to rounding


class Scene(NamedTuple):
    """An arm ready to be drawn."""

    model: Any
    """Compiled ``MjModel`` with geoms, lights and cameras."""
    moving: tuple[int, ...]
    """Visible geoms that move with a joint."""
    reach: float
    """Length of the stretched arm [m]."""
    joints: Sequence[str]
    """Names of the joints."""
    unit: str
    """Unit of the joints' positions: ``rad``, ``m`` or ``m or rad``."""
    limits: Array
    """Torque limits, (n,) [N m]."""


def build_scene(source: ArmSource, poses: Array, bare: bool = False) -> Scene:
    """Make the scene of an arm.

    Args:
        source: Name of the arm, its file, or one that was read.
        poses: Joint positions that cameras made here must show, (N, n) [rad].
        bare: Whether the arm's ``scene.xml`` is left out, so that its own file alone says how it looks.

    Raises:
        ModelError: the arm cannot be read, or its ``scene.xml`` shows another arm.
    """
    arm, look = compile_arm(source).model, None if bare else scene_path(source)
    reach = max(float(np.sum(np.linalg.norm(np.diff(joint_chain(arm), axis=0), axis=1))), 1e-3)
    try:
        spec = mujoco.MjSpec.from_file(str(look)) if look else mujoco.MjSpec.from_string(read_arm(source).text)
        spec.compiler.discardvisual = False  # which a URDF's is: what is drawn here would go
        check_same_arm(arm, spec.compile(), str(look))
        dress(spec, arm, poses, reach, own=look is None or has_imported_looks(look))
        m = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        if look and has_imported_looks(look):
            return build_scene(source, poses, bare=True)  # the meshes are no longer where they were
        raise ModelError(f"{look or source}: cannot be drawn: {' '.join(str(error).split())}") from error
    visible = np.flatnonzero(m.geom_group <= VISIBLE_GROUPS)
    moving = tuple(int(g) for g in visible if m.body_weldid[m.geom_bodyid[g]] != 0)
    kinds = ("m" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "rad" for kind in arm.jnt_type)
    return Scene(m, moving, reach, joint_names(arm), " or ".join(dict.fromkeys(kinds)), torque_limits(arm)[0])


def scene_of_runs(source: ArmSource, runs: Sequence[Trajectory], bare: bool = False) -> Scene:
    """Make the scene of an arm whose cameras show these runs and their references; the rest as for `build_scene`."""
    poses = [x[:: max(1, len(x) // POSES)] for run in runs for x in (run.q, run.q_ref)]
    return build_scene(source, np.nan_to_num(np.concatenate(poses)), bare)


def shown_poses(run: Trajectory, exaggerate: float = 1.0) -> Array:
    """Return a run's positions (N, n) [rad]; from where they are no numbers the last one that is one stays.

    Args:
        run: The run.
        exaggerate: How many times as far from the reference they are shown, but no further than `MOST_DRAWN`.
    """
    last = np.max(np.flatnonzero(np.isfinite(run.q).all(axis=1)), initial=0)
    poses: Array = np.nan_to_num(run.q[np.minimum(np.arange(len(run.q)), last)])
    error = poses - run.q_ref
    most = np.maximum(MOST_DRAWN - np.abs(error), 0.0)
    return poses + np.clip((exaggerate - 1.0) * error, -most, most)


def check_same_arm(arm: Any, look: Any, where: str) -> None:
    """Refuse a look whose joints are not the arm's, or whose tool is elsewhere.

    Args:
        arm: The arm, compiled.
        look: Its look, compiled.
        where: File of the look, for messages.

    Raises:
        ModelError: it would show another motion than the one that was run.
    """
    if joint_names(arm) != joint_names(look):
        raise ModelError(f"{where}: its joints are not those of the arm ({', '.join(joint_names(arm))})")
    poses = np.repeat([[0.0], [0.5], [-1.0]], arm.nq, axis=1)
    if np.max(np.abs(tool_path(arm, poses) - tool_path(look, poses))) > _SAME:
        raise ModelError(f"{where}: its tool is not where the arm's is; it shows another arm")


def dress(spec: Any, arm: Any, poses: Array, reach: float, own: bool = False) -> None:
    """Add what a scene lacks: links, a floor, lights, a sky, and cameras that see every pose.

    Args:
        spec: The arm's ``MjSpec``; changed in place.
        arm: The arm, compiled.
        poses: Joint positions that the cameras must show, (N, n) [rad].
        reach: Length of the stretched arm [m].
        own: Whether its bodies are the arm's, so that long links without a shape can be told.
    """
    points = joint_points(arm, poses)
    low, high = points.min(axis=0), points.max(axis=0)
    visible = [g for g in spec.geoms if g.group <= VISIBLE_GROUPS]
    if not visible or own:
        add_links(spec, arm, reach, LONG if visible else 0.0)
    if not any(g.type == mujoco.mjtGeom.mjGEOM_PLANE for g in visible):
        ground = min(float(low[2]), float(joint_chain(arm)[0, 2])) - 0.12 * reach
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 0.1],
            pos=[0, 0, ground],
            material=add_tiles(spec, reach),
            **_UNSEEN,
        )
    if not list(spec.lights):
        for towards, shade, shadow in (([0.35, -0.45, -1.0], 0.45, True), ([-0.7, -0.6, -0.4], 0.19, False)):
            spec.worldbody.add_light(
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                pos=(low + high) / 2.0 - 2.0 * reach * np.array(towards),
                dir=towards,
                diffuse=[shade] * 3,
                castshadow=shadow,
            )
        spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.42, 0.42, 0.44], [0.2, 0.2, 0.2]
        spec.visual.map.shadowclip = 2.0
    if not any(t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for t in spec.textures):
        spec.add_texture(
            name="torquebench-sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.86, 0.90, 0.95],
            rgb2=[0.95, 0.96, 0.97],
            width=64,
            height=384,
        )
        spec.visual.rgba.haze = [0.95, 0.96, 0.97, 1]
    if not list(spec.cameras):
        add_cameras(spec, points, reach)
        spec.stat.extent, spec.stat.center = 1.2 * reach, (low + high) / 2.0


def joint_points(arm: Any, poses: Array) -> Array:
    """Return where joints and tool of a compiled arm are at each of the poses (N, n) [rad], (N (n + 1), 3) [m]."""
    d = mujoco.MjData(arm)
    points = []
    for q in poses:
        d.qpos[:] = q
        mujoco.mj_kinematics(arm, d)
        points += [*d.xanchor.copy(), tool_frame(arm, d, "arm")[1].copy()]
    return np.array(points)


def tool_path(arm: Any, poses: Array) -> Array:
    """Return where the tool is at each pose, (N, 3) [m]; arguments as for `joint_points`."""
    return joint_points(arm, poses)[arm.njnt :: arm.njnt + 1]


def joint_chain(arm: Any) -> Array:
    """Return where joints and tool are at zero position, (n + 1, 3) [m]."""
    return joint_points(arm, np.zeros((1, arm.nq)))


def add_tiles(spec: Any, reach: float) -> str:
    """Add the material of a tiled floor and return its name.

    Args:
        spec: The arm's ``MjSpec``; changed in place.
        reach: Length of the stretched arm [m]; a tile is a little more than a third as wide.
    """
    name = "torquebench-tiles"
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.90, 0.91, 0.92],
        rgb2=[0.86, 0.87, 0.885],
        width=128,
        height=128,
    )
    material = spec.add_material(name=name, texrepeat=[2.5 / reach, 2.5 / reach], texuniform=True, specular=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def add_links(spec: Any, arm: Any, reach: float, least: float = 0.0) -> None:
    """Draw each link without a shape as a capsule from its joint to the next, and its joint as a drum about its axis.

    Args:
        spec: The arm's ``MjSpec``; changed in place.
        arm: The arm, compiled.
        reach: Length of the stretched arm [m].
        least: Length of the links that are drawn, over `reach`.
    """
    chain, d = joint_chain(arm), mujoco.MjData(arm)
    mujoco.mj_kinematics(arm, d)
    bodies = list(spec.bodies)  # in the order of the compiled model
    shown = {int(arm.body_weldid[i]) for i, b in enumerate(bodies) if any(g.group <= VISIBLE_GROUPS for g in b.geoms)}
    for j in range(arm.njnt):
        index = int(arm.jnt_bodyid[j])
        if index in shown or np.linalg.norm(chain[j + 1] - chain[j]) < least * reach:
            continue
        body = bodies[index]
        turn, origin = d.xmat[index].reshape(3, 3), d.xpos[index]
        start, end = turn.T @ (chain[j] - origin), turn.T @ (chain[j + 1] - origin)
        radius = 0.032 * reach * (1.0 - 0.45 * j / arm.njnt)
        length = float(np.linalg.norm(end - start))
        if j == arm.njnt - 1 and length > 3.0 * radius:
            end = end + (start - end) * radius / length  # its round end touches the tool
        if length > 1e-3 * reach:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[radius, 0, 0], rgba=SHELL, **_UNSEEN
            )
        axis = 1.25 * radius * arm.jnt_axis[j]
        hinge = arm.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER if hinge else mujoco.mjtGeom.mjGEOM_BOX
        size = [1.3 * radius, 0, 0] if hinge else [1.2 * radius, 1.2 * radius, 0]
        body.add_geom(type=kind, fromto=[*(start - axis), *(start + axis)], size=size, rgba=DARK, **_UNSEEN)


def add_cameras(spec: Any, points: Array, reach: float) -> None:
    """Add the cameras named in `CAMERAS`, far enough away to see all points in a square picture.

    Args:
        spec: The arm's ``MjSpec``; changed in place.
        points: What must be seen, (N, 3) [m].
        reach: Length of the stretched arm [m].
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius = float(np.max(np.linalg.norm(points - centre, axis=1))) + 0.1 * reach
    side = np.array([0.0, 1.0, 0.0])
    _, size, axes = np.linalg.svd(points - centre, full_matrices=False)
    if size[2] < FLAT * size[0] and abs(axes[2][2]) < 0.7:
        side = axes[2] * (1.0 if axes[2][1] + 1e-6 * axes[2][0] >= 0.0 else -1.0)
    across = np.cross(side, [0.0, 0.0, 1.0])
    distance = radius / np.sin(np.deg2rad(FIELD_OF_VIEW) / 2.0)
    for name, direction in zip(CAMERAS, (side - 0.5 * across + [0, 0, 0.3], side + [0, 0, 0.02]), strict=True):
        back = direction / np.linalg.norm(direction)
        right = np.cross([0.0, 0.0, 1.0], back)
        camera = spec.worldbody.add_camera(name=name, pos=centre + distance * back, fovy=FIELD_OF_VIEW)
        camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
        camera.alt.xyaxes = [*right, *np.cross(back, right)]


def window(scene: Scene, camera: int, poses: Array, aspect: float) -> Array:
    """Return which part of a camera's picture shows the arm at all poses: left, right, bottom and top.

    These are slopes, tangents of the angle to the camera's axis. Of what stands still and is smaller than the arm, its
    column say, so much is shown that what moves takes the most of the picture: `STILL` of its larger side beyond it.

    Args:
        scene: The arm.
        camera: Number of the camera.
        poses: Joint positions, (N, n) [rad].
        aspect: Width of the part over its height.
    """
    m, d, slopes = scene.model, mujoco.MjData(scene.model), []
    still = (m.geom_group <= VISIBLE_GROUPS) & (m.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (m.geom_rgba[:, 3] > 0.0)
    small = np.flatnonzero(still & (m.geom_rbound < scene.reach))
    seen = [*scene.moving, *(int(g) for g in small if g not in scene.moving)]
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    boxes = m.geom_aabb[seen, None, :3] + corners * m.geom_aabb[seen, None, 3:]
    for q in poses:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        mujoco.mj_camlight(m, d)
        turned = boxes @ d.geom_xmat[seen].reshape(-1, 3, 3).transpose(0, 2, 1)
        points = (d.geom_xpos[seen, None] + turned - d.cam_xpos[camera]).reshape(-1, 3) @ d.cam_xmat[camera].reshape(
            3, 3
        )
        slopes.append(points[:, :2] / np.maximum(-points[:, 2:], 0.1 * scene.reach))
    lows, highs = np.min(slopes, axis=0), np.max(slopes, axis=0)
    own = len(corners) * (len(scene.moving) or len(seen))
    low, high = np.min(lows[:own], axis=0), np.max(highs[:own], axis=0)
    beyond = STILL * np.max(high - low)
    low = np.maximum(np.min(lows, axis=0), low - beyond)
    high = np.minimum(np.max(highs, axis=0), high + beyond)
    half = (0.5 + MARGIN) * max((high[0] - low[0]) / aspect, high[1] - low[1]) * np.array([aspect, 1.0])
    middle = (low + high) / 2.0
    return np.stack([middle - half, middle + half], axis=1).ravel()
