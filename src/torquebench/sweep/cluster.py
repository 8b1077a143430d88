"""Shards on a Dask cluster: that of a running scheduler, or one of processes on this machine.

A worker takes part only if it would compute the client's bytes: it has the same software, source, arm and laws, and
the first rows of the sweep come out the same to the last bit.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import itertools
import logging
import os
import re
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import torquebench
from torquebench.errors import ConfigError, ModelError, Problem, ResultError, TorquebenchError
from torquebench.experiment.store import atomic_write, model_checksums
from torquebench.laws.plugin import load_plugin
from torquebench.robot.library import model_names
from torquebench.sweep.folder import decisive_versions
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.table import Table
from torquebench.sweep.worker import Task, Worker, run_shard

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT = 10.0
"""Time that a scheduler gets to answer [s]."""
FIRST = 30.0
"""Time that its first worker gets to join [s]."""
LOOK = 5.0
"""Time between checks that a worker that is waited for is still there [s]."""
AHEAD = 2
"""Shards submitted in advance for each thread: enough to keep it busy, few enough to keep memory flat."""
IGNORE_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""What a local worker runs first: the terminal sends Ctrl-C to all processes, and the client decides."""
WORKER_SIDE = "torquebench.sweep.cluster"
"""What every worker must be able to import."""
LOCAL = re.compile(r"local(?::(\d{1,4}))?")
REMOTE = re.compile(r"(tcp|tls)://[^\s/]+:\d+")
ABSENT, MODEL = "absent", "model "


class Needs(NamedTuple):
    """What a worker must have so that its rows are those that the client would compute."""

    source: Source
    plugins: tuple[tuple[str, bytes], ...]
    """Name and content of each file of the user's laws."""
    made_of: Mapping[str, str]
    """What the client computes with; see `made_of`."""
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
        raise _refused(f"needs Dask ({error}): wanted pip install 'torquebench[cluster]'") from error
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
        models = [name.removeprefix(MODEL) for name in needs.made_of if name.startswith(MODEL)]
        # in steps, so that nothing is sent to a worker that cannot read it
        steps: tuple[tuple[Callable[..., Any], tuple[Any, ...], Callable[[Any], str]], ...] = (
            (importlib.import_module, (WORKER_SIDE,), lambda module: ""),
            (made_of, (models,), lambda found: difference(found, needs.made_of)),
            (refusal, (needs,), str),
        )
        for function, arguments, judge in steps:
            asked = self._ask_all(function, *arguments)
            texts = {name: _failure(future) or judge(future.result()) for name, future in asked.items()}
            refused = {text: " and ".join(n for n in texts if texts[n] == text) for text in texts.values() if text}
            if refused:
                raise ConfigError([Problem("--cluster", "", f"worker {who} {text}") for text, who in refused.items()])

    def _ask_all(self, function: Callable[..., Any], *arguments: Any) -> dict[str, Future]:
        """Call a function on every worker and return the calls that are done; a worker that is lost has none."""
        from distributed import wait

        asked: dict[str, Future] = {
            name: self._client.submit(function, *arguments, workers=[name], allow_other_workers=False, pure=False)
            for name in self._client.nthreads()
        }
        while waiting := [f for name, f in asked.items() if not f.done() and name in self._client.nthreads()]:
            with contextlib.suppress(TimeoutError):
                wait(waiting, timeout=LOOK)
        return {name: future for name, future in asked.items() if future.done()}

    def run(self, task: Task, shards: Sequence[int]) -> Iterator[tuple[int, Table]]:
        """Run shards; see `Executor`. Dask runs those of a lost worker on another one.

        Raises:
            ResultError: a shard ended several workers, a worker that joined was refused, or the scheduler is gone.
        """
        from distributed import as_completed

        needs, waiting, done = self._needs_of(task.source), iter(shards), as_completed()
        arguments = (needs, task.shard_size, task.trajectories is not None)
        name = f"torquebench-{hashlib.sha256(repr(arguments).encode()).hexdigest()[:16]}"
        pending: dict[str, tuple[Future, int]] = {}
        try:
            while True:
                for shard in itertools.islice(waiting, max(0, AHEAD * max(1, self.count) - len(pending))):
                    future = self._client.submit(run_on_worker, *arguments, shard, key=f"{name}-{shard}", pure=False)
                    pending[future.key] = future, shard
                    done.add(future)
                if not pending:
                    return
                future = next(done)
                if text := _failure(future):
                    raise ResultError(f"shard {pending[future.key][1]}: {text}")
                columns, trajectories, text = future.result()
                if text:
                    raise ResultError(text)
                if task.trajectories is not None:
                    for file, content in trajectories.items():
                        atomic_write(task.trajectories / file, content)
                _, shard = pending.pop(future.key)
                del future  # the cluster forgets what nobody holds
                yield shard, columns
        finally:
            with contextlib.suppress(OSError):
                self._client.cancel([future for future, _ in pending.values()], force=True)


