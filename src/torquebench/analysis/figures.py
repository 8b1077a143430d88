"""The figures of one experiment: controllers over one another, a panel per joint, a page per signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.analysis import style
from torquebench.analysis.overlay import (
    SHADE,
    Comparison,
    Run,
    amplitudes,
    band_lines,
    draw,
    draw_zoom,
    looks,
    rmse_note,
    zoom_window,
)
from torquebench.analysis.page import level_lines, new_page, panel_grid, printable, write_note
from torquebench.analysis.style import figure_bytes
from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.metrics import Metrics
from torquebench.metrics.chattering import HF_FROM_HZ
from torquebench.sim.trajectory import Trajectory

__all__ = ["figure_bytes", "make_figures"]

SPECTRUM_FLOOR = 1e-4
"""Lowest torque amplitude shown in the spectrum [% of tau_max]."""
BEYOND = 1.3
"""End of the spectrum's axis [half the control rate]: a law that switches every instant has its line at 1."""

_TIME = "time [s]"
_BANDS = 24  # per octave, in the spectrum
_LIMIT: dict[str, Any] = {"color": "0.4", "linewidth": 0.8, "linestyle": (0, (1.5, 1.5))}
_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 0.8, "linestyle": (0, (4.0, 2.5)), "zorder": 3.0}
_PEAK: dict[str, Any] = {"marker": "o", "linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.0}
_ZOOMED: dict[str, Any] = {"facecolor": "#F0E442", "alpha": 0.6, "linewidth": 0.0, "zorder": 0.6}


def make_figures(
    runs: Mapping[str, Trajectory],
    *,
    title: str,
    subtitle: str,
    joint_names: Sequence[str],
    tau_max: Array,
    metrics_from: float,
    control_period: float,
    metrics: Mapping[str, Metrics] | None = None,
    bands: Mapping[str, Array] | None = None,
    slides: Sequence[bool] | None = None,
) -> dict[str, Figure]:
    """Draw all figures of one experiment.

    Args:
        runs: Controller name -> its run, in the order of the legend, which sets colour and dash. A failed run is
            drawn up to its end, which is marked with a cross, and does not set the range of an axis.
        title: Heading of every page.
        subtitle: What was run: reference, chain, definition of the noise. Line breaks are kept.
        joint_names: One name per panel, n of them.
        tau_max: Torque limits, (n,) [N m]; force limits [N] of slides.
        metrics_from: Start of the metrics' window [s].
        control_period: Time between control instants [s].
        metrics: Controller name -> metrics of its run; headlines are quoted in the legends.
        bands: Controller name -> half-widths phi of its band |s| <= phi, (n,) [rad/s] ([m/s] of slides), of
            those that have one; drawn in the sliding figure.
        slides: Whether each joint slides instead of turning, (n,); no joint does by default.

    Returns:
        `position`, `error`, `torque`, `sliding` (left out when no law has a sliding variable) and `spectrum`
        (left out when no run completed).

    Raises:
        ResultError: there is no run, or the runs, bands or slides do not all have n joints.
    """
    n = len(joint_names)
    if not runs or n == 0 or len(tau_max) != n or any(data.q.shape[1] != n for data in runs.values()):
        raise ResultError(f"figures need at least one run, and {n} joints in every run and in the torque limits")
    widths = {name: np.asarray(phi, dtype=np.float64) for name, phi in (bands or {}).items()}
    kinds = (False,) * n if slides is None else tuple(bool(slide) for slide in slides)
    if len(kinds) != n or any(name not in runs or phi.shape != (n,) for name, phi in widths.items()):
        raise ResultError(f"figures need one slide flag per joint, and {n} half-widths per band of a controller")
    x = Comparison(
        looks(runs, tau_max, control_period),
        title,
        subtitle,
        joint_names,
        tau_max,
        metrics_from,
        control_period,
        metrics or {},
        widths,
        kinds,
    )
    with style.journal_style():
        pages = {
            "position": _position(x),
            "error": _error(x),
            "torque": _torque(x),
            "sliding": _sliding(x),
            "spectrum": _spectrum(x),
        }
    return {key: page for key, page in pages.items() if page is not None}


def _time_panels(
    x: Comparison, what: str, per: str, signal: Callable[[Trajectory], Array], *, thin: bool, reference: bool
) -> tuple[Figure, list[style.Unit]]:
    """Draw a signal of all runs over time, one panel per joint; return the page and the unit of each joint.

    The unit is rad or m followed by `per`, with the prefix that the signal's size in all joints of a kind asks for.
    """
    values = {run.name: signal(run.data) for run in x.runs}
    values = {name: y for name, y in values.items() if np.isfinite(y).any()}
    trusted = [values[run.name] for run in x.runs if run.data.completed and run.name in values]
    reference_q = [x.longest.q_ref] if reference else []
    kinds = np.array(x.by_kind("rad", "m"))
    chosen = {}
    for kind in dict.fromkeys(kinds.tolist()):
        whole = [y[:, kinds == kind] for y in (*trusted, *reference_q)]
        low, high = style.limits(whole, [] if trusted else [y[:, kinds == kind] for y in values.values()])
        chosen[kind] = style.choose_unit(max(-low, high), kind + per)
    units = [chosen[kind] for kind in kinds.tolist()]
    fig, panels = panel_grid(x.joint_names, _TIME, [f"{what} [{unit.name}]" for unit in units])
    for i, (ax, unit) in enumerate(zip(panels, units, strict=True)):
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        more = [q_ref[:, i] * unit.factor for q_ref in reference_q]
        draw(ax, x, {name: y[:, i] * unit.factor for name, y in values.items()}, thin, more)
        for y in more:
            ax.plot(*style.decimate(x.longest.t, y, x.bins), **_REFERENCE)
    return fig, units


def _position(x: Comparison) -> Figure:
    fig, _ = _time_panels(x, "position", "", lambda data: data.q, thin=False, reference=True)
    return x.finish(fig, lambda _: "", Line2D([], [], label="reference", **_REFERENCE), *x.shade())


def _error(x: Comparison) -> Figure:
    fig, _ = _time_panels(x, "error e", "", lambda data: data.q_ref - data.q, thin=False, reference=False)
    return x.finish(fig, lambda run: rmse_note(x, run), *x.shade())


def _sliding(x: Comparison) -> Figure | None:
    has = {run.name: bool(np.isfinite(run.data.s).any()) for run in x.runs}
    if not any(has.values()):
        return None
    fig, units = _time_panels(x, "sliding variable s", "/s", lambda data: data.s, thin=True, reference=False)
    keys = band_lines(x, fig, units)
    return x.finish(fig, lambda run: "" if has[run.name] else " (has none)", *keys, *x.shade())


def _hf(value: float) -> str:
    return f"HF {value:.3g} %"


def _torque(x: Comparison) -> Figure:
    n = len(x.joint_names)
    zoom = zoom_window(x)
    fig = new_page(n, 1.05, 3.0)
    grid = fig.add_gridspec(n, 2, width_ratios=(3.6, 1.4)) if zoom else fig.add_gridspec(n, 1)
    limit_seen = False
    for i, name in enumerate(x.joint_names):
        ax = fig.add_subplot(grid[i, 0])
        ax.set_label(name)
        ax.set_ylabel(f"{printable(name)}\n{x.by_kind('torque [N m]', 'force [N]')[i]}")
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        draw(ax, x, {run.name: run.data.tau[:, i] for run in x.runs}, thin=True)
        if level_lines(ax, float(x.tau_max[i]), ax.get_ylim(), _LIMIT):
            limit_seen = True
        else:
            write_note(ax, f"limit \u00b1{x.tau_max[i]:.4g} {x.by_kind('N m', 'N')[i]}")
        panels = [ax]
        if zoom:
            ax.axvspan(*zoom, **_ZOOMED)
            panels.append(draw_zoom(fig.add_subplot(grid[i, 1]), x, i, zoom))
        for panel in panels:
            panel.set_xlabel(_TIME if i == n - 1 else "")
            panel.tick_params(labelbottom=i == n - 1)
    others: list[Artist] = [Line2D([], [], label=f"{_torque_word(x)} limit", **_LIMIT)] if limit_seen else []
    if zoom:
        others.append(Patch(label=f"zoomed at the right ({1e3 * (zoom[1] - zoom[0]):.4g} ms)", **_ZOOMED))
    return x.finish(fig, lambda run: x.headline(run, "hf", _hf), *others, *x.shade())


def _torque_word(x: Comparison) -> str:
    return "/".join(dict.fromkeys(x.by_kind("torque", "force")))


def _spectrum(x: Comparison) -> Figure | None:
    lines = {run.name: fa for run in x.runs if (fa := amplitudes(x, run.data)) is not None}
    if not lines:
        return None
    top = max(10.0 * SPECTRUM_FLOOR, 2.0 * max(float(a.max()) for _, a in lines.values()))
    half_rate = 0.5 / x.control_period
    y_labels = x.by_kind("torque amplitude [% of limit]", "force amplitude [% of limit]")
    fig, panels = panel_grid(x.joint_names, "frequency [Hz]", y_labels)
    marked = False
    for i, ax in enumerate(panels):
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.axvspan(half_rate, BEYOND * half_rate, **SHADE)
        ax.axvline(HF_FROM_HZ, **_LIMIT)
        for run in x.runs:
            if run.name in lines:
                f, a = lines[run.name][0], np.maximum(lines[run.name][1][:, i], 0.1 * SPECTRUM_FLOOR)
                hair = run.look | {"linewidth": 0.4, "linestyle": "-", "alpha": 0.35}
                ax.plot(*style.decimate(f, a, x.bins, logarithmic=True), **hair)
                ax.plot(*style.band_maxima(f, a, _BANDS), **run.look | {"linewidth": 1.1})
                peaks = style.isolated_peaks(f, a)
                peaks = peaks[(f[peaks] >= HF_FROM_HZ) & (a[peaks] > SPECTRUM_FLOOR)]
                if len(peaks):
                    marked = True
                    ax.plot(f[peaks], a[peaks], color=run.look["color"], zorder=run.look["zorder"] + 1.0, **_PEAK)
        ax.set_xlim(min(f[0] for f, _ in lines.values()), BEYOND * half_rate)
        ax.set_ylim(SPECTRUM_FLOOR, top)
        style.plain_decades(ax)
    others: list[Artist] = [
        Line2D([], [], label=f"{HF_FROM_HZ:g} Hz: HF counts from here", **_LIMIT),
        Line2D([], [], color="0.75", linewidth=3.0, label=f"each line (bold: greatest of 1/{_BANDS} octave)"),
        *([Line2D([], [], color="0.4", label="line that stands alone", **_PEAK)] if marked else []),
        Patch(label=f"above half the control rate ({half_rate:g} Hz)", **SHADE | {"color": "0.9"}),
    ]

    def note(run: Run) -> str:
        if run.name not in lines:
            return " (no spectrum)"
        below = lines[run.name][1].max() < SPECTRUM_FLOOR
        return x.headline(run, "hf", _hf) + (" (below axis)" if below else "")

    return x.finish(fig, note, *others)
