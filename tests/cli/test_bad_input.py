"""Bad configs, given to the command: status 2, lines instead of a traceback, nothing written.

`tests/experiment/test_bad_configs.py` has every one; what the command makes of mistakes shows in each seventh.
"""

import pytest

from tests.experiment.bad_configs import BAD
from tests.experiment.examples import GOOD
from torquebench.errors import UNCHECKED

BOMB = "a: &a [1, 1]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]\n"
FILES = {
    "alias bomb": (BOMB.encode(), "anchor"),
    "2 MiB": (b"name: x\n" + b"#" * (2 * 2**20), "at most 1048576"),
    "binary": (bytes(range(256)), "byte"),
    "empty": (b"", "empty"),
    "not a mapping": (b"- 1\n- 2\n", "mapping"),
    "two documents": (GOOD.encode() + b"---\n" + GOOD.encode(), "document"),
    "python tag": (b"name: !!python/object/apply:os.system ['touch hacked']\n", "tag"),
    "deep nesting": (b"name: " + b"[" * 5000 + b"]" * 5000 + b"\n", "deep"),
    "unfinished": (b"name: [1, 2\n", "config.yaml:"),
}


def everything_below(folder):
    """Every path below a folder."""
    return sorted(folder.rglob("*"))


@pytest.mark.parametrize("bad", BAD[::7], ids=lambda bad: f"{bad.key}<-{bad.new[:24]!r}"[:60])
def test_bad_config(bad, tmp_path, monkeypatch, command):
    """One mistake: one line with file:line:col and the key, what went unchecked, and not a file more than before."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "config.yaml"
    path.write_text(bad.config)
    before = everything_below(tmp_path)
    status, out, err = command("run", "config.yaml")
    assert (status, out) == (2, "")
    told, *rest = err.splitlines()
    assert rest in ([], [UNCHECKED])
    assert told.startswith(f"config.yaml:{bad.line}:")
    assert bad.key in told
    assert everything_below(tmp_path) == before


@pytest.mark.parametrize("name", FILES)
def test_bad_file(name, tmp_path, monkeypatch, command):
    """Files that are no experiment at all: the same."""
    content, word = FILES[name]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "config.yaml").write_bytes(content)
    before = everything_below(tmp_path)
    status, out, err = command("run", "config.yaml")
    assert (status, out) == (2, "")
    assert err.startswith("config.yaml:")
    assert word in err
    assert "Traceback" not in err
    assert everything_below(tmp_path) == before


@pytest.mark.parametrize("name", ["missing.yaml", ".", "", "\0", "missing/deep.yaml"])
def test_no_file(name, tmp_path, monkeypatch, command):
    """A file that is not there, a folder, names no file can have: the same."""
    monkeypatch.chdir(tmp_path)
    status, out, err = command("run", name)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert "Traceback" not in err
    assert everything_below(tmp_path) == []
