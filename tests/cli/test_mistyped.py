"""Mistyped commands, options, files and folders: exit 2 and the nearest one that there is."""

from pathlib import Path

import pytest

from torquebench.cli.main import parser
from torquebench.errors import did_you_mean_path

COMMANDS = {name: action for action in parser()._actions if action.choices for name, action in action.choices.items()}


def swapped(word):
    """The word with its first two letters exchanged, as a hand in a hurry does."""
    return word[1] + word[0] + word[2:]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_mistyped_command(command, name):
    """Of every command, with whatever follows, the one that was meant is named, in one line after the usage."""
    status, out, err = command(swapped(name), "--whatever", "x")
    assert (status, out) == (2, "")
    assert err.splitlines()[-1] == f"COMMAND: got '{swapped(name)}' (did you mean '{name}'?)"


OPTIONS = [
    (name, flag) for name, c in COMMANDS.items() for a in c._actions for flag in a.option_strings if len(flag) > 4
]


@pytest.mark.parametrize(("name", "flag"), OPTIONS)
def test_a_mistyped_option(command, name, flag):
    """Of every option of every command, with and without a value, though arguments are missing: the one meant."""
    wrong = "--" + swapped(flag[2:])
    for words in ([wrong], [wrong, "x"], [f"{wrong}=x"]):
        status, out, err = command(name, *words)
        assert (status, out) == (2, "")
        assert err.splitlines()[-1] == f"{wrong}: torquebench {name} has no such option (did you mean '{flag}'?)"


def test_every_mistyped_option_is_named(command):
    """Two give two lines; what may be their values is not complained of."""
    err = command("video", "r", "--contollers", "a,b", "--spede", "2", "--quiet")[2]
    assert [line.split(":")[0] for line in err.splitlines()] == ["--contollers", "--spede"]


def test_what_is_near_nothing_gets_the_list(command):
    """Dashes alone are no likeness."""
    assert "(one of: --help, --version)" in command("--set")[2]
    assert "(one of: run, compare, " in command("xyz")[2]


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
