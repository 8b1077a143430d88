"""The dynamics that laws and the analytic plant call, whatever the model's structure.

Every function fills its last argument in place and allocates nothing. No argument is checked here: these are the
innermost functions of the loop; shapes are checked once in `simulate` and in the public classes. A `Model` owns its
scratch space, so one model must not be used by two threads at once.
"""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.flat_model import EXACT, Model
from torquebench.robot.puma560.closed_form import (
    fill_bias,
    fill_centrifugal,
    fill_coriolis,
    fill_gravity,
    fill_inverse,
    fill_mass_matrix,
)
from torquebench.robot.regressor import generalized_momentum
from torquebench.robot.rigid_body import composite_mass_matrix, newton_euler, place_frames


@kernel
def mass_matrix(model: Model, q: Array, M: Array) -> None:
    """Fill `M` (n, n) [kg m^2] with the mass matrix M(q); armature is included."""
    if model.structure == EXACT:
        place_frames(model, q)
        composite_mass_matrix(model, M)
    else:
        fill_mass_matrix(model.constants, model.literal, q, M)


@kernel
def gravity(model: Model, q: Array, tau: Array) -> None:
    """Fill `tau` (n,) [N m] with the torque g(q) that holds the arm still."""
    if model.structure == EXACT:
        place_frames(model, q)
        newton_euler(model, model.scratch.zeros, model.scratch.zeros, 1.0, tau)
    else:
        fill_gravity(model.constants, q, tau)


@kernel
def bias_forces(model: Model, q: Array, qd: Array, tau: Array) -> None:
    """Fill `tau` (n,) [N m] with N(q, qd) = C(q, qd) qd + g(q), the torque for zero acceleration; (25)."""
    if model.structure == EXACT:
        place_frames(model, q)
        newton_euler(model, qd, model.scratch.zeros, 1.0, tau)
    else:
        fill_bias(model.constants, model.literal, q, qd, tau)


@kernel
def inverse_dynamics(model: Model, q: Array, qd: Array, qdd: Array, tau: Array) -> None:
    """Fill `tau` (n,) [N m] with M(q) qdd + N(q, qd), the torque that produces the acceleration `qdd`; (27)."""
    if model.structure == EXACT:
        place_frames(model, q)
        newton_euler(model, qd, qdd, 1.0, tau)
    else:
        fill_inverse(model.constants, model.literal, q, qd, qdd, tau)


@kernel
def forward_dynamics(model: Model, q: Array, qd: Array, tau: Array, qdd: Array) -> None:
    """Fill `qdd` (n,) [rad/s^2] with M(q)^-1 (tau - N(q, qd)), the acceleration under `tau`; (30)."""
    M, N = model.scratch.matrix, model.scratch.vector
    if model.structure == EXACT:
        place_frames(model, q)
        newton_euler(model, qd, model.scratch.zeros, 1.0, N)
        composite_mass_matrix(model, M)
        for i in range(len(q)):
            qdd[i] = tau[i] - N[i]
        solve_symmetric_in_place(M, qdd)
    else:
        fill_bias(model.constants, model.literal, q, qd, N)
        fill_mass_matrix(model.constants, model.literal, q, M)
        for i in range(len(q)):
            qdd[i] = tau[i] - N[i]
        solve_in_place(M, qdd)


@kernel
def momentum_balance(model: Model, q: Array, qd: Array, p: Array, rate: Array) -> None:
    """Fill `p` (n,) [N m s] with M(q) qd and `rate` (n,) [N m] with C(q, qd)' qd - g(q): dp/dt = tau + rate.

    Of the closed forms, whose velocity torque is v(qd) = C(q, qd) qd, row i of C' qd is qd' C(q, qd) e_i with
    C(q, qd) e_i = (v(qd + e_i) - v(qd) - v(e_i)) / 2, as in `sliding_terms`.
    """
    g = model.scratch.vector
    if model.structure == EXACT:
        generalized_momentum(model, q, qd, p, rate)
        newton_euler(model, model.scratch.zeros, model.scratch.zeros, 1.0, g)
        for i in range(len(q)):
            rate[i] -= g[i]
    else:
        M = model.scratch.matrix
        fill_mass_matrix(model.constants, model.literal, q, M)
        for i in range(len(q)):
            p[i] = 0.0
            for k in range(len(q)):
                p[i] += M[i, k] * qd[k]
        moved, torque = M[0], M[1]
        fill_gravity(model.constants, q, g)
        for i in range(len(q)):
            rate[i] = -g[i]
        for c in range(2 * len(q) + 1):  # one call in a loop: the equations are long, and each call compiles them again
            i, last = c // 2, c == 2 * len(q)
            for k in range(len(q)):
                moved[k] = (qd[k] if last or c % 2 == 1 else 0.0) + (1.0 if k == i else 0.0)
            fill_bias(model.constants, model.literal, q, moved, torque)
            power = 0.0
            for k in range(len(q)):
                power += 0.5 * qd[k] * (torque[k] - g[k])
            if last:
                for k in range(len(q)):
                    rate[k] -= power
            else:
                rate[i] += power if c % 2 == 1 else -power


