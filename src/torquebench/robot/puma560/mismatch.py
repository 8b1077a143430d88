"""A belief that is wrong on purpose: constants scaled, drawn within their tolerances, or changed by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np

from torquebench.errors import Fault, ModelError, did_you_mean
from torquebench.kernel import Array, IntArray, kernel
from torquebench.keys import Key, Units
from torquebench.robot.flat_model import CLOSED_FORM, EXACT, own_copy
from torquebench.robot.library import ArmSource
from torquebench.robot.perturbation import draw_factors, perturbed
from torquebench.robot.puma560.closed_form import fill_mass_pattern
from torquebench.robot.puma560.consistent import (
    consistent_links,
    form_conditions,
    linear_map,
    nearest_reachable,
    parts_of,
)
from torquebench.robot.puma560.constants import fitted_constants
from torquebench.robot.puma560.puma import NAME, puma_files
from torquebench.robot.puma560.symbols import CONSTANTS, Angles, angles
from torquebench.robot.robot_model import RobotModel

LEAST_EIGENVALUE = 0.05
"""A draw is accepted when the mass matrix stays above this [kg m^2] at every test pose."""
POSES = 300
MAX_REDRAWS = 1000
MAX_BODIES = 100
"""Draws for which a rigid body is looked for, before giving up."""
MOTORS = np.array([name.startswith("Im") for name in CONSTANTS])


def mismatched(model: RobotModel, relative: float, rng: np.random.Generator) -> tuple[RobotModel, int]:
    """Return a model that is off by a relative amount, and the number of rejected draws.

    A closed form has every constant multiplied by 1 + r or 1 - r, signs drawn independently for each of the 34.
    Independent changes belong to a belief: with seven exact ties among the constants, no rigid body has them. A rigid
    body has its links scaled instead, each parameter within 1 - r to 1 + r; see `scaled`.

    Args:
        model: What to change; of any structure.
        relative: Size r of the change, 0 <= r < 1.
        rng: Source of the signs, or factors.

    Raises:
        ModelError: no acceptable draw was found.
    """
    if model.flat.structure == EXACT:
        return perturbed(model, draw_factors(model.n, relative, rng)), 0
    for redraws in range(MAX_REDRAWS):
        signs = 2.0 * rng.integers(0, 2, len(model.flat.constants)) - 1.0
        constants = model.flat.constants * (1.0 + relative * signs)
        if _acceptable(model, constants):
            return _with_constants(model, constants), redraws
    raise ModelError(f"no positive definite model within {MAX_REDRAWS} draws at a relative mismatch of {relative}")


def within_tolerances(model: RobotModel, tolerances: float, rng: np.random.Generator) -> tuple[RobotModel, int]:
    """Return a PUMA whose constants are drawn within k times the tables' own tolerances, and the rejected draws.

    Each of the 34 constants is drawn evenly around its fitted value. The 28 of the links are then projected on the
    seven ties, nearest in units of the tolerances; a draw is accepted when all are still within k tolerances and a
    rigid body with them is found. A closed form takes the constants, ``exact`` that body's links; the same draw is
    accepted or rejected for each of them.

    Args:
        model: A model of the PUMA 560, of any structure.
        tolerances: Number k of tolerances.
        rng: Source of all randomness.

    Raises:
        ModelError: no draw was accepted.
    """
    if model.name != NAME:
        raise ModelError(f"model '{model.name}' has no table of tolerances: only {NAME} has")
    links, table, geometry = puma_files()
    B, conditions = linear_map(geometry, float(-links.gravity[2])), form_conditions()
    nominal, prior = fitted_constants(links, geometry), links.about_origin.ravel()
    rigid, size = ~MOTORS, tolerances * table.tolerance
    for redraws in range(MAX_BODIES):
        change = size * rng.uniform(-1.0, 1.0, len(CONSTANTS))
        change[rigid] = nearest_reachable(B, change[rigid], table.tolerance[rigid])
        constants = nominal + change
        if np.any(np.abs(change) > size) or np.any(constants[MOTORS] <= 0.0):
            continue
        target = np.concatenate([constants[rigid], np.zeros(len(conditions))])
        theta = consistent_links(np.vstack([B, conditions]), target, prior)
        if theta is None:
            continue
        if model.flat.structure == CLOSED_FORM:
            return _with_constants(model, constants), redraws
        mass, com, inertia = parts_of(theta)
        flat = own_copy(model.flat, mass=mass, com=com, inertia=inertia, armature=constants[MOTORS])
        return RobotModel(model.name, model.joint_names, flat), redraws
    raise ModelError(f"no rigid body within {MAX_BODIES} draws of constants at {tolerances:g} times their tolerances")


def with_factors(model: RobotModel, factors: Mapping[str, float]) -> RobotModel:
    """Return a closed form with some of its constants multiplied by factors.

    Args:
        model: A ``corrected`` or ``printed`` model of the PUMA.
        factors: Name of a constant -> its factor.

    Raises:
        ModelError: the model has no constants, an unknown name, or the mass matrix is not positive definite with them.
    """
    if model.flat.structure != CLOSED_FORM:
        raise ModelError("single constants can be changed in structure 'corrected' or 'printed': 'exact' has none")
    constants = model.flat.constants.copy()
    for name, factor in factors.items():
        if name not in CONSTANTS:
            raise ModelError(f"unknown constant '{name}'{did_you_mean(name, CONSTANTS)}")
        constants[CONSTANTS.index(name)] *= factor
    changed = _with_constants(model, constants)
    if not _acceptable(model, constants):
        raise ModelError(
            f"with these constants the mass matrix has an eigenvalue of {least_eigenvalue(changed):.3g} kg m^2, wanted "
            f"all above {LEAST_EIGENVALUE}"
        )
    return changed


def least_eigenvalue(model: RobotModel) -> float:
    """Return the least eigenvalue of the symmetric part of the mass matrix over fixed poses [kg m^2]."""
    M = model.mass_matrix(_poses(model.n))
    return float(np.linalg.eigvalsh(0.5 * (M + M.transpose(0, 2, 1))).min())


@lru_cache(maxsize=4)
def _poses(n: int) -> Array:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, n))


@lru_cache(maxsize=1)
def _sines() -> Array:
    """The sines and cosines at the poses, which every draw needs, a row of `Angles` each."""
    return np.array([angles(pose) for pose in _poses(6)])


def _acceptable(model: RobotModel, constants: Array) -> bool:
    """True if a closed form with these constants has its least eigenvalue above `LEAST_EIGENVALUE`."""
    work = np.zeros((model.n, model.n))
    return bool(_all_above(constants, model.flat.literal, _sines(), LEAST_EIGENVALUE, work))


@kernel
def _all_above(constants: Array, literal: IntArray, sines: Array, least: float, A: Array) -> bool:
    """True if the symmetric part of the mass matrix less `least` times 1 is positive definite at every pose.

    It is just when all pivots of its elimination are positive (Sylvester); a tenth of the time of its eigenvalues.
    """
    n = len(A)
    for k in range(len(sines)):
        x = sines[k]
        t = Angles(x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7])
        fill_mass_pattern(constants, literal, t, A)
        for i in range(n):
            A[i, i] -= least
            for j in range(i):
                A[i, j] = 0.5 * (A[i, j] + A[j, i])
        for j in range(n):
            if not A[j, j] > 0.0:
                return False
            for i in range(j + 1, n):
                if A[i, j] != 0.0:  # most of the pattern (36) is zero
                    factor = A[i, j] / A[j, j]
                    for c in range(j + 1, i + 1):
                        A[i, c] -= factor * A[c, j]
    return True


def _with_constants(model: RobotModel, constants: Array) -> RobotModel:
    return RobotModel(model.name, model.joint_names, own_copy(model.flat, constants=constants))


@dataclass(frozen=True)
class Mismatch:
    """Errors put on purpose into the model that the laws use: one of these keys."""

    one_of: ClassVar[bool] = True
    relative: Annotated[
        float | None,
        Key(
            "Every constant is multiplied by 1 + r or 1 - r, as drawn; with structure exact the links are scaled as by "
            "plant.perturb; r is a fraction, 0.3 for 30 %",
            "1",
            at_least=0,
            below=1,
        ),
    ] = None
    tolerance: Annotated[
        float | None,
        Key(
            "Constants are drawn within this many times the tolerances of the paper's tables, such that a rigid body "
            "has them; puma560 only",
            "1",
            above=0,
        ),
    ] = None
    constants: Annotated[
        dict[Literal[CONSTANTS], float] | None,  # type: ignore[valid-type]  # a computed tuple
        Key(
            "Name of a constant, I1 to I23, Im1 to Im6 or g1 to g5, -> its factor; puma560 only and not with structure "
            "exact",
            "1",
            wanted="a mapping of constants to factors, such as {g1: 1.3}",
        ),
    ] = None

    def misfits(self, model: ArmSource, structure: str) -> Iterator[Fault]:
        """Yield what a model of this name and structure cannot have."""
        for key in ("tolerance", "constants"):
            if getattr(self, key) is None:
                continue
            if model != NAME:
                yield Fault((key,), f"model '{model}' has no table of constants (only {NAME} has)", at="key")
            elif key == "constants" and structure == "exact":
                text = "needs structure corrected or printed: exact has links, no constants"
                yield Fault((key,), text, at="key")

    @property
    def is_random(self) -> bool:
        """Whether the mismatch is drawn at random."""
        return self.constants is None

    def apply(self, model: RobotModel, rng: np.random.Generator) -> tuple[RobotModel, int]:
        """Return a model with these errors, and the number of rejected draws.

        Raises:
            ModelError: no draw was accepted, or the model has no such constants.
        """
        if self.constants is not None:
            return with_factors(model, self.constants), 0
        if self.relative is not None:
            return mismatched(model, self.relative, rng)
        return within_tolerances(model, self.tolerance or 0.0, rng)

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        if self.relative is not None:
            return f"mismatch +-{100 * self.relative:g} %"
        if self.tolerance is not None:
            return f"constants drawn within {self.tolerance:g} tolerances"
        return "mismatch " + " ".join(f"{name} x {factor:g}" for name, factor in (self.constants or {}).items())
