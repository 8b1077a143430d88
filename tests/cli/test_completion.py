"""``torquebench completion``: what each shell offers, asked of the shells themselves where they are installed."""

import json
import os
import pty
import select
import shutil
import subprocess
import time

import pytest

from torquebench.analysis.sides import parse_side
from torquebench.cli import words
from torquebench.cli.completion import commands_of
from torquebench.cli.main import main, parser
from torquebench.fuzzy import BUILTIN
from torquebench.robot.library import data_root
from torquebench.video.settings import QUALITIES

LINES = {
    "torquebench pap": "paper",
    "torquebench video --qual": "--quality",
    "torquebench video --quality pre": "pretty",
    "torquebench compare a mujoco:pu": "puma560",
    "torquebench run --set run.dur": "run.duration=",
    "torquebench completion f": "fish",
    "torquebench run conf": "config.yaml",
    "torquebench run --plugin my": "my law.py",
    "torquebench report a": "a-run/",
    "torquebench doctor --js": "--json",
}
"""What is typed -> what must be offered, alone."""


@pytest.fixture
def script(tmp_path, monkeypatch, capsys):
    """Print a shell's script to a file and return its path, in a folder with files to offer."""
    monkeypatch.chdir(tmp_path)
    for name in ("config.yaml", "config.txt", "my law.py", "my law.txt"):
        (tmp_path / name).touch()
    (tmp_path / "a-run").mkdir()
    (tmp_path / "a-file").touch()

    def make(shell):
        assert main(["completion", shell]) == 0
        path = tmp_path / "script"
        path.write_text(capsys.readouterr().out)
        return path

    return make


BASH = """
source ./script
while IFS= read -r COMP_LINE; do
    COMP_POINT=${#COMP_LINE}
    COMPREPLY=()
    _torquebench
    (IFS='|'; echo "${COMPREPLY[*]}")
done
"""


def offered_by_bash(lines):
    """Return what bash is told to offer for each line."""
    done = subprocess.run(["bash", "--norc", "-c", BASH], input="\n".join(lines) + "\n", capture_output=True, text=True)
    assert done.stderr == ""
    return [line.split("|") if line else [] for line in done.stdout.splitlines()]


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash(script):
    """Commands, options, choices, values after = and after a colon, files of the right kind, folders; nothing else."""
    script("bash")
    more = {
        "torquebench video --quality=pre": ["pretty"],
        "torquebench run --out a": ["a-run"],
        "torquebench fly x": [],
    }
    found = offered_by_bash([*LINES, *more, "torquebench ", "torquebench fuzzy "])
    for line, wanted, offered in zip(LINES, LINES.values(), found, strict=False):
        assert offered == [wanted.rstrip("/")], line
    assert found[len(LINES) : -2] == list(more.values())
    assert set(found[-2]) == {command.name for command in commands_of(parser()) if command.name}
    assert set(found[-1]) >= {*words.SYSTEMS, "config.yaml", "a-run"}
    assert "config.txt" not in found[-1]


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
def test_fish(script):
    """The same lines, asked with fish's own `complete -C`; fish offers other files too, after the right ones."""
    script("fish")
    lines = LINES | {"torquebench compare a mujoco:pu": "mujoco:puma560"}
    code = "source ./script\n" + "\n".join(f"echo; complete -C '{line}'" for line in lines)
    done = subprocess.run(["fish", "--no-config", "-c", code], capture_output=True, text=True, check=True)
    answers = done.stdout.split("\n\n")
    assert done.stderr == ""
    for (line, wanted), answer in zip(lines.items(), answers, strict=True):
        offered = [row.partition("\t")[0].replace("\\ ", " ") for row in answer.strip().splitlines()]
        assert wanted in offered, (line, answer)


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh(script):
    """The same lines, typed into an interactive zsh and completed with Tab."""
    script("zsh")
    terminal, other = pty.openpty()
    zsh = subprocess.Popen(
        ["zsh", "-f", "-i"],
        stdin=other,
        stdout=other,
        stderr=other,
        start_new_session=True,
        env=os.environ | {"TERM": "dumb"},
    )
    os.close(other)
    try:
        os.write(terminal, b"autoload -Uz compinit; compinit -D -u; unsetopt prompt_sp; . ./script; echo rea''dy\n")
        read(terminal, "ready")
        for line, wanted in LINES.items():
            os.write(terminal, f"{line}\t".encode())
            shown = (
                line.rpartition(" ")[0] + " " + {"puma560": "mujoco:puma560"}.get(wanted, wanted).replace(" ", "\\ ")
            )
            read(terminal, shown)
            os.write(terminal, b"\x15")
    finally:
        zsh.kill()
        zsh.wait()
        os.close(terminal)


def read(terminal, wanted):
    """Read what the shell writes until it has written `wanted`."""
    seen, end = "", time.monotonic() + 60.0
    while wanted not in seen:
        assert time.monotonic() < end, seen
        if select.select([terminal], [], [], 1.0)[0]:
            seen += os.read(terminal, 65536).decode()


def test_every_command_and_option_is_in_every_script(capsys):
    """Nothing of the parser is forgotten."""
    for shell in ("bash", "zsh", "fish"):
        main(["completion", shell, "--json"])
        text = json.loads(capsys.readouterr().out)["script"]
        for command in commands_of(parser()):
            assert command.name in text
            for option in command.options:
                long = option.flags[-1].removeprefix("--")
                assert f"-l {long}" in text if shell == "fish" else f"--{long}" in text


def test_the_words_are_those_that_are_accepted():
    """Names are kept by hand, as asking for them would take a second: they are the registries' own."""
    assert set(words.SYSTEMS) == set(BUILTIN)
    assert set(words.QUALITIES) == set(QUALITIES)
    for side in words.SIDES:
        parse_side(side, "A")
    schema = json.loads((data_root() / "configs" / "schema.json").read_text())
    for word in words.SETTINGS:
        place = schema
        for key in word.rstrip("=.").split("."):
            place = find(schema, place, key)
            assert place is not None, word


def find(schema, place, key):
    """Return the schema of a key below a place of a JSON schema, through references and alternatives; None without."""
    if "$ref" in place:
        place = schema["$defs"][place["$ref"].rpartition("/")[2]]
    if key in place.get("properties", {}):
        return place["properties"][key]
    below = [find(schema, other, key) for word in ("anyOf", "oneOf", "allOf") for other in place.get(word, [])]
    return next((found for found in below if found is not None), None)
