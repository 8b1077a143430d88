"""Sweeps from Python: the same table as the command line, as a frame, summarised."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import torquebench as tb
from tests.test_results import QUICK
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError
from torquebench.statistics import mean_interval

NOISE = [{"kind": "band-limited-noise", "channel": "torque", "sigma": 0.1}]
GRID = {"controllers.band.gains.phi": np.geomspace(0.1, 0.4, 3)}
HOW = {"workers": 1}


@pytest.fixture(scope="module")
def sweep():
    """A small sweep of the small experiment, in memory."""
    return tb.run_sweep(tb.load_experiment(QUICK, {"disturbances": NOISE}), grid=GRID, draws=2, **HOW)


def test_the_table_is_a_frame(sweep):
    """A row for each closed loop with its case, draw, keys, outcome and metrics in SI units."""
    table = sweep.to_dataframe()
    assert len(table) == 3 * 2 * 2
    assert table["outcome"].eq("COMPLETED").all()
    own = table[table["controller"] == "band"]
    assert (
        own.groupby("case")["controllers.band.gains.phi"].first().tolist()
        == GRID["controllers.band.gains.phi"].tolist()
    )
    assert table[table["controller"] == "conventional"]["controllers.band.gains.phi"].isna().all()
    assert table.attrs["units"]["rmse"] == "rad"
    table["rmse"] = 0.0  # a copy: the sweep keeps its own
    assert (sweep.to_dataframe()["rmse"] > 0.0).all()


def test_a_row_can_be_run_again(sweep):
    """The experiment of a row has the row's metrics when it is run."""
    row = sweep.to_dataframe().iloc[7]
    result = tb.run_experiment(sweep.experiment(7))
    assert result.metrics.loc[row["controller"], "rmse"] == row["rmse"]
    with pytest.raises(ResultError, match="wanted 0 to 11"):
        sweep.experiment(12)


def test_the_summary_and_the_best(sweep):
    """Means of each controller in each case; the least of those that meet a condition."""
    table, summary = sweep.to_dataframe(), sweep.summary
    means = table.groupby(["case", "controller"], sort=False)["rmse"].mean()
    assert np.allclose(summary["rmse"], means.loc[summary.index], rtol=1e-12)
    assert (summary["completed"] == 2).all()
    best = sweep.best("rmse", over=())
    assert best.index[0] == means.idxmin()
    assert best["rmse"].is_monotonic_increasing
    calm = sweep.best("rmse", where={"hf": "< 5", "phi": "> 0.15"})
    fits = summary["controllers.band.gains.phi"].gt(0.15) & summary["hf"].lt(5)
    assert calm["rmse"].tolist() == sorted(summary["rmse"][fits])
    values = table.set_index(["case", "controller"])["rmse"].loc[calm.index[0]]
    mean, half = mean_interval(values.tolist())
    assert calm.iloc[0][["rmse", "low", "high"]].tolist() == pytest.approx([mean, mean - half, mean + half], rel=1e-12)
    with pytest.raises(ConfigError, match="did you mean 'rmse'"):
        sweep.best("rsme")
    with pytest.raises(ConfigError, match="hff"):
        sweep.best("rmse", where={"hff": "< 1"})
    with pytest.raises(ResultError, match="no law completes every run and meets"):
        sweep.best("rmse", where={"hf": "< -1"})


def test_a_sweep_from_python_is_what_the_command_leaves(tmp_path, monkeypatch):
    """The same table, summary and page from a file, with a folder; read back, the same frame."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    settings = ["--set", "sweep.draws=2", "--set", "run.duration=0.6", "--set", "run.metrics_from=0.1"]
    settings += ["--set", "sweep.grid={plant.payload.mass: [0, 1]}"]
    how = ["--executor", "threads", "--workers", "1", "--quiet"]
    assert main(["sweep", "sweep", *settings, *how, "--out", "command"]) == 0
    done = tb.run_sweep(
        "sweep",
        draws=2,
        grid={"plant.payload.mass": [0, 1]},
        changes={"run.duration": 0.6, "run.metrics_from": 0.1},
        folder="python",
        **HOW,
    )
    for name in ("results.npz", "results.csv", "summary.json", "sensitivity.json"):
        assert Path("python", name).read_bytes() == Path("command", name).read_bytes(), name
    again = tb.load_sweep("python")
    assert again.to_dataframe().equals(done.to_dataframe())
    assert "sweep" in repr(again)
    assert "<table" in again._repr_html_()
    assert len(again.figure("spread").axes) >= 1
    with pytest.raises(ResultError, match="did you mean 'spread'"):
        again.figure("spred")
    assert b"Every law" in again.report()


def test_mistakes_are_bad_input(tmp_path):
    """A key that does not exist, a folder that is none, a number of workers that makes no sense."""
    experiment = tb.load_experiment(QUICK)
    with pytest.raises(ConfigError, match="phi"):
        tb.run_sweep(experiment, grid={"controllers.band.gains.phii": [1, 2]}, draws=1, **HOW)
    with pytest.raises(ConfigError, match="wanted a value for a config"):
        tb.run_sweep(experiment, grid={"controllers.band.gains.phi": [object()]}, draws=1, **HOW)
    with pytest.raises(ConfigError, match="at least 1"):
        tb.run_sweep(experiment, draws=2, workers=-1)
    with pytest.raises(ConfigError, match="no such folder"):
        tb.load_sweep(tmp_path / "none")
