"""``torquebench boundary-layer``: what a boundary layer costs, on one page."""

from __future__ import annotations

from typing import Any

from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.experiment.describe import conditions_text
from torquebench.experiment.store import RunDirectory, claim_folder, json_bytes
from torquebench.paper.boundary_layer import Point, front, grid, study
from torquebench.paper.workload import PAIRED_DRAWS


def boundary_layer(options: Any) -> int:
    """Run the study, write its table and its page; return 0.

    Args:
        options: Arguments of the command; see ``torquebench boundary-layer --help``.

    Raises:
        ConfigError: bad arguments.
    """
    if options.workers < 1:
        raise ConfigError([Problem("--workers", str(options.workers), "wanted at least 1")])
    draws = PAIRED_DRAWS["quick" if options.quick else "full"]
    directory = RunDirectory(claim_folder(options.out, "boundary-layer"))
    experiment, choices = grid()
    with progress_bar(len(choices) * draws * experiment.n_steps, "step", "starting (compiles on first use)") as bar:

        def report(what: str, steps: int) -> None:
            bar.describe(what)
            bar.update(steps)

        points = study(draws, options.workers, report)
    best = front(points)
    facts = [
        {"phi": p.phi, "k": p.k, "lam": p.lam, "rmse": p.rmse._asdict(), "hf": p.hf._asdict(), "front": p in best}
        for p in points
    ]
    directory.write("points.json", json_bytes(facts))
    tell(directory=directory.folder, draws=draws, points=facts)
    write_page(points, best, directory, f"{conditions_text(experiment)}; {draws} draws")
    directory.finish({"name": "boundary-layer", "draws": draws})
    rows = [
        [
            f"{p.phi:g}",
            f"{p.k:g}",
            f"{p.lam:g}",
            f"{1e3 * p.rmse.ratio:.3g}",
            f"[{1e3 * p.rmse.low:.3g}, {1e3 * p.rmse.high:.3g}]",
            f"{p.hf.ratio:.3g}",
            f"[{p.hf.low:.3g}, {p.hf.high:.3g}]",
        ]
        for p in best
    ]
    say(f"choices that no other one of {len(points)} beats in both error and chattering:")
    say()
    header = ["phi [rad/s]", "k", "lambda [1/s]", "RMSE [mrad]", "95 %", "HF [%]", "95 %"]
    say(table(header, rows, left=0, keys=3))
    say()
    say(f"results: {directory.folder}")
    return 0


def write_page(points: list[Point], best: list[Point], directory: RunDirectory, subtitle: str) -> None:
    """Draw error against chattering and write it as SVG and PNG.

    Args:
        points: Every choice of gains.
        best: Those on the front.
        directory: Where.
        subtitle: What was run.
    """
    from torquebench.report.figures.pareto import Front, Spot, draw_pareto
    from torquebench.report.figures.style import figure_bytes

    spots = [
        Spot(f"k = {p.k:g}, lambda = {p.lam:g}", f"{p.phi:g}", p.rmse, p.hf, p in best)
        for p in sorted(points, key=lambda p: (p.lam, p.k, p.phi))
    ]
    figure = draw_pareto(Front(tuple(spots), "its phi [rad/s]"), "What a boundary layer costs", subtitle)
    directory.write("figures/front.svg", figure_bytes(figure, "svg"))
    directory.write("figures/front.png", figure_bytes(figure, "png"))
