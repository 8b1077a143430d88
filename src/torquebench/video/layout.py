"""Layout of a frame, and the stored samples that each frame shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from torquebench.errors import VideoError
from torquebench.kernel import Array, IntArray
from torquebench.video.job import FPS

LEAST_PANEL = (150, 150)
"""Least width and height of a panel [px]."""
LEAST_UNIT = 0.85
"""Smaller letters cannot be read."""
NAME, NOTE, LABEL = 15.0, 13.0, 13.0
"""Heights of a line of a controller's name, of a line below it and of one above a chart, in units of a layout."""
ROW = 18.0
"""Greatest height of a joint's row among the bars, the same."""
MOST_FRAMES = 100_000
"""More than an hour of film."""


class Box(NamedTuple):
    """A rectangle of pixels."""

    x: int
    y: int
    width: int
    height: int


class Panel(NamedTuple):
    """One controller's part of a frame."""

    title: Box
    view: Box
    bars: Box
    traces: tuple[Box, ...]
    """Plots without their labels; none in a panel that is too small for them."""


class Layout(NamedTuple):
    """The parts of a frame."""

    unit: float
    """Scale of what is in a panel, relative to one of 320 x 227 or more in a frame of 640 x 480."""
    header: Box
    panels: tuple[Panel, ...]


