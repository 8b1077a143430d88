"""The arm of a config: a name, or a file that is read when the config is checked; and what a run says of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ModelError, nearest_path
from torquebench.experiment.values import Here, Node
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN
from torquebench.kernel import Array
from torquebench.robot import load_model
from torquebench.robot.described import described_arm
from torquebench.robot.library import MJCF, ArmFile, is_path, model_folder, model_names
from torquebench.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from torquebench.experiment.schema import Experiment

SLACK = 1e-4
"""Distance by which a joint may leave its range without a word [rad, m]: less than arms are calibrated to."""


class ArmValue(Node):
    """The name of an arm, or the path of its file.

    A path is that of a file at or below the folder of the config that has it. One that a person gives otherwise, by
    ``--model``, ``--set`` or from Python, may be anywhere, and starts where they work.
    """

    wanted = "the name of an arm, or an MJCF or URDF file"

    def read(self, raw: Any, here: Here) -> Any:
        """Return the name, or the arm that the file holds."""
        if isinstance(raw, ArmFile):
            return raw
        if not isinstance(raw, str | Path):
            here.add(got=shown(raw), wanted=self.wanted)
            return BROKEN
        if isinstance(raw, str) and raw in model_names():
            return raw
        described = None
        if isinstance(raw, str) and not (is_path(raw) or "/" in raw or "\\" in raw):
            if raw not in here.document.arms:
                try:
                    described = described_arm(raw)
                    if described is None and not Path(raw).suffix:
                        model_folder(raw)
                except ModelError as error:
                    here.add(str(error))
                    return BROKEN
                if described is None:
                    here.add(got=shown(raw), wanted=f"{self.wanted} (.xml, .urdf)")
                    return BROKEN
            return self._file(raw, described, here)
        return self._file(str(raw), Path(raw) if isinstance(raw, Path) else None, here)

    def _file(self, raw: str, given: Path | None, here: Here) -> Any:
        """Return the arm of a file; `given` is its path where that is not below the config's folder."""
        document = here.document
        folder = None if given else document.folder(here.path)
        path = given or (folder or Path()) / raw
        known = document.arms.get(raw)
        if known is not None and known[0] in (None, folder):
            return known[1]
        if known is not None:
            here.add(f"{raw} stands for two files, in {known[0]} and in {folder}", wanted="other names")
            return BROKEN
        if folder is not None and not (document.outside or path.resolve().is_relative_to(folder.resolve())):
            note = "--model FILE takes any file, and so does --allow-outside"
            here.add(f"{raw} is outside the folder of the config", wanted="a file at or below it", note=note)
            return BROKEN
        if not path.is_file():
            near = _arm_in(path) if path.is_dir() else nearest_path(path, MJCF)
            where = "" if folder is None or Path(raw).is_absolute() else f" in {folder.absolute()}"
            text = f"{raw} is a folder" if path.is_dir() else f"there is no file {raw}{where}"
            here.add(text, nearest=near, wanted="" if near else self.wanted)
            return BROKEN
        from torquebench.robot.mjcf import read_arm

        try:
            arm = read_arm(path)
        except ModelError as error:
            for problem in error.problems:
                here.add(" ".join(str(problem).removeprefix(f"{path}: ").split()))
            return BROKEN
        document.arms[raw] = folder, arm
        return arm

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return str


def _arm_in(folder: Path) -> str:
    """Return the arm's file in a folder: the one that is called as the folder, or the only one; empty where none is."""
    files = sorted(path for path in folder.iterdir() if is_path(path.name) and path.is_file())
    alike = [path for path in files if path.stem == folder.name] or files
    return str(alike[0]) if len(alike) == 1 else ""


def range_remarks(experiment: Experiment, runs: Mapping[str, Trajectory]) -> list[str]:
    """Return a line for each controller in whose run joints leave the range that the arm's file gives them.

    Joints whose reference leaves it are told by `planned_range` instead.
    """
    lines = []
    for name, run in runs.items():
        planned = np.any(_beyond(experiment, run.q_ref) > 0.0, axis=0)
        lines += _leaving(experiment, f"controller '{name}': ", run.t, np.where(planned, run.q_ref, run.q), ~planned)
    return lines


def speed_remarks(experiment: Experiment, runs: Mapping[str, Trajectory]) -> list[str]:
    """Return a line for each controller in whose run joints are faster than the arm's file allows.

    Joints whose reference is too fast itself are told by `planned_speed` instead.
    """
    most, lines = np.array(load_model(experiment.plant.model).passive.speed), list[str]()
    for name, run in runs.items():
        asked = np.any(np.abs(run.qd_ref) > most, axis=0)
        lines += _too_fast(experiment, f"controller '{name}': ", run.t, run.qd, ~asked)
    return lines


IDLE = 0.02
"""Share of the torque limits below which it is asked whether they are right [1]."""


