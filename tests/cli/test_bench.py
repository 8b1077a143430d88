"""``torquebench bench``: what it measures, what it writes, and bad arguments."""

from __future__ import annotations

import json

import pytest

from torquebench.bench.loops import HEADLINE, experiment_of
from torquebench.bench.timing import Row
from torquebench.cli.app import main
from torquebench.cli.bench import as_markdown


def test_the_command_measures_every_case(capsys: pytest.CaptureFixture[str]) -> None:
    """Rows with name, value, unit, against, ratio, threads; the headline with one thread and two; ratios add up."""
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


def test_the_benchmark_is_the_proposed_law_recorded_in_full() -> None:
    """The headline runs the fuzzy linear band with the frozen-wrist model on all six joints, without noise."""
    experiment, loop = experiment_of(duration=4.0)
    assert experiment.model.structure == "corrected"
    (controller,) = loop.controllers
    assert controller.law.name == "fuzzy-linear-band-smc"
    assert controller.gains.equivalent_control == 1
    assert controller.gains.kf.min() > 0.0
    assert loop.disturbance is None
    assert loop.position_noise is None


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
