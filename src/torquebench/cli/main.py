"""Entry point: arguments, exit codes, and errors as lines instead of tracebacks."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torquebench
from torquebench.cli.ending import Ending, guarded
from torquebench.cli.options import Parser, add_common, frame_size, joint_list, name_list
from torquebench.cli.signals import terminable
from torquebench.cli.terminal import emit, speaking

SHELLS = ("bash", "zsh", "fish")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = Parser(
        prog="torquebench",
        allow_abbrev=False,
        description="Compare torque laws for robot arms on a plant that an analytic model agrees with to round-off.",
        epilog="Exit status: 0 done and every check held; 1 a run failed unexpectedly or a check did not hold; "
        "2 bad input, nothing written; 3 disk or internal error; 130 interrupted; 143 terminated. "
        "Every command has --quiet and --json. Example: torquebench run configs/paper/fig9-chattering.yaml",
    )
    top.add_argument("--version", action="version", version=f"torquebench {torquebench.__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="run one experiment: every controller in it, side by side")
    run.add_argument("config", type=Path, nargs="?", help="experiment, a YAML file")
    run.add_argument("--from-sweep", type=Path, metavar="DIR", help="run one row of a sweep again instead")
    run.add_argument("--index", type=int, metavar="K", help="number of that row, from 0")
    run.add_argument("--out", type=Path, help="folder for the results, new or empty (default: runs/NAME-UTC)")
    run.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="change one key, for example --set run.duration=2 or --set controllers.band.gains.phi=0.1",
    )
    run.add_argument(
        "--plugin",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="Python file that registers laws of your own with @controller",
    )
    run.add_argument("--no-figures", action="store_true", help="write numbers only: no figures, no film")

    compare = commands.add_parser(
        "compare",
        help="two models or plants: where do they differ, and in which term",
        description="A and B are mujoco:MODEL, analytic:MODEL[:STRUCTURE[:CONSTANTS]] or FILE.xml, for example "
        "mujoco:puma560 and analytic:puma560:corrected:printed.",
    )
    compare.add_argument("a", metavar="A")
    compare.add_argument("b", metavar="B")
    compare.add_argument("--states", type=int, default=1000, help="random states (default 1000)")
    compare.add_argument("--seed", type=int, default=0, help="seed of the states (default 0)")
    compare.add_argument(
        "--frozen-joints",
        type=joint_list,
        default=[],
        metavar="J,J",
        help="joints held at zero position and speed, counted from 1, for example 4,5,6",
    )
    compare.add_argument(
        "--tolerance",
        type=float,
        default=1e-12,
        help="relative difference that still counts as agreement (default 1e-12)",
    )
    compare.add_argument(
        "--rollout",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="also compare closed loops of this length on both plants (default: none)",
    )

    fuzzy = commands.add_parser(
        "fuzzy",
        help="a fuzzy system: how it is evaluated, what is odd about it, and its figures",
        description="Describe and draw the fuzzy systems of a config, or a built-in one (pd-49, pd-25, pd-9, s-7).",
    )
    fuzzy.add_argument("source", metavar="CONFIG", help="experiment, a YAML file, or the name of a built-in system")
    fuzzy.add_argument("--name", help="the only system of the file to describe (default: all)")
    fuzzy.add_argument("--out", type=Path, help="folder for the figures, new or empty (default: runs/fuzzy-NAME-UTC)")
    fuzzy.add_argument("--oracle", action="store_true", help="compare with scikit-fuzzy on a grid of inputs")
    fuzzy.add_argument(
        "--plugin",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="Python file that registers laws which the config uses",
    )

    sweep = commands.add_parser(
        "sweep",
        help="many runs of one experiment: grids and random draws over any of its keys",
        description="Run every case of a file's section `sweep` in every draw for every controller, and store a table "
        "of their metrics. The work is estimated and shown first.",
    )
    sweep.add_argument("config", type=Path, nargs="?", help="experiment with a section `sweep`, a YAML file")
    sweep.add_argument("--out", type=Path, help="folder for the results, new or empty (default: runs/NAME-UTC)")
    sweep.add_argument("--resume", type=Path, metavar="DIR", help="go on with the sweep in this folder")
    sweep.add_argument("--workers", type=int, help="how many run (default: one per core)")
    sweep.add_argument("--executor", choices=["processes", "threads"], help="what the workers are (default: processes)")
    sweep.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run on a Dask cluster: tcp://HOST:PORT or tls://HOST:PORT "
        "of its scheduler; local or local:N makes one here",
    )
    sweep.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="change one key, for example --set sweep.draws=10 or --set run.duration=2",
    )
    sweep.add_argument(
        "--plugin",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="Python file that registers laws of your own with @controller",
    )
    sweep.add_argument("--no-cap", action="store_true", help="start whatever it takes")
    sweep.add_argument("--dry-run", action="store_true", help="check and estimate only")
    sweep.add_argument("--no-figures", action="store_true", help="tables, summary and page only: no figures")

    paper = commands.add_parser(
        "paper",
        help="the paper's Figs 9 to 11 and a verdict on each of its claims",
        description="Run everything that the paper's claims rest on, on both plants, and judge each claim.",
    )
    paper.add_argument("--out", type=Path, help="folder for the results, new or empty (default: runs/paper-UTC)")
    paper.add_argument("--quick", action="store_true", help="few draws: for a look, and for continuous integration")
    paper.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="threads (default: one per core)")

    layer = commands.add_parser(
        "boundary-layer",
        help="what a boundary layer costs: error against chattering",
        description="Run configs/paper/boundary-layer.yaml over a grid of phi, k and lambda, and draw the front.",
    )
    layer.add_argument("--out", type=Path, help="folder for the results (default: runs/boundary-layer-UTC)")
    layer.add_argument("--quick", action="store_true", help="few draws")
    layer.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="threads (default: one per core)")

    report = commands.add_parser(
        "report",
        help="the page of a stored run or sweep again, or several runs side by side",
        description="Nothing is simulated: everything comes from the stored trajectories.",
    )
    report.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="folder that `run` or `sweep` left")
    report.add_argument(
        "--out", type=Path, metavar="FILE", help="page to write (default: RUN/report.html; comparison.html for several)"
    )
    report.add_argument("--redraw", action="store_true", help="draw the figures again from the trajectories")
    report.add_argument(
        "--plugin",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="Python file that registers laws which the runs use",
    )

    video = commands.add_parser(
        "video",
        help="the film of a stored run",
        description="Nothing is simulated: the film shows the stored trajectories, one panel for each controller.",
    )
    video.add_argument("run", type=Path, metavar="RUN", help="folder that `run` left")
    video.add_argument("--quality", default="fast", help="fast, or pretty: with shadows, many times as slow")
    video.add_argument(
        "--size",
        type=frame_size,
        default=(640, 480),
        metavar="WIDTHxHEIGHT",
        help="of a frame, even numbers (default 640x480)",
    )
    video.add_argument("--speed", type=float, default=1.0, help="simulated seconds in one second (default 1)")
    video.add_argument("--camera", help="a camera of the arm, by name (default: its first)")
    video.add_argument(
        "--controllers",
        type=name_list,
        default=[],
        metavar="NAME,NAME",
        help="those to show, in this order (default: all)",
    )
    video.add_argument("--still", type=float, metavar="SECONDS", help="one picture of this time, PNG; needs --out")
    video.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write, .mp4, or .png of a picture (default: RUN/video.mp4)"
    )

    view = commands.add_parser(
        "view",
        help="replay a stored run, to look at it from all sides",
        description="Nothing is simulated. MuJoCo's viewer where a window opens, else a page in the browser, served to "
        "this machine alone until Ctrl-C.",
    )
    view.add_argument("run", type=Path, metavar="RUN", help="folder that `run` left")
    view.add_argument(
        "--controllers",
        type=name_list,
        default=[],
        metavar="NAME,NAME",
        help="those to show, in this order (default: all)",
    )
    showing_options(view)

    check = commands.add_parser(
        "check",
        help="contract test of your own laws: what the loop relies on, and whether they can be compiled",
        description="Try every law that FILE registers with @controller, on two arms and on both paths.",
    )
    check.add_argument("file", metavar="FILE", type=Path, help="Python file of laws, as for --plugin")
    check.add_argument("--law", metavar="NAME", help="the only law of the file to try (default: all)")

    bench = commands.add_parser(
        "bench",
        help="speed against peers, as ratios within one run",
        description="Time the closed loop, MuJoCo's open loop and other ways to write the same, in turn, many times.",
    )
    bench.add_argument("--markdown", action="store_true", help="print the table as Markdown, with what each row is")
    bench.add_argument("--quick", action="store_true", help="short runs, few rounds")
    bench.add_argument("--rounds", type=int, help="how often each case is timed (default 15, with --quick 3)")
    bench.add_argument("--threads", type=int, default=2, help="threads of the largest case (default 2)")

    commands.add_parser(
        "doctor",
        help="versions, what can draw films here, threads, caches, and what to install",
        description="Try everything that depends on the machine. The exit status is 0 whatever is found.",
    )

    completion = commands.add_parser(
        "completion", help="a script that completes commands, options and values in a shell"
    )
    completion.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")

    add_common(commands.choices)
    return top


def showing_options(command: argparse.ArgumentParser) -> None:
    """Add the options of what shows a motion."""
    command.add_argument("--browser", action="store_true", help="in the browser, even where a window opens")
    command.add_argument("--no-open", action="store_true", help="print the page's address; do not open the browser")
    command.add_argument("--speed", type=float, help="simulated seconds in one second, to begin with (default 1)")
    command.add_argument("--port", type=int, help="port of the page, for a tunnel (default: a free one)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    words = sys.argv[1:] if arguments is None else list(arguments)
    options, ending = argparse.Namespace(command=None), Ending()
    # what --quiet and --json mean for a mistake in the arguments themselves
    with speaking("--quiet" in words, "--json" in words) as voice:

        def work() -> int:
            parser().parse_args(words, options)
            voice.quiet, voice.as_json = options.quiet, options.json is True
            with without_opengl() as options.gl, terminable(), contextlib.ExitStack() as stack:
                if voice.as_json:  # whatever a plug-in prints is no part of the document
                    stack.enter_context(contextlib.redirect_stdout(sys.stderr))
                return dispatch(options)

        def conclude() -> int:
            from torquebench.cli.document import document

            emit(document(options.command, status, ending.problems, ending.error, voice))
            return status

        status = guarded(work, ending)
        return guarded(conclude, Ending()) if voice.as_json else status


@contextlib.contextmanager
def without_opengl() -> Iterator[str | None]:
    """Take MUJOCO_GL out of the environment for as long as this context lasts; yield what it was.

    With it set and its library absent MuJoCo cannot even be imported. Only the processes that draw need it.
    """
    wish = os.environ.pop("MUJOCO_GL", None)
    try:
        yield wish
    finally:
        if wish is not None:
            os.environ["MUJOCO_GL"] = wish


def dispatch(options: argparse.Namespace) -> int:
    """Run the chosen command and return its exit status."""
    if options.command == "run":
        from torquebench.cli.run import run

        return run(options)
    if options.command == "view":
        from torquebench.cli.view import view

        return view(options)
    if options.command == "sweep":
        from torquebench.cli.sweep import sweep

        return sweep(options)
    if options.command == "video":
        from torquebench.cli.video import video

        return video(options)
    if options.command == "doctor":
        from torquebench.cli.doctor import doctor

        return doctor(options.gl)
    if options.command == "fuzzy":
        from torquebench.cli.fuzzy import fuzzy

        return fuzzy(options.source, options.name, options.out, options.plugin, options.oracle)
    if options.command == "check":
        from torquebench.cli.check import check

        return check(options.file, options.law)
    if options.command == "bench":
        from torquebench.cli.bench import bench

        return bench(options)
    if options.command == "boundary-layer":
        from torquebench.cli.boundary_layer import boundary_layer

        return boundary_layer(options)
    if options.command == "report":
        from torquebench.cli.report import report

        return report(options.runs, options.out, options.plugin, options.redraw)
    if options.command == "completion":
        from torquebench.cli.completion import completion

        return completion(options.shell, parser())
    if options.command == "paper":
        from torquebench.cli.paper import paper

        return paper(options)
    from torquebench.cli.compare import compare

    return compare(options)
