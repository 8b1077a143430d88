"""Shards on a Dask cluster of two worker processes: the bytes are those of any other executor, whatever happens.

All tests share one cluster, which takes seconds to start.
"""

from __future__ import annotations

import hashlib
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from distributed import Client, default_client

from tests.command_line import parsed
from tests.sweep.examples import SMALL, plan_of, user_law
from tests.sweep.test_executors import same
from torquebench.cli.app import main
from torquebench.errors import ConfigError, ResultError
from torquebench.registry import restored
from torquebench.robot.library import data_root
from torquebench.shipped import how_to_install
from torquebench.sweep import cluster as cluster_module
from torquebench.sweep.cluster import Cluster, open_cluster
from torquebench.sweep.executors import AHEAD, Executor, Threads
from torquebench.sweep.folder import StoredSweep
from torquebench.sweep.plan import Plan
from torquebench.sweep.worker import Task, Worker

WORKERS = 2
PLAN = plan_of(SMALL)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """Two worker processes of one thread on the loopback interface."""
    with open_cluster(f"local:{WORKERS}") as found:
        yield found


@pytest.fixture
def address(cluster: Cluster) -> str:
    """The address of its scheduler, as a user would give it."""
    return str(default_client().scheduler.address)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the small sweep, which is also the current one."""
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(SMALL)
    return tmp_path


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run ``torquebench sweep``: (exit status, standard output, standard error)."""

    def run(*arguments: object) -> tuple[int, str, str]:
        status = main(["sweep", *map(str, arguments)])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def results(folder: str) -> dict[str, str]:
    """Digests of everything that a sweep leaves but its manifest, which has the time and the machine."""
    files = [path for path in sorted(Path(folder).rglob("*")) if path.is_file() and path.name != "manifest.json"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def shards_of(plan: Plan, executor: Executor, size: int) -> dict[int, Any]:
    """Every shard of a plan; none comes twice."""
    found: dict[int, Any] = {}
    for shard, table in executor.run(Task(plan.source, size), range(-(-plan.pairs // size))):
        assert shard not in found
        found[shard] = table
    return found


def test_a_local_cluster_listens_on_loopback_only(cluster: Cluster) -> None:
    """Scheduler, workers and the scheduler's page of numbers: nobody on the network can reach them."""
    scheduler = default_client().cluster.scheduler
    assert {address.partition("//")[2].partition(":")[0] for address in (scheduler.address, *scheduler.workers)} == {
        "127.0.0.1"
    }
    assert scheduler.http_server.address == "127.0.0.1"


def test_tables_are_equal_in_every_byte_whoever_makes_them(folder, address, command):
    """Threads, processes, and Dask by address; trajectories too, which workers send and the client writes."""
    kept = ("--set", "sweep.keep=all", "--set", "sweep.draws=2")
    for name, how in (
        ("a", ("--executor", "threads", "--workers", 2)),
        ("b", ("--workers", 1)),
        ("c", ("--cluster", address)),
    ):
        status, out, err = command("small.yaml", "--out", name, *kept, *how)
        assert (status, err) == (0, ""), err
    assert f"cluster {address}, 2 workers with 2 threads" in out
    assert results("a") == results("b") == results("c")
    assert {"results.npz", "results.csv", "trajectories/23-sign.npz"} <= set(results("c"))


def test_few_shards_are_with_the_cluster_at_once(cluster: Cluster) -> None:
    """However many there are, it has those in hand and no result that was taken, so memory stays flat."""
    scheduler, most, count = default_client().cluster.scheduler, 0, 0
    for shard, table in cluster.run(Task(PLAN.source, 1), range(PLAN.pairs)):
        assert same(table, Worker(PLAN).columns(Task(PLAN.source, 1), shard)) or shard % 9
        most, count = max(most, len(scheduler.tasks)), count + 1
    assert count == PLAN.pairs == 36
    assert 1 <= most <= AHEAD * WORKERS + 2  # one may be on its way in, and one on its way out


class Busy(NamedTuple):
    """A worker and the shard that it is running."""

    address: str
    pid: int
    key: str


def running(client: Client) -> list[Busy]:
    """Workers that are in the middle of a shard, as they say themselves."""

    def report(dask_worker: Any) -> tuple[int, list[str]]:
        return os.getpid(), [task.key for task in dask_worker.state.executing]

    said = client.run(report)
    return [Busy(name, pid, keys[0]) for name, (pid, keys) in said.items() if keys]


def kill_one(client: Client) -> Busy:
    """Kill a worker with SIGKILL while it runs a shard: it is stopped first, so that it cannot finish meanwhile."""
    scheduler = client.cluster.scheduler
    for _ in range(200):
        for busy in running(client):
            os.kill(busy.pid, signal.SIGSTOP)
            time.sleep(0.1)  # what it sent before it was stopped arrives
            if busy.key in {task.key for task in scheduler.workers[busy.address].processing}:
                os.kill(busy.pid, signal.SIGKILL)
                return busy
            os.kill(busy.pid, signal.SIGCONT)
    raise RuntimeError("no worker was met while it ran a shard")


def test_a_killed_worker_changes_nothing(cluster: Cluster) -> None:
    """SIGKILL in the middle of a shard, some done and some missing: every shard comes once, with the same bytes."""
    plan = plan_of(SMALL, "run.duration=4", "sweep.draws=3")
    whole = shards_of(plan, Threads(1), 2)
    client, killed, found = default_client(), None, {}
    for shard, table in cluster.run(Task(plan.source, 2), range(len(whole))):
        assert shard not in found
        found[shard] = table
        killed = killed or kill_one(client)
    assert killed is not None
    assert sorted(found) == sorted(whole)
    assert all(same(found[shard], whole[shard]) for shard in whole)
    client.wait_for_workers(WORKERS, timeout=60)  # Dask starts another in its place
    assert killed.address not in client.nthreads()


def test_an_interrupted_sweep_is_finished_by_another_executor(folder, address, command, monkeypatch):
    """Ctrl-C on the cluster: exit 130, nothing left with the scheduler; threads finish it, or the other way round."""
    how = {"cluster": ("--cluster", address), "threads": ("--executor", "threads", "--workers", 2)}
    assert command("small.yaml", "--out", "whole", *how["threads"])[0] == 0
    write = StoredSweep.write_shard
    for first, second in (("cluster", "threads"), ("threads", "cluster")):
        written: list[int] = []

        def interrupted(self: StoredSweep, shard: int, table: Any, written: list[int] = written) -> None:
            if len(written) == 5:
                signal.raise_signal(signal.SIGINT)
            write(self, shard, table)
            written.append(shard)

        monkeypatch.setattr(StoredSweep, "write_shard", interrupted)
        status, _, err = command("small.yaml", "--out", first, *how[first])
        monkeypatch.setattr(StoredSweep, "write_shard", write)
        assert (status, len(written)) == (130, 5)
        assert f"torquebench sweep --resume {first}" in err
        status, out, _ = command("--resume", first, *how[second])
        assert status == 0
        assert "13 shards run, 5 were there" in out
        assert results(first) == results("whole")
    while default_client().cluster.scheduler.tasks:  # what was cancelled while it ran goes when it is done
        time.sleep(0.01)


def test_workers_with_other_software_are_refused(folder, cluster, address, command, monkeypatch):
    """Exit 2, each worker named with its version and the client's, nothing written; one that joins later, too."""
    versions = cluster_module.decisive_versions()
    monkeypatch.setattr(cluster_module, "decisive_versions", lambda: versions | {"numpy": "0.0.1"})
    cluster._needs_of.cache_clear()
    status, _, err = command("small.yaml", "--out", "s", "--cluster", address)
    assert status == 2
    names = sorted(default_client().nthreads())
    assert len(err.splitlines()) == 1
    assert all(name in err for name in names)
    assert f"has numpy {versions['numpy']} instead of 0.0.1" in err
    assert not Path("s").exists()
    with pytest.raises(ResultError, match=r"worker tcp://.* has numpy .* instead of 0\.0\.1"):
        shards_of(PLAN, cluster, 9)
    cluster._needs_of.cache_clear()


def test_the_one_worker_that_differs_is_named(cluster):
    """One of the two has other source, and is busy, so that Dask would rather ask another: it is refused."""
    client = default_client()
    name = next(iter(client.nthreads()))

    def alter(text: str) -> str:

        from torquebench.sweep import cluster

        before, cluster._SOURCE = cluster._SOURCE, text
        return before

    before = client.run(alter, "other", workers=[name])[name]
    busy = client.submit(time.sleep, 0.5, workers=[name], pure=False)
    with pytest.raises(ConfigError) as caught:
        cluster.prepare(PLAN.source)
    busy.result()
    client.run(alter, before, workers=[name])
    (problem,) = caught.value.problems
    assert problem.message.startswith(f"worker {name} has source of torquebench other instead of {before}")
    cluster.prepare(PLAN.source)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        (
            "made_of",
            lambda models: cluster_module.decisive_versions() | {"model nobody": "x"},
            "has model nobody absent instead",
        ),
        ("sample", lambda plan: "x", "computes other last bits"),
    ],
)
def test_workers_that_would_compute_other_bytes_are_refused(cluster, monkeypatch, name, value, text):
    """Other files of the arm, or other last bits of the first rows."""
    cluster._needs_of.cache_clear()
    monkeypatch.setattr(cluster_module, name, value)
    with pytest.raises(ConfigError, match=text):
        cluster.prepare(PLAN.source)


def test_workers_without_the_package_are_refused_unharmed(cluster, monkeypatch):
    """A worker that cannot import what it needs says so; it is not sent anything that it could not read."""
    before = default_client().nthreads()
    monkeypatch.setattr(cluster_module, "WORKER_SIDE", "torquebench.sweep.nowhere")
    with pytest.raises(ConfigError, match=r"cannot do the work \(ModuleNotFoundError: No module named 'torquebench.sw"):
        cluster.prepare(PLAN.source)
    assert default_client().nthreads() == before


LAW = user_law("clustered-law")


def test_laws_of_the_user_are_sent_to_the_workers(folder, address, command, monkeypatch):
    """The workers need not see the file; when it has changed, those that know the old one are refused."""
    own = (
        "--set",
        "controllers=[{name: own, law: clustered-law, gains: {k: 1}}]",
        "--set",
        "sweep.grid={}",
        "--set",
        "sweep.random={controllers.*.gains.k: {uniform: [1, 2]}}",
        "--plugin",
        "law.py",
    )
    found = []
    for name, text, how in (
        ("a", LAW, ("--executor", "threads")),
        ("b", LAW, ("--cluster", address)),
        ("c", LAW.replace("10.0", "12.0"), ("--cluster", address)),
    ):
        Path("law.py").write_text(text)
        with restored():
            found.append(command("small.yaml", "--out", name, *own, *how))
    assert [status for status, _, _ in found] == [0, 0, 2]
    assert results("a") == results("b")
    assert "has another law.py loaded: restart the workers" in found[2][2]
    assert not Path("c").exists()


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("localhost:8786", "got 'localhost:8786', wanted tcp://HOST:PORT"),
        ("local:0", "got 'local:0', wanted"),
        ("tcp://127.0.0.1", "got 'tcp://127.0.0.1', wanted"),
        ("tcp://127.0.0.1:1", "no connection to a scheduler at tcp://127.0.0.1:1 within 0.3 s"),
        ("tls://127.0.0.1:1", "no connection to a scheduler at tls://127.0.0.1:1 within 0.3 s"),
    ],
)
def test_an_address_without_a_scheduler_is_refused(folder, command, monkeypatch, address, text):
    """Exit 2 after at most the stated time, with the reason, and nothing written."""
    monkeypatch.setattr(cluster_module, "CONNECT", 0.3)
    status, _, err = command("small.yaml", "--out", "s", "--cluster", address)
    assert status == 2
    assert err.startswith(f"--cluster: {text}"), err
    assert len(err.splitlines()) == 1
    assert not Path("s").exists()


