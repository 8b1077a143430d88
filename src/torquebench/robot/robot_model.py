"""Analytic models of arms for users: checked shapes, leading batch axes, one method per term of the dynamics."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array, kernel
from torquebench.kernel.twin import map_states
from torquebench.robot import dynamics
from torquebench.robot.flat_model import EXACT, Model
from torquebench.robot.rigid_body import place_frames


class Passive(NamedTuple):
    """Friction and limits of the joints in an arm's file, one number for each: plants have them, laws never do."""

    viscous: tuple[float, ...]
    """Viscous friction [N m s/rad]."""
    coulomb: tuple[float, ...]
    """Coulomb friction [N m]."""
    low: tuple[float, ...]
    """Least position [rad]; -inf for none."""
    high: tuple[float, ...]
    """Greatest position [rad]; inf for none."""
    speed: tuple[float, ...]
    """Greatest speed [rad/s]; inf for none."""

    @property
    def rubs(self) -> bool:
        """Whether there is any friction."""
        return any((*self.viscous, *self.coulomb))


def nothing_passive(n: int) -> Passive:
    """Return what a file says that knows neither friction nor limits of its `n` joints."""
    return Passive((0.0,) * n, (0.0,) * n, (-math.inf,) * n, (math.inf,) * n, (math.inf,) * n)


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


class RobotModel:
    """Analytic model of a serial arm; every method takes (n,) or (..., n) arrays and returns new arrays.

    Frames: joint angles as in the model's files, base frame z up. One object must not be used by two threads.

    Attributes:
        name: Name of the model.
        joint_names: Names of the joints, base first.
        flat: What the kernels and laws receive.
        passive: Friction and limits of the joints, which are no part of `flat`.
    """

    def __init__(self, name: str, joint_names: tuple[str, ...], flat: Model, passive: Passive | None = None) -> None:
        self.name = name
        self.joint_names = joint_names
        self.flat = flat
        self.passive = nothing_passive(len(joint_names)) if passive is None else passive

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}, {self.n} joints>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.flat.armature)

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """Mass matrix M(q), armature included, (..., n, n) [kg m^2].

        Args:
            q: Joint position, (..., n) [rad].

        Raises:
            ValueError: the last axis is not n long, or a value is not finite; so in every method.
        """
        return self._map(dynamics.mass_matrix, (self.n, self.n), q=q)

    def coriolis(self, q: npt.ArrayLike) -> Array:
        """Coriolis matrix b(q) of (26), (..., n, n(n-1)/2) [kg m^2], columns 12, 13, .., 1n, 23, .. as in (32).

        Args:
            q: Joint position, (..., n) [rad].
        """
        return self._products(q)[0]

    def centrifugal(self, q: npt.ArrayLike) -> Array:
        """Centrifugal matrix C(q) of (26), (..., n, n) [kg m^2].

        Args:
            q: Joint position, (..., n) [rad].
        """
        return self._products(q)[1]

    def gravity(self, q: npt.ArrayLike) -> Array:
        """Torque g(q) that holds the arm still, (..., n) [N m].

        Args:
            q: Joint position, (..., n) [rad].
        """
        return self._map(dynamics.gravity, (self.n,), q=q)

    def bias_forces(self, q: npt.ArrayLike, qd: npt.ArrayLike) -> Array:
        """Torque N(q, qd) for zero acceleration: Coriolis, centrifugal and gravity, (25), (..., n) [N m].

        Args:
            q: Joint position, (..., n) [rad].
            qd: Joint velocity, (..., n) [rad/s].
        """
        return self._map(dynamics.bias_forces, (self.n,), q=q, qd=qd)

    def inverse_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike) -> Array:
        """Torque M(q) qdd + N(q, qd) that produces the acceleration `qdd`, (27), (..., n) [N m].

        Args:
            q: Joint position, (..., n) [rad].
            qd: Joint velocity, (..., n) [rad/s].
            qdd: Joint acceleration, (..., n) [rad/s^2].
        """
        return self._map(dynamics.inverse_dynamics, (self.n,), q=q, qd=qd, qdd=qdd)

    def sliding_terms(self, q: Array, qd: Array, s: Array) -> tuple[Array, Array, Array]:
        """Return M(q), (N, n, n) [kg m^2], C(q, qd) s with the C of Christoffel's symbols, and g(q), (N, n) [N m].

        Args:
            q, qd, s: Position [rad], velocity [rad/s] and sliding variable [rad/s], (N, n).
        """
        if self.flat.structure != EXACT:
            g = self.gravity(q)
            turning = self.bias_forces(q, qd + s) - self.bias_forces(q, qd) - self.bias_forces(q, s)
            return self.mass_matrix(q), 0.5 * (turning + g), g
        states, n = self._checked(q=q, qd=qd, s=s)[0], self.n
        rows = dynamics.sliding_terms_of_each
        M, turning, g = map_states(dynamics.sliding_terms, self.flat, states, (n, n), (n,), (n,), rows=rows)
        return M, turning, g

    def forward_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, tau: npt.ArrayLike) -> Array:
        """Acceleration M(q)^-1 (tau - N(q, qd)), (30), (..., n) [rad/s^2].

        Args:
            q: Joint position, (..., n) [rad].
            qd: Joint velocity, (..., n) [rad/s].
            tau: Joint torque, (..., n) [N m].
        """
        return self._map(dynamics.forward_dynamics, (self.n,), q=q, qd=qd, tau=tau)

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool frame in the base frame, homogeneous, (..., 4, 4) [-, m].

        Args:
            q: Joint position, (..., n) [rad].
        """
        return self._map(tool_pose, (4, 4), q=q)

    def _products(self, q: npt.ArrayLike) -> tuple[Array, Array]:
        states, lead = self._checked(q=q)
        n = self.n
        b, C = map_states(dynamics.velocity_products, self.flat, states, (n, n * (n - 1) // 2), (n, n))
        return b.reshape(*lead, *b.shape[1:]), C.reshape(*lead, *C.shape[1:])

    def _map(self, kernel: Callable[..., None], shape: tuple[int, ...], **arguments: Any) -> Array:
        states, lead = self._checked(**arguments)
        # the matrix of a closed form is solved with pivots
        pivots = kernel is dynamics.forward_dynamics and self.flat.structure != EXACT
        return map_states(kernel, self.flat, states, shape, branches=pivots)[0].reshape(*lead, *shape)

    def _checked(self, **arguments: Any) -> tuple[list[Array], tuple[int, ...]]:
        arrays = {name: np.asarray(value, dtype=np.float64) for name, value in arguments.items()}
        for name, array in arrays.items():
            if array.ndim < 1 or array.shape[-1] != self.n:
                raise ValueError(f"{name} has shape {array.shape}, wanted (..., {self.n})")
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{name} has values that are not finite")
        lead = np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
        flat = [np.ascontiguousarray(np.broadcast_to(a, (*lead, self.n))).reshape(-1, self.n) for a in arrays.values()]
        return flat, lead
