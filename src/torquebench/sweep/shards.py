"""Shards on disk: one file each, written whole or not at all, and accepted only as the plan's own and unaltered."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

import numpy as np

from torquebench.experiment.store import atomic_write
from torquebench.sweep.columns import Table

FOLDER = "shards"
MAGIC = "torquebench-shard-1"


class Shards:
    """The shards of one sweep; files are added, never changed.

    A file is a line of text, ``torquebench-shard-1 PLAN SHARD SHA256``, followed by an NPZ file of the columns; PLAN is
    the plan's digest, and SHA256 that of everything after the line.

    Args:
        folder: The sweep's folder.
        digest: The plan's digest.
    """

    def __init__(self, folder: Path, digest: str) -> None:
        self._folder, self._digest = folder / FOLDER, digest

    def write(self, shard: int, table: Table) -> None:
        """Write a shard; it is on the disk when this returns.

        Args:
            shard: Its number.
            table: Its columns.
        """
        self._folder.mkdir(exist_ok=True)
        buffer = io.BytesIO()
        np.savez(buffer, **table)  # type: ignore[arg-type]
        content = buffer.getvalue()
        atomic_write(self.path(shard), self._line(shard, content) + content)

    def read(self, shard: int) -> Table | None:
        """Return a shard's table; None when it is not there, or is not what was written for this plan.

        Args:
            shard: Its number.
        """
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

    def sweep_up(self) -> None:
        """Remove what a killed process was about to write."""
        for folder in (self._folder, self._folder.parent):
            for torn in folder.glob(".*.tmp"):
                torn.unlink(missing_ok=True)

    def path(self, shard: int) -> Path:
        """Return the file of a shard."""
        return self._folder / f"{shard:06d}.shard"

    def _line(self, shard: int, content: bytes) -> bytes:
        return f"{MAGIC} {self._digest} {shard} {hashlib.sha256(content).hexdigest()}\n".encode()
