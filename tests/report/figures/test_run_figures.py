"""Figures say what they show (labels, units, names), show all of it, and come out as the same bytes."""

import itertools
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from torquebench.errors import ResultError
from torquebench.metrics import from_joints, per_joint
from torquebench.report.figures.files import figure_bytes
from torquebench.report.figures.run_view import RunView, draw_figures
from torquebench.sim.trajectory import Outcome, Trajectory

T = 0.001
PAGES = ("position", "error", "torque", "sliding", "spectrum")


def make(n: int, tau: float, samples: int = 1500, error: float = 0.01, switching: bool = False) -> Trajectory:
    """A run of n joints on a 1 Hz reference; its torque is 50 Hz of amplitude `tau` or switches at random."""
    t = T * np.arange(samples)
    joint = 1.0 + 0.1 * np.arange(n)
    q_ref = np.sin(2 * np.pi * t)[:, None] * joint
    e = error * np.cos(2 * np.pi * t)[:, None] * joint
    wave = np.sin(2 * np.pi * 50.0 * t)[:, None] * np.ones(n)
    if switching:
        wave = np.where(np.random.default_rng(0).random((samples, n)) < 0.5, -1.0, 1.0)
    zero = np.zeros((samples, n))
    return Trajectory(
        t=t,
        q=q_ref - e,
        qd=zero,
        q_meas=zero,
        qd_meas=zero,
        q_ref=q_ref,
        qd_ref=zero,
        qdd_ref=zero,
        s=10.0 * e,
        tau_law=zero,
        tau=tau * wave,
        tau_applied=zero,
    )


def diverged(n: int, samples: int = 700) -> Trajectory:
    """A run that doubles its error every 10 ms from 0.5 s on and then fails, its last torque missing."""
    run = make(n, 0.5, samples)
    tau = run.tau.copy()
    tau[-1] = np.nan
    growing = run.q - 2.0 ** np.maximum((run.t - 0.5) / 0.01, -60.0)[:, None]
    return replace(run, q=growing, tau=tau, outcome=Outcome.DIVERGED, failed_at=samples - 1)


def draw(runs: dict[str, Trajectory], n: int, only: Sequence[str] = (), **changes: object) -> dict[str, Figure]:
    """Draw the runs, all figures or `only` some, with this file's defaults for what `changes` leaves out."""
    arguments = {
        "title": "a title",
        "subtitle": "noise: none",
        "joint_names": [f"joint {i + 1}" for i in range(n)],
        "tau_max": np.full(n, 20.0),
        "metrics_from": 0.5,
        "control_period": T,
        "chattering_from_hz": 8.0,
    } | changes
    return draw_figures(RunView(runs, **arguments), only)  # type: ignore[arg-type]


def page(name: str, runs: dict[str, Trajectory], n: int, **changes: object) -> Figure:
    """Draw one figure of the runs; the others are not laid out."""
    return draw(runs, n, [name], **changes)[name]


def panel(fig: Figure, label: str) -> Axes:
    """Return the panel with the given label."""
    return next(ax for ax in fig.axes if ax.get_label() == label)


def legend_texts(fig: Figure) -> list[str]:
    """Return the entries of the page's legend."""
    return [text.get_text() for text in fig.legends[0].get_texts()]


@pytest.fixture(scope="module")
def six() -> dict[str, Figure]:
    """Pages of six joints: a switching law, a calm one, one that diverges."""
    return draw({"smc": make(6, 9.0, switching=True), "calm": make(6, 1.0), "wild": diverged(6)}, 6)


