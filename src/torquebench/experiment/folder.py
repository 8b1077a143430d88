"""The folder of a run: its numbers written, and read back as they were stored; nothing is computed anew."""

from __future__ import annotations

import html
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from torquebench.errors import ConfigError, ModelError, Problem, ResultError, did_you_mean
from torquebench.experiment.build import build
from torquebench.experiment.config import load_experiment
from torquebench.experiment.describe import chain_text, fuzzy_facts, noise_text
from torquebench.experiment.dump import canonical_hash, dump_experiment
from torquebench.experiment.run import ExperimentResult, Joints, joints_in, outcome_facts
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import read_document
from torquebench.experiment.store import (
    EXPERIMENT,
    RunDirectory,
    check_run,
    checksums,
    json_bytes,
    model_checksums,
    refuse_without_experiment,
)
from torquebench.metrics import METRICS, Metric, Metrics
from torquebench.robot.library import ArmFile, scene_path
from torquebench.sim.trajectory import Trajectory, load_trajectory

T = TypeVar("T")
METRICS_FILE, CERTIFICATES_FILE = "metrics.json", "certificates.json"


class _Stored(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True)


class _StoredOutcome(_Stored):
    """Outcome of a run, as written by `run.outcome_facts`."""

    outcome: str
    failed_at: int | None
    digest: str


class _StoredJoints(_Stored):
    """Names, limits and kinds of the joints."""

    names: list[str]
    tau_max: list[float]
    slides: list[bool]


class _Manifest(_Stored):
    """Entries that are read from a run's manifest; the last three are absent from folders of older versions."""

    config_sha256: str
    seeds: dict[str, Any]
    software: dict[str, str]
    machine: dict[str, str]
    model_files: dict[str, str]
    files: dict[str, str]
    outcomes: dict[str, _StoredOutcome]
    conditions: list[str] | None = None
    joints: _StoredJoints | None = None
    flags: list[str] | None = None


class _Margin(_Stored):
    value: float
    joint: int
    t: float


class _StoredCertificate(_Stored):
    """Figures of a controller's certificates that tables show, as written by `Certificate.to_json`."""

    share_outside: float
    share_rising_outside: float | None
    worst_margin: _Margin
    reaching_time: float | None
    reaching_bound: float | None


_CERTIFICATES = TypeAdapter(dict[str, _StoredCertificate])


class _StoredMetric(_Stored):
    value: float | None
    per_joint: list[float | None]
    counted: int


class _StoredMetrics(_Stored):
    controllers: dict[str, dict[str, _StoredMetric] | None]


def write_trajectory(directory: RunDirectory, name: str, run: Trajectory) -> None:
    """Write the run of one controller.

    Args:
        directory: The folder being written.
        name: The controller.
        run: Its run.
    """
    directory.write(f"{name}/trajectory.npz", run.to_bytes())


def write_experiment(directory: RunDirectory, experiment: Experiment, name: str = EXPERIMENT) -> None:
    """Write the experiment, every default filled in, and beside it its arm, where that is from a file."""
    if isinstance(experiment.plant.model, ArmFile):
        beside = PurePosixPath(name).parent
        directory.write(str(beside / str(experiment.plant.model)), experiment.plant.model.text.encode())
        if looks := scene_path(experiment.plant.model):
            directory.write(str(beside / looks.name), _with_meshes(looks, directory.folder / beside))
    directory.write(name, dump_experiment(experiment).encode())


def _with_meshes(looks: Path, folder: Path) -> bytes:
    """Return a scene file for another folder, from which its meshes are found where they lie."""

    def moved(match: re.Match[str]) -> str:
        meshes = (looks.parent / html.unescape(match[1])).resolve()
        return f'meshdir="{html.escape(os.path.relpath(meshes, folder.resolve()))}"'

    return re.sub(r'meshdir="([^"]*)"', moved, looks.read_text(encoding="utf-8"), count=1).encode()


def write_numbers(directory: RunDirectory, result: ExperimentResult) -> None:
    """Write metrics and certificates of a run."""
    experiment = result.experiment
    metrics = {name: result.metrics[name].to_json() if name in result.metrics else None for name in result.runs}
    conditions = {
        "window_from": experiment.run.metrics_from,
        "chattering_from_hz": experiment.chattering_from_hz,
        "noise": noise_text(experiment),
        "chain": chain_text(experiment),
    }
    directory.write(METRICS_FILE, json_bytes({"conditions": conditions, "controllers": metrics}))
    directory.write(CERTIFICATES_FILE, json_bytes(result.certified))


def manifest_of(result: ExperimentResult, plugins: Sequence[Path] = ()) -> dict[str, Any]:
    """Return what a run's manifest says, but for the checksums of the folder's files.

    Args:
        result: The run.
        plugins: Files that were loaded for it.
    """
    return dict(result.facts) | {
        "name": result.experiment.name,
        "conditions": result.conditions.splitlines(),
        "joints": {key: list(value) for key, value in result.joints._asdict().items()},
        "flags": list(result.flags),
        "scenario": result.scenario,
        "model_files": dict(result.model_files),
        "plugins": checksums(plugins),
        "fuzzy": fuzzy_facts(result.experiment),
        "outcomes": {name: outcome_facts(run) for name, run in result.runs.items()},
    }


