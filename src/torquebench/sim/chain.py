"""Sensors and actuators between a law and the plant: noise, rounding, differentiation and delay; actuator lag."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from torquebench.kernel import Array
from torquebench.sim.plants import substeps_per_period


@dataclass(frozen=True, slots=True)
class Chain:
    """What lies between a law and the plant; the same on every joint.

    Raises:
        ValueError: a number is negative or not finite; `velocity_rate` alone may be infinite.
    """

    name: str = "ideal"
    position_sigma: float = 0.0
    """Standard deviation of the noise on each measured position [rad]; the noise itself is drawn before the loop."""
    velocity_rate: float = 0.0
    """Corner of the first-order filter through which the differentiated position passes [rad/s]; 0: exact velocity;
    infinite: no filter, the velocity is the backward difference itself."""
    lag: float = 0.0
    """Time constant of the actuators [s]; 0: none."""
    quantum: float = 0.0
    """Step of the encoders [rad]: the position, noise included, is rounded to a multiple of it; 0: not rounded."""
    delay: float = 0.0
    """Time after which the law sees a measurement [s], a whole number of control periods; until then it sees the
    measurement of t = 0."""

    def __post_init__(self) -> None:
        """Refuse sizes that mean nothing."""
        for key in ("position_sigma", "velocity_rate", "lag", "quantum", "delay"):
            value = getattr(self, key)
            if not (value >= 0.0 and (math.isfinite(value) or key == "velocity_rate")):
                raise ValueError(f"chain: {key} is {value}, wanted a finite number, at least 0")

    def velocity_gain(self, control_period: float) -> float:
        """Return a of the filter v += a (dq/T - v), a = 1 - exp(-rate T); 0 for exact velocity."""
        return 1.0 - math.exp(-self.velocity_rate * control_period) if self.velocity_rate > 0.0 else 0.0

    def decay(self, timestep: float, control_period: float) -> Array:
        """Return what is left of an actuator's lag after half a physics step, a whole one, and on average.

        u(t) = tau + (u(0) - tau) exp(-t/lag); its mean over a control period T has (lag/T) (1 - exp(-T/lag)) in
        place of the exponential.

        Args:
            timestep: Physics step [s].
            control_period: Control period T [s].

        Returns:
            (3,), or (0,) for an ideal actuator.
        """
        if self.lag == 0.0:
            return np.zeros(0)
        mean = -math.expm1(-control_period / self.lag) * self.lag / control_period
        return np.array([math.exp(-0.5 * timestep / self.lag), math.exp(-timestep / self.lag), mean])

    def delay_steps(self, control_period: float) -> int:
        """Return the delay in control periods.

        Raises:
            ValueError: it is not a whole number of them.
        """
        if self.delay == 0.0:
            return 0
        return substeps_per_period(self.delay, control_period, ("the chain's delay", "control_period"))


IDEAL = Chain()
CHAINS = {
    chain.name: chain
    for chain in (
        IDEAL,
        Chain("fast", position_sigma=1e-4, velocity_rate=500.0, lag=0.002),
        Chain("slow", position_sigma=1e-4, velocity_rate=200.0, lag=0.008),
    )
}
"""The chains that configs name."""
