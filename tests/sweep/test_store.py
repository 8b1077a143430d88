"""Shards on disk: what was written comes back, and anything else is not accepted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.sweep.examples import SMALL, plan_of
from torquebench.sweep.folder import Shards
from torquebench.sweep.table import Columns, empty_columns


@pytest.fixture
def table() -> Columns:
    """A table of eight rows with something in every column."""
    columns = empty_columns(plan_of(SMALL), 8)
    rng = np.random.default_rng(0)
    for name, column in columns.items():
        column[:] = rng.integers(0, 9, 8) if column.dtype.kind == "i" else rng.normal(size=8)
        if name in ("controller", "outcome"):
            column[:] = ["band", "sign"] * 4
    columns["rmse"][3] = np.nan
    return columns


def test_a_shard_comes_back_as_it_was_written(tmp_path: Path, table: Columns) -> None:
    """Columns, their order, types and bytes; and nothing but the file of its name is left in the folder."""
    shards = Shards(tmp_path, "d" * 64)
    shards.write(3, table)
    back = shards.read(3)
    assert back is not None
    assert list(back) == list(table)
    assert all(back[name].dtype == table[name].dtype for name in table)
    assert all(back[name].tobytes() == table[name].tobytes() for name in table)
    assert [p.name for p in (tmp_path / "shards").iterdir()] == ["000003.shard"]
    assert shards.complete(6) == ({3}, set())


def test_a_shard_with_any_byte_altered_is_not_accepted(tmp_path: Path, table: Columns) -> None:
    """A flipped bit anywhere in header or content, a file cut off anywhere, or one with more at its end."""
    shards = Shards(tmp_path, "d" * 64)
    shards.write(0, table)
    path, rng = shards.path(0), np.random.default_rng(1)
    whole = path.read_bytes()
    for at in {0, 30, 90, 150, *rng.integers(0, len(whole), 60).tolist()}:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << int(rng.integers(8))]) + whole[at + 1 :])
        assert shards.read(0) is None
        path.write_bytes(whole[:at])
        assert shards.read(0) is None
    path.write_bytes(whole + b"\0")
    assert shards.complete(1) == (set(), {0})
    path.write_bytes(whole)
    assert shards.complete(1) == ({0}, set())


def test_a_shard_of_another_plan_or_number_is_not_accepted(tmp_path: Path, table: Columns) -> None:
    """A file is that of one shard of one plan: copied elsewhere it does not count."""
    shards = Shards(tmp_path, "d" * 64)
    shards.write(0, table)
    assert Shards(tmp_path, "e" * 64).read(0) is None
    shards.path(1).write_bytes(shards.path(0).read_bytes())
    assert shards.read(1) is None
    assert shards.read(2) is None


def test_equal_tables_are_equal_files(tmp_path: Path, table: Columns) -> None:
    """No time or name of the machine gets into a shard."""
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        Shards(tmp_path / name, "d" * 64).write(0, table)
    assert Shards(tmp_path / "a", "").path(0).read_bytes() == Shards(tmp_path / "b", "").path(0).read_bytes()
