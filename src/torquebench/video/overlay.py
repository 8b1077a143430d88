"""Surroundings of the views in a frame: names, time, torques over their limits and errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from torquebench.experiment.schema import Video
from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.looks import SERIES
from torquebench.report.tables import without_common_words
from torquebench.scene.look import MOST_DRAWN, Scene
from torquebench.sim.trajectory import Trajectory
from torquebench.video.job import FPS, SEPARATOR, Footage, Shot
from torquebench.video.layout import LABEL, NAME, NOTE, ROW, Box, Layout, Timeline, layout, spans
from torquebench.video.paint import FINE, Colour, band, fill, shrunk, text_width, wrap, write

WINDOW = 1.5
"""Time that a trace shows, in seconds of the film."""
PEN = 0.55
"""Half the width of a trace, in units of a layout."""
PAPER, INK, FAINT, TRACK, PALE = (255, 255, 255), (30, 32, 38), (120, 124, 132), (230, 233, 237), (246, 247, 249)
HEADER_UNITS = 26.0
"""Height of the header, in units of its own."""
HEADER, HEADER_INK, ALARM = (38, 44, 54), (245, 247, 250), (200, 30, 30)
SIGN, RANGE = 217, 102
"""Opacity, of 255, of a sign on a view and of a torque's range."""
SWATCH = 4.0
"""Width of the mark in a joint's colour before its name, in units of a layout."""
STRIPE = 1.5
"""Height of the stripe in the colour of a controller above its name, in units of a layout."""
SMALL, PLAIN, LARGE = 9.6, 10.6, 13.0
"""Heights of fonts, in units of a layout."""
JOINTS: tuple[Colour, ...] = tuple(ImageColor.getrgb(colour) for colour in SERIES)


class _Signal(NamedTuple):
    """A signal of all controllers."""

    label: str
    """Its name, and the range that all of them share."""
    traces: list[Array]
    """Upper and lower edge in each fine column of the whole film, (2, columns, n) [px below the top]; NaN for none."""


def titles(shots: Sequence[Shot], width: float, unit: float) -> list[tuple[list[str], list[str]]]:
    """Divide names and notes of controllers in lines of a `width` [px], in a layout of a `unit`; the same number each.

    Notes are divided between their parts, not within one, if there is room.
    """
    notes = [SEPARATOR.join(part.replace(" ", "\xa0") for part in shot.note.split(SEPARATOR)) for shot in shots]
    names = [wrap(shot.name, LARGE * unit, width, bold=True) for shot in shots]
    return list(zip(names, (wrap(note, PLAIN * unit, width) for note in notes), strict=True))


def layout_for(shots: Sequence[Shot], size: tuple[int, int], joints: int) -> Layout:
    """Divide a frame so that names and notes of the controllers are seen whole; arguments as for `layout`."""

    def title(width: float, unit: float) -> float:
        lines = titles(shots, width, unit)
        return 8.0 + NAME * max(len(name) for name, _ in lines) + NOTE * max(len(note) for _, note in lines)

    return layout(len(shots), size, joints, title)


