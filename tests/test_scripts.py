"""The scripts that set up a clone: what they say, what they show when something fails, and that they do it once."""

import hashlib
import os
import pty
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from torquebench import shipped
from torquebench.shipped import data_root, how_to_install

UV = """\
#!/bin/sh
case "$1" in
venv) mkdir -p "$PWD/clone/.venv/bin"; printf '#!/bin/sh\\necho "ran $*"\\n' >"$PWD/clone/.venv/bin/python"
      chmod +x "$PWD/clone/.venv/bin/python" ;;
pip) echo "noise of $*"
      [ -z "$BROKEN" ] || { echo "no route to index" >&2; exit 1; } ;;
esac
"""
"""An installer that makes a .venv whose Python repeats its arguments; with BROKEN set nothing can be installed."""


@pytest.fixture
def clone(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run `scripts/torquebench` of a clone that has only scripts and lock, with `UV` for uv."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "uv").write_text(UV)
    (tmp_path / "bin" / "uv").chmod(0o755)
    shutil.copytree(data_root() / "scripts", tmp_path / "clone" / "scripts", ignore=shutil.ignore_patterns("web"))
    for name in ("pyproject.toml", "requirements.lock"):
        shutil.copy(data_root() / name, tmp_path / "clone")

    def run(*words: str, **settings: str) -> subprocess.CompletedProcess[str]:
        environment = {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", **settings}
        program = [str(tmp_path / "clone" / "scripts" / "torquebench"), *words]
        return subprocess.run(program, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    return run


def test_a_clone_is_set_up_once_in_four_lines(clone: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    """Each step is a line with what it takes and took; the installer's own lines are not shown; then all is silent."""
    first, second = clone("laws"), clone("laws")
    assert (first.returncode, first.stdout.splitlines()[-1]) == (0, "ran -m torquebench laws")
    lines = first.stderr.splitlines()
    assert len(lines) == 4
    assert "noise" not in first.stderr
    for line, step in zip(lines[1:3], ("1/2 packages (about 230 MB", "2/2 torquebench itself"), strict=True):
        assert line.startswith(step)
        assert line.endswith(" s")
    assert "scripts/torquebench" in lines[3]
    assert (second.returncode, second.stdout, second.stderr) == (0, "ran -m torquebench laws\n", "")


def test_what_fails_is_shown_whole_and_tried_again(
    clone: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """Exit 3 with all that the installer printed and where to read on; the next try goes on."""
    failed = clone("laws", BROKEN="yes")
    assert (failed.returncode, failed.stdout) == (3, "")
    for words in ("noise of pip install", "no route to index", "docs/installing.md", "goes on from here"):
        assert words in failed.stderr
    assert (tmp_path / "clone" / ".venv").is_dir()
    assert clone("laws").stdout == "ran -m torquebench laws\n"


def functions(
    command: str, root: Path, error: int = subprocess.PIPE, **settings: str
) -> subprocess.CompletedProcess[str]:
    """Run a command of sh that uses the functions of `environment.sh`, without setting anything up."""
    (root / "scripts").mkdir(parents=True, exist_ok=True)
    text = (data_root() / "scripts" / "environment.sh").read_text().partition("\nmade=\n")[0].replace("$0", "$PROGRAM")
    settings = {"PATH": os.environ["PATH"], "PROGRAM": str(root / "scripts" / "extras"), **settings}
    program = ["sh", "-c", f"{text}\n{command}"]
    return subprocess.run(program, env=settings, stdout=subprocess.PIPE, stderr=error, text=True, check=False)


def test_an_active_environment_is_not_asked_for_pip(tmp_path: Path) -> None:
    """The interpreter that installs is the one that ./.venv was made from, whether ./.venv is activated or not."""
    venv.create(tmp_path / ".venv", symlinks=True)
    inside = tmp_path / ".venv" / "bin"
    active = functions("find_python", tmp_path, PATH=f"{inside}:{os.environ['PATH']}")
    assert active.returncode == 0
    named = functions("find_python", tmp_path, PYTHON=str(inside / "python3"))
    for found in (active, named):
        base = Path(found.stdout.strip())
        assert base.is_file()
        assert tmp_path not in base.parents
    elsewhere = functions("find_python", tmp_path / "other", PYTHON=str(inside / "python3"))
    assert Path(elsewhere.stdout.strip()).parent == inside


def test_what_could_not_be_installed_says_what_to_do(
    clone: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """`scripts/extras` too ends with what to try, after all that the installer printed."""
    clone("laws")
    (tmp_path / "clone" / ".venv" / "bin" / "python").write_text("#!/bin/sh\necho tune\n")
    path = f"{tmp_path / 'bin'}:{os.environ['PATH']}"
    failed = subprocess.run(
        [str(tmp_path / "clone" / "scripts" / "extras"), "tune"],
        cwd=tmp_path,
        env={"PATH": path, "BROKEN": "yes"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert failed.returncode == 3
    for words in ("no route to index", "apt-get install python3-pip", "goes on from here"):
        assert words in failed.stderr


def test_a_step_on_a_terminal_counts_its_seconds(tmp_path: Path) -> None:
    """A step of minutes is never silent where somebody looks, and what ticks ends with it."""
    reader, writer = pty.openpty()
    assert functions("step packages sleep 1.5", tmp_path, writer).returncode == 0
    os.close(writer)
    shown = os.read(reader, 4096).decode()
    os.close(reader)
    assert re.search(r"packages \.\.\. \r(packages \.\.\. [12] s \r)+packages \.\.\. done in [12] s", shown)


def test_the_command_that_installs_an_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The checkout's script where its .venv runs torquebench, else pip."""
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "extras").touch()
    monkeypatch.setattr(shipped, "_own_data", lambda: tmp_path)
    assert how_to_install("tune") == "pip install 'torquebench[tune]'"
    monkeypatch.setattr(sys, "prefix", str(tmp_path / ".venv"))
    assert how_to_install("tune") == "scripts/extras tune"


def test_pip_without_a_network_gets_what_its_cache_has(tmp_path: Path) -> None:
    """A wheel that the lock names by its sha256 is found, whole, under the name that pip reads; others are not."""
    cache, lock, made = tmp_path / "cache" / "http-v2" / "a", tmp_path / "lock", tmp_path / "wheels"
    cache.mkdir(parents=True)
    for body in ("wanted", "other"):
        with zipfile.ZipFile(cache / f"{body}.body", "w") as wheel:
            wheel.writestr(
                f"{body}-1.0.dist-info/WHEEL", "Tag: cp311-cp311-manylinux_2_17_x86_64\nTag: cp311-cp311-linux\n"
            )
    (cache / "page.body").write_text("<html>")
    digest = hashlib.sha256((cache / "wanted.body").read_bytes()).hexdigest()
    lock.write_text(f"wanted==1.0 \\\n    --hash=sha256:{digest}\n")
    program = [sys.executable, str(data_root() / "scripts" / "cached_wheels.py"), str(tmp_path / "cache"), str(lock)]
    for _ in range(2):
        assert subprocess.run([*program, str(made)], check=False).returncode == 0
    (link,) = made.iterdir()
    assert link.name == "wanted-1.0-cp311-cp311-manylinux_2_17_x86_64.linux.whl"
    assert link.read_bytes() == (cache / "wanted.body").read_bytes()
    lock.write_text("")
    assert subprocess.run([*program, str(made)], check=False).returncode == 1
