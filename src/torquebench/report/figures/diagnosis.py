"""A diagnosis drawn: a bar for each cause, and the loop's frequency response with its margins."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from torquebench.diagnosis import Diagnosis
from torquebench.report.figures.layout import LIMIT, PAGE_WIDTH, REFERENCE
from torquebench.report.figures.style import journal_style, plain_powers

INK, BAD, SOFT = "#0b559f", "#b42318", "0.45"


def diagnosis_figure(found: Diagnosis) -> Figure:
    """Draw a diagnosis: causes, then size and phase of the open loop of the joint with the least phase margin.

    Args:
        found: The diagnosis.
    """
    margins, rows = found.margins, len(found.causes)
    with journal_style():
        heights = ([0.35 + 0.3 * rows] if rows else []) + ([1.7, 1.7] if margins is not None else [])
        fig = Figure(figsize=(PAGE_WIDTH, max(1.0, sum(heights) + 0.5 * len(heights))), layout="constrained")
        panels: list[Axes] = []
        if heights:
            panels = list(np.atleast_1d(fig.subplots(len(heights), 1, height_ratios=heights)))
        if rows:
            _bars(panels[0], found)
        if margins is not None:
            _bode(panels[-2], panels[-1], found)
    return fig


def _bars(ax: Axes, found: Diagnosis) -> None:
    causes = found.causes[::-1]
    ax.barh(range(len(causes)), [100 * cause.effect for cause in causes], height=0.55, color=INK)
    labels = [f"{cause.symptom}: {cause.title.rstrip(',').removeprefix('the ')}" for cause in causes]
    ax.set_yticks(range(len(causes)), labels)
    ax.set_xlim(0.0, 100.0)
    ax.set_xlabel("share of the symptom's power that goes with it [%]")


def _bode(size: Axes, phase: Axes, found: Diagnosis) -> None:
    margins = found.margins
    if margins is None:
        return
    f, angle = margins.frequency, margins.angle
    size.loglog(f, np.abs(margins.gain), color=INK)
    size.axhline(1.0, **REFERENCE)
    size.set_ylabel("size of the open loop [1]")
    joint = found.joints[margins.joint]
    size.set_title(f"joint {margins.joint + 1} ({joint}) at t = {margins.time:.3g} s", loc="left")
    phase.semilogx(f, angle, color=INK)
    phase.axhline(-180.0, **REFERENCE)
    phase.set_ylim(max(-400.0, float(angle.min()) - 10.0), max(0.0, float(angle.max()) + 10.0))
    phase.set_ylabel("its phase [deg]")
    phase.set_xlabel("frequency [Hz]")
    if margins.crossover is not None and margins.phase is not None:
        for ax in (size, phase):
            ax.axvline(margins.crossover, **LIMIT)
        colour = BAD if margins.phase <= 0.0 else INK
        phase.plot(2 * [margins.crossover], [-180.0, margins.phase - 180.0], color=colour, linewidth=2.5)
        phase.annotate(
            f"phase margin {margins.phase:.0f} deg at {margins.crossover:.3g} Hz",
            (margins.crossover, -180.0),
            (0.01, 0.06),
            textcoords="axes fraction",
            color=colour,
        )
    shake = found.seen.shaking
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
