"""From a model's name, file or structure to an analytic model; MuJoCo is imported only where it is needed."""

from __future__ import annotations

from pathlib import Path

from torquebench.kernel import Array
from torquebench.robot.library import mjcf_path
from torquebench.robot.puma560.puma import NAME, Puma560
from torquebench.robot.robot_model import RobotModel


def keyframes(source: str | Path) -> dict[str, Array]:
    """Return the keyframes of an arm's file by name, each a position (n,) [rad]; those without a name are left out.

    Args:
        source: Name of a model in ``models/``, or path of an ``.xml`` file.

    Raises:
        ModelError: there is no such file, or it does not compile.
    """
    from torquebench.robot import mjcf

    return mjcf.keyframes(mjcf.compile_mjcf(mjcf_path(source)))


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
    if source == NAME:
        return Puma560(structure, constants)  # type: ignore[arg-type]  # names are checked there
    if (structure, constants) != ("exact", "fitted"):
        raise ValueError(f"model '{source}' has structure 'exact' and constants 'fitted' only")
    from torquebench.robot import mjcf

    path = mjcf_path(source)
    compiled = mjcf.compile_mjcf(path)
    return RobotModel(path.stem, tuple(mjcf.joint_names(compiled)), mjcf.flatten(compiled, str(source)))