def _failure(future: Future) -> str:
    """Return why a future that is done has no result; nothing when it has one."""
    if future.status == "finished":
        return ""
    if future.status != "error":
        return "the connection to the scheduler is lost"
    error = future.exception()
    return f"cannot do the work ({type(error).__name__}: {' '.join(str(error).split())})"


def _refused(message: str) -> ConfigError:
    return ConfigError([Problem("--cluster", "", message)])


def needs_of(source: Source) -> Needs:
    """Return what the workers of a sweep need, computed by the client."""
    plan = Plan(source)
    words = {str(value.word) for axis in plan.keys.axes for value in axis.values} | {str(plan.first.plant.model)}
    plugins = tuple((path.name, path.read_bytes()) for path in source.plugins)
    return Needs(source, plugins, made_of(sorted(words.intersection(model_names()))), sample(plan))


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


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return how a worker is made of other things than the client; nothing when it is not."""
    wrong = [
        f"{name} {there.get(name, ABSENT)} instead of {want}" for name, want in here.items() if there.get(name) != want
    ]
    return f"has {', '.join(wrong)}: its rows would not be the client's" if wrong else ""


def sample(plan: Plan) -> str:
    """Return a digest of a sweep's first rows, computed here: other processors may have other last bits."""
    digest = hashlib.sha256()
    for name, column in Worker(plan).columns(Task(plan.source, 1), 0).items():
        digest.update(name.encode() + b"\0" + column.tobytes())
    return digest.hexdigest()[:16]


_lock = threading.Lock()
_refusals: dict[str, str] = {}
"""Answers of `refusal` in this worker process, by digest of what was needed."""
_loaded: dict[str, bytes] = {}
"""Laws of the user in this worker process, content by file name: laws cannot be registered anew."""


def refusal(needs: Needs) -> str:
    """Return, on a worker, why it cannot take part in a sweep, or nothing; laws of the user are registered."""
    key = hashlib.sha256(repr(needs).encode()).hexdigest()
    with _lock:  # threads of one process ask at the same time
        if key not in _refusals:
            _refusals[key] = _refusal(needs)
        return _refusals[key]


def _refusal(needs: Needs) -> str:
    from distributed import get_worker

    models = [name.removeprefix(MODEL) for name in needs.made_of if name.startswith(MODEL)]
    if text := difference(made_of(models), needs.made_of):
        return text
    try:
        for name, content in needs.plugins:
            if name not in _loaded:
                path = Path(get_worker().local_directory) / "torquebench-laws" / name
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


def run_on_worker(
    needs: Needs, shard_size: int, with_trajectories: bool, shard: int
) -> tuple[Table, Mapping[str, bytes], str]:
    """Run a shard on a worker; return its columns, trajectories by file name, and why there are none if so.

    Args:
        needs: What the sweep needs.
        shard_size: Number of (case, draw) pairs in a shard.
        with_trajectories: Whether trajectories are wanted.
        shard: Number of the shard.
    """
    from distributed import get_worker

    if text := refusal(needs):
        return {}, {}, f"worker {get_worker().address} {text}"
    if not with_trajectories:
        return run_shard(Task(needs.source, shard_size), shard), {}, ""
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        columns = run_shard(Task(needs.source, shard_size, Path(folder)), shard)
        return columns, {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}, ""
