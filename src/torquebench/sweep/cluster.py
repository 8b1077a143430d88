"""Shards on a Dask cluster: that of a running scheduler, or one of processes on this machine.

A worker takes part only if it would compute the client's bytes: it has the same software, source, arm and laws, and
the first rows of the sweep come out the same to the last bit.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import hashlib
import importlib
import logging
import os
import re
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import torquebench
from torquebench.errors import ConfigError, ModelError, Problem, ResultError, TorquebenchError
from torquebench.experiment.store import atomic_write, model_checksums
from torquebench.laws.plugin import load_plugin
from torquebench.robot.library import model_names
from torquebench.shipped import how_to_install
from torquebench.sweep.executors import as_done
from torquebench.sweep.folder import decisive_versions
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.table import Table
from torquebench.sweep.worker import Task, Worker, run_shard

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Worker as DaskWorker

CONNECT = 10.0
"""Time that a scheduler gets to answer [s]."""
FIRST = 30.0
"""Time that its first worker gets to join [s]."""
IGNORE_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""What a local worker runs first: the terminal sends Ctrl-C to all processes, and the client decides."""
WORKER_SIDE = "torquebench.sweep.cluster"
"""What every worker must be able to import."""
LOCAL = re.compile(r"local(?::(\d{1,4}))?")
REMOTE = re.compile(r"(tcp|tls)://[^\s/]+:\d+")
ABSENT, MODEL = "absent", "model "


class Needs(NamedTuple):
    """Requirements on a worker, so that its rows are those that the client would compute."""

    source: Source
    plugins: tuple[tuple[str, bytes], ...]
    """Name and content of each file of the user's laws."""
    models: tuple[str, ...]
    """Names of the arms that the sweep uses."""
    made_of: tuple[tuple[str, str], ...]
    """Software and files that the client computes with; see `made_of`."""
    sample: str
    """Digest of the first rows as the client computes them."""


@contextlib.contextmanager
def open_cluster(address: str) -> Iterator[Cluster]:
    """Connect to a cluster, or start one; closed at the end.

    Args:
        address: ``tcp://HOST:PORT`` or ``tls://HOST:PORT`` of a scheduler, ``local`` or ``local:N`` for N processes on
            this machine (default: one per core), which listen on the loopback interface only.

    Raises:
        ConfigError: Dask is missing, the address is none, no scheduler answers, or it has no worker.
    """
    local, remote = LOCAL.fullmatch(address), REMOTE.fullmatch(address)
    if not remote and (not local or local[1] == "0"):
        raise _refused(f"got {address!r}, wanted tcp://HOST:PORT, tls://HOST:PORT, local or local:N")
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise _refused(f"needs Dask ({error}): wanted {how_to_install('cluster')}") from error
    with contextlib.ExitStack() as stack:
        if local:
            count = int(local[1] or os.cpu_count() or 1)
            workers = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # any port: the default one may be taken
                memory_limit=None,
                preload=IGNORE_CTRL_C,
                silence_logs=logging.CRITICAL,
            )
            yield Cluster(stack.enter_context(Client(stack.enter_context(workers))), address, count)
            return
        try:
            client = stack.enter_context(Client(address, timeout=CONNECT))
        except (OSError, TypeError, ValueError, RuntimeError) as error:  # TypeError: no certificates for tls://
            raise _refused(f"no connection to a scheduler at {address} within {CONNECT:g} s ({error})") from error
        try:
            client.wait_for_workers(1, timeout=FIRST)
        except TimeoutError as error:
            message = f"the scheduler at {address} has no worker after {FIRST:g} s: start some with `dask worker`"
            raise _refused(message) from error
        yield Cluster(client, address, 0)


