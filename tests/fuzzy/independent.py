"""Fuzzy inference written out a second time, for tests: the formulas here share nothing with the package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from torquebench.kernel import Array

PEAKS = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]) / 3.0
"""Of the seven triangles, whose half-width is 1/3."""


def triangle(x: Any, a: float, b: float, c: float) -> Any:
    """Return the membership of x in the triangle with feet a and c and peak b."""
    return np.maximum(0.0, np.minimum((np.asarray(x) - a) / (b - a), (c - np.asarray(x)) / (c - b)))


def exact_output(x: float, y: float, peaks: Array = PEAKS, table: Array | None = None, product: bool = False) -> float:
    """Return the centre of area of max-min on evenly spaced triangles, exact to rounding.

    The upper edge of the clipped triangles is a broken line. It is summed trapezium by trapezium between all the places
    where it can break: corners of triangles, ends of their clipped tops, and where a flank meets a flank or a top.

    Args:
        x, y: Inputs.
        peaks: Of the terms of both inputs and of the output.
        table: Index of each rule's consequent, -1 for none; clip(i + j) if left out.
        product: Whether AND is the product instead of the minimum.
    """
    n, h = len(peaks), float(peaks[1] - peaks[0])
    x, y = min(max(x, -1.0), 1.0), min(max(y, -1.0), 1.0)
    if table is None:
        i = np.arange(n)
        table = np.clip(i[:, None] + i - (n - 1) // 2, 0, n - 1)
    heights = np.zeros(n)
    first, second = (triangle(z, peaks - h, peaks, peaks + h) for z in (x, y))
    for i in np.flatnonzero(first):
        for j in np.flatnonzero(second):
            u, v = first[i], second[j]
            if table[i, j] >= 0:
                k = table[i, j]
                heights[k] = max(heights[k], u * v if product else min(u, v))
    tops = [h * (1.0 - w) for w in heights[heights > 0.0]]
    breaks = [p + s for p in peaks for s in (-h, 0.0, h, -h / 2.0, h / 2.0, *tops, *(-t for t in tops))]
    at = np.unique(breaks)
    edge = np.max([np.minimum(w, triangle(at, p - h, p, p + h)) for w, p in zip(heights, peaks, strict=True)], axis=0)
    low, high, a, b = edge[:-1], edge[1:], at[:-1], at[1:]
    area = float(np.sum((b - a) * (low + high) / 2.0))
    moment = float(np.sum((b - a) * (a * (2.0 * low + high) + b * (low + 2.0 * high)) / 6.0))
    return moment / area if area > 0.0 else 0.0


def brute_force(
    x: float,
    y: float,
    inputs: Sequence[Sequence[Sequence[float]]],
    outputs: Sequence[Sequence[float]],
    table: Array,
    aggregation: str,
    product: bool,
    gravity: bool,
    points: int,
) -> float:
    """Return the centre of the set that an aggregation gives, rule by rule and point by point; NaN of an empty set.

    Args:
        x, y: Inputs, in their own units.
        inputs: Triangles (a, b, c) of each input.
        outputs: Triangles of the output.
        table: Index of each rule's consequent, -1 for none.
        aggregation: Its name.
        product: Whether AND is the product instead of the minimum.
        gravity: Whether the rules' sets are added up (135) instead of joined as the aggregation says (136).
        points: Number of points of the output's universe.
    """
    u = np.linspace(min(t[0] for t in outputs), max(t[2] for t in outputs), points)
    sets = []
    for i, first in enumerate(inputs[0]):
        for j, second in enumerate(inputs[1]):
            if table[i, j] < 0:
                continue
            degrees = float(triangle(x, *first)), float(triangle(y, *second))
            w = degrees[0] * degrees[1] if product else min(degrees)
            mu = triangle(u, *outputs[table[i, j]])
            near_one = np.abs(mu - 1.0) < 1e-9
            sets.append(
                {
                    "max-min": np.minimum(w, mu),
                    "sum-min": np.minimum(w, mu),
                    "max-bounded-product": np.maximum(0.0, w + mu - 1.0),
                    "max-drastic-product": np.where(near_one, w, mu if abs(w - 1.0) < 1e-9 else 0.0),
                    "max-bounded-sum": np.minimum(1.0, w + mu),
                    "max-algebraic-sum": 1.0 - (1.0 - w) * (1.0 - mu),
                    "min-max": np.maximum(1.0 - w, mu),
                }[aggregation]
            )
    if gravity or aggregation == "sum-min":
        joined = np.sum(sets, axis=0)
    else:
        joined = np.min(sets, axis=0) if aggregation == "min-max" else np.max(sets, axis=0)
    h = u[1] - u[0]
    area = float(np.sum((joined[:-1] + joined[1:]) * h / 2.0))
    a, b = u[:-1], u[1:]
    moment = float(np.sum(h * (a * (2.0 * joined[:-1] + joined[1:]) + b * (joined[:-1] + 2.0 * joined[1:])) / 6.0))
    return moment / area if area > 1e-12 else np.nan
