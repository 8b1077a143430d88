"""Torques and powers: what the printed velocity terms and constants are worth at speeds up to 2 rad/s.

A torque is a polynomial in the speeds; its largest value is sought over the speeds -2, 0 and 2 of each joint and the
torus at 10 degrees.
"""

from __future__ import annotations

import itertools
import math
from functools import cache

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.puma560.puma import Puma560

from .elements import exact, exact_on_grid, printed_matrix, printed_torque, printed_values
from .findings import corrected_matrices, peak
from .independent import NODES, PAIRS, node_positions, on_torus

COARSE = 36
SPEED = 2.0
"""Largest speed of each joint [rad/s]."""


def quadratic(b: Array, C: Array) -> Array:
    """V_i = sum_jk Q_ijk qd_j qd_k from b (..., 6, 15) and C (..., 6, 6), (..., 6, 6, 6)."""
    Q = np.zeros((*C.shape, 6))
    for j in range(6):
        Q[..., j, j] = C[..., j]
    for column, (j, k) in enumerate(PAIRS):
        Q[..., j, k] = Q[..., k, j] = 0.5 * b[..., column]
    return Q


@cache
def speed_products(joints: int = 6) -> tuple[Array, Array]:
    """Speeds of -2, 0, 2 rad/s of the first `joints` joints, (n, 6), and their products qd_j qd_k, (36, n)."""
    corners = np.array(list(itertools.product((-SPEED, 0.0, SPEED), repeat=joints)))
    qd = np.zeros((len(corners), 6))
    qd[:, :joints] = corners
    return qd, np.einsum("nj,nk->jkn", qd, qd).reshape(36, -1)


def torque_peak(Q: Array) -> Array:
    """Largest |Q qd qd| of each joint over the torus and the speeds, (6,) [N m]."""
    products = speed_products()[1]
    fine = on_torus(Q, COARSE).reshape(COARSE * COARSE, 6, 36)
    return np.array([np.abs(fine[:, i] @ products).max() for i in range(6)])


@cache
def printed_quadratic(numbers: tuple[int, ...] = (61, 71)) -> Array:
    """Q of the velocity torques of (61), (71) or both as printed, (9, 9, 6, 6, 6), from torques at unit speeds."""
    Q = np.zeros((NODES, NODES, 6, 6, 6))
    unit = np.eye(6)

    def torque(speeds: Array) -> Array:
        return np.sum([printed_torque(number, speeds) for number in numbers], axis=0)

    for j in range(6):
        Q[..., j, j] = torque(unit[j])
    for j, k in PAIRS:
        Q[..., j, k] = Q[..., k, j] = 0.5 * (torque(unit[j] + unit[k]) - Q[..., j, j] - Q[..., k, k])
    return Q


@cache
def exact_quadratic(numbers: tuple[int, ...] = (61, 71)) -> Array:
    """Q of the arm's velocity torques, all or only those of (61), Coriolis, or (71), centrifugal."""
    found = exact_on_grid()
    return quadratic(found["b"] * (61 in numbers), found["c"] * (71 in numbers))


@cache
def corrected_quadratic() -> Array:
    """Q of the `corrected` model's velocity torques, (9, 9, 6, 6, 6)."""
    return quadratic(corrected_matrices()["b"], corrected_matrices()["c"])


@cache
def row3_readings() -> dict[str, float]:
    """Torque [N m] by which readings of row 3 of (71) differ: c13 as printed, (68) under its label c31, c31 itself."""
    literal, labelled, right = printed_values()["c13"], printed_values()["c31"], exact("c31")
    square = SPEED * SPEED
    return {
        "c13 - c31": square * peak(literal - right),
        "(68) - c31": square * peak(labelled - right),
        "c13 - (68)": square * peak(literal - labelled),
    }


def power(Q: Array, D: Array, joints: int) -> float:
    """Largest |qd . V - 0.5 qd . dA/dt qd| [W] over the torus and speeds of the first `joints` joints.

    Zero for the velocity torques that belong to A: they do no work of their own. D[k] is dA/dq_k.
    """
    qd, products = speed_products(joints)
    cubic = Q - 0.5 * np.moveaxis(D, 2, -1)  # V_i qd_i less 0.5 A_ij,k qd_i qd_j qd_k
    fine = on_torus(cubic, COARSE).reshape(COARSE * COARSE, 6, 36)
    total = np.zeros((COARSE * COARSE, len(qd)))
    for i in range(6):
        total += (fine[:, i] @ products) * qd[:, i]
    return float(np.abs(total).max())


@cache
def power_rms() -> tuple[float, float]:
    """Rms [W] of the printed V's spurious power, and of qd . V of the arm, speeds uniform within 2 rad/s."""
    rng = np.random.default_rng(0)
    qd = rng.uniform(-SPEED, SPEED, (400, 6))
    triples = np.einsum("ni,nj,nk->nijk", qd, qd, qd).reshape(len(qd), -1)
    wrong, right = (
        on_torus(Q, COARSE).reshape(COARSE * COARSE, -1) @ triples.T
        for Q in (printed_quadratic() - exact_quadratic(), exact_quadratic())
    )
    return float(np.sqrt(np.mean(wrong**2))), float(np.sqrt(np.mean(right**2)))


@cache
def printed_mass_derivatives() -> Array:
    """dA/dq_k of the printed (36) in the order of `exact_on_grid`'s D; joints 2 and 3 only, as it depends on these."""
    A = printed_matrix(36)
    D = np.zeros((NODES, NODES, 6, 6, 6))
    D[:, :, 1] = on_torus(A, NODES, (1, 0))
    D[:, :, 2] = on_torus(A, NODES, (0, 1))
    return D


@cache
def definiteness() -> dict[str, tuple[float, float]]:
    """Least and largest eigenvalue [kg m^2] of the symmetric part of A over the torus, per structure; 3 degrees."""
    angle = 2 * math.pi * np.arange(120) / 120
    q = np.zeros((120 * 120, 6))
    q[:, 1], q[:, 2] = (a.ravel() for a in np.meshgrid(angle, angle, indexing="ij"))
    found = {}
    for name, A in (
        ("arm", Puma560().mass_matrix(q)),
        ("corrected", Puma560("corrected").mass_matrix(q)),
        ("printed", Puma560("printed").mass_matrix(q)),
    ):
        eigenvalues = np.linalg.eigvalsh(0.5 * (A + A.transpose(0, 2, 1)))
        found[name] = float(eigenvalues.min()), float(eigenvalues.max())
    return found


@cache
def constant_gaps() -> dict[str, float]:
    """Largest change of A [kg m^2], V at 2 rad/s and G [N m] of the corrected form when the constants are printed."""
    model, q = Puma560("corrected", "printed"), node_positions()
    shape = (NODES, NODES)
    A = model.mass_matrix(q).reshape(*shape, 6, 6) - corrected_matrices()["A"]
    Q = quadratic(model.coriolis(q).reshape(*shape, 6, 15), model.centrifugal(q).reshape(*shape, 6, 6))
    G = model.gravity(q).reshape(*shape, 6) - corrected_matrices()["G"]
    return {"A": peak(A), "V": float(torque_peak(Q - corrected_quadratic()).max()), "G": peak(G)}
