"""``torquebench paper``: the study of the paper's claims, which is part of the source and not of the package."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Any

from torquebench.cli.colour import bad, good
from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.experiment.store import RunDirectory, claim_folder
from torquebench.robot.library import data_root

DRAWS = {"quick": 4, "full": 30}
"""Draws behind each interval, by size of the study."""
TONES = {"holds": good, "fails": bad}


def paper(options: argparse.Namespace) -> int:
    """Run the study and write what came out; return 0.

    Args:
        options: Arguments of the command; see ``torquebench paper --help``.

    Raises:
        ConfigError: bad arguments, or the study is not there.
    """
    if options.workers < 1:
        raise ConfigError([Problem("--workers", str(options.workers), "wanted at least 1")])
    study, report = load_study("study"), load_study("report")
    draws = DRAWS["quick" if options.quick else "full"]
    directory = RunDirectory(claim_folder(options.out, "paper"))
    with progress_bar(study.count_runs(draws), "run", "starting (compiles on first use)") as bar:

        def progress(what: str, runs: int = 0) -> None:
            bar.set_description_str(what, refresh=False)
            bar.update(runs)

        found = study.run_study(draws, options.workers, progress)
        claims = report.write_study(found, directory, draws, progress)
    tell(
        directory=directory.folder,
        draws=draws,
        claims=[claim.to_json() for claim in claims],
        plants_apart=report.agreement_facts(found),
    )
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
        raise ConfigError([Problem("paper", "", f"{message}; run it in a checkout")])
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
