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
from torquebench.analysis.page import finish_page, printable
from torquebench.kernel import Array
from torquebench.measures import total_variation
from torquebench.metrics import Metrics
from torquebench.sim.trajectory import Outcome, Trajectory

CHATTERING = 20.0
"""Total variation of the torque from which a run is drawn solid, thin and below the others [tau_max/s]."""
SHADE: dict[str, Any] = {"color": "0.95", "linewidth": 0.0, "zorder": 0.5}

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
class Experiment:
    """What all pages of one experiment share; `runs` in the order of the legend."""

    runs: tuple[Run, ...]
    title: str
    subtitle: str
    joint_names: Sequence[str]
    tau_max: Array
    metrics_from: float
    control_period: float
    metrics: Mapping[str, Metrics]

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
        value = None if metrics is None else getattr(metrics, key).value
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
    """Give each run its look: colour by its place in the legend, layer, dash, width by how much it chatters.

    The most restless torque is drawn first, solid and widest, so that calmer lines lie over it and a line
    that coincides with another shows through the other's gaps.
    """
    restless = {name: _restlessness(data.tau, tau_max, control_period) for name, data in runs.items()}
    rank = {name: k for k, name in enumerate(sorted(runs, key=lambda name: -restless[name]))}
    chosen = []
    for k, (name, data) in enumerate(runs.items()):
        chatters = restless[name] >= CHATTERING
        look = {
            "color": style.COLOURS[k % len(style.COLOURS)],
            "linestyle": "-" if chatters else style.DASHES[rank[name] % len(style.DASHES)],
            "linewidth": max(0.9, 1.6 - 0.25 * rank[name]),
            "zorder": 2.0 + 0.01 * rank[name],
        }
        chosen.append(Run(name, data, chatters, look))
    return tuple(chosen)


def _restlessness(tau: Array, tau_max: Array, control_period: float) -> float:
    finite = tau[np.isfinite(tau).all(axis=1)]
    return float(np.mean(total_variation(finite, control_period, tau_max))) if len(finite) > 1 else 0.0


def draw(ax: Axes, x: Experiment, signals: Mapping[str, Array], thin: bool, more: Sequence[Array] = ()) -> None:
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
