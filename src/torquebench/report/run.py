"""Figures, page and folder of one run, fresh or stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.experiment.build import build_controllers
from torquebench.experiment.describe import fuzzy_in_use
from torquebench.experiment.folder import manifest_of, write_numbers
from torquebench.experiment.run import ExperimentResult, Progress, band_of
from torquebench.experiment.store import RunDirectory, add_to_run
from torquebench.keys import as_vector
from torquebench.report.render import PAGE, Picture
from torquebench.report.run_page import comparison_page, run_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torquebench.report.figures.run_view import FiredRules

FILM = "video.mp4"


def write_run(
    directory: RunDirectory,
    result: ExperimentResult,
    plugins: Sequence[Path] = (),
    figures: bool = True,
    progress: Progress | None = None,
) -> None:
    """Write numbers, figures, page and, last, the manifest of a run whose trajectories are written.

    Args:
        directory: The run's folder.
        result: The run.
        plugins: Files that were loaded for it, for the manifest.
        figures: Whether to draw.
        progress: Told each figure's file when it is drawn.
    """
    write_numbers(directory, result)
    drawn = dict(run_files(result, progress)) if figures else {}
    for name, content in drawn.items():
        directory.write(name, content)
    directory.write(PAGE, run_page(result, drawn))
    directory.finish(manifest_of(result, plugins))


def run_files(result: ExperimentResult, progress: Progress | None = None) -> Iterator[tuple[str, bytes]]:
    """Draw every figure of a run; yield each file's name and content.

    Args:
        result: The run.
        progress: Told each file when it is drawn.
    """
    from torquebench.report.figures.style import figure_files

    yield from figure_files(run_figures(result), progress)


def run_figures(result: ExperimentResult, only: str | None = None) -> dict[str, Figure]:
    """Draw the figures of a run, by name, from its trajectories; with `only`, that one at most.

    Those of the stability certificates need the arm that was run, and are left out where its files have changed.
    """
    from torquebench.report.figures.run_view import RunView, draw_figures

    experiment = result.experiment
    bands = {keys.name: band_of(keys.law, keys.gains) for keys in experiment.controllers}
    n = len(result.joints.names)
    view = RunView(
        result.runs,
        title=experiment.name,
        subtitle=result.conditions,
        joint_names=result.joints.names,
        tau_max=as_vector(result.joints.tau_max, n),
        metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period,
        chattering_from_hz=experiment.chattering_from_hz,
        laws=experiment.laws,
        metrics=result.metrics,
        bands={name: as_vector(band, n) for name, band in bands.items() if band is not None},
        slides=result.slides,
        certificates=result.certificates if result.certified and not result.arm_changed else {},
        fuzzy=fuzzy_in_use(experiment),
        fired=fired_rules(result),
    )
    return draw_figures(view, only)


def fired_rules(result: ExperimentResult) -> dict[str, FiredRules]:
    """Return which rules of its fuzzy system fired in each run, by controller."""
    from torquebench.report.figures.fuzzy_rules import rule_shares
    from torquebench.report.figures.run_view import FiredRules

    fired = {}
    for keys, controller in zip(result.experiment.controllers, build_controllers(result.experiment), strict=True):
        for field, rules in controller.law.rules.items():
            if keys.fuzzy is not None and rules.inputs is not None:
                fis, run = getattr(controller.gains, field), result.runs[controller.name]
                fired[controller.name] = FiredRules(keys.fuzzy, rule_shares(controller.gains, fis, rules.inputs, run))
    return fired


def stored_page(
    folder: Path, result: ExperimentResult, redraw: bool = False, progress: Progress | None = None
) -> bytes:
    """Return the page of a stored run, with its film if there is one.

    Args:
        folder: The run's folder.
        result: What was read from it.
        redraw: Draw the figures from the trajectories; one that cannot be drawn any more is taken as it was stored.
        progress: Told each file when it is drawn.
    """
    figures = stored_figures(folder, result)
    if redraw:
        figures |= dict(run_files(result, progress))
    film = folder / FILM
    return run_page(result, figures, film.read_bytes() if film.is_file() else None)


def rewrite_page(
    folder: Path, result: ExperimentResult, redraw: bool = False, progress: Progress | None = None
) -> Path:
    """Write the page of a stored run into its folder again and return its path; arguments as of `stored_page`."""
    add_to_run(folder, {PAGE: stored_page(folder, result, redraw, progress)})
    return folder / PAGE


def stored_figures(folder: Path, result: ExperimentResult) -> dict[str, bytes]:
    """Return the SVG files of a run's folder, in the order in which they were drawn.

    Args:
        folder: The run's folder.
        result: What was read from it.
    """
    files: Mapping[str, str] = (result.stored or {}).get("files", {})
    names = [name for name in files if name.startswith("figures/") and name.endswith(".svg")]
    return {name: (folder / name).read_bytes() for name in names}


def compare_page(runs: Mapping[str, tuple[Path, ExperimentResult]]) -> bytes:
    """Return a page with several stored runs side by side, and each one's errors drawn.

    Args:
        runs: Name of a run -> its folder, and what was read from it.
    """
    drawn = {name: stored_figures(folder, result).get("figures/error.svg") for name, (folder, result) in runs.items()}
    pictures = [Picture(f"Tracking error: {name}", svg) for name, svg in drawn.items() if svg is not None]
    return comparison_page({name: result for name, (_, result) in runs.items()}, pictures)
