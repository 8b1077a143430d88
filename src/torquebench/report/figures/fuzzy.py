"""Figures of a fuzzy system: its terms, its control surface, and what the scale of an input does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.experiment.describe import evaluation
from torquebench.fuzzy import Functions, Prepared, Variable
from torquebench.fuzzy.inference import fill_memberships
from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.layout import REFERENCE, SHADE, finish_page, new_page, shade_key
from torquebench.report.looks import series_colour

DIVERGING = LinearSegmentedColormap.from_list("output", ["#0072B2", "#FFFFFF", "#D55E00"])
SCALES = {"too small": 0.25, "right": 1.0, "too large": 4.0}
"""Cases that the paper's Fig 6 compares: the input's scale over the largest input that occurs."""

RISING = LinearSegmentedColormap.from_list("value", ["#FFFFFF", "#0072B2"])
_SAMPLES = 6401
_OUTLINE = 361
_SIDE = 241


def system_figures(prepared: Prepared, is_law: bool = True) -> dict[str, Figure]:
    """Draw a fuzzy system: `membership` (the paper's Fig 7), `surface` and `scaling` (Fig 6).

    Args:
        prepared: The system.
        is_law: Whether a law scales its inputs to [-1, 1]; otherwise the surface has the variables' own units, and
            there is nothing to scale.
    """
    with style.journal_style():
        figures = {"membership": _membership(prepared), "surface": _surface(prepared, is_law)}
        return {**figures, "scaling": _scaling(prepared)} if is_law else figures


def _titles(prepared: Prepared) -> tuple[str, str]:
    system = prepared.system
    how = "Sugeno"
    if isinstance(system.output, Variable):
        how = f"Mamdani, {system.aggregation}, {system.defuzzification.upper()}"
    what = f"{how}, AND {system.conjunction}; {len(system.rules)} rules; evaluated: {evaluation(prepared)}"
    return f"fuzzy system {system.name}", what


def _membership(prepared: Prepared) -> Figure:
    """Draw the terms of inputs and output; functions of a Sugeno system stand at their constants, written out."""
    system = prepared.system
    variables = {f"input {i + 1}": variable for i, variable in enumerate(system.inputs)} | {"output": system.output}
    fig = new_page(len(variables), 1.3, 1.7)
    for ax, (what, variable) in zip(fig.subplots(len(variables), 1), variables.items(), strict=True):
        shapes = _shapes(variable)
        ends = [variable.low, variable.high]
        if what == "output":  # its terms count beyond the range, too
            ends += [x for at, _, _ in shapes.values() for x in at]
        low, high = min(ends), max(ends)
        for place, (text, (x, degrees, peak)) in enumerate(shapes.items()):
            colour = series_colour(place)
            ax.plot(x, degrees, color=colour, linewidth=1.2)
            at = min(max(peak, low), high)
            end = 0.04 * (high - low)  # a name at an end must not run over the edge
            side = "left" if at < low + end else "right" if at > high - end else "center"
            ax.text(at, 1.03, text, ha=side, va="bottom", fontsize=7.5, color=colour)
        room = 0.03 * (high - low)
        ax.set_xlim(low - room, high + room)
        ax.set_ylim(0.0, 1.22)
        ax.set_yticks([0.0, 0.5, 1.0])
        ax.axvspan(low - room, variable.low, **SHADE)
        ax.axvspan(variable.high, high + room, **SHADE)
        ax.set_xlabel(f"{what} [1] (range {variable.low:g} to {variable.high:g})")
        ax.set_ylabel("degree [1]")
    finish_page(fig, *_titles(prepared), [shade_key("beyond the range, what the law sees as -1 to 1")])
    return fig


def _shapes(variable: Variable | Functions) -> dict[str, tuple[Sequence[float], Sequence[float], float]]:
    """Return the outline of each term by its name, places and degrees, and its peak.

    A function, which is written out, is an upright line at its constant.
    """
    height = (0.0, 1.0, 1.0, 0.0)
    if isinstance(variable, Functions):
        return {
            name + "".join(f" {factor:+g} x{i + 1}" for i, factor in enumerate(factors)): (
                [constant] * 4,
                height,
                constant,
            )
            for name, (constant, *factors) in variable.coefficients
        }
    x = np.linspace(variable.low, variable.high, _OUTLINE)
    normalised = np.linspace(-1.0, 1.0, _OUTLINE)
    degrees = np.empty((_OUTLINE, len(variable.terms)))
    fill_memberships(variable.rows(), normalised, degrees)
    return {
        term.name: (x.tolist(), column.tolist(), term.peak) if term.curve else (term.corners, height, term.peak)
        for term, column in zip(variable.terms, degrees.T, strict=True)
    }


def _surface(prepared: Prepared, is_law: bool) -> Figure:
    if not is_law:
        return _own_surface(prepared)
    x = np.linspace(-1.0, 1.0, _SIDE)
    fig = new_page(1, 3.0, 3.0)
    if len(prepared.system.inputs) == 2:
        contours, ax = fig.subplots(1, 2, width_ratios=(1.2, 1.0))
        _contours(fig, contours, prepared, x)
        sections = {"input 2 = 0": 0.0 * x, "input 2 = input 1": x, "input 2 = -1/2": 0.0 * x - 0.5}
        what = "sum of the inputs"
    else:
        ax, sections, what = fig.subplots(), {"output": 0.0 * x}, "input"
    handles = []
    for place, (name, second) in enumerate(sections.items()):
        look = {"color": series_colour(place), "linestyle": ("-", "--", "-.")[place]}
        handles += ax.plot(x, prepared.outputs(x, second), label=name, **look)
        ax.plot(x, np.clip(x + second, -1.0, 1.0), **REFERENCE | {"linewidth": 0.6})
    handles.append(Line2D([], [], label=f"{what}, clipped", **REFERENCE))
    ax.set_xlabel("input 1, normalised [1]")
    ax.set_ylabel("output, normalised [1]")
    ax.set_xlim(-1.0, 1.0)
    ax.locator_params(nbins=5)
    finish_page(fig, *_titles(prepared), handles)
    return fig


def _own_surface(prepared: Prepared) -> Figure:
    """Draw the output over the inputs, all in their own units: a map, and sections at each quarter of input 2."""
    system, grid = prepared.system, np.linspace(-1.0, 1.0, _SIDE)
    own = [variable.middle + variable.half * grid for variable in system.inputs]
    output = system.output
    fig = new_page(1, 3.0, 3.0)
    if len(system.inputs) == 2:
        z = output.middle + output.half * prepared.outputs(grid[:, None], grid[None, :])
        area, ax = fig.subplots(1, 2, width_ratios=(1.2, 1.0))
        mesh = area.pcolormesh(*own, z.T, cmap=RISING, shading="gouraud", rasterized=True)
        if np.ptp(z) > 0.0:
            area.contour(*own, z.T, levels=12, colors="0.25", linewidths=0.5)
        fig.colorbar(mesh, ax=area, pad=0.02, label="output [1]")
        area.grid(False)
        area.set_xlabel("input 1 [1]")
        area.set_ylabel("input 2 [1]")
        second = system.inputs[1]
        places = np.linspace(second.low, second.high, 5)
        sections = {f"input 2 = {place:.4g}": (place - second.middle) / second.half for place in places}
    else:
        ax, sections = fig.subplots(), {"output": 0.0}
    handles = []
    for place, (name, y) in enumerate(sections.items()):
        z = output.middle + output.half * prepared.outputs(grid, 0.0 * grid + y)
        handles += ax.plot(own[0], z, color=series_colour(place), label=name)
    ax.set_xlabel("input 1 [1]")
    ax.set_ylabel("output [1]")
    ax.set_xlim(own[0][0], own[0][-1])
    finish_page(fig, *_titles(prepared), handles)
    return fig


def _contours(fig: Figure, ax: Axes, prepared: Prepared, x: Array) -> None:
    z = prepared.outputs(x[:, None], x[None, :])
    reach = max(float(np.max(np.abs(z))), 1e-12)
    mesh = ax.pcolormesh(x, x, z.T, cmap=DIVERGING, vmin=-reach, vmax=reach, shading="gouraud", rasterized=True)
    levels = np.linspace(-reach, reach, 17)[1:-1]
    ax.contour(x, x, z.T, levels=levels, colors="0.25", linewidths=0.5, negative_linestyles="solid")
    fig.colorbar(mesh, ax=ax, pad=0.02, label="output, normalised [1]")
    ax.set_aspect("equal")
    ax.locator_params(nbins=5)
    ax.grid(False)
    ax.set_xlabel("input 1, normalised [1]")
    ax.set_ylabel("input 2, normalised [1]")


def _scaling(prepared: Prepared) -> Figure:
    """Draw the response to one signal, from -1 to 1, through three input scales: terms above, output below."""
    variable = prepared.system.inputs[0]
    signal = np.linspace(-1.0, 1.0, _SAMPLES)
    reach = max(1.0, float(np.max(np.abs(prepared.outputs(signal, 0.0 * signal)))))
    fig = new_page(2, 1.6, 1.6)
    panels = fig.subplots(2, len(SCALES), sharex=True, sharey="row")
    for (above, below), (name, scale) in zip(panels.T, SCALES.items(), strict=True):
        degrees = np.empty((_SAMPLES, len(variable.terms)))
        fill_memberships(variable.rows(), np.clip(signal / scale, -1.0, 1.0), degrees)
        for place, degree in enumerate(degrees.T):
            above.plot(signal, np.where(degree > 0.0, degree, np.nan), color=series_colour(place), linewidth=1.0)
        below.plot(signal, prepared.outputs(signal / scale, 0.0 * signal), color=series_colour(0))
        below.plot(signal, np.clip(signal / scale, -1.0, 1.0), **REFERENCE)
        above.set_title(f"{name}: scale {scale:g} x largest input")
        below.set_xlabel("input 1 over its largest [1]")
        for ax in (above, below) if scale < 1.0 else ():
            ax.axvspan(-1.0, -scale, **SHADE)
            ax.axvspan(scale, 1.0, **SHADE)
    above, below = panels[:, 0]
    above.set_ylabel("degree [1]")
    below.set_ylabel("output, input 2 = 0 [1]")
    below.set_xlim(-1.0, 1.0)
    above.set_ylim(-0.02, 1.08)
    below.set_ylim(-1.08 * reach, 1.08 * reach)
    handles = [
        Line2D([], [], color=series_colour(0), label="output"),
        Line2D([], [], label="input over its scale, clipped", **REFERENCE),
        shade_key("clipped: beyond the scale"),
    ]
    finish_page(fig, *_titles(prepared), handles)
    return fig
