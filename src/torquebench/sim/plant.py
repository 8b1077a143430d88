"""What the loop asks of a plant: the protocol, and the timing every plant shares."""

from __future__ import annotations

import math
from typing import Protocol

from torquebench.kernel import Array

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
        """Integrate `substeps` time steps under the constant joint torque `tau` (n,) [N m]; never resets itself."""
        ...


def check_scheme(timestep: float, integrator: str) -> None:
    """Refuse a time step or an integrator no plant can use.

    Raises:
        ValueError: the time step is not finite and positive, or the integrator is unknown.
    """
    substeps_per_period(timestep, timestep, ("timestep", "timestep"))
    if integrator not in INTEGRATORS:
        raise ValueError(f"integrator is {integrator!r}, wanted one of {', '.join(INTEGRATORS)}")


def substeps_per_period(
    control_period: float, timestep: float, names: tuple[str, str] = ("control_period", "timestep")
) -> int:
    """Return how many time steps make one control period.

    Args:
        control_period: Time between control instants [s].
        timestep: Integration step [s].
        names: What the caller calls the two, for messages.

    Raises:
        ValueError: either is not finite and positive, or the ratio is not a whole number.
    """
    for name, value in zip(names, (control_period, timestep), strict=True):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}, wanted a finite positive number of seconds")
    ratio = control_period / timestep
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > 1e-9 * ratio:
        raise ValueError(
            f"{names[0]} {control_period} s is not a whole multiple of {names[1]} {timestep} s "
            f"(nearest: {max(whole, 1) * timestep:.12g} s)"
        )
    return whole
