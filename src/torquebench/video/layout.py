"""Where things are in a frame, and which stored samples each frame shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.errors import VideoError
from torquebench.kernel import Array, IntArray
from torquebench.video.job import FPS

LEAST_PANEL = (150, 150)
"""Least width and height of a panel [px]."""
NOTE = 13
"""Height of a line below a controller's name, in units of a layout."""
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
    traces: Box


class Layout(NamedTuple):
    """The parts of a frame."""

    unit: float
    """Scale relative to a frame of 640 x 480."""
    header: Box
    panels: tuple[Panel, ...]


def layout(count: int, width: int, height: int, notes: int = 1) -> Layout:
    """Divide a frame among `count` panels, in the number of columns that makes the views largest.

    Args:
        count: Number of panels.
        width, height: Size of the frame [px].
        notes: Number of lines below a controller's name.

    Raises:
        VideoError: panels would be too small to show anything.
    """
    unit = max(0.75, min(width / 640.0, height / 480.0))
    top = round(26 * unit)
    grids = []
    for columns in range(1, count + 1):
        wide, high = width // columns, (height - top) // -(-count // columns)
        grids.append([Box(i % columns * wide, top + i // columns * high, wide, high) for i in range(count)])
    divided = [tuple(_panel(box, unit, notes) for box in grid) for grid in grids]
    best = max(range(count), key=lambda i: min(divided[i][0].view[2:]))
    wide, high = grids[best][0][2:]
    if wide < LEAST_PANEL[0] or high < LEAST_PANEL[1]:
        raise VideoError(
            f"{count} controllers do not fit in {width}x{height}: each would have {wide}x{high}, wanted at least "
            f"{LEAST_PANEL[0]}x{LEAST_PANEL[1]}; ask for a larger --size or fewer --controllers"
        )
    return Layout(unit, Box(0, 0, width, top), divided[best])


def _panel(box: Box, unit: float, notes: int) -> Panel:
    """Divide one panel: a title, the view, and below it torque bars beside traces."""
    margin, title = round(6 * unit), round((19 + NOTE * notes) * unit)
    below = min(round(112 * unit), int(0.42 * (box.height - title)))
    view = Box(box.x + 1, box.y + title, box.width - 2, max(box.height - title - below, 0))
    top, inside = view.y + view.height + margin, box.width - 3 * margin
    bars = Box(box.x + margin, top, round(0.38 * inside), below - 2 * margin)
    traces = Box(bars.x + bars.width + margin, top, inside - bars.width, bars.height)
    return Panel(Box(box.x + margin, box.y, box.width - 2 * margin, title), view, bars, traces)


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
