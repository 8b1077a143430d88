"""The runs of one experiment as its figures show them: each controller has the same look on every page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.certificates import Certificate
from torquebench.errors import ResultError
from torquebench.figures import Drawing, FigureInfo, figures_in_order
from torquebench.fuzzy import Prepared
from torquebench.kernel import Array
from torquebench.metrics import Metrics
from torquebench.metrics.torque import measure_torques
from torquebench.report.figures import style
from torquebench.report.figures.files import Drawn, Job, may_draw, named, wanted
from torquebench.report.figures.layout import finish_page, printable, shade_key
from torquebench.report.looks import looks
from torquebench.report.tables import number
from torquebench.sim.trajectory import Trajectory

CHATTERING = 20.0
"""Total variation of the torque from which a run is drawn thin where its line fills an area [tau_max/s]."""
TIME = "time [s]"


class Run(NamedTuple):
    """One controller's run and its look, which is the same on every page."""

    name: str
    data: Trajectory
    chatters: bool
    look: dict[str, Any]


class FiredRules(NamedTuple):
    """Shares of the rules of a law's fuzzy system in a run."""

    system: str
    """Name of the system."""
    shares: Array
    """Share of each rule in the firing of all, (n, n1, n2)."""


@dataclass(frozen=True)
class RunView:
    """Data that the figures of one experiment show.

    Raises:
        ResultError: there is no run, or the runs, bands or slides do not all have n joints.
    """

    trajectories: Mapping[str, Trajectory]
    """Controller -> its run, in the order of the legend. A failed run is drawn up to its end, which is marked with a
    cross, and does not set the range of an axis."""
    title: str
    """Heading of every page."""
    subtitle: str
    """What was run: reference, chain, definition of the noise; line breaks are kept."""
    joint_names: Sequence[str]
    """One name per panel, n of them."""
    tau_max: Array
    """Torque limits, (n,) [N m]; force limits [N] of slides."""
    metrics_from: float
    """Start of the metrics' window [s]."""
    control_period: float
    """Time between control instants [s]."""
    chattering_from_hz: float
    """Frequency from which the torque counts as chattering [Hz]."""
    laws: Mapping[str, str] = field(default_factory=dict)
    """Controller -> name of its law, which sets its colour and dash; its own name where it is left out."""
    metrics: Mapping[str, Metrics] = field(default_factory=dict)
    """Controller -> metrics of its run, which legends quote; a run that failed has none."""
    bands: Mapping[str, Array] = field(default_factory=dict)
    """Controller -> half-widths phi of its band |s| <= phi, (n,) [rad/s] ([m/s] of slides), of those that have one."""
    slides: Sequence[bool] = ()
    """Whether each joint slides instead of turning, (n,); no joint does by default."""
    certificates: Mapping[str, Certificate] = field(default_factory=dict)
    """Controller -> stability certificates of its run, of those that have some."""
    fuzzy: Mapping[str, Prepared] = field(default_factory=dict)
    """Fuzzy systems in use, by name."""
    fired: Mapping[str, FiredRules] = field(default_factory=dict)
    """Controller -> rules that fired in its run, of laws with a fuzzy system."""

    def __post_init__(self) -> None:
        n, runs = len(self.joint_names), self.trajectories
        if not runs or n == 0 or np.shape(self.tau_max) != (n,) or any(x.q.shape[1] != n for x in runs.values()):
            raise ResultError(f"figures need at least one run, and {n} joints in every run and in the torque limits")
        bad_band = any(name not in runs or np.shape(phi) != (n,) for name, phi in self.bands.items())
        if bad_band or len(self.slides) not in (0, n):
            raise ResultError(f"figures need one slide flag per joint, and {n} half-widths per band of a controller")

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Each run with its look, in the order of the legend.

        The most restless torque is drawn first and widest, so that calmer lines lie over it and a line that coincides
        with another shows at its edges or through its gaps.
        """
        shown = self.trajectories
        restless = {name: _restlessness(data.tau, self.tau_max, self.control_period) for name, data in shown.items()}
        rank = {name: k for k, name in enumerate(sorted(shown, key=lambda name: -restless[name]))}
        chosen = []
        for name, look in looks({name: self.laws.get(name, name) for name in shown}).items():
            layer = {"linewidth": max(0.9, 1.6 - 0.25 * rank[name]), "zorder": 2.0 + 0.01 * rank[name]}
            chosen.append(Run(name, shown[name], restless[name] >= CHATTERING, style.line_look(look) | layer))
        return tuple(chosen)

    def by_kind(self, hinge: str, slide: str) -> list[str]:
        """Return one of two texts per joint: `hinge` for a joint that turns, `slide` for one that slides."""
        return [slide if slides else hinge for slides in self.slides or [False] * len(self.joint_names)]

    @property
    def longest(self) -> Trajectory:
        """The run that lasted longest; the others see the same reference."""
        return max((run.data for run in self.runs), key=lambda data: len(data.t))

    def chattering_note(self, run: Run) -> str:
        """Return the chattering of a run for the legend; empty where it has no metrics."""
        if run.name not in self.metrics:
            return ""
        return f" (chattering {number(self.metrics[run.name].chattering.value)} %)"

    def finish(self, fig: Figure, note: Callable[[Run], str], *others: Artist) -> Figure:
        """Add title, subtitle and legend; `note` returns what follows a run's name in the legend."""
        keys: list[Artist] = []
        for run in self.runs:
            label = printable(run.name) + ("" if run.data.completed else f" ({run.data.ending})") + note(run)
            look = run.look | {"linewidth": max(1.2, run.look["linewidth"]), "label": label}
            keys.append(Line2D([], [], marker="" if run.data.completed else "x", markersize=5.0, **look))
        finish_page(fig, self.title, self.subtitle, [*keys, *others])
        return fig

    def shade(self) -> list[Artist]:
        """Return the legend entry of the time before the metrics' window, if there is such a time."""
        label = f"before the metrics' window (t < {self.metrics_from:g} s)"
        return [shade_key(label)] if self.metrics_from > 0.0 else []


