"""``torquebench bench``: speed against peers, measured by the folder ``benchmarks`` of a checkout."""

from __future__ import annotations

import argparse
import importlib.util
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.experiment.store import atomic_write, json_bytes
from torquebench.robot.library import data_root

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
    benchmarks = load_benchmarks()
    duration, rounds = QUICK if options.quick else FULL
    rounds = options.rounds or rounds
    with progress_bar(0, "case", "setting up (compiles on first use)") as bar:

        def start(total: int) -> None:
            bar.total = total

        def report(name: str) -> None:
            bar.set_description_str(name, refresh=False)
            bar.update(1)

        rows, left_out = benchmarks.run(duration, rounds, options.threads, start, report)
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


def load_benchmarks() -> Any:
    """Return the package ``benchmarks`` of the checkout.

    Raises:
        ConfigError: there is none, as where torquebench was installed from a wheel.
    """
    file = data_root() / "benchmarks" / "__init__.py"
    if "benchmarks" not in sys.modules:
        spec = importlib.util.spec_from_file_location("benchmarks", file, submodule_search_locations=[str(file.parent)])
        if not file.is_file() or spec is None or spec.loader is None:
            why = f"no folder {file.parent}: benchmarks come with the repository and the sdist, not with a wheel"
            raise ConfigError([Problem("bench", "", f"{why}; run it in a checkout")])
        sys.modules["benchmarks"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["benchmarks"])
    return sys.modules["benchmarks"]


def cells(row: Any) -> list[str]:
    """Return a row of the table."""
    ratio = "" if row.ratio is None else _short(row.ratio)
    return [row.name, str(row.threads), _short(row.value), row.unit, ratio, row.against]


def markdown(rows: list[Any]) -> str:
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
