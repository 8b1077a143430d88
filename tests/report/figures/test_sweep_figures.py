"""Figures of a sweep: what is drawn is what the table says, failures are seen, and every axis has its unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tests.sweep.tables import made
from torquebench.kernel import Array
from torquebench.report.figures.files import figure_bytes
from torquebench.report.figures.pareto import front_of
from torquebench.report.figures.sensitivity import draw_sensitivity
from torquebench.report.figures.style import fit_scale
from torquebench.report.figures.sweep import slug, sweep_jobs
from torquebench.report.looks import looks
from torquebench.statistics import paired_ratio
from torquebench.sweep.effects import Effect, Effects
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.table import Table

GRID = {"plant.payload.mass": (0.5, 1.0, 2.0), "chain": ("ideal", "slow")}
DRAWS = 12
NOISE = np.exp(0.1 * np.random.default_rng(3).normal(size=(3, DRAWS)))
LAWS = ("rough", "smooth", "fragile")
OF_LAW = dict.fromkeys((*LAWS, "a"), "smc")


def run(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float] | None:
    """Errors of some mrad that grow with the payload; under 2 kg the fragile law fails, on slow in some draws."""
    if law == "fragile" and values["plant.payload.mass"] == 2.0 and (values["chain"] == "ideal" or draw % 2):
        return None
    place = LAWS.index(law)
    rmse = 1e-3 * (1.0, 9.0, 2.0)[place] * float(values["plant.payload.mass"]) * NOISE[place, draw]
    return {"rmse": rmse, "chattering": (30.0, 0.5, 20.0)[place] * NOISE[place, -1 - draw]}


TABLE = made(LAWS, DRAWS, run, GRID)


def drawn(table: Table, found: Sequence[Sensitivity] = ()) -> dict[str, Figure]:
    """Draw all figures of a table of an arm that turns."""
    jobs = sweep_jobs(table, "study", "what was run", found, (False,), OF_LAW)
    return {name: job() for name, job in jobs.items()}


@pytest.fixture(scope="module")
def figures() -> dict[str, Figure]:
    """All figures of the sweep, drawn once."""
    return drawn(TABLE)


def texts(ax: Axes) -> list[str]:
    """What is written in a panel."""
    return [text.get_text() for text in ax.texts]


def test_a_figure_for_everything_that_the_table_has(figures: dict[str, Figure]) -> None:
    """By law, over each key of the grid, maps over the first two, and the front; without a grid only the first."""
    assert set(figures) == {"spread", "over-plant-payload-mass", "over-chain", "map-rmse", "map-chattering", "front"}
    assert set(drawn(made(LAWS, 2, run, {k: v[:1] for k, v in GRID.items()}))) == {"spread", "front"}
    lone = made(["rough"], 2, lambda law, draw, values: {"rmse": 1.0 + draw}, metrics=["rmse"])
    assert set(drawn(lone)) == {"spread"}
    failed = made(["rough"], 2, lambda law, draw, values: None)
    assert drawn(failed) == {}
    assert slug("controllers.*.gains.phi") == "controllers-gains-phi"


def test_headings_of_figures(figures: dict[str, Figure]) -> None:
    """Each figure's label is its heading on the page, a sentence that names metrics and keys in words."""
    assert {name: figure.get_label() for name, figure in figures.items()} == {
        "spread": "All runs",
        "over-plant-payload-mass": "Over plant.payload.mass",
        "over-chain": "Over chain",
        "map-rmse": "RMS error over plant.payload.mass and chain",
        "map-chattering": "Chattering over plant.payload.mass and chain",
        "front": "Error against chattering",
    }


def test_every_number_has_its_unit(figures: dict[str, Figure]) -> None:
    """Every label of an axis names a unit, but for words."""
    labels = set()
    for figure in figures.values():
        for shown in (figure.get_supxlabel(), figure.get_supylabel()):
            labels.add(shown)
        for ax in figure.axes:
            labels |= {ax.get_xlabel().replace("\n", " "), ax.get_ylabel().replace("\n", " ")}
    labels -= {"", "chain"}
    assert {label for label in labels if "[" not in label} == set()
    assert "plant.payload.mass [kg]" in labels
    assert "RMS error [mrad]" in labels


