"""Torque disturbances, made before the loop; what is random in them comes from keyed seeds."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from torquebench.kernel import Array


class Stream(IntEnum):
    """One independent random stream for each use, so that adding a use does not shift the others."""

    MISMATCH = 0
    TORQUE_NOISE = 1
    POSITION_NOISE = 2
    PERTURBATION = 3
    SWEEP = 4


def generator(seed: int, run: int, stream: Stream, index: int = 0) -> np.random.Generator:
    """Return the random generator of one stream of one run.

    Keyed by ``SeedSequence(seed, spawn_key=(run, stream, index))``: run k is reproduced alone, in any order.

    Args:
        seed: The experiment's seed.
        run: Number of the run (draw) within the experiment.
        stream: What the numbers are for.
        index: Which of several uses of the same kind, in the config's order.
    """
    seeds = np.random.SeedSequence(seed, spawn_key=(run, int(stream), index))
    return np.random.Generator(np.random.PCG64(seeds))


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


def bias(value: Array, n_steps: int) -> Array:
    """Return a constant torque `value` (n,) [N m] at each of `n_steps` control instants, (N, n) [N m]."""
    return np.tile(value, (n_steps, 1))


def sinusoid(amplitude: Array, frequency_hz: Array, t: Array) -> Array:
    """Return amplitude sin(2 pi f t), held from each control instant to the next.

    Args:
        amplitude: Amplitude, sqrt(2) times the RMS, (n,) [N m].
        frequency_hz: Frequency f, (n,) [Hz].
        t: Control instants, (N,) [s].

    Returns:
        Torque at each control instant, (N, n) [N m].
    """
    return amplitude * np.sin(2.0 * np.pi * np.outer(t, frequency_hz))
