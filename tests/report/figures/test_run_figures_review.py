"""What a reader must be able to tell from a page: which run, which unit, and lines at the edge of an axis."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tests.report.figures.test_run_figures import PAGES, T, diverged, draw, legend_texts, make, page, panel
from torquebench.errors import ResultError
from torquebench.metrics import Metrics, from_joints, per_joint
from torquebench.report.figures.files import figure_bytes
from torquebench.sim.trajectory import Outcome, Trajectory


def alternating(samples: int = 1500, tau: float = 5.0) -> Trajectory:
    """A run of one joint whose torque changes its sign at every control instant."""
    run = make(1, tau, samples)
    return replace(run, tau=tau * (-1.0) ** np.arange(samples)[:, None])


def measured(run: Trajectory) -> Metrics:
    """Metrics of a run with this file's limits and window."""
    n = run.q.shape[1]
    return from_joints(per_joint(run, tau_max=np.full(n, 20.0), metrics_from=0.5, control_period=T, step_like=False))


def markers(ax: Axes) -> list[Line2D]:
    """Return what marks the lines that stand alone."""
    return [line for line in ax.get_lines() if line.get_marker() == "o"]


def levels(ax: Axes) -> dict[float, Line2D]:
    """Return the horizontal lines across the panel by their height."""
    found = {}
    for line in ax.get_lines():
        x, y = np.ravel(line.get_xdata()), np.ravel(line.get_ydata())
        if len(y) == 2 and y[0] == y[1] and x.tolist() == [0.0, 1.0]:
            found[round(float(y[0]), 9)] = line
    return found


def looks(fig: Figure, count: int) -> list[tuple[str, object]]:
    """Return colour and dash of the first entries of the legend."""
    handles = [handle for handle in fig.legends[0].legend_handles[:count] if isinstance(handle, Line2D)]
    # The offset and pattern as set; get_linestyle names every pattern "--".
    return [(str(line.get_color()), str(line._unscaled_dash_pattern)) for line in handles]  # type: ignore[attr-defined]


@pytest.mark.parametrize("samples", [1500, 1501])
def test_line_of_a_torque_that_switches_every_instant_is_seen(samples: int) -> None:
    """+-5 N m of 20 N m: a marked line of 25 % at the end of the spectrum, clear of the right border."""
    ax = page("spectrum", {"a": alternating(samples)}, 1).axes[0]
    (marker,) = markers(ax)
    f, a = np.ravel(marker.get_xdata()), np.ravel(marker.get_ydata())
    assert f == pytest.approx([500.0], abs=1.1)  # of an odd number of samples the last line lies half a line lower
    if samples == 1500:
        # An even number of samples has a line at 500 Hz; what is left is round-off.
        assert f == pytest.approx([500.0])
        assert a == pytest.approx([25.0], rel=1e-6)
    assert ax.get_xlim()[1] == pytest.approx(650.0)
    assert max(line.get_ydata().max() for line in ax.get_lines()[1:]) < ax.get_ylim()[1]  # type: ignore[union-attr]


def test_spectrum_marks_only_lines_that_stand_alone() -> None:
    """Random switching has no such line, and then no entry in the legend; 50 Hz alone has one at 50 Hz."""
    noisy = page("spectrum", {"a": make(1, 5.0, switching=True)}, 1)
    assert markers(noisy.axes[0]) == []
    assert not any("alone" in text for text in legend_texts(noisy))
    pure = page("spectrum", {"a": make(1, 5.0)}, 1)
    assert [np.ravel(line.get_xdata()).tolist() for line in markers(pure.axes[0])] == [[pytest.approx(50.0)]]
    assert sum("alone" in text for text in legend_texts(pure)) == 1


def test_spectrum_says_what_lies_below_its_axis() -> None:
    """1e-6 N m of 20 N m is 5e-6 %, below 1e-4 %; a run that shows in one joint only is not marked as below."""
    quiet = make(2, 1e-6)
    half = replace(quiet, tau=quiet.tau * np.array([1.0, 1e6]))
    texts = legend_texts(page("spectrum", {"loud": make(2, 5.0), "quiet": quiet, "half": half}, 2))
    assert texts[:3] == ["loud", "quiet (below axis)", "half"]


