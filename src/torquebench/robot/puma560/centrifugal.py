"""Elements of the centrifugal matrix C(q), equations (63)-(70), by the slot of (62) they fill.

The labels of (66)-(69) are each one slot early: "c22" is c23, "c23" is c31, "c31" is c32 and "c32" is c51. With
`printed` = 1 a slot holds what the paper prints under that slot's label. Unit: kg m^2.
"""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.puma560.coriolis import b112, b113, b115, b123, b223, b235
from torquebench.robot.puma560.symbols import I4, I5, I8, I9, I12, I13, I16, I18, Angles


@kernel(inline=True)
def c12(k: Array, t: Angles) -> float:
    """Equation (63).

    printed: I4 C2 - I8 S23 - I9 S2 + I13 C23 + I18 S23
    """
    return k[I4] * t.c2 - k[I8] * t.s23 - k[I9] * t.s2 + k[I13] * t.c23 + k[I18] * t.s23


@kernel(inline=True)
def c13(k: Array, t: Angles) -> float:
    """Equation (64), 0.5 b123.

    printed: - I8 S23 + I13 C23 + I18 S23
    """
    return 0.5 * b123(k, t)


@kernel(inline=True)
def c21(k: Array, t: Angles, printed: int) -> float:
    """Equation (65), -0.5 b112; it repeats the wrong sign of I15 of (49).

    printed: I3 S2 C2 - I5 C223 - I7 S23 C23 + I12 S223 + I15 2 S23 C23 - I16 C223 - I21 S23 C23 - I22 (1 - 2 S23 S23) - 0.5 I10 (1 - 2 S23 S23) - 0.5 I11 (1 - 2 S2 S2)
    corrected: I3 S2 C2 - I5 C223 - I7 S23 C23 + I12 S223 - I15 2 S23 C23 - I16 C223 - I21 S23 C23 - I22 (1 - 2 S23 S23) - 0.5 I10 (1 - 2 S23 S23) - 0.5 I11 (1 - 2 S2 S2)
    """
    return -0.5 * b112(k, t, printed)


@kernel(inline=True)
def c23(k: Array, t: Angles, printed: int) -> float:
    """Slot (2, 3): equation (67) carries its label, equation (66) its value.

    printed: - I5 C2 C23 - I7 S23 C23 + I12 C2 S23 - I15 2 S23 C23 - I16 C2 C23 - I21 S23 C23 - I22 (1 - 2 S23 S23) - 0.5 I10 (1 - 2 S23 S23)
    corrected: - I12 S3 + I5 C3 + I16 C3
    """
    if printed:
        return -0.5 * b113(k, t, 0)
    return 0.5 * b223(k, t)


@kernel(inline=True)
def c31(k: Array, t: Angles, printed: int) -> float:
    """Slot (3, 1): equation (68) carries its label, equation (67) its value.

    printed: I12 S3 - I5 C3 - I16 C3
    corrected: - I5 C2 C23 - I7 S23 C23 + I12 C2 S23 - I15 2 S23 C23 - I16 C2 C23 - I21 S23 C23 - I22 (1 - 2 S23 S23) - 0.5 I10 (1 - 2 S23 S23)
    """
    if printed:
        return k[I12] * t.s3 - k[I5] * t.c3 - k[I16] * t.c3
    return -0.5 * b113(k, t, 0)


@kernel(inline=True)
def c32(k: Array, t: Angles, printed: int) -> float:
    """Slot (3, 2): equation (69) carries its label, equation (68) its value.

    printed: S23 C23 - I15 2 S23 C23 - I16 C2 C23 - I22 C23 C23
    corrected: I12 S3 - I5 C3 - I16 C3
    """
    if printed:
        return -0.5 * b115(k, t, 1)
    return -c23(k, t, 0)


@kernel(inline=True)
def c51(k: Array, t: Angles, printed: int) -> float:
    """Slot (5, 1): (62) and (71) use it, nothing defines it; equation (69), repaired, is its value.

    printed: 0
    corrected: I20 S23 C23 - I15 S23 C23 - I16 C2 C23 - I22 C23 C23
    """
    if printed:
        return 0.0
    return -0.5 * b115(k, t, 0)


@kernel(inline=True)
def c52(k: Array, t: Angles) -> float:
    """Equation (70), -0.5 b225.

    printed: - I16 C3 - I22
    """
    return -0.5 * b235(k, t)
