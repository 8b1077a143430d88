"""What the process that draws is told: a film of a stored run, as plain values that travel as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from torquebench.video.settings import Settings

APART = "   "
"""Between the parts of a note."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One controller of a film."""

    name: str
    note: str
    """Headline figures and law, parts that are `APART`."""
    ending: str
    """How and when the run failed; empty if it completed."""
    trajectory: str
    """Path of its stored samples."""


@dataclass(frozen=True, slots=True)
class Job:
    """A film, or one picture of it."""

    model: str
    """Name of the arm."""
    title: str
    shots: tuple[Shot, ...]
    control_period: float
    """Time between samples [s]."""
    settings: Settings
    backend: str
    """What draws: ``egl``, ``osmesa`` and so on, or ``stick``."""
    out: str
    """File to write."""
    still: float | None = None
    """Time of the one picture to make instead of a film [s]."""

    def to_json(self) -> str:
        """Return the job as JSON."""
        return json.dumps(asdict(self))


def job_from(text: str) -> Job:
    """Read a job from its JSON."""
    data: dict[str, Any] = json.loads(text)
    settings = data["settings"]
    settings["size"] = tuple(settings["size"])
    return Job(**data | {"shots": tuple(Shot(**shot) for shot in data["shots"]), "settings": Settings(**settings)})
