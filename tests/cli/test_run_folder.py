"""What is no finished run, given to ``report``, ``video`` and ``view``: each case is told apart, with what to do."""

import shlex
import shutil
from pathlib import Path

import pytest

from tests.cli.conftest import QUICK
from tests.sweep.examples import SMALL
from torquebench.cli.app import main
from torquebench.experiment.store import check_run, write_manifest

COMMANDS = ("report", "video", "view")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder with a finished run, an unfinished one, what a fuzzy system left, a small sweep, and one unfinished."""
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        Path("quick.yaml").write_text(QUICK)
        Path("small.yaml").write_text(SMALL)
        assert main(["run", "quick.yaml", "--out", "run", "--no-figures", "--quiet"]) == 0
        shutil.copytree("run", "half")
        Path("half/manifest.json").unlink()
        Path("half/unfinished").touch()
        Path("empty").mkdir()
        how = ("--set", "sweep.draws=1", "--executor", "threads", "--workers", "1", "--quiet")
        assert main(["sweep", "small.yaml", "--out", "swept", *how]) == 0
        shutil.copytree("swept", "half-swept")
        Path("half-swept/manifest.json").unlink()
        shutil.copytree("run", "other")  # a finished folder without experiment, as `paper` leaves one
        write_manifest(Path("other"), {"files": {}})
        Path("other/experiment.yaml").unlink()
    return folder


@pytest.fixture
def here(results, monkeypatch):
    """The folder with the results, as the current one."""
    monkeypatch.chdir(results)
    return results


@pytest.mark.parametrize("command_name", COMMANDS)
@pytest.mark.parametrize(
    ("folder", "said"),
    [
        ("rum", "rum: there is no such folder (did you mean 'run'?)"),
        (
            "half",
            "half: the run has not finished (no manifest.json): wait if it is running, else run it again: "
            "torquebench run half/experiment.yaml --out NEW",
        ),
        ("empty", "empty: is not a run (no manifest.json), wanted a folder that `torquebench run` left"),
        ("quick.yaml", "quick.yaml: is a file, wanted the folder that `torquebench run` left"),
        ("other", "other: holds results of another command, wanted a folder that `torquebench run` left"),
    ],
)
def test_each_case_has_its_own_message(here, command, command_name, folder, said):
    """Exit 2 and one line: the folder, what it is, what to do; the same for every command; nothing is written."""
    before = sorted(here.rglob("*"))
    status, out, err = command(command_name, folder)
    assert (status, out, err) == (2, "", f"RUN: {said}\n")
    assert sorted(here.rglob("*")) == before


def test_a_folder_of_runs_is_no_run_and_one_in_it_is_named(here, command):
    """The folder in which results lie is not taken for a run: the example given is one, or a sweep."""
    err = command("view", here)[2]
    example = Path(err.rstrip("\n").split(", such as ")[1])
    assert example.parent == here
    assert check_run(example)


def test_what_is_advised_for_an_unfinished_run_works(here, tmp_path, command):
    """The command that is named, with a folder for NEW, runs the same experiment to its end."""
    words = shlex.split(command("view", "half")[2].split("run it again: ")[1])
    assert words[-1] == "NEW"
    assert command(*words[1:-1], tmp_path / "new", "--no-figures")[0] == 0
    assert check_run(tmp_path / "new")["outcomes"] == check_run(here / "run")["outcomes"]


@pytest.mark.parametrize("folder", ["swept", "half-swept"])
@pytest.mark.parametrize("command_name", ["video", "view"])
def test_a_sweep_is_called_one_and_the_advice_works(here, tmp_path, command, command_name, folder):
    """Exit 2, that it is a sweep, and a command line that, with a row for K, leaves a run that the command can read."""
    status, out, err = command(command_name, folder)
    assert (status, out) == (2, "")
    assert err.startswith(f"RUN: {folder}: is a sweep")
    first, then = err.rstrip("\n").split(": ")[-1].split(", then ")
    assert then == f"torquebench {command_name} OUT"
    words = [{"K": "3", "OUT": str(tmp_path / "out")}.get(word, word) for word in shlex.split(first)]
    assert words[:3] == ["torquebench", "run", "--from-sweep"]
    assert command(*words[1:], "--no-figures")[0] == 0
    assert check_run(tmp_path / "out")["outcomes"]


def test_report_names_every_bad_folder_at_once(here, command):
    """Four of five cannot be read: four lines, each with its folder and reason; a sweep is one among several."""
    status, out, err = command("report", "rum", "run", "half", "empty", "swept", "--out", "page.html")
    assert (status, out) == (2, "")
    lines = err.splitlines()
    reasons = {"rum": "no such folder", "half": "not finished", "empty": "is not a run", "swept": "is a sweep"}
    assert len(lines) == len(reasons)
    for line, (folder, reason) in zip(lines, reasons.items(), strict=True):
        assert line.startswith(f"RUN: {folder}: ")
        assert reason in line
    assert "torquebench report swept, with nothing else" in lines[-1]
    assert not Path("page.html").exists()
