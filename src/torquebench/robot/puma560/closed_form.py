"""Assembly of the paper's closed forms: A (36), b (48), C (62), the rows of (61) and (71), G (72).

`literal` (14,) says for each misprinted equation whether it is taken as printed; see `symbols.MISPRINTED`.
The forms hold for the wrist at theta4 = theta5 = 0 and ignore theta4, theta5 and theta6 everywhere.
"""

from __future__ import annotations

from torquebench.kernel import Array, IntArray, kernel
from torquebench.robot.puma560.centrifugal import c12, c13, c21, c23, c31, c32, c51, c52
from torquebench.robot.puma560.coriolis import (
    b112,
    b113,
    b115,
    b123,
    b214,
    b223,
    b235,
    b314,
    b412,
    b413,
    b415,
    b514,
)
from torquebench.robot.puma560.gravity import gravity2, gravity3, gravity5
from torquebench.robot.puma560.inertia import a11, a12, a13, a22, a23, a33, a35, a44, a55, a66
from torquebench.robot.puma560.symbols import (
    E36,
    E37,
    E40,
    E49,
    E50,
    E51,
    E55,
    E58,
    E62,
    E65,
    E67,
    E68,
    E69,
    E71,
    Angles,
    angles,
)


@kernel
def fill_mass_matrix(k: Array, literal: IntArray, q: Array, A: Array) -> None:
    """Fill A (6, 6) [kg m^2] with the mass matrix at q (6,) [rad]."""
    fill_mass_pattern(k, literal, angles(q), A)


@kernel(inline=True)
def fill_mass_pattern(k: Array, literal: IntArray, t: Angles, A: Array) -> None:
    """Fill A (6, 6) [kg m^2] by the pattern (36) from constants k and angles t; as printed, A53 is 0, A35 is not."""
    for i in range(6):
        for j in range(6):
            A[i, j] = 0.0
    A[0, 0] = a11(k, t, literal[E37])
    A[0, 1] = a12(k, t)
    A[1, 0] = A[0, 1]
    A[0, 2] = a13(k, t)
    A[2, 0] = A[0, 2]
    A[1, 1] = a22(k, t, literal[E40])
    A[1, 2] = a23(k, t)
    A[2, 1] = A[1, 2]
    A[2, 2] = a33(k)
    A[2, 4] = a35(k)
    A[4, 2] = 0.0 if literal[E36] else A[2, 4]
    A[3, 3] = a44(k)
    A[4, 4] = a55(k)
    A[5, 5] = a66(k)


@kernel
def fill_coriolis(k: Array, literal: IntArray, q: Array, b: Array) -> None:
    """Fill b (6, 15) [kg m^2] by the pattern (48); columns 12 13 14 15 16 23 24 25 26 34 35 36 45 46 56."""
    t = angles(q)
    for i in range(6):
        for j in range(15):
            b[i, j] = 0.0
    b[0, 0] = b112(k, t, literal[E49])
    b[0, 1] = b113(k, t, literal[E50])
    b[0, 3] = b115(k, t, literal[E51])
    b[0, 5] = b123(k, t)
    b[1, 2] = b214(k, t)
    b[1, 5] = b223(k, t)
    b[1, 7] = 0.0 if literal[E55] else b235(k, t)
    b[1, 10] = b235(k, t)
    b[2, 2] = b314(k, t)
    b[3, 0] = b412(k, t)
    b[3, 1] = b413(k, t, literal[E58])
    b[3, 3] = b415(k, t)
    b[4, 2] = b514(k, t)


@kernel
def fill_centrifugal(k: Array, literal: IntArray, q: Array, C: Array) -> None:
    """Fill C (6, 6) [kg m^2] by the pattern (62)."""
    t = angles(q)
    for i in range(6):
        for j in range(6):
            C[i, j] = 0.0
    C[0, 1] = c12(k, t)
    C[0, 2] = c13(k, t)
    C[1, 0] = c21(k, t, literal[E65])
    C[1, 2] = c23(k, t, literal[E67])
    C[2, 0] = c31(k, t, literal[E68])
    C[2, 1] = c32(k, t, literal[E69])
    C[4, 0] = c51(k, t, literal[E62])
    C[4, 1] = c52(k, t)


