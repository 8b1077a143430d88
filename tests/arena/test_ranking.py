"""Who is better: the interval of a ratio, ties, failures, and that no name counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from torquebench.arena.ranking import Scores, best_at, compare, fails_more, is_open, rank, verdict
from torquebench.arena.record import looks_at
from torquebench.statistics import paired_ratio

RNG = np.random.default_rng(11)


def drawn(level: float, tuning: float, draws: int = 10, seeds: int = 3, noise: float = 0.1) -> Scores:
    """Return scores around a level, with a spread of tunings, one of draws in common and one of single runs."""
    logs = math.log(level) + tuning * RNG.standard_normal((seeds, 1, 1)) + noise * RNG.standard_normal((1, 2, draws))
    return Scores(np.exp(logs + 0.02 * RNG.standard_normal((seeds, 2, draws))))


def with_failures(scores: Scores, count: int) -> Scores:
    """Return scores of which every tuning fails in the first draws of the first condition."""
    values = scores.values.copy()
    values[:, 0, :count] = np.nan
    return Scores(values)


def test_one_tuning_has_the_interval_of_paired_draws() -> None:
    """With one tuning and one condition the ratio is that of `paired_ratio`, which is tested by itself."""
    a, b = (np.exp(RNG.standard_normal((1, 1, 12))) for _ in range(2))
    found, known = compare(Scores(a), Scores(b)), paired_ratio(a.ravel().tolist(), b.ravel().tolist())
    assert found[:3] == pytest.approx(known[:3], rel=1e-12)
    assert found[3:] == known[3:]


def test_tunings_have_the_interval_of_welch() -> None:
    """Where draws do not spread, the interval is Welch's of the means of the tunings, by scipy."""
    logs = RNG.standard_normal((2, 4))
    a, b = (Scores(np.exp(np.repeat(own[:, None, None], 5, axis=2))) for own in logs)
    known = stats.ttest_ind(*logs, equal_var=False).confidence_interval(0.95)
    assert np.log(compare(a, b)[1:3]) == pytest.approx([known.low, known.high], rel=1e-9)


def test_exchanging_two_laws_scores_exchanges_their_ranks() -> None:
    """Ranks go by scores alone: whichever entry has the worst ones is last, whatever its name."""
    own = {"fuzzy-linear-band-smc": drawn(1.0, 0.01), "pid": drawn(2.0, 0.01), "smc": drawn(4.0, 0.01)}
    assert rank(own) == {"fuzzy-linear-band-smc": (1, 1), "pid": (2, 2), "smc": (3, 3)}
    own["fuzzy-linear-band-smc"], own["smc"] = own["smc"], own["fuzzy-linear-band-smc"]
    assert rank(own) == {"fuzzy-linear-band-smc": (3, 3), "pid": (2, 2), "smc": (1, 1)}


def test_the_same_law_twice_ties() -> None:
    """A null arena has no winner."""
    own = drawn(1.0, 0.3)
    assert rank({"one": own, "other": own}) == {"one": (1, 2), "other": (1, 2)}
    ratio = compare(own, own)
    assert ratio.ratio == 1.0
    assert ratio.low < 1.0 < ratio.high


def test_null_arenas_are_decided_wrongly_in_one_of_twenty_at_most() -> None:
    """Of 400 pairs that differ by chance alone, tunings and draws, at most 5 % have a winner (+ 3 sigma, 3.3 %)."""
    for tuning in (0.0, 0.1, 0.5):
        wrong = 0
        for _ in range(400):
            a, b = drawn(1.0, tuning), drawn(1.0, tuning)
            wrong += verdict(a, b) != 0
        assert wrong <= 0.083 * 400, (tuning, wrong)


def test_a_difference_below_the_spread_of_tunings_is_a_tie() -> None:
    """5 % less error is a win where tunings agree and none where they differ by 20 %, whatever the draws say."""
    base = np.exp(0.1 * RNG.standard_normal((1, 2, 20)))
    for spread, wins in ((1.001, True), (1.2, False)):
        factors = np.array([1.0 / spread, 1.0, spread])[:, None, None]
        a, b = Scores(0.95 * base * factors), Scores(base * factors)
        assert (verdict(a, b), verdict(b, a)) == (int(wins), -int(wins))


def test_failures_are_counted_and_never_averaged() -> None:
    """Who fails in more runs by more than chance is behind, however small the error; a few failures decide nothing."""
    good, bad = drawn(1.0, 0.0), drawn(5.0, 0.0)
    assert rank({"a": with_failures(good, 8), "b": bad}) == {"a": (2, 2), "b": (1, 1)}
    assert rank({"a": with_failures(good, 3), "b": bad}) == {"a": (1, 1), "b": (2, 2)}
    never = good._replace(values=np.full_like(good.values, np.nan))
    assert math.isnan(compare(never, bad).ratio)
    assert rank({"a": never, "b": bad}) == {"a": (2, 2), "b": (1, 1)}
    # six of six that differ: p = 2/64 < 5 %, five of five: 2/32 > 5 %
    assert fails_more(with_failures(good, 6), good)
    assert not fails_more(with_failures(good, 5), good)