def limit_remarks(runs: Mapping[str, Trajectory], tau_max: Sequence[float]) -> list[str]:
    """Return a line where no controller ever uses more than `IDLE` of any joint's torque limit, or none.

    Args:
        runs: Controller name -> its run.
        tau_max: Torque limits, (n,) [N m].
    """
    used = [float(np.max(np.abs(run.tau) / np.array(tau_max), initial=0.0)) for run in runs.values() if run.completed]
    most = max(used, default=0.0)
    if len(used) < len(runs) or not 0.0 < most < IDLE:
        return []
    return [f"no controller uses more than {100.0 * most:.2g} % of a torque limit: are the limits right?"]


def planned_speed(experiment: Experiment, t: Array, qd_ref: Array) -> list[str]:
    """Return a line where the reference is faster than the arm's file allows, or none.

    Args:
        experiment: What is to be run.
        t: Control instants, (N,) [s].
        qd_ref: Desired velocities, (N, n) [rad/s].
    """
    return _too_fast(experiment, "the reference: ", t, qd_ref, np.ones(qd_ref.shape[1], dtype=bool))


def _worst(over: NDArray[np.bool_], size: Array, among: NDArray[np.bool_]) -> tuple[int, int, list[int]] | None:
    """Return the joint that is furthest over its limit, the first instant at which it is, and the others that are.

    Args:
        over: Where joints are over their limit, (N, n).
        size: How far they go, in a measure that joints share, (N, n).
        among: The joints that are looked at, (n,).

    Returns:
        None where no joint is over its limit.
    """
    joints = np.flatnonzero(np.any(over, axis=0) & among)
    if len(joints) == 0:
        return None
    worst = int(joints[np.argmax(size[:, joints].max(axis=0))])
    return worst, int(np.argmax(over[:, worst])), [int(j) for j in joints if j != worst]


def also(others: Sequence[str]) -> str:
    """Return that the same is so of other joints; nothing without any."""
    return f"; so {'do' if len(others) > 1 else 'does'} {', '.join(others)}" if others else ""


def _too_fast(experiment: Experiment, who: str, t: Array, qd: Array, among: NDArray[np.bool_]) -> list[str]:
    """Return a line where joints exceed their greatest speed, or none.

    Args:
        experiment: What is run.
        who: Beginning of the line.
        t: Times, (N,) [s].
        qd: Velocities, (N, n) [rad/s].
        among: The joints that are looked at, (n,).
    """
    if experiment.plant.limits == "ignore":
        return []
    arm = load_model(experiment.plant.model)
    most, speed = np.array(arm.passive.speed), np.abs(qd)
    found = _worst(speed > most, speed / most, among)
    if found is None:
        return []
    worst, first, rest = found
    unit, others = "m/s" if arm.flat.kind[worst] else "rad/s", [arm.joint_names[j] for j in rest]
    return [
        f"{who}{arm.joint_names[worst]} exceeds its speed limit, {most[worst]:.4g} {unit}, at {t[first]:.4g} s and "
        f"reaches {speed[:, worst].max():.4g} {unit}" + also(others)
    ]


def planned_range(experiment: Experiment, t: Array, q_ref: Array) -> list[str]:
    """Return a line where the reference leaves the ranges of joints, or none.

    Args:
        experiment: What is to be run.
        t: Control instants, (N,) [s].
        q_ref: Desired positions, (N, n) [rad].
    """
    return _leaving(experiment, "the reference: ", t, q_ref, np.ones(q_ref.shape[1], dtype=bool))


def _beyond(experiment: Experiment, q: Array) -> Array:
    """Return how far joints are beyond their range, (N, n) [rad]; not above 0 where they are in it."""
    passive = load_model(experiment.plant.model).passive
    far: Array = np.maximum(np.array(passive.low) - q, q - np.array(passive.high))
    return far


def _leaving(experiment: Experiment, who: str, t: Array, q: Array, among: NDArray[np.bool_]) -> list[str]:
    """Return a line where joints leave their range, or none.

    Args:
        experiment: What is run.
        who: Beginning of the line.
        t: Times, (N,) [s].
        q: Positions, (N, n) [rad].
        among: The joints that are looked at, (n,).
    """
    if experiment.plant.limits == "ignore":
        return []
    arm, beyond = load_model(experiment.plant.model), _beyond(experiment, q)
    found = _worst(beyond > 0.0, beyond, among & (beyond.max(axis=0) > SLACK))
    if found is None:
        return []
    worst, first, rest = found
    unit, others = "m" if arm.flat.kind[worst] else "rad", [arm.joint_names[j] for j in rest]
    return [
        f"{who}{arm.joint_names[worst]} leaves its range, {arm.passive.low[worst]:.4g} to "
        f"{arm.passive.high[worst]:.4g} {unit}, at {t[first]:.4g} s and goes up to {beyond[:, worst].max():.3g} {unit} "
        "beyond it" + also(others) + ("" if experiment.plant.limits == "stop" else "; no plant holds a joint back")
    ]
