"""What attacks share: a folder, random numbers, one stored run and sweep, and the command line in quick processes."""

from __future__ import annotations

import functools
import hashlib
import multiprocessing
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from typing import IO

EXPERIMENT = """\
name: short
plant: {engine: mujoco, model: two-link}
controllers:
  - {name: pd, law: pd-gravity, gains: {lam: 10, kv: 20}}
  - {name: band, law: linear-band-smc, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
reference: {kind: sine, amplitude: [0.5, -0.4], frequency_hz: [1.0, 1.4]}
run: {duration: 1.2, metrics_from: 0.2, seed: 3}
"""
SWEEP = """\
sweep:
  draws: 6
  grid: {plant.payload.mass: [0, 0.2, 0.4]}
  random: {'controllers.*.gains.lam': {uniform: [9, 11]}}
"""
PRELOADED = ["numpy", "mujoco", "torquebench.cli.app", "torquebench.cli.run", "torquebench.cli.sweep"]
PRELOADED += ["torquebench.cli.report", "torquebench.sim.simulate", "torquebench.experiment.store"]
MEMORY = 8 << 30
"""Address space of a process [bytes]."""
STARTED = "\n"
"""What a process writes before the line is run."""
POLL = 0.01
"""Time between two looks at a process [s]."""
PATIENCE = 300.0
"""Longest that making what a row attacks may take [s]."""


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    status: int
    """Exit status; minus the signal that ended it."""
    text: str
    """Both streams."""
    seconds: float
    hung: bool = False
    """Whether it had to be killed."""

    def fault(self, *statuses: int) -> str:
        """Return what is wrong with an end whatever the input was, or an empty text.

        Args:
            *statuses: Those that are right.
        """
        for sign in ("Traceback", "internal error"):
            if sign in self.text:
                return f"{sign}: {self.text.strip()[-200:]}"
        if self.hung:
            return f"no end within {self.seconds:.0f} s"
        return "" if self.status in statuses else f"exit status {self.status}: {self.text.strip()[-200:]}"


class Workshop:
    """The shared part of all attacks.

    Args:
        folder: Empty; everything is written below it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.random = random.Random(0)
        self.config = folder / "short.yaml"
        self.config.write_text(EXPERIMENT, encoding="utf-8")
        self.sweep_config = folder / "short-sweep.yaml"
        self.sweep_config.write_text(EXPERIMENT + SWEEP, encoding="utf-8")
        sys.warnoptions.append("ignore:resource_tracker")  # killed sweeps leave semaphores, which it tells at the end
        resource_tracker.ensure_running()
        sys.warnoptions.pop()
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(PRELOADED)

    def command(
        self,
        *words: str | Path,
        limit: float = 60.0,
        after: float | None = None,
        with_signal: int = signal.SIGINT,
        environment: Mapping[str, str] | None = None,
    ) -> Done:
        """Run a line of the command line in a process forked from one that has the packages loaded.

        Args:
            *words: The line, without ``torquebench``.
            limit: Seconds after which the process is killed.
            after: When to send a signal, from the instant at which the line begins to run [s]; None for never.
            with_signal: That signal.
            environment: Variables on top of this process's.
        """
        with tempfile.TemporaryFile(dir=self.folder) as output:
            line, begin = [str(word) for word in words], time.monotonic()
            process = self.context.Process(target=_run, args=(line, _Handle(output), dict(environment or {})))
            process.start()
            sent = hung = started = False
            while process.is_alive():
                process.join(POLL)
                if not started and os.fstat(output.fileno()).st_size:
                    started, begin = True, time.monotonic()
                passed = time.monotonic() - begin if started else 0.0
                if after is not None and passed > after and not sent and process.pid is not None:
                    os.kill(process.pid, with_signal)
                    sent = True
                if passed > limit + (after or 0.0) and not hung:
                    process.kill()
                    hung = True
            output.seek(0)
            text = output.read().decode("utf-8", "replace").removeprefix(STARTED)
            status = process.exitcode if process.exitcode is not None else -1
            return Done(status, text, time.monotonic() - begin, hung)

    def _prepare(self, *words: str | Path) -> Done:
        """Run a line that makes what a row attacks, which must succeed."""
        done = self.command(*words, limit=PATIENCE)
        if done.status:
            ended = f"was killed after {PATIENCE:.0f} s" if done.hung else f"ended with status {done.status}"
            raise RuntimeError(f"'{words[0]}', which makes what is attacked, {ended}: {done.text[-500:]}")
        return done

    @functools.cached_property
    def run(self) -> Path:
        """Folder of one stored run."""
        self._prepare("run", self.config, "--out", self.folder / "run")
        return self.folder / "run"

    @functools.cached_property
    def sweep(self) -> tuple[Path, float]:
        """Folder of one stored sweep, and how long a warm one takes [s]."""
        for name in ("sweep-cold", "sweep"):
            done = self._prepare(*sweep_words(self.sweep_config, self.folder / name))
        return self.folder / "sweep", done.seconds

    def copy(self, source: Path) -> Path:
        """Return a fresh copy of a folder."""
        shutil.rmtree(self.folder / "copy", ignore_errors=True)
        return Path(shutil.copytree(source, self.folder / "copy"))

    def absent(self, name: str) -> Path:
        """Return a path at which nothing is."""
        path = self.folder / name
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
        return path


def sweep_words(config: Path, out: Path, executor: str = "threads") -> Sequence[str]:
    """Return the line that runs a sweep with two workers."""
    return ["sweep", str(config), "--out", str(out), "--quiet", "--executor", executor, "--workers", "2"]


def tree(folder: Path) -> dict[str, str]:
    """Return the digest of every file below a folder but its manifest, which has times and versions."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "manifest.json"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def differing(a: Mapping[str, str], b: Mapping[str, str]) -> list[str]:
    """Return the names at which two `tree`s differ."""
    return sorted(name for name in a.keys() | b.keys() if a.get(name) != b.get(name))


class _Handle:
    """A file that another process writes to."""

    def __init__(self, file: IO[bytes]) -> None:
        self.number = file.fileno()

    def __getstate__(self) -> object:
        from multiprocessing.reduction import DupFd

        return DupFd(self.number)

    def __setstate__(self, state: object) -> None:
        self.number = state.detach()  # type: ignore[attr-defined]


def _run(line: list[str], output: _Handle, environment: Mapping[str, str]) -> None:
    """Run a line as a program of its own would; in the forked process."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for stream in (1, 2):
        os.dup2(output.number, stream)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
    os.environ.update(environment)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.modules["__main__"].__dict__.pop("__file__", None)  # workers must not run this program's script again
    sys.argv = ["torquebench", *line]
    from torquebench.cli.app import main

    os.write(1, STARTED.encode())
    signal.signal(signal.SIGINT, signal.default_int_handler)  # until here it was ignored
    try:
        status = main(line)
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join()
    os._exit(status)
