"""``torquebench audit``: the claims of a study, judged."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.cli.app import command
from torquebench.cli.parameters import Config, argument, option, out_folder, plugins, refuse, settings
from torquebench.cli.parameters import workers as workers_option
from torquebench.cli.terminal import complain, following, progress_bar, say, tell, warn
from torquebench.errors import Problem, nearest
from torquebench.shipped import find_config

if TYPE_CHECKING:
    from torquebench.audits import Audit

QUICK = 4
"""Draws of a quick look."""
VERDICTS = ("holds", "fails", "depends", "undecided")
ANY = "*"


@command(example="torquebench audit paper/audit --quick")
@argument("config", type=Config(), help="experiment with a section `audit`: a file, or a shipped one")
@out_folder(help="folder for the results: new, empty, or one in which this audit was begun (default: runs/NAME-UTC)")
@option("--quick", is_flag=True, help=f"{QUICK} draws in place of the study's: for a look")
@workers_option(help="how many conditions run at once (default: one per core)")
@settings(help="change one key, for example audit.draws=10")
@plugins
@option(
    "--fail-if",
    multiple=True,
    metavar="CLAIM=VERDICT",
    help="exit status 1 if this claim has this verdict; * stands for every claim; repeatable",
)
@option("--no-figures", is_flag=True, help="claims and page only: no figures")
@option("--show-config", is_flag=True, help="print the whole study, what it extends included; run nothing")
def audit(
    config: Path,
    out: Path | None,
    quick: bool,
    workers: int | None,
    overrides: Sequence[str],
    plugin: Sequence[Path],
    fail_if: Sequence[str],
    no_figures: bool,
    show_config: bool,
) -> int:
    """Judge the claims of a study under each of its conditions.

    A claim holds, fails, depends on the conditions, or is undecided. A verdict other than the one that the study
    expects makes the exit status 1.
    """
    gates = _gates(fail_if)
    if show_config:
        return _show(config, overrides, plugin)
    draws = QUICK if quick else None
    return report(
        _run(
            config, folder=out, draws=draws, changes=overrides, workers=workers, figures=not no_figures, plugins=plugin
        ),
        gates,
        quick,
    )


@command(example="torquebench paper --quick")
@out_folder(help="folder for the results: new, empty, or one in which this was begun (default: runs/paper-UTC)")
@option("--quick", is_flag=True, help=f"{QUICK} draws in place of the study's: for a look")
@workers_option(help="how many conditions run at once (default: one per core)")
def paper(out: Path | None, quick: bool, workers: int | None) -> int:
    """Judge the claims of the paper behind the PUMA's laws.

    It is `torquebench audit paper/audit`.
    """
    draws = QUICK if quick else None
    return report(_run(find_config("paper/audit"), folder=out, draws=draws, workers=workers), quick=quick)


def _show(config: Path, overrides: Sequence[str], plugin: Sequence[Path]) -> int:
    """Print a study as it would be run; arguments as of the command."""
    from torquebench.audits import audit_config
    from torquebench.experiment.dump import dump_tree
    from torquebench.laws.plugin import load_plugin

    for file in plugin:
        load_plugin(file)
    whole = audit_config(config, overrides)
    tell(experiment=whole)
    say(dump_tree(whole).rstrip("\n"), fold=False)
    return 0


def _run(config: Path, **given: Any) -> Audit:
    """Run a study, with a progress bar; arguments as of `run_audit`."""
    from torquebench.audits import run_audit

    with progress_bar(0, "run", "starting (compiles on first use)") as bar:
        return run_audit(config, progress=following(bar), **given)


def report(found: Audit, gates: Sequence[tuple[str, str]] = (), quick: bool = False) -> int:
    """Say what came out, and return the exit status.

    Args:
        found: The audit.
        gates: Claim, or `ANY`, and verdict that makes the status 1.
        quick: Whether there were fewer draws than the study has: a verdict that it does not expect is then told, and
            makes no status.
    """
    known = {claim.key for claim in found.claims}
    refuse([_unknown(key, known) for key, _ in gates if key not in known and key != ANY])
    tell(directory=found.folder, claims=[claim.to_json() for claim in found.claims])
    say(claim_lines(found))
    say(f"results: {found.folder}")
    moved = [f"claim '{claim.key}': {claim.verdict}, the study expects {claim.claim.expect}" for claim in found.moved]
    for text in moved if quick else ():
        warn(f"torquebench: {text}: {QUICK} draws are a look, the study's own decide")
    wrong = [] if quick else moved
    wrong += [
        f"claim '{claim.key}': {claim.verdict} (--fail-if {key}={verdict})"
        for key, verdict in gates
        for claim in found.claims
        if key in (claim.key, ANY) and claim.verdict == verdict
    ]
    for text in wrong:
        complain(f"torquebench: {text}")
    return 1 if wrong else 0


def _gates(texts: Sequence[str]) -> list[tuple[str, str]]:
    """Return claim and verdict of each text ``CLAIM=VERDICT``."""
    found, problems = [], []
    for text in texts:
        key, _, verdict = text.partition("=")
        if verdict not in VERDICTS:
            near = nearest(verdict, VERDICTS) or ""
            wanted = "" if near else f"CLAIM=VERDICT, the verdict one of {', '.join(VERDICTS)}"
            problems.append(Problem("--fail-if", got=f"'{text}'", nearest=near, wanted=wanted))
        found.append((key, verdict))
    refuse(problems)
    return found


def _unknown(key: str, known: set[str]) -> Problem:
    near = nearest(key, known) or ""
    wanted = "" if near else f"one of {', '.join(sorted(known))}, or *"
    return Problem("--fail-if", text="no such claim", got=f"'{key}'", nearest=near, wanted=wanted)


def claim_lines(found: Audit) -> str:
    """Return the claims for the terminal: verdict and claim, a dot for each case, and a sentence."""
    from torquebench.audit.pages import dots

    lines = [str(found.study.audit.paper)] if found.study.audit.paper else []
    lines += ["● holds  ◐ undecided  ○ fails", ""]
    for i, claim in enumerate(found.claims, 1):
        lines.append(f"{i:2d} {str(claim.verdict).upper():9}  {claim.claim.says}")
        lines.append(" " * 14 + "  ".join(f"{group} {text}" for group, text in dots(found.study, claim)))
        lines.append(" " * 14 + claim.sentence)
    return "\n".join(lines)
