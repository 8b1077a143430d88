"""A sweep's folder: plan, shards, final table and manifest, each file whole or not there at all."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

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
    own_digest,
    read_stored,
    replaced,
    versions,
    write_manifest,
)
from torquebench.experiment.values import Count, from_json
from torquebench.robot.library import ArmFile, arm_name, is_path
from torquebench.sweep.plan import Plan, Source, flattened, pairs_of
from torquebench.sweep.table import OUTCOMES, Table, empty_columns

CONFIG = "sweep.yaml"
"""The sweep's file, as it was given."""
PLAN = "plan.json"
"""Plan that is made of it; written when everything has been checked."""
PLAN_DIGEST = "plan_sha256"
"""Key of the plan: the digest of all others."""
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
"""Byte at which Windows locks ``plan.json``: far behind its end, so that it can still be read."""


@dataclass(frozen=True)
class Facts:
    """Content of ``plan.json``: what identifies a sweep, and what it is made of."""

    software: dict[str, str]
    plugins: dict[str, str]
    """Name of each file -> its SHA-256; so are those of the arm in `model_files`."""
    model_files: dict[str, str]
    format: Count
    name: str
    cases: Count
    draws: Count
    rows: Count
    controllers: list[str]
    shard_size: Count
    """Number of (case, draw) pairs in a shard."""
    digest: str
    """SHA-256 of everything that decides results."""
    filename: str
    overrides: list[str]
    config: dict[str, Any]
    """The file as it is after the overrides."""
    arms: dict[str, str] = field(default_factory=dict)
    """Path of each arm's file as the sweep's file has it -> the file that keeps it here."""
    plan_sha256: str = ""
    """SHA-256 of all else here; empty in a plan that an older version wrote."""

    def is_as_written(self, content: bytes) -> bool:
        """Return whether no byte of the file that they were read from has changed since it was written.

        An older version's, without the digest, can only be asked whether its keys are those of a plan.

        Args:
            content: Of the file.
        """
        if not self.plan_sha256:
            return bool(json.loads(content).keys() <= vars(self).keys() - {PLAN_DIGEST})
        return content == json_bytes(vars(self)) and self.plan_sha256 == own_digest(vars(self), PLAN_DIGEST)


@dataclass(frozen=True)
class StoredSweep:
    """A sweep and the folder that it is stored in.

    The file of a shard is a line of text, ``torquebench-shard-1 PLAN SHARD SHA256``, followed by an NPZ file of its
    rows; PLAN is the plan's digest, and SHA256 that of everything after the line. Files are added, never changed.
    """

    folder: Path
    plan: Plan
    facts: Facts

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.plan.pairs // self.facts.shard_size)

    def rows_in(self, shard: int) -> int:
        """Return the number of rows of a shard."""
        return len(pairs_of(self.facts.shard_size, self.plan.pairs, shard)) * len(self.plan.controllers)

    @property
    def finished(self) -> bool:
        """Whether all results are there."""
        return (self.folder / MANIFEST).is_file()

    def shard_path(self, shard: int) -> Path:
        """Return the file of a shard."""
        return self.folder / SHARDS / f"{shard:06d}.shard"

    def write_shard(self, shard: int, table: Table) -> None:
        """Write a shard; it is on the disk when this returns."""
        buffer = io.BytesIO()
        np.savez(buffer, **table)  # type: ignore[arg-type]
        self.shard_path(shard).parent.mkdir(exist_ok=True)
        atomic_write(self.shard_path(shard), self._line(shard, buffer.getvalue()) + buffer.getvalue())

    def read_shard(self, shard: int) -> Table | None:
        """Return a shard's rows; None when it is missing, or is not what was written for this plan."""
        if not self.shard_path(shard).is_file():
            return None
        line, newline, content = self.shard_path(shard).read_bytes().partition(b"\n")
        if line + newline != self._line(shard, content):
            return None
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            return dict(stored)

    def _line(self, shard: int, content: bytes) -> bytes:
        return f"{MAGIC} {self.facts.digest} {shard} {hashlib.sha256(content).hexdigest()}\n".encode()


def create_sweep(directory: RunDirectory, plan: Plan, shard_size: int) -> StoredSweep:
    """Write a sweep's file and plan to a new folder.

    Args:
        directory: The folder.
        plan: The sweep.
        shard_size: Number of (case, draw) pairs in a shard.
    """
    facts = facts_of(plan, shard_size)
    for path, arm in plan.source.arms:
        directory.write(facts.arms[path], arm.text.encode())
    directory.write(CONFIG, plan.text)
    directory.write(PLAN, json_bytes(vars(facts)))
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
        content = read_stored(folder / PLAN)
        facts = from_json(Facts, content)
        text = read_stored(folder / CONFIG)
        kept = {path: read_stored(folder / file).decode() for path, file in facts.arms.items()}
    except (OSError, ValueError) as error:
        why = f"{PLAN} or {CONFIG} is missing or damaged"
        raise ConfigError([Problem(option, "", f"{folder} is no folder of a sweep: {why}")]) from error
    if facts.format > FORMAT:
        message = f"{folder}: was written by a newer torquebench (format {facts.format}): wanted that one"
        raise ConfigError([Problem(option, "", message)])
    if not facts.is_as_written(content):
        raise ConfigError([Problem(option, "", f"{folder / PLAN}: changed since it was written ({PLAN_DIGEST})")])
    missing = sorted(set(facts.plugins) - {path.name for path in plugins})
    if missing:
        message = f"the sweep uses laws of {', '.join(missing)}: wanted --plugin with each of these files"
        raise ConfigError([Problem(option, "", message)])
    arms = tuple((path, ArmFile(arm_name(path), content)) for path, content in sorted(kept.items()))
    source = Source(text, facts.filename, tuple(facts.overrides), plugins, arms=arms)
    stored = StoredSweep(folder, Plan(source), facts)
    refuse_changes(stored, stored.plan, option, but=SOFTWARE if to_read else ())
    return stored


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


