"""Drawing the arm without OpenGL: lines from joint to joint through the same camera, by matplotlib."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from torquebench.kernel import Array
from torquebench.video.lens import lens, project
from torquebench.video.scene import Scene, joint_points
from torquebench.video.stage import Picture

BACKGROUND, GROUND, ARM, GHOST, TRAIL, TOOL = "#f2f5f8", "#d5d9de", "#2b3039", "#5aa2ee", "#db520d", "#e60073"
_DPI = 100.0
_GRID = 9
"""Lines of the floor's grid in each direction."""


class StickStage:
    """A `Stage` of lines; needs neither OpenGL nor a display.

    Args:
        scene: The arm.
        width, height: Size of the picture [px].
        camera: Number of the camera.
    """

    def __init__(self, scene: Scene, width: int, height: int, camera: int) -> None:
        self.backend = "stick"
        self._m, self._d = scene.model, mujoco.MjData(scene.model)
        self._width, self._height = width, height
        self._lens = lens(self._m, camera, width, height)
        self._figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI, facecolor=BACKGROUND)
        canvas: Any = FigureCanvasAgg(self._figure)
        self._canvas = canvas
        axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0, width), ylim=(height, 0))
        axes.set_axis_off()
        thick = max(1.0, min(width, height) / 320.0)
        for line in self._ground(scene):
            axes.plot(*line.T, color=GROUND, linewidth=0.7 * thick)
        looks: dict[str, dict[str, Any]] = {
            "ghost": {"color": GHOST, "linewidth": 9.0 * thick, "alpha": 0.45, "solid_capstyle": "round"},
            "arm": {"color": ARM, "linewidth": 3.2 * thick, "marker": "o", "markersize": 5.5 * thick},
            "trail": {"color": TRAIL, "linewidth": 1.2 * thick},
            "tool": {"color": TOOL, "marker": "o", "markersize": 6.0 * thick, "linestyle": "none"},
        }
        for look in looks.values():
            look["solid_joinstyle"] = "round"
        self._lines = {name: axes.plot([], [], animated=True, **look)[0] for name, look in looks.items()}
        self._axes = axes
        self._canvas.draw()
        self._paper = self._canvas.copy_from_bbox(self._figure.bbox)

    def draw(self, q: Array, q_ref: Array, trail: Array) -> Picture:
        """Draw one picture: see `Stage`."""
        arm = self._seen(self._links(q))
        paths = {"ghost": self._seen(self._links(q_ref)), "arm": arm, "trail": self._seen(trail), "tool": arm[-1:]}
        self._canvas.restore_region(self._paper)
        for name, line in self._lines.items():
            line.set_data(*paths[name].T)
            self._axes.draw_artist(line)
        return np.array(np.asarray(self._canvas.buffer_rgba())[:, :, :3])

    def close(self) -> None:
        """Forget the figure."""
        self._figure.clear()

    def _links(self, q: Array) -> Array:
        """Return the points that the arm's lines join, (n + 2, 3): floor or origin, joints, tool."""
        points = joint_points(self._m, self._d, q[None])
        return np.concatenate([np.zeros((1, 3)) + [0.0, 0.0, self._low], points])

    def _ground(self, scene: Scene) -> list[Array]:
        """Return the lines of a grid on the floor, and remember where the arm stands."""
        planes = np.flatnonzero(self._m.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        z = float(self._m.geom_pos[planes[0], 2]) if len(planes) else 0.0
        standing = len(scene.moving) < self._m.ngeom - len(planes)  # something is mounted on the floor
        self._low = z if standing else 0.0
        half, lines = 1.3 * scene.reach, []
        for x in np.linspace(-half, half, _GRID):
            for start, end in (((x, -half, z), (x, half, z)), ((-half, x, z), (half, x, z))):
                lines.append(self._seen(np.linspace(np.array(start), np.array(end), num=40)))
        return lines

    def _seen(self, points: Array) -> Array:
        """Return the pixels of points; those behind the camera are left out."""
        ahead = (points - self._lens.position) @ self._lens.axes[:, 2] < 0.0
        return project(self._lens, points[ahead], self._width, self._height)
