"""The work of the process that replays a run in MuJoCo's viewer, one controller at a time."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Iterator
from typing import Any

import glfw
import mujoco
import mujoco.viewer
import numpy as np

from torquebench.errors import VideoError
from torquebench.scene.look import scene_of_runs, shown_poses, tool_path
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.job import Job
from torquebench.video.stage import GROWN, add_ghost, add_trail

RATE = 60.0
"""Pictures per second."""
TRAIL_TIME, TRAIL_POINTS = 1.0, 100
"""Length of the tool's trail [s], and its number of points."""
SPACE, ENTER, RIGHT, LEFT = 32, 257, 262, 263
"""GLFW's codes of keys."""
STEP = 0.01
"""Step of an arrow key [s]."""
ALPHA = 0.35
"""Opacity of the ghost; it is as much smaller here as it is larger in a film, as the arm must hide it."""


class Replay:
    """The clock and the controller that is shown; keys change them, from the viewer's thread.

    Args:
        job: The runs and the speed.
    """

    def __init__(self, job: Job) -> None:
        self.job, self.time, self.playing, self.shown = job, 0.0, True, 0
        self.runs = [load_trajectory(shot.trajectory) for shot in job.footage.shots]

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
        return self.runs[self.shown]

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


def check_window() -> None:
    """Open a hidden window and close it: where none opens, MuJoCo's viewer would wait for ever.

    Raises:
        VideoError: none opens.
    """
    if sys.platform == "darwin":
        raise VideoError("on macOS MuJoCo's viewer needs mjpython")
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise VideoError("neither DISPLAY nor WAYLAND_DISPLAY is set")
    with warnings.catch_warnings(record=True) as reports:  # how glfw reports errors
        warnings.simplefilter("always")
        opens = False
        if glfw.init():
            glfw.window_hint(glfw.VISIBLE, False)
            opens = bool(glfw.create_window(64, 64, "torquebench", None, None))
            glfw.terminate()
    if not opens:
        said = "; ".join(" ".join(str(report.message).split()) for report in reports)
        raise VideoError(f"GLFW opens no window: {said}")


def main(job: Job) -> Iterator[str]:
    """Show the runs until the window is closed; yield the name of the controller that is shown, once a second.

    Raises:
        TorquebenchError: no window opens, or a run or the arm cannot be read.
    """
    check_window()
    state = Replay(job)
    scene = scene_of_runs(job.footage.model, state.runs)
    poses = [shown_poses(run) for run in state.runs]
    m = scene.model
    d, reference = mujoco.MjData(m), mujoco.MjData(m)
    with mujoco.viewer.launch_passive(m, d, key_callback=state.key, show_left_ui=False, show_right_ui=False) as viewer:
        with viewer.lock():
            viewer.cam.type, viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FREE, -1
            _look_like_first_camera(viewer.cam, m)
        before, reported = time.perf_counter(), 0.0
        while viewer.is_running():
            now = time.perf_counter()
            run, q, shot = state.run, poses[state.shown], job.footage.shots[state.shown]
            k = state.advance(now - before, run)
            back = np.linspace(max(0, k - TRAIL_TIME / job.footage.control_period), k, TRAIL_POINTS).astype(int)
            path = tool_path(m, q[np.unique(back)])
            reference.qpos[:] = run.q_ref[k]
            mujoco.mj_kinematics(m, reference)
            with viewer.lock():
                d.qpos[:] = q[k]
                d.time = state.time
                mujoco.mj_forward(m, d)
                viewer.user_scn.ngeom = 0
                add_ghost(viewer.user_scn, scene, reference, grown=-GROWN, alpha=ALPHA)
                add_trail(viewer.user_scn, path, scene.reach)
            place, font = mujoco.mjtGridPos.mjGRID_TOPLEFT, mujoco.mjtFontScale.mjFONTSCALE_150
            viewer.set_texts(
                (font, place, f"{shot.name}\n{run.ending}", f"t = {state.time:.2f} s\nspace, arrows, enter")
            )
            viewer.sync()
            if now - reported > 1.0:
                yield shot.name
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
