"""The page of a sweep stands alone and tells what the table says: counts, intervals, worst rows, what matters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.sweep.tables import made
from torquebench.report.render import Picture
from torquebench.report.sweep_page import SweepInfo, sweep_page
from torquebench.report.sweep_tables import effects_table, failures_table, law_table, silent_text
from torquebench.report.tables import Cells, headlines
from torquebench.statistics import clopper_pearson
from torquebench.sweep.effects import Effect, Effects
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import summarise
from torquebench.sweep.table import Table

INFO = SweepInfo(
    "study",
    "<script>alert(1)</script>",
    "plant and model\nchain and noise",
    "2 cases x 8 draws x 2 laws",
    "name: study\n",
    {"seed": 7},
    (False,),
    {"a": "smc", "b": "pid"},
)
GRID = {"plant.payload.mass": (0.0, 2.0)}
TITLES = headlines((False,), steps=True)


def run(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float] | None:
    """Law b is three times as far off, and fails in draw 5 under 2 kg."""
    if law == "b" and draw == 5 and values["plant.payload.mass"] == 2.0:
        return None
    noise = float(np.random.default_rng(draw).lognormal())
    return {"rmse": (1e-3 if law == "a" else 3e-3) * noise, "chattering": 30.0 if law == "a" else 1.0}


TABLE = made("ab", 8, run, GRID)
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
                Effect(("g1", "Im2"), 0.67, 0.43, 0.90),
                Effect(("I2",), -0.4, -0.6, -0.2),
                Effect(("I3",), 0.1, -0.2, 0.4),
            ),
        ),
        "",
    ),
    Sensitivity("b", "rmse", (0, 1), 7, 1, Effects("single", None, 3, (Effect(("I2",), 0.1, -0.5, 0.7),)), ""),
    Sensitivity("b", "chattering", (0, 1), 7, 1, None, "it is the same in every draw"),
]


def over_all(table: Table, reference: str | None = None) -> Cells:
    """Return the table of errors over all cases."""
    summary = summarise(table, reference)
    return law_table(summary, summary.overall, "rmse", TITLES)


def text_of(page: bytes) -> str:
    """Text of a page, without markup, in one line."""
    return " ".join(re.sub(r"<[^>]+>", " ", page.decode()).split())


def test_the_page_tells_what_the_table_says() -> None:
    """Completed runs with their exact interval, the worst run's index, the ratio, the failure, and how to replay."""
    page = sweep_page(TABLE, INFO, [Picture("All runs", b'<?xml version="1.0"?>\n<svg><path/></svg>')], FOUND)
    text = text_of(page)
    share = clopper_pearson(7, 8)
    assert f"7 of 8 [{100 * share.low:.3g}, {100 * share.high:.3g}] %" in text
    assert "15 of 16" in text
    figures = summarise(TABLE).overall[1].figures["rmse"]
    assert f"{1e3 * figures.worst:.4g} {figures.worst_row} 3 [3, 3], 1 left out" in text
    assert "plant.payload.mass = 2 " in text
    assert "1 diverged" in text
    assert "torquebench run --from-sweep DIR --index INDEX" in text
    assert "All runs" in text


def test_the_page_stands_alone_and_is_the_same_again() -> None:
    """No script, no link, no image from outside; text is text; the same arguments give the same bytes."""
    page = sweep_page(TABLE, INFO, (), FOUND)
    assert page == sweep_page(TABLE, INFO, (), FOUND)
    assert b"<script" not in page
    assert b"&lt;script&gt;" in page
    assert not re.search(rb"(src|href)=|@import|url\(", page)


def test_what_matters_is_named_as_it_does() -> None:
    """A product is a product, ranked constants come first, and what does not show is said with its reason."""
    _, rows = effects_table(FOUND)
    assert rows == [
        [
            "a",
            "RMSE",
            "0, 1",
            "8",
            "g1, Im2, I2",
            "g1 x Im2 +0.67 [0.43, 0.90]; I2 -0.40 [-0.60, -0.20]",
            "25 % explained",
        ]
    ]
    text = silent_text(FOUND)
    assert "RMSE of b: none of 1 and of their 3 products shows in 7 draws" in text
    assert "chattering of b: it is the same in every draw" in text
    assert silent_text(FOUND[:1]) == ""


def test_failures_are_listed_with_the_first_of_them() -> None:
    """Law, case, how often which outcome, and the row that replays it: case 1, draw 5, law 1 of 8 draws and 2 laws."""
    _, rows = failures_table(summarise(TABLE))
    assert rows == [["b", "plant.payload.mass = 2", "7 completed, 1 diverged", str((8 + 5) * 2 + 1), "5"]]


def test_a_reference_can_be_named() -> None:
    """Ratios to b are the inverse of those to a."""
    header, rows = over_all(TABLE, "b")
    assert header[-1] == "over b's [95 %]"
    assert rows[0][-1].startswith("0.333 [0.333, 0.333]")
    assert rows[1][-1].startswith("1 [1, 1]")


def test_a_law_without_a_completed_run_has_dashes() -> None:
    """Nothing is averaged over nothing."""
    table = made("ab", 3, lambda law, draw, values: run(law, draw, {"plant.payload.mass": 0.0}) if law == "a" else None)
    _, rows = over_all(table)
    assert rows[1] == ["b", *["-"] * 5]
    assert b"0 of 3" in sweep_page(table, INFO)
