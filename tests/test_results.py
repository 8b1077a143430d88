"""Experiments from Python: the same numbers and the same bytes as the command line, as frames, figures and pages."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import torquebench as tb
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError
from torquebench.experiment.store import check_run
from torquebench.registry import restored

QUICK = {
    "name": "quick",
    "plant": {"engine": "mujoco", "model": "two-link"},
    "controllers": [
        {"name": "conventional", "law": "smc", "switching": "sign", "gains": {"lam": 10, "k": 0.3}},
        {"name": "band", "law": "linear-band-smc", "gains": {"lam": 10, "k": [0.3, 0.3], "phi": 0.3, "kv": 20}},
    ],
    "reference": {"kind": "sine", "amplitude": 1.0, "frequency_hz": 1.0},
    "run": {"duration": 0.6, "metrics_from": 0.1},
}
LAW = '''
from typing import Annotated, NamedTuple
from torquebench import Array, Gain, controller

class Gains(NamedTuple):
    at: Annotated[Array, Gain("time of the failure", "s")]

@controller("fails-at", gains=Gains)
def fails_at(gains, model, t, q, qd, ref, memory, tau):
    """Zero torque until gains.at, then NaN."""
    for i in range(len(tau)):
        tau[i] = 0.0 if t < gains.at[i] else float("nan")
'''


@pytest.fixture(scope="module")
def result():
    """A run of the small experiment."""
    return tb.run_experiment(QUICK)


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """A run in which one controller fails at 0.2 s."""
    file = tmp_path_factory.mktemp("law") / "law.py"
    file.write_text(LAW)
    with restored():
        broken = {"name": "broken", "law": "fails-at", "gains": {"at": 0.2}}
        result = tb.run_experiment(QUICK | {"controllers": [*QUICK["controllers"], broken]}, plugins=[file])
        result.save(file.parent / "saved")
        yield result


def test_a_result_saved_from_python_is_what_the_command_leaves(result, tmp_path, monkeypatch):
    """Every file is the same in every byte; `run_experiment` with a folder and `Result.save` leave the same."""
    monkeypatch.chdir(tmp_path)
    Path("quick.yaml").write_text(json.dumps(QUICK))
    assert main(["run", "quick.yaml", "--out", "command", "--quiet"]) == 0
    assert result.save("saved") == Path("saved")
    stored = tb.run_experiment(QUICK, folder="stored")
    files = check_run(Path("command"))["files"]
    assert check_run(Path("saved"))["files"] == files
    assert Path("saved/manifest.json").read_bytes() == Path("command/manifest.json").read_bytes()
    numbers = {name: files[name] for name in files if name.endswith((".npz", ".yaml")) or name == "metrics.json"}
    assert numbers.items() <= check_run(Path("stored"))["files"].items()
    assert stored.folder == Path("stored")


def test_what_is_read_back_is_what_was_run(result, tmp_path):
    """Frames, outcomes, certificates, page: equal, though nothing is computed."""
    folder = tb.run_experiment(QUICK, folder=tmp_path / "r").folder
    again = tb.load_result(folder)
    assert again.to_dataframe().equals(result.to_dataframe())
    assert again.joint_metrics.equals(result.joint_metrics)
    assert again.trajectory_frame("band").equals(result.trajectory_frame("band"))
    assert (again.conditions, again.joints, again.outcomes) == (result.conditions, result.joints, result.outcomes)
    assert again.certificates == result.certificates
    assert again.report() == (folder / "report.html").read_bytes()
    assert again.experiment == result.experiment
    with pytest.raises(ResultError, match="is stored already"):
        again.save(tmp_path / "copy")


def test_the_metrics_are_a_frame_with_units(result):
    """One row for each controller, in SI units, the numbers of metrics.json; each column has its unit."""
    table = result.metrics
    assert list(table.index) == ["conventional", "band"]
    for name in table.index:
        for key, metric in result.numbers.metrics[name].to_json().items():
            value = metric["value"]
            assert table.loc[name, key] == value or (value is None and math.isnan(table.loc[name, key]))
    assert table.attrs["units"]["rmse"] == "rad"
    assert set(table.attrs["units"]) == set(table.columns)
    joints = result.joint_metrics
    assert list(joints.columns) == list(result.joints.names)
    assert joints.loc[("band", "rmse")].tolist() == list(result.numbers.metrics["band"].rmse.per_joint)


def test_a_failed_run_has_an_outcome_and_no_metrics(failed):
    """NaN in every metric, the time of the failure, and the others as they are."""
    table = failed.to_dataframe()
    assert table.loc["broken", "outcome"] == "BAD_TORQUE"
    assert table.loc["broken", "failed_at"] == 0.2
    assert failed.metrics.loc["broken"].isna().all()
    assert failed.metrics.loc["band", "rmse"] > 0.0
    assert failed.outcomes["broken"] is tb.Outcome.BAD_TORQUE
    assert "broken" not in failed.joint_metrics.index
    assert len(failed.trajectory_frame("broken")) == 201
    again = tb.load_result(failed.folder, plugins=failed.plugins)
    assert again.to_dataframe().equals(table)
    assert check_run(failed.folder)["plugins"].keys() == {"law.py"}


def test_a_trajectory_is_a_frame_with_names_and_units(result):
    """A column for each signal and joint, a row for each instant."""
    frame, run = result.trajectory_frame("band"), result.trajectories["band"]
    joint = result.joints.names[1]
    assert np.array_equal(frame["t [s]"], run.t)
    assert np.array_equal(frame[f"q:{joint} [rad]"], run.q[:, 1])
    assert np.array_equal(frame[f"tau:{joint} [N m]"], run.tau[:, 1])
    with pytest.raises(ResultError, match="did you mean 'band'"):
        result.trajectory_frame("bnad")


def test_figures_and_pages(result, tmp_path):
    """A figure by its name, files of some; the nearest name where there is none; a page."""
    assert len(result.figure("torque").axes) >= 2
    with pytest.raises(ResultError, match="did you mean 'torque'"):
        result.figure("torqe")
    paths = result.figures(tmp_path / "drawn", only=["error"], pdf=True)
    assert [path.name for path in paths] == ["error.svg", "error.png", "error.pdf"]
    assert all(path.stat().st_size > 1000 for path in paths)
    with pytest.raises(ConfigError, match=r"only: got 'errors' .did you mean 'error'"):
        result.figures(tmp_path / "other", only=["errors"])
    assert not (tmp_path / "other").exists()
    page = tb.run_experiment(QUICK).report(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_bytes() == page
    assert b"band" in page


def test_a_notebook_shows_tables_and_no_markup_of_the_config(result):
    """Text of a config is text."""
    shown = result._repr_html_()
    assert "<table" in shown
    assert "RMSE [mrad]" in shown
    assert "follows best: RMS error" in shown
    assert "<" not in repr(result).strip("<>")
    assert "2 of 2 controllers completed" in repr(result)


def test_keys_can_be_changed(result):
    """By dotted keys with numbers, arrays and mappings; a key that does not exist is answered with the nearest."""
    changed = result.experiment.with_({"run.duration": 0.7, "controllers.band.gains.phi": np.array([0.1, 0.2])})
    assert changed.run.duration == 0.7
    assert changed.controllers[1].gains["phi"] == (0.1, 0.2)
    assert result.experiment.run.duration == 0.6
    assert tb.load_experiment(QUICK, {"run.duration": 0.7}).run.duration == 0.7
    with pytest.raises(ConfigError, match="phi"):
        result.experiment.with_({"controllers.band.gains.phii": 0.1})
    for value in (float("nan"), object(), 3j):
        with pytest.raises(ConfigError, match=r"run\.duration: got .*, wanted a "):
            result.experiment.with_({"run.duration": value})


@pytest.mark.parametrize("name", ["fig9-chattering", "paper/fig9-chattering"])
def test_shipped_configs_have_names(name):
    """A shipped config by its name, from any folder, as text or path."""
    assert tb.load_experiment(name).name == "fig9-chattering"
    assert tb.load_experiment(Path(name)).name == "fig9-chattering"


def test_a_config_that_does_not_exist_is_bad_input():
    """The nearest name is in the message."""
    with pytest.raises(ConfigError, match="fig9-chattering"):
        tb.load_experiment("fig9-chatering")
    with pytest.raises(ConfigError, match="reference"):
        tb.load_experiment({key: value for key, value in QUICK.items() if key != "reference"})


def test_progress_is_reported():
    """Steps of both controllers, up to all of them."""
    seen = []
    tb.run_experiment(QUICK, progress=lambda *told: seen.append(told))
    assert seen[-1] == ("band", 1200, 1200)
    assert all(done <= whole == 1200 for _, done, whole in seen)


def test_a_plugin_can_be_edited_and_used_again(tmp_path, registries):
    """The second run has the law as the file has it now; a file that fails leaves the law that there was."""
    law = LAW.replace("fails-at", "edited")
    broken = {"name": "broken", "law": "edited", "gains": {"at": 0.2}}
    config, file = QUICK | {"controllers": [broken]}, tmp_path / "edited.py"
    for value in ("0.0", "1.50", "2.250"):
        file.write_text(law.replace("tau[i] = 0.0 if", f"tau[i] = {value} if"))
        result = tb.run_experiment(config, plugins=[file], path="python")
        assert result.trajectories["broken"].tau[0, 0] == float(value)
    file.write_text("raise RuntimeError")
    with pytest.raises(ConfigError, match="RuntimeError"):
        tb.run_experiment(config, plugins=[file])
    assert tb.find_law("edited")
    file.write_text(law + law)
    with pytest.raises(ConfigError, match="already registered"):
        tb.run_experiment(config, plugins=[file])