@pytest.mark.parametrize("n", [1, 2])
def test_one_panel_per_joint_with_units(n: int) -> None:
    """Every page has n panels (the torque page n zooms more), named, with units on the outer axes."""
    figures = draw({"a": make(n, 9.0), "b": make(n, 1.0)}, n)
    assert tuple(figures) == PAGES
    units = {
        "position": "position [rad]",
        "error": "error e [mrad]",
        "torque": "torque [N m]",
        "sliding": "sliding variable s [mrad/s]",
        "spectrum": "torque amplitude [% of limit]",
    }
    for key, fig in figures.items():
        assert len(fig.axes) == (2 * n if key == "torque" else n)
        assert units[key] in fig.axes[0].get_ylabel()
        assert fig.axes[-1].get_xlabel() == ("frequency [Hz]" if key == "spectrum" else "time [s]")
        for i in range(n):
            ax = panel(fig, f"joint {i + 1}")
            assert f"joint {i + 1}" in ax.get_title(loc="left") + ax.get_ylabel()
        assert len(fig.legends) == 1


def test_six_joints_fit_one_page(six: dict[str, Figure]) -> None:
    """Nothing leaves the page, the legend keeps clear of the panels, no text is below 7 pt."""
    for key, fig in six.items():
        assert len(fig.axes) == (12 if key == "torque" else 6)
        assert fig.get_figwidth() == pytest.approx(7.2)
        assert fig.get_figheight() < 9.0
        legend = fig.legends[0].get_window_extent()
        for ax in fig.axes:
            box = ax.get_tightbbox()
            assert box is not None
            # A cross on the frame may stand 3 pt out of its panel.
            assert box.x0 >= -7.0
            assert box.x1 <= fig.bbox.width + 7.0
            assert box.y0 >= 0.0
            assert box.y1 <= legend.y0 + 7.0
        assert legend.x1 <= fig.bbox.width
        assert all(text.get_fontsize() >= 7.0 for text in fig.findobj(Text) if text.get_text())  # type: ignore[attr-defined]


def test_runs_differ_in_colour_and_in_dash_and_the_restless_one_lies_below(six: dict[str, Figure]) -> None:
    """Each run keeps one colour on every page; without colour the dashes tell them apart."""
    colours = {}
    for fig in six.values():
        handles = fig.legends[0].legend_handles[:3]
        seen = [handle.get_color() for handle in handles]  # type: ignore[union-attr]
        assert len(set(seen)) == 3
        colours[tuple(seen)] = True
    assert len(colours) == 1
    drawn = panel(six["torque"], "joint 1").get_lines()[:3]  # in the order of the runs, the restless one first
    assert drawn[0].get_zorder() < min(line.get_zorder() for line in drawn[1:])
    assert drawn[0].get_linewidth() < min(line.get_linewidth() for line in drawn[1:])
    assert len({line.get_linestyle() for line in panel(six["position"], "joint 1").get_lines()[:2]}) == 2


def test_failed_run_ends_in_a_cross_and_does_not_set_the_range(six: dict[str, Figure]) -> None:
    """Its line stops where the run did, the legend says so, and the others keep their scale."""
    for key in ("position", "error", "torque", "sliding"):
        assert any(text.startswith("wild (diverged at 0.699 s)") for text in legend_texts(six[key]))
        ax = panel(six[key], "joint 1")
        crosses = [line for line in ax.get_lines() if line.get_marker() == "x"]
        assert len(crosses) == 1
        end = 0.698 if key == "torque" else 0.699  # the torque of the failing instant is missing
        assert crosses[0].get_xdata() == pytest.approx([end], abs=1e-9)
        low, high = ax.get_ylim()
        assert low <= np.ravel(crosses[0].get_ydata())[0] <= high
    low, high = panel(six["error"], "joint 1").get_ylim()
    # Errors of 10 mrad: the range may widen by its own width on the failed side, and has margins of 6 %.
    assert high - low <= 2.0 * 2.0 * 10.0 * 1.12 + 1e-6
    assert any("wild (diverged at 0.699 s) (no spectrum)" in text for text in legend_texts(six["spectrum"]))


def test_only_failed_runs() -> None:
    """Pages are still drawn when no run completed; only a spectrum there is none."""
    figures = draw({"wild": diverged(1), "dead": diverged(1, 1)}, 1)
    assert tuple(figures) == PAGES[:-1]
    for fig in figures.values():
        assert figure_bytes(fig, "png").startswith(b"\x89PNG")


