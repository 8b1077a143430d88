"""``torquebench report``: the page of a stored run made again, or several runs side by side; nothing is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torquebench.cli.conditions import conditions_text
from torquebench.cli.options import check_out
from torquebench.cli.run import draw_figures, summary
from torquebench.cli.run_facts import run_facts
from torquebench.cli.run_folder import read_run
from torquebench.cli.sweep_report import report_files
from torquebench.cli.terminal import say, tell
from torquebench.errors import ConfigError, Problem, ResultError
from torquebench.experiment.certify import certificates
from torquebench.experiment.store import add_to_run, atomic_write
from torquebench.experiment.stored import StoredRun, load_run
from torquebench.laws.plugin import load_plugin
from torquebench.report.render import PAGE, Picture
from torquebench.report.run_page import comparison_page, run_page
from torquebench.sweep.folder import PLAN, open_sweep, verify

FILM = "video.mp4"


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
    stored: list[StoredRun] = []
    problems: list[Problem] = []
    for folder in runs:
        try:
            stored.append(read_run(folder, "report", load_run))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(dict.fromkeys(problems))
    if len(stored) == 1 and out is None:
        (run,) = stored
        add_to_run(run.folder, {PAGE: page_of(run, redraw)})
        finish(run.folder / PAGE, stored)
        return 0
    target = out or Path("comparison.html")
    check_out(target)
    if target.exists():
        raise ConfigError([Problem("--out", "", f"{target} exists; wanted a new file")])
    names = [run.folder.resolve().name for run in stored]
    if len(set(names)) < len(names):
        raise ConfigError([Problem("RUN", "", f"two runs are called {max(names, key=names.count)}")])
    content = page_of(stored[0], redraw) if len(stored) == 1 else comparison_of(dict(zip(names, stored, strict=True)))
    atomic_write(target, content)
    finish(target, stored)
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
    add_to_run(folder, dict(report_files(stored, figures=True)))
    tell(report=folder / PAGE, directory=folder)
    say(f"report: {folder / PAGE}")


def finish(page: Path, stored: Sequence[StoredRun]) -> None:
    """Say what is on a page and where it is.

    Args:
        page: The page.
        stored: The runs on it.
    """
    runs = [{"directory": run.folder, **run_facts(run.result)} for run in stored]
    tell(report=page, runs=runs)
    for run in stored:
        say(f"{run.folder}: {summary(run.result)}\n")
    say(f"report: {page}")


def page_of(run: StoredRun, redraw: bool) -> bytes:
    """Return the page of a stored run.

    Args:
        run: The run.
        redraw: Draw the figures again instead of taking the stored ones.
    """
    proofs = certificates(run.result.experiment, run.result.loop, run.result.runs)
    svgs = {name: files["svg"] for name, files in draw_figures(run.result, proofs)} if redraw else stored_figures(run)
    film = run.folder / FILM
    return run_page(
        run.result,
        proofs,
        svgs,
        conditions_text(run.result.experiment),
        facts_of(run.manifest),
        film.read_bytes() if film.is_file() else None,
    )


def stored_figures(run: StoredRun) -> dict[str, bytes]:
    """Return the figures of a run directory by name, in the order in which they were drawn."""
    names = [name for name in run.manifest["files"] if name.startswith("figures/") and name.endswith(".svg")]
    return {Path(name).stem: (run.folder / name).read_bytes() for name in names}


def facts_of(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return what a page tells of a run's manifest: configuration, seeds, software and machine."""
    return {key: manifest[key] for key in ("config_sha256", "seeds", "software", "machine")}


def comparison_of(stored: dict[str, StoredRun]) -> bytes:
    """Return a page with several runs, and each one's errors drawn.

    Args:
        stored: Name -> run.
    """
    pictures = []
    for name, run in stored.items():
        svg = stored_figures(run).get("error")
        if svg is not None:
            pictures.append(Picture(f"Tracking error: {name}", svg.decode()))
    return comparison_page({name: run.result for name, run in stored.items()}, pictures)
