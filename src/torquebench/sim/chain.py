"""Sensors and actuators between a law and the plant: encoder noise, differentiated velocity, actuator lag."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from torquebench.kernel import Array


@dataclass(frozen=True, slots=True)
class Chain:
    """What lies between a law and the plant; the same on every joint."""

    name: str = "ideal"
    position_sigma: float = 0.0
    """Standard deviation of the noise on each measured position [rad]; the noise itself is drawn before the loop."""
    velocity_rate: float = 0.0
    """Corner of the first-order filter through which the differentiated position passes [rad/s]; 0: exact velocity."""
    lag: float = 0.0
    """Time constant of the actuators [s]; 0: none."""

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
