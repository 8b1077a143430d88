"""Elements of the gravity vector G(q), equations (73)-(75). Unit: N m."""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.puma560.symbols import G1, G2, G3, G4, G5, Angles


@kernel(inline=True)
def gravity2(k: Array, t: Angles) -> float:
    """Equation (73).

    printed: g1 C2 + g2 S23 + g3 S2 + g4 C23 + g5 S23
    """
    return k[G1] * t.c2 + k[G2] * t.s23 + k[G3] * t.s2 + k[G4] * t.c23 + k[G5] * t.s23


@kernel(inline=True)
def gravity3(k: Array, t: Angles) -> float:
    """Equation (74).

    printed: g2 S23 + g4 C23 + g5 S23
    """
    return k[G2] * t.s23 + k[G4] * t.c23 + k[G5] * t.s23


@kernel(inline=True)
def gravity5(k: Array, t: Angles) -> float:
    """Equation (75).

    printed: g5 S23
    """
    return k[G5] * t.s23
