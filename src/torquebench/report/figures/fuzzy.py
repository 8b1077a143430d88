"""Figures of a fuzzy system: its terms, its control surface, and what the scale of an input does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from torquebench.fuzzy import Functions, Prepared, Variable
from torquebench.fuzzy.inference import fill_memberships
from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.declare import figure
from torquebench.report.figures.fuzzy_rules import draw_rules
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.report.figures.run_view import SHADE, RunView

DIVERGING = LinearSegmentedColormap.from_list("output", ["#0072B2", "#FFFFFF", "#D55E00"])
SCALES = {"too small": 0.25, "right": 1.0, "too large": 4.0}
"""What the paper's Fig 6 compares: the input's scale over the largest input that occurs."""

_SAMPLES = 801
_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 0.8, "linestyle": (0, (4.0, 2.5))}


@figure("fuzzy", title="Fuzzy systems", order=70)
def draw_fuzzy(x: RunView) -> dict[str, Figure]:
    """Draw the fuzzy systems in use, and which of their rules fired in each run."""
    pages = {f"{name}-{rest}": page for name, one in x.fuzzy.items() for rest, page in system_figures(one).items()}
    for name, fired in x.fired.items():
        title = f"{x.title}: rules of {fired.system} that fired under {name}"
        pages[f"{name}-rules"] = draw_rules(x.fuzzy[fired.system], fired.shares, x.joint_names, title, x.subtitle)
    return pages


def system_figures(prepared: Prepared) -> dict[str, Figure]:
    """Draw a fuzzy system: `membership` (the paper's Fig 7), `surface` and `scaling` (Fig 6)."""
    with style.journal_style():
        return {"membership": _membership(prepared), "surface": _surface(prepared), "scaling": _scaling(prepared)}


def _titles(prepared: Prepared) -> tuple[str, str]:
    system = prepared.system
    how = f"Sugeno, AND {system.conjunction}"
    if isinstance(system.output, Variable):
        how = f"Mamdani, {system.aggregation}, {system.defuzzification.upper()}, AND {system.conjunction}"
    bound = "" if prepared.bound == 0.0 else f", error at most {prepared.bound:.2g}"
    return f"fuzzy system {system.name}", f"{how}; {len(system.rules)} rules; evaluated: {prepared.method}{bound}"


def _membership(prepared: Prepared) -> Figure:
    system = prepared.system
    variables = [(f"input {i + 1}", variable) for i, variable in enumerate(system.inputs)]
    fig = new_page(len(variables) + 1, 1.3, 1.7)
    grid = fig.add_gridspec(len(variables) + 1, 1)
    for i, (what, variable) in enumerate(variables):
        ax = fig.add_subplot(grid[i, 0])
        _terms(ax, variable, variable.low, variable.high)
        ax.set_xlabel(f"{what} [1] (range {variable.low:g} to {variable.high:g})")
    ax = fig.add_subplot(grid[-1, 0])
    output = system.output
    if isinstance(output, Functions):
        _functions(ax, output)
    else:
        _terms(ax, output, min(t.a for t in output.terms), max(t.d for t in output.terms))
    ax.set_xlabel(f"output [1] (range {output.low:g} to {output.high:g})")
    shade = Patch(label="beyond the range, what the law sees as -1 to 1", **SHADE | {"color": "0.9"})
    finish_page(fig, *_titles(prepared), [shade])
    return fig


def _terms(ax: Axes, variable: Variable, low: float, high: float) -> None:
    room = 0.03 * (high - low)
    x = np.linspace(low, high, _SAMPLES)
    x = np.sort(np.concatenate([x, *([t.a, t.b, t.c, t.d] for t in variable.terms)]))
    degrees = np.empty((len(x), len(variable.terms)))
    fill_memberships(variable.corners(), (x - variable.middle) / variable.half, degrees)
    inside = (x >= low) & (x <= high)
    for k, term in enumerate(variable.terms):
        colour = style.COLOURS[k % len(style.COLOURS)]
        ax.plot(x[inside], _where_positive(degrees[inside, k]), color=colour, linewidth=1.2)
        at = min(max(term.peak, low), high)
        ax.annotate(
            term.name,
            (at, 1.0),
            (0.0, 2.0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=7.5,
            color=colour,
            annotation_clip=False,
        )
    ax.set_xlim(low - room, high + room)
    ax.set_ylim(0.0, 1.22)
    for left, right in ((low - room, variable.low), (variable.high, high + room)):
        ax.axvspan(left, right, **SHADE)
    ax.set_ylabel("degree [1]")
    style.plain_numbers(ax, x_bins=9, y_bins=3)
    ax.set_yticks([0.0, 0.5, 1.0])


def _where_positive(degree: Array) -> Array:
    """Hide the zeros of a term's degrees, except where it starts and ends."""
    beside = np.pad(degree, 1)
    return np.where((degree > 0.0) | (beside[:-2] > 0.0) | (beside[2:] > 0.0), degree, np.nan)


def _functions(ax: Axes, output: Functions) -> None:
    """Draw output terms at their constants; write functions out, as their values depend on the inputs."""
    room = 0.05 * (output.high - output.low)
    values = [numbers[0] for _, numbers in output.coefficients]
    for k, (name, numbers) in enumerate(output.coefficients):
        colour = style.COLOURS[k % len(style.COLOURS)]
        text = name + "".join(f" {f:+g} x{i + 1}" for i, f in enumerate(numbers[1:]))
        ax.plot([numbers[0]] * 2, [0.0, 1.0], color=colour, linewidth=1.2)
        ax.annotate(
            text,
            (numbers[0], 1.0),
            (0.0, 2.0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=7.5,
            color=colour,
        )
    ax.set_xlim(min(output.low, *values) - room, max(output.high, *values) + room)
    ax.set_ylim(0.0, 1.25)
    ax.set_ylabel("constant [1]")
    style.plain_numbers(ax, x_bins=9)
    ax.set_yticks([])


def _surface(prepared: Prepared) -> Figure:
    system = prepared.system
    x = np.linspace(-1.0, 1.0, 241)
    fig = new_page(1, 3.0, 3.0)
    handles: list[Artist] = []
    sections: Mapping[str, tuple[Array, Array]] = {"output": (x, 0.0 * x)}
    if len(system.inputs) == 2:
        grid = fig.add_gridspec(1, 2, width_ratios=(1.2, 1.0))
        _contours(fig, fig.add_subplot(grid[0, 0]), prepared, x)
        ax = fig.add_subplot(grid[0, 1])
        sections = {
            "input 2 = 0": (x, 0.0 * x),
            "input 2 = input 1": (x, x),
            "input 2 = -1/2": (x, 0.0 * x - 0.5),
        }
    else:
        ax = fig.add_subplot()
    for k, (name, (a, b)) in enumerate(sections.items()):
        (line,) = ax.plot(x, prepared.outputs(a, b), color=style.COLOURS[k], linestyle=style.DASHES[k], label=name)
        handles.append(line)
        ax.plot(x, np.clip(a + b, -1.0, 1.0), **_REFERENCE | {"linewidth": 0.6})
    what = "sum of the inputs" if len(system.inputs) == 2 else "input"
    handles.append(Line2D([], [], label=f"{what}, clipped", **_REFERENCE))
    ax.set_xlabel("input 1, normalised [1]")
    ax.set_ylabel("output, normalised [1]")
    ax.set_xlim(-1.0, 1.0)
    style.plain_numbers(ax)
    finish_page(fig, *_titles(prepared), handles)
    return fig


def _contours(fig: Figure, ax: Axes, prepared: Prepared, x: Array) -> None:
    z = prepared.outputs(x[:, None], x[None, :])
    reach = max(float(np.max(np.abs(z))), 1e-12)
    mesh = ax.pcolormesh(x, x, z.T, cmap=DIVERGING, vmin=-reach, vmax=reach, shading="gouraud", rasterized=True)
    levels = np.linspace(-reach, reach, 17)[1:-1]
    ax.contour(x, x, z.T, levels=levels, colors="0.25", linewidths=0.5, negative_linestyles="solid")
    bar = fig.colorbar(mesh, ax=ax, pad=0.02)
    bar.ax.tick_params(labelsize=7.0)
    bar.set_label("output, normalised [1]")
    ax.set_aspect("equal")
    ax.grid(False)
    ax.set_xlabel("input 1, normalised [1]")
    ax.set_ylabel("input 2, normalised [1]")
    style.plain_numbers(ax)


def _scaling(prepared: Prepared) -> Figure:
    """Draw the response to one signal, from -1 to 1, through three input scales: terms above, output below."""
    variable = prepared.system.inputs[0]
    signal = np.linspace(-1.0, 1.0, _SAMPLES)
    reach = max(1.0, float(np.max(np.abs(prepared.outputs(signal, 0.0 * signal)))))
    fig = new_page(2, 1.6, 1.6)
    grid = fig.add_gridspec(2, len(SCALES))
    for column, (name, scale) in enumerate(SCALES.items()):
        above, below = fig.add_subplot(grid[0, column]), fig.add_subplot(grid[1, column])
        degrees = np.empty((_SAMPLES, len(variable.terms)))
        fill_memberships(variable.corners(), np.clip(signal / scale, -1.0, 1.0), degrees)
        for k in range(len(variable.terms)):
            above.plot(
                signal, _where_positive(degrees[:, k]), color=style.COLOURS[k % len(style.COLOURS)], linewidth=1.0
            )
        below.plot(signal, prepared.outputs(signal / scale, 0.0 * signal), color=style.COLOURS[0])
        below.plot(signal, np.clip(signal / scale, -1.0, 1.0), **_REFERENCE)
        above.set_title(f"{name}: scale {scale:g} x largest input", loc="left", pad=3.0)
        below.set_xlabel("input 1 over its largest [1]")
        for ax, low in ((above, -0.02), (below, -1.08)):
            for side in (-1.0, 1.0):
                if scale < 1.0:
                    ax.axvspan(*sorted((side * scale, side)), **SHADE)
            ax.set_xlim(-1.0, 1.0)
            ax.set_ylim(low * reach if ax is below else low, 1.08 * reach if ax is below else 1.08)
            ax.tick_params(labelleft=column == 0, labelbottom=ax is below)
            style.plain_numbers(ax, x_bins=5, y_bins=4)
        if column == 0:
            above.set_ylabel("degree [1]")
            below.set_ylabel("output, input 2 = 0 [1]")
    handles: list[Artist] = [
        Line2D([], [], color=style.COLOURS[0], label="output"),
        Line2D([], [], label="input over its scale, clipped", **_REFERENCE),
        Patch(label="clipped: beyond the scale", **SHADE | {"color": "0.9"}),
    ]
    finish_page(fig, *_titles(prepared), handles)
    return fig