def layout(count: int, size: tuple[int, int], joints: int, title: Callable[[float, float], float]) -> Layout:
    """Divide a frame among panels in the grid, with charts beside or below the views, that shows all largest.

    Args:
        count: Number of panels.
        size: Width and height of the frame [px].
        joints: Number of joints.
        title: Height of a panel's title [units], of the width it may have [px] and the unit.

    Raises:
        VideoError: panels would be too small to show anything.
    """
    best, most = None, 0.0
    scale, top = _header(size)
    for columns, wide, high in _grids(count, size):
        unit = max(LEAST_UNIT, min(scale, wide / 300.0, high / 220.0))
        above = round(unit * title(wide - 12 * unit, unit))
        for beside in (True, False):
            boxes = [Box(i % columns * wide, top + i // columns * high, wide, high) for i in range(count)]
            panels = [_panel(box, unit, above, joints, beside) for box in boxes]
            view, bars, traces = panels[0].view, panels[0].bars, panels[0].traces
            score = unit * min(view.width, view.height, 1.4 * (traces[0] if traces else bars).width)
            if score > most:
                best, most = Layout(unit, Box(0, 0, size[0], top), tuple(panels)), score
    if best is None:
        raise VideoError(misfit(count, size) + "; ask for a larger --size or fewer --controllers")
    return best


def misfit(count: int, size: tuple[int, int]) -> str:
    """Return why so many panels do not fit in a frame of some size [px]; nothing if they do."""
    if _grids(count, size):
        return ""
    do = "controller does" if count == 1 else "controllers do"
    wants = f"each wants {LEAST_PANEL[0]}x{LEAST_PANEL[1]} or more"
    return f"{count} {do} not fit in {size[0]}x{size[1]}: {wants} below a line of {_header(size)[1]} px"


def _header(size: tuple[int, int]) -> tuple[float, int]:
    """Return the scale of a frame of some size, and the height of the line above its panels [px]."""
    scale = max(0.75, min(size[0] / 640.0, size[1] / 480.0))
    return scale, round(26 * scale)


def _grids(count: int, size: tuple[int, int]) -> list[tuple[int, int, int]]:
    """Return columns, width and height [px] of the panels of each grid whose panels are not too small."""
    top = _header(size)[1]
    found = [(columns, size[0] // columns, (size[1] - top) // -(-count // columns)) for columns in range(1, count + 1)]
    return [grid for grid in found if grid[1] >= LEAST_PANEL[0] and grid[2] >= LEAST_PANEL[1]]


def _panel(box: Box, unit: float, above: int, joints: int, beside: bool) -> Panel:
    """Divide one panel: a title `above`; then the view, and charts beside or below it."""
    margin, label, left = round(6 * unit), round(LABEL * unit), box.height - above
    x, y = box.x + 1, box.y + above
    if beside:
        view = Box(x, y, round(0.47 * box.width), left)
        charts = Box(x + view.width + margin, y, box.width - view.width - 2 * margin, left - margin)
    else:
        below = min(max(round(112 * unit), left - round(1.1 * box.width)), left // 2)
        view = Box(x, y, box.width - 2, left - below)
        charts = Box(x + margin, y + view.height + margin, box.width - 2 * margin, below - 2 * margin)
    rows = round((LABEL + ROW * joints) * unit)
    if charts.width > 1.7 * charts.height:
        bars = charts._replace(width=round(0.42 * charts.width), height=min(charts.height, rows))
        traces = charts._replace(x=bars.x + bars.width + margin, width=charts.width - bars.width - margin)
    else:
        least = round(2 * 2.5 * LABEL * unit)
        bars = charts._replace(height=min(max(charts.height // 2, charts.height - 3 * least), rows))
        if charts.height < 2 * least:
            bars = charts._replace(height=min(charts.height, rows))
        traces = charts._replace(y=bars.y + bars.height + margin // 2, height=charts.height - bars.height - margin // 2)
    high = traces.height // 2
    plots = (traces._replace(y=traces.y + i * high + label, height=high - label - margin // 2) for i in (0, 1))
    title = Box(box.x + margin, box.y, box.width - 2 * margin, above)
    return Panel(title, view, bars, tuple(plots) if high > 2 * label else ())


class Timeline(NamedTuple):
    """The frames of a film: frame i shows the sample nearest to the time ``i * speed / FPS``."""

    total: int
    """Number of frames: the run's duration over `speed` times `FPS`, rounded, at least one."""
    speed: float
    """Simulated seconds shown in one second."""
    control_period: float
    """Time between samples [s]."""

    def time(self, frame: int) -> float:
        """Return the simulated time of a frame [s]."""
        return frame * self.speed / FPS

    def samples(self, per_frame: int = 1) -> IntArray:
        """Return the index of the sample shown at each of `per_frame` instants per frame, (total * per_frame,)."""
        frame, part = np.divmod(np.arange(self.total * per_frame), per_frame)
        within = part * (self.speed / FPS / per_frame)
        times = frame * self.speed / FPS + within  # a frame has its own time whatever per_frame is
        return np.asarray(np.floor(times / self.control_period + 0.5), dtype=np.int64)


def timeline(duration: float, speed: float, control_period: float) -> Timeline:
    """Choose the frames of a run.

    Args:
        duration: Length of the run [s].
        speed: Simulated seconds shown in one second.
        control_period: Time between samples [s].

    Raises:
        VideoError: the film would be longer than `MOST_FRAMES`.
    """
    frames = duration / speed * FPS
    if frames > MOST_FRAMES:
        slowest = duration * FPS / MOST_FRAMES
        raise VideoError(
            f"{duration:g} s at speed {speed:g} are too long a film: wanted a --speed of {slowest:.3g} or more"
        )
    return Timeline(max(1, round(frames)), speed, control_period)


def spans(values: Array, starts: IntArray) -> Array:
    """Return the least, greatest and mean value of a signal from each of `starts` to just before the next, (3, M, n).

    What is not a number is left out; a stretch that has nothing else, or lies beyond the signal's end, gives NaN.

    Args:
        values: Signal, (N, n).
        starts: Indices in rising order, (M,). Of two equal ones the first covers that one sample; the last one's
            stretch goes on to the signal's end.
    """
    inside = starts[starts < len(values)]
    found = np.full((3, len(starts), values.shape[1]), np.nan)
    if len(inside):
        known = np.isfinite(values)
        finite = np.where(known, values, np.nan)
        count = np.add.reduceat(known, inside, axis=0, dtype=np.int64)
        total = np.add.reduceat(np.where(known, values, 0.0), inside, axis=0)
        mean = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
        low, high = (choose.reduceat(finite, inside, axis=0) for choose in (np.fmin, np.fmax))
        found[:, : len(inside)] = low, high, mean
    return found
