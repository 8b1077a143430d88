"""From a model's name, file or structure to an analytic model; MuJoCo is imported only where it is needed."""

from __future__ import annotations

from torquebench.kernel import Array
from torquebench.robot.library import ArmSource
from torquebench.robot.puma560.puma import NAME, Puma560
from torquebench.robot.robot_model import RobotModel


def keyframes(source: ArmSource) -> dict[str, Array]:
    """Return the keyframes of an arm by name, each a position (n,) [rad]; those without a name are left out.

    Args:
        source: As of `load_model`.

    Raises:
        ModelError: there is no such arm, or it does not compile.
    """
    from torquebench.robot import mjcf

    return mjcf.keyframes(mjcf.compile_arm(mjcf.read_arm(source))[0])


def load_model(source: ArmSource, structure: str = "exact", constants: str = "fitted") -> RobotModel:
    """Load an analytic model.

    The PUMA 560 is read from ``links.yaml``, without MuJoCo. Any other model, and any MJCF file, is read through
    MuJoCo's compiler and must be a serial arm of hinges and slides; it has the structure ``exact`` only.

    Args:
        source: Name of a model in ``models/``, path of an MJCF or URDF file, or an arm that was read from one.
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

    return mjcf.analytic_model(mjcf.read_arm(source))
