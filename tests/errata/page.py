"""`docs/errata.md`, put together from computed numbers, parsed formulas and the sentences of `prose.py`."""

from __future__ import annotations

from pathlib import Path

from . import page_effects as effects
from . import page_equations as equations
from .layout import reflow

PATH = Path(__file__).resolve().parents[2] / "docs" / "errata.md"

PARTS = (
    equations.head,
    equations.kinematics,
    equations.mass,
    equations.coriolis,
    equations.centrifugal,
    equations.gravity,
    effects.controller,
    effects.together,
    effects.dropped,
    effects.constants,
    effects.itself,
    effects.notation,
)


def build() -> str:
    """Return the whole page."""
    blocks = "\n\n".join(part().strip() for part in PARTS).split("\n\n")
    return "\n\n".join(map(reflow, blocks)) + "\n"