def test_without_dask_it_says_what_to_install(folder, command, monkeypatch):
    """Exit 2 with the extra's name."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, err = command("small.yaml", "--cluster", "local:2")
    assert status == 2
    assert how_to_install("cluster") in err


@pytest.mark.parametrize("option", [("--workers", 2), ("--executor", "threads")])
def test_options_that_have_no_effect_are_refused(folder, command, option):
    """A cluster's workers are its own."""
    status, _, err = command("small.yaml", "--cluster", "local", *option)
    assert status == 2
    assert err.startswith(f"{option[0]}: has no effect with --cluster")


def test_what_the_documentation_shows_can_be_read() -> None:
    """Its Python is Python, its YAML is YAML, and its commands are commands of this version."""
    text = (data_root() / "docs" / "cluster.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)
    assert [language for language, _ in blocks] == ["sh", "sh", "python", "yaml"]
    compile(blocks[2][1], "slurm.py", "exec")
    assert set(yaml.safe_load(blocks[3][1])["distributed"]["comm"]) == {"require-encryption", "tls"}
    lines = [line.partition("#")[0].split() for _, block in blocks[:2] for line in block.splitlines()]
    commands = [words[1:] for words in lines if words and words[0].endswith("torquebench")]
    assert [parsed(words)["cluster"] for words in commands] == ["local", "local:3", "tcp://one:8786"]
