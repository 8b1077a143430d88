"""What a frame says around the views: names, time, torque against its limits, error and sliding variable."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_rgb

from torquebench.kernel import Array, IntArray
from torquebench.report.figures import style
from torquebench.sim.trajectory import Trajectory
from torquebench.video.job import APART
from torquebench.video.layout import NOTE, Box, Layout, layout
from torquebench.video.settings import FPS
from torquebench.video.text import Colour, Pixels, blend, curve_cover, fill, fitted, folded, write
from torquebench.video.timeline import Timeline, ranges

WINDOW = 1.5
"""Time that a trace shows, in the film's own seconds."""
PAPER, INK, FAINT, TRACK = (255, 255, 255), (30, 32, 38), (120, 124, 132), (230, 233, 237)
HEADER, HEADER_INK, ALARM = (38, 44, 54), (245, 247, 250), (200, 30, 30)
PLAIN = 10.6
"""Height of a note's font, in units of a layout [px]."""
JOINTS: tuple[Colour, ...] = tuple(
    tuple(round(255 * part) for part in to_rgb(colour))  # type: ignore[misc]
    for colour in style.COLOURS
)


class Clip(NamedTuple):
    """One controller of a film."""

    name: str
    note: str
    """As of `Shot`."""
    run: Trajectory
    ending: str
    """How and when the run failed; empty if it completed."""


class _Bars(NamedTuple):
    """Torque over its limit while each frame is shown, each (F, n)."""

    low: Array
    high: Array
    mean: Array


class _Trace(NamedTuple):
    """Envelope of a signal in each column of the film, each (columns, n) [px from the top]; None without signal."""

    low: Array
    high: Array


def layout_for(clips: Sequence[Clip], width: int, height: int) -> Layout:
    """Divide a frame such that the controllers' notes are seen whole. Arguments as of `layout`."""
    tried = (layout(len(clips), width, height, notes) for notes in itertools.count(1))
    return next(where for where in tried if max(len(note_lines(clip, where)) for clip in clips) <= where.notes)


def note_lines(clip: Clip, where: Layout) -> list[str]:
    """Return a controller's note in as many lines as its panel needs."""
    return folded(clip.note.split(APART), APART, round(PLAIN * where.unit), where.panels[0].title.width)


