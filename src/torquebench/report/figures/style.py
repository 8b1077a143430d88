"""The look shared by all figures: fonts, lines, units, ranges, peaks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
import numpy.typing as npt
from matplotlib.axis import Axis, XAxis
from matplotlib.ticker import LogLocator, NullLocator

from torquebench.kernel import Array
from torquebench.report.looks import Look, looks

MARKERS = "osD^vP"
SHEET = Path(__file__).with_name("style.mplstyle")


@contextmanager
def journal_style() -> Iterator[None]:
    """Apply the figures' style, whatever the user's own matplotlib settings are; restore them afterwards.

    Settings belong to the process: draw from one thread at a time.
    """
    with matplotlib.style.context(["default", SHEET]):
        yield


def line_look(look: Look) -> dict[str, Any]:
    """Return colour and dash of a controller as matplotlib takes them."""
    return {"color": look.colour, "linestyle": (0, look.dash) if look.dash else "-"}


def spot_looks(laws: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return colour, dash and marker of each controller, or of each family of a controller's choices.

    Args:
        laws: Controller or family -> name of its law.
    """
    return {
        name: line_look(look) | {"marker": MARKERS[place % len(MARKERS)]}
        for place, (name, look) in enumerate(looks(laws).items())
    }


def band_maxima(f: Array, a: Array, per_octave: int) -> tuple[Array, Array]:
    """Return the frequency and size of the greatest line in each band of 1/`per_octave` octave that holds one."""
    band = np.floor(np.log2(f / f[0]) * per_octave)
    first = np.flatnonzero(np.diff(band, prepend=-1.0))
    index = np.array([low + int(np.argmax(part)) for low, part in zip(first, np.split(a, first[1:]), strict=True)])
    return f[index], a[index]


def isolated_peaks(f: Array, a: Array, ratio: float = 10.0) -> npt.NDArray[np.intp]:
    """Find isolated lines of a spectrum, such as the one line of a torque that switches every instant.

    A line counts when it is `ratio` times as high as every other line within a quarter of an octave and at least
    six lines on either side. The two lines next to it on either side only must not be higher: a Hann taper spreads
    a sinusoid over them. Of equal neighbours the last counts.

    Args:
        f: Frequencies of all lines, equally spaced, (N,) [Hz].
        a: Their amplitudes, (N,).
        ratio: How much higher the line must be.

    Returns:
        Indices of the lines, ascending.
    """
    beside = np.pad(a, 3)
    found = []
    for k in np.flatnonzero((a > 0.0) & (a >= ratio * np.maximum(beside[:-6], beside[6:]))).tolist():
        low = max(0, min(int(np.searchsorted(f, f[k] * 2.0**-0.25)), k - 6))
        high = max(int(np.searchsorted(f, f[k] * 2.0**0.25, side="right")), k + 7)
        far = np.concatenate([a[low : max(0, k - 2)], a[k + 3 : high]])
        highest = (
            a[k] >= (1.0 - 1e-9) * a[max(0, k - 2) : k + 1].max() and (a[k] > a[k + 1 : k + 3] * (1.0 + 1e-9)).all()
        )
        if highest and far.size and a[k] >= ratio * far.max():
            found.append(k)
    return np.array(found, dtype=np.intp)


class Unit(NamedTuple):
    """Unit of an axis."""

    name: str
    """The unit with its prefix."""
    factor: float
    """By how much an SI value is multiplied."""


def choose_unit(peak: float, unit: str) -> Unit:
    """Choose the SI prefix that writes `peak` as 0.5 to 500, so that no axis needs a power of ten.

    The prefix goes to the first unit of a compound, 2e-3 rad/s is 2 mrad/s, and to both of two, 2e-3 m or rad is 2 mm
    or mrad. A larger value keeps the unit.
    """
    if peak > 0.0 and math.isfinite(peak):
        for prefix, factor in (("", 1.0), ("m", 1e3), ("µ", 1e6), ("n", 1e9), ("p", 1e12)):
            if peak * factor >= 0.5:
                return Unit(prefix + unit.replace(" or ", f" or {prefix}"), factor)
    return Unit(unit, 1.0)


def limits(base: Iterable[Array], extra: Iterable[Array] = (), floor: float = 0.0) -> tuple[float, float]:
    """Choose the range of an axis.

    Args:
        base: Signals that must be seen whole.
        extra: Signals of failed runs: they may widen the range by its own width on either side, not more, so
            that a state on its way to infinity does not flatten the others.
        floor: Least half-width of the range.

    Returns:
        Lower and upper end, with a margin of 6 %.
    """
    whole, failed = _finite(base), _finite(extra)
    if failed.size and not whole.size:  # only failed runs: the last tenth of the way to infinity may leave the page
        reach = np.quantile(np.abs(failed), 0.9)
        whole, failed = np.clip(failed, -reach, reach), failed[:0]
    low, high = (float(whole.min()), float(whole.max())) if whole.size else (0.0, 0.0)
    span = max(high - low, 2.0 * floor, 1e-12 * max(abs(low), abs(high)))
    if failed.size:
        low = max(min(low, float(failed.min())), low - span)
        high = min(max(high, float(failed.max())), high + span)
    middle, half = (low + high) / 2.0, max((high - low) / 2.0, floor, 1e-9 * max(abs(low), abs(high)), 1e-15)
    return middle - 1.12 * half, middle + 1.12 * half


def _finite(signals: Iterable[Array]) -> Array:
    joined: Array = np.concatenate([np.zeros(0), *(np.ravel(signal) for signal in signals)])
    finite: Array = joined[np.isfinite(joined)]
    return finite


def plain_powers(*axes: Axis) -> None:
    """Write the powers of ten of logarithmic axes as plain numbers."""
    for axis in axes:
        axis.set_major_locator(LogLocator(numticks=6))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())


def plain_numbers(axis: Axis, span: float) -> None:
    """Write plain numbers on a logarithmic axis: over fewer than three decades 2 and 5 between the powers of ten.

    Args:
        axis: The axis.
        span: Its greatest value over its least [1].
    """
    plain_powers(axis)
    if span < 1000.0:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))


def fit_scale(axis: Axis, values: npt.ArrayLike) -> bool:
    """Make an axis logarithmic if its values are positive and span a decade; return whether it is."""
    known = _finite([np.asarray(values, dtype=np.float64)])
    span = float(known.max() / known.min()) if known.size and known.min() > 0.0 else 1.0
    if span < 10.0:
        return False
    (axis.axes.set_xscale if isinstance(axis, XAxis) else axis.axes.set_yscale)("log")
    plain_numbers(axis, span)
    return True
