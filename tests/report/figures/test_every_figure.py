"""Every kind of figure: what its axes mean, whether colour-blind readers can tell its lines apart, size of its text."""

from __future__ import annotations

import ast
import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.report.figures.colour_vision import SIGHT, difference, lab
from tests.report.figures.test_fuzzy_figures import SYSTEMS
from tests.report.figures.test_run_figures import diverged, make
from tests.report.figures.test_sweep_figures import LAWS, TABLE, effects
from tests.source_tree import FILES, tree_of
from tests.sweep.tables import made
from torquebench.certificates import Certificate
from torquebench.fuzzy import prepare
from torquebench.report.figures.layout import PAGE_WIDTH, PAPER, Sheet, on_sheet
from torquebench.report.figures.pareto import Front, Spot, draw_pareto
from torquebench.report.figures.run_view import FiredRules, RunView, draw_figures
from torquebench.report.figures.style import journal_style
from torquebench.report.figures.sweep import sweep_jobs
from torquebench.statistics import Ratio
from torquebench.sweep.sensitivity import Sensitivity

N = 2
COLUMN = 183.0 / 25.4
"""Width at which figures are printed [in]: both columns of a journal's page."""
SMALLEST = 6.0
"""Least size of printed text [pt]."""
HOMES = {
    f"report/figures/{name}.py"
    for name in (
        "certificates",
        "cells",
        "pareto",
        "fuzzy",
        "fuzzy_rules",
        "signals",
        "spectrum",
        "torque",
    )
}
"""Files whose figures are drawn below."""
SWEEPS = {
    f"report/figures/{name}.py"
    for name in ("border", "convergence", "heatmap", "lines", "sensitivity", "tuning", "violins")
}
"""Files of a sweep's figures, whose axes `test_sweep_figures` reads: some are words."""


def certificate() -> Certificate:
    """Certificates of a run that decays."""
    t = 0.001 * np.arange(500)
    column = np.exp(-5.0 * t)[:, None] * np.ones(N)
    one = np.ones(N)
    return Certificate(
        K=one,
        t=t,
        s=column,
        V=column[:, 0],
        V_rate=-5.0 * column[:, 0],
        demand=column,
        margin=1.0 - column,
        eta=1.0 - column,
        K_u=one,
        layer=one,
        reaching_from=0.0,
        reaching_time=0.1,
        reaching_bound=0.2,
    )


def draw_all() -> dict[str, Figure]:
    """Draw every kind of figure once."""
    runs = {"smc": make(N, 9.0, switching=True), "calm": make(N, 1.0), "wild": diverged(N)}
    names = [f"joint {i + 1}" for i in range(N)]
    common = {"joint_names": names, "tau_max": np.full(N, 20.0), "metrics_from": 0.5, "control_period": 0.001}
    common["chattering_from_hz"] = 8.0
    bands = {"calm": np.full(N, 0.05)}
    systems = {system.name: prepare(system) for system in (SYSTEMS[0], SYSTEMS[-1])}  # two inputs; one, and functions
    fired = {}
    for name, prepared in systems.items():
        sizes = [len(variable.names) for variable in prepared.system.inputs]
        shares = np.random.default_rng(1).random((N, sizes[0], sizes[-1] if len(sizes) > 1 else 1))
        fired[name] = FiredRules(name, shares)
    view = RunView(
        runs,
        title="t",
        subtitle="s",
        bands=bands,
        slides=(False, True),
        certificates={"smc": certificate()},
        fuzzy=systems,
        fired=fired,
        **common,  # type: ignore[arg-type]
    )
    found = draw_figures(view)
    many = {f"law {k}": make(N, 1.0 + k) for k in range(5)} | {"wild": diverged(N)}
    of_many = RunView(many, title="t", subtitle="s", slides=(False, True), **common)  # type: ignore[arg-type]
    cells = draw_figures(of_many, ("position", "error", "torque", "sliding", "spectrum"))
    found |= {f"{name} of many": figure for name, figure in cells.items()}
    ratios = [Ratio(0.01 * k, 0.009 * k, 0.011 * k, 9, (0, 0), 0) for k in range(1, 9)]
    spots = [Spot("law", f"family {k}", str(k), r, r, k % 2 == 0) for k, r in enumerate(ratios)]
    families = {spot.family: spot.family for spot in spots}
    with journal_style():
        found["front"] = draw_pareto(Front(tuple(spots), families, "its phi [rad/s]"), "mrad", {"law": "smc"}, "t", "s")
    return found


@pytest.fixture(scope="module")
def every() -> dict[str, Figure]:
    """Every kind of figure."""
    return draw_all()


@pytest.fixture(scope="module")
def swept() -> dict[str, Figure]:
    """Every kind of a sweep's figures."""
    told = [Sensitivity("a", "rmse", (0,), 40, 2, effects(np.array([0.8, -0.5, 0.1])), "")]
    lone = made(["a"], 2, lambda law, draw, values: {"rmse": 1.0 + draw}, metrics=["rmse"])
    effect = sweep_jobs(lone, "t", "s", told, (False,), {"a": "smc"})["effects-rmse"]
    jobs = sweep_jobs(TABLE, "t", "s", (), (False,), dict.fromkeys(LAWS, "smc"))
    return {name: job() for name, job in (jobs | {"effects": effect}).items()}


