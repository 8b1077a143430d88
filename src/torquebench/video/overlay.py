"""What surrounds the views in a frame: names, time, torques over their limits, errors and sliding variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.looks import SERIES
from torquebench.scene.look import Scene
from torquebench.sim.trajectory import Trajectory
from torquebench.video.job import FPS, SEPARATOR, Footage, Shot
from torquebench.video.layout import NOTE, Box, Layout, Timeline, layout, spans
from torquebench.video.paint import FINE, Colour, band, fill, fit, text_width, write

WINDOW = 1.5
"""Time that a trace shows, in seconds of the film."""
PEN = 0.55
"""Half the width of a trace, in units of a layout."""
PAPER, INK, FAINT, TRACK, PALE = (255, 255, 255), (30, 32, 38), (120, 124, 132), (230, 233, 237), (246, 247, 249)
HEADER, HEADER_INK, ALARM = (38, 44, 54), (245, 247, 250), (200, 30, 30)
BANNER, RANGE = 217, 102
"""How much of 255 the banner of a failed run and the range of a torque hide."""
SMALL, PLAIN, LARGE = 9.6, 10.6, 13.0
"""Heights of fonts, in units of a layout."""
NOTES = ((0, PLAIN), (1, PLAIN), (-1, PLAIN), (-1, 0.9 * PLAIN), (-1, 0.8 * PLAIN))
"""Ways to write notes, of which the first that fits is taken: how often the last part gets its own line, and font."""
JOINTS: tuple[Colour, ...] = tuple(ImageColor.getrgb(colour) for colour in SERIES)


class _Signal(NamedTuple):
    """A signal of all controllers."""

    label: str
    """Its name, and the range that all of them share."""
    traces: list[Array]
    """Upper and lower edge in each fine column of the whole film, (2, columns, n) [px below the top]; NaN for none."""


class _Notes(NamedTuple):
    """What is written below the controllers' names."""

    lines: list[list[str]]
    """Lines of each controller."""
    height: float
    """Height of their font [px]."""


def layout_for(shots: Sequence[Shot], size: tuple[int, int]) -> tuple[Layout, _Notes]:
    """Divide a frame so that the controllers' notes fit, and divide the notes in lines.

    Args:
        shots: The controllers.
        size: Width and height of the frame [px].

    Raises:
        VideoError: panels would be too small to show anything.
    """
    for splits, height in NOTES:
        lines = [shot.note.rsplit(SEPARATOR, splits) for shot in shots]
        where = layout(len(shots), *size, notes=max(map(len, lines)))
        notes = _Notes(lines, height * where.unit)
        width = where.panels[0].title.width
        if all(text_width(line, notes.height) <= width for note in lines for line in note):
            break
    return where, notes


