"""The arm of a config: a name, or a file that is read when the config is checked; and what a run says of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench.errors import ModelError, nearest_path
from torquebench.experiment.values import Here, Node
from torquebench.experiment.words import shown
from torquebench.experiment.yaml_tree import BROKEN
from torquebench.robot import load_model
from torquebench.robot.described import described_arm
from torquebench.robot.library import MJCF, ArmFile, is_path, model_names
from torquebench.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from torquebench.experiment.schema import Experiment


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
                except ModelError as error:
                    here.add(str(error))
                    return BROKEN
                if described is None:
                    return raw  # the rules know which names there are
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
            near = nearest_path(path, MJCF)
            where = "" if folder is None or Path(raw).is_absolute() else f" in {folder.absolute()}"
            here.add(f"there is no file {raw}{where}", nearest=near, wanted="" if near else self.wanted)
            return BROKEN
        from torquebench.robot.mjcf import read_arm

        try:
            arm = read_arm(path)
        except ModelError as error:
            for reason in error.reasons:
                here.add(" ".join(reason.removeprefix(f"{path}: ").split()))
            return BROKEN
        document.arms[raw] = folder, arm
        return arm

    def type(self) -> Any:
        """Return the type from which pydantic makes the JSON schema."""
        return str


def range_remarks(experiment: Experiment, runs: Mapping[str, Trajectory]) -> list[str]:
    """Return a line for each controller in whose run joints leave the range that the arm's file gives them."""
    if experiment.plant.limits == "ignore":
        return []
    arm = load_model(experiment.plant.model)
    low, high = np.array(arm.passive.low), np.array(arm.passive.high)
    if not np.any(np.isfinite([low, high])):
        return []
    found = []
    for name, run in runs.items():
        beyond = np.maximum(low - run.q, run.q - high)
        left = np.flatnonzero(np.any(beyond > 0.0, axis=0))
        if len(left) == 0:
            continue
        worst = int(left[np.argmax(beyond[:, left].max(axis=0))])
        unit, at = "m" if arm.flat.kind[worst] else "rad", float(run.t[np.argmax(beyond[:, worst] > 0.0)])
        others = [arm.joint_names[j] for j in left if j != worst]
        found.append(
            f"controller '{name}': {arm.joint_names[worst]} leaves its range, {low[worst]:.4g} to {high[worst]:.4g} "
            f"{unit}, at {at:.4g} s and goes up to {beyond[:, worst].max():.3g} {unit} beyond it"
            + (f", as do {', '.join(others)} theirs" if others else "")
            + ("" if experiment.plant.limits == "stop" else "; no plant holds a joint back")
        )
    return found
