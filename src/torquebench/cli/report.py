"""``torquebench report``: the page of a stored run made again, or several runs side by side; nothing is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from torquebench.cli.options import check_out
from torquebench.cli.run import summary
from torquebench.cli.run_folder import read_run
from torquebench.cli.sweep import report_with_bar
from torquebench.cli.terminal import following, progress_bar, say, tell, warn
from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.folder import read_result
from torquebench.experiment.run import ExperimentResult
from torquebench.experiment.store import add_to_run, atomic_write
from torquebench.laws.plugin import load_plugin
from torquebench.report.render import PAGE
from torquebench.report.run import compare_page, rewrite_page, stored_page
from torquebench.report.run_page import changed_arm
from torquebench.sweep.folder import PLAN, open_sweep, verify


def report(runs: Sequence[Path], out: Path | None, plugins: Sequence[Path], redraw: bool) -> int:
    """Make the page of one run again, or a page with several; return 0.

    Args:
        runs: Run directories.
        out: File to write; None for ``report.html`` in the run, or ``comparison.html`` here for several.
        plugins: Files that register laws which the runs use.
        redraw: Draw the figures again from the trajectories instead of taking the stored ones.

    Raises:
        ConfigError: the file exists already, two runs have the same name, or runs cannot be read; each is named.
    """
    for plugin in plugins:
        load_plugin(plugin)
    if len(runs) == 1 and out is None and (runs[0] / PLAN).is_file():
        report_sweep(runs[0], plugins)
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
    with progress_bar(0, "figure", "drawing") as bar:
        if len(stored) == 1 and out is None:
            page = rewrite_page(runs[0], stored[0], redraw, following(bar))
        else:
            page = out or Path("comparison.html")
            check_out(page)
            if page.exists():
                raise ConfigError([Problem("--out", "", f"{page} exists; wanted a new file")])
            names = [folder.resolve().name for folder in runs]
            if len(set(names)) < len(names):
                raise ConfigError([Problem("RUN", "", f"two runs are called {max(names, key=names.count)}")])
            content = (
                stored_page(runs[0], stored[0], redraw, following(bar))
                if len(stored) == 1
                else compare_page(dict(zip(names, zip(runs, stored, strict=True), strict=True)))
            )
            atomic_write(page, content)
    finish(page, dict(zip(runs, stored, strict=True)))
    return 0


def report_sweep(folder: Path, plugins: Sequence[Path]) -> None:
    """Make summary, figures and page of a finished sweep again from its table.

    Raises:
        ConfigError: the sweep is not finished, or cannot be read.
    """
    stored = open_sweep(folder, tuple(path.absolute() for path in plugins), "RUN")
    if not stored.finished:
        message = f"{folder} is not a finished sweep: torquebench sweep --resume {folder} goes on with it"
        raise ConfigError([Problem("RUN", "", message)])
    try:
        verify(stored)
    except ResultError as error:
        raise ConfigError([Problem("RUN", "", str(error))]) from error
    add_to_run(folder, dict(report_with_bar(stored, figures=True)))
    tell(report=folder / PAGE, directory=folder)
    say(f"report: {folder / PAGE}")


def finish(page: Path, stored: Mapping[Path, ExperimentResult]) -> None:
    """Say what is on a page and where it is.

    Args:
        page: The page.
        stored: Folder -> the run that was read from it.
    """
    tell(report=page, runs=[{"directory": folder, **result.to_json()} for folder, result in stored.items()])
    for folder, result in stored.items():
        for line in changed_arm(result):
            warn(f"torquebench: {folder}: {line}")
        say(f"{folder}: {summary(result)}\n")
    say(f"report: {page}")
