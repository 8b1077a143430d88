"""Making a film of a stored run, on the first back end that draws, and recording what was made and why so."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torquebench.errors import VideoError
from torquebench.experiment.store import add_to_run
from torquebench.video.backends import STICK, Backend, advice, reason, usable
from torquebench.video.child import run_module
from torquebench.video.encode import ffmpeg_program
from torquebench.video.job import Job
from torquebench.video.settings import Settings, check_settings
from torquebench.video.stored import Footage

FILM = "video.mp4"
SILENCE = 300.0
"""Longest time between two frames [s]."""


@dataclass(frozen=True, slots=True)
class Made:
    """A film or picture."""

    content: bytes
    facts: dict[str, Any]
    """What it is: back end and reason, size, frames and so on, as recorded in the manifest."""
    advice: str
    """What to install for a better back end; empty if there is none better."""


def make_film(
    run: Footage,
    settings: Settings,
    wish: str | None = None,
    *,
    still: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Made:
    """Make a film, or one picture of it, from a run's stored trajectories.

    Args:
        run: The run.
        settings: What the film looks like.
        wish: The user's MUJOCO_GL; None if not set.
        still: Time of the one picture to make instead [s].
        progress: Called with the number of frames made and their total.

    Raises:
        ConfigError: impossible settings.
        VideoError: it cannot be made.
        ModelError: there is no such arm any more.
    """
    check_settings(settings, run.model)
    if still is None:
        ffmpeg_program()  # to say it at once, not after a back end has been sought

    def heard(message: Mapping[str, Any]) -> None:
        if progress is not None and "frame" in message:
            progress(message["frame"], message["of"])

    crashed: tuple[Backend, ...] = ()
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        out = Path(folder) / ("still.png" if still is not None else FILM)
        job = Job(run.model, run.title, run.shots, run.control_period, settings, "", str(out), still)
        for backend, failed in usable(wish):
            gl = "off" if backend.name == STICK else backend.name
            try:
                told = run_module(
                    "torquebench.video.render", replace(job, backend=backend.name).to_json(), gl, SILENCE, heard
                )
            except VideoError as error:
                if backend.name == STICK:
                    raise VideoError(f"drawing the film {error}") from error
                crashed = (*crashed, Backend(backend.name, False, f"drawing {error}"))
                continue
            if "failed" in told:
                raise VideoError(str(told["failed"]))
            if "made" not in told:
                raise VideoError(f"drawing the film ended after {told.get('frame', 0)} frames")
            worse = (*failed, *crashed)
            facts = {
                "reason": reason(backend, worse, wish),
                "renderer": backend.renderer,
                "controllers": [shot.name for shot in run.shots],
                **told["made"],
            }
            return Made(out.read_bytes(), facts, advice(worse) if backend.name == STICK else "")
    raise VideoError("no back end was left to draw with")


def keep_film(folder: Path, made: Made) -> Path:
    """Write a film into its run's folder, say in the manifest what it is, and return its path."""
    add_to_run(folder, {FILM: made.content}, {"video": {"file": FILM} | made.facts})
    return folder / FILM


def keep_failure(folder: Path, error: str) -> None:
    """Say in the manifest of a run that its film could not be made, and why."""
    add_to_run(folder, {FILM: None}, {"video": {"backend": None, "failed": error}})
