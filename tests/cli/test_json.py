"""Every command's ``--json``, ``--quiet`` and ``--help``: a document that agrees with files, silence, an example."""

import json
import math
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

import benchmarks
from benchmarks.timing import Row
from tests.cli.conftest import QUICK
from tests.cli.test_check import GOOD
from tests.command_line import COMMANDS, flags, parsed
from tests.experiment.bad_configs import BAD
from torquebench import check
from torquebench.cli.app import main
from torquebench.errors import UNCHECKED, ConfigError, Problem
from torquebench.experiment import parse_experiment
from torquebench.experiment.store import check_run
from torquebench.plain import plain

ENVELOPE = {"command", "status", "problems", "error", "remarks"}


def refuse(word):
    """No bare NaN or Infinity."""
    raise AssertionError(word)


@pytest.fixture
def document(command, monkeypatch):
    """Run a command with --json on a terminal and return what it printed, after what all documents promise."""

    def run(*arguments, status=0):
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        found, out, err = command(*arguments, "--json")
        data = json.loads(out, parse_constant=refuse)
        assert found == status == data["status"], err
        assert data["command"] == arguments[0]
        assert data.keys() >= ENVELOPE
        return data, err

    return run


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder of a finished run."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "quick.yaml").write_text(QUICK)
    assert main(["run", str(folder / "quick.yaml"), "--out", str(folder / "run"), "--no-figures", "--quiet"]) == 0
    return folder / "run"


def test_run(quick, document):
    """Metrics, certificates and outcomes are those of the run's files, at full precision; progress is still shown."""
    data, err = document("run", quick, "--out", "result", "--no-figures")
    folder = quick.parent / "result"
    assert data["directory"] == "result"
    stored = json.loads((folder / "metrics.json").read_text())["controllers"]
    outcomes = check_run(folder)["outcomes"]
    assert list(data["controllers"]) == ["conventional", "linear-band"]
    for name, told in data["controllers"].items():
        assert told["metrics"] == stored[name]
        assert {key: told[key] for key in outcomes[name]} == outcomes[name]
        assert told["expected"]
    assert data["certificates"] == json.loads((folder / "certificates.json").read_text())
    assert "%" in err


def test_run_with_a_talkative_plug_in(quick, document, registries):
    """What a plug-in prints is no part of the document; a failed run is in it, and the exit status is 1."""
    (quick.parent / "my_law.py").write_text(GOOD + "\nprint('loaded')\n")
    line = "  - {name: mine, law: good, gains: {k: 0.5}, expect: failed}\n"
    quick.write_text(quick.read_text().replace("reference:", line + "reference:"))
    data, err = document("run", quick, "--no-figures", "--plugin", "my_law.py", status=1)
    assert not data["controllers"]["mine"]["expected"]
    assert data["controllers"]["mine"]["outcome"] == "COMPLETED"
    assert "loaded" in err


def test_report_and_video(finished, tmp_path, document, monkeypatch):
    """The page and the picture are where the document says, and its metrics are the run's."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    data, _ = document("report", finished, "--out", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text().startswith("<!doctype html>")
    assert data["report"] == str(tmp_path / "page.html")
    stored = json.loads((finished / "metrics.json").read_text())["controllers"]
    assert {name: told["metrics"] for name, told in data["runs"][0]["controllers"].items()} == stored
    data, err = document("video", finished, "--still", "0.1", "--out", tmp_path / "still.png", "--size", "320x240")
    assert data["film"]["file"] == str(tmp_path / "still.png")
    assert (tmp_path / "still.png").read_bytes().startswith(b"\x89PNG")
    assert data["film"]["backend"] == "stick"
    assert "looking for what draws" in err


def test_compare(document):
    """Every row of the table as numbers; they differ, so the status is 1."""
    data, err = document("compare", "analytic:puma560", "analytic:puma560:corrected", "--states", "20", status=1)
    assert not data["agree"]
    assert all(
        row["agrees"] == (row["relative"] <= row["limit"]) for row in data["rows"] if row["measure"] == "relative"
    )
    assert "%" in err


def test_fuzzy(tmp_path, monkeypatch, document):
    """Sizes and evaluation of the system, and its figures where the document says."""
    monkeypatch.chdir(tmp_path)
    data, err = document("fuzzy", "s-7", "--out", "figures")
    assert data["systems"]["s-7"]["rules"] == 7
    assert data["systems"]["s-7"]["error_bound"] >= 0.0
    assert (tmp_path / data["directory"] / "s-7-membership.svg").is_file()
    assert "%" in err


def test_check(tmp_path, monkeypatch, document, registries):
    """As before, within the envelope."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(check, "SCALES", (1.0,))
    monkeypatch.setattr(check, "DURATION", 0.02)
    (tmp_path / "laws.py").write_text(GOOD)
    data, _ = document("check", "laws.py")
    assert data["held"]
    assert [law["law"] for law in data["laws"]] == ["good"]


