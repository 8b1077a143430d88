"""Figures, page and folder of one run, fresh or stored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

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
FORMATS: tuple[Literal["svg", "png"], ...] = ("svg", "png")


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
    svgs = {}
    for name, files in figure_files(result, progress) if figures else ():
        for fmt, content in files.items():
            directory.write(f"figures/{name}.{fmt}", content)
        svgs[name] = files["svg"]
    directory.write(PAGE, run_page(result, svgs))
    directory.finish(manifest_of(result, plugins))


def figure_files(result: ExperimentResult, progress: Progress | None = None) -> Iterator[tuple[str, dict[str, bytes]]]:
    """Draw every figure of a run; yield its name and its bytes by format.

    Args:
        result: The run.
        progress: Told each file when it is drawn.
    """
    from torquebench.report.figures.style import figure_bytes

    figures = run_figures(result)
    whole, done = len(FORMATS) * len(figures), 0
    for name, figure in figures.items():
        files = dict[str, bytes]()
        for fmt in FORMATS:
            files[fmt] = figure_bytes(figure, fmt)
            done += 1
            if progress is not None:
                progress(f"figures/{name}.{fmt}", done, whole)
        yield name, files


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
            if keys.fuzzy is None or rules.inputs is None:
                continue
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
    svgs = stored_figures(folder, result)
    if redraw:
        svgs |= {name: files["svg"] for name, files in figure_files(result, progress)}
    film = folder / FILM
    return run_page(result, svgs, film.read_bytes() if film.is_file() else None)


def rewrite_page(
    folder: Path, result: ExperimentResult, redraw: bool = False, progress: Progress | None = None
) -> Path:
    """Write the page of a stored run into its folder again and return its path; arguments as of `stored_page`."""
    add_to_run(folder, {PAGE: stored_page(folder, result, redraw, progress)})
    return folder / PAGE


def stored_figures(folder: Path, result: ExperimentResult) -> dict[str, bytes]:
    """Return the figures of a run's folder as SVG by name, in the order in which they were drawn.

    Args:
        folder: The run's folder.
        result: What was read from it.
    """
    files: Mapping[str, str] = (result.stored or {}).get("files", {})
    names = [name for name in files if name.startswith("figures/") and name.endswith(".svg")]
    return {Path(name).stem: (folder / name).read_bytes() for name in names}


def compare_page(runs: Mapping[str, tuple[Path, ExperimentResult]]) -> bytes:
    """Return a page with several stored runs side by side, and each one's errors drawn.

    Args:
        runs: Name of a run -> its folder, and what was read from it.
    """
    drawn = {name: stored_figures(folder, result).get("error") for name, (folder, result) in runs.items()}
    pictures = [Picture(f"Tracking error: {name}", svg) for name, svg in drawn.items() if svg is not None]
    return comparison_page({name: result for name, (_, result) in runs.items()}, pictures)


def certificate_lines(result: ExperimentResult) -> list[str]:
    """Return a line for each controller with certificates: worst margin of K, reaching time, where V grew."""
    lines = []
    for name, facts in result.certified.items():
        worst = facts["worst_margin"]
        joint, force = result.joints.names[worst["joint"] - 1], "N" if result.slides[worst["joint"] - 1] else "N m"
        text = (
            f"certificate of {name}: least K - (123) {worst['value']:.3g} {force} ({joint}, t = {worst['t']:.4g} s); "
        )
        time, most = facts["reaching_time"], facts["reaching_bound"]
        if not facts["share_outside"]:
            text += "the rest is vacuous: no joint is ever outside its layer"
        else:
            reached = "never" if time is None else f"{time:.3g} s"
            bound = facts.get("no_bound", "none: V grew on the way") if most is None else f"{most:.3g} s"
            text += f"reaching time {reached} (bound {bound}); V grew in {_percent(facts, 'share_rising_outside')} of "
            text += f"the {_percent(facts, 'share_outside')} of instants outside the layer"
        if facts.get("set_point"):
            text += f"; V of (142): {set_point_text(facts['set_point'])}"
        lines.append(text)
    return lines


def _percent(facts: Mapping[str, Any], key: str) -> str:
    return f"{100.0 * facts[key]:.3g} %"


def set_point_text(facts: Mapping[str, Any]) -> str:
    """Return what the paper's own Lyapunov function shows, as of `SetPoint.to_json`, in words."""
    says, share = facts["says"], facts["share_rising_outside"]
    if says == "falls":
        return f"falls wherever a joint is outside its layer, (144) by zeta {facts['least_zeta']:.3g}"
    if says == "vacuous":
        return "vacuous, no joint is outside its layer while the desired position stands still"
    if says == "lost to saturation":
        return f"{says}, rises in {100.0 * share:.3g} % of these instants, always with a joint at its torque limit"
    return f"rises in {100.0 * share:.3g} % of these instants" if says == "rises" else str(says)
