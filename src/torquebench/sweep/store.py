"""The sweep's folder: the file and the plan it was started with, and whether it may be continued with another."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean_path
from torquebench.experiment.dump import plain
from torquebench.experiment.store import MANIFEST, RunDirectory, checksums, json_bytes, model_checksums, versions
from torquebench.sweep.plan import Plan, Source, flattened

CONFIG = "sweep.yaml"
"""The sweep's file, as it was given."""
PLAN = "plan.json"
"""What was made of it; written when everything has been checked."""
TRAJECTORIES = "trajectories"
ABSENT = "(not given)"


class Stored(NamedTuple):
    """A sweep's folder as it was begun."""

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
        """What identifies the plan."""
        return str(self.facts["digest"])

    @property
    def finished(self) -> bool:
        """Whether all results are there."""
        return (self.folder / MANIFEST).is_file()


def begin(directory: RunDirectory, plan: Plan, shard_size: int) -> Stored:
    """Write down in a new folder what is about to be run.

    Args:
        directory: The folder.
        plan: The sweep.
        shard_size: Number of (case, draw) pairs in a shard.
    """
    facts = facts_of(plan, shard_size)
    directory.write(CONFIG, plan.source.text)
    directory.write(PLAN, json_bytes(facts))
    return Stored(directory.folder, plan, facts)


@contextlib.contextmanager
def alone(stored: Stored) -> Iterator[None]:
    """Keep other processes from running the same sweep meanwhile; the end of this one, however it ends, lets them.

    Raises:
        ResultError: another process is running it.
    """
    with (stored.folder / PLAN).open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ResultError(f"{stored.folder}: another process is running this sweep") from error
        yield


def facts_of(plan: Plan, shard_size: int) -> dict[str, Any]:
    """Return what identifies a sweep, and what it is made of."""
    source = plan.source
    made_of = {
        "software": decisive_versions(),
        "plugins": checksums(source.plugins),
        "model_files": model_checksums(plan.first.plant.model),
    }
    decides = made_of | {"first": plain(plan.first), "sweep": plan.keys.plain(), "shard_size": shard_size}
    text = json.dumps(decides, sort_keys=True, separators=(",", ":"))
    return made_of | {
        "format": 1,
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
    return {name: version for name, version in versions().items() if name in _DECISIVE}


def opened(folder: Path, plugins: tuple[Path, ...], option: str) -> Stored:
    """Return the sweep that a folder was begun with; its laws are registered already.

    Args:
        folder: The sweep's folder.
        plugins: The files of its own laws, where they are now.
        option: The command's option that names it, for messages.

    Raises:
        ConfigError: it is no sweep's folder, or what the sweep is made of has changed.
    """
    if not folder.is_dir():
        raise ConfigError([Problem(option, "", f"{folder}: there is no such folder{did_you_mean_path(folder)}")])
    try:
        facts: dict[str, Any] = json.loads((folder / PLAN).read_text(encoding="utf-8"))
        text = (folder / CONFIG).read_bytes()
        source = Source(text, str(facts["filename"]), tuple(facts["overrides"]), plugins)
        missing = sorted(set(facts["plugins"]) - {path.name for path in plugins})
    except (OSError, ValueError, KeyError, TypeError) as error:
        why = "there is no such folder" if not folder.exists() else f"{PLAN} or {CONFIG} is missing or damaged"
        raise ConfigError([Problem(option, "", f"{folder} is no folder of a sweep: {why}")]) from error
    if missing:
        message = f"the sweep uses laws of {', '.join(missing)}: wanted --plugin with each of these files"
        raise ConfigError([Problem(option, "", message)])
    stored = Stored(folder, Plan(source), facts)
    refuse_changes(stored, stored.plan, option)
    return stored


def refuse_changes(stored: Stored, plan: Plan, option: str) -> None:
    """Refuse to go on with another sweep than a folder was begun with.

    Args:
        stored: The folder.
        plan: The sweep as it is now.
        option: The command's option that names the folder, for messages.

    Raises:
        ConfigError: something that decides results has changed; each such key is named with its old and new value.
    """
    now = facts_of(plan, stored.shard_size)
    if now["digest"] == stored.digest:
        return
    old, new = (dict(flattened({k: facts[k] for k in _COMPARED})) for facts in (stored.facts, now))
    problems = []
    for key in [*old, *(key for key in new if key not in old)]:
        before, after = old.get(key, ABSENT), new.get(key, ABSENT)
        if before != after:
            name = key.removeprefix("config.")
            problems.append(Problem(option, name, f"was {_text(before)} when the sweep began, is {_text(after)} now"))
    raise ConfigError(
        problems or [Problem(option, "", "what the file means is not what it meant when the sweep began")]
    )


_DECISIVE = ("torquebench", "python", "mujoco", "numpy", "numba")
"""Software on which numbers depend."""
_COMPARED = ("config", "software", "plugins", "model_files")


def _text(value: Any) -> str:
    return value if value == ABSENT else json.dumps(value)