def test_bench(monkeypatch, document, command):
    """--json prints the rows that the table shows."""
    row = Row("case", 1234.5678, "steps/s", "", None, (1.0, 2.0), 1, 3, "what it is")
    monkeypatch.setattr(benchmarks, "run", lambda *_: ([row], ["one that is not here"]))
    data, err = document("bench", "--quick")
    status, out, _ = command("bench", "--quick")
    assert status == 0
    assert data["rows"][0]["value"] == 1234.5678
    assert data["left_out"] == ["one that is not here"]
    assert "1,230" in out
    assert "setting up" in err


def test_completion(document, command):
    """The script as text."""
    data, _ = document("completion", "bash")
    assert data["script"] + "\n" == command("completion", "bash")[1]


@pytest.mark.parametrize(
    ("arguments", "option", "wanted"),
    [
        (["run"], "CONFIG", "an experiment's file, or --from-sweep"),
        (["run", "a.yaml", "--colour"], "--colour", None),
        (["run", "--duration", "2"], "--duration", "--set run.duration=2"),
        (["run", "two-lnk"], None, "two-link"),
        (["video", "r", "--size", "huge"], "--size", "WIDTHxHEIGHT, for example 640x480"),
        (["fuzy"], "COMMAND", "fuzzy"),
        (["compare", "mujoco:puma", "analytic:puma560"], "A", None),
        (["paper", "--workers", "0"], "--workers", "1 to 4096"),
        (["completion", "bsh"], "SHELL", "bash"),
    ],
)
def test_bad_arguments(tmp_path, monkeypatch, command, arguments, option, wanted):
    """Exit 2, one line for each problem on standard error, and the problems in the document, with what was wanted."""
    monkeypatch.chdir(tmp_path)
    status, out, err = command(*arguments, "--json", "--quiet")
    data = json.loads(out)
    assert status == data["status"] == 2
    assert len(err.splitlines()) == len(data["problems"]) == 1
    (problem,) = data["problems"]
    assert problem["message"] in err
    assert problem["option"] == option
    if wanted is not None:
        assert problem["wanted"] == wanted
    assert list(tmp_path.iterdir()) == []


def test_bad_config(quick, command):
    """Every mistake with file, line, column, key, message and what was wanted; nothing but the document on stdout."""
    quick.write_text(quick.read_text().replace("lam: 10, k: 0.3}", "lamb: 10, k: -1}"))
    column = next(line for line in quick.read_text().splitlines() if "lamb:" in line).index("lamb:") + 1
    status, out, err = command("run", "quick.yaml", "--json")
    problems = json.loads(out)["problems"]
    assert status == 2
    assert [p["message"] for p in problems] == [line.split(": ", 2)[2] for line in err.splitlines()[:-1]]
    assert json.loads(out)["remarks"] == [UNCHECKED] == err.splitlines()[-1:]
    assert problems[0] == {
        "file": "quick.yaml",
        "line": 5,
        "column": column,
        "option": None,
        "key": "controllers[0].gains.lamb",
        "message": "unknown gain (did you mean 'lam'?)",
        "wanted": "lam",
    }


