"""``torquebench video``: the film of a stored run, or one picture of it; and the film that a config asks for."""

from __future__ import annotations

import argparse
from pathlib import Path

from torquebench.cli.options import check_out
from torquebench.cli.run_folder import read_run
from torquebench.cli.terminal import complain, progress_bar, say, table, tell, warn
from torquebench.errors import ConfigError, Problem, TorquebenchError
from torquebench.experiment.folder import read_result
from torquebench.experiment.run import ExperimentResult
from torquebench.experiment.store import atomic_write, check_run
from torquebench.report.run import rewrite_page
from torquebench.video.film import FILM, Made, keep_failure, keep_film, make_film
from torquebench.video.settings import Settings
from torquebench.video.stored import Footage, model_changed, read_footage

SHOWN = ("backend", "quality", "size", "camera", "speed", "frames", "seconds", "at")
"""What the table says of a film or a picture."""


def video(options: argparse.Namespace) -> int:
    """Make the film of a stored run; return 0.

    Args:
        options: Arguments of the command; see ``torquebench video --help``.

    Raises:
        ConfigError: bad arguments; nothing has been written.
        VideoError: it cannot be made.
    """
    settings = Settings(options.quality, options.size, options.speed, options.camera)
    if options.still is not None and options.out is None:
        raise ConfigError([Problem("--still", "", "wanted --out FILE as well, for the picture")])
    if options.still is not None and not options.still >= 0.0:
        raise ConfigError([Problem("--still", "", f"got {options.still:g}, wanted a time of the run [s]")])
    check_out(options.out)
    check_ending(options.out, options.still is not None)
    manifest = read_run(options.run, "video", lambda folder: check_run(folder, leave_out=(FILM,)))
    footage = read_run(options.run, "video", lambda folder: read_footage(folder, options.controllers))
    if options.still is not None and options.still > footage.duration:
        message = f"got {options.still:g}, wanted a time of the run, 0 to {footage.duration:g} s"
        raise ConfigError([Problem("--still", "", message)])
    if model_changed(footage, manifest):
        warn(f"torquebench: the file of '{footage.model}' has changed since the run; the film shows it as it is now")
    made = film(footage, settings, options.gl, options.still)
    if options.out is None:
        path = keep_film(options.run, made)
    else:
        path = options.out
        atomic_write(path, made.content)
    announce(path, made)
    shown = {key: made.facts[key] for key in SHOWN if key in made.facts}
    say("\n" + table(list(shown), [[_text(value) for value in shown.values()]]))
    return 0


def check_ending(out: Path | None, picture: bool) -> None:
    """Refuse a file whose name promises another format than is written.

    Args:
        out: The file; None for the film of the run's folder.
        picture: Whether one picture is made, not a film.

    Raises:
        ConfigError: the name ends otherwise.
    """
    wanted, what = (".png", "a picture of --still is PNG") if picture else (".mp4", "a film is MP4")
    if out is not None and out.suffix.lower() != wanted:
        other = "" if picture else " (one picture: --still SECONDS --out FILE.png)"
        message = f"got {out}, wanted a name that ends in {wanted}: {what} and nothing else{other}"
        raise ConfigError([Problem("--out", "", message)])


def _text(value: object) -> str:
    return " x ".join(str(part) for part in value) if isinstance(value, list | tuple) else str(value)


def film(footage: Footage, settings: Settings, gl: str | None, still: float | None = None) -> Made:
    """Make a film, or one picture, with a progress bar.

    Args:
        footage: What it is made of.
        settings: What it looks like.
        gl: The user's MUJOCO_GL.
        still: Time of the picture [s].
    """
    with progress_bar(0, "frame", "looking for what draws") as bar:

        def report(done: int, total: int) -> None:
            bar.total = total
            bar.set_description_str("film", refresh=False)
            bar.update(1)

        return make_film(footage, settings, gl, still=still, progress=report)


def announce(path: Path, made: Made) -> None:
    """Say what was made, what drew it and why, and what to install for a better one."""
    facts = made.facts
    tell(film=facts | {"file": path})
    what = f"{facts['frames']} frames, {facts['seconds']:g} s" if "frames" in facts else f"t = {facts['at']:g} s"
    say(
        f"{'film' if 'frames' in facts else 'picture'}: {path} ({what}; drawn by {facts['backend']}: {facts['reason']})"
    )
    if made.advice:
        warn(f"torquebench: drawn as a stick figure; for the whole arm: {made.advice}")


def film_of_run(result: ExperimentResult, folder: Path, gl: str | None) -> None:
    """Make the film that a run's config asks for, and show it on the run's page; a failure is told and recorded.

    Args:
        result: The run, whose folder is finished.
        folder: Its folder.
        gl: The user's MUJOCO_GL.
    """
    keys = result.experiment.video
    if keys is None:
        return
    try:
        made = film(read_footage(folder), Settings(keys.quality, keys.size, keys.speed, keys.camera), gl)
        announce(keep_film(folder, made), made)
        rewrite_page(folder, read_result(folder))
    except Exception as error:  # noqa: BLE001  whatever it is, the run stands as it is
        tell(film={"failed": str(error)})
        complain(f"torquebench: the run is complete, its film failed: {error}")
        try:
            keep_failure(folder, str(error))
        except (TorquebenchError, OSError) as worse:
            complain(f"torquebench: nor could that be recorded: {worse}")
