"""Band-limited noise: a Gaussian torque, each value held for a while."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from torquebench.disturbances.kinds import disturbance
from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Units, Vector, as_vector, in_words
from torquebench.timing import Timing, multiple_of, substeps_per_period

NOTHING = 1e-9
"""RMS torques below are what rounding leaves of none [N m]."""


def band_limited_noise(
    sigma: Array, hold_steps: int, n_steps: int, rng: np.random.Generator, clip_sigma: float = 3.0
) -> Array:
    """Zero-order-held Gaussian torque: the reading of "band limited white noise" used here.

    Each value is held for `hold_steps` control periods, giving the power spectrum sinc^2(f hold): -3 dB at
    0.44/hold, first side lobe -13 dB. In Simulink's block the noise power is sigma^2 hold.

    Args:
        sigma: Standard deviation before clipping, (n,) [N m].
        hold_steps: Control periods each value lasts, at least 1.
        n_steps: Number of control instants N.
        rng: Source of all randomness.
        clip_sigma: Values are clipped at this many standard deviations.

    Returns:
        Torque at each control instant, (N, n) [N m].
    """
    blocks = -(-n_steps // hold_steps)
    values = np.minimum(np.maximum(rng.standard_normal((blocks, len(sigma))), -clip_sigma), clip_sigma) * sigma
    return np.repeat(values, hold_steps, axis=0)[:n_steps]


@disturbance("band-limited-noise")
@dataclass(frozen=True)
class BandLimitedNoise:
    """Gaussian torque, each value held for a while.

    A value is drawn for each joint every `hold` seconds; see `band_limited_noise`.
    """

    is_random: ClassVar[bool] = True
    sigma: Annotated[
        Vector | None, Key("Standard deviation before clipping, unless relative gives it", "N m", at_least=0)
    ] = None
    hold: Annotated[float, Key("Time each value lasts, a whole multiple of run.control_period", "s", above=0)] = 0.01
    clip_sigma: Annotated[float, Key("Values are clipped at this many standard deviations", "1", above=0)] = 3.0
    relative: Annotated[
        float | None,
        Key(
            "Standard deviation as a share of the RMS torque of the motion: of the exact inverse dynamics of the arm, "
            "without load and friction, along the reference over the whole run; stored as sigma, to four digits",
            "1",
            above=0,
        ),
    ] = None

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit: two sizes, none, or a value that does not last whole control periods."""
        if self.sigma is None and self.relative is None:
            yield Fault(("sigma",), "missing", wanted="a value [N m], or relative, a share of the motion's", at="key")
        elif self.sigma is not None and self.relative is not None:
            yield Fault(("relative",), "sigma is given already", wanted="one of the two", at="key")
        if timing.whole:
            period = ("run", "control_period")
            yield from multiple_of(("hold",), self.hold, "run.control_period", timing.control_period, period)

    def sized(self, rms: Array) -> BandLimitedNoise:
        """Return the noise with `sigma` in place of `relative`.

        Args:
            rms: RMS torque of the motion, (n,) [N m].
        """
        if self.relative is None:
            return self
        sigma = tuple(float(f"{self.relative * x:.4g}") if x > NOTHING else 0.0 for x in rms)
        return replace(self, sigma=sigma, relative=None)

    def hold_steps(self, n_steps: int, control_period: float) -> int:
        """Return for how many control periods [s] one value lasts, at most the whole run of `n_steps`.

        Raises:
            ValueError: it is not a whole number of them.
        """
        if self.hold >= n_steps * control_period:
            return n_steps
        return substeps_per_period(self.hold, control_period, ("hold", "control_period"))

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the torque at each control instant, (N, n) [N m].

        Args:
            n: Number of joints.
            t: Control instants, (N,) [s].
            control_period: Time between them [s].
            rng: Source of all randomness.

        Raises:
            ValueError: its size is relative still.
        """
        if self.sigma is None:
            raise ValueError("relative noise has no size before `sized` gives it one, as the check of a config does")
        hold = self.hold_steps(len(t), control_period)
        return band_limited_noise(as_vector(self.sigma, n), hold, len(t), rng, self.clip_sigma)

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        held = f"{units.what} noise held {1e3 * self.hold:g} ms"
        size = f"sigma {in_words(self.sigma or 0.0)} {units.torque}, clipped at {self.clip_sigma:g} sigma"
        return f"{held}, Gaussian, {size}"
