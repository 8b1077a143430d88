"""The scatter of a page: points where logarithms have them, names beside them that can be read."""

import itertools
import re

import numpy as np
import pytest

from torquebench.report.scatter import BOTTOM, HEIGHT, LEFT, LINE, RIGHT, TOP, WIDTH, Point, axis, scatter

POINTS = [
    Point("conventional", 30.1, 0.53, "#000000"),
    Point("band", 4e-4, 0.052, "#111111"),
    Point("b<c", 1.0, 0.2, "#222222"),
]


def places(svg):
    """Centre of each point by its name."""
    found = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)"[^>]*><title>([^:]*):', svg)
    return {name: (float(x), float(y)) for x, y, name in found}


def test_points_are_at_their_logarithms():
    """Equal ratios are equal distances, right is more, up is more, all within the frame; a name is no markup."""
    svg = str(scatter(POINTS, "x [%]", "y [mrad]"))
    at = places(svg)
    assert set(at) == {"conventional", "band", "b&lt;c"}
    logs = np.log([[p.x, p.y] for p in POINTS])
    seen = np.array([at[p.name.replace("<", "&lt;")] for p in POINTS])
    for k, sign in ((0, 1), (1, -1)):
        slopes = np.diff(seen[:, k]) / np.diff(logs[:, k])
        assert np.ptp(slopes) < 0.01 * abs(slopes[0])
        assert np.all(sign * slopes > 0)
    assert np.all(
        (seen[:, 0] > LEFT) & (seen[:, 0] < WIDTH - RIGHT) & (seen[:, 1] > TOP) & (seen[:, 1] < HEIGHT - BOTTOM)
    )


def test_names_do_not_cover_each_other():
    """Twelve points at almost one place have names a line apart, or at either side, inside the picture."""
    points = [Point(f"controller-{k}", 1.0 + 0.001 * k, 1.0 + 0.001 * k, "#000000") for k in range(12)]
    svg = str(scatter(points, "x", "y"))
    names = re.findall(r'<text x="[\d.]+" y="([\d.]+)" text-anchor="(start|end)">controller', svg)
    assert len(names) == 12
    for side in ("start", "end"):  # names at different sides of the points cannot meet
        bases = [float(y) for y, anchor in names if anchor == side]
        assert all(abs(a - b) >= LINE - 0.1 for a, b in itertools.combinations(bases, 2))
        assert all(TOP < base < HEIGHT for base in bases)


def test_names_do_not_cover_points():
    """No name, at the least width of its letters, lies on a circle, its own or another one's."""
    rng = np.random.default_rng(3)
    points = [
        Point(f"two-input-fuzzy-{k}", *np.exp(spread * rng.standard_normal(2)), "#000000")
        for spread in (0.1, 1.0)
        for k in range(5)
    ]
    svg = str(scatter(points, "x", "y"))
    names = re.findall(r'<text x="([\d.]+)" y="([\d.]+)" text-anchor="(start|end)">(two-[^<]*)', svg)
    assert len(names) == 10
    for x, base, anchor, name in names:
        far = float(x) + (5.0 if anchor == "start" else -5.0) * len(name)
        low, high = sorted((float(x), far))
        for cx, cy in places(svg).values():
            assert not (low - 4 < cx < high + 4 and float(base) - 11 < cy < float(base) + 3)


@pytest.mark.parametrize("span", [1.05, 1.3, 2.0, 4.0, 30.0, 1e4])
def test_axes_have_three_numbers_or_more(span):
    """Round ones within the frame, however near the points are to each other, and not more than there is room for."""
    for low in (0.011, 0.29, 3.3, 97.0):
        ticks = axis([low, low * span], 0.0, 400.0).ticks()
        assert 3 <= len(ticks) <= 12
        assert ticks == pytest.approx([float(f"{tick:.2g}") for tick in ticks], rel=1e-12)


@pytest.mark.parametrize("points", [[], POINTS[:1]])
def test_there_is_nothing_to_compare(points):
    """Fewer than two points make no picture."""
    assert scatter(points, "x", "y") == ""


def test_zero_is_at_the_edge():
    """No chattering at all has no logarithm: the point is at the left end, and the axis is made by the others."""
    at = places(str(scatter([Point("none", 0.0, 1.0, "#000000"), *POINTS], "x", "y")))
    assert at["none"][0] == LEFT
    assert at["band"][0] > LEFT


def test_what_is_little_is_shaded_and_not_blown_up():
    """All below the limit: the axis goes from 0 to it in equal steps. Some above: logarithms, shaded up to it."""
    little = (0.1, "does not chatter")
    low = [Point(name, x, 1.0 + x, "#000000") for name, x in (("a", 0.02), ("b", 0.04), ("c", 0.08))]
    svg = str(scatter(low, "x", "y", little))
    at, width = places(svg), WIDTH - RIGHT - LEFT
    assert [at[p.name][0] for p in low] == pytest.approx([LEFT + p.x / 0.1 * width for p in low], abs=0.1)
    assert f'<rect x="{LEFT}" y="{TOP}" width="{float(width)}"' in svg
    assert ">does not chatter</text>" in svg
    assert all(f">{x:g}</text>" in svg for x in (0, 0.02, 0.1))
    mixed = str(scatter(POINTS, "x", "y", little))
    edge = LEFT + float(re.search(r'<rect [^>]*width="([\d.]+)"', mixed)[1])
    assert places(mixed) == places(str(scatter(POINTS, "x", "y")))
    assert places(mixed)["band"][0] < edge < places(mixed)["b&lt;c"][0]
    at_top = [Point(name, 1e-5, y, "#000000") for name, y in (("top", 9.0), ("low", 1.0))]
    covered = str(scatter(at_top, "x", "y", (0.002, "still")))
    base = float(re.search(r'class="hint" x="[\d.]+" y="([\d.]+)"', covered)[1])
    assert all(abs(base - 4 - y) > 9 for _, y in places(covered).values())  # no circle lies on the word
    assert "<rect" not in str(scatter([p for p in POINTS if p.x > 0.1], "x", "y", little))
