"""The sound of a film: in each ear the torque of one controller above the motion's band: its chattering."""

from __future__ import annotations

import wave
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from torquebench.kernel import Array
from torquebench.sim.trajectory import Trajectory

RATE = 48_000
"""Samples of sound in a second."""
LOUD = 0.5
"""Peak of the sound, of what a file can hold."""
QUIET = 0.01
"""Torque over its limit that is as loud as that if there is no larger one: what hardly chatters is not amplified."""


def heard(run: Trajectory, limits: Array, control_period: float, from_hz: float) -> Array:
    """Return what is heard of a run, (N,): its torque over the limit, above `from_hz`, of the joint where that is most.

    Of all joints together one would hear less than of one, where they switch against each other.

    Args:
        run: The run.
        limits: Torque limits, (n,) [N m].
        control_period: Time between samples [s].
        from_hz: Lowest frequency that is heard [Hz].
    """
    torque = np.nan_to_num(run.tau / limits)
    torque -= np.linspace(torque[0], torque[-1], len(torque))  # else its two ends, which are neighbours here, click
    lines = np.fft.rfft(torque, axis=0)
    lines[np.fft.rfftfreq(len(torque), control_period) < from_hz] = 0.0
    above: Array = np.fft.irfft(lines, len(torque), axis=0)
    return above[:, np.argmax(np.mean(above * above, axis=0))]


def write_sound(path: Path, ears: Sequence[Array], control_period: float, speed: float, seconds: float) -> None:
    """Write the sound for both ears: each sample is held until the next, as a motor gets it, and silence follows.

    Both are scaled by one number, so that their ratio is that of the torques.

    Args:
        path: The file, ``.wav``.
        ears: What `heard` returned for the left and the right ear.
        control_period: Time between samples [s].
        speed: Simulated seconds in one second of the film; the pitch changes by it.
        seconds: Length of the film [s].
    """
    sample = (np.arange(round(RATE * seconds)) * (speed / RATE / control_period)).astype(np.int64)
    full = LOUD * 32767.0 / max(QUIET, *(float(np.max(np.abs(ear))) for ear in ears))
    tracks = [full * np.append(ear, 0.0)[np.minimum(sample, len(ear))] for ear in ears]
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes(np.stack(tracks, axis=1).round().astype("<i2").tobytes())
