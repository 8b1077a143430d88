"""``torquebench compare``: a table of where two models or plants differ."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict

from torquebench import comparison
from torquebench.cli.colour import bad, good
from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.comparison import LOOPS, Row, Side, parse_side
from torquebench.errors import ConfigError, Problem


def compare(options: argparse.Namespace) -> int:
    """Compare two sides and return 0 when every compared quantity agrees, else 1.

    Args:
        options: Arguments of the command; see ``torquebench compare --help``.

    Raises:
        ConfigError: bad arguments.
    """
    _check(options)
    with progress_bar(LOOPS + 1 if options.rollout > 0 else 1, "comparison", "starting (compiles on first use)") as bar:
        a, b = _sides(options)
        n = a.dynamics.n
        if b.dynamics.n != n:
            raise ConfigError([Problem("B", b.label, f"has {b.dynamics.n} joints, wanted {n} as in {a.label}")])
        if any(j > n for j in options.frozen_joints):
            raise ConfigError(
                [Problem("--frozen-joints", "", f"{max(options.frozen_joints)} is beyond the {n} joints")]
            )

        def report(loop: str) -> None:
            bar.set_description_str(loop, refresh=False)
            bar.update(1)

        rows = comparison.compare(
            a,
            b,
            states=options.states,
            seed=options.seed,
            tolerance=options.tolerance,
            frozen=[j - 1 for j in options.frozen_joints],
            rollout=options.rollout,
            progress=report,
        )
    agree = all(row.agrees for row in rows)
    tell(
        a=a.label,
        b=b.label,
        states=options.states,
        seed=options.seed,
        agree=agree,
        rows=[asdict(row) | {"agrees": row.agrees} for row in rows],
    )
    held = ", ".join(str(j) for j in options.frozen_joints)
    say(
        f"A = {a.label}\nB = {b.label}\n{options.states} random states (seed {options.seed})"
        + (f", joints {held} held at zero" if held else " of all joints")
        + "\n"
    )
    say(table(["term", "max |A-B|", "unit", "|A-B|/|A|", "element", "limit", "agrees"], [_cells(r) for r in rows]))
    say(f"\n{'agree' if agree else 'DIFFER'}: {sum(r.agrees for r in rows)} of {len(rows)} within their limits")
    return 0 if agree else 1


def _sides(options: argparse.Namespace) -> tuple[Side, Side]:
    sides: list[Side] = []
    problems: list[Problem] = []
    for text, argument in ((options.a, "A"), (options.b, "B")):
        try:
            sides.append(parse_side(text, argument))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return sides[0], sides[1]


def _check(options: argparse.Namespace) -> None:
    problems = []
    if not 1 <= options.states <= 1_000_000:
        problems.append(Problem("--states", "", f"got {options.states}, wanted 1 to 1000000"))
    if options.seed < 0:
        problems.append(Problem("--seed", "", f"got {options.seed}, wanted zero or more"))
    if not (math.isfinite(options.tolerance) and options.tolerance >= 0):
        problems.append(Problem("--tolerance", "", f"got {options.tolerance}, wanted a finite number, zero or more"))
    steps = options.rollout * 1000
    if not 0 <= options.rollout <= 1000 or abs(steps - round(steps)) > 1e-6 or 0 < steps < 1:
        problems.append(Problem("--rollout", "", f"got {options.rollout}, wanted 0 to 1000 s in whole milliseconds"))
    if any(j < 1 for j in options.frozen_joints):
        problems.append(Problem("--frozen-joints", "", "joints are counted from 1"))
    if problems:
        raise ConfigError(problems)


def _cells(row: Row) -> list[str]:
    limit = f"{row.limit:.0e} {'rad' if row.measure == 'absolute' else 'rel.'}"
    gaps = [f"{row.absolute:.2e}", row.unit, f"{row.relative:.2e}", row.where]
    return [row.term, *gaps, limit, good("yes") if row.agrees else bad("NO")]
