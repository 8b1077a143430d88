"""A sweep's folder: plan, shards, final table and manifest, each file whole or not there at all."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import shutil
import tempfile
import zipfile
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean_path
from torquebench.experiment.dump import plain
from torquebench.experiment.store import (
    CLAIM,
    MANIFEST,
    RunDirectory,
    atomic_write,
    check_run,
    checksums,
    file_digest,
    json_bytes,
    machine,
    model_checksums,
    replaced,
    versions,
)
from torquebench.sweep.plan import Plan, Source, flattened
from torquebench.sweep.table import OUTCOMES, Table, empty_columns

CONFIG = "sweep.yaml"
"""The sweep's file, as it was given."""
PLAN = "plan.json"
"""What was made of it; written when everything has been checked."""
SHARDS = "shards"
TABLE, TEXT = "results.npz", "results.csv"
TRAJECTORIES = "trajectories"
FORMAT = 1
"""Layout of the folder; a newer one is refused."""
MAGIC = "torquebench-shard-1"
ABSENT = "(not given)"
DECISIVE = ("torquebench", "python", "mujoco", "numpy", "numba")
"""Software on which numbers depend."""
SOFTWARE = ("software",)
COMPARED = ("config", *SOFTWARE, "plugins", "model_files")
"""Facts of a plan that name what has changed."""
LOCKED_BYTE = 1 << 30
"""Where Windows locks ``plan.json``: far behind its end, so that it can still be read."""


class StoredSweep(NamedTuple):
    """A sweep and the folder that it is stored in."""

    folder: Path
    plan: Plan
    facts: dict[str, Any]
    """Content of ``plan.json``."""

    @property
    def shard_size(self) -> int:
        """Number of (case, draw) pairs in a shard."""
        return int(self.facts["shard_size"])

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.plan.pairs // self.shard_size)

    @property
    def digest(self) -> str:
        """Identifies the plan."""
        return str(self.facts["digest"])

    @property
    def finished(self) -> bool:
        """Whether all results are there."""
        return (self.folder / MANIFEST).is_file()


def create_sweep(directory: RunDirectory, plan: Plan, shard_size: int) -> StoredSweep:
    """Write a sweep's file and plan to a new folder.

    Args:
        directory: The folder.
        plan: The sweep.
        shard_size: Number of (case, draw) pairs in a shard.
    """
    facts = facts_of(plan, shard_size)
    directory.write(CONFIG, plan.text)
    directory.write(PLAN, json_bytes(facts))
    return StoredSweep(directory.folder, plan, facts)


def open_sweep(folder: Path, plugins: tuple[Path, ...], option: str, to_read: bool = False) -> StoredSweep:
    """Open a sweep's folder; its laws must be registered already.

    Args:
        folder: The folder.
        plugins: Current paths of the files of its own laws.
        option: Option of the command that names the folder, for messages.
        to_read: Whether it is read only: then other software may have made it.

    Raises:
        ConfigError: it is not a sweep's folder, or what the sweep is made of has changed.
    """
    if not folder.is_dir():
        raise ConfigError([Problem(option, "", f"{folder}: there is no such folder{did_you_mean_path(folder)}")])
    try:
        facts = _read_facts(folder / PLAN)
        text = (folder / CONFIG).read_bytes()
    except (OSError, ValueError, RecursionError) as error:
        why = f"{PLAN} or {CONFIG} is missing or damaged"
        raise ConfigError([Problem(option, "", f"{folder} is no folder of a sweep: {why}")]) from error
    if facts["format"] > FORMAT:
        message = f"{folder}: was written by a newer torquebench (format {facts['format']}): wanted that one"
        raise ConfigError([Problem(option, "", message)])
    missing = sorted(set(facts["plugins"]) - {path.name for path in plugins})
    if missing:
        message = f"the sweep uses laws of {', '.join(missing)}: wanted --plugin with each of these files"
        raise ConfigError([Problem(option, "", message)])
    plan = Plan(Source(text, facts["filename"], tuple(facts["overrides"]), plugins))
    stored = StoredSweep(folder, plan, facts)
    refuse_changes(stored, plan, option, but=SOFTWARE if to_read else ())
    return stored


