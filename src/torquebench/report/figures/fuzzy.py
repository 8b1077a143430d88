"""Figures of a fuzzy system: its terms, its control surface, and what the scale of an input does."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from torquebench.fuzzy import Functions, Prepared, Variable
from torquebench.fuzzy.inference import fill_memberships
from torquebench.kernel import Array
from torquebench.report.figures import style
from torquebench.report.figures.declare import figure
from torquebench.report.figures.fuzzy_rules import draw_rules
from torquebench.report.figures.layout import REFERENCE, SHADE, finish_page, new_page, shade_key
from torquebench.report.figures.run_view import RunView

DIVERGING = LinearSegmentedColormap.from_list("output", ["#0072B2", "#FFFFFF", "#D55E00"])
SCALES = {"too small": 0.25, "right": 1.0, "too large": 4.0}
"""What the paper's Fig 6 compares: the input's scale over the largest input that occurs."""

_SAMPLES = 801


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
    fig = new_page(len(system.inputs) + 1, 1.3, 1.7)
    *inputs, output = fig.subplots(len(system.inputs) + 1, 1)
    for i, (ax, variable) in enumerate(zip(inputs, system.inputs, strict=True)):
        _terms(ax, variable, f"input {i + 1}", variable.low, variable.high)
    if isinstance(system.output, Functions):
        _functions(output, system.output)
    else:
        ends = [x for term in system.output.terms for x in (term.a, term.d)]
        _terms(output, system.output, "output", min(ends), max(ends))
    finish_page(fig, *_titles(prepared), [shade_key("beyond the range, what the law sees as -1 to 1")])
    return fig


def _terms(ax: Axes, variable: Variable, what: str, low: float, high: float) -> None:
    """Draw the terms of an input or output from `low` to `high`."""
    for place, term in enumerate(variable.terms):
        ax.plot(term[1:], (0.0, 1.0, 1.0, 0.0), color=style.colour(place), linewidth=1.2)
        _name(ax, term.name, min(max(term.peak, low), high), place)
    ax.set_ylabel("degree [1]")
    ax.set_yticks([0.0, 0.5, 1.0])
    _show_range(ax, variable, what, low, high)


def _functions(ax: Axes, output: Functions) -> None:
    """Draw output terms at their constants; write functions out, as their values depend on the inputs."""
    values = [numbers[0] for _, numbers in output.coefficients]
    for place, (name, numbers) in enumerate(output.coefficients):
        text = name + "".join(f" {f:+g} x{i + 1}" for i, f in enumerate(numbers[1:]))
        ax.plot([numbers[0]] * 2, [0.0, 1.0], color=style.colour(place), linewidth=1.2)
        _name(ax, text, numbers[0], place)
    ax.set_ylabel("constant [1]")
    ax.set_yticks([])
    _show_range(ax, output, "output", min(output.low, *values), max(output.high, *values))


def _name(ax: Axes, text: str, x: float, place: int) -> None:
    """Write the name of a term above its peak."""
    look: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 7.5, "color": style.colour(place)}
    ax.annotate(text, (x, 1.0), (0.0, 2.0), textcoords="offset points", annotation_clip=False, **look)


def _show_range(ax: Axes, variable: Variable | Functions, what: str, low: float, high: float) -> None:
    """Show a variable from `low` to `high` with some room; shade what lies beyond its range."""
    room = 0.03 * (high - low)
    ax.set_xlim(low - room, high + room)
    ax.set_ylim(0.0, 1.22)
    for end in ((low - room, variable.low), (variable.high, high + room)):
        ax.axvspan(*end, **SHADE)
    ax.set_xlabel(f"{what} [1] (range {variable.low:g} to {variable.high:g})")


def _surface(prepared: Prepared) -> Figure:
    x = np.linspace(-1.0, 1.0, 241)
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
        handles += ax.plot(x, prepared.outputs(x, second), label=name, **style.look(place))
        ax.plot(x, np.clip(x + second, -1.0, 1.0), **REFERENCE | {"linewidth": 0.6})
    handles.append(Line2D([], [], label=f"{what}, clipped", **REFERENCE))
    ax.set_xlabel("input 1, normalised [1]")
    ax.set_ylabel("output, normalised [1]")
    ax.set_xlim(-1.0, 1.0)
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
        fill_memberships(variable.corners(), np.clip(signal / scale, -1.0, 1.0), degrees)
        for place, degree in enumerate(degrees.T):
            above.plot(signal, np.where(degree > 0.0, degree, np.nan), color=style.colour(place), linewidth=1.0)
        below.plot(signal, prepared.outputs(signal / scale, 0.0 * signal), color=style.colour(0))
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
        Line2D([], [], color=style.colour(0), label="output"),
        Line2D([], [], label="input over its scale, clipped", **REFERENCE),
        shade_key("clipped: beyond the scale"),
    ]
    finish_page(fig, *_titles(prepared), handles)
    return fig
