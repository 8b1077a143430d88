"""From a model's name, file or structure to an analytic model; MuJoCo is imported only where it is needed."""

from __future__ import annotations

from pathlib import Path

from torquebench.errors import ModelError, did_you_mean_path
from torquebench.robot.arm import RobotModel
from torquebench.robot.library import model_folder
from torquebench.robot.puma560.puma import Puma560

MJCF = r"\.xml"
"""What a model's file ends in, a regular expression."""


def load_model(source: str | Path, structure: str = "exact", constants: str = "fitted") -> RobotModel:
    """Load an analytic model.

    The PUMA 560 is read from ``links.yaml``, without MuJoCo. Any other model, and any MJCF file, is read through
    MuJoCo's compiler and must be a serial arm of hinges and slides; it has the structure ``exact`` only.

    Args:
        source: Name of a model in ``models/``, or path of an ``.xml`` file.
        structure: ``exact``; for the PUMA also ``corrected`` and ``printed``.
        constants: ``fitted``; for the PUMA's closed forms also ``printed``.

    Raises:
        ModelError: no such model, or not an arm the analytic side can represent.
        ValueError: a structure or constant set that the model does not have.
    """
    if source == "puma560":
        return Puma560(structure, constants)  # type: ignore[arg-type]  # names are checked there
    if (structure, constants) != ("exact", "fitted"):
        raise ValueError(f"model '{source}' has structure 'exact' and constants 'fitted' only")
    from torquebench.robot import mjcf

    path = mjcf_path(source)
    compiled = mjcf.compile_mjcf(path)
    return RobotModel(path.stem, tuple(mjcf.joint_names(compiled)), mjcf.flatten(compiled, str(source)))


def mjcf_path(source: str | Path) -> Path:
    """Return the MJCF file of a model's name, or `source` itself when it is the path of an ``.xml`` file.

    Raises:
        ModelError: there is no such model or file.
    """
    if isinstance(source, Path) or str(source).endswith(".xml"):
        path = Path(source)
        if not path.is_file():
            raise ModelError(f"{path}: no such file{did_you_mean_path(path, MJCF)}")
        return path
    return model_folder(source) / f"{source}.xml"
