"""A change in any kernel's source reaches every kernel that calls it, cached or not."""

import os
import shutil
import subprocess
import sys

import pytest

from torquebench.robot.library import data_root

GRAVITY = "import torquebench; print(torquebench.Puma560('corrected').gravity([0, 0.5, 0.5, 0, 0, 0])[2])"


@pytest.fixture
def copy(tmp_path):
    """A copy of the package's source, and a way to run code on it; returns printed text."""
    source = tmp_path / "src"
    shutil.copytree(data_root() / "src", source, ignore=shutil.ignore_patterns("__pycache__"))

    def run(code, **environment):
        known = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        known |= {"PYTHONPATH": str(source), "TORQUEBENCH_DATA": str(data_root()), **environment}
        done = subprocess.run([sys.executable, "-c", code], env=known, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    return source / "torquebench", run


def test_an_edited_callee_is_not_hidden_by_the_cache(copy):
    """G3 changes sign with its formula, although only a file that the cached caller imports was edited."""
    package, run = copy
    before = float(run(GRAVITY))
    assert float(run(GRAVITY)) == before
    element = package / "robot" / "puma560" / "gravity.py"
    text = element.read_text()
    after = "\n\n\n@kernel(inline=True)\ndef gravity5"
    edited = text.replace("    return k[G2] * t.s23 + k[G4]", "    return -k[G2] * t.s23 - k[G4]").replace(
        "t.c23 + k[G5] * t.s23" + after, "t.c23 - k[G5] * t.s23" + after
    )
    assert edited != text
    element.write_text(edited)
    assert float(run(GRAVITY)) == pytest.approx(-before, rel=1e-12)
    assert len(list((package / "__pycache__").glob("kernels-*"))) == 1  # the stale one is gone


def test_the_cache_is_used_and_can_be_moved(copy, tmp_path):
    """Compiled kernels land in NUMBA_CACHE_DIR when it is set; a second process adds none."""
    _, run = copy
    folder = tmp_path / "cache"
    run(GRAVITY, NUMBA_CACHE_DIR=str(folder))
    first = sorted(str(p) for p in folder.rglob("*.nbc"))
    run(GRAVITY, NUMBA_CACHE_DIR=str(folder))
    assert first
    assert sorted(str(p) for p in folder.rglob("*.nbc")) == first
