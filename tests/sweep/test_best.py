"""The best of a sweep is the least of those that meet what is asked; what failed or is missing is never best."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from tests.sweep.tables import made
from torquebench.errors import ConfigError
from torquebench.sweep.best import best_choices, conditions, short_names
from torquebench.sweep.summary import Summary, summarise

LAM, PHI, MASS = "controllers.*.gains.lam", "controllers.b.gains.phi", "plant.payload.mass"
GRID = {LAM: (10.0, 20.0), PHI: (0.1, 0.3, 1.0), MASS: (0.0, 2.0)}


def run(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float | None] | None:
    """Any figures, the same for the same law, gains and draw; law a has no phi; some runs fail, some lack a figure."""
    own = (values[LAM], values[MASS], values[PHI] if law == "b" else 0.0)
    rng = np.random.default_rng([ord(law), draw, *(int(10 * x) for x in own)])
    if law == "b" and values[PHI] == 0.3 and values[MASS] == 2.0 and draw == 1:
        return None
    chattering = None if law == "b" and values[PHI] == 1.0 and values[LAM] == 10.0 else 10.0 * float(rng.random())
    return {"rmse": 1e-3 * float(rng.lognormal()) * (0.01 if own[2] == 0.3 else 1.0), "chattering": chattering}


def summary() -> Summary:
    """A table of two laws, three keys and five draws, of which law a lacks phi."""
    table = dict(made("ab", 5, run, GRID))
    table[PHI] = np.where(table["controller"] == "a", np.nan, table[PHI])
    return summarise(table)


SUMMARY = summary()


def by_hand(metric: str) -> dict[tuple[str, float, float | None], float]:
    """Return for law, lam and phi the greater of the means under the two masses."""
    found = dict[tuple[str, float, float | None], float]()
    for law, lam, phi in itertools.product("ab", GRID[LAM], GRID[PHI]):
        runs = [[run(law, draw, {LAM: lam, PHI: phi, MASS: mass}) for draw in range(5)] for mass in GRID[MASS]]
        if all(one is not None and one[metric] is not None for own in runs for one in own):
            key = (law, lam, phi if law == "b" else None)
            found[key] = max(float(np.mean([one[metric] for one in own])) for own in runs)  # type: ignore[index, misc]
    return found


@pytest.mark.parametrize("limit", [None, 3.0, 5.0, 7.0])
def test_the_best_is_the_least_that_meets_the_constraint(limit: float | None) -> None:
    """In the worst condition, error and chattering each, against the runs themselves; sorted, none left out."""
    chosen = best_choices(SUMMARY, "rmse", {} if limit is None else {"chattering": f"<= {limit}"})
    whole = [one for one in chosen if one.completed == one.runs]
    found = [(one.controller, one.worst.values[LAM], one.worst.values[PHI]) for one in whole]
    error, chattering = by_hand("rmse"), by_hand("chattering")
    wanted = [key for key in error if limit is None or chattering.get(key, np.inf) <= limit]
    assert found == sorted(wanted, key=error.__getitem__)
    assert [one.figures["rmse"].mean for one in whole] == pytest.approx([error[key] for key in found], rel=1e-12)


def test_what_failed_is_never_best() -> None:
    """The law with the least error of all has a failed run: it is told last, with its number of runs."""
    *_, last, least = best_choices(SUMMARY)
    assert {(one.worst.values[PHI], one.completed, one.runs) for one in (last, least)} == {(0.3, 9, 10)}
    best = best_choices(SUMMARY)[0]
    assert least.figures["rmse"].mean < best.figures["rmse"].mean


def test_what_has_no_figure_is_never_best() -> None:
    """Without chattering in some case, a law has no place among those that chatter least, whatever the constraint."""
    ranked = best_choices(SUMMARY, "chattering")
    lacking = [one for one in ranked if "chattering" not in one.figures]
    assert [(one.worst.values[LAM], one.worst.values[PHI]) for one in lacking] == [(10.0, 1.0)]
    assert "chattering" in ranked[0].figures
    assert all("chattering" in one.figures for one in best_choices(SUMMARY, "rmse", {"chattering": "< 1e9"}))


def test_a_metric_that_is_better_higher_has_the_greatest_first() -> None:
    """Time in the band 0.1, 0.2, 0.3: the last case, and with two conditions the worst is the lesser."""
    table = made("a", 2, lambda law, draw, x: {"time_in_band": 0.1 * x[LAM]}, {LAM: (1.0, 2.0, 3.0)}, ["time_in_band"])
    assert [one.worst.case for one in best_choices(summarise(table), "time_in_band")] == [2, 1, 0]
    assert best_choices(summarise(table), "time_in_band", over=["lam"])[0].worst.case == 0


def test_ties_go_by_case() -> None:
    """Equal figures everywhere: the first case and the first law come first."""
    table = made("ab", 2, lambda law, draw, values: {"rmse": 1.0, "chattering": 1.0}, {LAM: (3.0, 1.0)})
    found = [(one.worst.case, one.controller) for one in best_choices(summarise(table))]
    assert found == [(0, "a"), (0, "b"), (1, "a"), (1, "b")]


def test_conditions_are_kept_apart_where_that_is_asked_for() -> None:
    """Over nothing, each law and case; over phi, too, the worst of these; a key's value tells which cases count."""
    assert conditions(SUMMARY) == (MASS,)
    apart = best_choices(SUMMARY, over=())
    assert len(apart) == 2 * 2 + 2 * 2 * 3  # law a is the same for every phi
    assert {one.cases for one in apart} == {1}
    assert len(best_choices(SUMMARY, over=(MASS, "phi"))) == 4
    light = best_choices(SUMMARY, where={"payload.mass": 0, "phi": "!= 0.3"})
    assert {(one.controller, one.worst.values[MASS], one.cases) for one in light} == {("b", 0.0, 1)}


def test_there_are_no_conditions_where_nothing_is_chosen() -> None:
    """One law over payloads: each payload is a row of its own."""
    one = summarise(made("a", 2, lambda law, draw, x: {"rmse": 1 + x[MASS], "chattering": 1.0}, {MASS: (0.0, 2.0)}))
    assert conditions(one) == ()
    assert [choice.worst.case for choice in best_choices(one)] == [0, 1]


def test_mistakes_are_told_together() -> None:
    """A metric, a key, a comparison of words and an empty condition: four mistakes with the nearest names."""
    with pytest.raises(ConfigError) as caught:
        best_choices(SUMMARY, "rsme", {"chaterring": "<= 1", "phi": "< wide", "lam": ""}, over=["mas"])
    text = str(caught.value)
    assert len(caught.value.problems) == 5
    for words in ("did you mean 'rmse'", "did you mean 'chattering'", "where: phi: got '< wide'", "where: lam: got ''"):
        assert words in text


def test_names_are_as_short_as_they_can_be() -> None:
    """The last word of a gain, with its controller where two have it; else the key without its section."""
    names = short_names([LAM, PHI, "controllers.c.gains.phi", "chain", MASS, "model.mismatch.relative", "run.rmse"])
    assert list(names.values()) == ["lam", "b.phi", "c.phi", "chain", "payload.mass", "mismatch.relative", "run.rmse"]