def _read_facts(path: Path) -> dict[str, Any]:
    """Return the content of ``plan.json``.

    Raises:
        ValueError: it is not what `facts_of` returns.
    """
    facts: Any = json.loads(path.read_text(encoding="utf-8"))
    texts = ("name", "digest", "filename")
    counts = ("format", "cases", "draws", "rows", "shard_size")
    mappings = ("software", "plugins", "model_files", "config")
    kinds: dict[str, type] = dict.fromkeys(texts, str) | dict.fromkeys(counts, int) | dict.fromkeys(mappings, dict)
    kinds |= {"overrides": list, "controllers": list}
    if not isinstance(facts, dict) or any(type(facts.get(key)) is not kind for key, kind in kinds.items()):
        raise ValueError(f"{path.name} is not a sweep's plan")
    if any(facts[key] < 1 for key in counts) or not all(isinstance(text, str) for text in facts["overrides"]):
        raise ValueError(f"{path.name} is not a sweep's plan")
    return facts


@contextlib.contextmanager
def lock_folder(stored: StoredSweep) -> Iterator[None]:
    """Hold an exclusive lock on the sweep's folder; the system releases it when this process ends, however it ends.

    Raises:
        ResultError: another process holds it.
    """
    with (stored.folder / PLAN).open("rb") as file:
        try:
            _lock(file)
        except OSError as error:
            raise ResultError(f"{stored.folder}: another process is running this sweep") from error
        yield


def _lock(file: BinaryIO) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        file.seek(LOCKED_BYTE)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def facts_of(plan: Plan, shard_size: int) -> dict[str, Any]:
    """Return what identifies a sweep, and what it is made of: the content of ``plan.json``."""
    source = plan.source
    made_of = {
        "software": decisive_versions(),
        "plugins": checksums(source.plugins),
        "model_files": model_checksums(plan.first.plant.model),
    }
    decides = made_of | {"first": plain(plan.first), "sweep": plan.keys.plain(), "shard_size": shard_size}
    text = json.dumps(decides, sort_keys=True, separators=(",", ":"))
    return made_of | {
        "format": FORMAT,
        "name": plan.first.name,
        "cases": plan.cases,
        "draws": plan.draws,
        "rows": plan.rows,
        "controllers": list(plan.controllers),
        "shard_size": shard_size,
        "digest": hashlib.sha256(text.encode()).hexdigest(),
        "filename": source.filename,
        "overrides": list(source.overrides),
        "config": plan.raw,
    }


def decisive_versions() -> dict[str, str]:
    """Return the versions of the software on which numbers depend."""
    return {name: version for name, version in versions().items() if name in DECISIVE}


def refuse_changes(stored: StoredSweep, plan: Plan, option: str, but: Collection[str] = ()) -> None:
    """Refuse to continue a sweep with another plan than it was started with.

    Args:
        stored: The sweep as it was started.
        plan: The sweep as it is now.
        option: Option of the command that names the folder, for messages.
        but: Facts that may have changed.

    Raises:
        ConfigError: something that decides results has changed; each such key is named with its old and new value.
    """
    now = facts_of(plan, stored.shard_size)
    if now["digest"] == stored.digest:
        return
    compared = [key for key in COMPARED if key not in but]
    old, new = (dict(flattened({key: facts[key] for key in compared})) for facts in (stored.facts, now))
    problems = []
    for key in [*old, *(key for key in new if key not in old)]:
        before, after = old.get(key, ABSENT), new.get(key, ABSENT)
        if before != after:
            name = key.removeprefix("config.")
            problems.append(Problem(option, name, f"was {_text(before)} when the sweep began, is {_text(after)} now"))
    if but and not problems:
        return
    raise ConfigError(problems or [Problem(option, "", "the file no longer means what it did when the sweep began")])


def _text(value: Any) -> str:
    return value if value == ABSENT else json.dumps(value)


