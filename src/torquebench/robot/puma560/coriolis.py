"""Elements of the Coriolis matrix b(q), equations (49)-(60); Sn, Cn, S23, S223 stand for sines and cosines.

Each function takes the constants `k` (34,) and the angles `t`. Where the paper misprints an equation, `printed`
selects the literal reading (1) or the corrected one (0), and the docstring states both. Unit: kg m^2.
"""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.puma560.symbols import (
    I3,
    I5,
    I7,
    I8,
    I10,
    I11,
    I12,
    I13,
    I14,
    I15,
    I16,
    I17,
    I18,
    I19,
    I20,
    I21,
    I22,
    Angles,
)


@kernel(inline=True)
def b112(k: Array, t: Angles, printed: int) -> float:
    """Equation (49).

    printed: 2 [- I3 S2 C2 + I5 C223 + I7 S23 C23 - I12 S223 - I15 2 S23 C23 + I16 C223 + I21 S23 C23 + I22 (1 - 2 S23 S23)] + I10 (1 - 2 S23 S23) + I11 (1 - 2 S2 S2)
    corrected: 2 [- I3 S2 C2 + I5 C223 + I7 S23 C23 - I12 S223 + I15 2 S23 C23 + I16 C223 + I21 S23 C23 + I22 (1 - 2 S23 S23)] + I10 (1 - 2 S23 S23) + I11 (1 - 2 S2 S2)
    """
    i15 = -k[I15] if printed else k[I15]
    cos46 = 1.0 - 2.0 * t.s23 * t.s23
    bracket = (
        -k[I3] * t.s2 * t.c2
        + k[I5] * t.c223
        + k[I7] * t.s23 * t.c23
        - k[I12] * t.s223
        + i15 * 2.0 * t.s23 * t.c23
        + k[I16] * t.c223
        + k[I21] * t.s23 * t.c23
        + k[I22] * cos46
    )
    return 2.0 * bracket + k[I10] * cos46 + k[I11] * (1.0 - 2.0 * t.s2 * t.s2)


@kernel(inline=True)
def b113(k: Array, t: Angles, printed: int) -> float:
    """Equation (50).

    printed: 2 [I5 C2 C23 + I7 S23 C23 - I12 C2 S22 + I15 2 S23 C23 + I16 C2 C23 + I21 S23 C23 + I22 (1 - 2 S23 S23)] + I10 (1 - 2 S23 S23)
    corrected: 2 [I5 C2 C23 + I7 S23 C23 - I12 C2 S23 + I15 2 S23 C23 + I16 C2 C23 + I21 S23 C23 + I22 (1 - 2 S23 S23)] + I10 (1 - 2 S23 S23)
    """
    sine = 2.0 * t.s2 * t.c2 if printed else t.s23
    cos46 = 1.0 - 2.0 * t.s23 * t.s23
    bracket = (
        k[I5] * t.c2 * t.c23
        + k[I7] * t.s23 * t.c23
        - k[I12] * t.c2 * sine
        + k[I15] * 2.0 * t.s23 * t.c23
        + k[I16] * t.c2 * t.c23
        + k[I21] * t.s23 * t.c23
        + k[I22] * cos46
    )
    return 2.0 * bracket + k[I10] * cos46


@kernel(inline=True)
def b115(k: Array, t: Angles, printed: int) -> float:
    """Equation (51).

    printed: 2 [- S23 C23 + I15 2 S23 C23 + I16 C2 C23 + I22 C23 C23]
    corrected: 2 [- I20 S23 C23 + I15 S23 C23 + I16 C2 C23 + I22 C23 C23]
    """
    rest = k[I16] * t.c2 * t.c23 + k[I22] * t.c23 * t.c23
    if printed:
        return 2.0 * (-t.s23 * t.c23 + k[I15] * 2.0 * t.s23 * t.c23 + rest)
    return 2.0 * (-k[I20] * t.s23 * t.c23 + k[I15] * t.s23 * t.c23 + rest)


@kernel(inline=True)
def b123(k: Array, t: Angles) -> float:
    """Equation (52).

    printed: 2 [- I8 S23 + I13 C23 + I18 S23]
    """
    return 2.0 * (-k[I8] * t.s23 + k[I13] * t.c23 + k[I18] * t.s23)


@kernel(inline=True)
def b214(k: Array, t: Angles) -> float:
    """Equation (53).

    printed: I14 S23 + I19 S23 + 2 I20 S23 (1 - 0.5)
    """
    return k[I14] * t.s23 + k[I19] * t.s23 + 2.0 * k[I20] * t.s23 * 0.5


@kernel(inline=True)
def b223(k: Array, t: Angles) -> float:
    """Equation (54).

    printed: 2 [- I12 S3 + I5 C3 + I16 C3]
    """
    return 2.0 * (-k[I12] * t.s3 + k[I5] * t.c3 + k[I16] * t.c3)


@kernel(inline=True)
def b235(k: Array, t: Angles) -> float:
    """Equation (55); b225, which (48) and (61) use and nothing defines, has the same value.

    printed: 2 [I16 C3 + I22]
    """
    return 2.0 * (k[I16] * t.c3 + k[I22])


@kernel(inline=True)
def b314(k: Array, t: Angles) -> float:
    """Equation (56).

    printed: 2 [I20 S23 (1 - 0.5)] + I14 S23 + I19 S23
    """
    return 2.0 * (k[I20] * t.s23 * 0.5) + k[I14] * t.s23 + k[I19] * t.s23


@kernel(inline=True)
def b412(k: Array, t: Angles) -> float:
    """Equation (57); its label also says b412 = b214, which its own right side contradicts.

    printed: - [I14 S23 + I19 S23 + 2 I20 S23 (1 - 0.5)]
    """
    return -(k[I14] * t.s23 + k[I19] * t.s23 + 2.0 * k[I20] * t.s23 * 0.5)


@kernel(inline=True)
def b413(k: Array, t: Angles, printed: int) -> float:
    """Equation (58).

    printed: - 2 [I20 S23 (1 - 0.5)] + I14 S23 + I19 S23
    corrected: - [2 [I20 S23 (1 - 0.5)] + I14 S23 + I19 S23]
    """
    if printed:
        return -2.0 * (k[I20] * t.s23 * 0.5) + k[I14] * t.s23 + k[I19] * t.s23
    return -(2.0 * (k[I20] * t.s23 * 0.5) + k[I14] * t.s23 + k[I19] * t.s23)


@kernel(inline=True)
def b415(k: Array, t: Angles) -> float:
    """Equation (59).

    printed: - I20 S23 - I17 S23
    """
    return -k[I20] * t.s23 - k[I17] * t.s23


@kernel(inline=True)
def b514(k: Array, t: Angles) -> float:
    """Equation (60).

    printed: I20 S23 + I17 S23
    """
    return k[I20] * t.s23 + k[I17] * t.s23
