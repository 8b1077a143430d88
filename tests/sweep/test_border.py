"""Borders of a sweep: the search, and what it stores, shows and refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from torquebench import load_model, run_experiment, run_sweep
from torquebench.errors import ConfigError
from torquebench.experiment.sweep_section import with_number
from torquebench.report.figures.border import draw_border
from torquebench.report.figures.style import spot_looks
from torquebench.report.sweep import border_facts
from torquebench.report.sweep_tables import border_table
from torquebench.sweep.border import find_border, level_of
from torquebench.sweep.table import read_table

CONFIG = {
    "name": "shaking",
    "plant": {"model": "two-link", "friction": "none"},
    "controllers": [
        {"name": "band", "law": "smc", "switching": "saturation", "gains": {"lam": 10, "k": 0.3, "phi": 0.3}},
        {"name": "pd", "law": "pd", "gains": {"lam": 10, "kv": 20}},
    ],
    "reference": {"kind": "quintic", "target": 0.5, "rise_time": 1.0},
    "run": {"duration": 2.0, "metrics_from": 1.1},
    "sweep": {
        "grid": {"chain.measurement_delay": [0.01, 0.03]},
        "border": {"key": "controllers.*.gains.k", "from": 0.001, "to": 1},
    },
}


@pytest.mark.parametrize("edge", [0.0123, 0.2, 0.99])
def test_a_border_is_bracketed_to_its_width(edge: float) -> None:
    """The first value with it and the last without it are on either side of the edge, within 5 % of each other."""
    found = find_border(lambda x: x >= edge, 0.001, 1.0, 0.05)
    assert found.before < edge <= found.border <= 1.05 * found.before
    assert found.last == found.before


def test_a_border_is_found_downwards() -> None:
    """From the larger end to the smaller one, the border is the largest value with it."""
    found = find_border(lambda x: x <= 0.2, 3.0, 0.01, 0.05)
    assert found.border <= 0.2 < found.before <= 1.06 * found.border


def test_none_and_all() -> None:
    """Where nothing has it there is no border; where the first value has it there is none before."""
    assert find_border(lambda x: False, 0.1, 1.0, 0.05) == (math.inf, 1.0, 1.0)
    border, before, last = find_border(lambda x: True, 0.1, 1.0, 0.05)
    assert border == 0.1
    assert math.isnan(before)
    assert math.isnan(last)


def test_an_island_of_stillness_is_told() -> None:
    """Where it stops again beyond the border, the last value without it lies within 5 % of the island's end."""
    found = find_border(lambda x: 0.02 <= x < 0.08 or x >= 0.5, 0.001, 1.0, 0.05)
    assert found.before < 0.02 <= found.border
    assert 0.5 / 1.05 <= found.last < 0.5


def test_runs_on_either_side_of_a_border(tmp_path: Path) -> None:
    """Run again, the gain of the border chatters by 0.1 % or more and that before it by less; pd has no gain k.

    The prediction is within 15 % of it: the layer's first harmonic alone, and an arm whose inertia changes on its way.
    """
    sweep = run_sweep(CONFIG, folder=tmp_path / "s", workers=1)
    rows = sweep.to_dataframe()
    own = rows[rows["controller"] == "band"]
    assert rows[rows["controller"] == "pd"]["border"].isna().all()
    for row in own.itertuples():
        for value, shakes in ((row.border_before, False), (row.border, True)):
            experiment = with_number(sweep.experiment(int(row.Index)), ("controllers", 0, "gains", "k"), value)
            chattering = float(run_experiment(experiment).metrics["chattering"].iloc[0])
            assert (chattering >= 0.1) == shakes
        assert row.border_predicted == pytest.approx(row.border, rel=0.15)
    assert own["border"].iloc[0] > 2.0 * own["border"].iloc[1]
    told = border_facts(read_table(sweep.folder / "results.npz"))
    assert [(x["controller"], x["values"], x["border"]) for x in told] == [
        ("band", {"chain.measurement_delay": delay}, border)
        for delay, border in zip((0.01, 0.03), own["border"], strict=True)
    ]
    assert told[0]["low"] is None  # an interval takes six draws
    header, cells = border_table(read_table(sweep.folder / "results.npz"))
    assert header[-3:] == ["measurement_delay [s]:", "0.01", "0.03"]
    assert cells[0][0] == "band"
    assert f"{own['border'].iloc[1]:.3g}" in cells[0][-1]
    assert cells[1][-1] == "-"
    axes = sweep.figure("border").axes
    assert [(ax.get_yscale(), ax.get_ylabel()) for ax in axes] == [("log", "first k [1] that shakes")]
    legend = [text.get_text() for text in axes[0].figure.legends[0].get_texts()]
    assert "band" in legend
    assert "pd" not in legend  # it has no such gain
    assert "Where each law starts to shake" in sweep.report().decode()