class Cluster:
    """Workers of a Dask cluster, as many as there are at the moment; see `open_cluster` and `Executor`.

    Args:
        client: The connection to the scheduler.
        address: What the cluster is called.
        processes: Number of its processes on this machine.
    """

    def __init__(self, client: Client, address: str, processes: int) -> None:
        self._client, self._address = client, address
        self.processes = self.here = processes
        self._needs_of = functools.lru_cache(maxsize=1)(needs_of)

    @property
    def count(self) -> int:
        """Number of threads that run shards."""
        return sum(self._client.nthreads().values())

    def __str__(self) -> str:
        workers, threads = len(self._client.nthreads()), self.count
        words = f"{workers} worker{'s' * (workers != 1)} with {threads} thread{'s' * (threads != 1)}"
        return f"cluster {self._address}, {words}"

    def prepare(self, source: Source) -> None:
        """Check that every worker would compute the client's bytes; one that joins later is checked by its first shard.

        Raises:
            ConfigError: one would not, or cannot compute anything; each is named.
        """
        needs = self._needs_of(source)
        # in steps, so that nothing is sent to a worker that cannot read it
        steps: tuple[tuple[Callable[..., Any], Any, Callable[[Any], str]], ...] = (
            (importlib.import_module, WORKER_SIDE, lambda module: ""),
            (made_of, needs.models, lambda found: difference(found, needs.made_of)),
            (asked_for_refusal, needs, str),
        )
        for function, argument, judge in steps:
            answers: dict[str, Any] = self._client.run(function, argument, on_error="return")
            refused: dict[str, list[str]] = {}
            for worker, answer in answers.items():
                if text := _failure(answer) if isinstance(answer, Exception) else judge(answer):
                    refused.setdefault(text, []).append(worker)
            if refused:
                texts = [f"worker {' and '.join(workers)} {text}" for text, workers in refused.items()]
                raise ConfigError([Problem("--cluster", "", text) for text in texts])

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`. Dask runs those of a lost worker on another one.

        Raises:
            ResultError: a shard ended several workers, a worker that joined was refused, or the scheduler is gone.
        """
        pool = self._client.get_executor(pure=False)
        submit = functools.partial(pool.submit, run_on_worker, self._needs_of(task.source), task)
        try:
            for shard, (table, trajectories) in as_done(self, submit, shards):
                for path, content in trajectories.items():
                    atomic_write(path, content)
                yield shard, table
        except CancelledError as error:
            raise ResultError("the connection to the scheduler is lost") from error
        except (OSError, ResultError):
            raise
        except Exception as error:  # a worker may fail in any way
            raise ResultError(f"a worker {_failure(error)}") from error
        finally:
            with contextlib.suppress(OSError):
                pool.shutdown(wait=False)


def _failure(error: Exception) -> str:
    return f"cannot do the work ({type(error).__name__}: {' '.join(str(error).split())})"


def _refused(message: str) -> ConfigError:
    return ConfigError([Problem("--cluster", "", message)])


def needs_of(source: Source) -> Needs:
    """Return what the workers of a sweep need, computed by the client."""
    plan = Plan(source)
    words = {str(value.word) for axis in plan.keys.axes for value in axis.values} | {str(plan.first.plant.model)}
    models = tuple(sorted(words.intersection(model_names())))
    plugins = tuple((path.name, path.read_bytes()) for path in source.plugins)
    return Needs(source, plugins, models, tuple(made_of(models).items()), sample(plan))


def made_of(models: Sequence[str]) -> dict[str, str]:
    """Return the versions that decide numbers, and digests of this package's source and of the arms' files."""
    found = decisive_versions() | {"source of torquebench": _SOURCE}
    for model in models:
        try:
            files = model_checksums(model)
        except ModelError:
            files = {}
        found[MODEL + model] = hashlib.sha256(repr(files).encode()).hexdigest()[:16] if files else ABSENT
    return found


def _source() -> str:
    package, digest = Path(torquebench.__file__).parent, hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


_SOURCE = _source()
"""Digest of the source when this process read it: what is on the disk may have changed since."""


def difference(there: Mapping[str, str], here: Iterable[tuple[str, str]]) -> str:
    """Return how a worker is made of other things than the client; nothing when it is not.

    Args:
        there: What the worker is made of.
        here: What the client is made of.
    """
    wrong = [f"{name} {there.get(name, ABSENT)} instead of {want}" for name, want in here if there.get(name) != want]
    return f"has {', '.join(wrong)}: its rows would not be the client's" if wrong else ""


def sample(plan: Plan) -> str:
    """Return a digest of a sweep's first rows, computed here: other processors may have other last bits."""
    digest = hashlib.sha256()
    for name, column in Worker(plan).columns(Task(plan.source, 1), 0).items():
        digest.update(name.encode() + b"\0" + column.tobytes())
    return digest.hexdigest()[:16]


_lock = threading.Lock()
_loaded: dict[str, bytes] = {}
"""Laws of the user in this worker process, content by file name: laws cannot be registered anew."""


async def asked_for_refusal(needs: Needs, dask_worker: DaskWorker) -> str:
    """Return `refusal`, found in a thread: the worker, which Dask names, goes on answering the scheduler meanwhile."""
    return await asyncio.to_thread(refusal, needs, dask_worker.local_directory)


def refusal(needs: Needs, folder: str) -> str:
    """Return, on a worker, why it cannot take part in a sweep, or nothing; laws of the user are registered."""
    with _lock:  # threads of one process ask at the same time
        return _refusal(needs, folder)


@functools.cache
def _refusal(needs: Needs, folder: str) -> str:
    if text := difference(made_of(needs.models), needs.made_of):
        return text
    try:
        for name, content in needs.plugins:
            if name not in _loaded:
                path = Path(folder) / "torquebench-laws" / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                load_plugin(path)
                _loaded[name] = content
            if _loaded[name] != content:
                return f"has another {name} loaded: restart the workers"
        found = sample(Plan(needs.source))
    except ConfigError as error:
        return "; ".join(map(str, error.problems))
    except (OSError, TorquebenchError) as error:
        return str(error)
    if found != needs.sample:
        return "computes other last bits in the first rows than the client, from the same software: other processor?"
    return ""


def run_on_worker(needs: Needs, task: Task, shard: int) -> tuple[Table, Mapping[Path, bytes]]:
    """Run a shard on a worker; return its rows, and the trajectories that the client is to write.

    Raises:
        ResultError: this worker cannot take part, and why.
    """
    from distributed import get_worker

    worker = get_worker()
    if text := refusal(needs, worker.local_directory):
        raise ResultError(f"worker {worker.address} {text}")
    if task.trajectories is None:
        return run_shard(task, shard), {}
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        table = run_shard(task._replace(trajectories=Path(folder)), shard)
        return table, {task.trajectories / path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
