"""The PUMA 560 in its three model structures and two constant sets."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from torquebench.errors import did_you_mean
from torquebench.kernel import Array
from torquebench.kernel.twin import map_states
from torquebench.robot.flat_model import CLOSED_FORM, STRUCTURES, Model, own_copy
from torquebench.robot.library import model_folder
from torquebench.robot.links import read_links
from torquebench.robot.puma560.constants import Body, Geometry, Table, fitted_constants, link_constants, read_constants
from torquebench.robot.puma560.kinematics import fill_pose, fill_pose_printed
from torquebench.robot.puma560.symbols import CONSTANTS, MISPRINTED
from torquebench.robot.robot_model import RobotModel

NAME = "puma560"
"""Its folder in ``models/``."""
JOINT_NAMES = ("waist", "shoulder", "elbow", "wrist-roll", "wrist-pitch", "wrist-yaw")
CONSTANT_SETS = ("fitted", "printed")


@lru_cache(maxsize=4)
def _files(folder: str) -> tuple[Model, Table, Geometry]:
    path = model_folder(NAME)
    return (read_links(path / "links.yaml"), *read_constants(path / "constants.yaml"))


def puma_files() -> tuple[Model, Table, Geometry]:
    """Return the PUMA's links, the tables of its constants, and its lengths, from the model's files."""
    return _files(str(model_folder(NAME)))


def wrist_load(mass: float, g: float) -> Array:
    """Return what a point mass at the wrist centre adds to the 34 constants, exactly, as they are linear in the links.

    I1 += (a3^2 + d^2) m, I2 += a2^2 m, .., g4 -= g a3 m; the wrist's own constants and the motors' keep their values.

    Args:
        mass: Mass [kg].
        g: Magnitude of gravity [m/s^2].
    """
    nothing = Body(*[0.0] * len(Body._fields))
    rigid = link_constants([nothing] * 5 + [nothing._replace(m=mass)], puma_files()[2], g)
    return np.concatenate([rigid[:23], np.zeros(6), rigid[23:]])


class Puma560(RobotModel):
    """Analytic model of the PUMA 560.

    Structures: ``exact`` is the rigid body with all six joints; ``corrected`` is the paper's frozen-wrist form (36),
    (48), (62), (72) with every equation right; ``printed`` is the same form with every equation read literally.
    ``corrected`` and ``printed`` ignore theta4, theta5 and theta6. Constant sets: ``printed`` are Tables 3 and 4;
    ``fitted`` are what ``links.yaml`` (and so the MuJoCo plant) realises.

    `forward_kinematics` gives the tool frame; with ``printed`` it gives (11)-(22) literally: the wrist centre, in
    other joint coordinates, and not a rotation.

    Args:
        structure: ``exact``, ``corrected`` or ``printed``.
        constants: ``fitted`` or ``printed``.

    Raises:
        ValueError: an unknown name, or ``exact`` with ``printed``: as printed, the constants break the seven ties
            that those of any rigid body satisfy.
    """

    def __init__(
        self,
        structure: Literal["exact", "corrected", "printed"] = "exact",
        constants: Literal["fitted", "printed"] = "fitted",
    ) -> None:
        for what, value, valid in (("structure", structure, STRUCTURES), ("constants", constants, CONSTANT_SETS)):
            if value not in valid:
                raise ValueError(f"{what} is {value!r}{did_you_mean(value, valid)}")
        if structure == "exact" and constants == "printed":
            raise ValueError(
                "structure 'exact' cannot have constants 'printed': the printed constants break the seven exact ties "
                "that those of a rigid body satisfy, so no rigid arm has them (use constants 'fitted')"
            )
        links, table, geometry = puma_files()
        self.structure = structure
        self.constants = constants
        self.geometry = geometry
        flat = own_copy(links)
        if structure != "exact":
            values = table.value.copy() if constants == "printed" else fitted_constants(links, geometry)
            literal = np.full(len(MISPRINTED), int(structure == "printed"), dtype=np.int64)
            flat = replace(flat, structure=CLOSED_FORM, constants=values, literal=literal)
        super().__init__(NAME, JOINT_NAMES, flat)

    def constant(self, name: str) -> float:
        """Value of one of I1..I23, Im1..Im6 [kg m^2] or g1..g5 [N m] in this model.

        Raises:
            ValueError: there is no constant of that name.
        """
        if name not in CONSTANTS:
            raise ValueError(f"unknown constant {name!r}{did_you_mean(name, CONSTANTS)}")
        values = fitted_constants(self.flat, self.geometry) if self.structure == "exact" else self.flat.constants
        return float(values[CONSTANTS.index(name)])

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool frame, (..., 4, 4) [-, m]; with ``printed`` the literal (10)-(22).

        Args:
            q: Joint position, (..., 6) [rad].
        """
        if self.structure == "exact":
            return super().forward_kinematics(q)
        states, lead = self._checked(q=q)
        equations = fill_pose_printed if self.structure == "printed" else fill_pose
        return map_states(equations, self.geometry, states, (4, 4))[0].reshape(*lead, 4, 4)
