"""What a film needs from a run's folder, read from its files alone: laws of plug-ins need not be there."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean
from torquebench.experiment.store import EXPERIMENT, checksums, refuse_without_experiment
from torquebench.experiment.yaml_source import read_document
from torquebench.robot.library import mjcf_path
from torquebench.sim.trajectory import load_trajectory
from torquebench.video.job import APART, Shot

HEADLINES = (("rmse", "RMSE", 1e3, "mrad"), ("hf", "HF", 1.0, "%"))
"""Metrics quoted beside a controller's name: key, title, factor and unit."""

LEAST = 1e-3
"""Figures below are not told apart."""


@dataclass(frozen=True, slots=True)
class Footage:
    """A stored run as what a film or a replay is made of: its shots, with their trajectories."""

    title: str
    model: str
    control_period: float
    duration: float
    """Length of the run as it was asked for [s]."""
    shots: tuple[Shot, ...]


def read_footage(folder: Path, controllers: Sequence[str] = ()) -> Footage:
    """Read what a film needs from a run's folder.

    Args:
        folder: The run; its files have been checked, or were just written.
        controllers: Names of those to show, in this order; all of them if empty.

    Raises:
        ResultError: it is not the folder of an experiment.
        ConfigError: it has no such controller.
    """
    refuse_without_experiment(folder)
    try:
        config = read_document((folder / EXPERIMENT).read_bytes(), str(folder / EXPERIMENT)).root
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))["controllers"]
        laws = {str(keys["name"]): str(keys["law"]) for keys in config["controllers"]}
        wrong = [f"the run has no '{name}'{did_you_mean(name, laws)}" for name in controllers if name not in laws]
        wrong += [f"'{name}' is there twice" for name in dict.fromkeys(controllers) if controllers.count(name) > 1]
        if wrong:
            raise ConfigError([Problem("--controllers", "", text) for text in wrong])
        shots = tuple(_shot(folder, name, laws[name], metrics.get(name)) for name in controllers or laws)
        period, duration = float(config["run"]["control_period"]), float(config["run"]["duration"])
        return Footage(str(config["name"]), str(config["plant"]["model"]), period, duration, shots)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{folder}: its files are not those of a run ({type(error).__name__}: {error})") from error


def model_changed(footage: Footage, manifest: Mapping[str, Any]) -> bool:
    """Return whether the arm's file is no longer the one that was run, by the run's manifest."""
    path = mjcf_path(footage.model)
    return bool(manifest.get("model_files", {}).get(path.name) != checksums([path])[path.name])


def _shot(folder: Path, name: str, law: str, metrics: Any) -> Shot:
    path = folder / name / "trajectory.npz"
    run = load_trajectory(path)
    figures = []
    for key, title, factor, unit in HEADLINES if metrics else ():
        value = metrics[key]["value"]
        if value is not None:
            shown = f"{value * factor:.3g}" if abs(value * factor) >= LEAST else f"<{LEAST:g}"
            figures.append(f"{title} {shown} {unit}")
    return Shot(name, APART.join([*figures, law]), run.ending, str(path.resolve()))
