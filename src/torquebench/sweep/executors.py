"""Where shards are run: on threads of this process, or in processes of their own."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from torquebench.errors import ResultError, TorquebenchError
from torquebench.sweep.columns import Table
from torquebench.sweep.plan import Source
from torquebench.sweep.work import Task, load_plugins, run_shard

PATIENCE = 10.0
"""Time that processes get to end by themselves [s]."""


class Executor(Protocol):
    """Runs shards; the same bytes come back whatever it is. Its text says what it is."""

    @property
    def count(self) -> int:
        """How many shards it runs at once."""
        ...

    @property
    def processes(self) -> int:
        """How many processes of their own it has on this machine."""
        ...

    @property
    def here(self) -> int:
        """How many of the shards that it runs at once are run on this machine."""
        ...

    def prepare(self, source: Source) -> None:
        """Make sure that whoever runs the shards of a sweep would get the same bytes as this process.

        Raises:
            ConfigError: one would not.
        """
        ...

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards and yield the number and table of each as soon as it is done, in any order.

        Closing the iterator, or an exception in it, stops what is still running.
        """
        ...


class Threads:
    """Threads of this process; compiled loops do not hold the interpreter's lock, the rest does.

    Args:
        count: Number of threads.
    """

    def __init__(self, count: int) -> None:
        self.count = self.here = count
        self.processes = 0

    def __str__(self) -> str:
        return f"{self.count} thread{'s' * (self.count != 1)}"

    def prepare(self, source: Source) -> None:
        """Do nothing: it is the same machine; see `Executor`."""

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`."""
        if self.count == 1:
            for shard in shards:
                yield shard, run_shard(task, shard)
            return
        stop, waiting = threading.Event(), iter(shards)
        pending: dict[Future[Table], int] = {}
        with ThreadPoolExecutor(self.count) as pool:
            try:
                while True:
                    # one more than there are threads, so that none waits for this one
                    for shard in itertools.islice(waiting, self.count + 1 - len(pending)):
                        pending[pool.submit(run_shard, task, shard, stop.is_set)] = shard
                    if not pending:
                        return
                    for future in wait(pending, return_when=FIRST_COMPLETED).done:
                        yield pending.pop(future), future.result()
            finally:
                stop.set()
                pool.shutdown(cancel_futures=True)


class Processes:
    """Processes of their own, started anew, which end when this process does, however it ends.

    Args:
        count: Number of processes.
    """

    def __init__(self, count: int) -> None:
        self.count = self.here = self.processes = count

    def __str__(self) -> str:
        return f"{self.count} process{'es' * (self.count != 1)}"

    def prepare(self, source: Source) -> None:
        """Do nothing: it is the same machine; see `Executor`."""

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`.

        Raises:
            ResultError: a process died, or could not do its work.
        """
        waiting, context = iter(shards), multiprocessing.get_context("spawn")
        workers: dict[Connection[Any, Any], BaseProcess] = {}
        owed: dict[Connection[Any, Any], int] = {}
        try:
            for first in itertools.islice(waiting, self.count):
                own, theirs = context.Pipe()
                process: BaseProcess = context.Process(target=_serve, args=(theirs, task), daemon=True)
                process.start()
                theirs.close()
                workers[own], owed[own] = process, 1
                own.send(first)
            for own, shard in zip(workers, waiting, strict=False):
                own.send(shard)  # one more than it is at, so that it need not wait for this process
                owed[own] += 1
            while workers:
                ready = wait_for(list(workers))
                for connection in [known for known in workers if known in ready]:
                    done, table = _received(connection, workers[connection])
                    owed[connection] -= 1
                    for shard in itertools.islice(waiting, 1):
                        connection.send(shard)
                        owed[connection] += 1
                    if owed[connection] == 0:
                        connection.send(None)
                        workers.pop(connection).join(PATIENCE)
                    yield done, table
        finally:
            for connection, process in workers.items():
                connection.close()
                process.terminate()
            for process in workers.values():
                process.join(PATIENCE)


def _received(connection: Connection[Any, Any], process: BaseProcess) -> tuple[int, Table]:
    """Return the next shard of a process.

    Raises:
        ResultError: it died, or says why it cannot go on.
    """
    try:
        done, table, reason = connection.recv()
    except (EOFError, ConnectionError) as error:
        process.join(PATIENCE)
        raise ResultError(f"a worker process died (exit status {process.exitcode})") from error
    if reason:
        raise ResultError(reason)
    return done, table


def _serve(connection: Connection[Any, Any], task: Task) -> None:
    """Run the shards that come through a connection until None comes, or nobody is left at its other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to all; the first process decides
    with contextlib.suppress(EOFError, ConnectionError):
        try:
            load_plugins(task.source)
            while (shard := connection.recv()) is not None:
                connection.send((shard, run_shard(task, shard), ""))
        except TorquebenchError as error:
            connection.send((0, {}, str(error)))
