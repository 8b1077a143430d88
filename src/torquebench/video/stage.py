"""Pictures of the arm, its reference as a ghost and the tool's trail: with OpenGL, or as a stick figure without it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from torquebench.kernel import Array
from torquebench.video.job import Quality
from torquebench.video.opengl import STICK
from torquebench.video.scene import Scene, joint_points, project, set_lens

FINER = 2
"""Pixels drawn with OpenGL for each one shown, in each direction."""
GHOST = np.array([0.30, 0.60, 0.95, 1.0], dtype=np.float32)
GROWN = 0.008
"""How far the ghost stands out, as a fraction of the stretched arm: around an arm that follows it is a thin edge."""
BEHIND = 1.08
"""The ghost is drawn this many times as far from the camera, and as large: the arm hides it where both are."""
TRAIL, PALE = np.array([0.86, 0.32, 0.05]), np.array([0.97, 0.82, 0.70])
"""Colours of the tool's path, where it is now and where it was."""
TRAIL_SIZE = 0.004
"""Half its width, as a fraction of the stretched arm."""
TOOL = np.array([0.90, 0.0, 0.45, 1.0], dtype=np.float32)
TOOL_SIZE = 0.014
"""Radius of the ball that marks the tool, as a fraction of the stretched arm."""
VISIBLE_GROUPS = 2
"""Geoms of higher groups are hidden by the arm's files."""
STICK_FINER = 3
"""Pixels drawn of a stick figure for each one shown, in each direction."""
STICK_BACKGROUND, STICK_GROUND, STICK_ARM, STICK_GHOST = "#f2f5f8", "#d5d9de", "#2b3039", "#afd0f3"
STICK_TRAIL, STICK_TOOL = "#db520d", "#e60073"
_GROUND, _HIDDEN = 5, 3
"""Groups of geoms here: planes, and what the arm's files hide."""
_FLAGS = mujoco.mjtRndFlag
_ROUND = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): 1,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): 3,
    int(mujoco.mjtGeom.mjGEOM_BOX): 3,
}
"""Kinds of geom that can be drawn grown -> how many of their sizes count."""


class OpenGlStage:
    """Draws an arm at many poses with MuJoCo's renderer.

    ``fast`` draws floor and sky once and only the arm anew; ``pretty`` draws everything, with shadows.

    Args:
        scene: The arm.
        size: Width and height of the picture [px].
        camera: Number of the camera.
        quality: As in `Settings`.
        trail: Most points a trail can have.
    """

    def __init__(self, scene: Scene, size: tuple[int, int], camera: int, quality: Quality, trail: int) -> None:
        m = scene.model
        self._m, self._moving, self._reach = m, scene.moving, scene.reach
        self._layered = quality == "fast"
        wide, high = FINER * size[0], FINER * size[1]
        m.vis.global_.offwidth, m.vis.global_.offheight = wide, high
        m.vis.global_.linewidth = 1.6 * FINER * max(1.0, size[1] / 320.0)
        m.vis.quality.offsamples = 0
        if self._layered:
            m.vis.quality.numslices, m.vis.quality.numstacks, m.vis.quality.numquads = 24, 6, 1
        visible = m.geom_group <= VISIBLE_GROUPS
        m.geom_group[~visible] = _HIDDEN
        m.geom_group[visible & (m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)] = _GROUND
        set_lens(m, camera, *size)
        self._context = mujoco.GLContext(wide, high)
        self.backend = type(self._context).__module__.rpartition(".")[2]
        self._context.make_current()
        self._gl = mujoco.MjrContext(m, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._gl)
        self._view = mujoco.MjrRect(0, 0, wide, high)
        self._scene = mujoco.MjvScene(m, maxgeom=2 * m.ngeom + trail + 8)
        self._options, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._camera = mujoco.MjvCamera()
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        self._arm, self._reference = mujoco.MjData(m), mujoco.MjData(m)
        self._pixels, self._depth = np.empty((high, wide, 3), np.uint8), np.empty((high, wide), np.float32)
        self._backdrop = self._draw_backdrop() if self._layered else None

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Image.Image:
        """Draw one picture.

        Args:
            q: Joint positions of the arm, (n,) [rad].
            q_ref: Those of its reference, (n,) [rad].
            trail: Path of the tool, (K, 3) [m].
        """
        self._pose(self._arm, q)
        self._pose(self._reference, q_ref)
        self._update(surroundings=not self._layered)
        self._add_trail(trail)
        solid = self._render()
        self._add_ghost()
        # the ghost is in one of two pictures: translucent, without showing its own inside
        both = Image.blend(solid, self._render(), 0.5)
        return both.reduce(FINER).transpose(Image.Transpose.FLIP_TOP_BOTTOM)  # OpenGL's rows run upwards

    def close(self) -> None:
        """Free the OpenGL context."""
        self._gl.free()
        self._context.free()

    def _pose(self, d: Any, q: Array) -> None:
        d.qpos[:] = q
        mujoco.mj_kinematics(self._m, d)
        mujoco.mj_camlight(self._m, d)

    def _update(self, surroundings: bool, what: Any = mujoco.mjtCatBit.mjCAT_ALL) -> None:
        self._options.geomgroup[_GROUND] = surroundings
        mujoco.mjv_updateScene(self._m, self._arm, self._options, self._perturb, self._camera, int(what), self._scene)
        flags = self._scene.flags
        flags[_FLAGS.mjRND_SHADOW] = not self._layered
        flags[_FLAGS.mjRND_REFLECTION] = False
        flags[_FLAGS.mjRND_SKYBOX] = flags[_FLAGS.mjRND_HAZE] = surroundings

    def _draw_backdrop(self) -> Image.Image:
        """Draw what does not move."""
        self._pose(self._arm, np.zeros(self._m.nq))
        self._update(surroundings=True, what=mujoco.mjtCatBit.mjCAT_STATIC)
        mujoco.mjr_render(self._view, self._scene, self._gl)
        mujoco.mjr_readPixels(self._pixels, None, self._view, self._gl)
        return Image.fromarray(self._pixels)

    def _render(self) -> Image.Image:
        """Render the scene, in front of the backdrop if there is one."""
        mujoco.mjr_render(self._view, self._scene, self._gl)
        mujoco.mjr_readPixels(self._pixels, self._depth if self._backdrop else None, self._view, self._gl)
        picture = Image.fromarray(self._pixels)
        if self._backdrop is None:
            return picture
        return Image.composite(picture, self._backdrop, Image.fromarray(self._depth < 1.0).convert("L"))

    def _next_geom(self) -> Any:
        geom = self._scene.geoms[self._scene.ngeom]
        self._scene.ngeom += 1
        return geom

    def _add_trail(self, points: Array) -> None:
        nothing = np.zeros(3), np.zeros(3), np.zeros(9)
        # with shadows every light adds its share to a line, up to white
        line = mujoco.mjtGeom.mjGEOM_LINE if self._layered else mujoco.mjtGeom.mjGEOM_CAPSULE
        for i in range(len(points) - 1):
            geom = self._next_geom()
            fresh = (i + 1.0) / len(points)
            colour = np.array([*(fresh * TRAIL + (1.0 - fresh) * PALE), 1.0], dtype=np.float32)
            mujoco.mjv_initGeom(geom, line, *nothing, colour)
            mujoco.mjv_connector(geom, line, TRAIL_SIZE * self._reach, points[i], points[i + 1])
            geom.emission = 0.5
        ball, size = mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, TOOL_SIZE * self._reach)
        geom = self._next_geom()
        mujoco.mjv_initGeom(geom, ball, size, points[-1], np.eye(3).ravel(), TOOL)
        geom.emission = 0.6

    def _add_ghost(self) -> None:
        m, d = self._m, self._reference
        eye = (self._scene.camera[0].pos + self._scene.camera[1].pos) / 2.0
        for i in self._moving:
            if m.geom_group[i] == _HIDDEN:
                continue
            geom, size, kind = self._next_geom(), m.geom_size[i].copy(), int(m.geom_type[i])
            size[: _ROUND.get(kind, 0)] += GROWN * self._reach
            place = eye + BEHIND * (d.geom_xpos[i] - eye)
            mujoco.mjv_initGeom(geom, kind, BEHIND * size, place, d.geom_xmat[i], GHOST)
            if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
                geom.dataid = 2 * int(m.geom_dataid[i])
            geom.emission = 0.35


