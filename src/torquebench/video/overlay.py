"""What surrounds the views in a frame: names, time, torques over their limits, errors and sliding variables."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from PIL import Image, ImageColor

from torquebench.kernel import Array, IntArray
from torquebench.report.figures import style
from torquebench.sim.trajectory import Trajectory
from torquebench.video.job import FPS, SEPARATOR, Shot
from torquebench.video.layout import NOTE, Box, Layout, Timeline, layout, ranges
from torquebench.video.paint import Colour, band, fill, fit, fold, write

WINDOW = 1.5
"""Time that a trace shows, in seconds of the film."""
PAPER, INK, FAINT, TRACK, PALE = (255, 255, 255), (30, 32, 38), (120, 124, 132), (230, 233, 237), (246, 247, 249)
HEADER, HEADER_INK, ALARM = (38, 44, 54), (245, 247, 250), (200, 30, 30)
SMALL, PLAIN, LARGE = 9.6, 10.6, 13.0
"""Heights of fonts, in units of a layout."""
JOINTS = tuple(cast(Colour, ImageColor.getrgb(colour)) for colour in style.COLOURS)


class _Bars(NamedTuple):
    """Torque over its limit while each frame is shown, each (frames, n)."""

    low: Array
    high: Array
    mean: Array


class _Trace(NamedTuple):
    """Envelope of a signal in each column of the whole film, each (columns, n) [px from the top of its box]."""

    upper: Array
    lower: Array


def layout_for(shots: Sequence[Shot], size: tuple[int, int]) -> Layout:
    """Divide a frame so that the controllers' notes fit.

    Args:
        shots: The controllers.
        size: Width and height of the frame [px].

    Raises:
        VideoError: panels would be too small to show anything.
    """
    for lines in itertools.count(1):
        where = layout(len(shots), *size, lines)
        if max(len(note_lines(shot, where)) for shot in shots) <= lines:
            break
    return where


def note_lines(shot: Shot, where: Layout) -> list[str]:
    """Return a controller's note in as many lines as its panel needs."""
    return fold(shot.note.split(SEPARATOR), SEPARATOR, round(PLAIN * where.unit), where.panels[0].title.width)


