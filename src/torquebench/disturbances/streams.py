"""Random numbers by key: each use has a stream of its own, and each draw can be had again alone."""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """One independent random stream for each use, so that adding a use does not shift the others."""

    MISMATCH = 0
    TORQUE_NOISE = 1
    POSITION_NOISE = 2
    PERTURBATION = 3
    SWEEP = 4
    VELOCITY_NOISE = 5
    DEADLINES = 6


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
