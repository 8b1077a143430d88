"""Bias: a constant torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.disturbances.kinds import disturbance
from torquebench.kernel import Array
from torquebench.keys import Key, Units, Vector, as_vector, in_words


@disturbance("bias")
@dataclass(frozen=True)
class Bias:
    """Constant torque."""

    value: Annotated[Vector, Key("Torque", "N m", ", in N for slide joints")]

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the torque of `n` joints at the control instants `t`, (N, n) [N m]; `control_period`, `rng` unused."""
        return np.tile(as_vector(self.value, n), (len(t), 1))

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        return f"constant {units.what} {in_words(self.value)} {units.torque}"
