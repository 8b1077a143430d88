"""A summary counts failures and never averages them, pairs by draw, and says which row replays the worst run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tests.sweep.tables import made
from torquebench.errors import ResultError
from torquebench.report.sweep import case_facts
from torquebench.report.sweep_tables import answer
from torquebench.report.tables import headlines
from torquebench.statistics import paired_ratio
from torquebench.sweep.summary import summarise
from torquebench.sweep.table import FIXED, controllers, grid_keys, metric_keys, read_table, rows_by, varied_keys

GRID = {"plant.payload.mass": (0.0, 2.0), "chain": ("ideal", "slow")}
SPREAD = np.exp(np.random.default_rng(4).normal(size=(2, 40)))


def two_laws(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float | None] | None:
    """Law b is 2 + payload times as far off as a, up to noise; it fails in draws 3 and 17 under a payload."""
    if law == "b" and draw in (3, 17) and values["plant.payload.mass"] > 0.0:
        return None
    size = 1.0 if law == "a" else 2.0 + float(values["plant.payload.mass"])
    hf = 0.0 if law == "a" else 5.0
    return {"rmse": size * SPREAD["ab".index(law), draw], "chattering": hf}


def test_failures_are_counted_and_enter_no_figure() -> None:
    """38 of 40 runs: scipy's exact interval, and the figures of these 38 alone; the first failure has its row."""
    table = made("ab", 40, two_laws, GRID)
    group = next(g for g in summarise(table).groups if (g.case, g.controller) == (2, "b"))
    wanted = stats.binomtest(38, 40).proportion_ci(0.95, "exact")
    assert group.successes[:2] == (38, 40)
    assert group.successes[2:] == pytest.approx((wanted.low, wanted.high), rel=1e-9)
    assert group.outcomes == {"COMPLETED": 38, "DIVERGED": 2}
    own = np.delete(4.0 * SPREAD[1], (3, 17))
    figure = group.figures["rmse"]
    assert figure.defined == 38
    assert (figure.mean, figure.median) == pytest.approx((own.mean(), np.median(own)), rel=1e-12)
    assert figure.worst == own.max()
    # a tenth of 38 runs are the worst three and 0.8 of the fourth
    high = np.sort(own)[::-1]
    assert figure.cvar == pytest.approx((high[:3].sum() + 0.8 * high[3]) / 3.8, rel=1e-12)
    assert group.earliest_failure is not None
    assert group.earliest_failure[:3] == ((2 * 40 + 3) * 2 + 1, 3, "DIVERGED")


def test_outcomes_are_paired_by_draw() -> None:
    """Law b fails in draws 3 and 17 alone, whatever the cases: 2 to 0 of 40, p 1/2, and a sentence says so."""
    summary = summarise(made("ab", 40, two_laws, GRID))
    assert [law.outcomes for law in summary.overall] == [(0, 0, 40, 1.0), (2, 0, 40, pytest.approx(0.5))]
    (told,) = answer(summary, headlines(()))[-1:]
    assert "Draws of 40 with more failures than a, and with fewer, exact McNemar test: b in 2 and 0 (p = 0.5)." in told


def test_every_case_is_told_with_the_intervals_of_its_means() -> None:
    """`--json` has each law in each case; over 40 draws every mean of the error lies inside its interval."""
    summary = summarise(made("ab", 40, two_laws, GRID))
    told = case_facts(summary)
    assert [(one["controller"], one["case"]) for one in told] == [(one.controller, one.case) for one in summary.groups]
    for one, group in zip(told, summary.groups, strict=True):
        assert one["metrics"]["rmse"]["low"] < one["metrics"]["rmse"]["mean"] < one["metrics"]["rmse"]["high"]
        assert one["metrics"]["rmse"]["mean"] == group.figures["rmse"].mean
        assert (one["runs"], one["completed"]) == (group.successes.trials, group.successes.successes)


def test_rows_of_the_worst_replay_it() -> None:
    """The row named as the worst holds the worst value, and its case, law and draw are those that are said."""
    table = made("ab", 40, two_laws, GRID)
    for group in summarise(table).groups:
        row = group.figures["rmse"].worst_row
        assert (table["case"][row], table["controller"][row]) == (group.case, group.controller)
        assert table["draw"][row] == group.figures["rmse"].worst_draw
        assert table["rmse"][row] == group.figures["rmse"].worst


def test_of_a_metric_that_is_better_higher_the_worst_is_the_least() -> None:
    """Time in the band 0.1 .. 1.0: worst 0.1, worst tenth 0.1, at draw 0."""
    table = made("a", 10, lambda law, draw, values: {"time_in_band": 0.1 * (draw + 1)}, metrics=["time_in_band"])
    (group,) = summarise(table).groups
    assert group.figures["time_in_band"][5:] == (pytest.approx(0.1), 0.1, 0, 0)


def test_ratios_are_those_of_the_pairs() -> None:
    """As `paired_ratio` of the two lists, failures left out in pairs; zeros have no ratio; a law is 1 beside itself."""
    table = made("ab", 40, two_laws, GRID)
    groups = {(g.case, g.controller): g for g in summarise(table, reference="a").groups}
    b = [None if draw in (3, 17) else 4.0 * SPREAD[1, draw] for draw in range(40)]
    wanted = paired_ratio(b, SPREAD[0].tolist())
    assert groups[2, "b"].ratios["rmse"][:3] == pytest.approx(wanted[:3], rel=1e-12)
    assert groups[2, "b"].ratios["rmse"].failed == (2, 0)
    assert "chattering" not in groups[0, "b"].ratios
    assert groups[0, "a"].ratios["rmse"][:3] == (1.0, 1.0, 1.0)
    swapped = {(g.case, g.controller): g for g in summarise(table, reference="b").groups}
    assert swapped[0, "a"].ratios["rmse"].ratio == pytest.approx(1 / groups[0, "b"].ratios["rmse"].ratio, rel=1e-12)


