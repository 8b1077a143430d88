"""The budget's verdict: noise raises no false alarm, and what has become 1.5 times slower is found."""

import itertools

import numpy as np

from benchmarks.budget import TOO_MUCH, judged


def failures(factor, spread, runs=3000):
    """Return the share of runs in which a part fails that takes `factor` times what is recorded, under noise."""
    rng = np.random.default_rng(0)
    noisy = (factor * float(np.exp(spread * rng.standard_normal())) for _ in itertools.count())
    return sum(not judged(lambda: next(noisy), TOO_MUCH)[1] for _ in range(runs)) / runs


def test_noise_of_a_tenth_raises_no_alarm():
    """Four of seven ratios above 1.3 by chance: 35 x 0.0044^4, never in 3,000 runs."""
    assert failures(1.0, 0.1) == 0.0


def test_a_part_half_as_slow_again_fails():
    """At a noise of a tenth, 1.5 times slower is found in 98 of 100 runs."""
    assert failures(1.5, 0.1) > 0.98


def test_a_quick_run_is_enough():
    """A part well within its limit runs once."""
    ratios = iter([1.0])
    assert judged(lambda: next(ratios), TOO_MUCH) == (1.0, True)