def draw_jobs(x: RunView) -> dict[str, Job]:
    """Return what draws each registered figure, by name, in order; one of a user's own may raise ResultError."""
    return {
        info.name: partial(_draw_built_in, info, x) if isinstance(info.draw, str) else _foreign(info, info.draw, x)
        for info in figures_in_order()
    }


def draw_figures(x: RunView, only: Sequence[str] = ()) -> dict[str, Figure]:
    """Draw every figure that has something to show, by the name of its file, in order.

    Args:
        x: The runs.
        only: Names of those that are wanted; figures that cannot be among them are not drawn.

    Raises:
        ResultError: a figure of a plug-in cannot be drawn.
    """
    return {
        each: fig
        for name, job in draw_jobs(x).items()
        if may_draw(name, only)
        for each, fig in named(name, job()).items()
        if wanted(each, only)
    }


def _draw_built_in(info: FigureInfo, x: RunView) -> Drawn:
    module = import_module(f"torquebench.report.figures.{info.draw}")
    with style.journal_style():
        drawn: Drawn = getattr(module, f"draw_{info.name}")(x)
    return drawn


def _foreign(info: FigureInfo, draw: Drawing, x: RunView) -> Job:
    """Return what draws a figure of a plug-in."""

    def job() -> Drawn:
        try:
            with style.journal_style():
                drawn: Drawn = draw(x)
        except Exception as error:  # a user's function may raise anything
            raise ResultError(f"figure '{info.name}': {type(error).__name__}: {error}") from error
        for page in drawn.values() if isinstance(drawn, Mapping) else [drawn]:
            if page is not None and not isinstance(page, Figure):
                raise ResultError(f"figure '{info.name}' returned {type(page).__name__}, wanted a matplotlib Figure")
        return drawn

    return job


def _restlessness(tau: Array, tau_max: Array, control_period: float) -> float:
    finite = tau[np.isfinite(tau).all(axis=1)]
    return float(np.mean(measure_torques(finite, control_period, tau_max).total_variation)) if len(finite) > 1 else 0.0


def draw(ax: Axes, x: RunView, signals: Mapping[str, Array], thin: bool, more: Sequence[Array] = ()) -> None:
    """Draw one joint's signals (N,) by controller; set the ranges of both axes from them and from `more`."""
    shown = [(run, signals[run.name]) for run in x.runs if run.name in signals]
    whole = [y for run, y in shown if run.data.completed]
    low, high = style.limits([*whole, *more], [y for run, y in shown if not run.data.completed])
    room = 9.0 * (high - low)  # beyond the page, yet within what a renderer can handle
    for run, y in shown:
        finite = np.isfinite(y)
        t, y = run.data.t[finite], y[finite]
        if len(y) == 0:
            continue
        look = run.look | ({"linewidth": 0.5, "alpha": 0.85} if thin and run.chatters else {})
        ax.plot(t, np.clip(y, low - room, high + room), **look)
        if not run.data.completed:
            end = min(max(y[-1], low), high)
            ax.plot(t[-1], end, "x", color=look["color"], ms=6.0, mew=1.6, zorder=4.0, clip_on=False)
    ax.set_ylim(low, high)
    ax.set_xlim(0.0, x.longest.t[-1] + x.control_period)
