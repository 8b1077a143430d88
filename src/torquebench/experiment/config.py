"""From a config's file or text to the experiment that it describes, or to all mistakes in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from torquebench.experiment.groups import group_of
from torquebench.experiment.rules import check_rules
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, read_bytes, read_document
from torquebench.experiment.values import Here
from torquebench.kernel import Array
from torquebench.robot import load_model
from torquebench.sim.signals import control_instants

MILLISECOND = 0.001


def load_experiment(path: Path | str, overrides: Sequence[str] = (), outside: bool = False) -> Experiment:
    """Read and check an experiment's file.

    Args:
        path: The YAML file.
        overrides: Edits ``key=value`` made before the check.
        outside: Whether the arm's file may be outside the folder of the config.

    Raises:
        ConfigError: the file cannot be read, or it or an override has mistakes; all of them at once.
    """
    return parse_experiment(read_bytes(path), str(path), overrides, outside)


def parse_experiment(
    text: str | bytes, filename: str = "", overrides: Sequence[str] = (), outside: bool = False
) -> Experiment:
    """Check an experiment given as YAML text.

    Args:
        text: The YAML.
        filename: What to call it in messages.
        overrides: Edits ``key=value`` made before the check.
        outside: As of `load_experiment`.

    Raises:
        ConfigError: something in it or in an override is wrong; all mistakes at once, in reading order.
    """
    document = read_document(text, filename)
    document.outside = outside
    apply_overrides(document, overrides)
    return check_experiment(document)


def check_experiment(document: Document) -> Experiment:
    """Check an experiment given as a document.

    Raises:
        ConfigError: something in it is wrong; all mistakes at once, in reading order. Sections are held against each
            other where each is right by itself.
    """
    top = group_of(Experiment)
    values = top.values(document.root, Here(document, top))
    check_rules(document, values)
    document.raise_problems()
    if values["run"].metrics_from is None:
        values["run"] = dataclasses.replace(values["run"], metrics_from=values["reference"].metrics_from)
    experiment = Experiment(**values)
    if not is_sized(document):
        return experiment
    rms = motion_torque(experiment)
    sized = tuple(item.sized(rms) if hasattr(item, "sized") else item for item in experiment.disturbances)
    return dataclasses.replace(experiment, disturbances=sized)


def is_sized(document: Document) -> bool:
    """Whether a valid config gives the size of a disturbance relative to the motion's torque."""
    given = document.root.get("disturbances")
    return isinstance(given, str) or (isinstance(given, list) and any("relative" in item for item in given))


def motion_torque(experiment: Experiment) -> Array:
    """Return the RMS torque that the motion takes, (n,) [N m].

    It is that of the exact inverse dynamics of the arm, without load and friction, along the reference: each
    millisecond, whatever the control period is.
    """
    instants = control_instants(max(round(experiment.run.duration / MILLISECOND), 2), MILLISECOND)
    motion = experiment.reference.sample(instants, experiment.n)
    tau = load_model(experiment.plant.model).inverse_dynamics(motion.q, motion.qd, motion.qdd)
    rms: Array = np.sqrt(np.mean(tau**2, axis=0))
    return rms
