"""Sweeps killed at random instants, or stopped by a full disk, and continued; prints what came of each as JSON.

``python -m tests.sweep.killing FOLDER KILLS SEED EXECUTOR``. Everything is imported once: each sweep is a fork of this
process, which has no other thread.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.sweep.examples import SMALL
from torquebench.cli.app import main
from torquebench.sweep.folder import PLAN, open_sweep
from torquebench.sweep.run import state_of

DRAWS = ["--set", "sweep.draws=12"]
MOST_TRIES = 40
"""Kills that come too early or too late before one counts."""


def forked(work: Callable[[], int]) -> int:
    """Do some work in a fork of this process and return the fork's number."""
    child = os.fork()
    if child == 0:
        status = 70
        try:
            status = work()
        finally:
            os._exit(status)
    return child


def command(arguments: list[str], output: Path, most_bytes: int | None = None) -> Callable[[], int]:
    """Return a run of the command line whose output goes to a file; no file may be longer than `most_bytes`."""

    def work() -> int:
        if most_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, resource.RLIM_INFINITY))
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            status = main(arguments)
        if most_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        output.write_text(text.getvalue())
        return status

    return work


def ended(child: int) -> int:
    """Wait for a fork and return its exit status, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def tables(folder: Path) -> dict[str, str]:
    """Digests of the final tables."""
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in ("results.npz", "results.csv")}


def marks(folder: Path) -> dict[str, tuple[int, int]]:
    """What changes when a shard's file is written anew: its inode and time of change."""
    return {p.name: (p.stat().st_ino, p.stat().st_mtime_ns) for p in (folder / "shards").glob("*.shard")}


class Bench:
    """Runs a sweep again and again, in folders of their own.

    Args:
        folder: Where.
        how: Options of the command for all of them.
    """

    def __init__(self, folder: Path, how: list[str]) -> None:
        self.folder, self.how, self.count = folder, list(how), 0
        self.config = folder / "small.yaml"
        self.config.write_text(SMALL)
        # here, not in a fork, so that the forks have what is compiled and loaded
        arguments = ["sweep", str(self.config), "--out", str(folder / "whole"), *DRAWS, "--workers", "1"]
        status = command([*arguments, "--executor", "threads"], folder / "output.txt")()
        again, child = self.begin()
        self.first_shard(again, child)
        start = time.perf_counter()
        if status != 0 or ended(child) != 0:
            raise RuntimeError((folder / "output.txt").read_text())
        self.seconds = time.perf_counter() - start
        self.wanted = tables(folder / "whole")
        if tables(again) != self.wanted:
            raise RuntimeError("two undisturbed sweeps differ")

    def begin(self, most_bytes: int | None = None) -> tuple[Path, int]:
        """Start a sweep; return its folder and its fork's number."""
        self.count += 1
        out = self.folder / f"run{self.count}"
        arguments = ["sweep", str(self.config), "--out", str(out), *DRAWS, *self.how]
        return out, forked(command(arguments, self.folder / "output.txt", most_bytes))

    def first_shard(self, out: Path, child: int) -> None:
        """Wait until a shard is there, or the sweep has ended."""
        while not list((out / "shards").glob("*.shard")) and Path(f"/proc/{child}/exe").exists():
            time.sleep(0.001)

    def resumed(self, out: Path) -> dict[str, Any]:
        """Continue a sweep that was stopped; return what was there, what was run, and whether the tables are right."""
        state, before = state_of(open_sweep(out, (), "")), marks(out)
        status = ended(forked(command(["sweep", "--resume", str(out), *self.how], self.folder / "output.txt")))
        after = marks(out)
        said = next((x for x in (self.folder / "output.txt").read_text().splitlines() if "shards run" in x), "")
        return {
            "complete": len(state.complete),
            "missing": len(state.missing),
            "damaged": len(state.damaged),
            "status": status,
            "said": said,
            "equal": tables(out) == self.wanted,
            "kept": sum(after[name] == mark for name, mark in before.items()),
            "files": len(after),
            "left": sorted(p.name for p in out.rglob("*") if p.name.startswith(".")),
        }

    def killed(self, rng: np.random.Generator) -> dict[str, Any]:
        """Kill a sweep at a random instant between its first shard and its last, and continue it."""
        for tries in range(1, MOST_TRIES + 1):
            out, child = self.begin()
            self.first_shard(out, child)
            time.sleep(float(rng.uniform(0.0, self.seconds)))
            os.kill(child, signal.SIGKILL)
            if ended(child) != -signal.SIGKILL or not (out / PLAN).is_file():
                continue
            state = state_of(open_sweep(out, (), ""))
            if state.complete and state.missing:
                return self.resumed(out) | {"tries": tries}
        raise RuntimeError("no kill came while shards were being run")

    def filled(self, most_bytes: int) -> dict[str, Any]:
        """Run a sweep on a disk on which no file gets longer than some bytes, and continue it with more space."""
        out, child = self.begin(most_bytes)
        status = ended(child)
        return self.resumed(out) | {"full": status, "text": (self.folder / "output.txt").read_text()}


if __name__ == "__main__":
    where, kills, seed, executor = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
    bench = Bench(where, ["--workers", "2", "--executor", executor])
    randomness = np.random.default_rng(seed)
    found = {
        "seconds": bench.seconds,
        "killed": [bench.killed(randomness) for _ in range(kills)],
        "filled": [bench.filled(most) for most in (3000, 20_000)],
    }
    sys.stdout.write(json.dumps(found))
