"""The work of the process that draws a film: a `Job` becomes the frames of its file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from torquebench.robot.library import camera_names
from torquebench.scene.look import fit_camera, scene_of_runs, shown_poses, tool_path
from torquebench.sim.trajectory import load_trajectory
from torquebench.video.encode import film_writer
from torquebench.video.job import FPS, Job
from torquebench.video.layout import timeline
from torquebench.video.opengl import STICK
from torquebench.video.overlay import Overlay
from torquebench.video.stage import OpenGlStage, StickStage

POINTS = 3
"""Points of the tool's trail per frame."""
TRAIL = POINTS * FPS
"""Length of the trail in points: one second of the film."""


class FilmRenderer:
    """Draws the frames of a job.

    Args:
        job: What to draw.

    Raises:
        TorquebenchError: a run or the arm cannot be read, or the controllers do not fit.
    """

    def __init__(self, job: Job) -> None:
        footage, settings = job.footage, job.settings
        runs = [load_trajectory(shot.trajectory) for shot in footage.shots]
        longest = max(runs, key=lambda run: len(run.t))
        self.timeline = timeline(len(longest.t) * footage.control_period, settings.speed, footage.control_period)
        scene = scene_of_runs(footage.model, runs)
        self._overlay = Overlay(footage, runs, settings.size, self.timeline, scene)
        samples, fine = self.timeline.samples(), self.timeline.samples(POINTS)
        poses = [shown_poses(run) for run in runs]
        self._poses = [q[np.minimum(samples, len(q) - 1)] for q in poses]
        self._reference = longest.q_ref[np.minimum(samples, len(longest.t) - 1)]
        self._paths = [tool_path(scene.model, q[np.minimum(fine, len(q) - 1)]) for q in poses]
        self.camera = settings.camera or camera_names(footage.model)[0]
        camera = mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_CAMERA, self.camera)
        size = self._overlay.where.panels[0].view[2:]
        fit_camera(scene.model, camera, *size)
        self._stage = (
            StickStage(scene, size, camera)
            if job.backend == STICK
            else OpenGlStage(scene, size, camera, settings.quality, TRAIL + 1)
        )

    def draw(self, i: int) -> Image.Image:
        """Return frame `i`."""
        trail = slice(max(0, POINTS * i - TRAIL), POINTS * i + 1)
        views = [
            self._stage.draw(q[i], self._reference[i], path[trail])
            for q, path in zip(self._poses, self._paths, strict=True)
        ]
        return self._overlay.draw(i, views)


def main(job: Job) -> Iterator[tuple[int, int, dict[str, Any]]]:
    """Make the film or picture of a job; yield the frames that are made, their total, and at the end the film's facts.

    Raises:
        TorquebenchError: it cannot be made.
    """
    mujoco.set_mju_user_warning(lambda message: None)
    renderer, settings = FilmRenderer(job), job.settings
    total = renderer.timeline.total
    made: dict[str, Any]
    if job.still is not None:
        i = min(round(job.still * FPS / settings.speed), total - 1)
        renderer.draw(i).save(job.out)
        made = {"at": renderer.timeline.time(i)}
    else:
        made = {"fps": FPS, "frames": total, "seconds": total / FPS}
        with film_writer(Path(job.out), settings.size) as write:
            for i in range(total):
                write(renderer.draw(i))
                yield i + 1, total, {}
    facts = {"backend": job.backend, "quality": settings.quality, "size": list(settings.size), "speed": settings.speed}
    yield 0, total, facts | {"camera": renderer.camera} | made