def facts_of(plan: Plan, shard_size: int) -> Facts:
    """Return what identifies a sweep, and what it is made of.

    Args:
        plan: The sweep.
        shard_size: Number of (case, draw) pairs in a shard.
    """
    source, first = plan.source, plan.first
    made_of = {
        "software": decisive_versions(),
        "plugins": checksums(source.plugins),
        "model_files": model_checksums(first.plant.model) | {path: arm.digest for path, arm in plan.source.arms},
    }
    decides = made_of | {"first": plain(first), "sweep": plan.keys.plain(), "shard_size": shard_size}
    text = json.dumps(decides, sort_keys=True, separators=(",", ":"))
    facts = Facts(
        software=made_of["software"],
        plugins=made_of["plugins"],
        model_files=made_of["model_files"],
        format=FORMAT,
        name=first.name,
        cases=plan.cases,
        draws=plan.draws,
        rows=plan.rows,
        controllers=list(plan.controllers),
        shard_size=shard_size,
        digest=hashlib.sha256(text.encode()).hexdigest(),
        filename=source.filename,
        overrides=list(source.overrides),
        config=plan.raw,
        arms={path: kept_at(path, arm) for path, arm in plan.source.arms},
    )
    return replace(facts, plan_sha256=own_digest(vars(facts), PLAN_DIGEST))


def kept_at(path: str, arm: ArmFile) -> str:
    """Return the file of a sweep's folder that keeps an arm: where the sweep's file has it, if that is inside.

    Args:
        path: The arm's file as the sweep's file has it.
        arm: The arm.
    """
    parts = Path(path).parts
    inside = (
        is_path(path) and not Path(path).is_absolute() and ".." not in parts and parts[0] not in (SHARDS, TRAJECTORIES)
    )
    return path if inside else f"arms/{arm.name}-{arm.digest[:8]}.xml"


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
    now = facts_of(plan, stored.facts.shard_size)
    if now.digest == stored.facts.digest:
        return
    compared = [key for key in COMPARED if key not in but]
    old, new = (dict(flattened({key: getattr(facts, key) for key in compared})) for facts in (stored.facts, now))
    problems = []
    for key in old | new:
        before, after = (json.dumps(facts[key]) if key in facts else ABSENT for facts in (old, new))
        if before != after:
            text = f"was {before} when the sweep began, is {after} now"
            problems.append(Problem(option, key.removeprefix("config."), text))
    if but and not problems:
        return
    raise ConfigError(problems or [Problem(option, "", "the file no longer means what it did when the sweep began")])


def write_table(stored: StoredSweep) -> dict[str, dict[str, int]]:
    """Write the final table as NPZ and CSV, and return each controller's number of runs by outcome.

    Args:
        stored: The sweep, all of whose shards are complete.

    Raises:
        ResultError: a shard is missing or damaged.
    """
    table, start = empty_columns(stored.plan, stored.plan.rows), 0
    with replaced(stored.folder / TEXT) as file:
        lines = io.TextIOWrapper(file, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(table)
        for shard in range(stored.shards):
            part = stored.read_shard(shard)
            if part is None:
                raise ResultError(f"{stored.shard_path(shard)}: missing or damaged since it was written")
            writer.writerows(zip(*(part[name].tolist() for name in table), strict=True))
            end = start + len(part["index"])
            for name, column in table.items():
                column[start:end] = part[name]
            start = end
        lines.detach()
    with replaced(stored.folder / TABLE) as file:
        np.savez(file, **table)  # type: ignore[arg-type]
    ended = Counter(zip(table["controller"].tolist(), table["outcome"].tolist(), strict=True))
    return {
        name: {kind: ended[name, kind] for kind in OUTCOMES if ended[name, kind]} for name in stored.plan.controllers
    }


def read_column(stored: StoredSweep, name: str) -> NDArray[Any]:
    """Return one column of the final table; the others are not read."""
    with np.load(stored.folder / TABLE, allow_pickle=False) as table:
        column: NDArray[Any] = table[name]
    return column


def seal_sweep(stored: StoredSweep, facts: Mapping[str, Any], more: Sequence[str] = ()) -> None:
    """Write the manifest, by which the sweep counts as finished.

    Args:
        stored: The sweep, with all other files written.
        facts: What else the manifest is to hold.
        more: Names of further files.
    """
    folder = stored.folder
    kept = sorted(path for path in (folder / TRAJECTORIES).glob("*.npz"))
    files = [folder / name for name in (CONFIG, PLAN, TABLE, TEXT, *stored.facts.arms.values(), *more)] + kept
    plan = {key: getattr(stored.facts, key) for key in ("name", "digest", "rows", "software", "plugins", "model_files")}
    digests = {path.relative_to(folder).as_posix(): file_digest(path) for path in files}
    write_manifest(folder, plan | dict(facts) | {"machine": machine(), "files": digests})
    (folder / CLAIM).unlink(missing_ok=True)


def verify(stored: StoredSweep) -> None:
    """Verify that the manifest is this plan's, and every file what the manifest says.

    Raises:
        ResultError: it is not.
    """
    if check_run(stored.folder).get("digest") != stored.facts.digest:
        raise ResultError(f"{stored.folder}: its manifest is another sweep's")
