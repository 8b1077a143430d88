"""Figures, page and folder of one run, fresh or stored."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.experiment.build import build_controllers
from torquebench.experiment.describe import fuzzy_in_use
from torquebench.experiment.folder import manifest_of, write_numbers
from torquebench.experiment.run import ExperimentResult, Progress, band_of
from torquebench.experiment.store import RunDirectory, add_to_run
from torquebench.figures import FIGURES
from torquebench.keys import as_vector
from torquebench.report.render import PAGE
from torquebench.report.run_page import run_page

if TYPE_CHECKING:
    from torquebench.report.figures.files import Wish
    from torquebench.report.figures.run_view import FiredRules, RunView

FILM = "video.mp4"


def write_run(
    directory: RunDirectory,
    result: ExperimentResult,
    plugins: Sequence[Path] = (),
    figures: bool = True,
    progress: Progress | None = None,
    workers: int = 1,
) -> None:
    """Write numbers, figures, page and, last, the manifest of a run whose trajectories are written.

    Args:
        directory: The run's folder.
        result: The run.
        plugins: Files that were loaded for it, for the manifest.
        figures: Whether to draw the figures that the experiment asks for.
        progress: Told each figure when it is drawn.
        workers: How many processes draw.
    """
    write_numbers(directory, result)
    asked, drawn = result.experiment.figures if figures else (), {}
    if asked:
        from torquebench.report.figures.files import Wish

        drawn = dict(run_files(result, () if asked == "all" else asked, Wish(workers=workers), progress))
    for name, content in drawn.items():
        directory.write(name, content)
    directory.write(PAGE, run_page(result, figures=sorted(drawn)))
    directory.finish(manifest_of(result, plugins))


def run_files(
    result: ExperimentResult, only: Sequence[str], wish: Wish, progress: Progress | None = None
) -> Iterator[tuple[str, bytes]]:
    """Draw figures of a run from its trajectories; yield each file's name and content.

    Args:
        result: The run.
        only: Names of the figures that are wanted; all if there are none.
        wish: How they are written.
        progress: Told each figure when it is drawn.
    """
    from torquebench.report.figures.files import figure_files
    from torquebench.report.figures.run_view import draw_jobs

    return figure_files(draw_jobs(view_of(result, only)), wish, progress, only)


def draw_run(
    result: ExperimentResult,
    only: Sequence[str],
    wish: Wish,
    progress: Progress | None = None,
    place: str = "only",
) -> dict[str, bytes]:
    """Draw figures of a run as `run_files` does; return each file's name and content.

    Args:
        result: The run.
        only: Names of the figures that are wanted; all if there are none.
        wish: How they are written.
        progress: Told each figure when it is drawn.
        place: What messages call `only`.

    Raises:
        ConfigError: the run has no figure of one of the names.
    """
    from torquebench.report.figures.files import check_names, may_draw, names_of, wanted

    check_names(only, FIGURES.names(), may_draw, place)
    files = dict(run_files(result, only, wish, progress))
    check_names(only, names_of(files, wish), wanted, place)
    return files


def view_of(result: ExperimentResult, only: Sequence[str] = ()) -> RunView:
    """Return what the figures of a run show.

    The stability certificates need the arm that was run, and are left out where its files have changed.

    Args:
        result: The run.
        only: Names of the figures that are wanted; what none of them shows is not worked out. All if there are none.
    """
    from torquebench.report.figures.files import may_draw
    from torquebench.report.figures.run_view import RunView

    def shown(name: str) -> bool:
        """Whether a wanted figure may show what the built-in one of this name shows; that of a plug-in shows any."""
        return any(may_draw(one.name, only) for one in FIGURES.values() if one.name == name or callable(one.draw))

    experiment = result.experiment
    certified = shown("certificates") and result.certified and not result.arm_changed
    bands = {keys.name: band_of(keys.law, keys.gains) for keys in experiment.controllers}
    n = len(result.joints.names)
    return RunView(
        result.runs,
        title=experiment.name,
        subtitle=result.conditions.partition("\n")[0],  # the rest is on the page, once
        joint_names=result.joints.names,
        tau_max=as_vector(result.joints.tau_max, n),
        metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period,
        chattering_from_hz=experiment.chattering_from_hz,
        laws=experiment.laws,
        metrics=result.metrics,
        bands={name: as_vector(band, n) for name, band in bands.items() if band is not None},
        slides=result.slides,
        certificates=result.certificates if certified else {},
        fuzzy=fuzzy_in_use(experiment),
        fired=fired_rules(result) if shown("rules") else {},
    )


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


def stored_page(folder: Path, result: ExperimentResult, drawn: Iterable[str] = ()) -> bytes:
    """Return the page of a stored run, with its film and links to its figures if there are any.

    Args:
        folder: The run's folder.
        result: What was read from it.
        drawn: Names of figures' files that are about to be written there.
    """
    film = folder / FILM
    figures = sorted({*stored_figures(result), *drawn})
    return run_page(result, film.read_bytes() if film.is_file() else None, figures)


def rewrite_page(folder: Path, result: ExperimentResult) -> Path:
    """Write the page of a stored run into its folder again and return its path; arguments as of `stored_page`."""
    add_to_run(folder, {PAGE: stored_page(folder, result)})
    return folder / PAGE


def add_figures(folder: Path, result: ExperimentResult, files: Mapping[str, bytes]) -> None:
    """Write figures into the folder of a stored run, and its page again, which links them.

    Args:
        folder: The run's folder.
        result: What was read from it.
        files: Name and content of each figure's file.
    """
    add_to_run(folder, {**files, PAGE: stored_page(folder, result, files)})


def stored_figures(result: ExperimentResult) -> list[str]:
    """Return the names of the figures' files in the folder of a stored run, in the order in which they were drawn."""
    files: Mapping[str, str] = (result.stored or {}).get("files", {})
    return sorted(name for name in files if name.startswith("figures/"))
