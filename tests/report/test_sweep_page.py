"""The page of a sweep stands alone and says what the summary does: the best, every number, failures, influences."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from tests.sweep.tables import made
from torquebench.report.sweep import best_facts
from torquebench.report.sweep_page import SweepInfo, sweep_page
from torquebench.report.sweep_tables import (
    answer,
    best_table,
    dot_rows,
    failures_table,
    influences,
    ratio_text,
    round_below,
    silent_text,
    told_choices,
)
from torquebench.report.tables import headlines
from torquebench.statistics import draws_needed, paired_ratio
from torquebench.sweep.best import best_choices
from torquebench.sweep.effects import Effect, Effects
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import summarise
from torquebench.sweep.table import Table

LAM, MASS = "controllers.*.gains.lam", "plant.payload.mass"
INFO = SweepInfo(
    "study",
    "<script>alert(1)</script>",
    "plant and model\nchain and noise",
    "4 cases x 8 draws x 2 laws",
    "name: study\n",
    {"seed": 7},
    (False,),
    {"a": "smc", "b": "pid"},
    {LAM: {10.0: 10, 20.0: 20}, MASS: {0.0: 0, 2.0: 2}},
)
GRID = {LAM: (10.0, 20.0), MASS: (0.0, 2.0)}
TITLES = headlines((False,), steps=True)


def run(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float] | None:
    """Law b errs thrice as much, hardly chatters, fails in draw 5 under 2 kg with lam 20; a load doubles errors."""
    if law == "b" and draw == 5 and values[MASS] == 2.0 and values[LAM] == 20.0:
        return None
    size = float(np.random.default_rng(draw).lognormal()) * (1.0 + values[MASS] / 2.0) * 10.0 / values[LAM]
    return {"rmse": (1e-3 if law == "a" else 3e-3) * size, "chattering": 30.0 if law == "a" else 1.0}


TABLE = made("ab", 8, run, GRID)
SUMMARY = summarise(TABLE)
FOUND = [
    Sensitivity(
        "a",
        "rmse",
        (0, 1),
        8,
        0,
        Effects(
            "joint",
            0.25,
            6,
            (
                Effect(("I2",), -0.4, -0.6, -0.2),
                Effect(("g1", "Im2"), 0.67, 0.43, 0.90),
                Effect(("I3",), 0.1, -0.2, 0.4),
            ),
        ),
        "",
    ),
    Sensitivity("b", "rmse", (0, 1), 7, 1, Effects("single", None, 3, (Effect(("I2",), 0.1, -0.5, 0.7),)), ""),
    Sensitivity("b", "chattering", (0, 1), 7, 1, None, "it is the same in every draw"),
]


def page_of(table: Table, info: SweepInfo = INFO, found: list[Sensitivity] = FOUND) -> bytes:
    """Return the page of a table."""
    return sweep_page(table, summarise(table), info, found)


def data_of(page: bytes) -> Any:
    """Return the data that the page's script reads."""
    found = re.search(rb'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def text_of(page: bytes) -> str:
    """Text of a page, without markup, in one line."""
    return " ".join(re.sub(r"<[^>]+>", " ", page.decode()).split())


def test_the_answer_is_the_best_that_completed() -> None:
    """Law a follows best in every load; b chatters least, of its gains the one without a failed run; one run failed."""
    mean = 2e3 * float(np.mean([TABLE["rmse"][draw * 2] for draw in range(8)]))
    best, calm, failed = answer(SUMMARY, TITLES)
    assert best.startswith(f"Least error: a with lam 20; RMSE {mean / 2:.3g} mrad [")
    assert best.endswith(
        "each in the worst of 2 cases (error: payload.mass 2); it chatters, as does every other choice."
    )
    assert calm.startswith(f"Least chattering: b with lam 10; RMSE {3 * mean:.3g} mrad [")
    assert "chattering 1 %" in calm
    assert failed == "1 of 64 runs failed: b 1."


@pytest.mark.parametrize("calm", [0.0999, 0.1])
def test_the_best_is_not_recommended_without_saying_that_it_chatters(calm: float) -> None:
    """From 0.1 % on it chatters, as for a run; the best below is named beside it, and JSON tells them apart."""

    def quiet(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float] | None:
        found = run(law, draw, values)
        return None if found is None else found | {"chattering": 30.0 if law == "a" else calm}

    summary = summarise(made("ab", 8, quiet, GRID))
    best = answer(summary, TITLES)[0]
    rmse = 1e3 * next(one for one in best_choices(summary) if one.controller == "b").figures["rmse"].mean
    told = f"; it chatters: without chattering, b with lam 10; RMSE {rmse:.3g} mrad ["
    assert (told in best) == (calm < 0.1)
    assert ("as does every other choice" in best) == (calm >= 0.1)
    assert {(one["controller"], one["chatters"]) for one in best_facts(summary)} == {("a", True), ("b", calm >= 0.1)}


@pytest.mark.parametrize(("value", "wanted"), [(14.9, 10.0), (3.0, 3.0), (2.9, 1.0), (0.31, 0.3), (0.01, 0.01)])
def test_a_limit_is_the_round_number_below(value: float, wanted: float) -> None:
    """Powers of ten and three times these."""
    assert round_below(value) == wanted


def test_the_numbers_of_the_page_are_those_of_the_summary() -> None:
    """Means and ends of intervals to the last bit, with their law, case, key values, runs and completed ones."""
    data = data_of(page_of(TABLE))
    assert [name for name, _ in data["laws"]] == ["a", "b"]
    metrics = {metric["key"]: metric for metric in data["metrics"]}
    groups = {(group.case, group.controller): group for group in SUMMARY.groups}
    assert len(data["case"]) == len(groups) == 8
    for i, (case, law) in enumerate(zip(data["case"], data["law"], strict=True)):
        group = groups[case, "ab"[law]]
        for key in ("rmse", "chattering"):
            figure = group.figures[key]
            ends = [None if np.isnan(end) else end for end in figure[1:4]]
            assert [metrics[key][end][i] for end in ("mean", "low", "high")] == ends
        assert (data["runs"][i], data["completed"][i]) == (group.successes.trials, group.successes.successes)
        words = [key["words"][place[i]] for key, place in zip(data["keys"], data["places"], strict=True)]
        assert words == [f"{value:g}" for value in group.values.values()]
    assert [key["sets"] for key in data["keys"]] == [["10", "20"], ["0", "2"]]
    assert [key["worst"] for key in data["keys"]] == [False, True]


def test_the_page_stands_alone_and_is_the_same_again() -> None:
    """Nothing from outside; what a user wrote is text, in the page and in its data; the same bytes again."""
    evil = "</script><script>alert(1)</script>"
    named = dict(TABLE) | {"controller": np.where(TABLE["controller"] == "b", evil, "a")}
    info = INFO._replace(name=evil, laws={"a": "smc", evil: "pid"})
    page = page_of(named, info)
    assert page == page_of(named, info)
    assert b"alert(1)</script>" not in page
    assert b"&lt;script&gt;" in page
    assert data_of(page)["laws"][1][0] == evil
    assert not re.search(rb'(src|href)=(?!"data:)|@import|url\(', page)


def test_laws_are_compared_over_all_cases() -> None:
    """Completed runs and the paired ratio: 3, one draw left out; the median by which they are sorted."""
    text = text_of(page_of(TABLE))
    median = 1e3 * float(np.median(TABLE["rmse"][TABLE["controller"] == "a"]))
    assert f"a 32 of 32 {median:.4g}" in text
    assert "b 31 of 32" in text
    assert "3 [3, 3], 1 left out" in text


def test_what_matters_is_named_as_it_does() -> None:
    """A product is a product, the strongest comes first, and what does not show is said with its reason."""
    (found,) = influences(FOUND)
    assert [text for text, _, _ in found.effects] == ["g1 x Im2 +0.67 [0.43, 0.90]", "I2 -0.40 [-0.60, -0.20]"]
    assert [bar for _, *bar in found.effects] == [pytest.approx([50.0, 33.5]), pytest.approx([30.0, 20.0])]
    text = silent_text(FOUND)
    assert "RMSE of b: of the drawn number and of their 3 products none shows an influence in 7 draws" in text
    assert "chattering of b: it is the same in every draw" in text
    assert silent_text(FOUND[:1]) == ""


def test_failures_are_listed_with_the_first_of_them() -> None:
    """Law, case, how often which outcome, and the row that replays it: case 3, draw 5, law 1 of 8 draws and 2 laws."""
    _, rows = failures_table(SUMMARY)
    assert rows == [["b", "lam 20, payload.mass 2", "7 completed, 1 diverged", str((3 * 8 + 5) * 2 + 1), "5"]]


def test_the_terminal_tells_the_best_and_the_best_of_each_law() -> None:
    """As many as there is room for, and every law however far behind it is; the means are those of the choices."""
    grid = {LAM: tuple(float(x) for x in range(10, 20)), MASS: (0.0,)}
    summary = summarise(made("ab", 8, run, grid))
    choices = told_choices(summary, TITLES, 5)
    _, rows = best_table(choices, summary, TITLES)
    assert [row[0] for row in rows] == ["a"] * 5 + ["b"]
    errors = [one.figures["rmse"] for one in best_choices(summary)]
    assert [row[3] for row in rows[:5]] == [
        f"{1e3 * figure.mean:.3g} [{1e3 * figure.low:.3g}, {1e3 * figure.high:.3g}]" for figure in errors[:5]
    ]
    assert told_choices(summary, TITLES, 100) == best_choices(summary)


def test_dots_stand_where_the_means_are() -> None:
    """The least and the greatest mean at the ends, others between in their order, each with its interval around it."""
    choices = told_choices(SUMMARY, TITLES, 100)
    header, rows = dot_rows(choices, SUMMARY, TITLES)
    means = [one.figures["rmse"].mean for one in choices]
    assert header[1] == f"RMSE [mrad]: {1e3 * min(means):.3g} to {1e3 * max(means):.3g}, logarithmic"
    places = [row[1].index("●") for row in rows]
    assert {min(places), max(places)} == {0, len(rows[0][1]) - 1}
    order = np.argsort(means)
    assert np.all(np.diff(np.array(places)[order]) >= 0)
    assert all("─" in row[1] for row in rows)


@pytest.mark.parametrize("broken", ["b", "ab"])
def test_what_never_completes_has_no_figure(broken: str) -> None:
    """Nothing is averaged over nothing: a law without a completed run, and a sweep without one, have a page."""
    table = made("ab", 3, lambda law, draw, values: None if law in broken else run(law, draw, values), GRID)
    page = page_of(table, found=[])
    runs = 12 * len(broken)
    assert f"{runs} of 24 runs failed" in text_of(page)
    assert b"0 of 12" in page
    assert ("rmse" in [metric["key"] for metric in data_of(page)["metrics"]]) == (broken == "b")


def test_a_ratio_that_is_undecided_says_how_many_draws_it_takes() -> None:
    """Where the interval holds 1, and only there; a ratio that repeats in every draw needs none."""
    undecided, same = (paired_ratio([x, 1.0, 1 / x, y], [1.0] * 4) for x, y in ((1.2, 1.1), (1.0, 1.0)))
    assert ratio_text(undecided).endswith(f", {draws_needed(undecided)} draws show 5 %")
    assert "show" not in ratio_text(same)
    assert "show" not in ratio_text(paired_ratio([2.0, 2.1, 1.9], [1.0] * 3))