class StickStage:
    """Draws an arm at many poses as lines from joint to joint; needs neither OpenGL nor a display.

    Args:
        scene: The arm.
        size: Width and height of the picture [px].
        camera: Number of the camera.
    """

    backend = STICK

    def __init__(self, scene: Scene, size: tuple[int, int], camera: int) -> None:
        self._m, self._d = scene.model, mujoco.MjData(scene.model)
        self._wide, self._high = STICK_FINER * size[0], STICK_FINER * size[1]
        self._lens = set_lens(self._m, camera, self._wide, self._high)
        self._thick = STICK_FINER * max(1.0, min(size) / 320.0)
        self._paper = Image.new("RGB", (self._wide, self._high), STICK_BACKGROUND)
        planes = np.flatnonzero(self._m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        floor = float(self._m.geom_pos[planes[0], 2]) if len(planes) else 0.0
        mounted = len(scene.moving) < self._m.ngeom - len(planes)  # something stands on the floor
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
        arm, ghost = (np.concatenate([self._base, joint_points(self._m, self._d, pose[None])]) for pose in (q, q_ref))
        self._draw_line(picture, ghost, STICK_GHOST, 12.5, dots=12.5)
        self._draw_line(picture, arm, STICK_ARM, 4.4, dots=7.6)
        self._draw_line(picture, trail, STICK_TRAIL, 1.7)
        self._draw_line(picture, arm[-1:], STICK_TOOL, 0.0, dots=8.4)
        return picture.reduce(STICK_FINER)

    def close(self) -> None:
        """There is nothing to free."""

    def _draw_line(self, picture: Image.Image, points: Array, colour: str, width: float, dots: float = 0.0) -> None:
        """Draw a line through points of the world, (K, 3) [m]; those behind the camera are left out.

        Args:
            picture: Where; changed.
            points: The points.
            colour: As CSS writes it.
            width: Of the line, in pixels of a small picture.
            dots: Diameter of the dots at the points, the same.
        """
        ahead = points[(points - self._lens.position) @ self._lens.axes[:, 2] < 0.0]
        pixels = [tuple(point) for point in project(self._lens, ahead, self._wide, self._high).tolist()]
        draw = ImageDraw.Draw(picture)
        draw.line(pixels, colour, round(width * self._thick), joint="curve")
        for point in pixels if dots else ():
            draw.circle(point, dots * self._thick / 2.0, colour)
