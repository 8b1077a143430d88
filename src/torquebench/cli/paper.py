"""``torquebench paper``: the study of the paper's claims, which is part of the source and not of the package."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torquebench.cli.app import command
from torquebench.cli.parameters import option, out_folder, refuse
from torquebench.cli.parameters import workers as workers_option
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.shipped import data_root

DRAWS = {"quick": 4, "full": 30}
"""Draws behind each interval, by size of the study."""
TONES = {"holds": good, "fails": bad}


@command(example="torquebench paper --quick")
@out_folder(help="folder for the results, new or empty (default: runs/paper-UTC)")
@option("--quick", is_flag=True, help="few draws: for a look, and for continuous integration")
@workers_option(help="threads (default: one per core)")
def paper(out: Path | None, quick: bool, workers: int | None) -> int:
    """Run the paper's Figs 9 to 11 and judge each of its claims.

    Everything that the claims rest on is run, on both plants. The study is not in the package: it needs a checkout.
    """
    from torquebench.experiment.store import RunDirectory, claim_folder

    study, report = load_study("study"), load_study("report")
    draws = DRAWS["quick" if quick else "full"]
    directory = RunDirectory(claim_folder(out, "paper"))
    with progress_bar(study.count_runs(draws), "run", "starting (compiles on first use)") as bar:

        def progress(what: str, runs: int = 0) -> None:
            bar.describe(what)
            bar.update(runs)

        found = study.run_study(draws, workers or os.cpu_count() or 1, progress)
        claims = report.write_study(found, directory, draws, progress)
    facts, apart = [claim.to_json() for claim in claims], report.agreement_facts(found)
    tell(directory=directory.folder, draws=draws, claims=facts, plants_apart=apart)
    say(claims_table(claims))
    say()
    say(f"two plants: {report.agreement_text(found.apart)}")
    say(report.lost_text(found.runs))
    say(f"results: {directory.folder}")
    return 0


def load_study(module: str) -> Any:
    """Import a module of the study, which is in the folder ``scripts/paper`` of the source.

    Raises:
        ConfigError: there is no such folder, as in an installed package.
    """
    scripts = data_root() / "scripts"
    if not (scripts / "paper" / "study.py").is_file():
        message = f"no folder {scripts / 'paper'}: the study comes with the repository, not with a wheel"
        refuse([("paper", f"{message}; run it in a checkout")])
    if str(scripts) not in sys.path:
        sys.path.insert(0, str(scripts))
    return importlib.import_module(f"paper.{module}")


def claims_table(claims: Sequence[Any]) -> str:
    """Return the table of claims for the terminal, conditions under it."""
    rows = [
        [claim.claim, claim.where, TONES.get(claim.verdict, str)(claim.verdict), claim.figure_text] for claim in claims
    ]
    lines = [table(["claim", "where", "verdict", "figure [95 %]"], rows, left=3, keys=2), ""]
    for claim in claims:
        lines.append(f"{claim.claim}: {claim.verdict}, {claim.condition}")
        lines.append(f"  figure: {claim.measure}; {claim.cases[0].who}, {claim.cases[0].where}")
        lines += [f"  {claim.ablation}", f"  {claim.command}"]
    return "\n".join(lines)
