"""Which constants a rigid PUMA can have: the ties among them, and link parameters that realise given ones.

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
SHORTEST = 1e-4
"""A Newton step that may be taken to less than this share, twice running, leads to no body."""


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
    scale = np.linalg.norm(A, axis=1)
    A, target = A / scale[:, None], target / scale
    u, singular, vt = np.linalg.svd(A, full_matrices=False)
    keep = singular > 1e-10 * singular[0]
    A, target = vt[keep], (u.T @ target)[keep] / singular[keep]
    k, theta, short = len(target), prior, 0
    slope = np.einsum("iab,eab->ie", np.linalg.inv(pseudos(theta)), BASIS).ravel()
    for _ in range(MAX_STEPS):
        products = np.linalg.inv(pseudos(theta))[:, None] @ BASIS
        gradient = slope - np.trace(products, axis1=2, axis2=3).ravel()
        hessian = np.zeros((PARAMETERS, PARAMETERS))
        for i, block in enumerate(np.einsum("ieab,ifba->ief", products, products)):
            part = slice(PER_LINK * i, PER_LINK * (i + 1))
            hessian[part, part] = block
        if not np.all(np.diag(hessian) > 0.0):
            return None  # so near to the edge that rounding decides
        # eliminate the equality constraints through the KKT system, scaled by the Hessian's diagonal
        d = 1.0 / np.sqrt(np.diag(hessian))
        kkt = np.block([[hessian * np.outer(d, d), (A * d).T], [A * d, np.zeros((k, k))]])
        right = np.concatenate([-gradient * d, target - A @ theta])
        step = d * np.linalg.solve(kkt, right)[:PARAMETERS]
        length = 1.0
        while length > 1e-12 and np.linalg.eigvalsh(pseudos(theta + length * step)).min() <= 0:
            length *= 0.5
        short = short + 1 if length < SHORTEST else 0
        if short == 2:
            return None
        theta = theta + (length if length == 1.0 else 0.9 * length) * step
        if length == 1.0 and np.max(np.abs(step / d)) < close:
            return theta
    return None
