"""The commands that are still written for argparse, behind click."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

import click
from click.shell_completion import CompletionItem

from torquebench.cli.app import command
from torquebench.cli.parameters import File, Words, argument, option, out_file, out_folder, workers


def _size(_context: click.Context, _parameter: click.Parameter, value: str) -> tuple[int, int]:
    width, _, height = value.partition("x")
    if not (width.isdecimal() and height.isdecimal() and len(value) < 14):
        raise click.BadParameter(f"got '{value}', wanted WIDTHxHEIGHT, for example 640x480")
    return int(width), int(height)


@command(example="torquebench video runs/one --speed 0.5")
@argument("run", type=File(folders=True), metavar="RUN", help="folder that `run` left")
@option(
    "--quality",
    default="fast",
    shell_complete=lambda *a: [CompletionItem(q) for q in ("fast", "pretty") if q.startswith(a[2])],
    help="fast, or pretty: with shadows, many times as slow",
)
@option(
    "--size",
    default="640x480",
    callback=_size,
    metavar="WIDTHxHEIGHT",
    help="of a frame, even numbers (default 640x480)",
)
@option("--speed", type=float, default=1.0, help="simulated seconds in one second (default 1)")
@option("--camera", help="a camera of the arm, by name (default: its first)")
@option(
    "--controllers", type=Words(), default="", metavar="NAME,NAME", help="those to show, in this order (default: all)"
)
@option("--still", type=float, metavar="SECONDS", help="one picture of this time, PNG; needs --out")
@out_file(help="file to write, .mp4, or .png of a picture (default: RUN/video.mp4)")
@click.pass_obj
def video(gl: str | None, /, **options: Any) -> int:
    """Make the film of a stored run.

    Nothing is simulated: the film shows the stored trajectories, one panel for each controller.
    """
    from torquebench.cli.video import video as work

    options["controllers"] = [name for name in options["controllers"] if name]
    return work(SimpleNamespace(gl=gl, **options))  # type: ignore[arg-type]


@command(example="torquebench view runs/one --browser")
@argument("run", type=File(folders=True), metavar="RUN", help="folder that `run` left")
@option(
    "--controllers", type=Words(), default="", metavar="NAME,NAME", help="those to show, in this order (default: all)"
)
@option("--browser", is_flag=True, help="in the browser, even where a window opens")
@option("--no-open", is_flag=True, help="print the page's address; do not open the browser")
@option("--speed", type=float, help="simulated seconds in one second, to begin with (default 1)")
@option("--port", type=int, help="port of the page, for a tunnel (default: a free one)")
def view(**options: Any) -> int:
    """Replay a stored run, to look at it from all sides.

    MuJoCo's viewer is used where a window opens, else a page in the browser, served to this machine alone until Ctrl-C.
    """
    from torquebench.cli.view import view as work

    options["controllers"] = [name for name in options["controllers"] if name]
    return work(SimpleNamespace(**options))  # type: ignore[arg-type]


@command(example="torquebench paper --quick")
@out_folder(help="folder for the results, new or empty (default: runs/paper-UTC)")
@option("--quick", is_flag=True, help="few draws: for a look, and for continuous integration")
@workers(help="threads (default: one per core)")
def paper(workers: int | None, **options: Any) -> int:
    """Run the paper's Figs 9 to 11 and judge each of its claims.

    Everything that the claims rest on is run, on both plants.
    """
    from torquebench.cli.paper import paper as work

    return work(SimpleNamespace(workers=workers or os.cpu_count() or 1, **options))  # type: ignore[arg-type]


@command(example="torquebench boundary-layer --quick")
@out_folder(help="folder for the results, new or empty (default: runs/boundary-layer-UTC)")
@option("--quick", is_flag=True, help="few draws")
@workers(help="threads (default: one per core)")
def boundary_layer(workers: int | None, **options: Any) -> int:
    """Show what a boundary layer costs: error against chattering.

    configs/paper/boundary-layer.yaml is run over a grid of phi, k and lambda.
    """
    from torquebench.cli.boundary_layer import boundary_layer as work

    return work(SimpleNamespace(workers=workers or os.cpu_count() or 1, **options))  # type: ignore[arg-type]
