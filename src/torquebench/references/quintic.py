"""Quintic: the minimum-jerk motion from its origin to a target."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Vector
from torquebench.references.reference import Motion, Reference, reference
from torquebench.timing import RELATIVE, Timing


@reference("quintic")
@dataclass(frozen=True)
class Quintic(Motion):
    """Minimum-jerk polynomial from its origin to the target, then held.

    10x^3 - 15x^4 + 6x^5 of the way, x = t / rise_time.
    """

    is_step_like: ClassVar[bool] = True
    target: Annotated[Vector, Key("Final position of each joint", "rad", ", in m for slide joints")]
    rise_time: Annotated[float, Key("Time from the origin to the target, at most run.duration", "s", above=0)]

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where the run ends before the target is reached."""
        if self.rise_time > timing.duration * (1.0 + RELATIVE):
            wanted = f"at most run.duration, {timing.duration:.12g} s"
            reason = "the metrics of the motion would be measured against a target that is never reached"
            yield Fault(("rise_time",), got=f"{self.rise_time:.12g} s", wanted=f"{wanted}: {reason}")

    def highest_hz(self) -> float:
        """Return the frequency of one swing of the acceleration, which takes the whole rise time [Hz]."""
        return 1.0 / self.rise_time

    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion of `n` joints at times (N,) [s]."""
        goal, rise_time = self.way(self.target, n), self.rise_time
        x = np.clip(t / rise_time, 0.0, 1.0)[:, None]
        position = x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
        velocity = 30.0 * x * x * (1.0 - x) * (1.0 - x) / rise_time
        acceleration = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (rise_time * rise_time)
        return Reference(self.placed(position * goal, n), velocity * goal, acceleration * goal)
