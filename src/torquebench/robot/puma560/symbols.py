"""Names used by the closed forms: where each constant sits, which equations are misprinted, the angles' sines."""

from __future__ import annotations

import math
from typing import NamedTuple

from torquebench.kernel import Array, kernel

CONSTANTS = tuple([f"I{i}" for i in range(1, 24)] + [f"Im{i}" for i in range(1, 7)] + [f"g{i}" for i in range(1, 6)])
"""Order of the 34 constants of Tables 3 and 4 in `Model.constants`."""

I1, I2, I3, I4, I5, I6, I7, I8, I9, I10, I11, I12 = range(12)
I13, I14, I15, I16, I17, I18, I19, I20, I21, I22, I23 = range(12, 23)
IM1, IM2, IM3, IM4, IM5, IM6 = range(23, 29)
G1, G2, G3, G4, G5 = range(29, 34)

MISPRINTED = ("36", "37", "40", "49", "50", "51", "55", "58", "62", "65", "67", "68", "69", "71")
"""Equations whose printed and corrected forms give different dynamics; order of the flags in `Model.literal`."""

E36, E37, E40, E49, E50, E51, E55, E58, E62, E65, E67, E68, E69, E71 = range(14)


class Angles(NamedTuple):
    """Sines and cosines the closed forms share; 23 stands for theta2 + theta3, 223 for 2 theta2 + theta3."""

    s2: float
    c2: float
    s3: float
    c3: float
    s23: float
    c23: float
    s223: float
    c223: float


@kernel(inline=True)
def angles(q: Array) -> Angles:
    """Return the sines and cosines of the closed forms at joint position `q` (6,) [rad]."""
    s2, c2, s3, c3 = math.sin(q[1]), math.cos(q[1]), math.sin(q[2]), math.cos(q[2])
    s23, c23 = s2 * c3 + c2 * s3, c2 * c3 - s2 * s3
    return Angles(s2, c2, s3, c3, s23, c23, s2 * c23 + c2 * s23, c2 * c23 - s2 * s23)
