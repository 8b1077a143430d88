"""Figs 9, 10 and 11 as one page each: a row per joint with motion, error and a close look at the torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.metrics import Metrics
from torquebench.report.figures import style
from torquebench.report.figures.layout import REFERENCE, new_page, printable
from torquebench.report.figures.run_view import RunView, draw
from torquebench.report.figures.signals import rmse_note
from torquebench.report.figures.torque import draw_zoom, zoom_window
from torquebench.sim.trajectory import Trajectory


def comparison_page(
    runs: Mapping[str, Trajectory],
    metrics: Mapping[str, Metrics],
    title: str,
    subtitle: str,
    *,
    joint_names: Sequence[str],
    tau_max: Array,
    metrics_from: float,
    control_period: float,
) -> Figure:
    """Draw one page: position with its reference, error, and the torque between control instants.

    Args:
        runs: Controller name -> its run, in the order of the legend.
        metrics: Controller name -> metrics of its run.
        title, subtitle: Headings.
        joint_names: Names of the joints, all of which turn.
        tau_max: Torque limits, (n,) [N m].
        metrics_from: Start of the metrics' window [s].
        control_period: Time between control instants [s].

    Raises:
        ResultError: there is no run, or the runs are too short to enlarge.
    """
    n = len(joint_names)
    x = RunView(
        runs,
        title=title,
        subtitle=subtitle,
        joint_names=joint_names,
        tau_max=tau_max,
        metrics_from=metrics_from,
        control_period=control_period,
        metrics=metrics,
    )
    zoom = zoom_window(x)
    if zoom is None:
        raise ResultError("a page needs runs long enough to show a part of them enlarged")
    with style.journal_style():
        fig = new_page(n, 1.1, 2.0)
        grid = fig.add_gridspec(n, 3, width_ratios=(1.0, 1.0, 0.8))
        errors = {run.name: run.data.q_ref - run.data.q for run in x.runs}
        low, high = style.limits(
            [e[run.data.t >= metrics_from] for run, e in zip(x.runs, errors.values(), strict=True)]
        )
        unit = style.choose_unit(max(-low, high), "rad")
        for i, name in enumerate(joint_names):
            position, error, torque = (fig.add_subplot(grid[i, column]) for column in range(3))
            reference = x.longest.q_ref[:, i]
            draw(position, x, {run.name: run.data.q[:, i] for run in x.runs}, False, [reference])
            position.plot(x.longest.t, reference, **REFERENCE)
            position.set_ylabel(f"{printable(name)}\nposition [rad]")
            draw(error, x, {key: e[:, i] * unit.factor for key, e in errors.items()}, True)
            late = [e[run.data.t >= metrics_from, i] for run, e in zip(x.runs, errors.values(), strict=True)]
            low, high = style.limits(late, floor=1e-6)
            error.set_ylim(low * unit.factor * 1.3, high * unit.factor * 1.3)
            error.set_ylabel(f"e [{unit.name}]")
            draw_zoom(torque, x, i, zoom)
            torque.set_ylabel("torque [N m]")
            for ax, text in (
                (position, "position"),
                (error, "error e"),
                (torque, f"torque, {1e3 * _span(zoom):.3g} ms"),
            ):
                ax.set_title(text if i == 0 else "", loc="left", pad=3.0)
                ax.set_xlabel("time [s]" if i == n - 1 else "")
                ax.tick_params(labelbottom=i == n - 1)
        return x.finish(fig, lambda run: rmse_note(x, run), Line2D([], [], label="reference", **REFERENCE))


def _span(zoom: tuple[float, float]) -> float:
    return float(np.subtract(zoom[1], zoom[0]))
