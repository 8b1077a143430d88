"""``torquebench video``: the film of a stored run, or one picture of it; and the film that a config asks for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from torquebench.cli.app import command
from torquebench.cli.parameters import File, Number, Words, Wrong, argument, check_out, option, out_file, refuse
from torquebench.cli.run_folder import read_run
from torquebench.cli.terminal import complain, progress_bar, say, table, tell, warn
from torquebench.errors import Problem, TorquebenchError

if TYPE_CHECKING:
    from torquebench.experiment.run import ExperimentResult
    from torquebench.experiment.schema import Video
    from torquebench.video.film import Film
    from torquebench.video.job import Footage

FILMS = (".mp4", ".webp")
COLUMNS = ("backend", "quality", "size", "camera", "speed", "frames", "seconds", "at")
"""Facts of a film or a picture that the table shows."""


class Size(click.ParamType[tuple[int, int]]):
    """Width and height of a frame."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return the two numbers."""
        width, _, height = str(value).partition("x")
        if not (width.isdecimal() and height.isdecimal() and len(str(value)) < 14):
            raise Wrong(got=f"'{value}'", wanted="WIDTHxHEIGHT, for example 640x480")
        return int(width), int(height)


@command(example="torquebench video runs/one --speed 0.5")
@argument("run", type=File(folders=True), metavar="RUN", help="folder that `run` left")
@option(
    "--quality",
    shell_complete=lambda context, parameter, typed: [word for word in ("fast", "pretty") if word.startswith(typed)],
    help="fast, or pretty: with shadows, many times as slow (default fast)",
)
@option("--size", type=Size(), metavar="WIDTHxHEIGHT", help="of a frame, even numbers (default 640x480)")
@option("--speed", type=Number(float), help="simulated seconds in one second (default 1)")
@option("--camera", help="a camera of the arm, by name (default: its first)")
@option("--controllers", type=Words(), metavar="NAME,NAME", help="those to show, in this order (default: all)")
@option("--exaggerate", type=Number(float), metavar="FACTOR", help="draw the position error this many times as large")
@option("--sound", is_flag=True, help="play the torque that chatters, of one controller in each ear")
@option("--ears", type=Words(), metavar="NAME,NAME", help="those to hear, left and right (default: the first two)")
@option("--still", type=Number(float), metavar="SECONDS", help="one picture of this time, PNG; needs --out")
@out_file(help="file to write: .mp4, .webp (loops, silent), or .png of a picture (default: RUN/video.mp4)")
@click.pass_obj
def video(
    gl: str | None,
    /,
    run: Path,
    controllers: Sequence[str] | None,
    still: float | None,
    out: Path | None,
    **settings: Any,
) -> int:
    """Make the film of a stored run.

    Nothing is simulated: the film shows the stored trajectories, one panel for each controller.
    """
    if still is not None and out is None:
        refuse([Problem("--still", wanted="--out FILE as well, for the picture")])
    if still is not None and not still >= 0.0:
        refuse([Problem("--still", got=f"{still:g}", wanted="a time of the run [s]")])
    check_out(out)
    _check_suffix(out, still is not None, bool(settings["sound"] or settings["ears"]))
    from torquebench.experiment.store import atomic_write, check_run
    from torquebench.video.film import FILM, keep_film, model_changed, read_footage
    from torquebench.video.job import check_settings

    manifest = read_run(run, "video", lambda folder: check_run(folder, leave_out=(FILM,)))
    footage = read_run(run, "video", lambda folder: read_footage(folder, controllers or ()))
    if still is not None and still > footage.duration:
        wanted = f"a time of the run, 0 to {footage.duration:g} s"
        refuse([Problem("--still", got=f"{still:g}", wanted=wanted)])
    if model_changed(footage, manifest):
        warn(f"torquebench: the file of '{footage.model}' has changed since the run; the film shows it as it is now")
    chosen = check_settings({key: value for key, value in settings.items() if value is not None}, footage)
    film = _draw(footage, chosen, gl, "" if out is None else out.suffix.lower(), still)
    if out is None:
        path = keep_film(run, film)
    else:
        path = out
        atomic_write(path, film.content)
    _announce(path, film)
    facts = {key: film.facts[key] for key in COLUMNS if key in film.facts}
    cells = [" x ".join(map(str, x)) if isinstance(x, list | tuple) else str(x) for x in facts.values()]
    say("\n" + table(list(facts), [cells]))
    return 0


