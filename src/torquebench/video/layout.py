"""Where things are in a frame: header, one panel for each controller, and in each panel view, bars and traces."""

from __future__ import annotations

from typing import NamedTuple

from torquebench.errors import VideoError

LEAST_PANEL = (150, 150)
"""Least width and height of a panel [px]."""
NOTE = 13
"""Height of a line below a controller's name, in units of a layout."""


class Box(NamedTuple):
    """A rectangle of pixels."""

    x: int
    y: int
    width: int
    height: int


class Panel(NamedTuple):
    """What is shown of one controller."""

    title: Box
    view: Box
    bars: Box
    traces: Box


class Layout(NamedTuple):
    """A frame."""

    width: int
    height: int
    unit: float
    """Size of things relative to a frame of 640 x 480."""
    notes: int
    """Number of lines below a controller's name."""
    header: Box
    panels: tuple[Panel, ...]


def layout(count: int, width: int, height: int, notes: int = 1) -> Layout:
    """Divide a frame among `count` panels, in as many columns as make the views largest.

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
