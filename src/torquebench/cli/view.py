"""``torquebench view`` and ``run --live``: MuJoCo's viewer where a window opens, else a page in the browser."""

from __future__ import annotations

import argparse
import os
import secrets
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from torquebench.cli.run_folder import read_run
from torquebench.cli.showing import Showing
from torquebench.cli.terminal import answer, complain, say, tell, warn
from torquebench.errors import ConfigError, Problem, VideoError
from torquebench.experiment.build import Loop
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import check_run
from torquebench.sim.result import Motion
from torquebench.sim.trajectory import Trajectory, load_trajectory
from torquebench.video.child import run_module
from torquebench.video.job import Job, Shot
from torquebench.video.settings import Settings
from torquebench.video.stored import model_changed, read_footage
from torquebench.view.feed import Feed
from torquebench.view.live import Live, PageSubject, feed_stored
from torquebench.view.server import HOST, Server

NOBODY, COLLECTING = 30.0, 10.0
"""After a live run: how long a first visitor is waited for, and how long one may take to get the rest [s]."""
SILENCE = 60.0
"""Longest time that a window may say nothing [s]."""
TRIAL = 30.0
"""Longest time that opening a hidden window may take [s]."""


def view(options: argparse.Namespace) -> int:
    """Replay a stored run until the window is closed or the user interrupts; return 0.

    Args:
        options: Arguments of the command; see ``torquebench view --help``.

    Raises:
        ConfigError: bad arguments.
        ModelError: there is no such arm any more.
    """
    how = Showing.of(options)
    manifest = read_run(options.run, "view", check_run)
    footage = read_run(options.run, "view", lambda folder: read_footage(folder, options.controllers))
    if model_changed(footage, manifest):
        warn(f"torquebench: the file of '{footage.model}' has changed since the run; it is shown as it is now")
    try:
        if window_opens(how):
            job = Job(
                footage.model,
                footage.title,
                footage.shots,
                footage.control_period,
                Settings(speed=how.speed),
                "window",
                "",
            )
            say("MuJoCo's viewer: space to pause, arrows to step, enter for the next controller")
            if show_window(job):
                return 0
        feed = Feed()
        controllers = tuple((shot.name, shot.note) for shot in footage.shots)
        runs = [load_trajectory(shot.trajectory) for shot in footage.shots]
        shown = PageSubject(footage.title, footage.model, footage.control_period, controllers)
        with served(feed, how):
            feed_stored(feed, shown, runs, colours(), how.speed)
            say("Ctrl-C ends it")
            flush()
            threading.Event().wait()
    except KeyboardInterrupt:
        say()
    return 0


def window_opens(how: Showing) -> bool:
    """Return whether a window opens here and is wanted; say why not where there is a display all the same."""
    if how.browser:
        return False
    try:
        found = run_module("torquebench.view.display", "", "off", TRIAL)
        ok, why = bool(found.get("ok")), str(found.get("why", ""))
    except VideoError as error:
        ok, why = False, f"its trial {error}"
    if not ok:
        say(f"in the browser, as no window opens here ({why})")
    return ok


def show_window(job: Job) -> bool:
    """Replay in MuJoCo's viewer until it is closed; return whether that worked, and say why not."""
    try:
        told = run_module("torquebench.view.window", job.to_json(), "glfw", SILENCE)
    except VideoError as error:
        told = {"failed": f"MuJoCo's viewer {error}"}
    if "failed" in told:
        complain(f"torquebench: {told['failed']}")
    return "failed" not in told


@contextmanager
def served(feed: Feed, how: Showing) -> Iterator[Server]:
    """Serve a feed, say where, and open the browser there.

    Args:
        feed: What is served.
        how: Port, and whether to open the browser.

    Raises:
        ConfigError: the port is taken.
    """
    try:
        server = Server(feed, secrets.token_urlsafe(16), how.port)
    except OSError as error:
        raise ConfigError([Problem("--port", "", f"{HOST}:{how.port} cannot be used ({error.strerror})")]) from error
    with server:
        tell(address=server.address)
        answer(f"view: {server.address}")
        flush()
        if how.open_it and browser_is_graphical():
            webbrowser.open(server.address)
        yield server


class Audience(NamedTuple):
    """What a run in progress tells those who watch it."""

    watch: Callable[[str, int, Motion], None] | None
    """As of `run_experiment`."""
    finished: Callable[[str, Trajectory], None]
    """As of `run_experiment`; the trajectory has been stored."""


@contextmanager
def watching(experiment: Experiment, loop: Loop, folder: Path, how: Showing) -> Iterator[Audience]:
    """Show an experiment's runs while they are simulated; leave when those who watch have what they need.

    In the browser the motion is shown as it is simulated. A window shows each controller from when its run is stored.

    Args:
        experiment: What is run.
        loop: Its objects.
        folder: Where its trajectories are being stored.
        how: The user's choices.
    """
    names, period = [keys.name for keys in experiment.controllers], experiment.run.control_period
    if window_opens(how):
        shots = tuple(Shot(name, "", "", str((folder / name / "trajectory.npz").resolve())) for name in names)
        job = Job(experiment.plant.model, experiment.name, shots, period, Settings(speed=how.speed), "window", "")
        window = threading.Thread(target=show_window, args=(job,), daemon=True)
        window.start()
        yield Audience(None, lambda name, trajectory: None)
        say("the run is complete; close the window to end")
        flush()
        try:
            window.join()
        except KeyboardInterrupt:  # the run is complete all the same
            say()
        return
    feed = Feed()
    subject = PageSubject(
        experiment.name, experiment.plant.model, period, tuple((keys.name, keys.law) for keys in experiment.controllers)
    )
    with served(feed, how):
        with Live(feed, subject, loop.reference.q, colours(), how.speed) as live:
            yield Audience(live.watch, live.finished)
        linger(feed, folder)


def linger(feed: Feed, folder: Path) -> None:
    """Wait, not for ever, until a page has everything: it goes on without this process then."""
    if not feed.visited.is_set():
        say(f"nobody has opened the page; waiting {NOBODY:g} s for it (Ctrl-C: not at all)")
        flush()
    try:
        if feed.visited.wait(NOBODY):
            feed.taken.wait(COLLECTING)
    except KeyboardInterrupt:
        say()
    say(f"again: torquebench view {folder}")


def colours() -> Sequence[str]:
    """Return the colours of joints, those of the figures."""
    from torquebench.analysis.style import COLOURS

    return COLOURS


def browser_is_graphical() -> bool:
    """Return whether opening a browser would not take over this terminal."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def flush() -> None:
    """Let what was said be read now: the command goes on."""
    if sys.stdout is not None:
        sys.stdout.flush()