@kernel
def fill_gravity(k: Array, q: Array, G: Array) -> None:
    """Fill G (6,) [N m] by (72)."""
    t = angles(q)
    G[0] = 0.0
    G[1] = gravity2(k, t)
    G[2] = gravity3(k, t)
    G[3] = 0.0
    G[4] = gravity5(k, t)
    G[5] = 0.0


@kernel(inline=True)
def bias_rows(k: Array, literal: IntArray, t: Angles, qd: Array, N: Array) -> None:
    """Fill N = b [qd qd] + C [qd^2] + G (6,) [N m] row by row as (61), (71) and (72) have it; constants k, angles t.

    As printed, row 3 of (71) multiplies joint 1's squared speed by c13 instead of c31.
    """
    d1, d2, d3, d4, d5 = qd[0], qd[1], qd[2], qd[3], qd[4]
    b225 = 0.0 if literal[E55] else b235(k, t)
    row3 = c13(k, t) if literal[E71] else c31(k, t, literal[E68])
    N[0] = (
        b112(k, t, literal[E49]) * d1 * d2
        + b113(k, t, literal[E50]) * d1 * d3
        + b115(k, t, literal[E51]) * d1 * d5
        + b123(k, t) * d2 * d3
        + c12(k, t) * d2 * d2
        + c13(k, t) * d3 * d3
    )
    N[1] = (
        b214(k, t) * d1 * d4
        + b223(k, t) * d2 * d3
        + b225 * d2 * d5
        + b235(k, t) * d3 * d5
        + c21(k, t, literal[E65]) * d1 * d1
        + c23(k, t, literal[E67]) * d3 * d3
        + gravity2(k, t)
    )
    N[2] = b314(k, t) * d1 * d4 + row3 * d1 * d1 + c32(k, t, literal[E69]) * d2 * d2 + gravity3(k, t)
    N[3] = b412(k, t) * d1 * d2 + b413(k, t, literal[E58]) * d1 * d3 + b415(k, t) * d1 * d5
    N[4] = b514(k, t) * d1 * d4 + c51(k, t, literal[E62]) * d1 * d1 + c52(k, t) * d2 * d2 + gravity5(k, t)
    N[5] = 0.0


@kernel
def fill_bias(k: Array, literal: IntArray, q: Array, qd: Array, N: Array) -> None:
    """Fill N (6,) [N m] with the bias at position `q` and velocity `qd`; see `bias_rows`."""
    bias_rows(k, literal, angles(q), qd, N)


@kernel
def fill_inverse(k: Array, literal: IntArray, q: Array, qd: Array, qdd: Array, tau: Array) -> None:
    """Fill `tau` (6,) [N m] with A qdd + N at (q, qd), (27), constants k: the nonzero elements of (36) only."""
    t = angles(q)
    bias_rows(k, literal, t, qd, tau)
    d12, d13, d23, d35 = a12(k, t), a13(k, t), a23(k, t), a35(k)
    d53 = 0.0 if literal[E36] else d35
    tau[0] = tau[0] + a11(k, t, literal[E37]) * qdd[0] + d12 * qdd[1] + d13 * qdd[2]
    tau[1] = tau[1] + d12 * qdd[0] + a22(k, t, literal[E40]) * qdd[1] + d23 * qdd[2]
    tau[2] = tau[2] + d13 * qdd[0] + d23 * qdd[1] + a33(k) * qdd[2] + d35 * qdd[4]
    tau[3] = tau[3] + a44(k) * qdd[3]
    tau[4] = tau[4] + d53 * qdd[2] + a55(k) * qdd[4]
    tau[5] = tau[5] + a66(k) * qdd[5]
