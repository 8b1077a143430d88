"""The figures of one experiment: controllers over one another, a panel per joint, a page per signal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.analysis import style
from torquebench.analysis.overlay import SHADE, Experiment, Run, draw, looks
from torquebench.analysis.page import new_page, panel_grid, printable
from torquebench.analysis.style import figure_bytes
from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.measures import HF_FROM_HZ, hann_spectrum
from torquebench.metrics import Metrics
from torquebench.sim.trajectory import Trajectory

__all__ = ["figure_bytes", "make_figures"]

ZOOM = 0.060
"""Length of the torque figure's zoomed window [s]; at least 20 control periods."""
SPECTRUM_FLOOR = 1e-4
"""Lowest torque amplitude shown in the spectrum [% of tau_max]."""

_TIME = "time [s]"
_BANDS = 24  # per octave, in the spectrum
_LIMIT: dict[str, Any] = {"color": "0.4", "linewidth": 0.8, "linestyle": (0, (1.5, 1.5))}
_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 0.8, "linestyle": (0, (4.0, 2.5)), "zorder": 3.0}
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
) -> dict[str, Figure]:
    """Draw all figures of one experiment.

    Args:
        runs: Controller name -> its run, in the order of the legend. A failed run is drawn up to its end,
            which is marked with a cross, and does not set the range of an axis.
        title: Heading of every page.
        subtitle: What was run: reference, chain, definition of the noise. Line breaks are kept.
        joint_names: One name per panel, n of them.
        tau_max: Torque limits, (n,) [N m].
        metrics_from: Start of the metrics' window [s].
        control_period: Time between control instants [s].
        metrics: Controller name -> metrics of its run; headlines are quoted in the legends.

    Returns:
        `position`, `error`, `torque`, `sliding` (left out when no law has a sliding variable) and `spectrum`
        (left out when no run completed).

    Raises:
        ResultError: there is no run, or the runs do not all have n joints.
    """
    n = len(joint_names)
    if not runs or n == 0 or len(tau_max) != n or any(data.q.shape[1] != n for data in runs.values()):
        raise ResultError(f"figures need at least one run, and {n} joints in every run and in the torque limits")
    x = Experiment(
        looks(runs, tau_max, control_period),
        title,
        subtitle,
        joint_names,
        tau_max,
        metrics_from,
        control_period,
        metrics or {},
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
    x: Experiment, what: str, unit: str, signal: Callable[[Trajectory], Array], *, thin: bool, reference: bool
) -> Figure:
    """Draw a signal of all runs over time, one panel per joint, in the unit that its size asks for."""
    values = {run.name: signal(run.data) for run in x.runs}
    values = {name: y for name, y in values.items() if np.isfinite(y).any()}
    trusted = [values[run.name] for run in x.runs if run.data.completed and run.name in values]
    reference_q = [x.longest.q_ref] if reference else []
    low, high = style.limits([*trusted, *reference_q], [] if trusted else values.values())
    chosen = style.choose_unit(max(-low, high), unit)
    fig, panels = panel_grid(x.joint_names, _TIME, f"{what} [{chosen.name}]")
    for i, ax in enumerate(panels):
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        more = [q_ref[:, i] * chosen.factor for q_ref in reference_q]
        draw(ax, x, {name: y[:, i] * chosen.factor for name, y in values.items()}, thin, more)
        for y in more:
            ax.plot(*style.decimate(x.longest.t, y, x.bins), **_REFERENCE)
    return fig


def _position(x: Experiment) -> Figure:
    fig = _time_panels(x, "position", "rad", lambda data: data.q, thin=False, reference=True)
    return x.finish(fig, lambda _: "", Line2D([], [], label="reference", **_REFERENCE), *x.shade())


def _rmse(value: float) -> str:
    unit = style.choose_unit(value, "rad")
    return f"RMSE {value * unit.factor:.3g} {unit.name}"


def _error(x: Experiment) -> Figure:
    fig = _time_panels(x, "error e", "rad", lambda data: data.q_ref - data.q, thin=False, reference=False)
    return x.finish(fig, lambda run: x.headline(run, "rmse", _rmse), *x.shade())


def _sliding(x: Experiment) -> Figure | None:
    has = {run.name: bool(np.isfinite(run.data.s).any()) for run in x.runs}
    if not any(has.values()):
        return None
    fig = _time_panels(x, "sliding variable s", "rad/s", lambda data: data.s, thin=True, reference=False)
    return x.finish(fig, lambda run: "" if has[run.name] else " (has none)", *x.shade())


def _hf(value: float) -> str:
    return f"HF {value:.3g} %"


