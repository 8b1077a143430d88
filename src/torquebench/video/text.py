"""Writing on pixels: text in matplotlib's own font, boxes, and curves, without a figure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from matplotlib import get_data_path
from matplotlib.ft2font import FT2Font

Pixels: TypeAlias = npt.NDArray[np.uint8]
"""(height, width, 3)."""
Colour: TypeAlias = tuple[int, int, int]


@lru_cache(maxsize=16)
def _font(size: int, bold: bool) -> FT2Font:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    font = FT2Font(str(Path(get_data_path(), "fonts", "ttf", name)))
    font.set_size(float(size), 72.0)
    return font


@lru_cache(maxsize=1024)
def glyphs(text: str, size: int, bold: bool = False) -> tuple[npt.NDArray[np.uint8], int]:
    """Return the coverage of a line of text, (h, w), and how many of its rows lie below the baseline.

    Args:
        text: One line.
        size: Height of the font [px].
        bold: Whether it is bold.
    """
    font = _font(size, bold)
    font.set_text(text)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.array(font.get_image()), round(font.get_descent() / 64.0)


def write(
    pixels: Pixels,
    x: float,
    y: float,
    text: str,
    size: int,
    colour: Colour = (30, 30, 35),
    *,
    bold: bool = False,
    anchor: Literal["left", "centre", "right"] = "left",
) -> None:
    """Write a line of text; what would leave the picture is cut off.

    Args:
        pixels: Picture; changed in place.
        x: Where the anchor is [px].
        y: Row of the baseline [px].
        text: One line.
        size: Height of the font [px].
        colour: Red, green and blue, 0 to 255.
        bold: Whether it is bold.
        anchor: Which end of the text is at `x`.
    """
    if not text:
        return
    mask, below = glyphs(text, size, bold)
    left = round(x - {"left": 0.0, "centre": 0.5, "right": 1.0}[anchor] * mask.shape[1])
    blend(pixels, left, round(y) + below - mask.shape[0], mask.astype(np.float32) / 255.0, colour)


def fitted(text: str, size: int, width: float, bold: bool = False) -> str:
    """Return as much of a text as fits in `width` pixels, with dots for the rest.

    Args:
        text: One line.
        size: Height of the font [px].
        width: Room [px].
        bold: Whether it is bold.
    """
    if not text or glyphs(text, size, bold)[0].shape[1] <= width:
        return text
    for end in range(len(text) - 1, 0, -1):
        shorter = text[:end].rstrip() + "…"
        if glyphs(shorter, size, bold)[0].shape[1] <= width:
            return shorter
    return ""


def folded(parts: Sequence[str], between: str, size: int, width: float) -> list[str]:
    """Return parts of a text in lines of at most `width` pixels; a part too long is broken after hyphens, or cut.

    Args:
        parts: What is kept together where it fits.
        between: What is written between two parts of a line.
        size: Height of the font [px].
        width: Room [px].
    """
    lines: list[str] = []
    for part in parts:
        whole = fitted(part, size, width) == part
        for i, piece in enumerate([part] if whole else re.split(r"(?<=-)", part)):
            longer = (between if i == 0 else "").join([*lines[-1:], piece])
            if lines and (whole or i > 0) and fitted(longer, size, width) == longer:
                lines[-1] = longer
            else:
                lines.append(fitted(piece, size, width))
    return lines


def fill(pixels: Pixels, x0: float, y0: float, x1: float, y1: float, colour: Colour, opacity: float = 1.0) -> None:
    """Fill a box; edges between pixels are smooth.

    Args:
        pixels: Picture; changed in place.
        x0, y0, x1, y1: Left, top, right and bottom [px].
        colour: Red, green and blue, 0 to 255.
        opacity: 1 hides what was there.
    """
    left, top = int(np.floor(x0)), int(np.floor(y0))
    across = np.arange(left, int(np.ceil(x1)), dtype=np.float32)
    down = np.arange(top, int(np.ceil(y1)), dtype=np.float32)
    wide = np.clip(np.minimum(across + 1.0, x1) - np.maximum(across, x0), 0.0, 1.0)
    high = np.clip(np.minimum(down + 1.0, y1) - np.maximum(down, y0), 0.0, 1.0)
    blend(pixels, left, top, (opacity * np.outer(high, wide)).astype(np.float32), colour)


def blend(pixels: Pixels, left: int, top: int, cover: npt.NDArray[np.float32], colour: Colour) -> None:
    """Paint `colour` where `cover`, (h, w) from 0 to 1, says, with its corner at a pixel.

    Args:
        pixels: Picture; changed in place.
        left, top: Upper left corner; may lie outside.
        cover: How much of each pixel is painted.
        colour: Red, green and blue, 0 to 255.
    """
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + cover.shape[1], pixels.shape[1]), min(top + cover.shape[0], pixels.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    part = cover[y0 - top : y1 - top, x0 - left : x1 - left, None]
    under = pixels[y0:y1, x0:x1]
    under[:] = (under + part * (np.array(colour, dtype=np.float32) - under) + 0.5).astype(np.uint8)


def curve_cover(
    low: npt.NDArray[np.float64], high: npt.NDArray[np.float64], rows: int, pen: float
) -> npt.NDArray[np.float32]:
    """Return how much of each pixel the envelope of a curve covers, (rows, columns).

    Args:
        low, high: Top and bottom of the envelope in each column [px from the top], NaN for none.
        rows: Height of the picture [px].
        pen: Half the width of the line [px].
    """
    y = np.arange(rows, dtype=np.float64)[:, None]
    covered = np.minimum(y + 1.0, high + pen) - np.maximum(y, low - pen)
    return np.asarray(np.clip(np.nan_to_num(covered), 0.0, 1.0), dtype=np.float32)
