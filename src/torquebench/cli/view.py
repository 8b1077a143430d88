"""``torquebench view``: replay a stored run in MuJoCo's viewer if a window opens, otherwise in the browser."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import webbrowser
from contextlib import ExitStack

from torquebench.cli.run_folder import read_run
from torquebench.cli.terminal import answer, complain, say, tell, warn
from torquebench.errors import ConfigError, Problem, VideoError
from torquebench.experiment.store import check_run
from torquebench.sim.trajectory import load_trajectory
from torquebench.video.child import run_module
from torquebench.video.job import Job
from torquebench.video.settings import FASTEST, SLOWEST, Settings
from torquebench.video.stored import Footage, model_changed, read_footage
from torquebench.view.replay import replay_json
from torquebench.view.server import HOST, serve

SILENCE = 60.0
"""Longest time that the window's process may send nothing [s]."""
TRIAL = 30.0
"""Longest time that opening a hidden window may take [s]."""


def view(options: argparse.Namespace) -> int:
    """Replay a stored run until the window is closed or the user interrupts; return 0.

    Args:
        options: Arguments of the command; see ``torquebench view --help``.

    Raises:
        ConfigError: bad arguments.
        ModelError: the arm no longer exists.
    """
    speed, port = options.speed or 1.0, options.port or 0
    check_options(options.speed, port)
    manifest = read_run(options.run, "view", check_run)
    footage = read_run(options.run, "view", lambda folder: read_footage(folder, options.controllers))
    if model_changed(footage, manifest):
        warn(f"torquebench: the file of '{footage.model}' has changed since the run; it is shown as it is now")
    in_browser = options.browser or options.no_open or port > 0
    try:
        if not in_browser and window_opens() and show_window(footage, speed):
            return 0
        serve_page(footage, speed, port, open_browser=not options.no_open)
    except KeyboardInterrupt:
        say()
    return 0


def check_options(speed: float | None, port: int) -> None:
    """Refuse an impossible speed or port.

    Args:
        speed: Value of ``--speed``; None if it was not given.
        port: Value of ``--port``; 0 for a free one.

    Raises:
        ConfigError: at least one is impossible; all are listed.
    """
    problems = []
    if speed is not None and not SLOWEST <= speed <= FASTEST:
        problems.append(Problem("--speed", "", f"got {speed:g}, wanted {SLOWEST:g} to {FASTEST:g}"))
    if not 0 <= port <= 65535:
        problems.append(Problem("--port", "", f"got {port}, wanted 1 to 65535, or 0 for a free one"))
    if problems:
        raise ConfigError(problems)


def window_opens() -> bool:
    """Try to open a hidden window; if it fails, say why the browser is used instead."""
    try:
        reply = run_module("torquebench.view.display", "", "off", TRIAL)
        opens, why = bool(reply.get("ok")), str(reply.get("why", ""))
    except VideoError as error:
        opens, why = False, f"its trial {error}"
    if not opens:
        say(f"in the browser, as no window opens here ({why})")
    return opens


def show_window(footage: Footage, speed: float) -> bool:
    """Replay a run in MuJoCo's viewer until it is closed; return whether that worked, and say why if it did not.

    Args:
        footage: The run.
        speed: Simulated seconds shown in one second.
    """
    job = Job(footage.model, footage.title, footage.shots, footage.control_period, Settings(speed=speed), "window", "")
    say("MuJoCo's viewer: space to pause, arrows to step, enter for the next controller")
    try:
        reply = run_module("torquebench.view.window", job.to_json(), "glfw", SILENCE)
    except VideoError as error:
        reply = {"failed": f"MuJoCo's viewer {error}"}
    if "failed" in reply:
        complain(f"torquebench: {reply['failed']}")
    return "failed" not in reply


def serve_page(footage: Footage, speed: float, port: int, open_browser: bool) -> None:
    """Serve the replay page, print its address, open the browser, and wait for an interrupt.

    Args:
        footage: The run.
        speed: Simulated seconds shown in one second at the start.
        port: Port of the page; 0 for a free one.
        open_browser: Whether to open the browser where that does not take over the terminal.

    Raises:
        ConfigError: the port is taken.
        KeyboardInterrupt: always, in the end.
    """
    from torquebench.analysis.style import COLOURS

    runs = [load_trajectory(shot.trajectory) for shot in footage.shots]
    replay = replay_json(footage, runs, COLOURS, speed)
    with ExitStack() as stack:
        try:
            address = stack.enter_context(serve(replay, port))
        except OSError as error:
            raise ConfigError([Problem("--port", "", f"{HOST}:{port} cannot be used ({error.strerror})")]) from error
        tell(address=address)
        answer(f"view: {address}")
        say("Ctrl-C ends it")
        if sys.stdout is not None:
            sys.stdout.flush()
        has_display = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if open_browser and has_display:
            webbrowser.open(address)
        threading.Event().wait()