def _torque(x: Experiment) -> Figure:
    n = len(x.joint_names)
    zoom = _zoom_window(x)
    fig = new_page(n, 1.05, 3.0)
    grid = fig.add_gridspec(n, 2, width_ratios=(3.6, 1.4))
    for i, name in enumerate(x.joint_names):
        ax, detail = fig.add_subplot(grid[i, 0]), fig.add_subplot(grid[i, 1])
        ax.set_label(name)
        detail.set_label(f"{name} zoom")
        ax.set_ylabel(f"{printable(name)}\ntorque [N m]")
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        ax.axvspan(*zoom, **_ZOOMED)
        draw(ax, x, {run.name: run.data.tau[:, i] for run in x.runs}, thin=True)
        _limit_lines(ax, float(x.tau_max[i]))
        _detail(detail, x, i, zoom)
        for panel in (ax, detail):
            panel.set_xlabel(_TIME if i == n - 1 else "")
            panel.tick_params(labelbottom=i == n - 1)
    others = (
        Line2D([], [], label="torque limit", **_LIMIT),
        Patch(label=f"zoomed at the right ({1e3 * (zoom[1] - zoom[0]):.3g} ms)", **_ZOOMED),
        *x.shade(),
    )
    return x.finish(fig, lambda run: x.headline(run, "hf", _hf), *others)


def _zoom_window(x: Experiment) -> tuple[float, float]:
    """Return the time span [s] shown large: the middle of the metrics' window, or of a shorter run."""
    end = float(x.longest.t[-1])
    start = x.metrics_from if x.metrics_from < end else 0.0
    middle, half = (start + end) / 2.0, max(ZOOM, 20.0 * x.control_period) / 2.0
    return middle - half, middle + half


def _limit_lines(ax: Axes, limit: float) -> None:
    """Draw +-`limit`; the range takes it in where the torque uses half of it, else it is written."""
    low, high = ax.get_ylim()
    for sign in (1.0, -1.0):
        ax.axhline(sign * limit, **_LIMIT)
    low = min(low, -1.1 * limit) if low < -0.5 * limit else low
    high = max(high, 1.1 * limit) if high > 0.5 * limit else high
    written = low > -limit and high < limit
    ax.set_ylim(low, high + 0.25 * (high - low) if written else high)
    if written:
        ax.annotate(
            f"limit \u00b1{limit:.4g} N m", (1.0, 1.0), (-3.0, -3.0), "axes fraction", "offset points",
            ha="right", va="top", fontsize=7.0, color="0.3", zorder=5.0,
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.8},
        )  # fmt: skip


def _detail(ax: Axes, x: Experiment, joint: int, zoom: tuple[float, float]) -> None:
    """Draw the torque in the zoomed window as what it is: held between control instants."""
    shown = []
    for run in x.runs:
        t, tau = run.data.t, run.data.tau[:, joint]
        inside = (np.abs(t - sum(zoom) / 2.0) < (zoom[1] - zoom[0]) / 2.0 + 1.5 * x.control_period) & np.isfinite(tau)
        if not inside.any():
            continue
        shown.append(tau[inside])
        ax.plot(t[inside], tau[inside], drawstyle="steps-post", **run.look | {"linewidth": 0.9})
    ax.set_xlim(*zoom)
    ax.set_ylim(*style.limits(shown, floor=1e-3 * float(x.tau_max[joint])))
    style.plain_numbers(ax, x_bins=3, y_bins=4)


def _spectrum(x: Experiment) -> Figure | None:
    lines = {}
    for run in x.runs:
        tau = run.data.tau[run.data.t > x.metrics_from - 1e-6 * x.control_period]
        if run.data.completed and len(tau) >= 8:
            frequency, spectrum = hann_spectrum(tau, x.control_period)
            # Amplitude of a sinusoid: the taper's mean is 1/2, and the line has a mirror image.
            lines[run.name] = frequency[1:], 400.0 * np.abs(spectrum[1:]) / len(tau) / x.tau_max
    if not lines:
        return None
    top = max(10.0 * SPECTRUM_FLOOR, 2.0 * max(float(a.max()) for _, a in lines.values()))
    fig, panels = panel_grid(x.joint_names, "frequency [Hz]", "torque [% of limit]")
    for i, ax in enumerate(panels):
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.axvline(HF_FROM_HZ, **_LIMIT)
        for run in x.runs:
            if run.name in lines:
                f, a = lines[run.name]
                a = np.maximum(a[:, i], 0.1 * SPECTRUM_FLOOR)
                hair = run.look | {"linewidth": 0.4, "linestyle": "-", "alpha": 0.35}
                ax.plot(*style.decimate(f, a, x.bins, logarithmic=True), **hair)
                ax.plot(*style.band_maxima(f, a, _BANDS), **run.look | {"linewidth": 1.1})
        ax.set_xlim(min(f[0] for f, _ in lines.values()), max(f[-1] for f, _ in lines.values()))
        ax.set_ylim(SPECTRUM_FLOOR, top)
        style.plain_decades(ax)
    border = Line2D([], [], label=f"{HF_FROM_HZ:g} Hz: HF counts from here", **_LIMIT)
    pale = Line2D([], [], color="0.75", linewidth=3.0, label=f"each line (bold: greatest of 1/{_BANDS} octave)")

    def note(run: Run) -> str:
        return x.headline(run, "hf", _hf) if run.name in lines else " (no spectrum)"

    return x.finish(fig, note, border, pale)