class Overlay:
    """Draws everything but the views.

    Args:
        clips: The controllers.
        where: The frame.
        frames: The film.
        title: What the header says.
        joint_names: Names of the joints, n of them.
        units: Unit of each joint's position, ``rad`` or ``m``.
        tau_max: Torque limits, (n,) [N m].
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        where: Layout,
        frames: Timeline,
        title: str,
        joint_names: Sequence[str],
        units: Sequence[str],
        tau_max: Array,
    ) -> None:
        self._clips, self._where, self._frames = clips, where, frames
        self._small, self._plain, self._large = (round(size * where.unit) for size in (9.6, PLAIN, 13.0))
        samples = frames.samples()
        self._bars = [_bars(clip.run.tau / tau_max, samples) for clip in clips]
        box = where.panels[0].traces
        self._step = max(1, round(box.width / (WINDOW * FPS)))
        unit = "/".join(dict.fromkeys(units))
        errors = [clip.run.q_ref - clip.run.q for clip in clips]
        self._labels, self._traces = [], []
        for values, what, per in ((errors, "error e", ""), ([clip.run.s for clip in clips], "sliding s", "/s")):
            label, traces = self._scaled(values, what, unit + per)
            self._labels.append(label)
            self._traces.append(traces)
        self._paper = self._background(title, joint_names)

    def frame(self, i: int, views: Sequence[Pixels]) -> Pixels:
        """Return frame `i` around the controllers' views."""
        pixels = self._paper.copy()
        header, unit = self._where.header, self._where.unit
        speed = "" if self._frames.speed == 1.0 else f"   {self._frames.speed:g}x"
        now = self._frames.time(i)
        write(
            pixels,
            header.width - 8 * unit,
            header.height - 8 * unit,
            f"t = {now:6.2f} s{speed}",
            self._large,
            HEADER_INK,
            anchor="right",
        )
        for panel, clip, view, bars in zip(self._where.panels, self._clips, views, self._bars, strict=True):
            box = panel.view
            pixels[box.y : box.y + box.height, box.x : box.x + box.width] = view
            self._draw_bars(pixels, panel.bars, bars, i)
            if clip.ending and now >= clip.run.t[-1]:
                middle, low = box.x + box.width / 2, box.y + box.height
                fill(pixels, box.x, low - 24 * unit, box.x + box.width, low, ALARM, 0.85)
                text = fitted(clip.ending, self._large, box.width - 8 * unit)
                write(pixels, middle, low - 7 * unit, text, self._large, PAPER, anchor="centre")
        for half, traces in enumerate(self._traces):
            for panel, trace in zip(self._where.panels, traces, strict=True):
                if trace is not None:
                    self._draw_trace(pixels, _half(panel.traces, half), trace, i * self._step)
        return pixels

    def _scaled(self, values: Sequence[Array], what: str, unit: str) -> tuple[str, list[_Trace | None]]:
        """Return the label of a signal, with the range that all controllers share, and its envelopes in pixels."""
        seen = [y if np.isfinite(y).any() else None for y in values]
        good = [y for y, clip in zip(seen, self._clips, strict=True) if y is not None and not clip.ending]
        bad = [y for y, clip in zip(seen, self._clips, strict=True) if y is not None and clip.ending]
        _, high = style.limits([*good, *(-y for y in good)], [*bad, *(-y for y in bad)])  # symmetric
        top = high / 1.12  # without the margin, which the box has
        prefix = style.choose_unit(top, unit)
        box = _half(self._where.panels[0].traces, 0)
        middle, scale = box.height / 2.0, (box.height / 2.0 - 2.0) / top
        samples = self._frames.samples(self._step)
        envelopes: list[_Trace | None] = []
        for y in seen:
            if y is None:
                envelopes.append(None)
                continue
            least, most = ranges(y, samples)
            upper, lower = middle - scale * most, middle - scale * least
            # neighbouring columns touch, so that the curve has no gaps
            upper[1:], lower[1:] = np.fmin(upper[1:], lower[:-1]), np.fmax(lower[1:], upper[:-1])
            ended = np.isnan(most)
            upper[ended], lower[ended] = np.nan, np.nan
            envelopes.append(_Trace(np.clip(upper, 0, box.height), np.clip(lower, 0, box.height)))
        label = f"{what}  ±{top * prefix.factor:.3g} {prefix.name}" if good or bad else what
        return label, envelopes

    def _background(self, title: str, joint_names: Sequence[str]) -> Pixels:
        """Draw what is the same in every frame."""
        where, unit = self._where, self._where.unit
        pixels = np.full((where.height, where.width, 3), 255, np.uint8)
        fill(pixels, 0, 0, where.width, where.header.height, HEADER)
        room = where.width - 150 * unit
        heading = fitted(title, self._large, room, bold=True)
        write(pixels, 8 * unit, where.header.height - 8 * unit, heading, self._large, HEADER_INK, bold=True)
        for panel, clip in zip(where.panels, self._clips, strict=True):
            box = panel.title
            name = fitted(clip.name, self._large, box.width, bold=True)
            write(pixels, box.x, box.y + 14 * unit, name, self._large, INK, bold=True)
            for i, line in enumerate(note_lines(clip, where)):
                write(pixels, box.x, box.y + (27 + NOTE * i) * unit, line, self._plain, FAINT)
            if box.x > where.width // len(where.panels) // 2:
                fill(pixels, panel.view.x - 1.5, box.y, panel.view.x - 0.5, where.height, TRACK)
            self._label_bars(pixels, panel.bars, joint_names)
            for half, label in enumerate(self._labels):
                self._frame_trace(pixels, _half(panel.traces, half), label)
        for half, traces in enumerate(self._traces):
            for panel, trace in zip(where.panels, traces, strict=True):
                if trace is None:
                    box = _half(panel.traces, half)
                    y = box.y + box.height / 2 + 4 * unit
                    write(pixels, box.x + box.width / 2, y, "has none", self._small, FAINT, anchor="centre")
        return pixels

    def _frame_trace(self, pixels: Pixels, box: Box, label: str) -> None:
        unit = self._where.unit
        write(pixels, box.x, box.y - 3 * unit, fitted(label, self._small, box.width), self._small, INK)
        fill(pixels, box.x, box.y, box.x + box.width, box.y + box.height, (246, 247, 249))
        fill(pixels, box.x, box.y + box.height / 2 - 0.5, box.x + box.width, box.y + box.height / 2 + 0.5, TRACK)

    def _draw_trace(self, pixels: Pixels, box: Box, trace: _Trace, end: int) -> None:
        width = min(box.width, end)
        if width <= 0:
            return
        shown, pen = slice(end - width, end), 0.55 * self._where.unit
        for j in range(trace.low.shape[1]):
            cover = curve_cover(trace.low[shown, j], trace.high[shown, j], box.height, pen)
            blend(pixels, box.x + box.width - width, box.y, cover, JOINTS[j % len(JOINTS)])

    def _rows(self, box: Box) -> tuple[float, float, float]:
        """Return where the first bar begins, the height of a row, and the left end of the bars."""
        n, unit = self._bars[0].mean.shape[1], self._where.unit
        top = 12 * unit
        room = 0.45 * box.width if box.width > 170 * unit else 12 * unit
        return box.y + top, min((box.height - top) / n, 18 * unit), box.x + room

    def _label_bars(self, pixels: Pixels, box: Box, joint_names: Sequence[str]) -> None:
        unit = self._where.unit
        top, row, left = self._rows(box)
        label = fitted("torque / limit", self._small, box.width)
        write(pixels, box.x, box.y + 6 * unit, label, self._small, INK)
        for j, name in enumerate(joint_names):
            y, colour = top + j * row, JOINTS[j % len(JOINTS)]
            if row >= 0.8 * self._small:
                text = name if left - box.x > 20 * unit else str(j + 1)
                text = fitted(text, self._small, left - box.x - 4 * unit)
                write(pixels, box.x, y + row / 2 + 0.36 * self._small, text, self._small, colour)
            right = box.x + box.width
            fill(pixels, left, y + 0.15 * row, right, y + 0.85 * row, TRACK)
            fill(pixels, (left + right) / 2 - 0.5, y + 0.1 * row, (left + right) / 2 + 0.5, y + 0.9 * row, FAINT)
            for x in (left, right):
                fill(pixels, x - 1, y + 0.1 * row, x + 1, y + 0.9 * row, FAINT)

    def _draw_bars(self, pixels: Pixels, box: Box, bars: _Bars, i: int) -> None:
        top, row, left = self._rows(box)
        right = box.x + box.width
        middle, scale = (left + right) / 2, (right - left) / 2
        for j in range(bars.mean.shape[1]):
            low, high, mean = bars.low[i, j], bars.high[i, j], bars.mean[i, j]
            if not np.isfinite(mean):
                continue
            y0, y1, colour = top + (j + 0.15) * row, top + (j + 0.85) * row, JOINTS[j % len(JOINTS)]
            fill(pixels, middle + scale * low, y0, middle + scale * high, y1, colour, 0.4)
            ends = sorted((middle, middle + scale * mean))
            fill(pixels, ends[0], y0 + 0.12 * row, ends[1], y1 - 0.12 * row, colour)
            for limit, reached in ((-1.0, low <= -1.0 + 1e-9), (1.0, high >= 1.0 - 1e-9)):
                if reached:
                    x = middle + scale * limit
                    fill(pixels, x - 1.5, y0 - 0.1 * row, x + 1.5, y1 + 0.1 * row, ALARM)


def _half(box: Box, half: int) -> Box:
    """Return the upper or the lower trace's own box, below its label."""
    label = round(0.26 * box.height / 2)
    high = box.height // 2
    return Box(box.x, box.y + half * high + label, box.width, high - label - 2)


def _bars(values: Array, samples: IntArray) -> _Bars:
    low, high = ranges(values, samples)
    mean = np.full_like(low, np.nan)
    inside = int(np.searchsorted(samples, len(values)))
    if inside:
        ends = np.append(samples[1:inside], len(values) if inside < len(samples) else samples[inside - 1] + 1)
        for i, (start, end) in enumerate(zip(samples[:inside], ends, strict=True)):
            mean[i] = values[start : max(end, start + 1)].mean(axis=0)
    return _Bars(np.clip(low, -1, 1), np.clip(high, -1, 1), np.clip(mean, -1, 1))
