"""A diagnosis drawn: the joint as it is and without the first cause, and the loop's frequency response."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from torquebench.diagnosis import Diagnosis
from torquebench.report.figures.layout import LIMIT, REFERENCE
from torquebench.report.figures.style import journal_style, plain_powers

INK, BAD = "#0b559f", "#b42318"
WIDTH, HEIGHT = 5.0, 1.9
"""Of a panel [in]: letters are read on a telephone too."""
BELOW = 30.0
"""Times the frequencies that are shown reach below the crossover [1]."""
SHOWN = 0.5
"""Length of what is shown of a torque that shakes, at most [s]."""


def diagnosis_figure(found: Diagnosis) -> Figure | None:
    """Draw a diagnosis; None where there is nothing to draw.

    The torque of the joint that shakes, or the error of one that errs, as it is and without the first cause; then size
    and phase of the open loop where its phase margin is least.
    """
    margins = found.margins
    shows = bool(found.symptoms) and not found.seen.ending
    rows = shows + 2 * (margins is not None)
    if not rows:
        return None
    with journal_style():
        fig = Figure(figsize=(WIDTH, HEIGHT * rows), layout="constrained")
        panels = list(np.atleast_1d(fig.subplots(rows, 1)))
        if shows:
            _signal(panels[0], found)
        if margins is not None:
            _bode(panels[-2], panels[-1], found)
    return fig


def _signal(ax: Axes, found: Diagnosis) -> None:
    kind, seen, cured = found.symptoms[0], found.seen, found.cured
    joint = seen.joint(kind)
    shakes = kind != "errs"
    last = seen.t >= seen.t[-1] - (SHOWN if shakes else np.inf)
    ax.plot(seen.t[last], (seen.tau if shakes else seen.e)[last, joint], color=BAD, linewidth=0.9, label="as it is")
    if cured is not None and not cured.ending:
        first = found.causes[0]
        after = cured.t >= seen.t[last][0]
        label = "with the cure" if first.key == "law" else f"without {first.key.replace('_', ' ')}"
        ax.plot(cured.t[after], (cured.tau if shakes else cured.e)[after, joint], color=INK, linewidth=1.2, label=label)
    ax.set_title(found.joints[joint], loc="left")
    ax.set_ylabel("torque [N m]" if shakes else "error [rad]")
    ax.set_xlabel("time [s]")
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)


def _bode(size: Axes, phase: Axes, found: Diagnosis) -> None:
    margins = found.margins
    if margins is None:
        return
    shake = found.seen.shaking
    least = (margins.crossover or np.inf) / BELOW
    if shake is not None and np.isfinite(shake.frequency):
        least = min(least, shake.frequency / 3.0)
    shown = margins.frequency >= min(least, margins.frequency[-1] / BELOW)
    f, angle, gain = margins.frequency[shown], margins.angle[shown], margins.gain[shown]
    size.loglog(f, np.abs(gain), color=INK)
    size.axhline(1.0, **REFERENCE)
    size.set_ylabel("size [1]")
    joint = found.joints[margins.joint]
    size.set_title(f"open loop of {joint} at t = {margins.time:.3g} s", loc="left")
    phase.semilogx(f, angle, color=INK)
    phase.axhline(-180.0, **REFERENCE)
    phase.set_ylim(max(-400.0, float(angle.min()) - 10.0), max(0.0, float(angle.max()) + 10.0))
    phase.set_ylabel("phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    if margins.crossover is not None and margins.phase is not None:
        for ax in (size, phase):
            ax.axvline(margins.crossover, **LIMIT)
        colour = BAD if margins.phase <= 0.0 else INK
        phase.plot(2 * [margins.crossover], [-180.0, margins.phase - 180.0], color=colour, linewidth=2.5)
        phase.set_title(f"phase margin {margins.phase:.0f} deg at {margins.crossover:.3g} Hz", loc="left", color=colour)
    if shake is not None and np.isfinite(shake.frequency):
        size.axvline(shake.frequency, color=BAD, linewidth=0.9)
        size.annotate(
            f" shakes at {shake.frequency:.3g} Hz",
            (shake.frequency, 0.96),
            xycoords=size.get_xaxis_transform(),
            color=BAD,
            va="top",
            ha="left" if shake.frequency < f[-1] / 5.0 else "right",
        )
    plain_powers(size.xaxis, phase.xaxis, size.yaxis)
