"""Making the film of a stored run from its files alone: laws of plug-ins are not needed."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torquebench.errors import ConfigError, Problem, ResultError, VideoError, did_you_mean
from torquebench.experiment.schema import Video
from torquebench.experiment.source import read_document
from torquebench.experiment.store import (
    EXPERIMENT,
    MANIFEST,
    add_to_run,
    checksums,
    read_manifest,
    refuse_without_experiment,
)
from torquebench.metrics import METRICS, Metric
from torquebench.report.looks import looks
from torquebench.report.tables import joined
from torquebench.robot.library import is_path, mjcf_path
from torquebench.video.encode import ffmpeg_program
from torquebench.video.job import SEPARATOR, Footage, Job, Shot
from torquebench.video.opengl import STICK, Backend, advice, candidates, probe, reason
from torquebench.video.process import CrashedError, answers

FILM = "video.mp4"
SILENCE = 300.0
"""Longest time between two frames [s]."""
HEADLINES = (("rmse", "RMSE", 1e3, "mrad"), ("tool_rmse", "tool", 1e3, "mm"), ("chattering", "chattering", 1.0, "%"))
"""Metrics quoted beside a controller's name: key, title, factor and unit."""
LEAST = 1e-3
"""Smaller figures are written as ``<0.001``."""


@dataclass(frozen=True, slots=True)
class Film:
    """A film or picture that was made."""

    content: bytes
    facts: dict[str, Any]
    """Back end and why, size, frames and so on, as the manifest records them."""
    advice: str
    """How to install a better back end; empty if there is none."""


def read_footage(folder: Path, controllers: Sequence[str] = ()) -> Footage:
    """Read what a film needs from a run's folder.

    Args:
        folder: The run; its files have been checked, or were just written.
        controllers: Names of those to show, in this order; all of them if empty.

    Raises:
        ResultError: it is not the folder of an experiment.
        ConfigError: the run has no such controller.
    """
    refuse_without_experiment(folder)
    try:
        config = read_document((folder / EXPERIMENT).read_bytes(), str(folder / EXPERIMENT)).root
        measured = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        metrics, corner = measured["controllers"], float(measured["conditions"]["chattering_from_hz"])
        laws = {str(keys["name"]): str(keys["law"]) for keys in config["controllers"]}
        wrong = [f"the run has no '{name}'{did_you_mean(name, laws)}" for name in controllers if name not in laws]
        wrong += [f"'{name}' is there twice" for name in dict.fromkeys(controllers) if controllers.count(name) > 1]
        if wrong:
            raise ConfigError([Problem("--controllers", "", text) for text in wrong])
        colours = {name: look.colour for name, look in looks(laws).items()}  # the same, whichever are shown
        manifest, _ = read_manifest(folder / MANIFEST)
        slides = tuple(map(bool, (manifest.get("joints") or {}).get("slides", ())))  # older versions stored none
        shots = tuple(
            _shot(folder, name, laws[name], metrics.get(name), colours[name], slides) for name in controllers or laws
        )
        period, duration = float(config["run"]["control_period"]), float(config["run"]["duration"])
        arm = str(config["plant"]["model"])
        arm = str(folder / arm) if is_path(arm) else arm
        since = config["reference"].get("approach")
        begins = None if since is None else float(since)
        return Footage(str(config["name"]), arm, period, duration, shots, corner, begins)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{folder}: its files are not those of a run ({type(error).__name__}: {error})") from error


def _shot(folder: Path, name: str, law: str, metrics: Any, colour: str, slides: tuple[bool, ...]) -> Shot:
    path = folder / name / "trajectory.npz"
    figures = []
    for key, title, factor, unit in HEADLINES if metrics else ():
        info, values = METRICS[key], metrics.get(key, {})
        metric = Metric(values.get("value"), tuple(values.get("per_joint", ())), values.get("counted", 0))
        kinds = sorted(set(slides)) if info.is_angle and slides else [False]
        for kind in kinds:
            value = joined(info, metric, slides or (False,), kind)
            if value is not None:
                text = f"{value * factor:.3g}" if abs(value * factor) >= LEAST else f"<{LEAST:g}"
                figures.append(f"{title} {text} {'mm' if kind else unit}")
    return Shot(name, SEPARATOR.join([*figures, law] if law != name else figures), str(path.resolve()), colour)


def model_changed(footage: Footage, manifest: Mapping[str, Any]) -> bool:
    """Return whether the arm's file differs from the one that was run, according to the run's manifest."""
    path = mjcf_path(footage.model)
    return bool(manifest.get("model_files", {}).get(path.name) != checksums([path])[path.name])


def make_film(
    footage: Footage,
    settings: Video,
    gl: str | None = None,
    *,
    suffix: str = ".mp4",
    still: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Film:
    """Make a film of a stored run, or one picture of it, on the first back end that draws.

    Args:
        footage: The run.
        settings: What the film looks like, as `check_settings` returns it.
        gl: The user's MUJOCO_GL; None if not set.
        suffix: ``.mp4`` or ``.webp``.
        still: Time of the picture to make instead of a film [s].
        progress: Called with the number of frames made and their total.

    Raises:
        VideoError: it cannot be made.
        ModelError: the arm no longer exists.
    """
    if still is None:
        ffmpeg_program()  # fail before a back end is sought

    failed: list[Backend] = []
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        out = Path(folder) / f"film{suffix if still is None else '.png'}"
        for name in (*candidates(gl), STICK):
            backend = Backend(STICK, renderer="Pillow") if name == STICK else probe(name)
            if backend.ok:
                try:
                    made = _draw(Job(footage, settings, name, str(out), still), progress)
                    break
                except CrashedError as error:
                    if name == STICK:
                        raise VideoError(f"drawing the film {error}") from error
                    backend = Backend(name, f"drawing {error}")
            failed.append(backend)
        facts = {
            "reason": reason(name, failed, gl),
            "renderer": backend.renderer,
            "controllers": [shot.name for shot in footage.shots],
            **made,
        }
        return Film(out.read_bytes(), facts, advice(failed) if name == STICK else "")


def _draw(job: Job, progress: Callable[[int, int], None] | None) -> dict[str, Any]:
    """Draw a film or picture in a process of its own, and return its facts."""
    made: dict[str, Any] = {}
    gl = "off" if job.backend == STICK else job.backend
    for frame, total, facts in answers("torquebench.video.render", job, gl, SILENCE):
        if progress is not None and frame:
            progress(frame, total)
        made = facts
    return made


def keep_film(folder: Path, film: Film) -> Path:
    """Write a film into its run's folder, record it in the manifest, and return its path."""
    add_to_run(folder, {FILM: film.content}, {"video": {"file": FILM} | film.facts})
    return folder / FILM


def keep_failure(folder: Path, error: str) -> None:
    """Record in a run's manifest that its film could not be made, and why."""
    add_to_run(folder, {FILM: None}, {"video": {"backend": None, "failed": error}})
