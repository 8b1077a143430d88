"""The budget's verdict: noise raises no false alarm, and what has become 1.5 times slower is found."""

import itertools

import numpy as np

from benchmarks.budget import PARTS, TOO_MUCH, judged


def failures(factor, spread, runs=3000):
    """Return the share of runs in which a part fails that takes `factor` times what is recorded, under noise."""
    rng = np.random.default_rng(0)
    measured = judged(
        lambda _: factor * float(np.exp(spread * rng.standard_normal())), dict.fromkeys(map(str, range(runs)), TOO_MUCH)
    )
    return sum(not kept for _, _, kept in measured) / runs


def test_noise_of_a_tenth_raises_no_alarm():
    """Four of seven ratios above 1.3 by chance: 35 x 0.0044^4, never in 3,000 runs."""
    assert failures(1.0, 0.1) == 0.0


def test_a_part_half_as_slow_again_fails():
    """At a noise of a tenth, 1.5 times slower is found in 98 of 100 runs."""
    assert failures(1.5, 0.1) > 0.98


def test_a_quick_run_is_enough():
    """A part well within its limit runs once."""
    ratios = iter([1.0])
    assert list(judged(lambda _: next(ratios), {"one": TOO_MUCH})) == [("one", 1.0, True)]


def test_a_loud_minute_raises_no_alarm():
    """A neighbour doubles all times of a round: parts are run again when it is over, not at once."""
    count = itertools.count()
    limits = dict.fromkeys("abcdefgh", TOO_MUCH)
    found = list(judged(lambda _: 2.0 if next(count) < 3 * len(limits) else 1.0, limits))
    assert sorted(name for name, _, kept in found if kept) == sorted(limits)


def test_a_first_run_that_compiles_is_not_counted():
    """Ten times the limit once is no alarm of a part that compiles; of another one it is a ratio like all others."""
    ratios = {"compiles": iter([10.0, 1.0]), "plain": iter([10.0, *[1.0] * 4])}
    limits = dict.fromkeys(ratios, TOO_MUCH)
    found = list(judged(lambda name: next(ratios[name]), limits, ["compiles"]))
    assert found == [("compiles", 1.0, True), ("plain", 1.0, True)]
    assert list(ratios["plain"]) == []
    assert {"check", "sweep", "audit"} == {name for name, part in PARTS.items() if part.compiles}
