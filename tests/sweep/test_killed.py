"""A sweep killed, or out of disk, and continued: nothing torn is accepted, nothing done is done again."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]


def harness(folder: Path, kills: int, seed: int, executor: str) -> dict[str, Any]:
    """Run `tests.sweep.killing` and return what it found."""
    command = [sys.executable, "-m", "tests.sweep.killing", str(folder), str(kills), str(seed), executor]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def check_resumed(outcome: dict[str, Any]) -> None:
    """The final tables are those of an undisturbed sweep, made by exactly the shards that were missing."""
    assert (outcome["status"], outcome["equal"]) == (0, True), outcome
    run, there = map(int, re.findall(r"\d+", outcome["said"]))
    assert (run, there) == (outcome["missing"], outcome["complete"])
    assert (outcome["kept"], outcome["files"]) == (there, there + run)
    assert outcome["damaged"] == 0  # an atomic write leaves nothing half done under a shard's name
    assert outcome["left"] == []


def check(found: dict[str, Any], kills: int) -> None:
    """Every kill came between the first shard and the last; both full disks were noticed."""
    assert len(found["killed"]) == kills
    for outcome in found["killed"]:
        assert outcome["complete"] >= 1
        assert outcome["missing"] >= 1
        check_resumed(outcome)
    small, large = found["filled"]
    for outcome in (small, large):
        assert outcome["full"] == 3
        check_resumed(outcome)
    assert small["complete"] == 0  # no shard had space
    assert large["missing"] == 0  # the shards had, the final table had not


@pytest.mark.slow
def test_killed_and_full_sweeps_end_in_the_same_bytes(tmp_path: Path) -> None:
    """Two kills -9 at random instants; files that may not grow beyond a part of a shard, or of the final table."""
    check(harness(tmp_path, 2, 0, "threads"), 2)


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_two_hundred_kills_end_in_the_same_bytes(
    tmp_path: Path, executor: str, figure: Callable[[str, float, str], None]
) -> None:
    """The same for 200 kills with threads, and 200 with processes, which must end with the one that was killed."""
    found = harness(tmp_path, 200, 1, executor)
    check(found, 200)
    figure(f"kills of {executor} after which the tables were equal in every byte", len(found["killed"]), "200")
