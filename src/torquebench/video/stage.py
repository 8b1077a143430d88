"""Pictures of the arm, its reference as a ghost and the tool's trail: with OpenGL, or as a stick figure without it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from torquebench.kernel import Array
from torquebench.scene.look import VISIBLE_GROUPS, Scene, joint_points
from torquebench.video.paint import FINE

GHOST = np.array([0.30, 0.60, 0.95, 1.0], dtype=np.float32)
GROWN = 0.008
"""Width by which the ghost stands out, over the stretched arm's length: a thin edge around an arm that follows."""
BEHIND = 1.08
"""The ghost is drawn this many times as far from the camera, and as large: the arm hides it where both are."""
TRAIL, PALE = np.array([0.86, 0.32, 0.05]), np.array([0.97, 0.82, 0.70])
"""Colours of the tool's path, where it is now and where it was."""
TRAIL_SIZE = 0.004
"""Half its width, as a fraction of the stretched arm."""
WANTED_SIZE = 0.0025
"""That of the path which the tool should follow."""
TOOL = np.array([0.90, 0.0, 0.45, 1.0], dtype=np.float32)
TOOL_SIZE = 0.014
"""Radius of the ball that marks the tool, as a fraction of the stretched arm."""
STICK_BACKGROUND, STICK_GROUND, STICK_ARM, STICK_GHOST = "#f2f5f8", "#d5d9de", "#2b3039", "#afd0f3"
STICK_TRAIL, STICK_TOOL, STICK_WANTED = "#db520d", "#e60073", "#4d99f2"
NOWHERE: Array = np.empty((0, 3))
_GROUND = 5
"""Group of planes here; nothing else that can be seen is of a group above `VISIBLE_GROUPS`."""
_FLAGS, _KIND = mujoco.mjtRndFlag, mujoco.mjtGeom


def add_trail(view: Any, points: Array, reach: float, line: Any = _KIND.mjGEOM_CAPSULE, *, fading: bool = True) -> None:
    """Add the tool's path and a ball at its end to a scene of MuJoCo.

    Args:
        view: The ``MjvScene``.
        points: The path, (K, 3) [m].
        reach: Length of the stretched arm [m].
        line: Kind of the geoms that it is made of.
        fading: Whether it is paler where the tool was earlier.
    """
    fresh = np.arange(1, len(points))[:, None] / len(points) if fading else np.ones((len(points), 1))
    _add_lines(view, points, fresh * TRAIL + (1.0 - fresh) * PALE, TRAIL_SIZE * reach, line)
    geom, size = _next_geom(view), np.full(3, TOOL_SIZE * reach)
    mujoco.mjv_initGeom(geom, _KIND.mjGEOM_SPHERE, size, points[-1], np.eye(3).ravel(), TOOL)
    geom.emission = 0.6


def add_wanted(view: Any, points: Array, reach: float, line: Any = _KIND.mjGEOM_CAPSULE) -> None:
    """Add the path that the tool should follow to a scene of MuJoCo; arguments as for `add_trail`."""
    _add_lines(view, points, np.tile(GHOST[:3], (len(points), 1)), WANTED_SIZE * reach, line)


def _add_lines(view: Any, points: Array, colours: Array, size: float, line: Any) -> None:
    nothing = np.zeros(3), np.zeros(3), np.zeros(9)
    for i in range(1, len(points)):
        geom = _next_geom(view)
        mujoco.mjv_initGeom(geom, line, *nothing, np.array([*colours[i - 1], 1.0], dtype=np.float32))
        mujoco.mjv_connector(geom, line, size, points[i - 1], points[i])
        geom.emission = 0.5


def add_ghost(
    view: Any, scene: Scene, d: Any, *, grown: float = GROWN, alpha: float = 1.0, eye: Array | None = None
) -> None:
    """Add the arm's moving geoms as a ghost to a scene of MuJoCo.

    Args:
        view: The ``MjvScene``.
        scene: The arm.
        d: Its ``MjData`` at the ghost's pose.
        grown: How much larger than the arm's its geoms are, as a fraction of the stretched arm.
        alpha: How much the ghost hides.
        eye: Place of the camera that is to see it behind the arm, (3,) [m]; None: it is in its own place.
    """
    m, far, centre = scene.model, 1.0 if eye is None else BEHIND, np.zeros(3) if eye is None else eye
    for i in scene.moving:
        geom, kind = _next_geom(view), m.geom_type[i]
        size = far * np.maximum(m.geom_size[i] + grown * scene.reach, 0.2 * m.geom_size[i])
        place = centre + far * (d.geom_xpos[i] - centre)
        mujoco.mjv_initGeom(geom, kind, size, place, d.geom_xmat[i], np.array([*GHOST[:3], alpha], np.float32))
        if kind == _KIND.mjGEOM_MESH:
            geom.dataid = 2 * int(m.geom_dataid[i])
        geom.emission = 0.35