def test_colour_and_dash_do_not_follow_what_chatters() -> None:
    """Whichever of five runs chatters, each has the same look; five colours; only layer and width change."""
    names = "abcde"
    pages = []
    for restless in (0, 4):
        runs = {name: make(1, 9.0, 600, switching=k == restless) for k, name in enumerate(names)}
        pages.append(draw(runs, 1, metrics_from=0.1))
    seen = [looks(fig, 5) for figures in pages for fig in figures.values()]
    assert all(look == seen[0] for look in seen)
    assert len({colour for colour, _ in seen[0]}) == 5
    for figures, restless in zip(pages, (0, 4), strict=True):
        drawn = panel(figures["position"], "joint 1").get_lines()[:5]
        assert [line.get_color() for line in drawn] == [colour for colour, _ in seen[0]]
        lowest = min(range(5), key=lambda k: drawn[k].get_zorder())
        widest = max(range(5), key=lambda k: drawn[k].get_linewidth())
        assert lowest == widest == restless


def test_torque_limit_stands_in_the_legend_only_where_it_is_drawn() -> None:
    """No entry and no line at 5 % of the limit, where it is written; both at 75 %, in one joint of two."""
    low = page("torque", {"a": make(2, 1.0)}, 2)
    assert not any("torque limit" in text for text in legend_texts(low))
    assert all(levels(ax) == {} for ax in low.axes)
    assert "limit \u00b120 N m" in [text.get_text() for text in panel(low, "joint 1").texts]
    run = make(2, 1.0)
    high = page("torque", {"a": replace(run, tau=run.tau * np.array([1.0, 15.0]))}, 2)
    assert legend_texts(high)[1] == "torque limit"
    assert levels(panel(high, "joint 1")) == {}
    assert set(levels(panel(high, "joint 2"))) == {20.0, -20.0}
    leaning = page("torque", {"a": replace(run, tau=run.tau - 15.0)}, 2)  # as under gravity: one side only
    assert set(levels(panel(leaning, "joint 1"))) == {-20.0}
    assert legend_texts(leaning)[1] == "torque limit"


def test_errors_are_quoted_in_one_unit() -> None:
    """Errors of 2 rad, 20 mrad and 3 urad amplitude, over sqrt 2, all in mrad."""
    runs = {name: make(1, 1.0, error=error) for name, error in (("a", 2.0), ("b", 0.02), ("c", 3e-6))}
    metrics = {name: measured(run) for name, run in runs.items()}
    texts = legend_texts(page("error", runs, 1, metrics=metrics))
    # The window [0.5 s, 1.5 s) is one period.
    assert texts[:3] == ["a (RMSE 1414 mrad)", "b (RMSE 14.14 mrad)", "c (RMSE 0.002121 mrad)"]


@pytest.mark.parametrize("samples", [1, 2, 100])
def test_no_zoom_of_a_run_that_ended_at_once(samples: int) -> None:
    """A run too short to be enlarged, or without any torque, gets one panel per joint and no zoom in the legend."""
    run = replace(make(2, 5.0, samples), outcome=Outcome.BAD_TORQUE, failed_at=samples - 1)
    for tau in (run.tau, np.full_like(run.tau, np.nan)):
        fig = page("torque", {"a": replace(run, tau=tau)}, 2)
        assert len(fig.axes) == 2
        assert not any("zoomed" in text for text in legend_texts(fig))
        assert fig.axes[1].get_xlabel() == "time [s]"


def test_zoom_stays_where_one_of_the_runs_has_data() -> None:
    """A run that failed early does not take the zoom from the others; its length is a plain number."""
    fig = page("torque", {"dead": diverged(1, 3), "a": make(1, 5.0)}, 1)
    assert len(panel(fig, "joint 1 zoom").get_lines()) == 1
    slow = make(1, 5.0, 2000)
    fig = page("torque", {"a": replace(slow, t=50.0 * slow.t)}, 1, control_period=50.0 * T)
    assert "zoomed at the right (1000 ms)" in legend_texts(fig)


