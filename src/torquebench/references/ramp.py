"""Ramp: constant speed from its origin to a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from torquebench.kernel import Array
from torquebench.keys import Key, Vector
from torquebench.references.reference import ROUNDING, Motion, Reference, reference


@reference("ramp")
@dataclass(frozen=True)
class Ramp(Motion):
    """Constant speed from its origin to the target, then held; a run may end before the target is reached."""

    has_corners: ClassVar[bool] = True
    target: Annotated[Vector, Key("Final position of each joint", "rad", ", in m for slide joints")]
    rise_time: Annotated[float, Key("Time from the origin to the target", "s", above=0)]

    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion of `n` joints at times (N,) [s]; the desired acceleration is zero."""
        goal = self.way(self.target, n)
        x = np.clip(t / self.rise_time, 0.0, 1.0)[:, None]
        moving = (t < self.rise_time - ROUNDING)[:, None]
        velocity = np.where(moving, goal / self.rise_time, 0.0)
        return Reference(self.placed(x * goal, n), velocity, np.zeros((len(t), len(goal))))
