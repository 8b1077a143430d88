"""``torquebench bench``: what it measures, what it writes, and bad arguments."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmarks import loops
from benchmarks.loops import HEADLINE
from benchmarks.timing import Row
from torquebench import MujocoPlant, load_trajectory
from torquebench.cli import bench
from torquebench.cli.app import main
from torquebench.cli.bench import as_markdown
from torquebench.robot.library import data_root


@pytest.mark.slow
@pytest.mark.parametrize(
    "short", [pytest.param(True, id="small"), pytest.param(False, id="large", marks=pytest.mark.slow)]
)
def test_the_command_measures_every_case(
    short: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows with name, value, unit, against, ratio, threads; the headline with one thread and two; ratios add up.

    The small size has loops of half a second, which do not meet every rule.
    """
    if short:
        monkeypatch.setattr(bench, "QUICK", (0.5, 1))
        monkeypatch.setattr(loops, "check_rules", loops.check)
    assert main(["bench", "--quick", "--rounds", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert all({"name", "value", "unit", "against", "ratio", "threads"} <= row.keys() for row in rows)
    found = {(row["name"], row["threads"]): row for row in rows}
    assert {(HEADLINE, 1), (HEADLINE, 2), ("naive-numpy-skfuzzy", 1), ("pinocchio-python", 1)} <= found.keys()
    for row in rows:
        assert row["value"] > 0.0
        if row["against"]:
            assert row["ratio"] == pytest.approx(row["value"] / found[row["against"], row["threads"]]["value"])
    table = as_markdown([Row(**row) for row in rows])
    assert all(f"| {row['name']} |" in table for row in rows)


def test_the_benchmark_is_the_loop_of_its_config(tmp_path: Path) -> None:
    """The headline is what ``torquebench run benchmarks/bench.yaml`` computes, to the byte."""
    config, out = data_root() / "benchmarks" / "bench.yaml", tmp_path / "out"
    assert main(["run", str(config), "--set", "run.duration=0.5", "--no-figures", "--out", str(out)]) == 0
    own = loops.run(MujocoPlant("puma560", 0.001, "euler"), loops.trial_of(0.5))
    assert own.digest() == load_trajectory(out / "fuzzy" / "trajectory.npz").digest()


def test_an_installed_wheel_has_no_benchmarks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line says where they are, and the exit status is 2."""
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    monkeypatch.delitem(sys.modules, "benchmarks")
    assert main(["bench", "--quick"]) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert "run it in a checkout" in printed.err


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        (["--rounds", "0"], "--rounds"),
        (["--threads", "0"], "--threads"),
    ],
)
def test_bad_arguments(arguments: list[str], place: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 2 and one line with the argument's name."""
    assert main(["bench", *arguments]) == 2
    assert capsys.readouterr().err.startswith(place)
