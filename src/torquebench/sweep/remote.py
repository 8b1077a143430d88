"""A worker on another machine: whether its numbers would be the client's to the last bit, and its shards."""

from __future__ import annotations

import hashlib
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import torquebench
from torquebench.errors import ConfigError, ModelError, TorquebenchError
from torquebench.experiment.store import model_checksums
from torquebench.laws.plugin import load_plugin
from torquebench.robot.library import model_names
from torquebench.sweep.columns import Table
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.store import decisive_versions
from torquebench.sweep.work import Task, Worker, run_shard

ABSENT, MODEL = "absent", "model "


class Needs(NamedTuple):
    """What a worker must have, and be, so that its rows are those that the client would have computed."""

    source: Source
    plugins: tuple[tuple[str, bytes], ...]
    """Name and content of each file of the user's laws."""
    made_of: Mapping[str, str]
    """What the client computes with; see `made_of`."""
    sample: str
    """Digest of the first rows as the client computes them."""

    @property
    def models(self) -> list[str]:
        """Names of the arms."""
        return [name.removeprefix(MODEL) for name in self.made_of if name.startswith(MODEL)]


class Rows(NamedTuple):
    """What comes back from a worker."""

    table: Table
    trajectories: Mapping[str, bytes]
    """Content of each trajectory's file by its name; empty when none is kept."""
    refusal: str = ""
    """Why the worker takes no part; then there are no rows."""


def needs_of(source: Source) -> Needs:
    """Return what the workers of a sweep need.

    Args:
        source: The sweep; its laws are registered here.
    """
    plan = Plan(source)
    words = {str(value.word) for axis in plan.keys.axes for value in axis.values} | {str(plan.first.plant.model)}
    plugins = tuple((path.name, path.read_bytes()) for path in source.plugins)
    return Needs(source, plugins, made_of(sorted(words.intersection(model_names()))), sample(plan))


def made_of(models: list[str]) -> dict[str, str]:
    """Return the versions that decide numbers, and digests of this package's source and of the arms' files.

    Args:
        models: Names of the arms.
    """
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
"""As it was when this process read it: a worker may be older than what is on its disk by now."""


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Return how a worker is made of other things than the client, or nothing.

    Args:
        there: What the worker is made of.
        here: What the client is made of.
    """
    wrong = [
        f"{name} {there.get(name, ABSENT)} instead of {want}" for name, want in here.items() if there.get(name) != want
    ]
    return f"has {', '.join(wrong)}: its rows would not be the client's" if wrong else ""


def sample(plan: Plan) -> str:
    """Return a digest of the first rows of a sweep, computed here: other processors may have other last bits."""
    digest = hashlib.sha256()
    for name, column in Worker(plan).table(Task(plan.source, 1), 0).items():
        digest.update(name.encode() + b"\0" + column.tobytes())
    return digest.hexdigest()[:16]


_lock = threading.Lock()
_known: dict[str, str] = {}
"""What `refusal` has found, by digest of what was needed."""
_loaded: dict[str, bytes] = {}
"""Laws of the user in this process: content by file name; laws cannot be registered anew."""


def refusal(needs: Needs, folder: Path) -> str:
    """Return why this process cannot take part in a sweep, or nothing; laws of the user are registered.

    Args:
        needs: What is needed.
        folder: Where files of laws may be put; they must last as long as the process.
    """
    key = hashlib.sha256(repr(needs).encode()).hexdigest()
    with _lock:  # threads of one process ask at the same time
        if key not in _known:
            _known[key] = _refusal(needs, folder)
        return _known[key]


def _refusal(needs: Needs, folder: Path) -> str:
    if text := difference(made_of(needs.models), needs.made_of):
        return text
    try:
        for name, content in needs.plugins:
            if name not in _loaded:
                path = folder / "torquebench-laws" / name
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


def run(needs: Needs, shard_size: int, with_trajectories: bool, shard: int) -> Rows:
    """Run a shard in a process that nothing is wrong with.

    Args:
        needs: The sweep.
        shard_size: Number of (case, draw) pairs in a shard.
        with_trajectories: Whether the trajectories come back, too.
        shard: Number of the shard.
    """
    if not with_trajectories:
        return Rows(run_shard(Task(needs.source, shard_size), shard), {})
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        table = run_shard(Task(needs.source, shard_size, Path(folder)), shard)
        return Rows(table, {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())})