def test_every_mistake_in_a_config_can_be_placed():
    """Of all bad configs: the file's name, the line, the key; what was wanted, where the message says so."""
    found = 0
    for bad in BAD:
        with pytest.raises(ConfigError) as caught:
            parse_experiment(bad.config, "a b:c.yaml")
        told = caught.value.problems[0].to_json()
        assert (told["file"], told["line"], told["option"]) == ("a b:c.yaml", bad.line, None)
        assert told["column"] >= 1
        found += told["wanted"] is not None
    assert found > 0.7 * len(BAD)


@pytest.mark.parametrize(
    ("problem", "place", "wanted"),
    [
        (
            Problem("--set run.seed=x", "run.seed", got="'x'", wanted="a number"),
            ("option", "--set run.seed=x"),
            "a number",
        ),
        (Problem("RUN", "", "runs/a: there is no such folder"), ("option", "RUN"), None),
        (Problem("missing.yaml", "", "does not exist"), ("file", "missing.yaml"), None),
        (Problem("x.yaml", "law", "unknown", wanted="a or b", line=1, column=2), ("file", "x.yaml"), "a or b"),
        (Problem("", "reference", "too fast"), ("option", None), None),
    ],
)
def test_where_a_problem_is(problem, place, wanted):
    """An option or an argument, or a file."""
    told = problem.to_json()
    assert told[place[0]] == place[1]
    assert told["wanted"] == wanted


def test_no_number_without_a_value():
    """NaN and infinities are null at any depth, in arrays and tuples too; everything else keeps its value."""
    value = {
        "a": [math.nan, 1.5, (math.inf,)],
        "b": np.array([1.0, -math.inf]),
        "c": np.float64(0.1),
        "d": True,
        "e": None,
    }
    assert plain(value) == {"a": [None, 1.5, [None]], "b": [1.0, None], "c": 0.1, "d": True, "e": None}


@pytest.mark.parametrize("error", [RuntimeError("boom"), OSError(28, "No space left"), KeyboardInterrupt()])
def test_an_end_before_the_end(monkeypatch, command, error):
    """The document says why, whatever it was, and has the exit status."""

    def fail(_wish):
        raise error

    monkeypatch.setattr("torquebench.cli.doctor.findings", fail)
    status, out, err = command("doctor", "--json")
    data = json.loads(out)
    assert status == data["status"] == (130 if isinstance(error, KeyboardInterrupt) else 3)
    assert data["error"]
    assert data["error"] in err


@pytest.mark.parametrize("arguments", [["report"], ["video", "--still", "0.1", "--size", "320x240", "--out", "x.png"]])
def test_quiet(finished, tmp_path, monkeypatch, command, arguments):
    """Nothing on either stream, on a terminal too, and the same exit status."""
    monkeypatch.setenv("MUJOCO_GL", "off")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    more = ["--out", "page.html"] if arguments[0] == "report" else []
    assert command(arguments[0], finished, *arguments[1:], *more, "--quiet") == (0, "", "")


def test_quiet_keeps_the_exit_status(command):
    """A comparison that differs is 1 without a word; bad input is its one line."""
    assert command("compare", "analytic:puma560", "analytic:puma560:corrected", "--states", "20", "--quiet") == (
        1,
        "",
        "",
    )
    status, out, err = command("video", "--quiet")
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1


def test_the_documents_of_all_commands_are_described():
    """docs/command-line.md has one row for the keys of each command that has --json, and none for anything else."""
    text = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    table = text.split("| command | keys |\n|---|---|\n")[1].split("\n\n")[0]
    rows = [re.match(r"\| `([a-z-]+)` \| \S", line) for line in table.splitlines()]
    assert all(rows)
    assert sorted(row[1] for row in rows) == sorted(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_quiet_json_and_an_example(name, capsys):
    """Whatever is added: the options are there, and the last line of the help is a command that parses."""
    assert {"--quiet", "--json", "--verbose", "--help"} <= set(flags(name))
    assert main([name, "--help"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"\n\nExample: torquebench .*\n$", out)
    words = shlex.split(out.splitlines()[-1])[2:]
    assert parsed(words)["command"] == name