class Overlay:
    """Draws everything but the views.

    Args:
        footage: The stored run.
        runs: Trajectories of its controllers.
        settings: How the film looks.
        timeline: The film's frames.
        scene: The arm.
    """

    def __init__(
        self, footage: Footage, runs: Sequence[Trajectory], settings: Video, timeline: Timeline, scene: Scene
    ) -> None:
        self._runs, self._timeline, self._joints = runs, timeline, without_common_words(scene.joints)
        self.where = layout_for(footage.shots, settings.size, len(scene.joints))
        self._unit = self.where.unit
        self._small, self._large = self._unit * SMALL, self._unit * LARGE
        self._bars = [np.clip(spans(run.tau / scene.limits, timeline.samples()), -1.0, 1.0) for run in runs]
        plots = self.where.panels[0].traces
        self._step = max(1, round(FINE * plots[0].width / (WINDOW * FPS))) if plots else 1
        errors, torques = [run.q_ref - run.q for run in runs], [run.tau / scene.limits for run in runs]
        signals = ("error e  ±{:.3g} {}", scene.unit, errors), ("torque  ±{:.3g} % of limit", "", torques)
        self._signals = [self._signal(*signal) for signal in signals] if plots else []
        drawn = f"error times {settings.exaggerate:g}, up to {MOST_DRAWN:g} {scene.unit}"
        self._warning = [(drawn, self._small, HEADER)] if settings.exaggerate > 1.0 else []
        self._background = self._draw_background(footage, settings.size)

    def draw(self, i: int, views: Sequence[Image.Image]) -> Image.Image:
        """Return frame `i` around the controllers' views, which are `FINE` times as large as their boxes."""
        image, header, unit = self._background.copy(), self.where.header, self._unit
        draw = ImageDraw.Draw(image, "RGBA")
        speed = "" if self._timeline.speed == 1.0 else f"   {self._timeline.speed:g}x"
        now, scale = self._timeline.time(i), header.height / HEADER_UNITS
        text, right, baseline = f"t = {now:6.2f} s{speed}", header.width - 8 * scale, header.height - 8 * scale
        write(draw, right, baseline, text, LARGE * scale, HEADER_INK, align="right")
        for k, (panel, run) in enumerate(zip(self.where.panels, self._runs, strict=True)):
            box = panel.view
            image.paste(views[k], (FINE * box.x, FINE * box.y))
            self._draw_bars(draw, panel.bars, self._bars[k][:, i])
            for plot, signal in zip(panel.traces, self._signals, strict=True):
                self._draw_trace(draw, plot, signal.traces[k], i * self._step)
            ended = [(run.ending, PLAIN * unit, ALARM)] if run.ending and now >= run.t[-1] else []
            self._draw_signs(draw, box, [*self._warning, *ended])
        return image.reduce(FINE)

    def _draw_signs(
        self, draw: ImageDraw.ImageDraw, box: Box, signs: Sequence[tuple[str, float, tuple[int, int, int]]]
    ) -> None:
        """Write texts of some size and ground at the lower edge of a view, the first at the bottom."""
        bottom, edge = float(box.y + box.height), 4 * self._unit
        for text, size, colour in signs:
            lines = wrap(text, size, box.width - 2 * edge)
            top = bottom - 1.25 * size * len(lines) - 2 * edge
            fill(draw, box.x, top, box.x + box.width, bottom, (*colour, SIGN))
            for i, line in enumerate(lines):
                baseline = top + edge + 1.25 * size * (i + 0.8)
                write(draw, box.x + box.width / 2, baseline, line, size, PAPER, align="middle")
            bottom = top

    def _signal(self, label: str, unit: str, values: Sequence[Array]) -> _Signal:
        """Scale a signal to the range that all controllers share, zero in the middle.

        Args:
            label: Its name, with room for that range and its unit.
            unit: Its unit; none for a ratio, which is shown in percent.
            values: The signal of each run, (N, n).
        """
        both = [(np.stack([y, -y]), run.completed) for y, run in zip(values, self._runs, strict=True)]
        limits = style.limits([y for y, completed in both if completed], [y for y, completed in both if not completed])
        top = limits[1] / 1.12  # without the margin, which the box has
        prefix = style.choose_unit(top, unit) if unit else style.Unit("", 100.0)
        return _Signal(label.format(top * prefix.factor, prefix.name), [self._trace(y, top) for y in values])

    def _trace(self, values: Array, top: float) -> Array:
        """Return the edges of a trace; `top` is at the upper edge of its box."""
        height = self.where.panels[0].traces[0].height
        least, most, _ = spans(values, self._timeline.samples(self._step))
        upper, lower = (np.clip((height - (height - 4.0) * y / top) / 2.0, 0, height) for y in (most, least))
        # neighbouring columns touch, so that the curve has no gaps
        upper[1:], lower[1:] = np.minimum(upper[1:], lower[:-1]), np.maximum(lower[1:], upper[:-1])
        pen = PEN * self._unit
        edges: Array = np.clip([upper - pen, lower + pen], 0, height)
        return edges

    def _draw_background(self, footage: Footage, size: tuple[int, int]) -> Image.Image:
        """Draw what is the same in every frame."""
        where, unit, (width, height) = self.where, self._unit, size
        image, scale = Image.new("RGB", (FINE * width, FINE * height), PAPER), where.header.height / HEADER_UNITS
        draw = ImageDraw.Draw(image)
        fill(draw, 0, 0, width, where.header.height, HEADER)
        large = shrunk(footage.title, LARGE * scale, width - 150 * scale, bold=True)
        write(draw, 8 * scale, where.header.height - 8 * scale, footage.title, large, HEADER_INK, bold=True)
        lines = titles(footage.shots, where.panels[0].title.width, unit)
        for panel, shot, (name, note) in zip(where.panels, footage.shots, lines, strict=True):
            box, colour = panel.title, ImageColor.getrgb(shot.colour)
            fill(
                draw, box.x, box.y + STRIPE * unit, panel.view.x + panel.title.width, box.y + 2 * STRIPE * unit, colour
            )
            baseline = box.y + unit
            for line in name:
                baseline += NAME * unit
                write(draw, box.x, baseline, line, self._large, INK, bold=True)
            for line in note:
                baseline += NOTE * unit
                write(draw, box.x, baseline, line, PLAIN * unit, FAINT)
            if panel.view.x > 1:
                bottom = panel.view.y + panel.view.height
                fill(draw, panel.view.x - 1.5, box.y, panel.view.x - 0.5, bottom, TRACK)
            self._label_bars(draw, panel.bars)
            for plot, signal in zip(panel.traces, self._signals, strict=True):
                self._label_trace(draw, plot, signal.label)
        return image

    def _label_trace(self, draw: ImageDraw.ImageDraw, box: Box, label: str) -> None:
        middle, right = box.y + box.height / 2, box.x + box.width
        write(draw, box.x, box.y - 3 * self._unit, label, shrunk(label, self._small, box.width), INK)
        fill(draw, box.x, box.y, right, box.y + box.height, PALE)
        fill(draw, box.x, middle - 0.5, right, middle + 0.5, TRACK)

    def _draw_trace(self, draw: ImageDraw.ImageDraw, box: Box, trace: Array, end: int) -> None:
        shown = trace[:, max(0, end - FINE * box.width) : end]
        first = FINE * (box.x + box.width) - shown.shape[1]
        for j in range(len(self._joints)):
            band(draw, first, box.y + shown[:, :, j], JOINTS[j % len(JOINTS)])

    def _bar_rows(self, box: Box) -> tuple[float, float, float]:
        """Return where the first bar begins, the height of a row, and the left end of the bars."""
        top = LABEL * self._unit
        room = max(text_width(name, self._small) for name in self._joints) + (SWATCH + 8) * self._unit
        return (
            box.y + top,
            min((box.height - top) / len(self._joints), ROW * self._unit),
            box.x + min(room, 0.55 * box.width),
        )

    def _label_bars(self, draw: ImageDraw.ImageDraw, box: Box) -> None:
        unit, right = self._unit, box.x + box.width
        top, row, left = self._bar_rows(box)
        label = "torque / limit  ±1"
        write(draw, box.x, box.y + 9 * unit, label, shrunk(label, self._small, box.width - 3 * unit), INK)
        for j, name in enumerate(self._joints):
            y, mark = top + j * row, box.x + SWATCH * unit
            size = min(shrunk(name, self._small, left - mark - 5 * unit), row)
            fill(draw, box.x, y + 0.15 * row, mark, y + 0.85 * row, JOINTS[j % len(JOINTS)])
            write(draw, mark + 3 * unit, y + row / 2 + 0.36 * size, name, size, INK)
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
