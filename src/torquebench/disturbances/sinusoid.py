"""Sinusoid: a torque that swings at one frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.disturbances.kinds import disturbance
from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Units, Vector, as_vector, in_words
from torquebench.timing import Timing


@disturbance("sinusoid")
@dataclass(frozen=True)
class Sinusoid:
    """Torque a sin(2 pi f t), held from each control instant to the next."""

    amplitude: Annotated[Vector | None, Key("Amplitude a, unless rms gives it", "N m", ", in N for slide joints")] = (
        None
    )
    rms: Annotated[
        Vector | None, Key("Root mean square of the torque, a/sqrt(2), unless amplitude is given", "N m", at_least=0)
    ] = None
    frequency_hz: Annotated[Vector, Key("Frequency f, less than half of 1/run.control_period", "Hz", above=0)] = 1.0

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit: two sizes, none, or a frequency that cannot be sampled."""
        if self.amplitude is None and self.rms is None:
            yield Fault((), "missing: amplitude, or rms (size of the sinusoid [N m])")
        elif self.amplitude is not None and self.rms is not None:
            yield Fault(("rms",), "amplitude is given already", wanted="one of the two", at="key")
        highest = max(self.frequency_hz) if isinstance(self.frequency_hz, tuple) else self.frequency_hz
        most = 0.5 / timing.control_period
        if highest >= most:
            wanted = f"less than half of 1/run.control_period, {most:g} Hz"
            yield Fault(("frequency_hz",), got=f"{highest:g} Hz", wanted=wanted, unless=("run", "control_period"))

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the torque of `n` joints at the control instants `t`, (N, n) [N m]; `control_period`, `rng` unused."""
        size = as_vector(self.amplitude or 0.0, n) + math.sqrt(2.0) * as_vector(self.rms or 0.0, n)
        return size * np.sin(2.0 * np.pi * np.outer(t, as_vector(self.frequency_hz, n)))

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        of = "RMS" if self.amplitude is None else "amplitude"
        size = f"{of} {in_words(self.rms or 0.0 if self.amplitude is None else self.amplitude)}"
        return f"sinusoidal {units.what}, {size} {units.torque}, {in_words(self.frequency_hz)} Hz"
