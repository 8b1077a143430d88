"""Forward kinematics, equations (10)-(22): as printed, and repaired.

`fill_pose_printed` follows the printed brackets and numbers literally; the result is not a rotation. The repaired
equations describe the same arm as the dynamics in other joint coordinates: the arm's theta are
(theta1, -theta2, pi - theta3, theta4, theta5 + pi, theta6) there. Both give the wrist centre; `fill_pose` adds
Table 2's d6 along the approach vector and so gives the tool frame.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from torquebench.kernel import Array, kernel
from torquebench.robot.puma560.constants import Geometry


class Pose(NamedTuple):
    """Sines and cosines of the six joint angles, and of theta2 + theta3, as (11)-(22) use them."""

    s1: float
    c1: float
    s2: float
    c2: float
    s23: float
    c23: float
    s4: float
    c4: float
    s5: float
    c5: float
    s6: float
    c6: float


@kernel
def pose_angles(t1: float, t2: float, t3: float, t4: float, t5: float, t6: float) -> Pose:
    """Return the sines and cosines for joint angles t1..t6 [rad]."""
    return Pose(
        math.sin(t1),
        math.cos(t1),
        math.sin(t2),
        math.cos(t2),
        math.sin(t2 + t3),
        math.cos(t2 + t3),
        math.sin(t4),
        math.cos(t4),
        math.sin(t5),
        math.cos(t5),
        math.sin(t6),
        math.cos(t6),
    )


@kernel
def fill_pose_printed(lengths: Geometry, q: Array, T: Array) -> None:
    """Fill T (4, 4) [-, m] with (10)-(22) as printed, with their own lengths, at theta = q (6,) [rad].

    (11) has sin1 sin1 where the other rows have sin4 sin1; in (11), (12), (14), (15) the bracket opened after the
    first factor closes after the theta6 term; (20) takes the cosine of theta2 cos(theta1); (21) has 0.4312.
    """
    p = pose_angles(q[0], q[1], q[2], q[3], q[4], q[5])
    s1, c1, s2, c2, s23, c23, s4, c4, s5, c5, s6, c6 = p
    T[0, 0] = c6 * (c5 * (c4 * c23 * c1 + s1 * s1) + s5 * s23 * c1 + s6 * (s4 * c23 * c1 - c4 * s1))
    T[1, 0] = c6 * (c5 * (c4 * c23 * s1 - s4 * c1) + s5 * s23 * s1 + s6 * (s4 * c23 * s1 + c4 * c1))
    T[2, 0] = c6 * (c5 * c4 * s23 - s5 * c23) + s6 * s4 * s23
    T[0, 1] = -s6 * (c5 * (c4 * c23 * c1 + s4 * s1) + s5 * s23 * c1 + c6 * (s4 * c23 * c1 - c4 * s1))
    T[1, 1] = -s6 * (c5 * (c4 * c23 * s1 - s4 * c1) + s5 * s23 * s1 + c6 * (s4 * c23 * s1 + c4 * c1))
    T[2, 1] = -s6 * (c5 * c4 * s23 - s5 * c23) + c6 * s4 * s23
    T[0, 2] = s5 * (c4 * c23 * c1 + s4 * s1) - c5 * s23 * c1
    T[1, 2] = s5 * (c4 * c23 * s1 - s4 * c1) - c5 * s23 * s1
    T[2, 2] = s5 * c4 * s23 + c5 * c23
    T[0, 3] = 0.4331 * s23 * c1 + 0.0203 * c23 * c1 - 0.1491 * s1 + 0.4318 * math.cos(q[1] * c1)
    T[1, 3] = 0.4331 * s23 * s1 + 0.0203 * c23 * s1 + 0.1491 * c1 + 0.4312 * c2 * s1
    T[2, 3] = -0.4331 * c23 + 0.0203 * s23 + 0.4318 * s2
    T[3, 0] = T[3, 1] = T[3, 2] = 0.0
    T[3, 3] = 1.0


@kernel
def fill_wrist_repaired(p: Pose, lengths: Geometry, T: Array) -> None:
    """Fill T (4, 4) [-, m] with (10)-(22), repaired, in the equations' own joint coordinates, of angles `p`.

    Their a3 is positive, as the paper prints it: 0.4318, 0.0203, 0.1491 and 0.4331 are a2, a3, d2 and d4.
    """
    a2, a3, d2, d4 = lengths.a2, -lengths.a3, lengths.d2, lengths.d4
    s1, c1, s2, c2, s23, c23, s4, c4, s5, c5, s6, c6 = p
    T[0, 0] = c6 * (c5 * (c4 * c23 * c1 + s4 * s1) + s5 * s23 * c1) + s6 * (s4 * c23 * c1 - c4 * s1)
    T[1, 0] = c6 * (c5 * (c4 * c23 * s1 - s4 * c1) + s5 * s23 * s1) + s6 * (s4 * c23 * s1 + c4 * c1)
    T[2, 0] = c6 * (c5 * c4 * s23 - s5 * c23) + s6 * s4 * s23
    T[0, 1] = -s6 * (c5 * (c4 * c23 * c1 + s4 * s1) + s5 * s23 * c1) + c6 * (s4 * c23 * c1 - c4 * s1)
    T[1, 1] = -s6 * (c5 * (c4 * c23 * s1 - s4 * c1) + s5 * s23 * s1) + c6 * (s4 * c23 * s1 + c4 * c1)
    T[2, 1] = -s6 * (c5 * c4 * s23 - s5 * c23) + c6 * s4 * s23
    T[0, 2] = s5 * (c4 * c23 * c1 + s4 * s1) - c5 * s23 * c1
    T[1, 2] = s5 * (c4 * c23 * s1 - s4 * c1) - c5 * s23 * s1
    T[2, 2] = s5 * c4 * s23 + c5 * c23
    T[0, 3] = d4 * s23 * c1 + a3 * c23 * c1 - d2 * s1 + a2 * c2 * c1
    T[1, 3] = d4 * s23 * s1 + a3 * c23 * s1 + d2 * c1 + a2 * c2 * s1
    T[2, 3] = -d4 * c23 + a3 * s23 + a2 * s2
    T[3, 0] = T[3, 1] = T[3, 2] = 0.0
    T[3, 3] = 1.0


@kernel
def fill_pose(lengths: Geometry, q: Array, T: Array) -> None:
    """Fill T (4, 4) [-, m] with the tool frame at joint position `q` (6,) [rad], by the repaired equations.

    Args:
        lengths: The arm's lengths; a3 with the sign of the dynamics (negative).
        q: Joint position in the coordinates of the dynamics.
        T: Result.
    """
    p = pose_angles(q[0], -q[1], math.pi - q[2], q[3], q[4] + math.pi, q[5])
    fill_wrist_repaired(p, lengths, T)
    for i in range(3):
        T[i, 3] += lengths.d6 * T[i, 2]
