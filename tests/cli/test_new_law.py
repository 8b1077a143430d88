"""``torquebench new-law``: files that hold as they are, and nothing written where something is wrong."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from torquebench import check
from torquebench.dialect import read_file
from torquebench.laws.law import LAWS


def test_the_file_passes_the_check_as_it_is(tmp_path, command, monkeypatch, registries):
    """`check` and `run` take it as is offered, the whole file only declares, and every gain has a box for tuning."""
    monkeypatch.setattr(check, "SCALES", (1.0,))
    monkeypatch.setattr(check, "DURATION", 0.02)
    status, told, _ = command("new-law", "my-2nd-law", "--out", tmp_path)
    assert status == 0
    assert sorted(x.name for x in tmp_path.iterdir()) == ["my_2nd_law.py", "test_my_2nd_law.py"]
    status, out, _ = command("check", tmp_path / "my_2nd_law.py")
    assert status == 0
    assert out.strip().endswith("the contract holds, on both paths")
    status, config, _ = command(*shlex.split(told.splitlines()[-1])[1:], "--show-config")
    assert (status, config.count("law: smc"), config.count("law: my-2nd-law")) == (0, 1, 1)
    assert all(gain.search for gain in LAWS["my-2nd-law"].gains.values())
    assert read_file((tmp_path / "my_2nd_law.py").read_text()) == []


def test_the_test_passes_as_it_is(tmp_path, command):
    """The test beside it runs with pytest, from any folder."""
    assert command("new-law", "fresh", "--out", tmp_path)[0] == 0
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "sine", "test_fresh.py"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("name", "said"), [("My Law", "lower-case"), ("smc", "ships with the package"), ("../evil", "lower-case")]
)
def test_a_name_that_is_none_or_taken_is_refused(name, said, tmp_path, command, monkeypatch):
    """Exit 2, the reason, and no file."""
    monkeypatch.chdir(tmp_path)
    status, _, err = command("new-law", name)
    assert status == 2
    assert said in err
    assert list(tmp_path.iterdir()) == []
    assert not Path("../evil.py").exists()


def test_a_file_that_exists_is_left_alone(tmp_path, command):
    """Also when only the test is there, neither is written."""
    (tmp_path / "test_mine.py").write_text("kept")
    status, _, err = command("new-law", "mine", "--out", tmp_path)
    assert status == 2
    assert f"test_mine.py exists, wanted a name of which no file is in {tmp_path}, or another folder" in err
    assert [x.name for x in tmp_path.iterdir()] == ["test_mine.py"]
    assert (tmp_path / "test_mine.py").read_text() == "kept"
