"""Sweeps from Python: the same table as the command line, as a frame, summarised."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import torquebench as tb
from tests.test_results import QUICK
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError

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
    assert sweep.best("rmse").name == means.idxmin()
    calm = sweep.best("rmse", where="hf < 5 and `controllers.band.gains.phi` > 0.15")
    assert calm["hf"] < 5
    assert calm["rmse"] == summary[summary["controllers.band.gains.phi"].gt(0.15) & summary["hf"].lt(5)]["rmse"].min()
    with pytest.raises(ResultError, match="did you mean 'rmse'"):
        sweep.best("rsme")
    for condition in ("hf <", "hff < 1", "hf < -1", "@__import__('os').getcwd()"):
        with pytest.raises(ResultError):
            sweep.best("rmse", where=condition)


def test_a_sweep_from_python_is_what_the_command_leaves(tmp_path, monkeypatch):
    """The same table, summary and page from a file, with a folder; read back, the same frame."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    settings = ["--set", "sweep.draws=2", "--set", "run.duration=0.6", "--set", "run.metrics_from=0.1"]
    settings += ["--set", "sweep.grid={plant.payload.mass: [0, 1]}"]
    how = ["--no-figures", "--executor", "threads", "--workers", "1", "--quiet"]
    assert main(["sweep", "sweep", *settings, *how, "--out", "command"]) == 0
    done = tb.run_sweep(
        "sweep",
        draws=2,
        grid={"plant.payload.mass": [0, 1]},
        changes={"run.duration": 0.6, "run.metrics_from": 0.1},
        folder="python",
        figures=False,
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
    assert b"Every law" in again.report(figures=False)


def test_what_other_software_made_is_read_but_not_computed_anew(tmp_path):
    """Table and summary of a finished sweep are numbers that are there; a row, a figure and the page are refused."""
    experiment = tb.load_experiment(QUICK, {"disturbances": NOISE})
    done = tb.run_sweep(experiment, draws=2, folder=tmp_path / "s", figures=False, **HOW)
    before, plan = done.to_dataframe(), json.loads((tmp_path / "s" / "plan.json").read_text())
    plan["software"]["numpy"], plan["digest"] = "0.0.1", "0" * 64
    content = json.dumps(plan).encode()
    manifest = json.loads((tmp_path / "s" / "manifest.json").read_text())
    manifest["digest"], manifest["files"]["plan.json"] = plan["digest"], hashlib.sha256(content).hexdigest()
    (tmp_path / "s" / "plan.json").write_bytes(content)
    (tmp_path / "s" / "manifest.json").write_text(json.dumps(manifest))
    again = tb.load_sweep(tmp_path / "s")
    assert again.to_dataframe().equals(before)
    assert again.summary.equals(done.summary)
    for compute in (lambda: again.experiment(0), lambda: again.figure("spread"), again.report):
        with pytest.raises(ConfigError, match=r'software\.numpy: was "0\.0\.1" when the sweep began'):
            compute()
    with pytest.raises(ConfigError, match=r"software\.numpy"):
        tb.run_sweep(experiment, draws=2, folder=tmp_path / "s", figures=False, **HOW)


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
