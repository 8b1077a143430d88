"""A finished run read back: the experiment, its objects, its trajectories and metrics, nothing simulated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.run import ExperimentResult, metrics_of
from torquebench.experiment.store import EXPERIMENT, check_run, refuse_without_experiment
from torquebench.sim.trajectory import load_trajectory


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run directory's content."""

    folder: Path
    result: ExperimentResult
    manifest: dict[str, Any]


def load_run(folder: Path) -> StoredRun:
    """Read a run directory.

    Args:
        folder: Where `torquebench run` left its results.

    Raises:
        ResultError: it is not a finished run, or a file of it is missing or changed.
        ConfigError: its experiment uses a law or a model that is not there any more.
    """
    manifest = check_run(folder)
    refuse_without_experiment(folder)
    experiment = load_experiment(folder / EXPERIMENT)
    loop = build(experiment)
    runs = {keys.name: load_trajectory(folder / keys.name / "trajectory.npz") for keys in experiment.controllers}
    metrics = {
        keys.name: metrics_of(experiment, loop, keys, runs[keys.name])
        for keys in experiment.controllers
        if runs[keys.name].completed
    }
    return StoredRun(folder, ExperimentResult(experiment, loop, runs, metrics), manifest)
