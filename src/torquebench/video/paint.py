"""Text, boxes and curves on a Pillow image, with edges that may lie between pixels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from importlib.util import find_spec
from math import ceil, floor
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from torquebench.errors import VideoError
from torquebench.kernel import Array

Colour: TypeAlias = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
FINE = 4
"""Subdivisions of a pixel."""


@lru_cache(maxsize=16)
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return DejaVu Sans, which comes with matplotlib, `size` pixels high.

    Raises:
        VideoError: matplotlib is not installed.
    """
    package = find_spec("matplotlib")  # its folder; importing it would take longer than drawing a second of film
    if package is None or package.origin is None:
        raise VideoError("films need a font of matplotlib, which is not installed: pip install matplotlib")
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / name
    return ImageFont.truetype(str(path), size, layout_engine=ImageFont.Layout.BASIC)


def write(
    image: Image.Image,
    x: float,
    y: float,
    text: str,
    size: int,
    colour: Colour,
    *,
    bold: bool = False,
    align: Literal["left", "middle", "right"] = "left",
) -> None:
    """Write a line of text.

    Args:
        image: The picture; changed.
        x: Column of the text's left end, middle or right end [px].
        y: Row of its baseline [px].
        text: One line.
        size: Height of the font [px].
        colour: Its colour.
        bold: Whether it is bold.
        align: Which part of the text is at `x`.
    """
    ImageDraw.Draw(image).text((round(x), round(y)), text, colour, font(size, bold), anchor=align[0] + "s")


def fit(text: str, size: int, width: float, bold: bool = False) -> str:
    """Shorten a line of text to a width, with an ellipsis for the rest.

    Args:
        text: One line.
        size: Height of the font [px].
        width: Room [px].
        bold: Whether it is bold.
    """
    shapes = font(size, bold)
    if shapes.getlength(text) <= width:
        return text
    shorter = (text[:end].rstrip() + "…" for end in range(len(text) - 1, 0, -1))
    return next((line for line in shorter if shapes.getlength(line) <= width), "")


def fold(parts: Sequence[str], separator: str, size: int, width: float) -> list[str]:
    """Arrange parts of a text in lines; a part wider than a line is broken after hyphens, or shortened.

    Args:
        parts: What is kept together where it fits.
        separator: What is written between two parts of a line.
        size: Height of the font [px].
        width: Room [px].
    """
    lines: list[str] = []
    for part in parts:
        whole = fit(part, size, width) == part
        for i, piece in enumerate([part] if whole else re.split(r"(?<=-)", part)):
            longer = (separator if i == 0 else "").join([*lines[-1:], piece])
            if lines and (whole or i > 0) and fit(longer, size, width) == longer:
                lines[-1] = longer
            else:
                lines.append(fit(piece, size, width))
    return lines


def fill(image: Image.Image, x0: float, y0: float, x1: float, y1: float, colour: Colour, opacity: float = 1.0) -> None:
    """Fill a box.

    Args:
        image: The picture; changed.
        x0, y0, x1, y1: Left, top, right and bottom [px].
        colour: Its colour.
        opacity: 1 hides what was there.
    """
    left, top = floor(x0), floor(y0)
    a, b, c, d = (round(FINE * side) for side in (x0 - left, y0 - top, x1 - left, y1 - top))
    if c > a and d > b:
        mask = Image.new("L", (FINE * (ceil(x1) - left), FINE * (ceil(y1) - top)))
        ImageDraw.Draw(mask).rectangle((a, b, c - 1, d - 1), fill=round(255 * opacity))
        image.paste(colour, (left, top), mask.reduce(FINE))


def band(
    image: Image.Image, x: int, y: int, height: int, upper: Array, lower: Array, pen: float, colour: Colour
) -> None:
    """Draw the band between two curves.

    Args:
        image: The picture; changed.
        x, y: Upper left corner of the box that the curves are in [px].
        height: Its height [px].
        upper, lower: Curves, one value per column, NaN for none, (K,) [px from the top of the box].
        pen: How far the band reaches beyond the curves [px].
        colour: Its colour.
    """
    columns = np.flatnonzero(np.isfinite(upper) & np.isfinite(lower))
    if len(columns):
        above, below = FINE * (upper[columns] - pen), FINE * (lower[columns] + pen) - 1
        there, back = np.stack([columns, above], axis=1), np.stack([columns, below], axis=1)[::-1]
        outline = np.concatenate([there, back]).round().astype(int).ravel().tolist()
        mask = Image.new("L", (len(upper), FINE * height))
        ImageDraw.Draw(mask).polygon(outline, fill=255)
        image.paste(colour, (x, y), mask.reduce((1, FINE)))
