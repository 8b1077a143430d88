"""Elements of the mass matrix A(q), equations (37)-(46); Sn, Cn, S23 stand for sines and cosines.

Each function takes the constants `k` (34,) and the angles `t`. Where the paper misprints an equation, `printed`
selects the literal reading (1) or the corrected one (0), and the docstring states both. Unit: kg m^2.
"""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.puma560.symbols import (
    I1,
    I2,
    I3,
    I4,
    I5,
    I6,
    I7,
    I8,
    I9,
    I10,
    I11,
    I12,
    I13,
    I14,
    I15,
    I16,
    I17,
    I18,
    I21,
    I22,
    I23,
    IM1,
    IM2,
    IM3,
    IM4,
    IM5,
    IM6,
    Angles,
)


@kernel(inline=True)
def a11(k: Array, t: Angles, printed: int) -> float:
    """Equation (37).

    printed: Im1 + I1 + I3 C2 C2 + I7 S23 S23 + I10 S23 C23 + I11 S2 C2 + I21 S23 S23 + 2 + [I5 C2 S23 + I12 C2 C23 + I15 S23 S23 + I16 C2 S23 + I22 S23 C23]
    corrected: Im1 + I1 + I3 C2 C2 + I7 S23 S23 + I10 S23 C23 + I11 S2 C2 + I21 S23 S23 + 2 [I5 C2 S23 + I12 C2 C23 + I15 S23 S23 + I16 C2 S23 + I22 S23 C23]
    """
    outside = (
        k[IM1]
        + k[I1]
        + k[I3] * t.c2 * t.c2
        + k[I7] * t.s23 * t.s23
        + k[I10] * t.s23 * t.c23
        + k[I11] * t.s2 * t.c2
        + k[I21] * t.s23 * t.s23
    )
    bracket = (
        k[I5] * t.c2 * t.s23
        + k[I12] * t.c2 * t.c23
        + k[I15] * t.s23 * t.s23
        + k[I16] * t.c2 * t.s23
        + k[I22] * t.s23 * t.c23
    )
    if printed:
        return outside + 2.0 + bracket
    return outside + 2.0 * bracket


@kernel(inline=True)
def a12(k: Array, t: Angles) -> float:
    """Equation (38).

    printed: I4 S2 + I8 C23 + I9 C2 + I13 S23 - I18 C23
    """
    return k[I4] * t.s2 + k[I8] * t.c23 + k[I9] * t.c2 + k[I13] * t.s23 - k[I18] * t.c23


@kernel(inline=True)
def a13(k: Array, t: Angles) -> float:
    """Equation (39).

    printed: I8 C23 + I13 S23 - I18 C23
    """
    return k[I8] * t.c23 + k[I13] * t.s23 - k[I18] * t.c23


@kernel(inline=True)
def a22(k: Array, t: Angles, printed: int) -> float:
    """Equation (40).

    printed: Im2 + I2 + I6 + 2 [I5 S3 + I12 C2 + I15 + I16 S3]
    corrected: Im2 + I2 + I6 + 2 [I5 S3 + I12 C3 + I15 + I16 S3]
    """
    cosine = t.c2 if printed else t.c3
    return k[IM2] + k[I2] + k[I6] + 2.0 * (k[I5] * t.s3 + k[I12] * cosine + k[I15] + k[I16] * t.s3)


@kernel(inline=True)
def a23(k: Array, t: Angles) -> float:
    """Equation (41).

    printed: I5 S3 + I6 + I12 C3 + I16 S3 + 2 I15
    """
    return k[I5] * t.s3 + k[I6] + k[I12] * t.c3 + k[I16] * t.s3 + 2.0 * k[I15]


@kernel(inline=True)
def a33(k: Array) -> float:
    """Equation (42).

    printed: Im3 + I6 + 2 I15
    """
    return k[IM3] + k[I6] + 2.0 * k[I15]


@kernel(inline=True)
def a35(k: Array) -> float:
    """Equation (43).

    printed: I15 + I17
    """
    return k[I15] + k[I17]


@kernel(inline=True)
def a44(k: Array) -> float:
    """Equation (44).

    printed: Im4 + I14
    """
    return k[IM4] + k[I14]


@kernel(inline=True)
def a55(k: Array) -> float:
    """Equation (45).

    printed: Im5 + I17
    """
    return k[IM5] + k[I17]


@kernel(inline=True)
def a66(k: Array) -> float:
    """Equation (46).

    printed: Im6 + I23
    """
    return k[IM6] + k[I23]
