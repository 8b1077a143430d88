"""Where things are in a frame, and which stored sample each frame shows."""

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

    width: int
    height: int
    unit: float
    """Scale relative to a frame of 640 x 480."""
    notes: int
    """Number of lines below a controller's name."""
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
    best, columns = 0.0, 1
    for tried in range(1, count + 1):
        rows = -(-count // tried)
        panel = _panel(Box(0, 0, width // tried, (height - top) // rows), unit, notes)
        if min(panel.view.width, panel.view.height) > best:
            best, columns = min(panel.view.width, panel.view.height), tried
    rows = -(-count // columns)
    wide, high = width // columns, (height - top) // rows
    if wide < LEAST_PANEL[0] or high < LEAST_PANEL[1]:
        raise VideoError(
            f"{count} controllers do not fit in {width}x{height}: each would have {wide}x{high}, wanted at least "
            f"{LEAST_PANEL[0]}x{LEAST_PANEL[1]}; ask for a larger --size or fewer --controllers"
        )
    boxes = [Box(i % columns * wide, top + i // columns * high, wide, high) for i in range(count)]
    return Layout(width, height, unit, notes, Box(0, 0, width, top), tuple(_panel(box, unit, notes) for box in boxes))


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

    def time(self, frame: float) -> float:
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
    if duration / speed * FPS > MOST_FRAMES:
        slowest = duration * FPS / MOST_FRAMES
        raise VideoError(
            f"{duration:g} s at speed {speed:g} are too long a film: wanted a --speed of {slowest:.3g} or more"
        )
    return Timeline(max(1, round(duration / speed * FPS)), speed, control_period)


def ranges(values: Array, samples: IntArray) -> tuple[Array, Array]:
    """Return the least and greatest value of a signal from each of `samples` to just before the next.

    Args:
        values: Signal, (N, n).
        samples: Indices in rising order, (M,). Of two equal ones the first covers that one sample; those beyond the
            signal's end give NaN.

    Returns:
        Two arrays (M, n).
    """
    inside = int(np.searchsorted(samples, len(values)))
    low, high = (np.full((len(samples), values.shape[1]), np.nan) for _ in range(2))
    if inside:
        low[:inside] = np.fmin.reduceat(values, samples[:inside], axis=0)
        high[:inside] = np.fmax.reduceat(values, samples[:inside], axis=0)
        if inside == len(samples):  # the last stretch ends with the film, not with the signal
            low[-1] = high[-1] = values[samples[-1]]
    return low, high