def test_boxes_are_quartiles_and_failures_are_named(figures: dict[str, Figure]) -> None:
    """The box of each law spans numpy's quartiles of its completed runs [mrad]; under its name what failed."""
    ax = figures["spread"].axes[0]
    boxes = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    for law, box in zip(LAWS, boxes, strict=True):
        own = 1e3 * TABLE["rmse"][(TABLE["controller"] == law) & np.isnan(TABLE["failed_at"])]
        assert (box.get_x(), box.get_x() + box.get_width()) == pytest.approx(
            tuple(np.quantile(own, [0.25, 0.75])), rel=1e-12
        )
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["rough", "smooth", "fragile\n18 of 72 failed"]


def test_cells_of_a_map_are_geometric_means_of_the_completed_runs(figures: dict[str, Figure]) -> None:
    """2 kg on slow: the geometric mean of the six draws that completed, and (6); on ideal nothing, hatched."""
    ax = next(ax for ax in figures["map-rmse"].axes if ax.get_title(loc="left") == "fragile")
    slow = ax.images[0].get_array()
    own = (TABLE["controller"] == "fragile") & (TABLE["chain"] == "slow") & (TABLE["plant.payload.mass"] == 2.0)
    mean = 1e3 * np.exp(np.nanmean(np.log(TABLE["rmse"][own])))
    assert slow is not None
    assert slow[1, 2] == pytest.approx(mean, rel=1e-12)
    assert slow[0, 2] is np.ma.masked
    assert f"{mean:.3g}\n(6)" in texts(ax)
    assert len(texts(ax)) == 5
    assert ax.patch.get_hatch() == "////"  # seen through the masked cell
    sizes = {tuple(image.get_clim()) for panel in figures["map-rmse"].axes for image in panel.images}
    assert len(sizes) == 1  # one scale of colours for all laws


def test_courses_are_geometric_means(figures: dict[str, Figure]) -> None:
    """Over the payload the error is a line through the geometric means, and a law without a value stops before it."""
    ax = figures["over-plant-payload-mass"].axes[0]
    lines = {
        line.get_color(): line
        for line in ax.get_lines()
        if len(np.ravel(line.get_xdata())) and line.get_marker() in "osD"
    }
    rough = lines[looks(OF_LAW)["rough"].colour]
    assert np.ravel(rough.get_xdata()).tolist() == [0.5, 1.0, 2.0]
    wanted = [1e3 * m * 1e-3 * np.exp(np.mean(np.log(NOISE[0]))) for m in (0.5, 1.0, 2.0)]
    assert np.ravel(rough.get_ydata()) == pytest.approx(wanted, rel=1e-12)
    assert np.ravel(lines[looks(OF_LAW)["fragile"].colour].get_xdata()).tolist() == [0.5, 1.0]


def test_a_front_is_of_choices_not_of_conditions() -> None:
    """A gain is chosen, a payload is not: a spot for each law and phi that it has, under the worse payload."""

    def chosen(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float] | None:
        if law == "a" and values["controllers.a.gains.phi"] == 3.0 and draw == 1:
            return None
        phi = float(values["controllers.a.gains.phi"]) if law == "a" else 1.0
        worse = 1.1 if law == "b" else 1.0
        return {"rmse": worse * phi * float(values["plant.payload.mass"]) * NOISE[0, draw], "chattering": worse / phi}

    table = made("ab", DRAWS, chosen, {"controllers.a.gains.phi": (0.5, 1.0, 3.0), "plant.payload.mass": (1.0, 4.0)})
    spots = {(spot.family, spot.label): spot for spot in front_of(table).spots}
    assert list(spots) == [("a", "phi 0.5"), ("a", "phi 1"), ("a", "phi 3"), ("b", "b")]
    wanted = paired_ratio((4.0 * NOISE[0]).tolist(), [1.0] * DRAWS)
    assert spots["a", "phi 1"].error[:3] == pytest.approx(wanted[:3], rel=1e-12)
    # b is beaten by a at phi 1; phi 3 would be unbeaten in chattering, but a run of it failed
    assert [spot.best for spot in spots.values()] == [True, True, False, False]


