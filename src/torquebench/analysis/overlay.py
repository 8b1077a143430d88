"""Controllers over one another: how each run looks, and how one joint's signals share a panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.analysis import style
from torquebench.analysis.page import finish_page, level_lines, printable, write_note
from torquebench.kernel import Array
from torquebench.metrics import METRICS, Metrics
from torquebench.metrics.chattering import hann_spectrum
from torquebench.metrics.torque import measure_torques
from torquebench.sim.trajectory import Outcome, Trajectory

CHATTERING = 20.0
"""Total variation of the torque from which a run is drawn thin where its line fills an area [tau_max/s]."""
ZOOM = 0.060
"""Length of the torque figure's zoomed window [s]; at least 20 control periods."""
SHADE: dict[str, Any] = {"color": "0.95", "linewidth": 0.0, "zorder": 0.5}

_BAND: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (1.0, 1.5)), "zorder": 3.0}
_OUTCOMES = {
    Outcome.DIVERGED: " (diverged)",
    Outcome.BAD_TORQUE: " (non-finite torque)",
    Outcome.CONTROLLER_ERROR: " (law failed)",
}
_POINTS = 36_000  # samples drawn per page: about 1 MB of SVG


class Run(NamedTuple):
    """One controller's run and its look, which is the same on every page."""

    name: str
    data: Trajectory
    chatters: bool
    look: dict[str, Any]


