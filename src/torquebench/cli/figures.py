"""``torquebench figures``: figures of a stored run, sweep or audit, drawn for the screen or for print."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import Choice, File, argument, option, plugins, workers
from torquebench.cli.run_folder import read_run, read_sweep
from torquebench.cli.terminal import following, progress_bar, say, tell

if TYPE_CHECKING:
    from torquebench.experiment.run import Progress
    from torquebench.report.figures.files import Wish


@command(example="torquebench figures runs/one --only torque --only error --pdf --for paper")
@argument("folder", type=File(folders=True), metavar="RUN", help="what `run`, `sweep` or `audit` left")
@option(
    "--only", multiple=True, metavar="NAME", help="a figure that is wanted (default: all); may be given several times"
)
@option("--pdf", is_flag=True, help="write PDF files too, besides SVG and PNG")
@option(
    "--for",
    "use",
    type=Choice(["screen", "paper"]),
    default="screen",
    show_default=True,
    help="paper: 85 mm wide and 180 mm, without headings, no text under 7 pt",
)
@workers(help="how many processes draw (default: one per core)")
@plugins
def figures(folder: Path, only: Sequence[str], pdf: bool, use: str, workers: int | None, plugin: Sequence[Path]) -> int:
    """Draw the figures of a stored run, sweep or audit.

    They go into its folder `figures`. Nothing is simulated.
    """
    from torquebench.audit import DIGEST
    from torquebench.laws.plugin import load_plugin
    from torquebench.report.figures.files import Wish, names_of
    from torquebench.sweep.folder import PLAN

    for file in plugin:
        load_plugin(file)
    wish = Wish(pdf, use == "paper", workers or os.cpu_count() or 1)
    draw = _of_sweep if (folder / PLAN).is_file() else _of_audit if (folder / DIGEST).is_file() else _of_run
    with progress_bar(0, "figure", "drawing") as bar:
        files = draw(folder, plugin, only, wish, following(bar))
    tell(directory=folder, figures=list(files))
    for name in names_of(files, wish):
        say(name)
    say(f"figures: {folder / 'figures'}")
    return 0


def _of_run(
    folder: Path, _plugins: Sequence[Path], only: Sequence[str], wish: Wish, progress: Progress
) -> dict[str, bytes]:
    from torquebench.experiment.folder import read_result
    from torquebench.report.run import add_figures, draw_run

    result = read_run(folder, "figures", read_result)
    files = draw_run(result, only, wish, progress, "--only")
    add_figures(folder, result, files)
    return files


def _of_sweep(
    folder: Path, plugins: Sequence[Path], only: Sequence[str], wish: Wish, progress: Progress
) -> dict[str, bytes]:
    from torquebench.experiment.store import add_to_run
    from torquebench.report.sweep import draw_sweep

    files = draw_sweep(read_sweep(folder, plugins), only, wish, progress, "--only")
    add_to_run(folder, files)
    return files


def _of_audit(
    folder: Path, plugins: Sequence[Path], only: Sequence[str], wish: Wish, progress: Progress
) -> dict[str, bytes]:
    from torquebench.audits import draw_audit, read_audit

    found = read_run(folder, "figures", lambda path: read_audit(path, plugins))
    return draw_audit(found, only, wish, progress, "--only")
