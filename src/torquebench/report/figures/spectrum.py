"""The figure of the torque's spectrum, with the frequency from which it counts as chattering."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.kernel import Array
from torquebench.metrics.chattering import hann_spectrum
from torquebench.report.figures import style
from torquebench.report.figures.cells import MOST_LINES
from torquebench.report.figures.layout import LIMIT, SHADE, finish_page, panel_grid, printable, shade_key
from torquebench.report.figures.run_view import Run, RunView
from torquebench.sim.trajectory import Trajectory

SPECTRUM_FLOOR = 1e-4
"""Lowest torque amplitude shown in the spectrum [% of tau_max]."""
BEYOND = 1.3
"""End of the spectrum's axis [half the control rate]: a law that switches every instant has its line at 1."""

_BANDS = 24  # per octave, in the spectrum
_PEAK: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.0}


def draw_spectrum(x: RunView) -> Figure | None:
    """Draw amplitudes over frequency; None where no run completed.

    Of more than five controllers each has a panel of its own, with the sum of the amplitudes of all joints.
    """
    lines = {run.name: fa for run in x.runs if (fa := amplitudes(x, run.data)) is not None}
    if not lines:
        return None
    apart = len(x.runs) > MOST_LINES
    if apart:
        lines = {name: (f, a.sum(axis=1, keepdims=True)) for name, (f, a) in lines.items()}
    top = max(10.0 * SPECTRUM_FLOOR, 2.0 * max(float(a.max()) for _, a in lines.values()))
    half_rate = 0.5 / x.control_period
    y_labels = x.by_kind("torque amplitude [% of limit]", "force amplitude [% of limit]")

    def note(run: Run) -> str:
        if run.name not in lines:
            return " (no spectrum)"
        below = lines[run.name][1].max() < SPECTRUM_FLOOR
        return x.chattering_note(run) + (" (below axis)" if below else "")

    if apart:
        word = "/".join(dict.fromkeys(x.by_kind("torque", "force")))
        names, y_labels = [run.name for run in x.runs], [f"{word}, joints'\nsum [% of limit]"] * len(x.runs)
        fig, panels = panel_grid(names, "frequency [Hz]", y_labels, 3, (1.2, 1.8))
        for ax, run in zip(panels, x.runs, strict=True):
            ax.set_title(f"{printable(run.name)}\n{note(run).strip(' ()')}", fontsize=7.5)
    else:
        fig, panels = panel_grid(x.joint_names, "frequency [Hz]", y_labels)
    marked = False
    for i, ax in enumerate(panels):
        ax.loglog()
        ax.axvspan(half_rate, BEYOND * half_rate, **SHADE)
        ax.axvline(x.chattering_from_hz, **LIMIT)
        for run in x.runs[i : i + 1] if apart else x.runs:
            if run.name in lines:
                f, a = lines[run.name][0], np.maximum(lines[run.name][1][:, 0 if apart else i], 0.1 * SPECTRUM_FLOOR)
                dashless = {"linestyle": "-"} if apart else {}
                hair = run.look | {"linewidth": 0.4, "linestyle": "-", "alpha": 0.35}
                ax.plot(f, a, **hair)
                ax.plot(*style.band_maxima(f, a, _BANDS), **run.look | {"linewidth": 1.1} | dashless)
                peaks = style.isolated_peaks(f, a)
                peaks = peaks[(f[peaks] >= x.chattering_from_hz) & (a[peaks] > SPECTRUM_FLOOR)]
                if len(peaks):
                    marked = True
                    ax.plot(f[peaks], a[peaks], color=run.look["color"], zorder=run.look["zorder"] + 1.0, **_PEAK)
        ax.set_xlim(min(f[0] for f, _ in lines.values()), BEYOND * half_rate)
        ax.set_ylim(SPECTRUM_FLOOR, top)
        style.plain_powers(ax.xaxis, ax.yaxis)
    others: list[Artist] = [
        Line2D([], [], label=f"{x.chattering_from_hz:g} Hz: chattering counts from here", **LIMIT),
        Line2D([], [], color="0.75", linewidth=3.0, label=f"each line (bold: greatest of 1/{_BANDS} octave)"),
        *([Line2D([], [], color="0.4", label="line that stands alone", **_PEAK)] if marked else []),
        shade_key(f"above half the control rate ({half_rate:g} Hz)"),
    ]

    if apart:
        finish_page(fig, x.title, x.subtitle, others)
        return fig
    return x.finish(fig, note, *others)


def amplitudes(x: RunView, data: Trajectory) -> tuple[Array, Array] | None:
    """Return frequencies (N,) [Hz] and amplitudes (N, n) [% of tau_max] of the torque of a completed run."""
    tau = data.tau[data.t > x.metrics_from - 1e-6 * x.control_period]
    if not data.completed or len(tau) < 8:
        return None
    frequency, spectrum = hann_spectrum(tau, x.control_period)
    # The taper's mean is 1/2, and a line has a mirror image; only the one at half the control rate has none.
    a = 400.0 * np.abs(spectrum) / len(tau) / x.tau_max
    a[-1] *= 0.5 if len(tau) % 2 == 0 else 1.0
    return frequency[1:], a[1:]
