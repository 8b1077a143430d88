"""Drawing the arm with OpenGL through MuJoCo's renderer: solid arm, ghost of the reference, trail of the tool."""

from __future__ import annotations

from typing import Any, Protocol

import mujoco
import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array
from torquebench.video.lens import lens
from torquebench.video.scene import Scene
from torquebench.video.settings import Quality

Picture = npt.NDArray[np.uint8]
"""Pixels, (height, width, 3)."""
FINER = 2
"""Pixels drawn for each one shown, in each direction."""
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
_GROUND, _HIDDEN = 5, 3
"""Groups of geoms: planes, and what the arm's files hide."""
_FLAGS = mujoco.mjtRndFlag
_ROUND = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): 1,
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): 2,
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): 2,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): 3,
    int(mujoco.mjtGeom.mjGEOM_BOX): 3,
}
"""Kinds of geom that can be drawn grown -> how many of their sizes count."""


class Stage(Protocol):
    """Where one arm is drawn, again and again."""

    backend: str
    """What draws: ``egl``, ``osmesa`` and so on, or ``stick``."""

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Picture:
        """Draw the arm at `q`, its reference at `q_ref`, each (n,) [rad], and the tool's path `trail`, (K, 3) [m]."""
        ...

    def close(self) -> None:
        """Give back what the drawing needs."""
        ...


class GlStage:
    """A `Stage` on OpenGL.

    ``fast`` draws floor and sky once and only the arm anew; ``pretty`` draws everything, with shadows.

    Args:
        scene: The arm.
        width, height: Size of the picture [px].
        camera: Number of the camera.
        quality: See `Settings`.
        trail: Most points a trail can have.
    """

    def __init__(self, scene: Scene, width: int, height: int, camera: int, quality: Quality, trail: int) -> None:
        m = scene.model
        self._m, self._moving, self._reach = m, scene.moving, scene.reach
        self._layered = quality == "fast"
        wide, high = FINER * width, FINER * height
        m.vis.global_.offwidth, m.vis.global_.offheight = wide, high
        m.vis.global_.linewidth = 1.6 * FINER * max(1.0, height / 320.0)
        quality_of = m.vis.quality
        quality_of.offsamples = 0
        if self._layered:
            quality_of.numslices, quality_of.numstacks, quality_of.numquads = 24, 6, 1
        planes = m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        m.geom_group[m.geom_group > 2] = _HIDDEN
        m.geom_group[planes & (m.geom_group <= 2)] = _GROUND
        lens(m, camera, width, height)
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
        self._buffers = [(np.empty((high, wide, 3), np.uint8), np.empty((high, wide), np.float32)) for _ in range(2)]
        self._backdrop = self._surroundings() if self._layered else np.empty((high, wide, 3), np.uint8)
        self._paper = _shrunk(self._backdrop, self._backdrop)

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Picture:
        """Draw one picture: see `Stage`."""
        self._pose(self._arm, q)
        self._pose(self._reference, q_ref)
        self._update(surroundings=not self._layered)
        self._add_trail(trail)
        solid, near = self._render(0)
        self._add_ghost()
        both, nearer = self._render(1)
        # the ghost is in one of two pictures: half there, without showing its own inside
        if not self._layered:
            return _shrunk(solid, both)[::-1]
        picture, box = self._paper.copy(), _bounds(nearer < 1.0)
        small = tuple(slice(part.start // FINER, part.stop // FINER) for part in box)
        solid, both = (
            _over(self._backdrop[box], pixels[box], depth[box] < 1.0)
            for pixels, depth in ((solid, near), (both, nearer))
        )
        picture[small] = _shrunk(solid, both)
        return picture[::-1]

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

    def _render(self, buffer: int) -> tuple[Picture, npt.NDArray[np.float32]]:
        """Return colours and depths, 1 where there is nothing; rows run upwards."""
        pixels, depth = self._buffers[buffer]
        mujoco.mjr_render(self._view, self._scene, self._gl)
        mujoco.mjr_readPixels(pixels, depth if self._layered else None, self._view, self._gl)
        return pixels, depth

    def _surroundings(self) -> Picture:
        """Draw what does not move."""
        self._pose(self._arm, np.zeros(self._m.nq))
        self._update(surroundings=True, what=mujoco.mjtCatBit.mjCAT_STATIC)
        return self._render(0)[0].copy()

    def _next(self) -> Any:
        geom = self._scene.geoms[self._scene.ngeom]
        self._scene.ngeom += 1
        return geom

    def _add_trail(self, points: Array) -> None:
        nothing = np.zeros(3), np.zeros(3), np.zeros(9)
        # with shadows every light adds its share to a line, up to white
        line = mujoco.mjtGeom.mjGEOM_LINE if self._layered else mujoco.mjtGeom.mjGEOM_CAPSULE
        for i in range(len(points) - 1):
            geom = self._next()
            fresh = (i + 1.0) / len(points)
            colour = np.array([*(fresh * TRAIL + (1.0 - fresh) * PALE), 1.0], dtype=np.float32)
            mujoco.mjv_initGeom(geom, line, *nothing, colour)
            mujoco.mjv_connector(geom, line, TRAIL_SIZE * self._reach, points[i], points[i + 1])
            geom.emission = 0.5
        ball, size = mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, TOOL_SIZE * self._reach)
        geom = self._next()
        mujoco.mjv_initGeom(geom, ball, size, points[-1], np.eye(3).ravel(), TOOL)
        geom.emission = 0.6

    def _add_ghost(self) -> None:
        m, d = self._m, self._reference
        eye = (self._scene.camera[0].pos + self._scene.camera[1].pos) / 2.0
        for i in self._moving:
            if m.geom_group[i] == _HIDDEN:
                continue
            geom, size, kind = self._next(), m.geom_size[i].copy(), int(m.geom_type[i])
            size[: _ROUND.get(kind, 0)] += GROWN * self._reach
            place = eye + BEHIND * (d.geom_xpos[i] - eye)
            mujoco.mjv_initGeom(geom, kind, BEHIND * size, place, d.geom_xmat[i], GHOST)
            if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
                geom.dataid = 2 * int(m.geom_dataid[i])
            geom.emission = 0.35


def _bounds(hit: npt.NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the smallest rectangle of whole pixels as shown that holds all that is hit."""
    sides = []
    for line in (hit.any(axis=1), hit.any(axis=0)):
        at = np.flatnonzero(line)
        start, end = (at[0], at[-1] + 1) if len(at) else (0, 0)
        sides.append(slice(start // FINER * FINER, -(-end // FINER) * FINER))
    return sides[0], sides[1]


def _over(behind: Picture, pixels: Picture, hit: npt.NDArray[np.bool_]) -> Picture:
    """Return a picture with others' pixels where they are hit."""
    each = np.empty(pixels.shape, np.bool_)
    for channel in range(3):  # a mask of the pictures' own shape: broadcasting along three values is slow
        each[:, :, channel] = hit
    return np.where(each, pixels, behind)


def _shrunk(a: Picture, b: Picture) -> Picture:
    """Return the mean of two pictures, at the size shown."""
    total = np.zeros((a.shape[0] // FINER, a.shape[1] // FINER, 3), np.uint16)
    for picture in (a, b):
        for i in range(FINER):
            for j in range(FINER):
                total += picture[i::FINER, j::FINER]
    return np.asarray(total // (2 * FINER * FINER), dtype=np.uint8)
