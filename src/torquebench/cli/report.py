"""``torquebench report``: the page of a stored run made again, or several runs side by side; nothing is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import File, argument, check_out, out_file, plugins, refuse
from torquebench.cli.run import outcome
from torquebench.cli.run_folder import read_run, read_sweep
from torquebench.cli.sweep import report_with_bar
from torquebench.cli.terminal import say, tell, warn
from torquebench.errors import ConfigError, Problem

if TYPE_CHECKING:
    from torquebench.experiment.run import ExperimentResult


@command(example="torquebench report runs/one runs/two --out both.html")
@argument("runs", type=File(folders=True), nargs=-1, required=True, metavar="RUN", help="what `run` or `sweep` left")
@out_file(help="page to write (default: RUN/report.html; comparison.html for several)")
@plugins
def report(runs: Sequence[Path], out: Path | None, plugin: Sequence[Path]) -> int:
    """Write a stored run's page again, or compare several runs.

    A sweep has a page too. Nothing is simulated.
    """
    from torquebench.experiment.folder import read_result
    from torquebench.experiment.store import atomic_write
    from torquebench.laws.plugin import load_plugin
    from torquebench.report.run import rewrite_page, stored_page
    from torquebench.sweep.folder import PLAN

    for file in plugin:
        load_plugin(file)
    if len(runs) == 1 and out is None and (runs[0] / PLAN).is_file():
        _report_sweep(runs[0], plugin)
        return 0
    stored: list[ExperimentResult] = []
    problems: list[Problem] = []
    for folder in runs:
        try:
            stored.append(read_run(folder, "report", read_result))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(dict.fromkeys(problems))
    if len(stored) == 1 and out is None:
        page = rewrite_page(runs[0], stored[0])
    else:
        page = out or Path("comparison.html")
        check_out(page)
        if page.exists():
            refuse([Problem("--out", text=f"{page} exists", wanted="a new file")])
        names = [folder.resolve().name for folder in runs]
        if len(set(names)) < len(names):
            refuse([("RUN", f"two runs are called {max(names, key=names.count)}")])
        if len(stored) == 1:
            atomic_write(page, stored_page(runs[0], stored[0]))
        else:
            from torquebench.report.compare_page import comparison_page

            atomic_write(page, comparison_page(dict(zip(names, stored, strict=True))))
    _print_page(page, dict(zip(runs, stored, strict=True)))
    return 0


def _report_sweep(folder: Path, plugins: Sequence[Path]) -> None:
    """Make summary and page of a finished sweep again from its table."""
    from torquebench.experiment.store import add_to_run
    from torquebench.report.render import PAGE

    add_to_run(folder, dict(report_with_bar(read_sweep(folder, plugins))))
    tell(report=folder / PAGE, directory=folder)
    say(f"report: {folder / PAGE}")


def _print_page(page: Path, stored: Mapping[Path, ExperimentResult]) -> None:
    """Say what is on a page of stored runs, and where it is."""
    from torquebench.report.run_page import changed_arm

    tell(report=page, runs=[{"directory": folder, **result.to_json()} for folder, result in stored.items()])
    for folder, result in stored.items():
        for line in (*result.flags, *changed_arm(result)):
            warn(f"torquebench: {folder}: {line}")
        say(f"{folder}: {outcome(result)}\n")
    say(f"report: {page}")
