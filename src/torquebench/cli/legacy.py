"""The commands that are still written for argparse, behind click."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
from click.shell_completion import CompletionItem

from torquebench.cli.app import (
    Choice,
    Config,
    File,
    Words,
    argument,
    command,
    option,
    out_file,
    out_folder,
    plugins,
    workers,
)
from torquebench.shipped import find_config


def _settings(context: click.Context, parameter: click.Parameter, typed: str) -> list[CompletionItem]:
    from torquebench.cli.completion import complete_setting

    return complete_setting(context, parameter, typed)


@command(example="torquebench run fig9-chattering --set run.duration=2")
@argument("config", type=Config(), required=False, help="experiment: a YAML file, or the name of a shipped one")
@option("--from-sweep", type=File(folders=True), metavar="DIR", help="run one row of a sweep again instead")
@option("--index", type=int, metavar="K", help="number of that row, from 0")
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@option(
    "-s",
    "--set",
    "overrides",
    multiple=True,
    shell_complete=_settings,
    metavar="KEY=VALUE",
    help="change one key, for example run.duration=2 or controllers.band.gains.phi=0.1",
)
@plugins
@option("--no-figures", is_flag=True, help="write numbers only: no figures, no film")
@click.pass_obj
def run(gl: str | None, /, **options: Any) -> int:
    """Run one experiment: every controller in it, side by side."""
    from torquebench.cli.run import run as work

    options = SimpleNamespace(gl=gl, **options)  # type: ignore[assignment]
    return work(options)  # type: ignore[arg-type]


@command(example="torquebench sweep sweep --dry-run")
@argument(
    "config", type=Config(), required=False, help="experiment with a section `sweep`: a YAML file, or a shipped one"
)
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@option("--resume", type=File(folders=True), metavar="DIR", help="go on with the sweep in this folder")
@option("-j", "--workers", type=int, metavar="N", help="how many run (default: one per core)")
@option("--executor", type=Choice(["processes", "threads"]), help="what the workers are (default: processes)")
@option(
    "--cluster",
    metavar="ADDRESS",
    help="run on a Dask cluster: tcp://HOST:PORT or tls://HOST:PORT of its scheduler; local or local:N makes one here",
)
@option(
    "-s",
    "--set",
    "overrides",
    multiple=True,
    shell_complete=_settings,
    metavar="KEY=VALUE",
    help="change one key, for example sweep.draws=10 or run.duration=2",
)
@plugins
@option("--no-cap", is_flag=True, help="start whatever it takes")
@option("--dry-run", is_flag=True, help="check and estimate only")
@option("--no-figures", is_flag=True, help="tables, summary and page only: no figures")
def sweep(**options: Any) -> int:
    """Run many variants of one experiment: grids and random draws over any of its keys."""
    from torquebench.cli.sweep import sweep as work

    return work(SimpleNamespace(**options))  # type: ignore[arg-type]


@command(example="torquebench report runs/one runs/two --out both.html")
@argument(
    "runs", type=File(folders=True), nargs=-1, required=True, metavar="RUN", help="folder that `run` or `sweep` left"
)
@out_file(help="page to write (default: RUN/report.html; comparison.html for several)")
@option("--redraw", is_flag=True, help="draw the figures again from the trajectories")
@plugins
def report(runs: Any, out: Any, redraw: bool, plugin: Any) -> int:
    """Make the page of a stored run or sweep again, or one page of several runs; nothing is simulated."""
    from torquebench.cli.report import report as work

    return work(runs, out, plugin, redraw)


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
    """Make the film of a stored run; nothing is simulated."""
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
    """Replay a stored run, to look at it from all sides; nothing is simulated."""
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


SYSTEMS = ("pd-49", "pd-25", "pd-9", "s-7")
"""Built-in fuzzy systems, known before what defines them is imported."""


class Source(Config):
    """A config, or the name of a built-in fuzzy system."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the file's path, or the system's name as a path."""
        return Path(value) if value in SYSTEMS else find_config(str(value), SYSTEMS)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return systems, shipped configs and files."""
        systems = [CompletionItem(name) for name in SYSTEMS if name.startswith(incomplete)]
        return systems + super().shell_complete(ctx, param, incomplete)


@command(example="torquebench fuzzy pd-49")
@argument(
    "source",
    type=Source(),
    metavar="CONFIG",
    help="experiment: a YAML file, or a shipped one; or a built-in system: pd-49, pd-25, pd-9, s-7",
)
@option("--name", help="the only system of the file to describe (default: all)")
@out_folder(help="folder for the figures, new or empty (default: runs/fuzzy-NAME-UTC)")
@plugins
def fuzzy(source: Path, name: str | None, out: Path | None, plugin: Any) -> int:
    """Describe and draw fuzzy systems: how they are evaluated, and what is odd about them."""
    from torquebench.cli.fuzzy import fuzzy as work

    return work(str(source), name, out, plugin)
