"""Shards on a Dask cluster: one whose scheduler is running, or one of processes on this machine."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import itertools
import logging
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.store import atomic_write
from torquebench.sweep import remote
from torquebench.sweep.columns import Table
from torquebench.sweep.plan import Source
from torquebench.sweep.remote import Needs, Rows
from torquebench.sweep.work import Task

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT = 10.0
"""Time that a scheduler gets to answer [s]."""
FIRST = 30.0
"""Time that its first worker gets to join [s]."""
LOOK = 5.0
"""Time between looks whether a worker that is waited for is still there [s]."""
AHEAD = 2
"""Shards asked for in advance for each thread: enough to keep it busy, few enough to keep memory flat."""
DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""What a local worker does first: Ctrl-C comes from the terminal to all processes, and this one decides."""
WORKER_SIDE = "torquebench.sweep.cluster"
"""What every worker must be able to import."""
LOCAL = re.compile(r"local(?::(\d{1,4}))?")
REMOTE = re.compile(r"(tcp|tls)://[^\s/]+:\d+")


@contextlib.contextmanager
def opened(address: str) -> Iterator[Cluster]:
    """Connect to a cluster, or make one; closed at the end.

    Args:
        address: ``tcp://HOST:PORT`` or ``tls://HOST:PORT`` of a scheduler, ``local`` or ``local:N`` for N processes on
            this machine (default: one per core), which listen on the loopback interface only.

    Raises:
        ConfigError: Dask is missing, the address is none, no scheduler answers, or it has no worker.
    """
    local, there = LOCAL.fullmatch(address), REMOTE.fullmatch(address)
    if not there and (not local or local[1] == "0"):
        _refuse(f"got {address!r}, wanted tcp://HOST:PORT, tls://HOST:PORT, local or local:N")
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ConfigError(
            [Problem("--cluster", "", f"needs Dask ({error}): wanted pip install 'torquebench[cluster]'")]
        ) from error
    with contextlib.ExitStack() as stack:
        if local:
            count = int(local[1] or os.cpu_count() or 1)
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=count,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=None,
                    scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # any port: the default one may be taken
                    memory_limit=None,
                    preload=DEAF,
                    silence_logs=logging.CRITICAL,
                )
            )
            yield Cluster(stack.enter_context(Client(cluster)), address, count)
            return
        try:
            client = stack.enter_context(Client(address, timeout=CONNECT))
        except (OSError, TypeError, ValueError, RuntimeError) as error:  # TypeError: no certificates for tls://
            raise ConfigError(
                [Problem("--cluster", "", f"no connection to a scheduler at {address} within {CONNECT:g} s ({error})")]
            ) from error
        try:
            client.wait_for_workers(1, timeout=FIRST)
        except TimeoutError:
            _refuse(f"the scheduler at {address} has no worker after {FIRST:g} s: start some with `dask worker`")
        yield Cluster(client, address, 0)


