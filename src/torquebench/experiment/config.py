"""From a config's file or text to the experiment that it describes, or to all mistakes in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.experiment.controllers import Controller
from torquebench.experiment.extends import AUTO
from torquebench.experiment.groups import group_of
from torquebench.experiment.rules import check_rules
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, read_bytes, read_document
from torquebench.experiment.start import write_keyframe
from torquebench.experiment.values import Here
from torquebench.kernel import Array
from torquebench.keys import altered
from torquebench.laws import find_law
from torquebench.robot import load_model
from torquebench.sim.signals import control_instants

MILLISECOND = 0.001
MOTIONS = 64
"""Motions whose torque `MotionTorques` keeps."""


def load_experiment(path: Path | str, overrides: Sequence[str] = ()) -> Experiment:
    """Read and check an experiment's file.

    Args:
        path: The YAML file.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: the file cannot be read, or it or an override has mistakes; all of them at once.
    """
    return parse_experiment(read_bytes(path), str(path), overrides)


def parse_experiment(text: str | bytes, filename: str = "", overrides: Sequence[str] = ()) -> Experiment:
    """Check an experiment given as YAML text.

    Args:
        text: The YAML.
        filename: What to call it in messages.
        overrides: Edits ``key=value`` made before the check.

    Raises:
        ConfigError: something in it or in an override is wrong; all mistakes at once, in reading order.
    """
    document = read_document(text, filename)
    apply_overrides(document, overrides)
    return check_experiment(document)


def check_experiment(document: Document) -> Experiment:
    """Check an experiment given as a document.

    Raises:
        ConfigError: something in it is wrong; all mistakes at once, in reading order. Sections are held against each
            other where each is right by itself.
    """
    return sized(unsized(document), motion_torque)


def unsized(document: Document) -> Experiment:
    """Check an experiment as `check_experiment` does; what is relative to the motion, or to be chosen, stays so."""
    write_keyframe(document)
    top = group_of(Experiment)
    values = top.values(document.root, Here(document, top))
    check_rules(document, values)
    document.raise_problems()
    if values["run"].metrics_from is None:
        values["run"] = dataclasses.replace(values["run"], metrics_from=values["reference"].metrics_from)
    return Experiment(**values)


def sized(experiment: Experiment, torque_of: Callable[[Experiment], Array]) -> Experiment:
    """Return an experiment with numbers in place of gains to be chosen, and of shares of the motion's torque.

    Args:
        experiment: As of `unsized`.
        torque_of: `motion_torque`, or `MotionTorques`.
    """
    if any(_is_open(value) for keys in experiment.controllers for value in keys.gains.values()):
        experiment = with_gains(experiment)
    acting = experiment.disturbances
    if all(getattr(item, "relative", None) is None for item in acting):
        return experiment
    rms = torque_of(experiment)
    return altered(
        experiment, disturbances=tuple(item.sized(rms) if hasattr(item, "sized") else item for item in acting)
    )


def _is_open(value: object) -> bool:
    """Whether a gain is still to be chosen."""
    return value == AUTO


def with_gains(experiment: Experiment) -> Experiment:
    """Return an experiment with numbers in place of the gains that are to be chosen; see `Law.choose_gains`.

    They suit the arm itself, without load and friction, whatever the laws believe of it.
    """
    arm, controllers, chosen = load_model(experiment.plant.model), list[Controller](), dict[str, tuple[str, ...]]()
    for keys in experiment.controllers:
        given = {name: value for name, value in keys.gains.items() if not _is_open(value)}
        if len(given) < len(keys.gains):
            law, period = find_law(keys.law), experiment.run.control_period
            gains = law.choose_gains(arm, period, experiment.chain, keys.options, given)
            chosen[keys.name] = tuple(name for name in gains if name not in given)
            keys = dataclasses.replace(keys, gains=gains)
        controllers.append(keys)
    return altered(experiment, controllers=tuple(controllers), chosen=chosen)


def motion_torque(experiment: Experiment) -> Array:
    """Return the RMS torque that the motion takes, (n,) [N m].

    It is that of the exact inverse dynamics of the arm, without load and friction, along the reference: each
    millisecond, whatever the control period is.
    """
    instants = control_instants(max(round(experiment.run.duration / MILLISECOND), 2), MILLISECOND)
    motion = experiment.motion.sample(instants, experiment.n)
    tau = load_model(experiment.plant.model).inverse_dynamics(motion.q, motion.qd, motion.qdd)
    rms: Array = np.sqrt(np.mean(tau**2, axis=0))
    return rms


class MotionTorques:
    """`motion_torque` of many experiments, worked out once for each motion; the arms' files must stay as they are."""

    def __init__(self) -> None:
        self._known: list[tuple[tuple[Any, ...], Array]] = []

    def __call__(self, experiment: Experiment) -> Array:
        """Return the RMS torque that the motion takes, (n,) [N m]."""
        key = experiment.reference, experiment.run.duration, experiment.plant.model
        for known, rms in self._known:
            if known == key:
                return rms
        self._known = [*self._known[1 - MOTIONS :], (key, motion_torque(experiment))]
        return self._known[-1][1]
