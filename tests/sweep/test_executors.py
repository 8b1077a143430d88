"""Shards on threads and in processes: the same tables, every one of them once, and clean ends."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from tests.sweep.examples import SMALL, plan_of
from torquebench.errors import ResultError
from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment
from torquebench.metrics import applicable
from torquebench.sweep.executors import Executor, Processes, Threads
from torquebench.sweep.plan import Plan
from torquebench.sweep.table import Table
from torquebench.sweep.worker import Stopped, Task, Worker, run_shard

SIZE = 5
PLAN = plan_of(SMALL)
TASK = Task(PLAN.source, SIZE)
SHARDS = range(-(-PLAN.pairs // SIZE))


@pytest.fixture(scope="module")
def whole() -> dict[int, Table]:
    """Every shard, run by one worker in order."""
    worker = Worker(PLAN)
    return {shard: worker.columns(TASK, shard) for shard in SHARDS}


def same(a: Table, b: Table) -> bool:
    """Whether two tables are equal in every byte."""
    return list(a) == list(b) and all(
        a[name].dtype == b[name].dtype and a[name].tobytes() == b[name].tobytes() for name in a
    )


@pytest.mark.parametrize("executor", [Threads(1), Threads(2), Threads(4)], ids=["1", "2", "4"])
def test_tables_do_not_depend_on_who_makes_them(executor: Executor, whole: dict[int, Table]) -> None:
    """Every shard comes once, equal in every byte whatever the number of threads, in reverse order too."""
    order = list(reversed(SHARDS))
    found = list(executor.run(TASK, order))
    assert sorted(shard for shard, _ in found) == list(SHARDS)
    assert all(same(table, whole[shard]) for shard, table in found)


def test_every_row_is_what_running_it_alone_gives(whole: dict[int, Table]) -> None:
    """Outcome, values and metrics of a row equal, bit by bit, those of its experiment run by itself."""
    rows = {name: np.concatenate([whole[shard][name] for shard in SHARDS]) for name in whole[0]}
    assert rows["index"].tolist() == list(range(PLAN.rows))
    for index in (0, 7, 30, 71):
        row = PLAN.row(index)
        assert (rows["case"][index], rows["draw"][index]) == (row.case, row.draw)
        experiment = PLAN.experiment_of(row)
        result = run_experiment(experiment, build(experiment))
        ((name, metrics),) = result.metrics.items()
        assert rows["controller"][index] == name
        assert rows["outcome"][index] == "COMPLETED"
        assert math.isnan(rows["failed_at"][index])
        for info in applicable(tool=False):
            value = metrics[info.key].value
            stored = rows[info.key][index]
            assert np.float64(math.nan if value is None else value).tobytes() == stored.tobytes()


def test_failed_and_refused_runs_have_outcomes_and_no_metrics() -> None:
    """A push that no arm withstands, and drawn constants with which there is no arm: rows like any other."""
    drawn = "{uniform: [8, 12]}\n    model.mismatch.constants.I1: {uniform: [-9, 1]}"
    text = SMALL.replace("{uniform: [8, 12]}", drawn).replace("relative: 0.3", "constants: {g1: 1}")
    plan = plan_of(text, "disturbances=[{kind: bias, channel: torque, value: 1e9}]")
    table = Worker(plan).columns(Task(plan.source, plan.pairs), 0)
    ended = dict(zip(*np.unique(table["outcome"], return_counts=True), strict=True))
    assert set(ended) == {"REFUSED", "DIVERGED"}
    failed = table["outcome"] != "COMPLETED"
    assert np.all(np.isnan(table["failed_at"]) == ~failed)
    assert all(np.all(np.isnan(table[info.key][failed])) for info in applicable(tool=False))


def test_closing_the_iterator_stops_the_rest() -> None:
    """After the first shard nothing more is run, and no thread is left."""
    before = threading.active_count()
    tables = Threads(2).run(TASK, SHARDS)
    next(tables)
    tables.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before


def test_a_worker_that_is_told_to_stop_gives_up_its_shard() -> None:
    """Asked before each pair."""
    asked = iter([False, True])
    with pytest.raises(Stopped):
        run_shard(TASK, 0, lambda: next(asked))


def test_closing_the_iterator_ends_the_processes() -> None:
    """At once, although one has a shard of an hour in hand: no process and no thread is left."""
    plan = plan_of(SMALL, "sweep.grid={run.duration: [0.6, 0.7, 50000]}", "sweep.draws=1")
    threads = threading.active_count()
    tables = Processes(1).run(Task(plan.source, 1), range(3))
    next(tables)
    next(tables)
    tables.close()  # type: ignore[attr-defined]
    assert multiprocessing.active_children() == []
    assert threading.active_count() == threads


def test_a_process_that_dies_is_an_error(whole: dict[int, Table]) -> None:
    """Its tables are the same as any; when somebody kills it, its shard is not waited for, and no process is left."""
    tables = Processes(1).run(TASK, SHARDS)
    shard, table = next(tables)
    assert same(table, whole[shard])
    os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)  # type: ignore[arg-type]
    with pytest.raises(ResultError, match="a worker process died"):
        list(tables)
    assert multiprocessing.active_children() == []


def test_trajectories_are_kept_where_they_are_asked_for(tmp_path: Path) -> None:
    """One file for each row, which is the trajectory of that row."""
    from torquebench import load_trajectory

    Worker(PLAN).columns(Task(PLAN.source, 1, tmp_path), 3)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["6-band.npz", "7-sign.npz"]
    experiment = PLAN.experiment_of(PLAN.row(7))
    run = run_experiment(experiment).runs["sign"]
    assert load_trajectory(tmp_path / "7-sign.npz").digest() == run.digest()


def test_plans_are_equal_wherever_they_are_made() -> None:
    """A plan made from the source alone, as a process does, has the same rows."""
    again = Plan(PLAN.source)
    assert again.rows == PLAN.rows
    assert again.experiment(4, 5) == PLAN.experiment(4, 5)
