"""The final table, put together shard by shard so that it may be larger than memory; the manifest last."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import shutil
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from torquebench.errors import ResultError
from torquebench.experiment.store import CLAIM, MANIFEST, atomic_write, file_digest, json_bytes, machine, sync_folder
from torquebench.sweep.columns import Table
from torquebench.sweep.form import OUTCOMES, empty_columns
from torquebench.sweep.shards import Shards
from torquebench.sweep.store import CONFIG, PLAN, TRAJECTORIES, Stored

TABLE = "results.npz"
TEXT = "results.csv"


def write_results(stored: Stored, shards: Shards) -> dict[str, dict[str, int]]:
    """Write the final table in both forms, each whole or not at all; return each controller's number of each outcome.

    Args:
        stored: The sweep.
        shards: Its shards, all complete.

    Raises:
        ResultError: a shard is missing or damaged.
    """
    empty, ended = empty_columns(stored.plan, 0), Counter[tuple[str, str]]()
    with contextlib.ExitStack() as files, replaced(stored.folder / TEXT) as text:
        columns = {name: files.enter_context(tempfile.TemporaryFile(dir=stored.folder)) for name in empty}
        lines = io.TextIOWrapper(text, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(columns)
        for shard in range(stored.shards):
            table = shards.read(shard)
            if table is None:
                raise ResultError(f"{shards.path(shard)}: missing or damaged since it was written")
            for name, file in columns.items():
                file.write(np.ascontiguousarray(table[name], empty[name].dtype).tobytes())
            writer.writerows(zip(*(table[name].tolist() for name in columns), strict=True))
            ended.update(zip(table["controller"].tolist(), table["outcome"].tolist(), strict=True))
        lines.detach()
        with replaced(stored.folder / TABLE) as whole:
            _write_npz(whole, empty, columns, stored.plan.rows)
    return {
        name: {kind: ended[name, kind] for kind in OUTCOMES if ended[name, kind]} for name in stored.plan.controllers
    }


def _write_npz(out: BinaryIO, empty: Table, columns: Mapping[str, Any], rows: int) -> None:
    """Write columns whose bytes are in files as numpy's NPZ, which opens like any other."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for name, file in columns.items():
            file.seek(0)
            header = {"descr": empty[name].dtype.str, "fortran_order": False, "shape": (rows,)}
            # a fixed time stamp, which ZipInfo has by default: equal tables are equal files
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array_header_1_0(member, header)
                shutil.copyfileobj(file, member, 1 << 20)


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes its name only when it has been written whole and is on the disk."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    sync_folder(path.parent)


def read_column(stored: Stored, name: str) -> npt.NDArray[Any]:
    """Return one column of the final table."""
    with np.load(stored.folder / TABLE, allow_pickle=False) as table:
        column: npt.NDArray[Any] = table[name]
    return column


def finish(stored: Stored, facts: Mapping[str, Any], more: Sequence[str] = ()) -> None:
    """Write the manifest, by which the sweep counts as finished.

    Args:
        stored: The sweep, with all other files written.
        facts: What else it is to hold.
        more: Names of further files.
    """
    folder = stored.folder
    kept = sorted(path for path in (folder / TRAJECTORIES).glob("*.npz"))
    files = [folder / name for name in (CONFIG, PLAN, TABLE, TEXT, *more)] + kept
    own = {key: stored.facts[key] for key in ("name", "digest", "rows", "software", "plugins", "model_files")}
    content = own | dict(facts) | {"machine": machine(), "files": {_name(p, folder): file_digest(p) for p in files}}
    atomic_write(folder / MANIFEST, json_bytes(content))
    (folder / CLAIM).unlink(missing_ok=True)


def _name(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix()