def read_result(folder: Path) -> ExperimentResult:
    """Read the folder of a run: numbers, limits and names of joints are those that were stored.

    Args:
        folder: Where `torquebench run` or `Result.save` left its results.

    Raises:
        ResultError: it is not a finished run, a file of it is missing or changed, its files do not belong together, or
            it does not say what the joints are and the arm has changed since.
        ConfigError: its experiment uses a law or a model that does not exist any more.
    """
    content = check_run(folder)
    refuse_without_experiment(folder)
    manifest = _validated(TypeAdapter(_Manifest), content, folder / "manifest.json")
    experiment = _experiment(folder, manifest.config_sha256)
    runs = {keys.name: _trajectory(folder, keys.name, manifest) for keys in experiment.controllers}
    changed = _model_files(experiment) != manifest.model_files
    if changed and (manifest.joints is None or manifest.flags is None):
        raise ResultError(
            f"{folder}: an older version left it, which did not store names and limits of the joints, and the "
            f"files of the arm '{experiment.plant.model}' have changed since: wanted these files as they were"
        )
    stored = manifest.joints
    if stored is None:
        joints = joints_in(build(experiment))
    else:
        joints = Joints(tuple(stored.names), tuple(stored.tau_max), tuple(stored.slides))
    n = len(joints.names)
    if not len(joints.tau_max) == len(joints.slides) == n or any(run.q.shape[1] != n for run in runs.values()):
        raise ResultError(f"{folder}: its files do not belong together: not all are of {n} joints")
    metrics = _metrics(folder, n)
    if set(metrics) != {name for name, run in runs.items() if run.completed}:
        raise ResultError(f"{folder / METRICS_FILE}: is not of these runs: wanted metrics of those that completed")
    certificates = _read_json(folder / CERTIFICATES_FILE)
    for name, found in _validated(_CERTIFICATES, certificates, folder / CERTIFICATES_FILE).items():
        if name not in metrics or not 1 <= found.worst_margin.joint <= n:
            raise ResultError(f"{folder / CERTIFICATES_FILE}: is not of these runs (controller '{name}')")
    known: dict[str, Any] = {
        "files": manifest.files,
        "facts": {key: content[key] for key in ("config_sha256", "seeds", "software", "machine")},
        "model_files": manifest.model_files,
        "scenario": content.get("scenario", {}),
        "certified": certificates,
    }
    if manifest.conditions is not None:
        known["conditions"] = "\n".join(manifest.conditions)
    if manifest.flags is not None:
        known["flags"] = tuple(manifest.flags)
    return ExperimentResult(experiment, joints, runs, metrics, stored=known, arm_changed=changed)


def _experiment(folder: Path, digest: str) -> Experiment:
    path = folder / EXPERIMENT
    experiment = load_experiment(path)
    # by the file itself: a later version may fill in keys that the file does not have
    if canonical_hash(read_document(path.read_bytes(), str(path)).root) != digest:
        raise ResultError(f"{path}: is not the experiment that was run (config_sha256 of the manifest)")
    return experiment


def _trajectory(folder: Path, name: str, manifest: _Manifest) -> Trajectory:
    path = folder / name / "trajectory.npz"
    run, said = load_trajectory(path), manifest.outcomes.get(name)
    if said is None or run.digest() != said.digest or run.outcome.name != said.outcome:
        raise ResultError(f"{path}: is not the run of controller '{name}' (digest in the manifest)")
    return run


def _model_files(experiment: Experiment) -> dict[str, str]:
    try:
        return model_checksums(experiment.plant.model)
    except ModelError as error:
        raise ConfigError([Problem("", "plant.model", str(error))]) from error


def _metrics(folder: Path, n: int) -> dict[str, Metrics]:
    """Return the stored metrics of each controller that has them; one that the file lacks is undefined."""
    path = folder / METRICS_FILE
    stored = _validated(TypeAdapter(_StoredMetrics), _read_json(path), path)
    found, of_tool = {}, {info.key for info in METRICS.values() if info.of_tool}
    for name, values in stored.controllers.items():
        if values is None:
            continue
        if any(len(metric.per_joint) != n * (key not in of_tool) for key, metric in values.items()):
            raise ResultError(f"{path}: '{name}' has metrics of another number of joints, wanted {n}")
        for key in set(values) - set(METRICS.names()):
            raise ResultError(
                f"{path}: unknown metric '{key}'{did_you_mean(key, METRICS.names())}; one of your own needs --plugin "
                "FILE, the file that registers it"
            )
        metrics = {key: Metric(m.value, tuple(m.per_joint), m.counted) for key, m in values.items()}
        absent = Metric(None, (None,) * n, n)
        found[name] = Metrics(
            {key: metrics.get(key, absent) for key in METRICS.names() if key in metrics or key not in of_tool}
        )
    return found


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ResultError(f"{path}: cannot be read ({type(error).__name__}: {error})") from error


def _validated(adapter: TypeAdapter[T], content: Any, path: Path) -> T:
    try:
        return adapter.validate_python(content)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg'].lower()}" for e in error.errors()[:3])
        raise ResultError(f"{path}: is not what a run leaves ({wrong})") from error
