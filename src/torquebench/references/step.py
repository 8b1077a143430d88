"""Step: a constant, then another one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Vector
from torquebench.references.reference import ROUNDING, Motion, Reference, reference
from torquebench.timing import Timing


@reference("step")
@dataclass(frozen=True)
class Step(Motion):
    """The origin, then the target.

    The desired rates are zero throughout.
    """

    metrics_from: ClassVar[float] = 2.0
    is_step_like: ClassVar[bool] = True
    has_corners: ClassVar[bool] = True
    target: Annotated[Vector, Key("Position of each joint after the step", "rad", ", in m for slide joints")]
    at: Annotated[float, Key("Time of the step; less than run.duration", "s", at_least=0)]

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where the run ends before the step."""
        if self.at >= timing.duration:
            wanted = f"less than run.duration, {timing.duration:.12g} s: there would be no step"
            yield Fault(("at",), got=f"{self.at:.12g} s", wanted=wanted)

    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion of `n` joints at times (N,) [s]."""
        goal = self.way(self.target, n)
        zero = np.zeros((len(t), len(goal)))
        position = np.where(t[:, None] >= self.at - ROUNDING, goal, 0.0)
        return Reference(self.placed(position, n), zero, zero.copy())