@dataclass(frozen=True)
class Comparison:
    """What all pages of one experiment share; `runs` in the order of the legend."""

    runs: tuple[Run, ...]
    title: str
    subtitle: str
    joint_names: Sequence[str]
    tau_max: Array
    metrics_from: float
    control_period: float
    metrics: Mapping[str, Metrics]
    bands: Mapping[str, Array]
    slides: tuple[bool, ...]

    def by_kind(self, hinge: str, slide: str) -> list[str]:
        """Return one of two texts per joint: `hinge` for a joint that turns, `slide` for one that slides."""
        return [slide if slides else hinge for slides in self.slides]

    @property
    def longest(self) -> Trajectory:
        """The run that lasted longest; the others see the same reference."""
        return max((run.data for run in self.runs), key=lambda data: len(data.t))

    @property
    def bins(self) -> int:
        """Stretches per line that keep a page within its size."""
        return max(60, min(600, _POINTS // (2 * len(self.runs) * len(self.joint_names))))

    def headline(self, run: Run, key: str, text: Callable[[float], str]) -> str:
        """Return the run's headline metric for the legend, or nothing where it has none."""
        metrics = self.metrics.get(run.name)
        value = None if metrics is None else metrics[key].value
        return "" if value is None else f" ({text(value)})"

    def finish(self, fig: Figure, note: Callable[[Run], str], *others: Artist) -> Figure:
        """Add title, subtitle and legend; `note` says what a run's legend entry adds to its name."""
        keys: list[Artist] = []
        for run in self.runs:
            label = printable(run.name) + _OUTCOMES.get(run.data.outcome, "") + note(run)
            look = run.look | {"linewidth": max(1.2, run.look["linewidth"]), "label": label}
            keys.append(Line2D([], [], marker="" if run.data.completed else "x", markersize=5.0, **look))
        finish_page(fig, self.title, self.subtitle, [*keys, *others])
        return fig

    def shade(self) -> list[Artist]:
        """Return the legend entry of the time before the metrics' window, if there is such a time."""
        label = f"before the metrics' window (t < {self.metrics_from:g} s)"
        return [Patch(label=label, **SHADE | {"color": "0.9"})] if self.metrics_from > 0.0 else []


def looks(runs: Mapping[str, Trajectory], tau_max: Array, control_period: float) -> tuple[Run, ...]:
    """Give each run its look: colour and dash by its place in the legend, layer and width by how much it chatters.

    A controller therefore looks the same in every experiment that has the same controllers. The most restless
    torque is drawn first and widest, so that calmer lines lie over it and a line that coincides with another
    shows at its edges or through its gaps.
    """
    restless = {name: _restlessness(data.tau, tau_max, control_period) for name, data in runs.items()}
    rank = {name: k for k, name in enumerate(sorted(runs, key=lambda name: -restless[name]))}
    chosen = []
    for k, (name, data) in enumerate(runs.items()):
        look = {
            "color": style.COLOURS[k % len(style.COLOURS)],
            "linestyle": style.DASHES[k % len(style.DASHES)],
            "linewidth": max(0.9, 1.6 - 0.25 * rank[name]),
            "zorder": 2.0 + 0.01 * rank[name],
        }
        chosen.append(Run(name, data, restless[name] >= CHATTERING, look))
    return tuple(chosen)


def _restlessness(tau: Array, tau_max: Array, control_period: float) -> float:
    finite = tau[np.isfinite(tau).all(axis=1)]
    return float(np.mean(measure_torques(finite, control_period, tau_max).total_variation)) if len(finite) > 1 else 0.0


def draw(ax: Axes, x: Comparison, signals: Mapping[str, Array], thin: bool, more: Sequence[Array] = ()) -> None:
    """Draw one joint's signals (N,) by controller; set the ranges of both axes from them and from `more`."""
    failed = [signals[run.name] for run in x.runs if run.name in signals and not run.data.completed]
    whole = [signals[run.name] for run in x.runs if run.name in signals and run.data.completed]
    low, high = style.limits([*whole, *more], failed)
    room = 9.0 * (high - low)  # beyond the page, yet within what a renderer can handle
    for run in x.runs:
        if run.name not in signals:
            continue
        y = signals[run.name]
        finite = np.isfinite(y)
        t, y = run.data.t[finite], y[finite]
        if len(y) == 0:
            continue
        look = run.look | ({"linewidth": 0.5, "alpha": 0.85} if thin and run.chatters else {})
        ax.plot(*style.decimate(t, np.clip(y, low - room, high + room), x.bins), **look)
        if not run.data.completed:
            end = min(max(y[-1], low), high)
            ax.plot(t[-1], end, "x", color=look["color"], ms=6.0, mew=1.6, zorder=4.0, clip_on=False)
    ax.set_ylim(low, high)
    ax.set_xlim(0.0, x.longest.t[-1] + x.control_period)
    style.plain_numbers(ax)


def zoom_window(x: Comparison) -> tuple[float, float] | None:
    """Return the time span [s] to show large: the middle of the metrics' window, or of a shorter run.

    None where there is nothing to enlarge: the span would be most of the run, or holds no torque.
    """
    end = float(x.longest.t[-1])
    start = x.metrics_from if x.metrics_from < end else 0.0
    middle, half = (start + end) / 2.0, max(ZOOM, 20.0 * x.control_period) / 2.0
    if 4.0 * half > end or not any(
        np.isfinite(run.data.tau[np.abs(run.data.t - middle) < half]).any() for run in x.runs
    ):
        return None
    return middle - half, middle + half


def draw_zoom(ax: Axes, x: Comparison, joint: int, zoom: tuple[float, float]) -> Axes:
    """Draw the torque of `joint` of all runs of `x` into `ax` as what it is: held between control instants.

    The panel shows the time span `zoom` [s], and comes back.
    """
    ax.set_label(f"{x.joint_names[joint]} zoom")
    shown = []
    for run in x.runs:
        t, tau = run.data.t, run.data.tau[:, joint]
        inside = (np.abs(t - sum(zoom) / 2.0) < (zoom[1] - zoom[0]) / 2.0 + 1.5 * x.control_period) & np.isfinite(tau)
        if not inside.any():
            continue
        shown.append(tau[inside])
        # Solid: dashes would take the edges off a torque that switches every instant.
        look = run.look | {"linewidth": 0.7 * run.look["linewidth"], "linestyle": "-"}
        ax.plot(t[inside], tau[inside], drawstyle="steps-post", **look)
    ax.set_xlim(*zoom)
    ax.set_ylim(*style.limits(shown, floor=1e-3 * float(x.tau_max[joint])))
    style.plain_numbers(ax, x_bins=3, y_bins=4)
    return ax


def amplitudes(x: Comparison, data: Trajectory) -> tuple[Array, Array] | None:
    """Return frequencies (N,) [Hz] and amplitudes (N, n) [% of tau_max] of the torque of a completed run."""
    tau = data.tau[data.t > x.metrics_from - 1e-6 * x.control_period]
    if not data.completed or len(tau) < 8:
        return None
    frequency, spectrum = hann_spectrum(tau, x.control_period)
    # The taper's mean is 1/2, and a line has a mirror image; only the one at half the control rate has none.
    a = 400.0 * np.abs(spectrum) / len(tau) / x.tau_max
    a[-1] *= 0.5 if len(tau) % 2 == 0 else 1.0
    return frequency[1:], a[1:]


def rmse_note(x: Comparison, run: Run) -> str:
    """Return the RMS error for the legend: in mrad and in mm, as in tables, whatever its size."""
    metrics = x.metrics.get(run.name)
    if metrics is None or metrics.rmse.value is None:
        return ""
    kinds = x.by_kind("mrad", "mm")
    texts = []
    for unit in dict.fromkeys(kinds):
        errors = [e for e, kind in zip(metrics.rmse.per_joint, kinds, strict=True) if kind == unit and e is not None]
        rmse = 1e3 * METRICS["rmse"].over(np.array(errors))
        texts.append(f"{rmse:.3g} {unit}" if rmse < 999.5 else f"{rmse:.0f} {unit}")
    return f" (RMSE {', '.join(texts)})"


def band_lines(x: Comparison, fig: Figure, units: Sequence[style.Unit]) -> list[Artist]:
    """Draw the bands |s| <= phi and return their legend entries; equal ones are drawn once, in grey.

    A lone band too wide for a panel is written there instead.
    """
    owners: dict[tuple[float, ...], list[Run]] = {}
    for run in x.runs:
        if run.name in x.bands:
            owners.setdefault(tuple(x.bands[run.name].tolist()), []).append(run)
    used = [ax.get_ylim() for ax in fig.axes]
    keys: list[Artist] = []
    for phi in sorted(owners, reverse=True):
        shared, alone = len(owners[phi]) > 1, len(owners) == 1
        look = _BAND | {"color": "0.4" if shared else owners[phi][0].look["color"]}
        seen = []
        for ax, width, unit, used_here in zip(fig.axes, phi, units, used, strict=True):
            seen.append(level_lines(ax, width * unit.factor, used_here, look))
            if alone and not seen[-1]:
                write_note(ax, f"band \u00b1{width * unit.factor:.4g} {unit.name}")
        label = "band \u00b1phi" + ("" if shared or alone else f" of {printable(owners[phi][0].name)}")
        if any(seen) or not alone:
            keys.append(Line2D([], [], label=label + ("" if any(seen) else " (beyond the axes)"), **look))
    return keys
