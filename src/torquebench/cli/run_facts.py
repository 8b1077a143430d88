"""What ``torquebench run`` tells of a run beside its table: for ``--json`` and for the manifest."""

from __future__ import annotations

from typing import Any

from torquebench.cli.conditions import conditions_text
from torquebench.cli.fuzzy import used
from torquebench.experiment.run import ExperimentResult
from torquebench.experiment.schema import Experiment
from torquebench.sim.trajectory import Trajectory


def run_facts(result: ExperimentResult) -> dict[str, Any]:
    """Return what ``--json`` tells of a run: what was run, and outcome and metrics of each controller."""
    controllers = {}
    for keys in result.experiment.controllers:
        trajectory, metrics = result.runs[keys.name], result.metrics.get(keys.name)
        controllers[keys.name] = {
            "law": keys.law,
            **outcome_facts(trajectory),
            "expected": keys.name not in result.unexpected,
            "metrics": None if metrics is None else metrics.to_json(),
        }
    return {
        "name": result.experiment.name,
        "conditions": conditions_text(result.experiment).splitlines(),
        "joints": list(result.loop.joint_names),
        "controllers": controllers,
    }


def outcome_facts(trajectory: Trajectory) -> dict[str, Any]:
    """Return how a run ended, for the manifest and for ``--json``."""
    return {
        "path": trajectory.path,
        "path_reason": trajectory.path_reason,
        "outcome": trajectory.outcome.name,
        "failed_at": trajectory.failed_at,
        "detail": trajectory.detail,
        "digest": trajectory.digest(),
    }


def fuzzy_facts(experiment: Experiment) -> dict[str, dict[str, Any]]:
    """Return how each fuzzy system in use is evaluated, for the manifest and for ``--json``."""
    return {
        name: {"method": prepared.method, "error_bound": prepared.bound} for name, prepared in used(experiment).items()
    }
