"""A scatter of two metrics as inline SVG in the page's own colours: logarithmic axes, every point with its name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup

WIDTH, HEIGHT = 440, 330
LEFT, RIGHT, TOP, BOTTOM = 66, 14, 14, 46
LINE = 14
"""Height of a line of text."""
LETTER = 7.6
"""Width of a letter at most."""
CIRCLE = 6
"""Radius of a point."""


class Point(NamedTuple):
    """A point of the scatter."""

    name: str
    x: float
    y: float
    colour: str


class Axis(NamedTuple):
    """A logarithmic axis, or a linear one from 0: its range, and where its ends are on the picture."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Return the place of a value."""
        if self.low == 0.0:
            return round(self.start + value / self.high * (self.end - self.start), 1)
        part = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        return round(self.start + part * (self.end - self.start), 1)

    def ticks(self) -> list[float]:
        """Return three round values or more: powers of ten, then 1, 2 and 5, tenths, or twentieths of each decade.

        A linear axis has fifths.
        """
        if self.low == 0.0:
            return [self.high * k / 5 for k in range(6)]
        decades = math.log10(self.high / self.low)
        skip = max(1, round(decades / 6))
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        found = list[float]()
        for steps in ((10,), (10, 20, 50), range(10, 100, 10), range(10, 100, 5), range(10, 100)):
            found = [step * 10.0 ** (p - 1) for p in powers if p % skip == 0 for step in steps]
            found = [value for value in found if self.low <= value <= self.high]
            if len(found) > 2 and (decades >= 2.5 or len(steps) > 1):
                break
        return found


def axis(values: Sequence[float], start: float, end: float) -> Axis:
    """Return the axis on which all values have room; zeros are at its start.

    Args:
        values: What is shown.
        start, end: Where the axis begins and ends on the picture.
    """
    some = [value for value in values if value > 0.0] or [1.0]
    low, high = min(some), max(some)
    room = max((high / low) ** 0.08, 1.5)
    return Axis(low / room, high * room, start, end)


def scatter(points: Sequence[Point], across: str, up: str, little: tuple[float, str] = (0.0, "")) -> Markup:
    """Return the picture; with fewer than two points nothing.

    Args:
        points: What is shown.
        across, up: Labels of the axes, with units.
        little: An x below which differences mean nothing, and what that is called: it is shaded, and where all points
            are below it the axis goes from 0 to it.
    """
    if len(points) < 2:
        return Markup("")
    x, (least, told) = axis([point.x for point in points], LEFT, WIDTH - RIGHT), little
    if all(point.x < least for point in points):
        x = Axis(0.0, least, LEFT, WIDTH - RIGHT)
    y = axis([point.y for point in points], HEIGHT - BOTTOM, TOP)
    parts = [
        Markup('<svg class="scatter" viewBox="0 0 {} {}" role="img" aria-label="{} against {}">').format(
            WIDTH, HEIGHT, up, across
        )
    ]
    taken = [(a - CIRCLE, a + CIRCLE, b + 5) for a, b in ((x.at(point.x), y.at(point.y)) for point in points)]
    if least > x.low:
        size = round(x.at(least) - LEFT, 1)
        parts.append(
            Markup('<rect x="{}" y="{}" width="{}" height="{}"/>').format(LEFT, TOP, size, HEIGHT - BOTTOM - TOP)
        )
        if size > LETTER * len(told):
            end, rows = LEFT + 6 + LETTER * len(told), range(TOP + LINE, HEIGHT - BOTTOM, LINE)
            base = max(rows, key=lambda y: min((abs(y - b) for a, _, b in taken if a < end), default=HEIGHT))
            taken.append((LEFT, end, base))
            parts.append(Markup('<text class="hint" x="{}" y="{}">{}</text>').format(LEFT + 6, base, told))
    for value in x.ticks():
        parts.append(
            Markup('<path d="M{0} {1}V{2}"/><text x="{0}" y="{3}" text-anchor="middle">{4:g}</text>').format(
                x.at(value), TOP, HEIGHT - BOTTOM, HEIGHT - BOTTOM + LINE + 2, value
            )
        )
    for value in y.ticks():
        parts.append(
            Markup('<path d="M{0} {2}H{1}"/><text x="{3}" y="{4}" text-anchor="end">{5:g}</text>').format(
                LEFT, WIDTH - RIGHT, y.at(value), LEFT - 6, y.at(value) + 4, value
            )
        )
    middle = (TOP + HEIGHT - BOTTOM) / 2
    parts.append(
        Markup(
            '<text x="{}" y="{}" text-anchor="middle">{}</text><text transform="translate(14 {}) rotate(-90)" '
            'text-anchor="middle">{}</text>'
        ).format((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, across, middle, up)
    )
    for point in sorted(points, key=lambda point: point.y):
        parts.append(_labelled(point, x.at(point.x), y.at(point.y), taken))
    return Markup("").join([*parts, Markup("</svg>")])


def _labelled(point: Point, x: float, y: float, taken: list[tuple[float, float, float]]) -> Markup:
    """Return a point with its name where no point and no other name is, as near as there is room.

    Args:
        point: The point.
        x, y: Where it is on the picture.
        taken: Left, right and base of what is there already; the name is added.
    """
    size, gap = LETTER * len(point.name), CIRCLE + 4
    sides = [(x + gap, x + gap + size)] * (x + gap + size < WIDTH) + [(x - gap - size, x - gap)] * (
        x - gap - size > LEFT
    )
    steps = sorted(range(-16, 17), key=lambda k: (abs(k), k))
    places = [(*side, y + 5 + k * LINE) for k in steps for side in sides or [(x + gap, x + gap + size)]]
    inside = [place for place in places if TOP + LINE <= place[2] <= HEIGHT - BOTTOM - 3] or places
    free = [
        (a, b, base)
        for a, b, base in inside
        if all(b < left or a > right or abs(base - other) >= LINE for left, right, other in taken)
    ]
    low, high, base = (free or inside)[0]
    base, right = round(base, 1), low > x
    taken.append((low, high, base))
    line = (
        Markup("")
        if abs(base - y - 5) < LINE
        else Markup('<path class="lead" d="M{} {}L{} {}"/>').format(x, y, low if right else high, base - 4)
    )
    return line + Markup(
        '<circle cx="{}" cy="{}" r="{}" style="--own: {}"><title>{}: {:.4g}, {:.4g}</title></circle>'
        '<text x="{}" y="{}" text-anchor="{}">{}</text>'
    ).format(
        x,
        y,
        CIRCLE,
        point.colour,
        point.name,
        point.x,
        point.y,
        low if right else high,
        base,
        "start" if right else "end",
        point.name,
    )
