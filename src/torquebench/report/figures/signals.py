"""Figures of signals over time, a panel for each joint: position, tracking error, sliding variable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import SymmetricalLogLocator

from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.report.figures import style
from torquebench.report.figures.cells import MOST_LINES, draw_cells
from torquebench.report.figures.layout import (
    REFERENCE,
    SHADE,
    is_narrow,
    level_lines,
    panel_grid,
    printable,
    write_note,
)
from torquebench.report.figures.run_view import TIME, Run, RunView, draw
from torquebench.report.tables import joined, number
from torquebench.sim.trajectory import Trajectory

HIDES = 10.0
"""Largest error over that of the middle controller from which all axes are logarithmic beyond the latter's decade."""
_BAND: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (1.0, 1.5)), "zorder": 3.0}


def _time_panels(
    x: RunView, what: str, per: str, signal: Callable[[Trajectory], Array], *, thin: bool, reference: bool
) -> tuple[Figure, list[style.Unit]]:
    """Draw a signal of all runs over time, one panel per joint; return the page and the unit of each joint.

    The unit is rad or m followed by `per`, with the prefix that the signal's size in all joints of a kind asks for.
    """
    values = {run.name: y for run in x.runs if np.isfinite(y := signal(run.data)).any()}
    whole = [values[run.name] for run in x.runs if run.data.completed and run.name in values]
    failed = [values[run.name] for run in x.runs if not run.data.completed and run.name in values]
    reference_q = [x.longest.q_ref] if reference else []
    kinds = np.array(x.by_kind("rad", "m"))
    chosen = {}
    for kind in dict.fromkeys(kinds.tolist()):
        own = kinds == kind
        low, high = style.limits([y[:, own] for y in (*whole, *reference_q)], [y[:, own] for y in failed])
        chosen[kind] = style.choose_unit(max(-low, high), kind + per)
    units = [chosen[kind] for kind in kinds.tolist()]
    fig, panels = panel_grid(x.joint_names, TIME, [f"{what} [{unit.name}]" for unit in units])
    for i, (ax, unit) in enumerate(zip(panels, units, strict=True)):
        ax.axvspan(0.0, x.metrics_from, **SHADE)
        more = [q_ref[:, i] * unit.factor for q_ref in reference_q]
        draw(ax, x, {name: y[:, i] * unit.factor for name, y in values.items()}, thin, more)
        for y in more:
            ax.plot(x.longest.t, y, **REFERENCE)
    return fig, units


def draw_position(x: RunView) -> Figure:
    """Draw positions with their reference."""
    if len(x.runs) > MOST_LINES:
        return _apart(x, "position", "", lambda data: data.q, lambda _: "", reference=x.longest.q_ref)
    fig, _ = _time_panels(x, "position", "", lambda data: data.q, thin=False, reference=True)
    return x.finish(fig, lambda _: "", Line2D([], [], label="reference", **REFERENCE), *x.shade())


def draw_error(x: RunView) -> Figure:
    """Draw tracking errors, with RMSE in the legend."""
    if len(x.runs) > MOST_LINES:
        return _apart(x, "error e", "", lambda data: data.q_ref - data.q, lambda run: rmse_note(x, run), rescale=True)
    fig, units = _time_panels(x, "error e", "", lambda data: data.q_ref - data.q, thin=False, reference=False)
    keys = spread_out(fig, x, [unit.factor for unit in units])
    return x.finish(fig, lambda run: rmse_note(x, run), *keys, *x.shade())


