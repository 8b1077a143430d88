"""Runs shards in threads of this process, or in processes of their own."""

from __future__ import annotations

import contextlib
import functools
import itertools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection
from typing import Any, Protocol, TypeVar

from torquebench.errors import ResultError, TorquebenchError
from torquebench.laws.plugin import load_plugin
from torquebench.sweep.plan import Source
from torquebench.sweep.repeats import Known
from torquebench.sweep.table import Table
from torquebench.sweep.worker import Task, run_shard

T = TypeVar("T")

AHEAD = 2
"""Shards in hand for each that is run: the next one is there already, and memory stays flat."""


class Executor(Protocol):
    """Runs shards. Results do not depend on the executor; `str()` describes it."""

    @property
    def count(self) -> int:
        """Number of shards that run at once."""
        ...

    @property
    def processes(self) -> int:
        """Number of worker processes on this machine."""
        ...

    @property
    def here(self) -> int:
        """Number of shards that run at once on this machine."""
        ...

    def prepare(self, source: Source) -> None:
        """Make sure that every worker would compute the same bytes as this process.

        Raises:
            ConfigError: one would not.
        """
        ...

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards and yield the number and rows of each as soon as it is done, in any order.

        Closing the iterator, or an exception in it, stops what is still running.
        """
        ...


class Threads:
    """Threads of this process; compiled loops release the interpreter's lock, everything else holds it.

    Args:
        count: Number of threads.
        known: Loops that need not be run again; for sweeps that repeat each other's. None to run all.
    """

    processes = 0

    def __init__(self, count: int, known: Known | None = None) -> None:
        self.count = self.here = count
        self._known = known

    def __str__(self) -> str:
        return f"{self.count} thread{'s' * (self.count != 1)}"

    def prepare(self, source: Source) -> None:
        """Do nothing: this is the process that workers are compared with; see `Executor`."""

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`."""
        stop = threading.Event()
        with ThreadPoolExecutor(self.count) as pool:
            try:
                run = functools.partial(run_shard, task, stop=stop.is_set, known=self._known)
                yield from as_done(self, lambda shard: pool.submit(run, shard), shards)
            finally:
                stop.set()
                pool.shutdown(cancel_futures=True)


class Processes:
    """Worker processes, which end when this process does, however it ends.

    Args:
        count: Number of processes.
    """

    def __init__(self, count: int) -> None:
        self.count = self.here = self.processes = count

    def __str__(self) -> str:
        return f"{self.count} process{'es' * (self.count != 1)}"

    def prepare(self, source: Source) -> None:
        """Do nothing: processes of one machine compute the same bytes; see `Executor`."""

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`.

        Raises:
            ResultError: a process died, or could not do its work.
        """
        context = multiprocessing.get_context("spawn")
        watched, held = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(self.count, context, _start, (watched,))
        try:
            yield from as_done(self, lambda shard: pool.submit(_run, task, shard), shards)
            pool.shutdown()
        except BrokenProcessPool as error:
            why = "it was killed, the machine ran out of memory, or a script starts processes when it is imported"
            raise ResultError(f"a worker process died: {why}") from error
        finally:
            held.close()
            pool.shutdown(cancel_futures=True)
            watched.close()


def as_done(executor: Executor, submit: Callable[[int], Future[T]], shards: Sequence[int]) -> Iterator[tuple[int, T]]:
    """Submit shards, a few ahead of those that run, and yield the number and result of each as soon as it is done.

    Args:
        executor: What runs them.
        submit: Gives it a shard.
        shards: Numbers of the shards.
    """
    waiting, pending = iter(shards), dict[Future[T], int]()
    while True:
        for shard in itertools.islice(waiting, max(0, AHEAD * max(1, executor.count) - len(pending))):
            pending[submit(shard)] = shard
        if not pending:
            return
        future = wait(pending, return_when=FIRST_COMPLETED).done.pop()
        yield pending.pop(future), future.result()


def _start(watched: Connection[Any, Any]) -> None:
    """Set up a worker process; it ends when its parent closes the other end of a pipe, or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends Ctrl-C to all; the parent decides
    threading.Thread(target=_end_with_parent, args=(watched,), daemon=True).start()


def _end_with_parent(watched: Connection[Any, Any]) -> None:
    with contextlib.suppress(EOFError, OSError):
        watched.recv()
    os._exit(0)


def _run(task: Task, shard: int) -> Table:
    """Run a shard in a worker process.

    Raises:
        ResultError: it cannot be run, and why.
    """
    try:
        _load_plugins(task.source)
        return run_shard(task, shard)
    except TorquebenchError as error:
        raise ResultError(str(error)) from error  # a message survives the way back to the parent, its data does not


@functools.cache
def _load_plugins(source: Source) -> None:
    for path in source.plugins:
        load_plugin(path)
