"""A sweep run from Python: the files are those of the command, it goes on where it was, and refuses another plan."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sweep.examples import SMALL, plan_of
from torquebench.errors import ConfigError, ResultError
from torquebench.sweep.executors import Threads
from torquebench.sweep.folder import StoredSweep, lock_folder
from torquebench.sweep.run import run_sweep, state_of
from torquebench.sweep.table import read_table

DRAWS = "sweep.draws=2"
PLAN = plan_of(SMALL, DRAWS)


def test_a_sweep_goes_on_where_it_was_and_ends_in_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped by an error while a shard is written, then run again; once finished, it is only verified.

    The tables are those of an undisturbed sweep in a temporary folder; progress starts with the rows that are there.
    """
    whole = run_sweep(PLAN, executor=Threads(1))
    write, progress = StoredSweep.write_shard, list[tuple[int, int]]()

    def full(self: StoredSweep, shard: int, columns: object) -> None:
        if shard == 3:
            raise OSError("no space left")
        write(self, shard, columns)  # type: ignore[arg-type]

    monkeypatch.setattr(StoredSweep, "write_shard", full)
    with pytest.raises(OSError, match="no space left"):
        run_sweep(PLAN, tmp_path / "s", Threads(1))
    monkeypatch.undo()
    stored = run_sweep(PLAN, tmp_path / "s", Threads(2), progress=lambda done, rows: progress.append((done, rows)))
    done = [rows for rows, _ in progress]
    assert done == sorted(done)
    assert (done[0], done[-1]) == (6, PLAN.rows)
    assert {rows for _, rows in progress} == {PLAN.rows}
    for name in ("results.npz", "results.csv", "plan.json"):
        assert (stored.folder / name).read_bytes() == (whole.folder / name).read_bytes()
    assert len(read_table(stored.folder / "results.npz")["index"]) == PLAN.rows
    before = (stored.folder / "manifest.json").stat().st_mtime_ns
    assert state_of(run_sweep(PLAN, tmp_path / "s", Threads(1))).missing == ()
    assert (stored.folder / "manifest.json").stat().st_mtime_ns == before
    with (stored.folder / "results.csv").open("a") as file:
        file.write("\n")
    with pytest.raises(ResultError, match=r"results\.csv: missing or changed"):
        run_sweep(PLAN, tmp_path / "s", Threads(1))


def test_another_plan_and_other_files_are_refused(tmp_path: Path) -> None:
    """A folder with a sweep of other draws, one that is not empty, and one that another process is running in."""
    stored = run_sweep(PLAN, tmp_path / "s", Threads(1))
    with pytest.raises(ConfigError, match=r"sweep\.draws: was 2 when the sweep began, is 3 now"):
        run_sweep(plan_of(SMALL, "sweep.draws=3"), tmp_path / "s", Threads(1))
    (tmp_path / "t").mkdir()
    (tmp_path / "t" / "mine.txt").write_text("mine")
    with pytest.raises(ConfigError, match="is not empty"):
        run_sweep(PLAN, tmp_path / "t", Threads(1))
    (stored.folder / "manifest.json").unlink()
    with lock_folder(stored), pytest.raises(ResultError, match="another process is running this sweep"):
        run_sweep(PLAN, tmp_path / "s", Threads(1))