def test_a_failure_hides_no_other_run() -> None:
    """Who fails in a condition is compared in the others, exactly as if it were not there, whatever it would show."""
    good, bad = drawn(1.0, 0.05), drawn(10.0, 0.05)
    found = compare(with_failures(bad, 10), good)
    a, b = (scores._replace(values=scores.values[:, 1:]) for scores in (bad, good))
    assert found[:4] == pytest.approx(compare(a, b)[:4], rel=1e-12)
    one = with_failures(bad, 10)._replace(once=frozenset({0}))  # one run, of a condition in which nothing is random
    assert rank({"good": good._replace(once=frozenset({0})), "fails": one}) == {"good": (1, 1), "fails": (2, 2)}


def test_a_tuning_that_misses_a_hard_condition_is_no_better_one() -> None:
    """Errors are a hundred times as large in one condition; a tuning that fails there leaves tunings alike."""
    b = np.ones((3, 2, 10)) * np.array([1.0, 100.0])[:, None]
    a = 0.5 * b
    a[0, 1] = np.nan
    assert compare(Scores(a), Scores(b))[:3] == pytest.approx((0.5, 0.5, 0.5), rel=1e-9)


def with_fragile_tunings(scores: Scores, share: float) -> Scores:
    """Return scores of which some tunings, drawn by chance, fail in every draw of the first condition."""
    values = scores.values.copy()
    values[share > RNG.random(len(values)), 0] = np.nan
    return Scores(values)


def test_tunings_that_fail_by_chance_decide_nothing() -> None:
    """Of 100 pairs whose tunings are fragile with the same chance at most 5 % have a winner (+ 3 sigma, 6.5 %).

    One tuning of three that fails makes a law no worse, though it fails in all draws; it keeps it from being better.
    """
    pairs = [[with_fragile_tunings(drawn(1.0, 0.1), 0.3) for _ in "ab"] for _ in range(100)]
    assert sum(verdict(a, b) != 0 for a, b in pairs) <= 11
    base = np.ones((3, 2, 10))
    values = 0.9 * base
    values[0, 0] = np.nan
    fragile, whole = Scores(values), Scores(base)
    assert rank({"fragile": fragile, "whole": whole}) == {"fragile": (1, 2), "whole": (1, 2)}


LOOKS = looks_at(30, 3)


def stopped(a: Scores, b: Scores) -> Scores:
    """Return what is left of a pair that is looked at until it is decided, or no draw will decide it."""
    return next((a.first(n) for n in LOOKS if not is_open(a.first(n), b.first(n), looks=3)), a)


def test_draws_are_looked_at_each_time_after_twice_as_many() -> None:
    """The last look is after all draws, the first one after two at least; one look is a fixed number of draws."""
    assert LOOKS == [8, 15, 30]
    assert looks_at(30, 1) == [30]
    assert looks_at(5, 8) == [2, 3, 5]


def test_null_arenas_that_stop_when_decided_are_wrong_in_one_of_twenty_at_most() -> None:
    """Of 402 pairs that differ by chance alone at most 5 % have a winner (+ 3 sigma, 3.3 %), looked at three times."""
    pairs = [(drawn(1.0, tuning, 30), drawn(1.0, tuning, 30)) for tuning in (0.0, 0.1, 0.5) for _ in range(134)]
    assert sum(verdict(stopped(a, b), b, looks=3) != 0 for a, b in pairs) <= 33


def test_stopping_when_decided_takes_half_the_draws() -> None:
    """Of pairs that differ by a third or so, tunings by some per cent, 15 of 30 draws at most decide, and as before.

    Nine of ten verdicts are those of all 30 draws, and none is the opposite.
    """
    draws, same = list[int](), 0
    for level in np.exp(0.3 * RNG.standard_normal(200)):
        a, b = drawn(float(level), 0.05, 30), drawn(1.0, 0.05, 30)
        short, whole = verdict(stopped(a, b), b, looks=3), verdict(a, b)
        draws.append(stopped(a, b).values.shape[2])
        same += short == whole
        assert short * whole >= 0
    assert np.mean(draws) <= 15
    assert same >= 180


def test_no_draw_is_asked_for_where_tunings_differ_by_more() -> None:
    """A tie within the spread of tunings is closed; one within that of draws is open; a decided pair is closed."""
    base = np.exp(0.1 * RNG.standard_normal((1, 2, 8)))
    other = np.exp(0.1 * RNG.standard_normal((1, 2, 8)))
    spread = np.array([0.5, 1.0, 2.0])[:, None, None]
    assert not is_open(Scores(base * spread), Scores(other * spread))
    alike = np.ones((3, 1, 1))
    assert is_open(Scores(base * alike), Scores(other * alike))
    assert not is_open(Scores(9.0 * base * alike), Scores(other * alike))
    failing = with_failures(Scores(base * alike), 3)  # p = 1/4, and tunings that are alike
    assert is_open(failing, Scores(base * alike))


def test_the_least_error_at_no_more_chattering_is_picked() -> None:
    """A level is a bound; what failed is never picked, and nothing where all chatter more."""
    points = [(1.0, 9.0), (2.0, 4.0), (3.0, 1.0), (0.5, math.nan)]
    assert [best_at(points, level) for level in (0.6, 1.0, 2.5, 9.0)] == [None, 0, 1, 2]