def test_a_line_of_the_front_follows_one_choice() -> None:
    """Over phi and k there is a line along phi for each law and k; over more choices than lines, none."""

    def chosen(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float]:
        phi, k = (float(values[f"controllers.*.gains.{key}"]) for key in ("phi", "k"))
        return {"rmse": phi / k * NOISE[0, draw], "chattering": k / phi}

    grid = {"controllers.*.gains.phi": (0.1, 0.3, 1.0), "controllers.*.gains.k": (0.2, 0.3)}
    front = front_of(made("ab", DRAWS, chosen, grid))
    assert front.labels == "its phi [rad/s]"
    assert front.joined
    lines = {family: [s.label for s in front.spots if s.family == family] for family in ("a, k 0.2", "b, k 0.3")}
    assert lines == {"a, k 0.2": ["0.1", "0.3", "1"], "b, k 0.3": ["0.1", "0.3", "1"]}
    many = front_of(made("ab", 2, chosen, grid | {"controllers.*.gains.k": tuple(0.1 * i for i in range(1, 9))}))
    assert not many.joined
    assert {spot.family for spot in many.spots} == {"a", "b"}


def effects(strengths: Array) -> Effects:
    """Effects with intervals of +- 0.2."""
    return Effects("joint", 0.9, 6, tuple(Effect((f"I{i}",), x, x - 0.2, x + 0.2) for i, x in enumerate(strengths)))


def test_effects_are_drawn_with_their_intervals() -> None:
    """Those that matter in black, others in grey; a law of which nothing can be said has no panel."""
    found = [
        Sensitivity("a", "rmse", (0,), 40, 2, effects(np.array([0.8, -0.5, 0.1])), ""),
        Sensitivity("b", "rmse", (0,), 40, 0, None, "it is the same in every draw"),
    ]
    figure = draw_sensitivity(found, "t", "")
    (ax,) = figure.axes
    bars = [line for line in ax.get_lines() if line.get_marker() == "o"]
    spans = [(0.6, 0.8, 1.0), (-0.7, -0.5, -0.3), (-0.1, 0.1, 0.3)]
    assert [tuple(np.round(np.ravel(bar.get_xdata()), 9)) for bar in bars] == spans
    assert [bar.get_color() for bar in bars] == ["0.1", "0.1", "0.6"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["I0", "I1", "I2"]
    lone = made(["a"], 2, lambda law, draw, values: {"rmse": 1.0 + draw}, metrics=["rmse"])
    assert "effects-rmse" in drawn(lone, found)
    assert "effects-rmse" not in drawn(lone, found[1:])


@pytest.mark.parametrize(
    ("values", "log"), [([1.0, 9.0], False), ([1.0, 20.0], True), ([0.0, 20.0], False), ([], False)]
)
def test_axes_are_logarithmic_from_a_decade_on(values: list[float], log: bool) -> None:
    """Zero and values within a decade are drawn on a linear axis."""
    ax = Figure().add_subplot()
    assert fit_scale(ax.yaxis, values) == log
    assert ax.get_yscale() == ("log" if log else "linear")
    assert ax.get_xscale() == "linear"


def test_the_same_table_gives_the_same_bytes(figures: dict[str, Figure]) -> None:
    """Drawn again, the figures are the same in every byte."""
    again = drawn(TABLE)
    for name in ("spread", "map-rmse"):
        assert figure_bytes(figures[name], "svg") == figure_bytes(again[name], "svg")
