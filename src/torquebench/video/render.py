"""The process that draws a film (``python -m torquebench.video.render``): reads a `Job`, writes the film.

MUJOCO_GL, which says which OpenGL to use, must be set before MuJoCo is imported; hence a process of its own.
It reports each frame on standard output, and what was made at the end.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from torquebench.errors import TorquebenchError
from torquebench.kernel import Array
from torquebench.robot.library import camera_names
from torquebench.robot.mjcf import joint_names, torque_limits
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.encode import film_writer
from torquebench.video.job import FPS, Job, job_from
from torquebench.video.layout import timeline
from torquebench.video.opengl import STICK, send
from torquebench.video.overlay import Overlay, layout_for
from torquebench.video.scene import build_scene, tool_path
from torquebench.video.stage import OpenGlStage, StickStage

POINTS = 3
"""Points of the tool's trail per frame."""
TRAIL = POINTS * FPS
"""Length of the trail in points: one second of the film."""
CAMERA_POSES = 100
"""Poses of each run from which a camera is placed if the arm's files have none."""


class FilmRenderer:
    """Draws the frames of a job.

    Args:
        job: What to draw.

    Raises:
        TorquebenchError: a run or the arm cannot be read, or the controllers do not fit.
    """

    def __init__(self, job: Job) -> None:
        footage = job.footage
        self._runs = runs = [load_trajectory(shot.trajectory) for shot in footage.shots]
        self._longest = max(runs, key=lambda run: len(run.t))
        duration = len(self._longest.t) * footage.control_period
        self.timeline = timeline(duration, job.settings.speed, footage.control_period)
        self._samples = self.timeline.samples()
        where = layout_for(footage.shots, job.settings.size)
        scene = build_scene(footage.model, np.concatenate([sample_poses(run) for run in runs]))
        m = scene.model
        units = ["m" if kind == mujoco.mjtJoint.mjJNT_SLIDE else "rad" for kind in m.jnt_type]
        limits = torque_limits(m, footage.model)
        self._overlay = Overlay(footage.shots, runs, where, self.timeline, footage.title, joint_names(m), units, limits)
        fine = self.timeline.samples(POINTS)
        self._paths = [tool_path(m, run.q[np.minimum(fine, last_pose(run))]) for run in runs]
        self.camera = job.settings.camera or camera_names(footage.model)[0]
        camera = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_CAMERA, self.camera)
        size = where.panels[0].view[2:]
        self.stage = (
            StickStage(scene, size, camera)
            if job.backend == STICK
            else OpenGlStage(scene, size, camera, job.settings.quality, TRAIL + 1)
        )

    def draw(self, i: int) -> Image.Image:
        """Return frame `i`."""
        k, now = int(self._samples[i]), POINTS * i
        q_ref = self._longest.q_ref[min(k, len(self._longest.t) - 1)]
        views = []
        for run, path in zip(self._runs, self._paths, strict=True):
            trail = path[max(0, now - TRAIL) : now + 1]
            views.append(self.stage.draw(run.q[min(k, last_pose(run))], q_ref, trail))
        return self._overlay.draw(i, views)


def sample_poses(run: Trajectory) -> Array:
    """Return some positions of a run and of its reference, (N, n) [rad]."""
    every = max(1, len(run.t) // CAMERA_POSES)
    poses: Array = np.nan_to_num(np.concatenate([run.q[::every], run.q_ref[::every]]))
    return poses


def last_pose(run: Trajectory) -> int:
    """Return the index of a run's last position that is made of numbers."""
    return int(np.max(np.flatnonzero(np.isfinite(run.q).all(axis=1)), initial=0))


def make(job: Job) -> dict[str, Any]:
    """Make the film or picture of a job; return its facts.

    Raises:
        TorquebenchError: it cannot be made.
    """
    renderer, settings = FilmRenderer(job), job.settings
    total = renderer.timeline.total
    try:
        if job.still is not None:
            i = min(round(job.still * FPS / settings.speed), total - 1)
            renderer.draw(i).save(job.out)
            made = {"at": renderer.timeline.time(i)}
        else:
            made = {"fps": FPS, "frames": total, "seconds": total / FPS}
            with film_writer(Path(job.out), settings.size) as write:
                for i in range(total):
                    write(renderer.draw(i))
                    send({"frame": i + 1, "of": total})
    finally:
        renderer.stage.close()
    return {
        "backend": renderer.stage.backend,
        "quality": settings.quality,
        "size": list(settings.size),
        "speed": settings.speed,
        "camera": renderer.camera,
        **made,
    }


if __name__ == "__main__":
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        send({"made": make(job_from(sys.stdin.read()))})
    except TorquebenchError as error:
        send({"failed": str(error)})
