"""Raised sine: a motion that swings from its origin and back, at rest when it starts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.kernel import Array
from torquebench.keys import Key, Vector
from torquebench.references.reference import Motion, Reference, each_joint, reference


@reference("sine")
@dataclass(frozen=True)
class Sine(Motion):
    """Raised sine A/2 (1 - cos 2 pi f t), from its origin and at rest there at t = 0."""

    amplitude: Annotated[Vector, Key("Peak-to-peak excursion A of each joint", "rad", ", in m for slide joints")]
    frequency_hz: Annotated[Vector, Key("Frequency f of each joint", "Hz", at_least=0)]

    def highest_hz(self) -> float:
        """Return the frequency of the fastest joint [Hz]."""
        return float(np.max(self.frequency_hz))

    @property
    def swings_hz(self) -> tuple[float, ...]:
        """Frequencies of the joints [Hz]."""
        return tuple(sorted({float(f) for f in np.atleast_1d(self.frequency_hz) if f > 0.0}))

    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion of `n` joints at times (N,) [s]."""
        half, w = each_joint(self.amplitude, n) / 2.0, 2.0 * math.pi * each_joint(self.frequency_hz, n)
        phase = t[:, None] * w
        position = self.placed(half * (1.0 - np.cos(phase)), n)
        return Reference(position, half * w * np.sin(phase), half * w * w * np.cos(phase))