def _next_geom(view: Any) -> Any:
    geom = view.geoms[view.ngeom]
    view.ngeom += 1
    return geom


class OpenGlStage:
    """Draws an arm at many poses with MuJoCo's renderer.

    ``fast`` draws floor and sky once and only the arm anew; ``pretty`` draws everything, with shadows.

    Args:
        scene: The arm.
        size: Width and height of the view [px]; pictures are `FINE` times as large.
        camera: Number of the camera.
        part: Part of the camera's picture that is shown, as `scene.window` returns it.
        quality: As in a config.
        trail: Most points a trail can have.
        wanted: Path that the tool should follow, (K, 3) [m]; none if left out.
    """

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int],
        camera: int,
        part: Array,
        quality: str,
        trail: int,
        wanted: Array = NOWHERE,
    ) -> None:
        self._arm, self._part, self._wanted, m = scene, part, wanted, scene.model
        self._layered = quality == "fast"
        wide, high = FINE * size[0], FINE * size[1]
        m.vis.global_.offwidth, m.vis.global_.offheight = wide, high
        m.vis.global_.linewidth = 1.6 * FINE * max(1.0, size[1] / 320.0)
        m.vis.quality.offsamples = 0
        if self._layered:
            m.vis.quality.numslices, m.vis.quality.numstacks, m.vis.quality.numquads = 24, 6, 1
        visible = m.geom_group <= VISIBLE_GROUPS
        m.geom_group[~visible] = VISIBLE_GROUPS + 1
        m.geom_group[visible & (m.geom_type == _KIND.mjGEOM_PLANE)] = _GROUND
        self._context = mujoco.GLContext(wide, high)
        self._context.make_current()
        self._gl = mujoco.MjrContext(m, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._gl)
        self._frame = mujoco.MjrRect(0, 0, wide, high)
        self._view = mujoco.MjvScene(m, maxgeom=2 * m.ngeom + trail + len(wanted) + 8)
        self._options, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        self._data, self._reference = mujoco.MjData(m), mujoco.MjData(m)
        self._pixels, self._depth = np.empty((high, wide, 3), np.uint8), np.empty((high, wide), np.float32)
        self._backdrop: Image.Image | None = None
        if self._layered:
            self._pose(self._data, np.zeros(m.nq))
            self._update(surroundings=True, what=mujoco.mjtCatBit.mjCAT_STATIC)
            self._backdrop = self._render()

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Image.Image:
        """Draw one picture.

        Args:
            q: Joint positions of the arm, (n,) [rad].
            q_ref: Those of its reference, (n,) [rad].
            trail: Path of the tool, (K, 3) [m].
        """
        self._pose(self._data, q)
        self._pose(self._reference, q_ref)
        self._update(surroundings=not self._layered)
        # with shadows every light adds its share to a line, up to white
        line = _KIND.mjGEOM_LINE if self._layered else _KIND.mjGEOM_CAPSULE
        add_wanted(self._view, self._wanted, self._arm.reach, line)
        add_trail(self._view, trail, self._arm.reach, line, fading=not len(self._wanted))
        solid = self._render()
        eye = (self._view.camera[0].pos + self._view.camera[1].pos) / 2.0
        add_ghost(self._view, self._arm, self._reference, eye=eye)
        # the ghost is in one of two pictures: translucent, without showing its own inside
        both = Image.blend(solid, self._render(), 0.5)
        return both.transpose(Image.Transpose.FLIP_TOP_BOTTOM)  # OpenGL's rows run upwards

    def _pose(self, d: Any, q: Array) -> None:
        d.qpos[:] = q
        mujoco.mj_kinematics(self._arm.model, d)
        mujoco.mj_camlight(self._arm.model, d)

    def _update(self, surroundings: bool, what: Any = mujoco.mjtCatBit.mjCAT_ALL) -> None:
        self._options.geomgroup[_GROUND] = surroundings
        mujoco.mjv_updateScene(self._arm.model, self._data, self._options, None, self._camera, int(what), self._view)
        for camera in self._view.camera:
            left, right, camera.frustum_bottom, camera.frustum_top = camera.frustum_near * self._part
            camera.frustum_center, camera.frustum_width = (left + right) / 2.0, (right - left) / 2.0
        flags = self._view.flags
        flags[_FLAGS.mjRND_SHADOW] = not self._layered
        flags[_FLAGS.mjRND_REFLECTION] = False
        flags[_FLAGS.mjRND_SKYBOX] = flags[_FLAGS.mjRND_HAZE] = surroundings

    def _render(self) -> Image.Image:
        """Render the scene, in front of the backdrop if there is one."""
        mujoco.mjr_render(self._frame, self._view, self._gl)
        mujoco.mjr_readPixels(self._pixels, self._depth, self._frame, self._gl)
        picture = Image.fromarray(self._pixels)
        if self._backdrop is None:
            return picture
        return Image.composite(picture, self._backdrop, Image.fromarray(self._depth < 1.0).convert("L"))


