"""Joint friction: a function of velocity, evaluated at every stage of an integrator."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from torquebench.errors import Fault
from torquebench.kernel import Array, kernel, sat
from torquebench.kernel.struct import Structure
from torquebench.keys import Key, Units, Vector, in_words
from torquebench.registry import Registry
from torquebench.robot.robot_model import Passive
from torquebench.timing import Timing

SPEED = 0.01
"""Speed above which Coulomb friction is fully developed [rad/s]."""
SPEEDS = tuple(factor * 10.0**power for power in range(-2, 2) for factor in (1.0, 2.0, 5.0))
"""Such speeds for the friction that an arm has of its own: the least that the integrator can follow [rad/s]."""
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
    """Friction of the joints, of which the belief knows nothing: viscous qd + coulomb sat(qd/speed).

    One number for all joints, or one for each; an array is as good. Below `speed` Coulomb friction falls linearly to
    zero, because its sign function has no meaning inside a Runge-Kutta step. A joint therefore creeps under a torque
    that would not move it.

    Raises:
        ValueError: a number is negative or not finite, or the speed is zero.
    """

    viscous: Annotated[
        Vector,
        Key(
            "Viscous friction",
            "N m s/rad",
            ", in N s/m for slide joints; of the PUMA 5.8 9.3 4.0 .36 .36 .22",
            at_least=0,
        ),
    ] = 0.0
    coulomb: Annotated[
        Vector, Key("Coulomb friction", "N m", ", in N for slide joints; of the PUMA 26 14 6.5 1.0 1.3 0.7", at_least=0)
    ] = 0.0
    speed: Annotated[
        float,
        Key(
            "Speed above which Coulomb friction is fully developed; below it falls linearly to zero, so that a joint "
            "at rest creeps",
            "rad/s",
            ", in m/s for slide joints",
            above=0,
        ),
    ] = SPEED

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name in ("viscous", "coulomb", "speed"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if not (np.all(np.isfinite(values)) and np.all(values >= 0.0)) or (name == "speed" and values == 0.0):
                raise ValueError(f"friction: {name} is {getattr(self, name)}, wanted finite numbers, not negative")

    @property
    def name(self) -> str:
        """The word for it in a config, if there is one."""
        return "none" if self == FRICTIONS["none"] else ""

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where there is no friction."""
        given = any(any(x if isinstance(x, tuple) else (x,)) for x in (self.viscous, self.coulomb))
        if self is not FRICTIONS["none"] and not given:
            yield Fault((), "neither viscous nor coulomb is given: write none, or leave it out for the arm's own")

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        if self.name:
            return "no friction"
        coulomb = f"Coulomb {in_words(self.coulomb)} {units.torque}"
        return f"friction viscous {in_words(self.viscous)} {units.viscous}, {coulomb}"

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


FRICTIONS: Registry[Friction] = Registry("friction")
"""Friction by a word: none, whatever the arm's file says."""
FRICTIONS.register("none", Friction())


def acting(
    given: Friction | None, own: Passive, masses: Callable[[Array], Array], timestep: float, integrator: str
) -> tuple[Friction | None, Resistance]:
    """Return the friction of a plant's joints, also for kernels: the given one, else the arm's own.

    Coulomb friction of its own is fully developed above the least of `SPEEDS` that the integrator can follow.

    Args:
        given: What is asked for; None for what the arm's file says.
        own: What the arm's file says.
        masses: Returns the mass matrices at positions (N, n), (N, n, n) [kg m^2].
        timestep, integrator: Integration step [s] and the integrator's name.

    Raises:
        SteepError: it is too steep near standstill for the time step.
    """
    n = len(own.viscous)
    if given is None and not own.rubs:
        return None, NONE
    M = masses(poses(n))
    if given is not None:
        check_stable(given.of_joints(n), M, timestep, integrator)
        return given, given.of_joints(n)
    viscous, coulomb = (each[0] if len(set(each)) == 1 else each for each in (own.viscous, own.coulomb))
    friction = Friction(viscous, coulomb)
    for speed in SPEEDS if any(own.coulomb) else ():
        friction = replace(friction, speed=speed)
        if decay(friction.of_joints(n), M) * timestep <= STABLE[integrator]:
            break
    try:
        check_stable(friction.of_joints(n), M, timestep, integrator)
    except SteepError as error:
        raise SteepError(f"of the arm's own: {error}, or `friction: none`") from error
    return friction, friction.of_joints(n)


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
    if (fastest := decay(friction, mass_matrix)) * timestep > STABLE[integrator]:
        raise SteepError(
            f"friction near standstill decays at up to {fastest:.3g} 1/s, too fast for {integrator} at a time step of "
            f"{timestep:g} s, which follows {STABLE[integrator] / timestep:.3g} 1/s: wanted a higher speed than "
            f"{friction.speed:g} rad/s for Coulomb friction, or a shorter time step"
        )


def decay(friction: Resistance, mass_matrix: Array) -> float:
    """Return the fastest decay of a joint's velocity near standstill [1/s]; arguments as of `check_stable`."""
    steep = friction.viscous + friction.coulomb / friction.speed
    rates = np.abs(np.linalg.eigvals(np.linalg.solve(mass_matrix, np.broadcast_to(np.diag(steep), mass_matrix.shape))))
    return float(rates.max())
