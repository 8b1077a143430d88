"""``torquebench completion``: what is offered for a line, asked of bash itself, and of the answer to any shell."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.shell_completion import FishComplete

import torquebench
from tests.command_line import COMMANDS, flags
from torquebench.chain import CHAINS
from torquebench.cli.app import app, main
from torquebench.cli.compare import SideName
from torquebench.cli.discover import Shown
from torquebench.cli.fuzzy import SYSTEMS
from torquebench.comparison import parse_side
from torquebench.fuzzy import BUILTIN
from torquebench.laws import law_names
from torquebench.robot.library import model_names
from torquebench.shipped import config_keys, configs

LINES = {
    "torquebench pap": ["paper"],
    "torquebench video --qual": ["--quality"],
    "torquebench video --quality pre": ["pretty"],
    "torquebench video --quality=pre": ["pretty"],
    "torquebench compare a mujoco:pu": ["puma560"],
    "torquebench run --set run.dur": ["run.duration="],
    "torquebench run config.yaml --set controllers.b": [
        "controllers.band.gains.phi=",
        "controllers.band.law=",
        "controllers.band.name=",
    ],
    "torquebench completion f": ["fish"],
    "torquebench run confi": ["config.yaml"],
    "torquebench run fig9-ch": ["fig9-chattering"],
    "torquebench run paper/fig9-ch": ["paper/fig9-chattering"],
    "torquebench run --plugin my": ["my law.py"],
    "torquebench report a": ["a-run/"],
    "torquebench run --out a": ["a-run/"],
    "torquebench show linear": ["linear-band-smc"],
    "torquebench fuzzy pd-4": ["pd-49"],
    "torquebench doctor --js": ["--json"],
    "torquebench fly x": [],
}
"""What is typed -> what must be offered, alone."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder, also the current one, with files to offer, and the command on PATH."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.yaml").write_text("controllers:\n  - {name: band, law: smc, gains: {phi: 1}}\n")
    for name in ("config.txt", "my law.py", "my law.txt", "a-file"):
        (tmp_path / name).touch()
    (tmp_path / "a-run").mkdir()
    program = tmp_path / "bin" / "torquebench"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m torquebench "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PYTHONPATH", str(Path(torquebench.__file__).parents[1]))
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    return tmp_path


BASH = """
source ./script
while IFS= read -r COMP_LINE; do
    COMP_POINT=${#COMP_LINE}
    _torquebench_completion torquebench
    (IFS='|'; echo "${COMPREPLY[*]}")
done
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash(folder, capsys):
    """Commands, options, choices, values after = and after a colon, files of the right kind, folders; nothing else."""
    assert main(["completion", "bash"]) == 0
    (folder / "script").write_text(capsys.readouterr().out)
    lines = [*LINES, "torquebench ", "torquebench fuzzy "]
    done = subprocess.run(["bash", "--norc", "-c", BASH], input="\n".join(lines) + "\n", capture_output=True, text=True)
    assert done.stderr == ""
    offered = [line.split("|") if line else [] for line in done.stdout.splitlines()]
    for line, wanted, found in zip(LINES, LINES.values(), offered, strict=False):
        assert found == wanted, line
    assert offered[-2] == list(COMMANDS)
    assert set(offered[-1]) >= {*SYSTEMS, *configs(), "config.yaml", "a-run/"}
    assert "config.txt" not in offered[-1]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells(folder, shell):
    """The program answers the scripts of zsh and fish with the same words."""
    for line in ("torquebench video --qual", "torquebench run --set run.dur", "torquebench report a"):
        words = line.split()
        count = str(len(words) - 1) if shell == "zsh" else words[-1]
        asked = {"_TORQUEBENCH_COMPLETE": f"{shell}_complete", "COMP_WORDS": line, "COMP_CWORD": count}
        done = subprocess.run(["torquebench"], env=os.environ | asked, capture_output=True, text=True, check=True)
        assert LINES[line][0] in done.stdout.replace("\t", "\n").replace(",", "\n").splitlines()


def test_completing_is_light(folder):
    """No shell waits for numpy, numba or pydantic: asking for keys of a config on the line needs YAML alone."""
    code = (
        "import sys; from torquebench.cli.app import app, main; main();"
        "print(sorted({'numpy', 'numba', 'pydantic', 'mujoco', 'rich'} & set(sys.modules)))"
    )
    line = "torquebench run config.yaml --set controllers.b"
    asked = {"_TORQUEBENCH_COMPLETE": "bash_complete", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_install(folder, monkeypatch, capsys, shell):
    """The script is written where the shell looks for it, and nothing else is."""
    monkeypatch.setenv("HOME", str(folder / "home"))
    assert main(["completion", shell, "--install", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    (file,) = (path for path in Path(folder, "home").rglob("*") if path.is_file())
    assert data["installed"] == str(file)
    assert file.read_text() == data["script"] + "\n"


def test_every_option_is_offered(folder):
    """Nothing of any command is forgotten."""
    for name in COMMANDS:
        shell = FishComplete(app, {}, "torquebench", "_TORQUEBENCH_COMPLETE")
        offered = {item.value for item in shell.get_completions([name], "--")}
        assert offered >= {flag for flag in flags(name) if flag.startswith("--")}


def test_the_words_are_those_that_are_accepted():
    """Names that are known without the registries, whose import would take a second, are the registries' own."""
    assert set(SYSTEMS) == set(BUILTIN)
    for engine in ("mujoco:", "analytic:"):
        for item in SideName(".xml").shell_complete(None, None, engine):
            parse_side(item.value, "A")
    names = {item.value for item in Shown().shell_complete(None, None, "")}
    assert names == {*law_names(), *CHAINS, *model_names(), *configs()}
    assert {"run.duration", "plant.payload", "chain.measurement_delay", "sweep.draws"} <= set(config_keys())