class Cluster:
    """Workers of a Dask cluster, however many they are at the moment; see `opened`.

    Args:
        client: The connection to the scheduler.
        address: What the cluster is called.
        processes: How many processes it has on this machine.
    """

    def __init__(self, client: Client, address: str, processes: int) -> None:
        self._client, self._address, self.processes = client, address, processes
        self._needs: Needs | None = None

    @property
    def count(self) -> int:
        """Number of threads that run shards."""
        return sum(self._client.nthreads().values())

    @property
    def here(self) -> int:
        """How many of them are on this machine."""
        return self.processes

    def __str__(self) -> str:
        threads = self._client.nthreads()
        return f"cluster {self._address}, {_number(len(threads), 'worker')} with {_number(self.count, 'thread')}"

    def prepare(self, source: Source) -> None:
        """Ask every worker whether its rows would be those computed here; see `Executor`.

        A worker that joins later is asked before its first shard.

        Raises:
            ConfigError: one would compute others, or cannot compute any; each is named.
        """
        needs = self._needs_of(source)
        # by steps, each sent only to those who can read it: a worker dies of a message that it cannot
        _refuse_workers({name: _failure(f) for name, f in self._each(importlib.import_module, WORKER_SIDE).items()})
        _refuse_workers(
            {
                name: _failure(f) or remote.difference(f.result(), needs.made_of)
                for name, f in self._each(remote.made_of, needs.models).items()
            }
        )
        _refuse_workers({name: _failure(f) or f.result() for name, f in self._each(_ask, needs).items()})

    def _each(self, function: Callable[..., object], *arguments: object) -> dict[str, Future]:
        """Have every worker do something, and return what came of it for those that are there at the end."""
        from distributed import wait

        asked: dict[str, Future] = {
            name: self._client.submit(function, *arguments, workers=[name], allow_other_workers=False, pure=False)
            for name in self._client.nthreads()
        }
        while any(not future.done() for future in asked.values()):
            with contextlib.suppress(TimeoutError):
                wait(list(asked.values()), timeout=LOOK)
            there = self._client.nthreads()
            asked = {name: future for name, future in asked.items() if future.done() or name in there}
        return asked

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`. Workers that die or fall silent are Dask's business.

        Raises:
            ResultError: a shard ended several workers, a worker that joined takes no part, or the scheduler is gone.
        """
        from distributed import as_completed

        needs, waiting, done = self._needs_of(task.source), iter(shards), as_completed()
        arguments = (needs, task.shard_size, task.trajectories is not None)
        name = f"torquebench-{hashlib.sha256(repr(arguments).encode()).hexdigest()[:16]}"
        pending: dict[str, tuple[Future, int]] = {}
        try:
            while True:
                for shard in itertools.islice(waiting, max(0, AHEAD * max(1, self.count) - len(pending))):
                    future = self._client.submit(_run, *arguments, shard, key=f"{name}-{shard}", pure=False)
                    pending[future.key] = future, shard
                    done.add(future)
                if not pending:
                    return
                future = next(done)
                if text := _failure(future):
                    raise ResultError(f"shard {pending[future.key][1]}: {text}")
                rows: Rows = future.result()
                if rows.refusal:
                    raise ResultError(rows.refusal)
                if task.trajectories is not None:
                    for file, content in rows.trajectories.items():
                        atomic_write(task.trajectories / file, content)
                _, shard = pending.pop(future.key)
                del future  # the cluster forgets what nobody holds
                yield shard, rows.table
        finally:
            with contextlib.suppress(OSError):
                self._client.cancel([future for future, _ in pending.values()], force=True)

    def _needs_of(self, source: Source) -> Needs:
        if self._needs is None or self._needs.source != source:
            self._needs = remote.needs_of(source)
        return self._needs


def _ask(needs: Needs) -> str:
    """Say, on a worker, why it takes no part, or nothing."""
    from distributed import get_worker

    return remote.refusal(needs, Path(get_worker().local_directory))


def _run(needs: Needs, shard_size: int, with_trajectories: bool, shard: int) -> Rows:
    """Run a shard on a worker."""
    from distributed import get_worker

    if text := _ask(needs):
        return Rows({}, {}, f"worker {get_worker().address} {text}")
    return remote.run(needs, shard_size, with_trajectories, shard)


def _failure(future: Future) -> str:
    """Return why a future that is done has no result, or nothing when it has one."""
    if future.status == "finished":
        return ""
    if future.status != "error":
        return "the connection to the scheduler is lost"
    error = future.exception()
    return f"cannot do the work ({type(error).__name__}: {' '.join(str(error).split())})"


def _refuse_workers(texts: Mapping[str, str]) -> None:
    reasons = {text: [name for name in texts if texts[name] == text] for text in texts.values() if text}
    if reasons:
        raise ConfigError(
            [Problem("--cluster", "", f"worker {' and '.join(names)} {text}") for text, names in reasons.items()]
        )


def _number(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _refuse(message: str) -> None:
    raise ConfigError([Problem("--cluster", "", message)])
