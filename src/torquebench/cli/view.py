"""``torquebench view``: replay a stored run in MuJoCo's viewer if a window opens, otherwise in the browser."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from torquebench.cli.app import command
from torquebench.cli.parameters import File, Number, Words, argument, option, refuse
from torquebench.cli.run_folder import read_run
from torquebench.cli.terminal import answer, say, settle, tell, warn
from torquebench.errors import VideoError

if TYPE_CHECKING:
    from torquebench.video.job import Footage

SILENCE = 60.0
"""Longest time that the window's process may send nothing [s]."""


@command(example="torquebench view runs/one --browser")
@argument("run", type=File(folders=True), metavar="RUN", help="folder that `run` left")
@option("--controllers", type=Words(), metavar="NAME,NAME", help="those to show, in this order (default: all)")
@option("--browser", is_flag=True, help="in the browser, even where a window opens")
@option("--no-open", is_flag=True, help="print the page's address; do not open the browser")
@option("--speed", type=Number(float, 0.001, 1000), help="simulated seconds in one second, at first (default 1)")
@option("--port", type=Number(int, 0, 65535), help="port of the page, for a tunnel (default: a free one)")
def view(
    run: Path,
    controllers: Sequence[str] | None,
    browser: bool,
    no_open: bool,
    speed: float | None,
    port: int | None,
) -> int:
    """Replay a stored run, to look at it from all sides.

    MuJoCo's viewer is used where a window opens, else the run's page in the browser, served to this machine alone until
    Ctrl-C.
    """
    from torquebench.experiment.store import MANIFEST, check_run
    from torquebench.report.render import PAGE
    from torquebench.video.film import model_changed, read_footage

    manifest = read_run(run, "view", check_run)
    footage = read_run(run, "view", lambda folder: read_footage(folder, controllers or ()))
    if not (run / PAGE).is_file():
        refuse([("RUN", f"{run} has no {PAGE}: torquebench report {run} writes it")])
    window = not (browser or no_open or port)
    if window and model_changed(footage, manifest):
        warn(f"torquebench: the file of '{footage.model}' has changed since the run; it is shown as it is now")
    chosen = {"play": "", "speed": speed and f"{speed:g}", "show": controllers and ",".join(controllers)}
    asked = urlencode({key: value for key, value in chosen.items() if value is not None}, safe=",")
    try:
        if window and _show_window(footage, speed or 1.0):
            return 0
        files = {name: run / name for name in (*manifest["files"], MANIFEST)}
        _serve_page((run / PAGE).read_bytes(), files, asked, port or 0, open_browser=not no_open)
    except KeyboardInterrupt:
        say()
    return 0


def _show_window(footage: Footage, speed: float) -> bool:
    """Replay a run in MuJoCo's viewer until it is closed; return whether that worked, and say why if it did not."""
    from torquebench.experiment.schema import Video
    from torquebench.video.job import Job
    from torquebench.video.process import CrashedError, answers

    shown = answers("torquebench.view.window", Job(footage, Video(speed=speed)), "glfw", SILENCE)
    try:
        next(shown, None)
        settle()
        say("MuJoCo's viewer: space to pause, arrows to step, enter for the next controller")
        for _ in shown:
            continue  # it is still open
    except VideoError as error:
        why = f"MuJoCo's viewer {error}" if isinstance(error, CrashedError) else error
        say(f"in the browser, as no window opens here ({why})")
        return False
    return True


def _serve_page(page: bytes, files: Mapping[str, Path], chosen: str, port: int, open_browser: bool) -> None:
    """Serve a run's page, print its address, open the browser, and wait for an interrupt.

    Args:
        page: The page.
        files: As of `serve`.
        chosen: What the page is to do, the part of its address after #.
        port: As of `serve`.
        open_browser: Whether to open the browser.
    """
    from torquebench.view.server import HOST, serve

    with ExitStack() as stack:
        try:
            address = f"{stack.enter_context(serve(page, port, files))}#{chosen}"
        except OSError as error:
            refuse([("--port", f"{HOST}:{port} cannot be used ({error.strerror})")])
        settle()
        tell(address=address)
        answer(f"view: {address}")
        say("Ctrl-C ends it")
        if sys.stdout is not None:
            sys.stdout.flush()
        has_display = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if open_browser and has_display:
            import webbrowser

            webbrowser.open(address)
        threading.Event().wait()
