"""Peaks of a spectrum are found; units and ranges follow the size of what is drawn."""

import numpy as np
import pytest

from torquebench.report.figures.style import band_maxima, choose_unit, isolated_peaks, limits


def test_band_maxima() -> None:
    """Octave bands of 1..64 Hz hold 1, 2, 4 .. 32 lines; each gives its greatest, where it is."""
    f = np.arange(1.0, 64.0)
    a = np.where(f == 11.0, 5.0, 1.0 / f)
    where, greatest = band_maxima(f, a, 1)
    assert where.tolist() == [1.0, 2.0, 4.0, 11.0, 16.0, 32.0]
    assert greatest == pytest.approx([1.0, 0.5, 0.25, 5.0, 1 / 16, 1 / 32])


def test_isolated_peaks() -> None:
    """A line 20 times as high as all around counts, inside or last, alone or with a taper's skirts; others do not."""
    f = np.arange(1.0, 501.0)
    flat = 1.0 + 0.5 * np.random.default_rng(3).random(500)
    assert isolated_peaks(f, flat).tolist() == []
    for place in (99, 499):
        a = flat.copy()
        a[place] = 30.0
        assert isolated_peaks(f, a).tolist() == [place]
        a[place - 1] = 15.0
        assert isolated_peaks(f, a).tolist() == [place]
        a[place - 1] = 30.0  # the taper makes the last two lines of a torque switching every instant equal
        assert isolated_peaks(f, a).tolist() == [place]
        a[place - 4] = 15.0  # no longer alone
        assert isolated_peaks(f, a).tolist() == []
    assert isolated_peaks(f, np.exp(f / 100.0)).tolist() == []  # a rise is no line
    assert isolated_peaks(f, np.zeros(500)).tolist() == []
    assert isolated_peaks(f[:3], np.array([1.0, 50.0, 1.0])).tolist() == []  # nothing to stand out from


@pytest.mark.parametrize(
    ("peak", "name", "factor"),
    [
        (1.2, "rad", 1.0),
        (0.5, "rad", 1.0),
        (0.3, "mrad", 1e3),
        (8e-4, "mrad", 1e3),
        (3e-4, "µrad", 1e6),
        (2e-9, "nrad", 1e9),
        (0.0, "rad", 1.0),
        (float("inf"), "rad", 1.0),
        (1e-30, "rad", 1.0),
    ],
)
def test_choose_unit(peak: float, name: str, factor: float) -> None:
    """The prefix makes the peak a number from 0.5 to 500."""
    assert choose_unit(peak, "rad") == (name, factor)
    assert choose_unit(peak, "m or rad") == (f"{name.removesuffix('rad')}m or {name}", factor)


def test_limits() -> None:
    """Completed runs are seen whole with 6 % to spare; a failed run adds at most as much again."""
    good = np.array([-1.0, 3.0, np.nan])
    assert limits([good]) == pytest.approx((-1.24, 3.24))
    assert limits([good], [np.array([1e12])]) == pytest.approx((3.0 - 4.48, 3.0 + 4.48))
    assert limits([good], [np.array([-1e12])]) == pytest.approx((-1.0 - 4.48, -1.0 + 4.48))
    assert limits([good], [np.array([-1.5])]) == pytest.approx((0.75 - 2.52, 0.75 + 2.52))
    low, high = limits([], [np.append(np.linspace(-1.0, 1.0, 99), 1e12)])
    assert -1.2 < low < -0.8  # all failed: the last tenth may leave the page
    assert 0.8 < high < 1.2
    for flat in ([], [np.zeros(3)], [np.full(3, 1e6)]):
        low, high = limits(flat)
        assert low < high
    assert limits([np.zeros(2)], floor=0.5) == pytest.approx((-0.56, 0.56))
