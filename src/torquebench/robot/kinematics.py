"""Forward kinematics of a serial arm: the tool frame by multiplying link poses."""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.model import Model
from torquebench.robot.rigid_body import place_frames


@kernel
def tool_pose(model: Model, q: Array, T: Array) -> None:
    """Fill `T` (4, 4) with the tool frame in the base frame at joint position `q` (n,): rotation and origin [m]."""
    place_frames(model, q)
    n = len(q)
    for r in range(4):
        for c in range(4):
            T[r, c] = 1.0 if r == c else 0.0
    for i in range(n + 1):
        R = model.scratch.rotation[i] if i < n else model.tool_rotation
        p = model.scratch.offset[i] if i < n else model.tool_offset
        for r in range(3):
            x, y, z = T[r, 0], T[r, 1], T[r, 2]
            T[r, 3] += x * p[0] + y * p[1] + z * p[2]
            for c in range(3):
                T[r, c] = x * R[0, c] + y * R[1, c] + z * R[2, c]