class Overlay:
    """Draws everything but the views.

    Args:
        footage: The stored run.
        runs: Trajectories of its controllers.
        size: Width and height of the frame [px].
        timeline: The film's frames.
        scene: The arm.
    """

    def __init__(
        self, footage: Footage, runs: Sequence[Trajectory], size: tuple[int, int], timeline: Timeline, scene: Scene
    ) -> None:
        self._runs, self._timeline, self._joints = runs, timeline, scene.joints
        self.where, notes = layout_for(footage.shots, size)
        self._unit = self.where.unit
        self._small, self._large = self._unit * SMALL, self._unit * LARGE
        self._bars = [np.clip(spans(run.tau / scene.limits, timeline.samples()), -1.0, 1.0) for run in runs]
        self._step = max(1, round(FINE * self.where.panels[0].traces.width / (WINDOW * FPS)))
        self._signals = (
            self._signal("error e", scene.unit, [run.q_ref - run.q for run in runs]),
            self._signal("sliding s", f"{scene.unit}/s", [run.s for run in runs]),
        )
        self._background = self._draw_background(footage, notes, size)

    def draw(self, i: int, views: Sequence[Image.Image]) -> Image.Image:
        """Return frame `i` around the controllers' views, which are `FINE` times as large as their boxes."""
        image, header, unit = self._background.copy(), self.where.header, self._unit
        draw = ImageDraw.Draw(image, "RGBA")
        speed = "" if self._timeline.speed == 1.0 else f"   {self._timeline.speed:g}x"
        now = self._timeline.time(i)
        text, right, baseline = f"t = {now:6.2f} s{speed}", header.width - 8 * unit, header.height - 8 * unit
        write(draw, right, baseline, text, self._large, HEADER_INK, align="right")
        for k, (panel, run) in enumerate(zip(self.where.panels, self._runs, strict=True)):
            box = panel.view
            image.paste(views[k], (FINE * box.x, FINE * box.y))
            self._draw_bars(draw, panel.bars, self._bars[k][:, i])
            for half, signal in enumerate(self._signals):
                self._draw_trace(draw, _half(panel.traces, half), signal.traces[k], i * self._step)
            if run.ending and now >= run.t[-1]:
                bottom = box.y + box.height
                fill(draw, box.x, bottom - 24 * unit, box.x + box.width, bottom, (*ALARM, BANNER))
                text, middle = fit(run.ending, self._large, box.width - 8 * unit), box.x + box.width / 2
                write(draw, middle, bottom - 7 * unit, text, self._large, PAPER, align="middle")
        return image.reduce(FINE)

    def _signal(self, name: str, unit: str, values: Sequence[Array]) -> _Signal:
        """Scale a signal to the range that all controllers share, zero in the middle."""
        both = [(np.stack([y, -y]), run.completed) for y, run in zip(values, self._runs, strict=True)]
        limits = style.limits([y for y, completed in both if completed], [y for y, completed in both if not completed])
        top = limits[1] / 1.12  # without the margin, which the box has
        prefix = style.choose_unit(top, unit)
        seen = any(np.isfinite(y).any() for y in values)
        label = f"{name}  ±{top * prefix.factor:.3g} {prefix.name}" if seen else name
        return _Signal(label, [self._trace(y, top) for y in values])

    def _trace(self, values: Array, top: float) -> Array:
        """Return the edges of a trace; `top` is at the upper edge of its box."""
        height = _half(self.where.panels[0].traces, 0).height
        least, most, _ = spans(values, self._timeline.samples(self._step))
        upper, lower = (np.clip((height - (height - 4.0) * y / top) / 2.0, 0, height) for y in (most, least))
        # neighbouring columns touch, so that the curve has no gaps
        upper[1:], lower[1:] = np.minimum(upper[1:], lower[:-1]), np.maximum(lower[1:], upper[:-1])
        pen = PEN * self._unit
        edges: Array = np.clip([upper - pen, lower + pen], 0, height)
        return edges

    def _draw_background(self, footage: Footage, notes: _Notes, size: tuple[int, int]) -> Image.Image:
        """Draw what is the same in every frame."""
        where, unit, (width, height) = self.where, self._unit, size
        image = Image.new("RGB", (FINE * width, FINE * height), PAPER)
        draw = ImageDraw.Draw(image)
        fill(draw, 0, 0, width, where.header.height, HEADER)
        heading = fit(footage.title, self._large, width - 150 * unit, bold=True)
        write(draw, 8 * unit, where.header.height - 8 * unit, heading, self._large, HEADER_INK, bold=True)
        for k, (panel, shot) in enumerate(zip(where.panels, footage.shots, strict=True)):
            box = panel.title
            name = fit(shot.name, self._large, box.width, bold=True)
            write(draw, box.x, box.y + 14 * unit, name, self._large, INK, bold=True)
            for i, line in enumerate(notes.lines[k]):
                text = fit(line, notes.height, box.width)
                write(draw, box.x, box.y + (27 + NOTE * i) * unit, text, notes.height, FAINT)
            if panel.view.x > 1:
                fill(draw, panel.view.x - 1.5, box.y, panel.view.x - 0.5, height, TRACK)
            self._label_bars(draw, panel.bars)
            for half, signal in enumerate(self._signals):
                self._label_trace(draw, _half(panel.traces, half), signal.label, not np.isnan(signal.traces[k]).all())
        return image

    def _label_trace(self, draw: ImageDraw.ImageDraw, box: Box, label: str, present: bool) -> None:
        unit, middle, right = self._unit, box.y + box.height / 2, box.x + box.width
        write(draw, box.x, box.y - 3 * unit, fit(label, self._small, box.width), self._small, INK)
        fill(draw, box.x, box.y, right, box.y + box.height, PALE)
        fill(draw, box.x, middle - 0.5, right, middle + 0.5, TRACK)
        if not present:
            write(draw, box.x + box.width / 2, middle + 4 * unit, "has none", self._small, FAINT, align="middle")

    def _draw_trace(self, draw: ImageDraw.ImageDraw, box: Box, trace: Array, end: int) -> None:
        shown = trace[:, max(0, end - FINE * box.width) : end]
        first = FINE * (box.x + box.width) - shown.shape[1]
        for j in range(len(self._joints)):
            band(draw, first, box.y + shown[:, :, j], JOINTS[j % len(JOINTS)])

    def _bar_rows(self, box: Box) -> tuple[float, float, float]:
        """Return where the first bar begins, the height of a row, and the left end of the bars."""
        top = 12 * self._unit
        room = 0.45 * box.width if box.width > 170 * self._unit else 12 * self._unit
        return box.y + top, min((box.height - top) / len(self._joints), 18 * self._unit), box.x + room

    def _label_bars(self, draw: ImageDraw.ImageDraw, box: Box) -> None:
        unit, right = self._unit, box.x + box.width
        top, row, left = self._bar_rows(box)
        write(draw, box.x, box.y + 6 * unit, fit("torque / limit", self._small, box.width), self._small, INK)
        for j, name in enumerate(self._joints):
            y, colour = top + j * row, JOINTS[j % len(JOINTS)]
            if row >= 0.8 * self._small:
                text = fit(name if left - box.x > 20 * unit else str(j + 1), self._small, left - box.x - 4 * unit)
                write(draw, box.x, y + row / 2 + 0.36 * self._small, text, self._small, colour)
            fill(draw, left, y + 0.15 * row, right, y + 0.85 * row, TRACK)
            for x, half in ((left, 1.0), ((left + right) / 2, 0.5), (right, 1.0)):
                fill(draw, x - half, y + 0.1 * row, x + half, y + 0.9 * row, FAINT)

    def _draw_bars(self, draw: ImageDraw.ImageDraw, box: Box, torques: Array) -> None:
        """Draw the least, greatest and mean torque over the limit of each joint, (3, n)."""
        top, row, left = self._bar_rows(box)
        right = box.x + box.width
        middle, scale = (left + right) / 2, (right - left) / 2
        for j, (low, high, mean) in enumerate(torques.T.tolist()):
            if np.isnan(mean):
                continue
            y0, y1, colour = top + (j + 0.15) * row, top + (j + 0.85) * row, JOINTS[j % len(JOINTS)]
            fill(draw, middle + scale * low, y0, middle + scale * high, y1, (*colour, RANGE))
            start, end = sorted((middle, middle + scale * mean))
            fill(draw, start, y0 + 0.12 * row, end, y1 - 0.12 * row, colour)
            for x, reached in ((left, low <= -1.0 + 1e-9), (right, high >= 1.0 - 1e-9)):
                if reached:
                    fill(draw, x - 1.5, y0 - 0.1 * row, x + 1.5, y1 + 0.1 * row, ALARM)


def _half(box: Box, half: int) -> Box:
    """Return the box of the upper or the lower trace, below its label."""
    label = round(0.26 * box.height / 2)
    high = box.height // 2
    return Box(box.x, box.y + half * high + label, box.width, high - label - 2)