def test_every_kind_is_here() -> None:
    """Whatever module makes a page of its own is drawn in this file."""
    makers = {
        name
        for name in FILES
        if name.startswith("report/figures/")
        and name != "report/figures/layout.py"
        and any(
            isinstance(node, ast.Name) and node.id in ("new_page", "panel_grid") for node in ast.walk(tree_of(name))
        )
    }
    assert makers == HOMES | SWEEPS


def labelled(ax: Axes, fig: Figure, which: str) -> str:
    """Return the label that is read for an axis: its own, or the one written once for a row or page."""
    own = str(ax.get_xlabel() if which == "x" else ax.get_ylabel() or fig.get_supylabel())
    if own or ax.get_label() == "<colorbar>":
        return own
    box = ax.get_position()
    found = []
    for other in fig.axes:
        place = other.get_position()
        if which == "x" and abs(place.x0 - box.x0) < 0.02 and place.y0 < box.y0:
            found.append((place.y0, str(other.get_xlabel())))
        if which == "y" and abs(place.y0 - box.y0) < 0.02 and place.x0 < box.x0:
            found.append((-place.x0, str(other.get_ylabel())))
    return next((text for _, text in sorted(found) if text), "")


def test_every_axis_has_a_label_with_its_unit(every: dict[str, Figure]) -> None:
    """A unit in brackets, [1] for a pure number, [term] for names; axes without any number on them need none."""
    wrong = []
    for name, fig in every.items():
        for ax in fig.axes:
            for which, axis in (("x", ax.xaxis), ("y", ax.yaxis)):
                label = labelled(ax, fig, which)
                blank = not any(text.get_text() for text in axis.get_ticklabels()) and not label
                if not blank and not re.search(r"[a-z0-9),\n ] ?\[[^\[\]]+\]", label):
                    wrong.append(f"{name}: {which} axis of {ax.get_label() or ax.get_title(loc='left')!r}: {label!r}")
    assert wrong == []


def test_every_text_is_legible_in_print(every: dict[str, Figure], swept: dict[str, Figure]) -> None:
    """At both columns' width, which is the figures' own, no text is smaller than 6 pt."""
    assert pytest.approx(COLUMN, abs=0.01) == PAGE_WIDTH
    for name, fig in (every | swept).items():
        scale = COLUMN / fig.get_figwidth()
        for text in fig.findobj(Text):
            if text.get_text().strip() and text.get_visible():  # type: ignore[attr-defined]
                assert text.get_fontsize() * scale >= SMALLEST - 0.01, (name, text.get_text())  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("sheet", "only"),
    [
        (PAPER[0], ("spectrum", "certificates")),  # labels longer than a panel, and of two lines
        *(pytest.param(sheet, (), marks=pytest.mark.slow) for sheet in PAPER),
    ],
    ids=["two at 85mm", "85mm", "180mm"],
)
def test_no_label_of_an_axis_is_cut_off_or_meets_another(sheet: Sheet, only: tuple[str, ...]) -> None:
    """In a journal's column, and in two, each is within the page to half a pixel, and covers no other by more."""
    names, limits = [f"joint {i + 1}" for i in range(6)], np.full(6, 20.0)
    with on_sheet(sheet):
        found = {} if only else draw_all()
        proof = certificate()
        proof = replace(proof, V_rate=1e-4 * proof.V_rate)  # of many figures, so that its numbers are wide
        six = RunView({"a": make(6, 9.0)}, "t", "s", names, limits, 0.5, 0.001, 8.0, certificates={"a": proof})
        found |= {f"{name} of six": fig for name, fig in draw_figures(six, only).items()}
    wrong = []
    for name, fig in found.items():
        page, renderer = fig.bbox, fig.canvas.get_renderer()  # type: ignore[attr-defined]
        labels = [axis.label for ax in fig.axes for axis in (ax.xaxis, ax.yaxis)]
        labels += [text for text in fig.texts if text.get_text() in (fig.get_supxlabel(), fig.get_supylabel())]
        boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in labels if text.get_text().strip()]
        for text, box in boxes:
            if min(box.x0, box.y0, page.width - box.x1, page.height - box.y1) < -0.5:
                wrong.append(f"{name}: {text!r} leaves the page")
        for (one, a), (other, b) in itertools.combinations(boxes, 2):
            if min(a.x1, b.x1) - max(a.x0, b.x0) > 0.5 and min(a.y1, b.y1) - max(a.y0, b.y0) > 0.5:
                wrong.append(f"{name}: {one!r} meets {other!r}")
    assert wrong == []


def test_pages_are_white_in_light_and_dark(every: dict[str, Figure], swept: dict[str, Figure]) -> None:
    """Figures bring their own white page, so that the palette meets the same background in a dark report."""
    for fig in (every | swept).values():
        assert to_hex(fig.get_facecolor()) == "#ffffff"
    base = (FILES["__init__.py"].parent / "report" / "templates" / "base.html.j2").read_text()
    assert re.search(r"figure \{[^}]*background: #ffffff", base)


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_verdicts_are_read_on_the_page(scheme: str, sight: str) -> None:
    """Green, red and yellow words are clear of the report's background, light and dark; words tell them apart."""
    base = (FILES["__init__.py"].parent / "report" / "templates" / "base.html.j2").read_text()
    block = re.findall(r":root \{(.*?)\}", base, flags=re.DOTALL)[scheme == "dark"]
    colours = dict(re.findall(r"--(\w+): (#\w{6})", block))
    for word in ("good", "bad", "mixed", "ink", "soft"):
        assert difference(lab(colours[word], sight), lab(colours["page"], sight)) >= 25.0
