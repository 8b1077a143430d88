"""From a config's file or text to the experiment that it describes, or to all mistakes in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.experiment.controllers import Controller
from torquebench.experiment.extends import AUTO
from torquebench.experiment.fuzzy_schema import fuzzy_system
from torquebench.experiment.groups import group_of
from torquebench.experiment.rules import check_rules
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document, apply_overrides, read_bytes, read_document
from torquebench.experiment.start import write_keyframe
from torquebench.experiment.values import Here
from torquebench.fuzzy import FuzzySystem
from torquebench.kernel import Array
from torquebench.keys import altered
from torquebench.laws import find_law
from torquebench.robot import load_model
from torquebench.sim.signals import control_instants

MILLISECOND = 0.001
MOTIONS = 64
"""Motions whose torque `MotionTorques` keeps."""


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
    return sized(unsized(document), motion_torque)


def unsized(document: Document) -> Experiment:
    """Check an experiment as `check_experiment` does; what is relative to the motion, or to be chosen, stays so."""
    values = read_sections(document)
    document.raise_problems()
    if values["run"].metrics_from is None:
        values["run"] = dataclasses.replace(values["run"], metrics_from=values["reference"].metrics_from)
    return Experiment(**values)


def read_sections(document: Document) -> dict[str, Any]:
    """Return what each section of an experiment means; mistakes are recorded, and values that have some BROKEN."""
    top = group_of(Experiment)
    write_keyframe(document, top)
    values: dict[str, Any] = top.values(document.root, Here(document, top))
    check_rules(document, values)
    return values


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

    They suit the arm as its file has it, without the load and the friction of the config, whatever the laws believe.
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


SYSTEMS_ALONE = frozenset({"name", "description", "fuzzy"})
"""Keys of a file that defines fuzzy systems and nothing else."""


def load_systems(path: Path | str) -> dict[str, FuzzySystem] | None:
    """Read and check the fuzzy systems of a file that defines nothing else.

    Args:
        path: The YAML file: a mapping with the key ``fuzzy``.

    Returns:
        The systems by name; None of a file that has other keys, an experiment's.

    Raises:
        ConfigError: the file cannot be read, or has mistakes; all of them at once.
    """
    document = read_document(read_bytes(path), str(path))
    if not document.root.keys() <= SYSTEMS_ALONE or "fuzzy" not in document.root:
        return None
    top = group_of(Experiment)
    here = Here(document, top)
    values = {key: here.read(top.nodes[key], key, document.root[key]) for key in document.root}
    check_rules(document, values)
    document.raise_problems()
    return {name: fuzzy_system(name, keys) for name, keys in values["fuzzy"].items()}


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
