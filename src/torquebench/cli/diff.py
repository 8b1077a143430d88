"""``torquebench diff``: what changed from one stored run, sweep or arena to another, and whether that may be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import File, argument, option, plugins
from torquebench.cli.terminal import bad, complain, good, say, table, tell, warn
from torquebench.errors import ConfigError, Problem, ResultError

if TYPE_CHECKING:
    from torquebench.diffs import Change

MOST = 100
"""Rows of a table; of more, as an arena has, those are shown that differ by more than chance."""
SCALE = 15
"""Characters of the line on which a ratio stands, from a half to two."""


@command(example="torquebench diff runs/main runs/branch --fail-if 'rmse > 1.05'")
@argument("a", type=File(folders=True), metavar="A", help="what `run`, `sweep` or `arena` left before")
@argument("b", type=File(folders=True), metavar="B", help="what the same command leaves now")
@option(
    "--fail-if",
    "limits",
    multiple=True,
    metavar="METRIC>RATIO",
    help="what makes the exit status 1, for example 'rmse > 1.05'; may be given several times",
)
@option("--junit", type=File(".xml"), metavar="FILE", help="write what passes a limit as JUnit's XML, for a CI server")
@plugins
def diff(a: Path, b: Path, limits: Sequence[str], junit: Path | None, plugin: Sequence[Path]) -> int:
    """Say what changed from one run, sweep or arena to another.

    Ratios are of B to A, for each controller, in a sweep for each case, in an arena for each chain and level, with the
    95 % interval of the paired ratio over draws. A limit is passed when the whole interval is beyond it; then, and
    where with a limit named a run fails in B only or is missing there, the exit status is 1.
    """
    from torquebench.diffs import diff as compare
    from torquebench.diffs import shown
    from torquebench.experiment.store import atomic_write
    from torquebench.statistics import POWER, SMALL

    try:
        found = compare(a, b, limits, plugin)
    except ResultError as error:
        raise ConfigError([Problem("A, B", "", str(error))]) from error
    tell(a=a, b=b, **found.to_json())
    if junit is not None:
        atomic_write(junit, found.junit())
    for title, names in (("only in A", found.only_a), ("only in B", found.only_b)):
        for name in names:
            warn(f"torquebench: {name} is {title}")
    for sentence in found.remarks:
        warn(f"torquebench: {sentence}")
    for sentence in (*found.failed, *found.mended):
        say(sentence)
    tables = shown(found.changes, [limit.metric for limit in found.limits])
    say("\n\n".join(_text(key, changes) for key, changes in tables) or "no run completed in both A and B")
    if any(change.needed for change in found.changes):
        say(f"\nneeded: draws that show a change by the limit's ratio, or {SMALL:g}, with a probability of {POWER:.0%}")
    for sentence in found.broken:
        complain(f"torquebench: {sentence}")
    return 1 if found.broken else 0


def _text(key: str, changes: Sequence[Change]) -> str:
    """Return the changes of one metric: where each ratio stands between a half and two, and the numbers.

    Of more than `MOST` rows those are left out whose interval holds 1.
    """
    from torquebench.metrics import METRICS

    info, rows, every = METRICS[key], [], len(changes)
    if every > MOST:
        changes = [change for change in changes if change.ratio.below or change.ratio.above]
    for change in changes:
        r = change.ratio
        worse, better = (r.above, r.below) if info.better == "lower" else (r.below, r.above)
        tone = bad if worse else good if better else str
        spread = f"{r.low:.4g} to {r.high:.4g}" if r.low < r.high else ""
        values = [f"{x * info.scale:.4g}" for x in (change.a, change.b)]
        numbers = [tone(f"x{r.ratio:.4g}"), spread, str(r.pairs), f"{change.needed or ''}"]
        rows.append([change.controller, change.case, line(r.ratio), *values, *numbers])
    unit = f" [{info.shown_unit}]" if info.shown_unit not in ("", "1") else ""
    header = [
        "controller",
        "case",
        f"{info.title}, x1/2 to x2",
        f"A{unit}",
        f"B{unit}",
        "B/A",
        "95 %",
        "draws",
        "needed",
    ]
    kept = [i for i, title in enumerate(header) if title not in ("case", "needed") or any(row[i] for row in rows)]
    left, cases = f"{info.title}: {every - len(rows)} of {every} do not differ by more than chance", 1 in kept
    if not rows:
        return left
    cells = table([header[i] for i in kept], [[row[i] for i in kept] for row in rows], left=2 + cases, keys=1 + cases)
    return f"{cells}\n{left}" if every > MOST else cells


def line(ratio: float) -> str:
    """Return a line from a half to two with 1 in its middle and a disc where a ratio is."""
    from math import log2

    marks = ["·"] * SCALE
    marks[SCALE // 2] = "|"
    at = max(-1.0, min(1.0, log2(ratio))) if ratio > 0.0 else -1.0
    marks[round((at + 1.0) / 2.0 * (SCALE - 1))] = "●"
    return "".join(marks)