class Shards:
    """The shards of one sweep; files are added, never changed.

    A file is a line of text, ``torquebench-shard-1 PLAN SHARD SHA256``, followed by an NPZ file of the columns; PLAN is
    the plan's digest, and SHA256 that of everything after the line.

    Args:
        folder: The sweep's folder.
        digest: The plan's digest.
    """

    def __init__(self, folder: Path, digest: str) -> None:
        self._folder, self._digest = folder / SHARDS, digest

    def write(self, shard: int, columns: Table) -> None:
        """Write a shard; it is on the disk when this returns."""
        self._folder.mkdir(exist_ok=True)
        buffer = io.BytesIO()
        np.savez(buffer, **columns)  # type: ignore[arg-type]
        content = buffer.getvalue()
        atomic_write(self.path(shard), self._line(shard, content) + content)

    def read(self, shard: int) -> Table | None:
        """Return a shard's columns; None when it is missing, or is not what was written for this plan."""
        try:
            line, newline, content = self.path(shard).read_bytes().partition(b"\n")
        except FileNotFoundError:
            return None
        if line + newline != self._line(shard, content):
            return None
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}

    def complete(self, count: int) -> tuple[set[int], set[int]]:
        """Return which of the first `count` shards are complete, and which are there but damaged."""
        there = {shard for shard in range(count) if self.path(shard).is_file()}
        good = {shard for shard in there if self.read(shard) is not None}
        return good, there - good

    def clean_up(self) -> None:
        """Remove the unfinished files of a killed process."""
        for folder in (self._folder, self._folder.parent):
            for torn in folder.glob(".*.tmp"):
                torn.unlink(missing_ok=True)

    def path(self, shard: int) -> Path:
        """Return the file of a shard."""
        return self._folder / f"{shard:06d}.shard"

    def _line(self, shard: int, content: bytes) -> bytes:
        return f"{MAGIC} {self._digest} {shard} {hashlib.sha256(content).hexdigest()}\n".encode()


def write_table(stored: StoredSweep) -> dict[str, dict[str, int]]:
    """Write the final table as NPZ and CSV; return each controller's number of runs by outcome.

    Both are put together shard by shard, so that a table may be larger than memory.

    Args:
        stored: The sweep, all of whose shards are complete.

    Raises:
        ResultError: a shard is missing or damaged.
    """
    shards = Shards(stored.folder, stored.digest)
    empty, ended = empty_columns(stored.plan, 0), Counter[tuple[str, str]]()
    with contextlib.ExitStack() as files, replaced(stored.folder / TEXT) as text:
        columns = {name: files.enter_context(tempfile.TemporaryFile(dir=stored.folder)) for name in empty}
        lines = io.TextIOWrapper(text, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(columns)
        for shard in range(stored.shards):
            part = shards.read(shard)
            if part is None:
                raise ResultError(f"{shards.path(shard)}: missing or damaged since it was written")
            for name, file in columns.items():
                file.write(np.ascontiguousarray(part[name], empty[name].dtype).tobytes())
            writer.writerows(zip(*(part[name].tolist() for name in columns), strict=True))
            ended.update(zip(part["controller"].tolist(), part["outcome"].tolist(), strict=True))
        lines.detach()
        with replaced(stored.folder / TABLE) as whole:
            _write_npz(whole, empty, columns, stored.plan.rows)
    return {
        name: {kind: ended[name, kind] for kind in OUTCOMES if ended[name, kind]} for name in stored.plan.controllers
    }


def _write_npz(out: BinaryIO, empty: Table, columns: Mapping[str, Any], rows: int) -> None:
    """Write columns whose bytes are in files as numpy's NPZ."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for name, file in columns.items():
            file.seek(0)
            header = {"descr": empty[name].dtype.str, "fortran_order": False, "shape": (rows,)}
            # ZipInfo has a fixed time stamp by default: equal tables are equal files
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array_header_1_0(member, header)
                shutil.copyfileobj(file, member, 1 << 20)


def read_column(stored: StoredSweep, name: str) -> NDArray[Any]:
    """Return one column of the final table; the others are not read."""
    with np.load(stored.folder / TABLE, allow_pickle=False) as table:
        column: NDArray[Any] = table[name]
    return column


def write_manifest(stored: StoredSweep, facts: Mapping[str, Any], more: Sequence[str] = ()) -> None:
    """Write the manifest, by which the sweep counts as finished.

    Args:
        stored: The sweep, with all other files written.
        facts: What else the manifest is to hold.
        more: Names of further files.
    """
    folder = stored.folder
    kept = sorted(path for path in (folder / TRAJECTORIES).glob("*.npz"))
    files = [folder / name for name in (CONFIG, PLAN, TABLE, TEXT, *more)] + kept
    plan = {key: stored.facts[key] for key in ("name", "digest", "rows", "software", "plugins", "model_files")}
    digests = {path.relative_to(folder).as_posix(): file_digest(path) for path in files}
    atomic_write(folder / MANIFEST, json_bytes(plan | dict(facts) | {"machine": machine(), "files": digests}))
    (folder / CLAIM).unlink(missing_ok=True)


def verify(stored: StoredSweep) -> None:
    """Verify that the manifest is this plan's, and every file what the manifest says.

    Raises:
        ResultError: it is not.
    """
    if check_run(stored.folder).get("digest") != stored.digest:
        raise ResultError(f"{stored.folder}: its manifest is another sweep's")