def test_bands_are_drawn_where_they_are() -> None:
    """Equal bands once, in grey; another in its controller's colour and named; both signs; in the axis' unit."""
    runs = {name: make(2, 5.0, error=0.03) for name in "abc"}  # |s| up to 300 and 330 mrad/s
    phi = np.array([0.2, 0.1])
    fig = page("sliding", runs, 2, bands={"a": phi, "c": phi})
    for label, level in (("joint 1", 200.0), ("joint 2", 100.0)):
        drawn = levels(panel(fig, label))
        assert set(drawn) == {level, -level}
        assert {line.get_color() for line in drawn.values()} == {"0.4"}
    assert legend_texts(fig)[3] == "band \u00b1phi"
    fig = page("sliding", runs, 2, bands={"a": phi, "c": phi, "b": 2.0 * phi})
    drawn = levels(panel(fig, "joint 1"))
    assert set(drawn) == {200.0, -200.0, 400.0, -400.0}
    assert to_hex(drawn[400.0].get_color()) == to_hex(looks(fig, 2)[1][0])
    assert legend_texts(fig)[3:5] == ["band \u00b1phi of b", "band \u00b1phi"]
    assert levels(panel(page("sliding", runs, 2), "joint 1")) == {}


def test_band_far_outside_is_written_and_does_not_flatten_the_signal() -> None:
    """|s| of 0.1 rad/s in a band of 3 rad/s keeps its own scale."""
    ax = page("sliding", {"a": make(1, 5.0)}, 1, bands={"a": np.array([3.0])}).axes[0]
    assert levels(ax) == {}
    assert ax.get_ylim()[1] < 200.0
    assert [text.get_text() for text in ax.texts] == ["band \u00b13000 mrad/s"]


def test_slides_have_their_own_units() -> None:
    """m, m/s, N and mm for a joint that slides beside one that turns; prefixes are chosen for each kind."""
    run = make(2, 1.0)
    run = replace(run, q=run.q_ref - (run.q_ref - run.q) * np.array([1.0, 1e-3]), s=run.s * np.array([100.0, 1.0]))
    figures = draw(
        {"a": run}, 2, metrics={"a": measured(run)}, slides=[False, True], bands={"a": np.array([8.0, 0.09])}
    )
    labels = {key: [panel(fig, f"joint {i}").get_ylabel() for i in (1, 2)] for key, fig in figures.items()}
    assert labels == {
        "position": ["position [rad]", "position [m]"],
        "error": ["error e [mrad]", "error e [\u00b5m]"],
        "torque": ["joint 1\ntorque [N m]", "joint 2\nforce [N]"],
        "sliding": ["sliding variable s [rad/s]", "sliding variable s [mm/s]"],
        "spectrum": ["torque amplitude [% of limit]", "force amplitude [% of limit]"],
    }
    assert legend_texts(figures["error"])[0] == "a (RMSE 7.071 mrad, 0.007778 mm)"  # 10 mrad, 11 um over sqrt 2
    assert "limit \u00b120 N" in [text.get_text() for text in panel(figures["torque"], "joint 2").texts]
    assert set(levels(panel(figures["sliding"], "joint 1"))) == {8.0, -8.0}
    assert set(levels(panel(figures["sliding"], "joint 2"))) == {90.0, -90.0}
    force = page("torque", {"a": make(1, 15.0)}, 1, slides=[True])
    assert legend_texts(force)[1] == "force limit"


def test_bands_and_slides_keep_bytes_equal() -> None:
    """Drawn twice, every page has the same bytes."""
    runs = {"a": alternating(600), "b": make(1, 1.0, 600)}
    more: dict[str, object] = {"bands": {"a": np.array([0.08]), "b": np.array([0.09])}, "slides": [True]}
    first, again = (draw(runs, 1, metrics_from=0.1, **more) for _ in range(2))
    assert tuple(first) == PAGES
    for key, fig in first.items():
        assert figure_bytes(fig, "svg") == figure_bytes(again[key], "svg")


@pytest.mark.parametrize(
    "more",
    [{"bands": {"b": np.ones(1)}}, {"bands": {"a": np.ones(2)}}, {"slides": [True, False]}],
)
def test_bands_and_slides_of_another_robot_are_refused(more: dict[str, object]) -> None:
    """A band of no controller, or another number of joints, is an error with a message."""
    with pytest.raises(ResultError, match="one slide flag per joint"):
        draw({"a": make(1, 1.0)}, 1, **more)
