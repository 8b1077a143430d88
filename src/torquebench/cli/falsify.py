"""``torquebench falsify``: what breaks a law, and the least that does."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from torquebench.cli.app import command
from torquebench.cli.parameters import (
    Choice,
    Config,
    Wrong,
    allow_outside,
    argument,
    model,
    option,
    out_folder,
    plugins,
    settings,
    with_arm,
)
from torquebench.cli.parameters import workers as workers_option
from torquebench.cli.terminal import complain, following, progress_bar, say, table, tell

if TYPE_CHECKING:
    from torquebench.experiment.source import OptionChange
    from torquebench.falsification import Falsification

BOTH, ALL = "both", "all"
SCALE = 21
"""Characters of the line on which a variable's value stands in its range."""
FEW = 3
"""Numbers of a list that have a row each."""
BARS = "▁▂▃▄▅▆▇█"
LONGEST = 40
"""Numbers of a list that are drawn."""


class Until(click.ParamType[Any]):
    """Type of --until: a condition that breaks a claim, such as ``max_error > 5 mrad``."""

    name = "until"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> OptionChange:
        """Return the claim as a change of the config."""
        from torquebench.experiment.falsify_section import OPPOSITE, Claim, read_claim
        from torquebench.experiment.source import OptionChange

        found = read_claim(value, denied=True)
        if not isinstance(found, Claim):
            raise Wrong(**found)
        limit = value.partition(OPPOSITE[found.sign])[2].strip()
        return OptionChange(f"falsify.claim={found.metric} {found.sign} {limit}", "--until", value)


@command(example="torquebench falsify studies/falsify --until 'max_error > 20 mrad'")
@argument("config", type=Config(), help="experiment with a section `falsify`: a file, or a shipped one")
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@option(
    "--until",
    type=Until(),
    metavar="METRIC>LIMIT",
    help="end at the first run that does this, for example 'max_error > 5 mrad': the claim is that none does",
)
@option(
    "--method",
    type=Choice([BOTH, ALL, "cma", "random", "corners"]),
    default=BOTH,
    help="how to search: CMA-ES, evenly drawn points, these and corners in turn, or the first two (default) or all",
)
@workers_option(help="how many runs are made at once (default: one per core)")
@settings(help="change one key, for example falsify.evaluations=100")
@model
@allow_outside
@plugins
def falsify(
    config: Path,
    out: Path | None,
    until: OptionChange | None,
    method: str,
    workers: int | None,
    overrides: Sequence[str],
    model: Path | None,
    allow_outside: bool,
    plugin: Sequence[Path],
) -> int:
    """Search the worst that may happen to each law.

    What may change, and how far, stands in a file's section `falsify`. Of the worst run found every variable is then
    moved back as far as the claim stays broken: what is left is needed for it. Both are stored as configs to run again,
    worst.yaml and smallest.yaml.
    A broken claim, or a failed run, makes the exit status 1.
    """
    from torquebench.experiment.store import RunDirectory, claim_folder
    from torquebench.falsification import WORST, Falsification, space_of
    from torquebench.sweep.falsify import hunt
    from torquebench.sweep.search import COMPARED, METHODS, check_method

    sets = {BOTH: COMPARED, ALL: METHODS}
    methods = sets.get(method, tuple(own for own in METHODS if own == method))
    check_method(methods, "--method")
    changes = list(with_arm(overrides, model))
    if until is not None:
        changes.append(until)
    space = space_of(config, changes, allow_outside, plugin)
    folder = claim_folder(out, space.base.name)
    with progress_bar(0, "run", "starting (compiles on first use)") as bar:
        found = Falsification(space, hunt(space, methods, workers or os.cpu_count() or 1, following(bar)))
    with progress_bar(0, "figure", "writing") as bar:
        found.write(RunDirectory(folder), following(bar))
    tell(directory=folder, **found.to_json())
    report(found)
    say()
    say(f"results: {folder}; to run a case again, with its film:")
    first = folder / found.hunts[0].controller / WORST
    say(f"torquebench run {shlex.quote(str(first))} --set video={{}}", fold=False)
    if found.asked.claim is None:
        failed = [own.controller for own in found.hunts if own.controller in found.broken]
        for name in failed:
            complain(f"torquebench: controller '{name}': a run fails")
    else:
        for name in found.broken:
            complain(f"torquebench: controller '{name}': {found.asked.claim.text} is broken")
    return 1 if found.broken else 0


def report(found: Falsification) -> None:
    """Say what came out: a sentence and a row for each law, and where in its range each variable stands."""
    from statistics import median

    from torquebench.sweep.search import TITLES

    for own in found.hunts:
        say(f"{found.sentence(own)}.")
    used = [method for method in TITLES if any(key[0] == method for own in found.hunts for key in own.tried)]
    rows = []
    for own in found.hunts:
        worst = [found.worst_by(own, method) for method in used]
        rows.append(
            [
                own.controller,
                found.shown(own.nominal),
                *worst,
                "-" if own.smallest is None else found.shown(own.smallest),
            ]
        )
    say()
    say(table([found.info.title, "nominal", *(TITLES[method] for method in used), "smallest"], rows))
    for method, ratios in found.ratios.items() if found.asked.claim is None else ():
        ratio, other = median(ratios.values()), TITLES[method]
        say(f"the worst of CMA-ES is {ratio:.3g} times that of {other} with as many runs, median over the laws")
    for own in found.hunts:
        if own.smallest is None:
            continue
        variables, values = found.space.variables, found.space.values(own.smallest.point)
        shares, lines, count = [v.share(x) for v, x in zip(variables, values, strict=True)], [], 0
        for key, moved in found.moved(own).items():
            count += len(moved)
            every = [i for i, v in enumerate(variables) if v.of == key]
            for i in moved if len(every) <= FEW else moved[:1]:
                v, where = variables[i], scale(variables[i].nominal_share, shares[i])
                row = [v.key, f"{v.low:.4g}", where, f"{v.high:.4g}", f"{values[i]:.4g}", f"{v.nominal:.4g}", v.unit]
                if len(every) > FEW:
                    told = bars([shares[k] if k in moved else None for k in every])
                    row = [key, row[1], told, row[3], f"{len(moved)} of {len(every)}", "", v.unit]
                lines.append(row)
        say()
        say(table([own.controller, "low", "in its range", "high", "value", "nominal", "unit"], lines, left=1))
        left = f"{len(variables) - count} of {len(variables)} variables are not needed"
        say(f"○ nominal, ● needed; of a list {BARS[0]} low to {BARS[-1]} high, · not needed; {left}")


def scale(nominal: float, share: float) -> str:
    """Return a line with a ring where the nominal value is and a disc where the value is; both are 0 to 1."""
    marks = ["·"] * SCALE
    marks[round(min(max(nominal, 0.0), 1.0) * (SCALE - 1))] = "○"
    marks[round(share * (SCALE - 1))] = "●"
    return "".join(marks)


def bars(shares: Sequence[float | None]) -> str:
    """Return a bar for each number of a list, as high as it is in its range; a dot for None."""
    marks = ["·" if share is None else BARS[round(share * (len(BARS) - 1))] for share in shares]
    return "".join(marks[:LONGEST]) + ("…" if len(marks) > LONGEST else "")
