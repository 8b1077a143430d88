"""Constants that a rigid PUMA can have: the ties among them, and link parameters that realise given ones.

I1..I23 and g1..g5 are linear in the links' parameters (mass, first moment, inertia about the frame's origin; 60 in all).
Links of a form without terms beyond these 28 reach only 21 independent values, and links that are bodies, with a
positive definite pseudo-inertia each (Wensing, Kim and Slotine, 2018), only a part of those.
"""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.links import inertia_tensor
from torquebench.robot.puma560.constants import Body, Geometry, link_constants

FIELDS = Body._fields
PER_LINK = len(FIELDS)
PARAMETERS = 6 * PER_LINK
MAX_STEPS = 200
REPEATED = 1e-8
"""A condition is redundant if less than this share of it is independent of the others."""
SHORTEST = 1e-4
"""If two Newton steps in a row must be cut below this share, there is no such body."""


def linear_map(geometry: Geometry, g: float) -> Array:
    """Return the matrix (28, 60) from the links' parameters to I1..I23, g1..g5; arguments as of `link_constants`."""
    rows = []
    for unit in np.eye(PARAMETERS):
        rows.append(link_constants([Body(*unit[PER_LINK * i : PER_LINK * (i + 1)]) for i in range(6)], geometry, g))
    return np.array(rows).T


def form_conditions() -> Array:
    """Return the rows (.., 60) of linear conditions = 0 for which the dynamics have no terms beyond the 28 constants.

    Beyond what that needs, the wrist is made plain: every centre of mass of links 4-6 on its z axis, link 5's at the
    origin, and link 1 (only its Izz matters) without first moments or products.
    """
    zero = [(link, moment) for link in (1, 5) for moment in ("hx", "hy", "hz")]
    zero += [(link, moment) for link in (4, 6) for moment in ("hx", "hy")]
    zero += [(link, product) for link in (1, 4, 5, 6) for product in ("xy", "xz", "yz")]
    rows = np.zeros((len(zero) + 1, PARAMETERS))
    for row, (link, name) in zip(rows, zero, strict=False):
        row[PER_LINK * (link - 1) + FIELDS.index(name)] = 1.0
    rows[-1, 5 * PER_LINK + FIELDS.index("xx")], rows[-1, 5 * PER_LINK + FIELDS.index("yy")] = 1.0, -1.0
    return rows


def reachable(B: Array) -> Array:
    """Return a basis of the constants that links of that form reach, (28, 21), from the `linear_map`."""
    _, singular, vt = np.linalg.svd(form_conditions())
    return B @ vt[np.sum(singular > 1e-12) :].T


def nearest_reachable(B: Array, constants: Array, tolerance: Array) -> Array:
    """Return the reachable constants of least distance, (28,): the ties hold in them.

    Args:
        B: The `linear_map`.
        constants: What to come near to, (28,).
        tolerance: Unit of each constant's distance, (28,).
    """
    basis = reachable(B)
    solution = np.linalg.lstsq(basis / tolerance[:, None], constants / tolerance, rcond=1e-12)[0]
    found: Array = basis @ solution
    return found


