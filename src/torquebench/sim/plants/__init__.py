"""Plants: the protocol that the loop needs, and the timing that all share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from torquebench.errors import TorquebenchError
from torquebench.kernel import Array
from torquebench.kernel.struct import Structure
from torquebench.robot.robot_model import Passive
from torquebench.timing import substeps_per_period

if TYPE_CHECKING:
    from torquebench.sim.native import NativeFunction

INTEGRATORS = ("rk4", "euler")
"""Classical Runge-Kutta of order 4, and semi-implicit Euler (velocity first)."""


class Plant(Protocol):
    """The truth: a robot whose joints are driven by torques held constant between control instants."""

    n: int
    """Number of joints."""
    timestep: float
    """Integration step [s]."""
    tau_max: Array
    """Torque limits of the actuators, (n,) [N m]."""

    def reset(self, q: Array, qd: Array) -> None:
        """Put the joints at position `q` [rad] and velocity `qd` [rad/s], each (n,)."""
        ...

    def state(self) -> tuple[Array, Array]:
        """Return copies of the joint position [rad] and velocity [rad/s], each (n,)."""
        ...

    def step(self, tau: Array, substeps: int) -> None:
        """Integrate `substeps` time steps; never resets itself.

        Args:
            tau: Joint torque [N m]: constant, (n,), or at the start, in the middle and at the end of each time step,
                (3, n), as a lagging actuator gives it. Euler's method uses the first row.
            substeps: Number of time steps.
        """
        ...

    def replica(self) -> Plant:
        """Return another plant of the same arm that shares nothing it writes to, for another thread."""
        ...


class Bounded(Plant, Protocol):
    """A plant whose run ends where a joint leaves its range; others need none of this."""

    range: Array | None
    """Least and greatest position of each joint, (2, n) [rad], inf where there is no such; None for no such end."""


class Geared(Plant, Protocol):
    """A plant whose motors move relative to its links; others need none of this."""

    sensor: str
    """Side on which position and velocity are measured: ``motor`` or ``link``."""

    def motors(self) -> Array:
        """Return position [rad] and velocity [rad/s] of the motors, (2, n); (0, n) where they are the links'."""
        ...


class Changing(Plant, Protocol):
    """A plant that becomes another arm in the middle of a run; `simulate` tells it when. Others need none of this."""

    changes: tuple[float, ...]
    """Times at which it takes up a payload or a joint of it locks, rising [s]; see `phases_of`."""

    def change(self) -> None:
        """Go on as the next of its arms, from the same position; `reset` makes it the first one again."""
        ...


class NativeError(TorquebenchError):
    """A plant has no native form here; the message says why."""


class NativePlant(NamedTuple):
    """A plant as the compiled loop sees it, from its method ``native()``; a plant without one is interpreted.

    Such a plant has the native function as its attribute ``native_step`` too, whether it is compiled or not.
    """

    step: NativeFunction
    """Native function (structure, torque (3, n), substeps, varying) -> 0; see `STEP_SIGNATURE`."""
    structure: Structure
    """The structure that the function works on; kept alive by this tuple."""
    q: Array
    """The plant's position, advanced by the function, (n,) [rad]."""
    qd: Array
    """The plant's velocity, likewise, (n,) [rad/s]."""
    later: tuple[Structure, ...] = ()
    """The structures that take its place, one after the other, when the plant changes; with the same `q` and `qd`."""
    motors: Array | None = None
    """Position and velocity of motors that move relative to the links, likewise, (2, n); (0, n) where none do."""


def check_own(plant: Plant, known: type[Any]) -> None:
    """Refuse to compile an instance of a subclass, whose methods may differ from the compiled ones.

    Raises:
        NativeError: `plant` is an instance of a subclass of `known`.
    """
    if type(plant) is not known:
        raise NativeError(f"the plant is a {type(plant).__name__}; only a {known.__name__} itself has a native form")


def instants_of_change(plant: Plant, control_period: float, n_steps: int) -> tuple[int, ...]:
    """Return the control instants at which a plant changes; see `Changing`.

    Args:
        plant: The plant; its attribute ``changes`` is asked for, where it has one.
        control_period: Time between control instants [s].
        n_steps: Number of control instants.

    Raises:
        ValueError: a time is not one of a control instant of the run.
    """
    found = []
    for time in getattr(plant, "changes", ()):
        found.append(
            substeps_per_period(time, control_period, ("the time at which the plant changes", "control_period"))
        )
        if found[-1] >= n_steps:
            raise ValueError(f"the plant changes at {time:g} s, wanted a time before the end of the run")
    return tuple(found)


def stages(tau: Array) -> tuple[Array, Array, Array]:
    """Return the torque at the start, in the middle and at the end of a time step, from what `Plant.step` takes."""
    return (tau, tau, tau) if tau.ndim == 1 else (tau[0], tau[1], tau[2])


def range_of(passive: Passive) -> Array:
    """Return the least and the greatest position of each joint, (2, n) [rad]."""
    return np.array([passive.low, passive.high])


def check_scheme(timestep: float, integrator: str, transmission: object = None) -> None:
    """Refuse a time step or an integrator no plant can use, or that its joints' own states cannot.

    Raises:
        ValueError: the time step is not finite and positive, or the integrator is unknown or does not go with them.
    """
    substeps_per_period(timestep, timestep, ("timestep", "timestep"))
    if integrator not in INTEGRATORS:
        raise ValueError(f"integrator is {integrator!r}, wanted one of {', '.join(INTEGRATORS)}")
    if transmission is not None and integrator != "rk4":
        raise ValueError(f"integrator is {integrator!r}, wanted 'rk4' where joints have a transmission")
