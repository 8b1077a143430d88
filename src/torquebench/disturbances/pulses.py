"""Pulses: a torque of a given shape, one level after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.disturbances.kinds import disturbance
from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Units, Vector, as_vector, in_words
from torquebench.timing import Timing, multiple_of, substeps_per_period


@disturbance("pulses")
@dataclass(frozen=True)
class Pulses:
    """Torque size x levels[i] from i hold to (i + 1) hold; none after the last level.

    A bounded torque of any shape, described by numbers: what `torquebench falsify` searches.
    """

    size: Annotated[Vector, Key("Torque at level 1", "N m", ", in N for slide joints")]
    levels: Annotated[tuple[float, ...], Key("Levels, one after the other", "1", wanted="a list of numbers")]
    hold: Annotated[float, Key("Time each level lasts, a whole multiple of run.control_period", "s", above=0)]

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit: levels that do not last whole control periods."""
        if timing.whole:
            period = ("run", "control_period")
            yield from multiple_of(("hold",), self.hold, "run.control_period", timing.control_period, period)

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the torque at each control instant, (N, n) [N m].

        Args:
            n: Number of joints.
            t: Control instants, (N,) [s].
            control_period: Time between them [s].
            rng: Not used.
        """
        steps = len(t)
        if self.hold < steps * control_period:
            steps = substeps_per_period(self.hold, control_period, ("hold", "control_period"))
        shape = np.zeros(len(t))
        held = np.repeat(np.array(self.levels), steps)[: len(t)]
        shape[: len(held)] = held
        torque: Array = np.outer(shape, as_vector(self.size, n))
        return torque

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        shape = f"{len(self.levels)} levels of {1e3 * self.hold:g} ms each"
        return f"pulses of {units.what}, {shape}, {in_words(self.size)} {units.torque} at level 1"