def test_laws_without_sliding_variable() -> None:
    """One law without s is named as such; no page when no law has one."""
    a, b = make(1, 9.0), make(1, 1.0)
    b = replace(b, s=np.full_like(b.s, np.nan))
    mixed = page("sliding", {"a": a, "b": b}, 1)
    assert legend_texts(mixed)[:2] == ["a", "b (has none)"]
    assert len(mixed.axes[0].get_lines()) == 1
    assert draw({"b": b}, 1, ["sliding"]) == {}


def test_error_reference_and_limits_are_drawn_as_they_are() -> None:
    """Error is q_ref - q in the stated unit; the reference is black and dashed; limits lie at +-tau_max."""
    run = make(1, 15.0, error=0.02)
    figures = draw({"a": run}, 1, ["error", "position", "torque"])
    line = figures["error"].axes[0].get_lines()[0]
    shown = np.interp(run.t, np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
    # Thinning moves the line by less than one stretch's change: 1500/600 samples of a 20 mrad, 1 Hz wave.
    assert shown == pytest.approx(1e3 * (run.q_ref - run.q)[:, 0], abs=20 * 2 * np.pi * 0.003)
    reference = figures["position"].axes[0].get_lines()[-1]
    assert (reference.get_color(), reference.is_dashed()) == ("black", True)
    levels = [np.ravel(line.get_ydata()) for line in figures["torque"].axes[0].get_lines()]
    assert {float(y[0]) for y in levels if len(y) == 2 and y[0] == y[1]} == {-20.0, 20.0}
    low, high = figures["torque"].axes[0].get_ylim()
    assert low < -20.0 < 20.0 < high  # in view because the torque uses most of it


def test_zoom_lies_in_the_middle_of_the_window_and_shows_held_torque() -> None:
    """60 ms about the middle of [0.5 s, 1.499 s], drawn as steps, every sample kept."""
    run = make(1, 9.0, switching=True)
    detail = panel(page("torque", {"a": run}, 1), "joint 1 zoom")
    assert detail.get_xlim() == pytest.approx((0.9995 - 0.03, 0.9995 + 0.03), abs=1e-9)
    line = detail.get_lines()[0]
    assert line.get_drawstyle() == "steps-post"
    inside = (run.t > 0.9695) & (run.t < 1.0295)
    assert np.isin(run.t[inside], np.asarray(line.get_xdata())).all()


def test_spectrum_reads_the_amplitude_of_a_sinusoid() -> None:
    """50 Hz of 5 N m at a limit of 20 N m peaks at 25 % and at 50 Hz; the corner of 8 Hz is marked."""
    ax = page("spectrum", {"a": make(1, 5.0)}, 1).axes[0]
    mark, *lines = ax.get_lines()
    assert np.ravel(mark.get_xdata())[0] == 8.0
    for line in lines:
        f, a = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        assert f[np.argmax(a)] == pytest.approx(50.0)
        assert a.max() == pytest.approx(25.0, rel=1e-9)  # periodic in the window: only round-off
    assert ax.get_yscale() == "log"


def test_headline_metrics_stand_in_the_legend() -> None:
    """RMSE on the error page, chattering on the torque page, from the metrics handed in."""
    run = make(1, 5.0)
    metrics = from_joints(per_joint(run, tau_max=np.array([20.0]), metrics_from=0.5, control_period=T, step_like=False))
    figures = draw({"a": run}, 1, ["error", "torque"], metrics={"a": metrics})
    assert legend_texts(figures["error"])[0] == "a (RMSE 7.071 mrad)"  # 10 mrad / sqrt 2
    assert legend_texts(figures["torque"])[0] == "a (chattering 17.68 %)"  # 25 % / sqrt 2


def test_same_input_same_bytes_whatever_the_users_settings() -> None:
    """Drawn anew, written twice, or under other matplotlib settings: no byte differs."""
    runs = {"a": make(1, 9.0, 600, switching=True), "b": make(1, 1.0, 600)}
    first = draw(runs, 1)
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "svg.hashsalt": None}):
        again = draw(runs, 1)
        others = {(key, fmt): figure_bytes(again[key], fmt) for key in PAGES for fmt in ("svg", "png")}
    for (key, fmt), data in others.items():
        assert figure_bytes(first[key], fmt) == data  # type: ignore[arg-type]
    assert figure_bytes(first["torque"], "svg") == others["torque", "svg"]
    assert matplotlib.rcParams["text.parse_math"] is True  # the style does not leak


