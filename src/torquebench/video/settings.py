"""What a film looks like: the choices a user has, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from torquebench.errors import ConfigError, Problem, did_you_mean
from torquebench.robot.library import camera_names

Quality: TypeAlias = Literal["fast", "pretty"]
QUALITIES: tuple[str, ...] = get_args(Quality)
FPS = 25
"""Frames a second: 40 ms, a whole number of the usual control periods."""
SLOWEST, FASTEST = 1e-3, 1e3
"""Simulated seconds shown in one second."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How a film is made."""

    quality: Quality = "fast"
    """``pretty`` has shadows and takes several times as long."""
    size: tuple[int, int] = (640, 480)
    """Width and height [px], even."""
    speed: float = 1.0
    """Simulated seconds shown in one second."""
    camera: str | None = None
    """Name of a camera of the arm; its first if None."""


def check_settings(settings: Settings, model: str) -> None:
    """Refuse settings that no film can have.

    Args:
        settings: The choices.
        model: Name of the arm, or path of its ``.xml`` file.

    Raises:
        ConfigError: some are impossible; all of them at once.
        ModelError: there is no such arm.
    """
    from torquebench.experiment.values import LARGEST_SIDE, LEAST_SIDE  # not where films are drawn: it is slow to load

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
        problems.append(
            ("--camera", f"{model} has no camera {settings.camera!r}{did_you_mean(settings.camera, names)}")
        )
    if problems:
        raise ConfigError([Problem(option, "", text) for option, text in problems])