def _check_suffix(out: Path | None, picture: bool, sound: bool) -> None:
    """Refuse a file whose name promises another format than is written, and sound for what is silent."""
    endings, what = ((".png",), "a picture of --still is PNG") if picture else (FILMS, "a film is MP4 or WebP")
    suffix = ".mp4" if out is None else out.suffix.lower()
    if suffix not in endings:
        other = "" if picture else " (one picture: --still SECONDS --out FILE.png)"
        ending = f"a name that ends in {' or '.join(endings)}: {what} and nothing else{other}"
        refuse([Problem("--out", got=str(out), wanted=ending)])
    if sound and suffix != ".mp4":
        refuse([Problem("--sound", text=f"{suffix} is silent", wanted="a film, .mp4")])


def _draw(footage: Footage, settings: Video, gl: str | None, suffix: str = "", still: float | None = None) -> Film:
    """Make a film, or one picture, with a progress bar."""
    from torquebench.video.film import make_film

    with progress_bar(0, "frame", "looking for what draws") as bar:

        def report(done: int, total: int) -> None:
            bar.total = total
            bar.describe("film")
            bar.update(1)

        return make_film(footage, settings, gl, suffix=suffix or ".mp4", still=still, progress=report)


def _announce(path: Path, film: Film) -> None:
    """Say what was made, what drew it and why, and what to install for a better one."""
    facts = film.facts
    tell(film=facts | {"file": path})
    is_film = "frames" in facts
    size = f"{facts['frames']} frames, {facts['seconds']:g} s" if is_film else f"t = {facts['at']:g} s"
    say(f"{'film' if is_film else 'picture'}: {path} ({size}; drawn by {facts['backend']}: {facts['reason']})")
    if sound := facts.get("sound"):
        ears = zip(("left", "right"), sound["rms_over_limit"], strict=True)
        heard = ", ".join(f"{side} {sound[side]} {100.0 * rms:.3g} %" for side, rms in ears)
        say(
            f"sound: {heard} of the torque limit: RMS above {sound['from_hz']:g} Hz of the loudest joint in the whole "
            "run, the jolt of its start too; chattering in the tables is the mean of all joints, from metrics_from on"
        )
    if film.advice:
        warn(f"torquebench: drawn as a stick figure; for the whole arm: {film.advice}")


def film_of_run(result: ExperimentResult, folder: Path, gl: str | None) -> None:
    """Make the film that a run's config asks for, and show it on the run's page; report and record a failure.

    Args:
        result: The run, whose folder is finished.
        folder: Its folder.
        gl: The user's MUJOCO_GL.
    """
    from torquebench.experiment.folder import read_result
    from torquebench.report.run import rewrite_page
    from torquebench.video.film import keep_failure, keep_film, read_footage

    keys = result.experiment.video
    if keys is None:
        return
    try:
        film = _draw(read_footage(folder), keys, gl)
        _announce(keep_film(folder, film), film)
        rewrite_page(folder, read_result(folder))
    except Exception as error:  # noqa: BLE001  whatever it is, the run is complete without its film
        tell(film={"failed": str(error)})
        complain(f"torquebench: the run is complete, its film failed: {error}")
        try:
            keep_failure(folder, str(error))
        except (TorquebenchError, OSError) as worse:
            complain(f"torquebench: nor could that be recorded: {worse}")
