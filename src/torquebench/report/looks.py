"""The look of each controller, in figures, pages and films alike: hue is its law, lightness its place in that law."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from zlib import crc32

HUES = {
    "smc": "#D55E00",
    "linear-band-smc": "#0072B2",
    "fuzzy-linear-band-smc": "#009E73",
    "computed-torque": "#CC79A7",
    "pid": "#E69F00",
    "pd": "#56B4E9",
    "super-twisting": "#665533",
    "pd-gravity": "#882255",
}
"""Law -> its colour wherever it occurs: Okabe and Ito's, readable for the colour-blind, with a wine red for their
yellow, which is lost on white, and an olive brown. Every other law has one of these that is free."""
DASHES: tuple[tuple[float, ...], ...] = ((), (5.0, 1.6), (6.0, 1.4, 1.2, 1.4), (1.4, 1.2), (9.0, 2.0))
"""Lengths of stroke and gap, in turn [line widths]; none for a solid line."""
SERIES = ("#4818F0", "#86B300", "#784860", "#A8A8F0", "#486000", "#C0A890", "#7830A8")
"""Colours of what is no controller: joints, terms of a variable."""
DARKEST, LIGHTEST = 0.33, 0.74
"""CIE lightness / 100 between which a law's controllers are: all are seen on white and on a dark page."""


class Look(NamedTuple):
    """Colour and dash of a line."""

    colour: str
    """``#RRGGBB``."""
    dash: tuple[float, ...]
    """As one of `DASHES`."""


def looks(laws: Mapping[str, str]) -> dict[str, Look]:
    """Return the look of each controller of an experiment; no two have the same colour.

    A law keeps its hue from one experiment to the next as far as the laws of each can be kept apart, whatever their
    order. A lone controller of a law, and the first of two, have the law's own colour; more go from dark to light, and
    so do laws that share a hue because there are more than eight.

    Args:
        laws: Controller -> name of its law.
    """
    hues = _hues(set(laws.values()))
    sharing: dict[int, list[str]] = {}
    for name, law in laws.items():
        sharing.setdefault(hues[law], []).append(name)
    bases = list(HUES.values())
    return {
        name: Look(
            _shades(bases[hue], len(sharing[hue]))[sharing[hue].index(name)],
            DASHES[(hue + sharing[hue].index(name)) % len(DASHES)],
        )
        for name, law in laws.items()
        for hue in [hues[law]]
    }


def series_colour(place: int) -> str:
    """Return the colour of a joint, or of something else that is no controller, by its place."""
    return SERIES[place % len(SERIES)]


def _hues(laws: set[str]) -> dict[str, int]:
    """Give each law the place of its hue: its own, or the first free one after a place that its name determines."""
    found = {law: place for place, law in enumerate(HUES) if law in laws}
    for law in sorted(laws - set(HUES)):
        start = crc32(law.encode())
        places = [(start + step) % len(HUES) for step in range(len(HUES))]
        used = list(found.values())
        found[law] = min(places, key=used.count)
    return found


def _shades(colour: str, count: int) -> list[str]:
    """Return shades of a colour for controllers of one law."""
    if count <= 2:
        own = _lightness(_parts(colour))
        farther = DARKEST if own - DARKEST > LIGHTEST - own else LIGHTEST
        return [colour, _shade(colour, farther)][:count]
    return [_shade(colour, DARKEST + k / (count - 1) * (LIGHTEST - DARKEST)) for k in range(count)]


def _shade(colour: str, lightness: float) -> str:
    """Mix a colour with black or white until it has a CIE lightness, given from 0 to 1."""
    base = _parts(colour)
    end = 1.0 if _lightness(base) < lightness else 0.0
    low, high = 0.0, 1.0
    for _ in range(16):
        part = 0.5 * (low + high)
        mixed = [x + part * (end - x) for x in base]
        low, high = (part, high) if (_lightness(mixed) < lightness) == (end == 1.0) else (low, part)
    return "#" + "".join(f"{round(255.0 * x):02X}" for x in mixed)


def _parts(colour: str) -> list[float]:
    return [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]


def _lightness(rgb: list[float]) -> float:
    """Return the CIE lightness of an sRGB colour, 0 to 1."""
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in rgb]
    y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return 1.16 * y ** (1.0 / 3.0) - 0.16 if y > 0.008856 else 9.033 * y
