"""The process that draws a film (``python -m torquebench.video.render``): a `Job` comes in, a film comes out.

It is told which OpenGL to use by MUJOCO_GL, which must be set before MuJoCo is imported; hence a process of its own.
A line for each frame on standard output says how far it is, the last line what was made.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import TorquebenchError
from torquebench.kernel import Array
from torquebench.robot.library import camera_names
from torquebench.robot.mjcf import joint_names, torque_limits
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.encode import film_writer, png_bytes
from torquebench.video.job import Job, job_from
from torquebench.video.layout import Box
from torquebench.video.overlay import Clip, Overlay, layout_for
from torquebench.video.scene import Scene, build_scene, joint_points
from torquebench.video.settings import FPS
from torquebench.video.stage import GlStage, Stage
from torquebench.video.text import Pixels
from torquebench.video.timeline import Timeline, timeline

TRAIL, POINTS = 1.0, 3
"""Length of the tool's trail in the film's own seconds, and its points for each frame."""
POSES = 100
"""Poses of each run by which a camera is placed, where the arm's files have none."""


class Film:
    """The frames of a job.

    Args:
        job: What to draw.

    Raises:
        TorquebenchError: a run or the arm cannot be read, or the controllers do not fit.
    """

    def __init__(self, job: Job) -> None:
        self._runs = [load_trajectory(shot.trajectory) for shot in job.shots]
        lasting = max(len(run.t) for run in self._runs) * job.control_period
        self.frames: Timeline = timeline(lasting, job.settings.speed, job.control_period)
        clips = [Clip(s.name, s.note, run, s.ending) for s, run in zip(job.shots, self._runs, strict=True)]
        where = layout_for(clips, *job.settings.size)
        scene = build_scene(job.model, np.concatenate([poses(run) for run in self._runs]))
        m = scene.model
        slides = m.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
        self._overlay = Overlay(
            clips,
            where,
            self.frames,
            job.title,
            joint_names(m),
            ["m" if slide else "rad" for slide in slides],
            torque_limits(m, job.model),
        )
        names = camera_names(job.model)
        self.camera = job.settings.camera or names[0]
        camera = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_CAMERA, self.camera)
        self._paths = [tool_path(scene, run, self.frames) for run in self._runs]
        self.stage = open_stage(scene, where.panels[0].view, camera, job)
        self._samples = self.frames.samples()
        self._longest = max(self._runs, key=lambda run: len(run.t))

    def draw(self, i: int) -> Pixels:
        """Return frame `i`."""
        views = []
        for run, path in zip(self._runs, self._paths, strict=True):
            k = int(self._samples[i])
            trail = path[max(0, POINTS * i - round(TRAIL * FPS * POINTS)) : POINTS * i + 1]
            q_ref = self._longest.q_ref[min(k, len(self._longest.t) - 1)]
            views.append(self.stage.draw(run.q[min(k, last_pose(run))], q_ref, trail))
        return self._overlay.frame(i, views)


def poses(run: Trajectory) -> Array:
    """Return some positions of a run and of its reference, (N, n) [rad]."""
    every = max(1, len(run.t) // POSES)
    found: Array = np.nan_to_num(np.concatenate([run.q[::every], run.q_ref[::every]]))
    return found


def last_pose(run: Trajectory) -> int:
    """Return the index of the last position that is made of numbers."""
    return int(np.max(np.flatnonzero(np.isfinite(run.q).all(axis=1)), initial=0))


def tool_path(scene: Scene, run: Trajectory, frames: Timeline) -> Array:
    """Return where the tool is at `POINTS` instants a frame, (frames * POINTS, 3) [m]."""
    samples = np.minimum(frames.samples(POINTS), last_pose(run))
    d = mujoco.MjData(scene.model)
    joints = scene.model.njnt + 1
    return joint_points(scene.model, d, run.q[samples])[joints - 1 :: joints]


def open_stage(scene: Scene, view: Box, camera: int, job: Job) -> Stage:
    """Return what draws the arm.

    Args:
        scene: The arm.
        view: Size of the picture.
        camera: Number of the camera.
        job: Which back end, and how well.
    """
    if job.backend == "stick":
        from torquebench.video.stick import StickStage

        return StickStage(scene, view.width, view.height, camera)
    return GlStage(scene, view.width, view.height, camera, job.settings.quality, round(TRAIL * FPS * POINTS) + 1)


def make(job: Job) -> dict[str, Any]:
    """Make the film or picture of a job and return what it is.

    Raises:
        TorquebenchError: it cannot be made.
    """
    film = Film(job)
    width, height = job.settings.size
    try:
        if job.still is not None:
            i = min(round(job.still * FPS / job.settings.speed), film.frames.frames - 1)
            Path(job.out).write_bytes(png_bytes(film.draw(i)))
            made = {"at": film.frames.time(i)}
        else:
            made = {"fps": FPS, "frames": film.frames.frames, "seconds": film.frames.frames / FPS}
            with film_writer(Path(job.out), width, height) as film_file:
                for i in range(film.frames.frames):
                    film_file.write(film.draw(i))
                    tell({"frame": i + 1, "of": film.frames.frames})
    finally:
        film.stage.close()
    return {
        "backend": film.stage.backend,
        "quality": job.settings.quality,
        "size": [width, height],
        "speed": job.settings.speed,
        "camera": film.camera,
        **made,
    }


def tell(message: dict[str, Any]) -> None:
    """Send a line to the process that started this one."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        tell({"made": make(job_from(sys.stdin.read()))})
    except TorquebenchError as error:
        tell({"failed": str(error)})