def spread_out(fig: Figure, x: RunView, factors: Sequence[float]) -> list[Artist]:
    """Make the axes of errors logarithmic where the worst run hides the middle one; return the legend's entry.

    Args:
        fig: The figure.
        x: The runs.
        factors: From SI to the unit of each joint, (n,).
    """
    whole = [np.max(np.abs(run.data.q_ref - run.data.q), axis=0) for run in x.runs if run.data.completed]
    peaks = np.array(whole).reshape(-1, len(factors)) * factors
    middle = np.median(peaks, axis=0) if len(peaks) else np.zeros(len(factors))
    if not (middle > 0.0).all() or not (np.max(peaks, axis=0) > HIDES * middle).any():
        return []
    linear = 10.0 ** round(float(np.log10(middle).mean()))
    for ax in fig.axes:
        ax.set_yscale("symlog", linthresh=linear)
        ax.yaxis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=linear))
        ax.yaxis.set_major_formatter("{x:g}")
        if is_narrow() and len(x.runs) > MOST_LINES:  # no room for every decade
            top = 10.0 ** np.floor(np.log10(peaks.max()))
            ax.set_yticks([-top, 0.0, top])
    return [Line2D([], [], linestyle="none", label=f"linear up to \u00b1{linear:g}, logarithmic beyond")]


def _apart(
    x: RunView,
    what: str,
    per: str,
    signal: Callable[[Trajectory], Array],
    note: Callable[[Run], str],
    levels: Mapping[str, Array] | None = None,
    **more: Any,
) -> Figure:
    """Draw a signal of many controllers, a row of panels for each, in one unit.

    Args:
        x: The runs.
        what: Name of the signal.
        per: What follows its unit, rad or m.
        signal: Returns it, (N, n), in SI units; not finite where a law has none.
        note: Returns what follows the name of a run.
        levels: Controller -> levels drawn at +- their values, (n,), in SI units.
        more: Of `draw_cells`: `reference` in SI units, `rescale`, any, for the scale of errors.
    """
    unit = "/".join(dict.fromkeys(x.by_kind("rad", "m")))
    values = {run.name: y for run in x.runs if np.isfinite(y := signal(run.data)).any()}
    peak = max(float(np.nanmax(np.abs(y[np.isfinite(y)]))) for y in values.values())
    scale = style.choose_unit(peak, unit) if unit in ("rad", "m") else style.Unit(f"({unit})", 1.0)
    own = {name: phi * scale.factor for name, phi in (levels or {}).items()}
    if "reference" in more:
        more["reference"] = more["reference"] * scale.factor
    if "rescale" in more:
        factors = [scale.factor] * len(x.joint_names)
        more["rescale"] = lambda fig: spread_out(fig, x, factors)
    scaled = {name: y * scale.factor for name, y in values.items()}
    return draw_cells(x, f"{what} [{scale.name}{per}]", scaled, own, "band \u00b1phi", note, **more)


def draw_sliding(x: RunView) -> Figure | None:
    """Draw sliding variables with their bands; None where no law has one."""
    has = {run.name: bool(np.isfinite(run.data.s).any()) for run in x.runs}
    if not any(has.values()):
        return None

    def lacks(run: Run) -> str:
        return "" if has[run.name] else " (has none)"

    if len(x.runs) > MOST_LINES:
        return _apart(x, "sliding variable s", "/s", lambda data: data.s, lacks, x.bands)
    fig, units = _time_panels(x, "sliding variable s", "/s", lambda data: data.s, thin=True, reference=False)
    keys = band_lines(x, fig, units)
    return x.finish(fig, lacks, *keys, *x.shade())


def rmse_note(x: RunView, run: Run) -> str:
    """Return the RMS error for the legend: in mrad and in mm, as in tables, whatever its size."""
    metrics = x.metrics.get(run.name)
    if metrics is None or metrics.rmse.value is None:
        return ""
    kinds, info = x.by_kind("mrad", "mm"), METRICS["rmse"]
    slides = [kind == "mm" for kind in kinds]
    values = {unit: joined(info, metrics.rmse, slides, unit == "mm") for unit in dict.fromkeys(kinds)}
    return f" (RMSE {', '.join(f'{number(value, 1e3)} {unit}' for unit, value in values.items())})"


def band_lines(x: RunView, fig: Figure, units: Sequence[style.Unit]) -> list[Artist]:
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
        if (any(seen) or not alone) and label not in [str(key.get_label()) for key in keys]:
            keys.append(Line2D([], [], label=label + ("" if any(seen) else " (beyond the axes)"), **look))
    return keys
