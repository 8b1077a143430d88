"""``torquebench bench``: speed against peers, as ratios within one run."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path

from torquebench.bench.timing import Row
from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.experiment.store import atomic_write, json_bytes

QUICK = (4.0, 3)
FULL = (10.0, 15)
"""Length of a closed loop [s], and rounds."""


def bench(options: argparse.Namespace) -> int:
    """Measure and print the table; return 0.

    Args:
        options: Arguments of the command; see ``torquebench bench --help``.

    Raises:
        ConfigError: bad arguments.
    """
    _check(options)
    from torquebench.bench.loops import closed_loops
    from torquebench.bench.parts import parts
    from torquebench.bench.peers import peers
    from torquebench.bench.timing import measure

    duration, rounds = QUICK if options.quick else FULL
    rounds = options.rounds or rounds
    with progress_bar(0, "case", "setting up (compiles on first use)") as bar:
        cases = closed_loops(duration, options.threads) + parts()
        others, left_out = peers()
        cases += others
        bar.total = sum(min(case.most, rounds) + 1 for case in cases)

        def report(name: str) -> None:
            bar.set_description_str(name, refresh=False)
            bar.update(1)

        rows = measure(cases, rounds, report)
    tell(rows=[asdict(row) for row in rows], rounds=rounds, left_out=left_out)
    if options.markdown:
        say(markdown(rows), fold=False)
    else:
        say(table(["case", "threads", "median", "unit", "ratio", "against"], [cells(row) for row in rows]))
    say()
    say(f"ratio: median speed over median speed of the case named, in this run; {rounds} rounds, in turn")
    for reason in left_out:
        say(f"left out: {reason}")
    if isinstance(options.json, Path):
        atomic_write(options.json, json_bytes([asdict(row) for row in rows]))
        say(f"written: {options.json}")
    return 0


def cells(row: Row) -> list[str]:
    """Return a row of the table."""
    ratio = "" if row.ratio is None else _short(row.ratio)
    return [row.name, str(row.threads), _short(row.value), row.unit, ratio, row.against]


def markdown(rows: list[Row]) -> str:
    """Return the table as Markdown, with what each row is."""
    lines = ["| case | threads | speed | against | ratio | what |", "|---|---|---|---|---|---|"]
    for row in rows:
        ratio = "" if row.ratio is None else _short(row.ratio)
        lines.append(
            f"| {row.name} | {row.threads} | {_short(row.value)} {row.unit} | {row.against} | {ratio} | {row.note} |"
        )
    return "\n".join(lines)


def _short(value: float) -> str:
    """Three digits, without an exponent."""
    digits = max(0, 2 - math.floor(math.log10(value))) if value > 0 else 0
    return f"{value:,.{digits}f}" if value < 1000 else f"{float(f'{value:.3g}'):,.0f}"


def _check(options: argparse.Namespace) -> None:
    problems = []
    if options.rounds is not None and not 1 <= options.rounds <= 1000:
        problems.append(Problem("--rounds", "", f"got {options.rounds}, wanted 1 to 1000"))
    if not 1 <= options.threads <= 64:
        problems.append(Problem("--threads", "", f"got {options.threads}, wanted 1 to 64"))
    if isinstance(options.json, Path) and not options.json.parent.is_dir():
        problems.append(Problem("--json", "", f"{options.json}: no such folder"))
    if problems:
        raise ConfigError(problems)
