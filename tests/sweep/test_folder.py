"""A sweep's folder: what was written comes back, anything else is not accepted, and one process at a time writes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sweep.examples import SMALL, plan_of
from torquebench.errors import ConfigError, ResultError
from torquebench.experiment.store import RunDirectory, claim_folder
from torquebench.sweep.folder import StoredSweep, create_sweep, facts_of, lock_folder, open_sweep
from torquebench.sweep.run import state_of
from torquebench.sweep.table import Table, empty_columns


def stored_in(folder: Path, digest: str = "d" * 64) -> StoredSweep:
    """A sweep of eight shards in a folder, with a digest of its own."""
    plan = plan_of(SMALL)
    return StoredSweep(folder, plan, replace(facts_of(plan, 5), digest=digest))


@pytest.fixture
def table() -> Table:
    """A table of eight rows with something in every column."""
    columns = empty_columns(plan_of(SMALL), 8)
    rng = np.random.default_rng(0)
    for name, column in columns.items():
        column[:] = rng.integers(0, 9, 8) if column.dtype.kind == "i" else rng.normal(size=8)
        if name in ("controller", "outcome"):
            column[:] = ["band", "sign"] * 4
    columns["rmse"][3] = np.nan
    return columns


def test_a_shard_comes_back_as_it_was_written(tmp_path: Path, table: Table) -> None:
    """Table, their order, types and bytes; and nothing but the file of its name is left in the folder."""
    shards = stored_in(tmp_path)
    shards.write_shard(3, table)
    back = shards.read_shard(3)
    assert back is not None
    assert list(back) == list(table)
    assert all(back[name].dtype == table[name].dtype for name in table)
    assert all(back[name].tobytes() == table[name].tobytes() for name in table)
    assert [p.name for p in (tmp_path / "shards").iterdir()] == ["000003.shard"]
    assert state_of(shards) == ({3}, set(), (0, 1, 2, 4, 5, 6, 7), 10)


def test_a_shard_with_any_byte_altered_is_not_accepted(tmp_path: Path, table: Table) -> None:
    """A flipped bit anywhere in header or content, a file cut off anywhere, or one with more at its end."""
    shards = stored_in(tmp_path)
    shards.write_shard(0, table)
    path, rng = shards.shard_path(0), np.random.default_rng(1)
    whole = path.read_bytes()
    for at in {0, 30, 90, 150, *rng.integers(0, len(whole), 60).tolist()}:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << int(rng.integers(8))]) + whole[at + 1 :])
        assert shards.read_shard(0) is None
        path.write_bytes(whole[:at])
        assert shards.read_shard(0) is None
    path.write_bytes(whole + b"\0")
    assert state_of(shards)[:2] == (set(), {0})
    path.write_bytes(whole)
    assert state_of(shards)[:2] == ({0}, set())


def test_a_shard_of_another_plan_or_number_is_not_accepted(tmp_path: Path, table: Table) -> None:
    """A file is that of one shard of one plan: copied elsewhere it does not count."""
    shards = stored_in(tmp_path)
    shards.write_shard(0, table)
    assert stored_in(tmp_path, "e" * 64).read_shard(0) is None
    shards.shard_path(1).write_bytes(shards.shard_path(0).read_bytes())
    assert shards.read_shard(1) is None
    assert shards.read_shard(2) is None


def test_equal_tables_are_equal_files(tmp_path: Path, table: Table) -> None:
    """No time or name of the machine gets into a shard."""
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        stored_in(tmp_path / name).write_shard(0, table)
    assert stored_in(tmp_path / "a").shard_path(0).read_bytes() == stored_in(tmp_path / "b").shard_path(0).read_bytes()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The folder of a sweep that has been started."""
    plan = plan_of(SMALL)
    return create_sweep(RunDirectory(claim_folder(tmp_path / "s", "small")), plan, 5).folder


def with_facts(**changes: Any) -> str:
    """The plan's JSON with some of its facts changed."""
    return json.dumps(vars(facts_of(plan_of(SMALL), 5)) | changes)


DAMAGED = [
    "[]",
    "null",
    "NaN",
    "[" * 100_000,
    "{",
    with_facts(shard_size="x"),
    with_facts(shard_size=0),
    with_facts(shard_size=True),
    with_facts(digest=None),
    with_facts(plugins=[1]),
    with_facts(config=3),
    with_facts(filename=3),
    with_facts(format="1"),
    with_facts(overrides=[1]),
]


@pytest.mark.parametrize("content", DAMAGED, ids=range(len(DAMAGED)))
def test_a_plan_that_is_not_ours_cannot_be_read(folder: Path, content: str) -> None:
    """Another kind of JSON, one nested too deeply, or a fact of another type: said, in one line, with the folder."""
    (folder / "plan.json").write_text(content)
    with pytest.raises(ConfigError, match=r"is no folder of a sweep: plan\.json or sweep\.yaml is missing or damaged"):
        open_sweep(folder, (), "--resume")


@pytest.mark.parametrize("name", ["plan.json", "sweep.yaml"])
def test_a_pipe_in_a_sweeps_folder_keeps_nobody_waiting(folder: Path, name: str) -> None:
    """A pipe without a writer would be read for ever: it is damage like any other, and a shard that is one is none."""
    stored = stored_in(folder)
    stored.shard_path(0).parent.mkdir(exist_ok=True)
    os.mkfifo(stored.shard_path(0))
    assert stored.read_shard(0) is None
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(ConfigError, match=r"is missing or damaged"):
        open_sweep(folder, (), "--resume")


def test_a_plan_of_which_a_byte_was_changed_is_refused(folder: Path) -> None:
    """Also where no result depends on it, as in the sweep's name or the digest's: resumed, the bytes would differ."""
    path, rng = folder / "plan.json", np.random.default_rng(2)
    whole = path.read_bytes()
    named = [whole.index(word) for word in (b'small"', b'"cases', b'"plan_sha256')]
    for at in {*named, *(at + 3 for at in named), *rng.integers(0, len(whole), 30).tolist()}:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << int(rng.integers(8))]) + whole[at + 1 :])
        with pytest.raises(ConfigError):
            open_sweep(folder, (), "--resume")
    path.write_bytes(whole[:-1])
    with pytest.raises(ConfigError, match=r"plan\.json: changed since it was written \(plan_sha256\)"):
        open_sweep(folder, (), "--resume")


def test_a_plan_of_an_older_version_is_still_read(folder: Path) -> None:
    """One without a digest of itself is taken if all its keys are a plan's."""
    path = folder / "plan.json"
    old = {key: fact for key, fact in json.loads(path.read_text()).items() if key != "plan_sha256"}
    path.write_text(json.dumps(old))
    assert open_sweep(folder, (), "--resume").facts.cases == old["cases"]
    path.write_text(json.dumps(old | {"plan_sha257": ""}))
    with pytest.raises(ConfigError, match="changed since it was written"):
        open_sweep(folder, (), "--resume")


def test_a_folder_of_a_newer_version_is_refused(folder: Path) -> None:
    """What a newer torquebench wrote is not continued by this one."""
    (folder / "plan.json").write_text(with_facts(format=99))
    with pytest.raises(ConfigError, match=r"was written by a newer torquebench \(format 99\)"):
        open_sweep(folder, (), "--resume")


def test_one_process_at_a_time_runs_a_sweep(folder: Path) -> None:
    """Whoever comes second is told; after the first has ended it may."""
    stored = open_sweep(folder, (), "--resume")
    with lock_folder(stored):
        with pytest.raises(ResultError, match="another process is running this sweep"), lock_folder(stored):
            pass
    with lock_folder(stored):
        pass


def test_nothing_unix_only_is_needed_to_import() -> None:
    """Without fcntl, resource, termios and their like, every module of sweeps and of their command can be imported."""
    unix = ("fcntl", "resource", "termios", "tty", "pty", "pwd", "grp", "syslog")
    modules = ("folder", "run", "cluster", "executors", "estimate", "summary")
    lines = [f"sys.modules[{name!r}] = None" for name in unix]
    lines += [f"import torquebench.sweep.{name}" for name in modules] + ["import torquebench.cli.sweep"]
    done = subprocess.run([sys.executable, "-c", "\n".join(["import sys", *lines])], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
