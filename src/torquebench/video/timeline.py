"""Which stored sample each frame shows: exact numbers of frames, and the range of a signal between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.errors import VideoError
from torquebench.kernel import Array, IntArray
from torquebench.video.settings import FPS

MOST_FRAMES = 100_000
"""More than an hour of film."""


class Timeline(NamedTuple):
    """Frames of a film: frame i shows the sample nearest to ``i * speed / FPS``."""

    frames: int
    """Number of frames: that of the run's duration at this speed, rounded, at least one."""
    speed: float
    """Simulated seconds shown in one second."""
    control_period: float
    """Time between samples [s]."""

    def time(self, frame: float) -> float:
        """Return the simulated time of a frame [s]."""
        return frame * self.speed / FPS

    def samples(self, per_frame: int = 1) -> IntArray:
        """Return the index of the sample shown at each of `per_frame` instants a frame, (frames * per_frame,)."""
        frame, part = np.divmod(np.arange(self.frames * per_frame), per_frame)
        within = part * (self.speed / FPS / per_frame)
        times = frame * self.speed / FPS + within  # a frame has its own time whatever per_frame is
        return np.asarray(np.floor(times / self.control_period + 0.5), dtype=np.int64)


def timeline(duration: float, speed: float, control_period: float) -> Timeline:
    """Return the frames of a run.

    Args:
        duration: Length of the run [s].
        speed: Simulated seconds shown in one second.
        control_period: Time between samples [s].

    Raises:
        VideoError: the film would be longer than `MOST_FRAMES`.
    """
    if duration / speed * FPS > MOST_FRAMES:
        slowest = duration * FPS / MOST_FRAMES
        raise VideoError(
            f"{duration:g} s at speed {speed:g} are too long a film: wanted a --speed of {slowest:.3g} or more"
        )
    return Timeline(max(1, round(duration / speed * FPS)), speed, control_period)


def ranges(values: Array, samples: IntArray) -> tuple[Array, Array]:
    """Return the least and the greatest value of a signal from each of `samples` up to the one before the next.

    Args:
        values: Signal, (N, n).
        samples: Indices in rising order, (M,); where two are equal the range is that of one sample. Those beyond
            the signal's end give NaN.

    Returns:
        Two arrays (M, n).
    """
    inside = int(np.searchsorted(samples, len(values)))
    low, high = (np.full((len(samples), values.shape[1]), np.nan) for _ in range(2))
    if inside:
        low[:inside] = np.fmin.reduceat(values, samples[:inside], axis=0)
        high[:inside] = np.fmax.reduceat(values, samples[:inside], axis=0)
        if inside == len(samples):  # the last stretch ends with the film, not with the signal
            low[-1] = high[-1] = values[samples[-1]]
    return low, high