def pseudo(parameters: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of one link's ten parameters, linear in them."""
    m, h, J = parameters[0], parameters[1:4], inertia_tensor(*parameters[4:])
    second = 0.5 * np.trace(J) * np.eye(3) - J
    return np.block([[second, h[:, None]], [h[None, :], np.array([[m]])]])


BASIS = np.array([pseudo(row) for row in np.eye(PER_LINK)])


_GRAM = np.einsum("eab,fab->ef", BASIS, BASIS)
DUAL = np.tensordot(np.linalg.inv(_GRAM), BASIS, axes=1)
"""The dual basis (10, 4, 4): tr(DUAL_e BASIS_f) is 1 for e = f and 0 otherwise."""


def pseudos(theta: Array) -> Array:
    """Return the pseudo-inertias (6, 4, 4) of the links' parameters (60,)."""
    found: Array = np.tensordot(theta.reshape(6, PER_LINK), BASIS, axes=1)
    return found


def parts_of(theta: Array) -> tuple[Array, Array, Array]:
    """Return masses (6,), centres of mass (6, 3) and inertias about them (6, 3, 3) of the links' parameters (60,)."""
    rows = theta.reshape(6, PER_LINK)
    mass, com = rows[:, 0].copy(), rows[:, 1:4] / rows[:, :1]
    inertia = np.array([inertia_tensor(*row[4:]) for row in rows])
    for i in range(6):
        inertia[i] -= mass[i] * (np.dot(com[i], com[i]) * np.eye(3) - np.outer(com[i], com[i]))
    return mass, com, inertia


def consistent_links(A: Array, target: Array, prior: Array, close: float = 1e-6) -> Array | None:
    """Return the links' parameters nearest to a prior with A theta = target that are bodies; None when none are found.

    Minimises sum_i tr(P0_i^-1 P_i) - log det P_i over the pseudo-inertias P_i by Newton's method from the prior, which
    need not meet the target; the steps are kept short enough for every P_i to stay positive definite. When no bodies
    meet the target they become ever shorter.

    Args:
        A, target: The conditions, (k, 60) and (k,); those that repeat others are dropped.
        prior: Parameters of bodies, (60,).
        close: Largest step, in units of the distance's curvature, at which the nearest ones count as found. The
            conditions themselves hold from the first whole step on.
    """
    A, target = _independent(A, target)
    theta, short = prior, 0
    slope = np.einsum("iab,eab->ie", np.linalg.inv(pseudos(theta)), BASIS).ravel()
    for _ in range(MAX_STEPS):
        P = pseudos(theta)
        try:
            step = _newton_step(P, theta, slope, A, target - A @ theta)
            size = np.max(np.abs(np.linalg.solve(P, pseudos(step))))
        except np.linalg.LinAlgError:
            return None  # so near to the edge that rounding decides
        length = 1.0
        while length > 1e-12 and np.linalg.eigvalsh(pseudos(theta + length * step)).min() <= 0:
            length *= 0.5
        short = short + 1 if length < SHORTEST else 0
        if short == 2:
            return None
        theta = theta + (length if length == 1.0 else 0.9 * length) * step
        if length == 1.0 and size < close:
            return theta
    return None


def _independent(A: Array, target: Array) -> tuple[Array, Array]:
    """Return orthonormal rows and their values that say what A theta = target says, without rows that repeat others.

    By Gram-Schmidt, each row projected twice: the conditions are enough of them for a singular value decomposition to
    depend on the number of threads, as in `_newton_step`.
    """
    rows, values = np.empty((0, A.shape[1])), np.empty(0)
    for row, value in zip(A, target, strict=True):
        size = np.linalg.norm(row)
        row, value = row / size, value / size
        for _ in range(2):
            along = rows @ row
            row, value = row - along @ rows, value - along @ values
        left = np.linalg.norm(row)
        if left > REPEATED:
            rows, values = np.vstack([rows, row / left]), np.append(values, value / left)
    return rows, values


def _newton_step(P: Array, theta: Array, slope: Array, A: Array, missing: Array) -> Array:
    """Return the Newton step (60,) of sum_i tr(P0_i^-1 P_i) - log det P_i with A step = missing.

    The curvature at P takes a direction D to P^-1 D P^-1, so that its inverse takes G to P G P: no system of the 60
    parameters is solved. Linear algebra libraries share larger systems among threads, whose number would then decide
    the last bits, and by them which draws are accepted.

    Args:
        P, theta: Pseudo-inertias (6, 4, 4) and parameters (60,) here.
        slope: Gradient of the first term, (60,); the curvature's inverse takes that of the second to -theta.
        A, missing: The conditions, (k, 60) and (k,).
    """
    halves = P[:, None] @ DUAL
    inverse = np.einsum("ieab,ifba->ief", halves, halves)
    sides = np.vstack([A, slope]).reshape(-1, 6, PER_LINK)
    turned = np.einsum("kie,ief->kif", sides, inverse).reshape(len(sides), PARAMETERS)
    free = theta - turned[-1]
    matrix = turned[:-1] @ A.T
    d = 1.0 / np.sqrt(np.diag(matrix))
    multipliers = d * np.linalg.solve(matrix * np.outer(d, d), d * (missing - A @ free))
    step: Array = free + multipliers @ turned[:-1]
    return step