@kernel
def sliding_terms(model: Model, q: Array, qd: Array, s: Array, M: Array, turning: Array, g: Array) -> None:
    """Fill `M` (n, n) with M(q), `turning` (n,) with C(q, qd) s and `g` (n,) with g(q), of an EXACT model [N m].

    C is that of Christoffel's symbols, for which dM/dt - 2C is skew-symmetric. The velocity torque is a quadratic form
    v(x) = C(q, x) x, so C(q, qd) s = (v(qd + s) - v(qd) - v(s)) / 2.

    Args:
        model: The arm.
        q, qd, s: Position [rad], velocity [rad/s] and sliding variable [rad/s], (n,).
        M, turning, g: Results.
    """
    both, torque, still = model.scratch.matrix[0], model.scratch.vector, model.scratch.zeros
    place_frames(model, q)
    composite_mass_matrix(model, M)
    for i in range(len(q)):
        both[i] = qd[i] + s[i]
    newton_euler(model, both, still, 1.0, turning)
    newton_euler(model, qd, still, 1.0, torque)
    for i in range(len(q)):
        turning[i] -= torque[i]
    newton_euler(model, s, still, 1.0, torque)
    for i in range(len(q)):
        turning[i] -= torque[i]
    newton_euler(model, still, still, 1.0, g)
    for i in range(len(q)):
        turning[i] = 0.5 * (turning[i] + g[i])


@kernel
def sliding_terms_of_each(model: Model, q: Array, qd: Array, s: Array, M: Array, turning: Array, g: Array) -> None:
    """Fill the rows of `M` (N, n, n), `turning` and `g` (N, n) with `sliding_terms`; arguments as there, (N, n)."""
    for k in range(len(q)):
        sliding_terms(model, q[k], qd[k], s[k], M[k], turning[k], g[k])


@kernel
def velocity_products(model: Model, q: Array, b: Array, C: Array) -> None:
    """Fill the Coriolis matrix `b` (n, n(n-1)/2) and the centrifugal matrix `C` (n, n), (26) [kg m^2].

    Columns of `b` are the pairs 12, 13, .., 1n, 23, .. in the paper's order (32). For a rigid body both are read
    off the bias at unit velocities: C_j = N(e_j), b_jk = N(e_j + e_k) - N(e_j) - N(e_k), gravity left out, which is
    exact because N is quadratic in the velocities.
    """
    if model.structure == EXACT:
        n = len(q)
        place_frames(model, q)
        qd, tau = model.scratch.matrix[0], model.scratch.vector
        for i in range(n):
            qd[i] = 0.0
        for j in range(n):
            qd[j] = 1.0
            newton_euler(model, qd, model.scratch.zeros, 0.0, tau)
            for i in range(n):
                C[i, j] = tau[i]
            qd[j] = 0.0
        column = 0
        for j in range(n):
            for k in range(j + 1, n):
                qd[j], qd[k] = 1.0, 1.0
                newton_euler(model, qd, model.scratch.zeros, 0.0, tau)
                for i in range(n):
                    b[i, column] = tau[i] - C[i, j] - C[i, k]
                qd[j], qd[k] = 0.0, 0.0
                column += 1
    else:
        fill_coriolis(model.constants, model.literal, q, b)
        fill_centrifugal(model.constants, model.literal, q, C)


@kernel
def solve_in_place(A: Array, x: Array) -> None:
    """Replace `x` (n,) by A^-1 x and destroy `A` (n, n): LU with partial pivoting, in a fixed order.

    General rather than symmetric because the mass matrix as printed in (36) is not symmetric. A singular matrix
    gives values that are not finite.
    """
    n = len(x)
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[pivot, j]):
                pivot = i
        if pivot != j:
            for c in range(n):
                A[j, c], A[pivot, c] = A[pivot, c], A[j, c]
            x[j], x[pivot] = x[pivot], x[j]
        for i in range(j + 1, n):
            factor = A[i, j] / A[j, j]
            for c in range(j + 1, n):
                A[i, c] -= factor * A[j, c]
            x[i] -= factor * x[j]
    for back in range(n):
        i = n - 1 - back
        total = x[i]
        for c in range(i + 1, n):
            total -= A[i, c] * x[c]
        x[i] = total / A[i, i]


@kernel
def solve_symmetric_in_place(A: Array, x: Array) -> None:
    """Replace `x` (n,) by A^-1 x and destroy `A` (n, n), symmetric and positive definite: L D L^T in a fixed order.

    Only the lower triangle of `A` is read. A singular matrix gives values that are not finite.
    """
    n = len(x)
    for j in range(n):
        inverse = 1.0 / A[j, j]
        for i in range(j + 1, n):
            factor = A[i, j] * inverse
            for c in range(j + 1, i + 1):
                A[i, c] -= factor * A[c, j]
            x[i] -= factor * x[j]
        for i in range(j + 1, n):
            A[i, j] *= inverse
        x[j] *= inverse
    for back in range(n):
        i = n - 1 - back
        for c in range(i):
            x[c] -= A[i, c] * x[i]
