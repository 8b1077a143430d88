"""Mistyped commands, options, files and folders: exit 2 and the nearest one that there is."""

from pathlib import Path

import pytest

from tests.command_line import COMMANDS, flags
from torquebench.errors import did_you_mean_path


def swapped(word):
    """The word with its first two letters exchanged, as a hand in a hurry does."""
    return word[1] + word[0] + word[2:]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_mistyped_command(command, name):
    """Of every command, with whatever follows, the one that was meant is named, in one line."""
    status, out, err = command(swapped(name), "--whatever", "x")
    assert (status, out) == (2, "")
    assert err == f"COMMAND: got '{swapped(name)}' (did you mean '{name}'?)\n"


OPTIONS = [(name, flag) for name in COMMANDS for flag in flags(name) if len(flag) > 4]


@pytest.mark.parametrize(("name", "flag"), OPTIONS)
def test_a_mistyped_option(command, name, flag):
    """Of every option of every command, with and without a value, though arguments are missing: the one meant."""
    wrong = "--" + swapped(flag[2:])
    for words in ([wrong], [wrong, "x"], [f"{wrong}=x"]):
        status, out, err = command(name, *words)
        assert (status, out) == (2, "")
        assert err == f"{wrong}: torquebench {name} has no such option (did you mean '{flag}'?)\n"


def test_every_mistyped_option_is_named(command):
    """Two give two lines; what may be their values is not complained of."""
    err = command("video", "r", "--contollers", "a,b", "--spede", "2", "--quiet")[2]
    assert [line.split(":")[0] for line in err.splitlines()] == ["--contollers", "--spede"]


def test_what_is_near_nothing_gets_the_list(command):
    """Dashes alone are no likeness."""
    assert "wanted one of: --version, --help" in command("--set")[2]
    assert "wanted one of: run, sweep, " in command("xyz")[2]


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["--duration", "2"], "--set run.duration=2"),
        (["--control-period=0.002"], "--set run.control_period=0.002"),
        (["--payload", "--json"], "--set plant.payload="),
        (["--draws", "5"], "--set sweep.draws=5"),
    ],
)
def test_an_option_that_is_a_key(command, words, meant):
    """What is no option but a key of a section: the --set that changes it, with the value that was given."""
    status, _, err = command("run", "two-link", *words)
    assert status == 2
    assert err.endswith(f"(did you mean '{meant}'?)\n")


def test_all_wrong_values_at_once(command):
    """Each wrong value and each missing argument is a line of its own."""
    err = command("compare", "--states", "0", "--seed", "x", "--frozen-joints", "0,1")[2]
    assert [line.split(":")[0] for line in err.splitlines()] == ["--states", "--seed", "--frozen-joints", "A", "B"]


def test_one_argument_too_many(command):
    """It is named, with the command."""
    assert command("doctor", "now", "--quiet")[::2] == (
        2,
        "torquebench doctor: got 'now' as well, one argument too many\n",
    )


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A folder, also the current one, with a few files of each kind."""
    monkeypatch.chdir(tmp_path)
    Path("configs").mkdir()
    for name in ("fig9.yaml", "fig9.txt", "fig10.yaml", ".fig9.yaml", "law.py", "arm.xml"):
        Path("configs", name).touch()


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["run", "configs/fig9.yml"], "configs/fig9.yaml"),
        (["run", "configs/fgi9.yaml"], "configs/fig9.yaml"),
        (["run", "configs/FIG10.yaml"], "configs/fig10.yaml"),
        (["run", "config/fig10"], "configs/fig10.yaml"),
        (["sweep", "configs/fig9.yml"], "configs/fig9.yaml"),
        (["fuzzy", "configs/fig9.yml"], "configs/fig9.yaml"),
        (["fuzzy", "pd-48"], "pd-49"),
        (["check", "configs/lwa.py"], "configs/law.py"),
        (["run", "configs/fig9.yaml", "--plugin", "configs/laws.py"], "configs/law.py"),
        (["compare", "configs/arms.xml", "mujoco:puma560"], "configs/arm.xml"),
        (["video", "confgis"], "configs"),
        (["sweep", "--resume", "confgis"], "configs"),
        (["run", "--from-sweep", "confgis", "--index", "0"], "configs"),
    ],
)
def test_a_mistyped_path(files, command, words, meant):
    """The nearest file of the kind that is wanted, or folder, whichever part of the path is wrong."""
    status, out, err = command(*words)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert err.rstrip("\n").endswith(f"(did you mean '{meant}'?)")


@pytest.mark.parametrize(
    "path", ["nothing/like.yaml", "configs/quite-another.yaml", "configs/law.yaml", "\0", "configs"]
)
def test_a_path_near_nothing(files, path):
    """No guess where nothing of the kind is near, and none for what is there."""
    assert did_you_mean_path(Path(path), "" if path == "configs" else r"\.yaml") == ""