def test_a_law_without_a_model_is_predicted_to_switch_from_its_load_on(tmp_path: Path) -> None:
    """K sgn(s) alone has to carry gravity first: not where its square wave is 0.1 % of the limit, but at the load.

    Of the two joints the one with less gravity for its limit switches first. A sweep without a key that varies has a
    border, too, and a page.
    """
    law = {"name": "relay", "law": "smc", "equivalent_control": False, "gains": {"lam": 10, "k": 0.3}}
    asked = {"border": {"key": "controllers.*.gains.k", "from": 0.01, "to": 1}}
    sweep = run_sweep({**CONFIG, "controllers": [law], "sweep": asked}, folder=tmp_path / "s", workers=1)
    arm = load_model("two-link")
    share = float(np.min(np.abs(arm.gravity(np.array([0.5, 0.5]))) / arm.flat.tau_max))
    assert share > 0.05
    assert sweep.to_dataframe()["border_predicted"].iloc[0] == pytest.approx(share, rel=0.02)
    assert b"Where each law starts to shake" in (sweep.folder / "report.html").read_bytes()


def test_laws_without_a_border_at_a_place_are_all_seen() -> None:
    """Points at an end of the search that have one place are drawn beside each other; a single one is at its own."""
    n = 4
    table = {
        "index": np.arange(n),
        "controller": np.repeat(["band", "relay"], 2),
        "chain.measurement_delay": np.tile([0.01, 0.03], 2),
        "border": np.array([math.inf, 0.5, math.inf, math.inf]),
        "border_before": np.array([1.0, 0.48, 1.0, 1.0]),
        "border_last": np.array([1.0, 0.48, 1.0, 1.0]),
        "border_predicted": np.full(n, math.nan),
    }
    looks = spot_looks({"band": "smc", "relay": "smc"})
    fig = draw_border(table, ["chain.measurement_delay"], "controllers.*.gains.k", looks, "t", "s")
    points = [line for line in fig.axes[0].lines if line.get_marker() == "^" and len(line.get_xdata()) == 1]
    at = np.array([line.get_transform().transform(line.get_xydata())[0] for line in points])
    ends = np.array([fig.axes[0].transData.transform(line.get_xydata())[0] for line in points])
    by = 5.0 / 72.0 * fig.dpi
    assert at - ends == pytest.approx(np.array([[0.0, 0.0], [by, 0.0], [0.0, 0.0]]))


def test_levels_of_draws_with_and_without_a_border() -> None:
    """The median of six draws counts those without a border as infinite; so does the end of the interval."""
    table = {
        "border": np.array([0.1, 0.2, 0.3, 0.4, math.inf, math.inf]),
        "border_before": np.array([0.09, 0.19, 0.29, 0.39, 1.0, 1.0]),
        "border_last": np.array([0.09, 0.19, 0.29, 0.7, 1.0, 1.0]),
        "border_predicted": np.full(6, math.nan),
    }
    found = level_of(table, np.arange(6))
    assert (found.border, found.low, found.high, found.last) == (0.35, 0.1, math.inf, 0.7)
    assert math.isnan(found.predicted)


@pytest.mark.parametrize(
    ("border", "said"),
    [
        ({"key": "plant.payload.mass", "from": 1, "to": 2}, "a gain, such as controllers.*.gains.k"),
        ({"key": "controllers.*.gains.kx", "from": 1, "to": 2}, "no controller's law has it"),
        ({"key": "controllers.*.gains.k", "from": 0.1, "to": 0.1}, "another end"),
        ({"key": "controllers.*.gains.k", "from": -1, "to": 1}, "more than 0"),
    ],
)
def test_bad_borders_are_refused(border: dict[str, object], said: str) -> None:
    """What is no gain, a gain of no law, ends that are one, and an end that is not positive."""
    with pytest.raises(ConfigError, match=said.replace("*", r"\*")):
        run_sweep({**CONFIG, "sweep": {"border": border}})
