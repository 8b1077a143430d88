"""``torquebench bench``: speed against peers, as ratios within one run."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from torquebench.cli.app import command
from torquebench.cli.parameters import Number, option
from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.shipped import from_checkout

QUICK = (4.0, 3)
FULL = (10.0, 15)
"""Length of a closed loop [s], and rounds."""


@command(example="torquebench bench --quick --json")
@option("--markdown", is_flag=True, help="print the table as Markdown, with what each row is")
@option("--quick", is_flag=True, help="short runs, few rounds")
@option("--rounds", type=Number(int, 1, 1000), help="how often each case is timed (default 15, with --quick 3)")
@option("--threads", type=Number(int, 1, 64), default=2, help="threads of the largest case (default 2)")
def bench(markdown: bool, quick: bool, rounds: int | None, threads: int) -> int:
    """Measure speed against peers, as ratios within one run.

    The closed loop, MuJoCo's open loop and other ways to write the same are timed in turn, many times.
    """
    benchmarks: Any = from_checkout("benchmarks")
    duration, usual = QUICK if quick else FULL
    rounds = rounds or usual
    with progress_bar(0, "case", "setting up (compiles on first use)") as bar:

        def start(total: int) -> None:
            bar.total = total

        def report(name: str) -> None:
            bar.describe(name)
            bar.update(1)

        rows, left_out = benchmarks.run(duration, rounds, threads, start, report)
    tell(rows=[asdict(row) for row in rows], rounds=rounds, left_out=left_out)
    if markdown:
        say(as_markdown(rows), fold=False)
    else:
        say(table(["case", "threads", "median", "unit", "ratio", "against"], [cells(row) for row in rows]))
    say()
    say(f"ratio: median speed over median speed of the case named, in this run; {rounds} rounds, in turn")
    for reason in left_out:
        say(f"left out: {reason}")
    return 0


def cells(row: Any) -> list[str]:
    """Return a row of the table."""
    ratio = "" if row.ratio is None else _short(row.ratio)
    return [row.name, str(row.threads), _short(row.value), row.unit, ratio, row.against]


def as_markdown(rows: list[Any]) -> str:
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
