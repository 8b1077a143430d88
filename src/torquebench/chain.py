"""Sensors and actuators between a law and the plant: noise, rounding, differentiation and delay; actuator lag."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from torquebench.disturbances import Stream, generator
from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Units, check_numbers
from torquebench.registry import Registry
from torquebench.timing import Timing, control_instant, substeps_per_period


@dataclass(frozen=True)
class Chain:
    """Sensors and actuators, each imperfection by itself; the same on every joint.

    Raises:
        ValueError: a number is negative or not finite, or there is no such kind of velocity.
    """

    encoder_noise: Annotated[
        float,
        Key(
            "Standard deviation of the noise added to each measured position at each control instant",
            "rad",
            at_least=0,
        ),
    ] = 0.0
    quantisation: Annotated[
        float,
        Key(
            "Step of the encoders: the measured position, noise included, is rounded to a whole multiple of it; 0 for "
            "none",
            "rad",
            at_least=0,
        ),
    ] = 0.0
    velocity: Annotated[
        Literal["exact", "differentiated"],
        Key(
            "Measured velocity: exact is the true one; differentiated is the change of the measured position since the "
            "last control instant over run.control_period, zero at first"
        ),
    ] = "exact"
    velocity_filter: Annotated[
        float | None,
        Key(
            "Corner of a first-order filter through which the differentiated velocity passes; if left out there is "
            "none",
            "rad/s",
            above=0,
        ),
    ] = None
    delay: Annotated[
        float,
        Key(
            "Time after which the law sees a measurement, less than run.duration and a whole multiple of "
            "run.control_period; until then it sees that of t = 0",
            "s",
            at_least=0,
        ),
    ] = 0.0
    actuator_lag: Annotated[float, Key("Time constant of the actuators; 0 for none", "s", at_least=0)] = 0.0
    name: str = "custom"
    """Name under which it is registered."""

    def __post_init__(self) -> None:
        """Refuse sizes that mean nothing."""
        check_numbers(self)
        if self.velocity not in ("exact", "differentiated"):
            raise ValueError(f"chain: velocity is {self.velocity!r}, wanted exact or differentiated")

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the chain, or the run."""
        if self.velocity == "exact" and self.velocity_filter is not None:
            text = "has no effect with velocity: exact (it belongs to velocity: differentiated)"
            yield Fault(("velocity_filter",), text, at="key")
        yield from control_instant(("delay",), self.delay, timing)

    def noise(self, n: int, n_steps: int, seed: int, draw: int) -> Array | None:
        """Draw the noise of the encoders, (N, n) [rad]; None where they have none.

        Args:
            n: Number of joints.
            n_steps: Number of control instants N.
            seed, draw: Key of the random stream; see `generator`.
        """
        if self.encoder_noise == 0.0:
            return None
        noise: Array = generator(seed, draw, Stream.POSITION_NOISE).standard_normal((n_steps, n))
        noise *= self.encoder_noise
        return noise

    def velocity_gain(self, control_period: float) -> float:
        """Return a of the filter v += a (dq/T - v), a = 1 - exp(-rate T); 1 without a filter, 0 for exact velocity."""
        if self.velocity == "exact":
            return 0.0
        return 1.0 if self.velocity_filter is None else 1.0 - math.exp(-self.velocity_filter * control_period)

    def reaction(self, control_period: float) -> float:
        """Return the time from a change of the state to the torque that answers it [s].

        The control period, the delay, and the time constants of the velocity's filter and of the actuators.

        Args:
            control_period: Control period T [s].
        """
        filtering = 0.0 if self.velocity_filter is None else 1.0 / self.velocity_filter
        return control_period + self.delay + filtering + self.actuator_lag

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
        lag = self.actuator_lag
        if lag == 0.0:
            return np.zeros(0)
        mean = -math.expm1(-control_period / lag) * lag / control_period
        return np.array([math.exp(-0.5 * timestep / lag), math.exp(-timestep / lag), mean])

    def delay_steps(self, control_period: float) -> int:
        """Return the delay in control periods.

        Raises:
            ValueError: it is not a whole number of them.
        """
        if self.delay == 0.0:
            return 0
        return substeps_per_period(self.delay, control_period, ("the chain's delay", "control_period"))

    def describe(self, units: Units) -> str:
        """Return its name, or its imperfections in one line."""
        if self.name in CHAINS:
            return self.name
        parts = [f"noise {1e3 * self.encoder_noise:g} {units.milli}"] * (self.encoder_noise > 0)
        parts += [f"encoder step {1e3 * self.quantisation:g} {units.milli}"] * (self.quantisation > 0)
        if self.velocity == "differentiated":
            filtered = "" if self.velocity_filter is None else f", filtered at {self.velocity_filter:g} rad/s"
            parts.append(f"velocity differentiated{filtered}")
        parts += [f"delay {1e3 * self.delay:g} ms"] * (self.delay > 0)
        parts += [f"actuator lag {1e3 * self.actuator_lag:g} ms"] * (self.actuator_lag > 0)
        return f"({', '.join(parts)})" if parts else "ideal"


CHAINS: Registry[Chain] = Registry("chain")
"""The chains that configs name."""


def chain(name: str) -> Callable[[Callable[[], Chain]], Callable[[], Chain]]:
    """Register the chain that a function returns under `name`.

    Raises:
        RegistryError: the name is taken, or is not a slug.
    """

    def register(make: Callable[[], Chain]) -> Callable[[], Chain]:
        CHAINS.register(name, replace(make(), name=name), make)
        return make

    return register


@chain("ideal")
def ideal() -> Chain:
    """Exact and instantaneous."""
    return Chain()


@chain("fast")
def fast() -> Chain:
    """Position with noise of 0.1 mrad, velocity differentiated and filtered at 500 rad/s, actuators lagging by 2 ms."""
    return Chain(encoder_noise=1e-4, velocity="differentiated", velocity_filter=500.0, actuator_lag=0.002)


@chain("slow")
def slow() -> Chain:
    """The same noise, velocity filtered at 200 rad/s, actuators lagging by 8 ms."""
    return Chain(encoder_noise=1e-4, velocity="differentiated", velocity_filter=200.0, actuator_lag=0.008)


IDEAL = CHAINS["ideal"]
