"""``torquebench compare``: a table of where two models or plants differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from torquebench.cli.app import command
from torquebench.cli.parameters import File, Number, Wrong, argument, option
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem

if TYPE_CHECKING:
    from torquebench.comparison import Row

SIDES = ("mujoco:puma560", "mujoco:two-link", "analytic:two-link", "analytic:puma560")
"""Sides that completion offers, beside files."""


class SideName(File):
    """Name of a model or plant, or a file."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the text."""
        return str(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        """Return the names and files that begin as typed."""
        from click.shell_completion import CompletionItem

        forms = ("corrected", "corrected:fitted", "corrected:printed", "exact", "printed", "printed:fitted")
        sides = [*SIDES, *(f"analytic:puma560:{form}" for form in forms)]
        named = [CompletionItem(side) for side in sides if side.startswith(incomplete)]
        return named + super().shell_complete(ctx, param, incomplete)


class Joints(click.ParamType[list[int]]):
    """Numbers of joints separated by commas."""

    name = "joints"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[int]:
        """Return the numbers."""
        try:
            joints = [int(word) for word in str(value).split(",")] if value else []
        except ValueError:
            raise Wrong(got=f"'{value}'", wanted="joint numbers separated by commas") from None
        if any(joint < 1 for joint in joints):
            raise Wrong(text="joints are counted from 1")
        return joints


class Milliseconds(Number):
    """A time in whole milliseconds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the time [s]."""
        seconds = super().convert(value, param, ctx)
        steps = 1000 * seconds
        if abs(steps - round(steps)) > 1e-6 or 0 < steps < 1:
            raise Wrong(got=str(value), wanted=f"0 to {self.high:g} s in whole milliseconds")
        return seconds


@command(example="torquebench compare mujoco:puma560 analytic:puma560 --rollout 5")
@argument(
    "a",
    type=SideName(".xml", ".urdf"),
    help="a model or plant: mujoco:MODEL, analytic:MODEL[:STRUCTURE[:CONSTANTS]], FILE.xml, FILE.urdf",
)
@argument("b", type=SideName(".xml", ".urdf"), help="the other one")
@option("--states", type=Number(int, 1, 1_000_000), default=1000, help="random states (default 1000)")
@option("--seed", type=Number(int, 0), default=0, help="seed of the states (default 0)")
@option(
    "--frozen-joints",
    type=Joints(),
    default="",
    metavar="J,J",
    help="joints held at zero position and speed, counted from 1, for example 4,5,6",
)
@option(
    "--tolerance",
    type=Number(float, 0),
    default=1e-12,
    help="relative difference that still counts as agreement (default 1e-12)",
)
@option(
    "--rollout",
    type=Milliseconds(float, 0, 1000),
    default=0.0,
    metavar="SECONDS",
    help="also compare closed loops of this length on both plants (default: none)",
)
@option(
    "--motion",
    type=File(".csv"),
    default=None,
    metavar="FILE.csv",
    help="states of a motion instead of random ones: columns t, q1.., qd1.. and maybe qdd1..",
)
def compare(
    a: str,
    b: str,
    states: int,
    seed: int,
    frozen_joints: list[int],
    tolerance: float,
    rollout: float,
    motion: str | None,
) -> int:
    """Show where two models or plants differ, and in which term.

    Of FILE.xml alone all counts that it has, springs, gears and integrator too; mujoco:FILE.xml is what the testbed
    takes of it. The last line can be pasted into an issue. A file that needs flags of import is compared by import,
    which proves the arm that it writes against the file.

    The exit status is 1 when a compared quantity differs, else 0: also where closed loops amplify round-off, so that
    they say nothing, and single steps from equal states agree.
    """
    import torquebench
    from torquebench import comparison

    with progress_bar(comparison.LOOPS + 1 if rollout > 0 else 1, "comparison", "starting") as bar:
        first, second = comparison.parse_sides(a, b, ("A", "B"))
        n = first.dynamics.n
        if second.dynamics.n != n:
            raise ConfigError(
                [Problem("B", second.label, f"has {second.dynamics.n} joints", wanted=f"{n} as in {first.label}")]
            )
        if any(j > n for j in frozen_joints):
            raise ConfigError([Problem("--frozen-joints", "", f"{max(frozen_joints)} is beyond the {n} joints")])

        def report(loop: str) -> None:
            bar.describe(loop)
            bar.update(1)

        given = None if motion is None else comparison.read_motion(str(motion), n, "--motion")
        found = comparison.compare(
            first,
            second,
            states=states,
            seed=seed,
            tolerance=tolerance,
            frozen=[j - 1 for j in frozen_joints],
            rollout=rollout,
            motion=given,
            progress=report,
        )
    rows, named, agree = found.rows, found.named, found.agree
    tell(
        a=first.label,
        b=second.label,
        states=states,
        seed=seed,
        agree=agree,
        terms=[asdict(term) for term in named.terms],
        left=named.left,
        sentence=found.sentence,
        rows=[row.to_json() for row in rows],
    )
    held = ", ".join(str(j) for j in frozen_joints)
    say(
        f"A = {first.label}\nB = {second.label}\n"
        + (f"{states} random states (seed {seed})" if given is None else f"{len(given.t)} states of {motion}")
        + (f", joints {held} held at zero" if held else " of all joints")
        + "\n"
    )
    say(scale(rows))
    say()
    loops = [row for row in rows if row.own is not None]
    header = ["term", "max |A-B|", "unit", "|A-B|/|A|", "element", "limit", "agrees"]
    say(table(header, [_cells(row) for row in rows if row.own is None]))
    if loops:
        header = ["closed loop", "A and B apart [rad]", "joint", "limit [rad]", "A and itself [rad]", "growth [1/s]"]
        say("\n" + table([*header, "agrees"], [_loop(row) for row in loops]))
    say()
    same = all(row.agrees for row in rows if row.term.startswith("one step"))
    for row in rows:
        if row.verdict == "undecided":
            say(
                f"{row.term}: undecided, as this loop amplifies round-off: started {comparison.ULP:.1e} rad beside, A "
                f"comes apart from itself by {row.own:.1e} rad. That A and B do says nothing about them"
                + ("; from equal states they take the same steps, as the rows of one step show." if same else ".")
            )
    counted = [row for row in rows if row.verdict != "undecided"]
    idle = f"; {len(rows) - len(counted)} undecided" * (len(counted) < len(rows))
    idle += "; what differs is in none of these rows" * (not agree and all(row.agrees for row in rows))
    within = f"{sum(r.agrees for r in counted)} of {len(counted)} within their limits{idle}"
    say(f"{'agree' if agree else 'DIFFER'}: {within}")
    if agree:
        return 0
    say("\nWhat B has beside A:" if named.terms else "")
    for term in named.terms:
        say(f"  {term}")
    if named.terms:
        say(f"leaves {named.left:.1e} of the difference in torque\n")
    held = f" --frozen-joints {','.join(map(str, frozen_joints))}" * bool(frozen_joints)
    drawn = f"--states {states} --seed {seed}" if given is None else f"--motion {motion}"
    say(f"`torquebench compare {a} {b} {drawn}{held}` (torquebench {torquebench.__version__}): {found.sentence}")
    return 1


LEFT, RIGHT, EACH = -18, 2, 2
"""Powers of ten at the ends of the scale, and characters for each."""
MARKS = {"agrees": "●", "undecided": "◐", "differs": "○"}
WORDS = {"agrees": "yes", "undecided": "undecided", "differs": "NO"}


def scale(rows: Sequence[Row]) -> str:
    """Return a picture: how large each difference is, on a logarithmic scale with the limits."""
    names = max(len(row.term) for row in rows)
    ticks = "".join(f"{10.0**power:<{6 * EACH}.0e}" for power in range(LEFT, RIGHT + 1, 6))
    lines = [f"{'':{names}}  {ticks}".rstrip()]
    for row in rows:
        value = getattr(row, row.measure)
        line = ["·"] * (EACH * (RIGHT - LEFT) + 1)
        line[_place(row.limit)] = "|"
        line[_place(value)] = MARKS[row.verdict]
        lines.append(f"{row.term:{names}}  {''.join(line)}")
    lines += ["", "● agrees  ◐ undecided  ○ differs  | limit; |A-B| over |A|, in rad for closed loops and positions"]
    return "\n".join(lines)


def _place(value: float) -> int:
    """Return where a value stands on the scale; what is beyond an end, or no number, at that end."""
    if not value < 10.0**RIGHT:
        return EACH * (RIGHT - LEFT)
    return max(0, round(EACH * (math.log10(max(value, 10.0**LEFT)) - LEFT)))


def _cells(row: Row) -> list[object]:
    limit = f"{row.limit:.0e} {'rad' if row.measure == 'absolute' else 'rel.'}"
    gaps = [f"{row.absolute:.2e}", row.unit, f"{row.relative:.2e}", row.where]
    return [row.term, *gaps, limit, _word(row)]


def _loop(row: Row) -> list[object]:
    term = row.term.removeprefix("closed loop, ")
    apart = [f"{row.absolute:.2e}", row.where, f"{row.limit:.0e}", f"{row.own:.2e}", f"{row.growth:.1f}"]
    return [term, *apart, _word(row)]


def _word(row: Row) -> object:
    word = WORDS[row.verdict]
    return good(word) if row.verdict == "agrees" else bad(word) if row.verdict == "differs" else word