class Overlay:
    """Draws everything but the views.

    Args:
        shots: The controllers.
        runs: Their trajectories.
        where: The frame.
        timeline: The film's frames.
        title: Text of the header.
        joint_names: Names of the joints, n of them.
        units: Unit of each joint's position, ``rad`` or ``m``.
        tau_max: Torque limits, (n,) [N m].
    """

    def __init__(
        self,
        shots: Sequence[Shot],
        runs: Sequence[Trajectory],
        where: Layout,
        timeline: Timeline,
        title: str,
        joint_names: Sequence[str],
        units: Sequence[str],
        tau_max: Array,
    ) -> None:
        self._shots, self._runs, self._where, self._timeline = shots, runs, where, timeline
        self._small, self._plain, self._large = (round(size * where.unit) for size in (SMALL, PLAIN, LARGE))
        self._bars = [_bars(run.tau / tau_max, timeline.samples()) for run in runs]
        self._step = max(1, round(where.panels[0].traces.width / (WINDOW * FPS)))
        unit = "/".join(dict.fromkeys(units))
        self._signals = (
            self._scale("error e", unit, [run.q_ref - run.q for run in runs]),
            self._scale("sliding s", f"{unit}/s", [run.s for run in runs]),
        )
        self._background = self._draw_background(title, joint_names)

    def draw(self, i: int, views: Sequence[Image.Image]) -> Image.Image:
        """Return frame `i` around the controllers' views."""
        image, header, unit = self._background.copy(), self._where.header, self._where.unit
        speed = "" if self._timeline.speed == 1.0 else f"   {self._timeline.speed:g}x"
        now = self._timeline.time(i)
        text, right, baseline = f"t = {now:6.2f} s{speed}", header.width - 8 * unit, header.height - 8 * unit
        write(image, right, baseline, text, self._large, HEADER_INK, align="right")
        for k, panel in enumerate(self._where.panels):
            box, shot = panel.view, self._shots[k]
            image.paste(views[k], (box.x, box.y))
            self._draw_bars(image, panel.bars, self._bars[k], i)
            for half, (_, traces) in enumerate(self._signals):
                self._draw_trace(image, _half(panel.traces, half), traces[k], i * self._step)
            if shot.ending and now >= self._runs[k].t[-1]:
                bottom = box.y + box.height
                fill(image, box.x, bottom - 24 * unit, box.x + box.width, bottom, ALARM, 0.85)
                text, middle = fit(shot.ending, self._large, box.width - 8 * unit), box.x + box.width / 2
                write(image, middle, bottom - 7 * unit, text, self._large, PAPER, align="middle")
        return image

    def _scale(self, name: str, unit: str, values: Sequence[Array]) -> tuple[str, list[_Trace | None]]:
        """Return a signal's label, with the range that all controllers share, and its traces; None without signal."""
        seen = [y if np.isfinite(y).any() else None for y in values]
        good, bad = (
            [y for y, shot in zip(seen, self._shots, strict=True) if y is not None and bool(shot.ending) == failed]
            for failed in (False, True)
        )
        _, high = style.limits([*good, *(-y for y in good)], [*bad, *(-y for y in bad)])  # symmetric
        top = high / 1.12  # without the margin, which the box has
        prefix = style.choose_unit(top, unit)
        label = f"{name}  ±{top * prefix.factor:.3g} {prefix.name}" if good or bad else name
        return label, [None if y is None else self._trace(y, top) for y in seen]

    def _trace(self, values: Array, top: float) -> _Trace:
        """Return a signal's envelope in pixels; `top` is at the upper edge of its box."""
        height = _half(self._where.panels[0].traces, 0).height
        middle, scale = height / 2.0, (height / 2.0 - 2.0) / top
        least, most = ranges(values, self._timeline.samples(self._step))
        upper, lower = middle - scale * most, middle - scale * least
        ended = np.isnan(most)
        # neighbouring columns touch, so that the curve has no gaps
        upper[1:], lower[1:] = np.fmin(upper[1:], lower[:-1]), np.fmax(lower[1:], upper[:-1])
        upper[ended], lower[ended] = np.nan, np.nan
        return _Trace(np.clip(upper, 0, height), np.clip(lower, 0, height))

    def _draw_background(self, title: str, joint_names: Sequence[str]) -> Image.Image:
        """Draw what is the same in every frame."""
        where, unit = self._where, self._where.unit
        image = Image.new("RGB", (where.width, where.height), PAPER)
        fill(image, 0, 0, where.width, where.header.height, HEADER)
        heading = fit(title, self._large, where.width - 150 * unit, bold=True)
        write(image, 8 * unit, where.header.height - 8 * unit, heading, self._large, HEADER_INK, bold=True)
        for k, (panel, shot) in enumerate(zip(where.panels, self._shots, strict=True)):
            box = panel.title
            name = fit(shot.name, self._large, box.width, bold=True)
            write(image, box.x, box.y + 14 * unit, name, self._large, INK, bold=True)
            for i, line in enumerate(note_lines(shot, where)):
                write(image, box.x, box.y + (27 + NOTE * i) * unit, line, self._plain, FAINT)
            if box.x > where.width // len(where.panels) // 2:
                fill(image, panel.view.x - 1.5, box.y, panel.view.x - 0.5, where.height, TRACK)
            self._label_bars(image, panel.bars, joint_names)
            for half, (label, traces) in enumerate(self._signals):
                self._label_trace(image, _half(panel.traces, half), label, traces[k])
        return image

    def _label_trace(self, image: Image.Image, box: Box, label: str, trace: _Trace | None) -> None:
        unit, middle, right = self._where.unit, box.y + box.height / 2, box.x + box.width
        write(image, box.x, box.y - 3 * unit, fit(label, self._small, box.width), self._small, INK)
        fill(image, box.x, box.y, right, box.y + box.height, PALE)
        fill(image, box.x, middle - 0.5, right, middle + 0.5, TRACK)
        if trace is None:
            text = "has none"
            write(image, box.x + box.width / 2, middle + 4 * unit, text, self._small, FAINT, align="middle")

    def _draw_trace(self, image: Image.Image, box: Box, trace: _Trace | None, end: int) -> None:
        if trace is None:
            return
        width = min(box.width, end)
        upper, lower = (side[end - width : end] for side in trace)
        x, pen = box.x + box.width - width, 0.55 * self._where.unit
        for j in range(upper.shape[1]):
            band(image, x, box.y, box.height, upper[:, j], lower[:, j], pen, JOINTS[j % len(JOINTS)])

    def _bar_rows(self, box: Box) -> tuple[float, float, float]:
        """Return where the first bar begins, the height of a row, and the left end of the bars."""
        n, unit = self._bars[0].mean.shape[1], self._where.unit
        top = 12 * unit
        room = 0.45 * box.width if box.width > 170 * unit else 12 * unit
        return box.y + top, min((box.height - top) / n, 18 * unit), box.x + room

    def _label_bars(self, image: Image.Image, box: Box, joint_names: Sequence[str]) -> None:
        unit, right = self._where.unit, box.x + box.width
        top, row, left = self._bar_rows(box)
        write(image, box.x, box.y + 6 * unit, fit("torque / limit", self._small, box.width), self._small, INK)
        for j, name in enumerate(joint_names):
            y, colour = top + j * row, JOINTS[j % len(JOINTS)]
            if row >= 0.8 * self._small:
                text = fit(name if left - box.x > 20 * unit else str(j + 1), self._small, left - box.x - 4 * unit)
                write(image, box.x, y + row / 2 + 0.36 * self._small, text, self._small, colour)
            fill(image, left, y + 0.15 * row, right, y + 0.85 * row, TRACK)
            for x, half in ((left, 1.0), ((left + right) / 2, 0.5), (right, 1.0)):
                fill(image, x - half, y + 0.1 * row, x + half, y + 0.9 * row, FAINT)

    def _draw_bars(self, image: Image.Image, box: Box, bars: _Bars, i: int) -> None:
        top, row, left = self._bar_rows(box)
        right = box.x + box.width
        middle, scale = (left + right) / 2, (right - left) / 2
        for j in range(bars.mean.shape[1]):
            low, high, mean = bars.low[i, j], bars.high[i, j], bars.mean[i, j]
            if not np.isfinite(mean):
                continue
            y0, y1, colour = top + (j + 0.15) * row, top + (j + 0.85) * row, JOINTS[j % len(JOINTS)]
            fill(image, middle + scale * low, y0, middle + scale * high, y1, colour, 0.4)
            start, end = sorted((middle, middle + scale * mean))
            fill(image, start, y0 + 0.12 * row, end, y1 - 0.12 * row, colour)
            for limit, reached in ((-1.0, low <= -1.0 + 1e-9), (1.0, high >= 1.0 - 1e-9)):
                if reached:
                    x = middle + scale * limit
                    fill(image, x - 1.5, y0 - 0.1 * row, x + 1.5, y1 + 0.1 * row, ALARM)


def _half(box: Box, half: int) -> Box:
    """Return the box of the upper or the lower trace, below its label."""
    label = round(0.26 * box.height / 2)
    high = box.height // 2
    return Box(box.x, box.y + half * high + label, box.width, high - label - 2)


def _bars(values: Array, samples: IntArray) -> _Bars:
    low, high = ranges(values, samples)
    mean = np.full_like(low, np.nan)
    inside = int(np.searchsorted(samples, len(values)))
    if inside:
        lengths = np.maximum(np.diff(samples[:inside], append=len(values)), 1)
        mean[:inside] = np.add.reduceat(values, samples[:inside], axis=0) / lengths[:, None]
        if inside == len(samples):  # the film ends with this sample
            mean[-1] = values[samples[-1]]
    return _Bars(*(np.clip(x, -1.0, 1.0) for x in (low, high, mean)))
