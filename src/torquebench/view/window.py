"""The process that replays runs in MuJoCo's viewer (``python -m torquebench.view.window``): reads a `Job`.

It shows one controller at a time, and reports once a second that it is alive, and at the end that it was closed.
"""

from __future__ import annotations

import itertools
import sys
import time
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np

from torquebench.errors import TorquebenchError
from torquebench.kernel import Array
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.job import Job, job_from
from torquebench.video.opengl import send
from torquebench.video.scene import Scene, build_scene, tool_path
from torquebench.video.stage import GHOST, GROWN, TOOL, TOOL_SIZE, TRAIL, TRAIL_SIZE, VISIBLE_GROUPS

RATE = 60.0
"""Pictures per second."""
TRAIL_TIME, TRAIL_POINTS = 1.0, 100
"""Length of the tool's trail [s], and its number of points."""
SPACE, ENTER, RIGHT, LEFT = 32, 257, 262, 263
"""GLFW's codes of keys."""
STEP = 0.01
"""Step of an arrow key [s]."""
_ALPHA = 0.35


class Replay:
    """The clock and the controller that is shown; keys change them, from the viewer's thread.

    Args:
        job: The runs and the speed.
    """

    def __init__(self, job: Job) -> None:
        self.job, self.time, self.playing, self.shown = job, 0.0, True, 0
        self._runs = [load_trajectory(shot.trajectory) for shot in job.footage.shots]

    def key(self, code: int) -> None:
        """Handle a key."""
        if code == SPACE:
            self.playing = not self.playing
        elif code == ENTER:
            self.shown = (self.shown + 1) % len(self.job.footage.shots)
        elif code in (LEFT, RIGHT):
            self.playing = False
            self.time = max(0.0, self.time + (STEP if code == RIGHT else -STEP))

    @property
    def run(self) -> Trajectory:
        """The run that is shown."""
        return self._runs[self.shown]

    def advance(self, passed: float, run: Trajectory) -> int:
        """Advance the clock, from the end back to the start; return the sample to show.

        Args:
            passed: Time since the last call [s].
            run: The run that is shown.
        """
        if self.playing:
            self.time += passed * self.job.settings.speed
        k = round(self.time / self.job.footage.control_period)
        if k >= len(run.t):
            if self.playing and self.time > run.t[-1] + self.job.settings.speed:  # it stands still for a second first
                self.time = 0.0
            k = len(run.t) - 1
        return k


def add_ghost(view: Any, scene: Scene, d: Any) -> None:
    """Add the arm's moving geoms at the pose of `d` to a viewer's user scene, translucent."""
    m = scene.model
    for i in scene.moving:
        if m.geom_group[i] > VISIBLE_GROUPS:
            continue
        geom = view.geoms[view.ngeom]
        view.ngeom += 1
        size = np.maximum(m.geom_size[i] - GROWN * scene.reach, 0.2 * m.geom_size[i])  # the arm hides it if it follows
        mujoco.mjv_initGeom(
            geom, int(m.geom_type[i]), size, d.geom_xpos[i], d.geom_xmat[i], np.array([*GHOST[:3], _ALPHA], np.float32)
        )
        if m.geom_type[i] == mujoco.mjtGeom.mjGEOM_MESH:
            geom.dataid = 2 * int(m.geom_dataid[i])


def add_trail(view: Any, points: Array, reach: float) -> None:
    """Add the tool's path, (K, 3) [m], and a ball at its end to a viewer's user scene."""
    nothing = np.zeros(3), np.zeros(3), np.zeros(9)
    line, ball = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
    for a, b in itertools.pairwise(points):
        geom = view.geoms[view.ngeom]
        view.ngeom += 1
        mujoco.mjv_initGeom(geom, line, *nothing, np.array([*TRAIL, 1.0], np.float32))
        mujoco.mjv_connector(geom, line, TRAIL_SIZE * reach, a, b)
    geom = view.geoms[view.ngeom]
    view.ngeom += 1
    mujoco.mjv_initGeom(geom, ball, np.full(3, TOOL_SIZE * reach), points[-1], np.eye(3).ravel(), TOOL)


def replay(job: Job) -> None:
    """Show the runs until the window is closed.

    Raises:
        TorquebenchError: a run or the arm cannot be read.
    """
    state = Replay(job)
    scene = build_scene(job.footage.model, np.nan_to_num(state.run.q[::50]))
    m = scene.model
    d, reference = mujoco.MjData(m), mujoco.MjData(m)
    with mujoco.viewer.launch_passive(m, d, key_callback=state.key, show_left_ui=False, show_right_ui=False) as viewer:
        with viewer.lock():
            viewer.cam.type, viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FREE, -1
            _look_like_first_camera(viewer.cam, m)
        before, reported = time.perf_counter(), 0.0
        while viewer.is_running():
            now = time.perf_counter()
            run = state.run
            k = state.advance(now - before, run)
            back = np.linspace(max(0, k - TRAIL_TIME / job.footage.control_period), k, TRAIL_POINTS).astype(int)
            path = tool_path(m, np.nan_to_num(run.q[np.unique(back)]))
            reference.qpos[:] = run.q_ref[k]
            mujoco.mj_kinematics(m, reference)
            with viewer.lock():
                d.qpos[:] = np.nan_to_num(run.q[k])
                d.time = state.time
                mujoco.mj_forward(m, d)
                viewer.user_scn.ngeom = 0
                add_ghost(viewer.user_scn, scene, reference)
                add_trail(viewer.user_scn, path, scene.reach)
            shot = job.footage.shots[state.shown]
            place, font = mujoco.mjtGridPos.mjGRID_TOPLEFT, mujoco.mjtFontScale.mjFONTSCALE_150
            viewer.set_texts(
                (font, place, f"{shot.name}\n{shot.ending}", f"t = {state.time:.2f} s\nspace, arrows, enter")
            )
            viewer.sync()
            if now - reported > 1.0:
                send({"time": state.time, "shown": shot.name})
                reported = now
            before = now
            time.sleep(max(0.0, 1.0 / RATE - (time.perf_counter() - now)))


def _look_like_first_camera(camera: Any, m: Any) -> None:
    """Place a free camera where the scene's first camera is."""
    d = mujoco.MjData(m)
    mujoco.mj_kinematics(m, d)
    mujoco.mj_camlight(m, d)
    ahead = -d.cam_xmat[0].reshape(3, 3)[:, 2]
    distance = float((m.stat.center - d.cam_xpos[0]) @ ahead)
    camera.lookat[:] = d.cam_xpos[0] + distance * ahead
    camera.distance = distance
    camera.azimuth = float(np.rad2deg(np.arctan2(ahead[1], ahead[0])))
    camera.elevation = float(np.rad2deg(np.arcsin(ahead[2])))


if __name__ == "__main__":
    try:
        replay(job_from(sys.stdin.read()))
        send({"closed": True})
    except TorquebenchError as error:
        send({"failed": str(error)})
