"""A film as plain values, which travel to the process that draws it: what it shows and how it looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from torquebench.errors import ConfigError, Problem, did_you_mean
from torquebench.robot.library import camera_names

Quality: TypeAlias = Literal["fast", "pretty"]
QUALITIES: tuple[str, ...] = get_args(Quality)
FPS = 25
"""Frames per second: one every 40 ms, a whole number of the usual control periods."""
SLOWEST, FASTEST = 1e-3, 1e3
"""Range of the simulated seconds shown in one second."""
SEPARATOR = "   "
"""Between the parts of a note."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How a film looks."""

    quality: Quality = "fast"
    """``pretty`` has shadows and takes several times as long."""
    size: tuple[int, int] = (640, 480)
    """Width and height [px], even."""
    speed: float = 1.0
    """Simulated seconds shown in one second."""
    camera: str | None = None
    """Name of a camera of the arm; None for its first."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One controller of a film."""

    name: str
    note: str
    """Headline metrics and law, with `SEPARATOR` between them."""
    trajectory: str
    """Path of its stored samples."""


@dataclass(frozen=True, slots=True)
class Footage:
    """A stored run as a film or a replay needs it."""

    title: str
    model: str
    """Name of the arm, or path of its ``.xml`` file."""
    control_period: float
    """Time between samples [s]."""
    duration: float
    """Length of the run that the config asks for [s]."""
    shots: tuple[Shot, ...]


@dataclass(frozen=True, slots=True)
class Job:
    """A film, or one picture of it."""

    footage: Footage
    settings: Settings
    backend: str = ""
    """What draws: ``egl``, ``osmesa`` and so on, or ``stick``."""
    out: str = ""
    """File to write."""
    still: float | None = None
    """Time of the picture to make instead of a film [s]."""


def check_settings(settings: Settings, model: str) -> None:
    """Refuse settings that no film can have.

    Args:
        settings: The user's choices.
        model: Name of the arm, or path of its ``.xml`` file.

    Raises:
        ConfigError: some are impossible; all of them are listed.
        ModelError: there is no such arm.
    """
    from torquebench.experiment.schema import LARGEST_SIDE, LEAST_SIDE  # slow to load, and not needed to draw

    problems = []
    if settings.quality not in QUALITIES:
        problems.append(("--quality", f"got {settings.quality!r}, wanted {' or '.join(QUALITIES)}"))
    if any(not LEAST_SIDE <= side <= LARGEST_SIDE or side % 2 for side in settings.size):
        wanted = f"wanted even numbers from {LEAST_SIDE} to {LARGEST_SIDE}"
        problems.append(("--size", f"got {settings.size[0]}x{settings.size[1]}, {wanted}"))
    if not SLOWEST <= settings.speed <= FASTEST:
        problems.append(("--speed", f"got {settings.speed:g}, wanted {SLOWEST:g} to {FASTEST:g}"))
    names = camera_names(model)
    if settings.camera is not None and settings.camera not in names:
        hint = did_you_mean(settings.camera, names)
        problems.append(("--camera", f"{model} has no camera {settings.camera!r}{hint}"))
    if problems:
        raise ConfigError([Problem(option, "", text) for option, text in problems])
