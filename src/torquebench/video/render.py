"""The work of the process that draws a film: a `Job` becomes the frames of its file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from torquebench.kernel import Array
from torquebench.robot.library import camera_names
from torquebench.scene.look import scene_of_runs, shown_poses, tool_path, window
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.encode import film_writer
from torquebench.video.job import FPS, SEPARATOR, Footage, Job
from torquebench.video.layout import timeline
from torquebench.video.opengl import STICK
from torquebench.video.overlay import Overlay
from torquebench.video.sound import heard, write_sound
from torquebench.video.stage import NOWHERE, OpenGlStage, StickStage

POINTS = 3
"""Points of the tool's trail per frame."""
TRAIL = POINTS * FPS
"""Length of the trail in points: one second of the film."""
MOST_POINTS = 600
"""Points of a path of the tool."""
POSES = 300
"""Poses that the camera's picture is cut to."""


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
        self.sound: dict[str, Any] = {}
        if settings.has_sound:
            footage, self.sound = self._listen(job, runs, scene.limits)
        self._overlay = Overlay(footage, runs, settings, self.timeline, scene)
        samples, fine = self.timeline.samples(), self.timeline.samples(POINTS)
        poses = [shown_poses(run, settings.exaggerate) for run in runs]
        self._poses = [q[np.minimum(samples, len(q) - 1)] for q in poses]
        self._reference = longest.q_ref[np.minimum(samples, len(longest.t) - 1)]
        since = footage.path_from
        every, whole = 1, POINTS * self.timeline.total
        self._since: int | None = None
        wanted = NOWHERE
        if since is not None:  # of a path of the tool the whole is shown
            self._since, every = int(np.searchsorted(fine, since / footage.control_period)), -(-whole // MOST_POINTS)
            shown = np.minimum(fine, len(longest.t) - 1)[self._since :: every]
            wanted = tool_path(scene.model, longest.q_ref[shown])
        self._every = every
        self._paths = [tool_path(scene.model, q[np.minimum(fine, len(q) - 1)]) for q in poses]
        self.camera = settings.camera or camera_names(footage.model)[0]
        camera = mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_CAMERA, self.camera)
        size = self._overlay.where.panels[0].view[2:]
        shown = np.concatenate([self._reference, *self._poses])
        self.part = window(scene, camera, shown[:: max(1, len(shown) // POSES)], size[0] / size[1])
        self._stage = (
            StickStage(scene, size, camera, self.part, wanted)
            if job.backend == STICK
            else OpenGlStage(scene, size, camera, self.part, settings.quality, max(TRAIL, MOST_POINTS) + 2, wanted)
        )

    def _listen(self, job: Job, runs: Sequence[Trajectory], limits: Array) -> tuple[Footage, dict[str, Any]]:
        """Write the film's sound; return the footage with notes that tell what is heard where, and its facts."""
        footage, settings, period = job.footage, job.settings, job.footage.control_period
        names = [shot.name for shot in footage.shots]
        ears = settings.ears or (names[0], names[min(1, len(names) - 1)])
        above = [heard(runs[names.index(ear)], limits, period, footage.chattering_from_hz) for ear in ears]
        write_sound(sound_file(job), above, period, settings.speed, self.timeline.total / FPS)
        told: dict[str, str] = {}
        for ear, side in zip(ears, ("left", "right"), strict=True):
            told[ear] = f"{SEPARATOR}{side} ear" if ear not in told else f"{SEPARATOR}both ears"
        shots = tuple(replace(shot, note=shot.note + told.get(shot.name, "")) for shot in footage.shots)
        rms = [float(np.sqrt(np.mean(signal * signal))) for signal in above]
        facts = {"left": ears[0], "right": ears[1], "from_hz": footage.chattering_from_hz, "rms_over_limit": rms}
        return replace(footage, shots=shots), facts

    def draw(self, i: int) -> Image.Image:
        """Return frame `i`."""
        now = POINTS * i
        first = max(0, now - TRAIL) if self._since is None else min(self._since, now)
        trail = [*range(first, now, self._every), now]
        views = [
            self._stage.draw(q[i], self._reference[i], path[np.minimum(trail, len(path) - 1)])
            for q, path in zip(self._poses, self._paths, strict=True)
        ]
        return self._overlay.draw(i, views)


def sound_file(job: Job) -> Path:
    """Return where a film's sound is until it is part of the film."""
    return Path(job.out).with_suffix(".wav")


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
        sound = sound_file(job) if settings.has_sound else None
        with film_writer(Path(job.out), settings.size, sound) as write:
            for i in range(total):
                write(renderer.draw(i))
                yield i + 1, total, {}
    facts = {"backend": job.backend, "quality": settings.quality, "size": list(settings.size), "speed": settings.speed}
    facts |= {"camera": renderer.camera, "exaggerate": settings.exaggerate} | made
    yield 0, total, facts | ({"sound": renderer.sound} if renderer.sound else {})
