"""Text, boxes and curves on a Pillow image that is finer than what is shown, so that edges may lie between pixels."""

from __future__ import annotations

import textwrap
from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeAlias

import matplotlib
import numpy as np
from PIL import ImageDraw, ImageFont

from torquebench.kernel import Array

Colour: TypeAlias = tuple[int, ...]
"""Red, green, blue and, if it is translucent, alpha: 0 to 255."""
FINE = 2
"""Pixels that are drawn for each one shown, in each direction; positions and sizes here are in those shown [px]."""


@lru_cache(maxsize=64)
def font(size: float, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return DejaVu Sans, which comes with matplotlib, `size` high."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(matplotlib.get_data_path(), "fonts", "ttf", name)
    return ImageFont.truetype(str(path), FINE * size, layout_engine=ImageFont.Layout.BASIC)


def text_width(text: str, size: float, bold: bool = False) -> float:
    """Return how wide a line of text is in a font of a `size`, `bold` or not."""
    return font(size, bold).getlength(text) / FINE


def wrap(text: str, size: float, width: float, bold: bool = False) -> list[str]:
    """Divide text in lines that fit: at spaces, or where need be at hyphens and anywhere; nothing is cut.

    Args:
        text: The text.
        size: Height of the font.
        width: Greatest width of a line.
        bold: Whether it is bold.
    """
    for anywhere in (False, True):
        for most in range(len(text), 0, -1):
            lines = textwrap.wrap(text, most, break_on_hyphens=anywhere, break_long_words=anywhere)
            if all(text_width(line, size, bold) <= width for line in lines):
                return lines
    return [text]


def shrunk(text: str, size: float, width: float, bold: bool = False) -> float:
    """Return the height of a font, at most `size`, in which a line of `text`, `bold` or not, fits a `width`."""
    return size * min(1.0, width / max(text_width(text, size, bold), 1.0))


def write(
    draw: ImageDraw.ImageDraw,
    x: float,
    y: float,
    text: str,
    size: float,
    colour: Colour,
    *,
    bold: bool = False,
    align: Literal["left", "middle", "right"] = "left",
) -> None:
    """Write a line of text.

    Args:
        draw: Draws on the picture.
        x: Column of the text's left end, middle or right end.
        y: Row of its baseline.
        text: One line.
        size: Height of the font.
        colour: Its colour.
        bold: Whether it is bold.
        align: Which part of the text is at `x`.
    """
    draw.text((round(FINE * x), round(FINE * y)), text, colour, font(size, bold), anchor=align[0] + "s")


def fill(draw: ImageDraw.ImageDraw, x0: float, y0: float, x1: float, y1: float, colour: Colour) -> None:
    """Fill the box from `x0`, `y0` to `x1`, `y1` with a `colour`; `draw` draws on the picture."""
    left, top, right, bottom = (round(FINE * side) for side in (x0, y0, x1, y1))
    if right > left and bottom > top:
        draw.rectangle((left, top, right - 1, bottom - 1), fill=colour)


def band(draw: ImageDraw.ImageDraw, x: int, edges: Array, colour: Colour) -> None:
    """Fill the band between two curves with one value for each column of the picture, NaN for none.

    Args:
        draw: Draws on the picture.
        x: First of its columns, in pixels that are drawn.
        edges: Rows of the upper and the lower curve, (2, K).
        colour: Colour of the band.
    """
    columns = np.flatnonzero(np.isfinite(edges[0]))
    if len(columns):
        there, back = (np.stack([x + columns, FINE * edge[columns]], axis=1) for edge in edges)
        draw.polygon(np.concatenate([there, back[::-1]]).round().ravel().tolist(), fill=colour)