@pytest.mark.slow
def test_svg_of_switching_torque_stays_small() -> None:
    """Three laws switching at random for 4 s on six joints: each page below 1.5 MB of SVG."""
    runs = {name: make(6, 9.0, 4000, switching=True) for name in "abc"}
    for fig in draw(runs, 6).values():
        svg = figure_bytes(fig, "svg")
        assert len(svg) < 1_500_000
        assert b"<dc:date>" not in svg


def test_names_and_titles_are_text_not_markup() -> None:
    """Dollar signs, underscores, angle brackets and control characters neither fail nor break the SVG."""
    from xml.etree import ElementTree

    figures = draw(
        {"a$_{b$": make(1, 9.0)},
        1,
        title="<b>$x^$ & \x07",
        subtitle="50 % $\n--> \x00 end",
        joint_names=["$_j"],
    )
    for fig in figures.values():
        assert ElementTree.fromstring(figure_bytes(fig, "svg")).tag.endswith("svg")


def test_bad_input_is_refused() -> None:
    """No run, or a run with another number of joints, is an error with a message."""
    with pytest.raises(ResultError, match="at least one run"):
        draw({}, 1)
    with pytest.raises(ResultError, match="2 joints"):
        draw({"a": make(1, 1.0)}, 2)


def test_no_interactive_plotting_and_a_light_package() -> None:
    """`torquebench.report.figures` loads no matplotlib; the figures load no pyplot."""
    code = (
        "import sys, torquebench.report.figures; assert 'matplotlib' not in sys.modules;"
        "import torquebench.report.figures.signals; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_long_names_push_no_panels_apart() -> None:
    """Beside names wider than two panels, the gaps between the columns differ by less than the solver's round-off."""
    runs = {f"a law of a name that is as long as three of the panels are wide {k}": make(6, 3.0 + k) for k in range(6)}
    row = draw(runs, 6, ["torque"])["torque"].axes[:6]
    gaps = [b.get_position().x0 - a.get_position().x1 for a, b in itertools.pairwise(row)]
    assert max(gaps) - min(gaps) < 1e-3


def test_more_than_five_controllers_each_have_their_own_panels() -> None:
    """No panel of torque, sliding variable or spectrum shows two of six laws; the range drawn holds every sample."""
    runs = {f"law {k}": make(2, 3.0 + k, switching=k % 2 == 0) for k in range(5)} | {"wild": diverged(2)}
    figures = draw(runs, 2)
    assert tuple(figures) == PAGES
    for key in ("torque", "sliding"):
        assert [ax.get_label() for ax in figures[key].axes] == [f"{run} joint {i}" for run in runs for i in (1, 2)]
        for ax, run in zip(figures[key].axes[::2], runs, strict=True):
            assert ax.texts[0].get_text().startswith(run)
    for k in range(5):
        drawn = (
            panel(figures["torque"], f"law {k} joint 1")
            .collections[0]
            .get_datalim(panel(figures["torque"], f"law {k} joint 1").transData)
        )
        tau = 100.0 * runs[f"law {k}"].tau[:, 0] / 20.0
        assert (drawn.y0, drawn.y1) == pytest.approx((tau.min(), tau.max()))
    assert [ax.get_label() for ax in figures["spectrum"].axes] == list(runs)