class StickStage:
    """Draws an arm at many poses as lines from joint to joint; needs neither OpenGL nor a display.

    Args:
        scene: The arm.
        size: Width and height of the view [px]; pictures are `FINE` times as large.
        camera: Number of the camera.
        part: Part of the camera's picture that is shown, as `scene.window` returns it.
        wanted: Path that the tool should follow, (K, 3) [m]; none if left out.
    """

    def __init__(self, scene: Scene, size: tuple[int, int], camera: int, part: Array, wanted: Array = NOWHERE) -> None:
        self._m, self._wanted = scene.model, wanted
        m = self._m
        self._wide, self._high = FINE * size[0], FINE * size[1]
        d = mujoco.MjData(m)
        mujoco.mj_kinematics(m, d)
        mujoco.mj_camlight(m, d)
        self._eye, self._axes = d.cam_xpos[camera], d.cam_xmat[camera].reshape(3, 3)
        self._left, _, bottom, self._top = part.tolist()
        self._scale = self._high / (self._top - bottom)
        self._thick = FINE * max(1.0, min(size) / 320.0)
        self._paper = Image.new("RGB", (self._wide, self._high), STICK_BACKGROUND)
        planes = m.geom_type == _KIND.mjGEOM_PLANE
        floor = float(m.geom_pos[planes, 2][0])
        mounted = np.any((m.body_weldid[m.geom_bodyid] == 0) & ~planes)  # something stands on the floor
        self._base = np.array([[0.0, 0.0, floor if mounted else 0.0]])
        half = 1.3 * scene.reach
        along = np.linspace(-half, half, 40)
        for x in np.linspace(-half, half, 9):
            line = np.stack([np.full_like(along, x), along, np.full_like(along, floor)], axis=1)
            self._draw_line(self._paper, line, STICK_GROUND, 1.0)
            self._draw_line(self._paper, line[:, [1, 0, 2]], STICK_GROUND, 1.0)

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Image.Image:
        """Draw one picture; arguments as for `OpenGlStage.draw`."""
        picture = self._paper.copy()
        arm, ghost = (np.concatenate([self._base, joint_points(self._m, pose[None])]) for pose in (q, q_ref))
        self._draw_line(picture, ghost, STICK_GHOST, 12.5, dots=12.5)
        self._draw_line(picture, arm, STICK_ARM, 4.4, dots=7.6)
        if len(self._wanted):
            self._draw_line(picture, self._wanted, STICK_WANTED, 2.6)
        self._draw_line(picture, trail, STICK_TRAIL, 1.7)
        self._draw_line(picture, arm[-1:], STICK_TOOL, 0.0, dots=8.4)
        return picture

    def _draw_line(self, picture: Image.Image, points: Array, colour: str, width: float, dots: float = 0.0) -> None:
        """Draw a line through points of the world, (K, 3) [m]; those behind the camera are left out.

        Args:
            picture: Where; changed.
            points: The points.
            colour: As CSS writes it.
            width: Of the line, in pixels of a small picture.
            dots: Diameter of the dots at the points, the same.
        """
        right, up, back = ((points - self._eye) @ self._axes).T
        away = np.where(back < 0.0, -back, np.nan)
        seen = self._scale * np.stack([right / away - self._left, self._top - up / away], axis=1)[back < 0.0]
        pixels = [tuple(point) for point in seen.tolist()]
        draw = ImageDraw.Draw(picture)
        draw.line(pixels, colour, round(width * self._thick), joint="curve")
        for point in pixels if dots else ():
            draw.circle(point, dots * self._thick / 2.0, colour)
