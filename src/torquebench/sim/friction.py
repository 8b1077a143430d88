"""Joint friction: a function of velocity, evaluated at every stage of an integrator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from torquebench.kernel import Array, kernel, sat
from torquebench.kernel.struct import Structure

SPEED = 0.01
"""Speed above which Coulomb friction is fully developed [rad/s]."""
STABLE = {"rk4": 2.785, "euler": 2.0}
"""Largest (rate of decay) x (time step) at which an integrator decays: the end of its stability interval."""
POSES = 300


class SteepError(ValueError):
    """Friction is too steep near standstill for the time step."""


@dataclass(frozen=True, eq=False)
class Resistance(Structure):
    """Friction as kernels see it; arrays of no elements stand for none."""

    viscous: Array
    """Viscous friction, (n,) [N m s/rad]."""
    coulomb: Array
    """Coulomb friction, (n,) [N m]."""
    speed: float
    """Speed above which Coulomb friction is fully developed [rad/s]."""


NONE = Resistance(np.zeros(0), np.zeros(0), 1.0)


@kernel
def resist(friction: Resistance, qd: Array, torque: Array, net: Array) -> None:
    """Fill `net` (n,) [N m] with `torque` minus the friction at velocity `qd`: viscous qd + coulomb sat(qd/speed)."""
    for i in range(len(qd)):
        drag = friction.viscous[i] * qd[i] + friction.coulomb[i] * sat(qd[i] / friction.speed)
        net[i] = torque[i] - drag


@dataclass(frozen=True)
class Friction:
    """Viscous and Coulomb friction of the joints, one number for all or one for each.

    tau = -(viscous qd + coulomb sat(qd/speed)): below `speed` Coulomb friction falls linearly to zero, because its sign
    function has no meaning inside a Runge-Kutta step. A joint therefore creeps under a torque that would not move it.

    Raises:
        ValueError: a number is negative or not finite, or the speed is zero.
    """

    viscous: npt.ArrayLike = 0.0
    """Viscous friction [N m s/rad]."""
    coulomb: npt.ArrayLike = 0.0
    """Coulomb friction [N m]."""
    speed: float = SPEED
    """Speed above which Coulomb friction is fully developed [rad/s]."""

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name in ("viscous", "coulomb", "speed"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not (np.all(np.isfinite(values)) and np.all(values >= 0.0)) or (name == "speed" and values == 0.0):
                raise ValueError(f"friction: {name} is {getattr(self, name)}, wanted finite numbers, not negative")

    def of_joints(self, n: int) -> Resistance:
        """Return it for kernels.

        Raises:
            ValueError: it has numbers for another count of joints than `n`.
        """
        each = []
        for name in ("viscous", "coulomb"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape not in ((), (n,)):
                raise ValueError(f"friction: {name} has shape {values.shape}, wanted one number or {n}")
            each.append(np.array(np.broadcast_to(values, (n,))))
            each[-1].setflags(write=False)
        return Resistance(each[0], each[1], float(self.speed))


def poses(n: int) -> Array:
    """Return the positions at which `check_stable` wants the mass matrix, (POSES, n) [rad]."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, n))


def check_stable(friction: Resistance, mass_matrix: Array, timestep: float, integrator: str) -> None:
    """Refuse friction that is too steep near standstill for the time step.

    There it is a damping of viscous + coulomb/speed; the joints' velocities then decay at the eigenvalues of M^-1
    diag(viscous + coulomb/speed), and an explicit integrator can follow a decay only up to `STABLE` per time step.

    Args:
        friction: The friction.
        mass_matrix: At `poses`, (POSES, n, n) [kg m^2].
        timestep: Integration step [s].
        integrator: Name of the integrator.

    Raises:
        SteepError: at one of the poses the decay is faster.
    """
    steep = friction.viscous + friction.coulomb / friction.speed
    rates = np.abs(np.linalg.eigvals(np.linalg.solve(mass_matrix, np.broadcast_to(np.diag(steep), mass_matrix.shape))))
    if (fastest := float(rates.max())) * timestep > STABLE[integrator]:
        raise SteepError(
            f"friction near standstill decays at up to {fastest:.3g} 1/s, too fast for {integrator} at a time step of "
            f"{timestep:g} s, which follows {STABLE[integrator] / timestep:.3g} 1/s: wanted a higher speed than "
            f"{friction.speed:g} rad/s for Coulomb friction, or a shorter time step"
        )