def test_rows_in_any_order_are_paired_by_draw() -> None:
    """A shuffled table gives the same groups."""
    table = made("ab", 40, two_laws, GRID)
    order = np.random.default_rng(0).permutation(len(table["index"]))
    shuffled = {name: column[order] for name, column in table.items()}
    plain = {(g.case, g.controller): g for g in summarise(table, "a").groups}
    for group in summarise(shuffled, "a").groups:
        other = plain[group.case, group.controller]
        assert group.ratios["rmse"][:3] == pytest.approx(other.ratios["rmse"][:3], rel=1e-12)
        assert group.figures["rmse"].worst_row == other.figures["rmse"].worst_row


def test_over_all_cases_a_draw_counts_once() -> None:
    """Four cases of 40 draws are 38 pairs, not 152: each draw's mean over the cases, as its cases share their noise."""
    b = next(law for law in summarise(made("ab", 40, two_laws, GRID)).overall if law.controller == "b")
    assert (b.successes, b.runs) == (156, 160)
    ratio = b.ratios["rmse"]
    assert ratio.pairs == 38
    # payload 0 doubles, 2 kg quadruples: sqrt(8) on average, whatever the noise
    kept = np.delete(SPREAD, (3, 17), axis=1)
    assert ratio.ratio == pytest.approx(np.sqrt(8.0) * np.exp(np.mean(np.log(kept[1] / kept[0]))), rel=1e-12)


def test_columns_are_told_apart() -> None:
    """Grid keys have one value in a case, drawn ones have not; a metric nobody has is no metric of the sweep."""
    table = made("ab", 3, two_laws, GRID, metrics=("rmse", "chattering", "rise_time"))
    drawn = np.where(table["controller"] == "b", table["draw"].astype(float), np.nan)
    table = {name: table[name] for name in [*FIXED, *GRID]} | {"controllers.b.gains.phi": drawn} | dict(table)
    assert varied_keys(table) == (*GRID, "controllers.b.gains.phi")
    assert grid_keys(table) == tuple(GRID)
    assert metric_keys(table) == ("rmse", "chattering")
    assert controllers(table) == ("a", "b")
    summary = summarise(table)
    assert (summary.grid, summary.drawn) == (tuple(GRID), ("controllers.b.gains.phi",))
    assert summary.groups[-1].values == {"plant.payload.mass": 2.0, "chain": "slow"}


def test_a_key_that_differs_between_laws_is_a_key_of_the_grid() -> None:
    """A gain that one law lacks has NaN in its rows, and is known as a key of the grid still."""
    table = made("ab", 3, two_laws, {"controllers.*.gains.phi": (0.1, 0.3), **GRID})
    table["controllers.*.gains.phi"][table["controller"] == "a"] = np.nan
    groups = summarise(table).groups
    assert summarise(table).drawn == ()
    assert groups[0].values["controllers.*.gains.phi"] is None
    assert groups[1].values["controllers.*.gains.phi"] == 0.1


def test_rows_by_finds_every_row_once() -> None:
    """The parts are the whole table, each of one case and law."""
    table = made("ab", 5, two_laws, GRID)
    parts = rows_by(table, "case", "controller")
    assert sorted(np.concatenate(list(parts.values())).tolist()) == list(range(40))
    assert list(parts)[:3] == [(0, "a"), (0, "b"), (1, "a")]
    assert all(len({*table["controller"][rows]}) == 1 for rows in parts.values())


def test_the_summary_is_plain_data() -> None:
    """JSON without NaN, also where every run of a law failed; ratios and figures are objects."""
    table = made("ab", 3, lambda law, draw, values: {"rmse": 1.0 + draw} if law == "a" else None, metrics=["rmse"])
    data = json.loads(json.dumps(summarise(table).to_json(), allow_nan=False))
    a, b = data["groups"]
    assert a["figures"]["rmse"]["worst"] == 3.0
    assert b["figures"] == b["ratios"] == {}
    assert b["successes"]["successes"] == 0
    assert b["earliest_failure"] == {"row": 1, "draw": 0, "outcome": "DIVERGED", "at": 0.25}


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    """A missing column, no rows, a reference that is not there; a file with ragged columns, or that is no NPZ file."""
    table = made("ab", 3, two_laws, GRID)
    with pytest.raises(ResultError, match="no column failed_at"):
        summarise({name: column for name, column in table.items() if name != "failed_at"})
    with pytest.raises(ResultError, match="no rows"):
        summarise({name: column[:0] for name, column in table.items()})
    with pytest.raises(ResultError, match="no controller 'c' in the sweep"):
        summarise(table, "c")
    path = tmp_path / "results.npz"
    np.savez(path, **(dict(table) | {"case": np.zeros(2)}))
    with pytest.raises(ResultError, match="its columns differ in length"):
        read_table(path)
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(ResultError, match="cannot be read as a sweep's table"):
        read_table(path)
