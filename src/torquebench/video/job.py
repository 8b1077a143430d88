"""A film as plain values, which travel to the process that draws it: what it shows and how it looks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from torquebench.errors import ConfigError
from torquebench.experiment.groups import group_of, is_broken
from torquebench.experiment.schema import Video
from torquebench.experiment.source import document_of
from torquebench.experiment.values import Here

FPS = 25
"""Frames per second: one every 40 ms, a whole number of the usual control periods."""
SEPARATOR = "   "
"""Between the parts of a note."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One controller of a film."""

    name: str
    note: str
    """Headline metrics and law, with `SEPARATOR` between them."""
    trajectory: str
    """Path of its stored samples."""
    colour: str = "#808080"
    """As figures and pages have it."""


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
    chattering_from_hz: float = 0.0
    """Frequency from which the torque counts as chattering [Hz]."""
    path_from: float | None = None
    """Time at which a path of the tool begins [s]; None where the reference is none."""


@dataclass(frozen=True, slots=True)
class Job:
    """A film, or one picture of it."""

    footage: Footage
    settings: Video
    backend: str = ""
    """What draws: ``egl``, ``osmesa`` and so on, or ``stick``."""
    out: str = ""
    """File to write."""
    still: float | None = None
    """Time of the picture to make instead of a film [s]."""


def check_settings(settings: Mapping[str, Any], footage: Footage) -> Video:
    """Return the settings of a film.

    Args:
        settings: The user's choices, by the keys of a config's section `video`.
        footage: The run.

    Raises:
        ConfigError: some are impossible; all of them are listed, by the option for each.
        ModelError: there is no such arm.
    """
    document, group = document_of(settings), group_of(Video)
    values = group.values(document.root, Here(document, group))
    found = Video(**{key: value for key, value in values.items() if not is_broken(value)})
    for fault in found.mistakes(footage.model, [shot.name for shot in footage.shots]):
        document.add_fault(fault)
    from torquebench.video.layout import misfit

    text = misfit(len(footage.shots), found.size)
    if text and not document.found:
        document.add(("size",), text, wanted="a larger frame, or fewer --controllers")
    if document.found:
        problems = (problem for _, problem in document.found)
        raise ConfigError(replace(one, source=f"--{one.key.partition('[')[0]}", key="") for one in problems)
    return found
