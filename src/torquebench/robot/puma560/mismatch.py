"""A belief that is wrong on purpose: the closed forms' constants scaled by a drawn amount."""

from __future__ import annotations

import numpy as np

from torquebench.errors import ModelError
from torquebench.robot.arm import RobotModel
from torquebench.robot.model import CLOSED_FORM, own_copy

LEAST_EIGENVALUE = 0.05
"""A draw is accepted when the mass matrix stays above this [kg m^2] at every test pose."""
POSES = 300
MAX_REDRAWS = 1000


def mismatched(model: RobotModel, relative: float, rng: np.random.Generator) -> tuple[RobotModel, int]:
    """Return `model` with every constant multiplied by 1 + r or 1 - r, and the number of rejected draws.

    Signs are drawn independently for each of the 34 constants. Independent changes belong to a belief: with seven
    exact ties among the constants, no rigid body has them.

    Args:
        model: A ``corrected`` or ``printed`` model of the PUMA.
        relative: Size r of the change, 0 <= r < 1.
        rng: Source of the signs.

    Raises:
        ModelError: the model has no constants, or no acceptable draw was found.
    """
    if model.flat.structure != CLOSED_FORM:
        raise ModelError("a mismatch needs a model of structure 'corrected' or 'printed': 'exact' has no constants")
    poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, model.n))
    for redraws in range(MAX_REDRAWS):
        signs = 2.0 * rng.integers(0, 2, len(model.flat.constants)) - 1.0
        flat = own_copy(model.flat, constants=model.flat.constants * (1.0 + relative * signs))
        drawn = RobotModel(model.name, model.joint_names, flat)
        M = drawn.mass_matrix(poses)
        if np.linalg.eigvalsh(0.5 * (M + M.transpose(0, 2, 1))).min() > LEAST_EIGENVALUE:
            return drawn, redraws
    raise ModelError(f"no positive definite model within {MAX_REDRAWS} draws at a relative mismatch of {relative}")
