"""``torquebench trust``: every promise, attacked here and now; the table of `docs/trust.md`."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import torquebench
from torquebench.cli.app import command
from torquebench.cli.parameters import Choice, Number, option, suggest
from torquebench.cli.terminal import bad, following, good, progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.shipped import from_checkout


@command(example="torquebench trust --only configs --only arms")
@option("--size", type=Choice(["tiny", "ci", "nightly", "release"]), default="ci", help="how many tries (default ci)")
@option("--only", multiple=True, metavar="ROW", help="this row alone; may be given several times")
@option("--seed", type=Number(int, 0, 2**32), default=1, help="of every random choice (default 1)")
@option("--page", type=Path, metavar="FILE", help="write the table as Markdown too")
def trust(size: str, only: tuple[str, ...], seed: int, page: Path | None) -> int:
    """Attack what torquebench promises, and count what gave way.

    Each row is a promise: hostile configs and arms, laws with faults, kills and signals, damaged files, equal bytes,
    texts in pages, odd environments, numbers against closed forms and other programs. The size tiny takes a minute on
    two cores, ci some, nightly an hour, release many. The exit status is 1 if any try was wrong. Needs a checkout.
    """
    attacks: Any = from_checkout("tests/trust")
    if unknown := [name for name in only if name not in attacks.ROWS]:
        raise ConfigError([Problem("--only", got=f"'{x}'", **suggest(x, list(attacks.ROWS))) for x in unknown])
    with progress_bar(0, "attempt", "starting") as bar:
        rows = attacks.run(size, only, seed, following(bar))
    wrong = sum(row["wrong"] for row in rows)
    tell(rows=rows, size=size, seed=seed)
    for row in rows:
        for finding in row["findings"]:
            say(f"{row['name']}: {finding}")
    say(table(["", "promise", "tried", "wrong"], [cells(row) for row in rows], left=2))
    if page is not None:
        page.write_text(as_markdown(rows, size, seed), encoding="utf-8")
    return 1 if wrong else 0


def cells(row: dict[str, Any]) -> list[Any]:
    """Return a row of the terminal's table."""
    count = "left out" if row["left_out"] else f"{row['tried']:,}" if row["tried"] else "none in this size"
    return [row["name"], row["left_out"] or row["promise"], count, (bad if row["wrong"] else good)(_wrong(row))]


def _wrong(row: dict[str, Any]) -> str:
    """Return how many tries were wrong; of none that is no result, and no 0."""
    return f"{row['wrong']:,}" if row["tried"] else "-"


def as_markdown(rows: list[dict[str, Any]], size: str, seed: int) -> str:
    """Return the page: what is promised, how it was attacked, how often, what gave way, where and when."""
    from torquebench.experiment.store import machine

    here = machine()
    lines = [
        "# What is promised, and how often it was attacked",
        "",
        f"Written by `torquebench trust --size {size} --seed {seed} --page docs/trust.md` on "
        f"{datetime.date.today().isoformat()}: torquebench {torquebench.__version__}, {here['system']}, "
        f"{here['processor']}, {here['libc']}. Every try is drawn from the seed; a try counts as wrong if the promise "
        "did not hold, or if the attack could not tell. The sizes nightly and release try up to a hundred times as "
        "often. Tolerances, limits and what a row leaves out are in its source, in `tests/trust`.",
        "",
        "| | promise | how it is attacked | tried | wrong |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        tried = row["left_out"] or (f"{row['tried']:,}" if row["tried"] else "none in this size")
        lines.append(f"| `{row['name']}` | {row['promise']} | {row['how']} | {tried} | {_wrong(row)} |")
    found = [f"* `{row['name']}`: {finding}" for row in rows for finding in row["findings"]]
    return "\n".join([*lines, *(["", "## What gave way", "", *found] if found else []), ""])
