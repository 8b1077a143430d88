"""Attacks on what torquebench promises, a row a promise; ``torquebench trust`` loads this folder from the checkout."""

from __future__ import annotations

import random
import resource
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from trust.rows import ROWS, Counted, Row, Unavailable
from trust.workshop import Workshop

# isort: off
# the order of the table
from trust import inputs, laws, stored, processes, web, environments, same_bytes, numbers, engines

# isort: on

__all__ = ["ROWS", "Counted", "attack", "engines", "environments", "inputs", "laws", "numbers", "processes", "run"]
__all__ += ["same_bytes", "stored", "web"]

MOST_FINDINGS = 5
"""Sentences kept of a row: the count tells the rest."""


def run(size: str, only: Sequence[str], seed: int, tell: Callable[[str, int, int], None]) -> list[dict[str, Any]]:
    """Attack every promise and return the rows of the table, as values that JSON can hold.

    Args:
        size: ``tiny``, ``ci``, ``nightly`` or ``release``: how many tries of each row.
        only: Names of the rows to run; empty for all.
        seed: Of every random choice; each row has its own sequence.
        tell: Told the row's name, and how many tries of how many are done in all.
    """
    rows = [row for row in ROWS.values() if row.name in only or not only]
    whole, begun = sum(row.sizes[size] for row in rows), 0
    table = []
    with tempfile.TemporaryDirectory(prefix="trust-") as folder:
        shop = Workshop(Path(folder))
        for row in rows:
            shop.random = random.Random(f"{seed} {row.name}")
            done = attack(row, shop, row.sizes[size], lambda k, row=row, begun=begun: tell(row.name, begun + k, whole))  # type: ignore[misc]
            table.append(asdict(done))
            begun += row.sizes[size]
    return table


def attack(row: Row, shop: Workshop, tries: int, tell: Callable[[int], None]) -> Counted:
    """Try to break one promise.

    A try that ends in an exception counts as wrong: an attack that cannot tell has not shown anything.

    Args:
        row: The promise.
        shop: What attacks share.
        tries: How many are wanted.
        tell: Told how many are done.
    """
    before, findings, wrong, done, left_out = cpu(), list[str](), 0, 0, ""
    tell(0)
    try:
        for found in row.attack(shop, tries):
            done += 1
            wrong += bool(found)
            if found and len(findings) < MOST_FINDINGS:
                findings.append(found)
            tell(done)
    except Unavailable as error:
        left_out = str(error)
    except Exception as error:  # noqa: BLE001  whatever an attack raises, the other rows are still to be run
        wrong, done = wrong + 1, done + 1
        findings = [*findings[: MOST_FINDINGS - 1], f"the attack ended: {type(error).__name__}: {error}"]
    return Counted(row.name, row.promise, row.how, done, wrong, findings, round(cpu() - before, 1), left_out)


def cpu() -> float:
    """Return the CPU time of this process and of those it has started [s]."""
    own, others = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime
