"""Figures of fuzzy systems say what they show, show what the kernels compute, and come out as the same bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.arms import pack
from tests.fuzzy.test_tables import uneven
from torquebench.errors import ResultError
from torquebench.fuzzy import Functions, FuzzySystem, Prepared, Variable, builtin_system, prepare
from torquebench.fuzzy.system import rules_of_table
from torquebench.kernel import Array
from torquebench.report.figures.files import figure_bytes
from torquebench.report.figures.fuzzy import SCALES, system_figures
from torquebench.report.figures.fuzzy_rules import rule_shares, rule_tables
from torquebench.sim.trajectory import Outcome, Trajectory

V = Variable.of({"low": 1.0, "mid": 2.0, "high": 3.0}, 1.0, 3.0)
ONE = FuzzySystem(
    "one-input", (V,), Functions.of({"a": -1.0, "b": (0.5, 0.25)}), rules_of_table([V.names], [["a", "b", "b"]])
)
SYSTEMS = [builtin_system("pd-49"), uneven(), ONE]


@pytest.fixture(scope="session")
def pages() -> Callable[[FuzzySystem], dict[str, Figure]]:
    """Pages of a system, drawn once."""
    return cache(lambda system: system_figures(prepare(system)))


def texts(fig: Figure) -> str:
    """Return everything written on a page."""
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in fig.findobj(Text))  # type: ignore[attr-defined]


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda system: system.name)
def test_pages_say_what_they_show(system: FuzzySystem, pages: Callable[[FuzzySystem], dict[str, Figure]]) -> None:
    """Each page names the system, its operators, how it is evaluated and how wrong that may be."""
    prepared, drawn = prepare(system), pages(system)
    assert set(drawn) == {"membership", "surface", "scaling"}
    for fig in drawn.values():
        written = texts(fig)
        assert f"fuzzy system {system.name}" in written
        assert f"{len(system.rules)} rules" in written.replace("\n", " ")
        assert prepared.method in written.replace("\n", " ")
        assert (f"error at most {prepared.bound:.2g}" in written.replace("\n", " ")) == (prepared.bound > 0.0)
        assert "input 1" in written
    names = texts(drawn["membership"])
    for variable in (*system.inputs, system.output):
        assert all(name in names for name in variable.names)
        assert f"range {variable.low:g} to {variable.high:g}" in names


def test_membership_page_draws_the_terms(pages: Callable[[FuzzySystem], dict[str, Figure]]) -> None:
    """The curves of a panel have their peaks and feet where the definition has them, in its own units."""
    system = uneven()
    ax = pages(system)["membership"].axes[0]
    for line, term in zip(ax.get_lines(), system.inputs[0].terms, strict=True):
        assert np.ravel(line.get_xdata()).tolist() == [term.a, term.b, term.c, term.d]
        assert np.ravel(line.get_ydata()).tolist() == [0.0, 1.0, 1.0, 0.0]


def test_surface_page_draws_what_the_kernels_compute(pages: Callable[[FuzzySystem], dict[str, Figure]]) -> None:
    """The sections are the outputs themselves, beside the clipped sum of the inputs."""
    system = builtin_system("pd-49")
    prepared, ax = prepare(system), pages(system)["surface"].axes[1]
    sections, sums = ax.get_lines()[::2], ax.get_lines()[1::2]
    for line, second in zip(sections, (lambda x: 0.0 * x, lambda x: x, lambda x: 0.0 * x - 0.5), strict=True):
        x, y = (np.asarray(data, dtype=np.float64) for data in line.get_data())
        assert np.array_equal(y, prepared.outputs(x, second(x)))
    assert len(sums) == 3


def test_scaling_page_compares_three_scales(pages: Callable[[FuzzySystem], dict[str, Figure]]) -> None:
    """Too small a scale clips most of the signal, too large a one leaves most terms unused."""
    system = builtin_system("pd-49")
    prepared, fig = prepare(system), pages(system)["scaling"]
    above, below = fig.axes[:3], fig.axes[3:]
    for ax, (name, scale) in zip(above, SCALES.items(), strict=True):
        assert ax.get_title(loc="left").startswith(name)
        seen = sum(bool(np.any(np.isfinite(np.asarray(line.get_ydata(), dtype=float)))) for line in ax.get_lines())
        assert seen == (3 if scale > 1.0 else 7)
    for ax, scale in zip(below, SCALES.values(), strict=True):
        x, y = (np.asarray(data, dtype=np.float64) for data in ax.get_lines()[0].get_data())
        assert np.array_equal(y, prepared.outputs(x / scale, 0.0 * x))


@pytest.mark.parametrize("fmt", ["svg", pytest.param("png", marks=pytest.mark.slow)])
def test_the_same_system_gives_the_same_bytes(fmt: Any, pages: Callable[[FuzzySystem], dict[str, Figure]]) -> None:
    """Drawing twice changes nothing."""
    both = pages(uneven()), system_figures(prepare(uneven()))
    first, second = ([figure_bytes(fig, fmt) for fig in drawn.values()] for drawn in both)
    assert first == second
    assert all(len(data) < 1_500_000 for data in first)


def run_with(e: Array, de: Array) -> Trajectory:
    """Return a run whose measured errors are these, (N, n); the true ones are none."""
    zero = np.zeros_like(e)
    return Trajectory(
        t=0.001 * np.arange(len(e)),
        q=zero,
        qd=zero,
        q_meas=-e,
        qd_meas=-de,
        q_ref=zero,
        qd_ref=zero,
        qdd_ref=zero,
        s=zero,
        tau_law=zero,
        tau=zero,
        tau_applied=zero,
        outcome=Outcome.COMPLETED,
    )


def shares_of(prepared: Prepared, run: Trajectory, **gains: Any) -> Array:
    """Return the shares of the rules of a system in the fuzzy linear-band law with these gains."""
    values = {"lam": 10.0, "k": 0.3, "phi": 1.0, "kv": 20.0, "kf": 0.3, "gd": 4.0, "ki": 0.0} | gains
    controller = pack("fuzzy-linear-band-smc", run.q.shape[1], **values)
    (rules,) = controller.law.rules.values()
    return rule_shares(controller.gains, prepared.fis, rules.inputs, run)


def test_shares_of_rules_by_hand() -> None:
    """Of two joints one sits on a single rule, the other spends a quarter of the time half way between two."""
    prepared = prepare(builtin_system("pd-25"))
    # ge = gd/lambda = 0.4 rad; e = 0.2 is x = 1/2, the peak of PS; de = -4 rad/s is y = -1, that of NB
    e, de = np.full((4, 2), [0.2, 0.0]), np.full((4, 2), [-4.0, 0.0])
    e[3, 1] = -0.1  # x = -1/4, half way between NS and Z
    shares = shares_of(prepared, run_with(e, de))
    assert shares.shape == (2, 5, 5)
    assert shares[0, 3, 0] == pytest.approx(1.0)
    assert np.count_nonzero(shares[0]) == 1
    assert (shares[1, 2, 2], shares[1, 1, 2]) == pytest.approx((0.875, 0.125))
    assert shares.sum(axis=(1, 2)) == pytest.approx(np.ones(2))


def test_shares_follow_the_laws_own_scaling() -> None:
    """Each joint's inputs are scaled by its own gains, and the mirrored error fires the mirrored rule."""
    prepared = prepare(builtin_system("pd-25"))
    e, de = np.full((3, 2), 0.2), np.full((3, 2), 2.0)
    shares = shares_of(prepared, run_with(e, de), lam=np.array([5.0, 10.0]), gd=np.array([2.0, 4.0]))
    assert (shares[0, 3, 4], shares[1, 3, 3]) == pytest.approx((1.0, 1.0))
    mirrored = shares_of(prepared, run_with(-e, -de), lam=np.array([5.0, 10.0]), gd=np.array([2.0, 4.0]))
    assert mirrored == pytest.approx(shares[:, ::-1, ::-1])


def test_instants_without_a_finite_state_count_for_no_rule() -> None:
    """A run that ended in NaN is drawn as far as it went."""
    e = np.full((4, 1), 0.2)
    e[2:] = np.nan
    shares = shares_of(prepare(builtin_system("pd-25")), run_with(e, np.zeros((4, 1))))
    assert shares.sum() == pytest.approx(0.5)


def test_a_law_that_hides_its_scaling_has_no_shares() -> None:
    """Without the law's own scaling nothing is guessed."""
    run = run_with(np.zeros((2, 1)), np.zeros((2, 1)))
    with pytest.raises(ResultError, match="how it scales"):
        rule_shares(None, prepare(builtin_system("pd-9")).fis, None, run)


def test_firing_page_writes_the_shares_and_leaves_idle_rules_grey() -> None:
    """A panel for each joint, the terms beside it, a number in each cell that fired and none in the others."""
    prepared = prepare(builtin_system("pd-25"))
    shares = np.zeros((2, 5, 5))
    shares[0, 3, 0], shares[1, 2, 2], shares[1, 1, 2] = 1.0, 0.875, 0.125
    fig = rule_tables(prepared, shares, ["hip", "knee"], "a title", "what was run")
    assert [ax.get_label() for ax in fig.axes] == ["hip", "knee"]
    for ax, cells in zip(fig.axes, [{(3.5, 0.5): "100"}, {(2.5, 2.5): "88", (1.5, 2.5): "12"}], strict=True):
        assert {text.get_position(): text.get_text() for text in ax.texts} == cells
        assert [label.get_text() for label in ax.get_xticklabels()] == list(prepared.system.inputs[0].names)
    assert all(word in texts(fig) for word in ("a title", "what was run", "did not fire", "[%]"))


def test_firing_page_of_one_input() -> None:
    """A system of one input has one row of rules."""
    prepared = prepare(ONE)
    fired = np.zeros((1, 3, 2))
    fired[0, 1] = 1.0
    fig = rule_tables(prepared, fired, ["hip"], "t", "s")
    assert [text.get_text() for text in fig.axes[0].texts] == ["100"]
    assert figure_bytes(fig, "png") == figure_bytes(rule_tables(prepared, fired, ["hip"], "t", "s"), "png")


@pytest.mark.parametrize(("terms", "most"), [(13, 1_100_000), pytest.param(25, 4_000_000, marks=pytest.mark.slow)])
def test_twenty_five_terms_fit(terms: int, most: int) -> None:
    """The largest rule table still gives a page of bounded size; one of half its sides a quarter."""
    names = {f"t{k}": float(k) for k in range(terms)}
    big = Variable.of(names, 0.0, terms - 1.0)
    rules = rules_of_table([big.names, big.names], [[f"t{min(i, j)}" for j in range(terms)] for i in range(terms)])
    prepared = prepare(replace(builtin_system("pd-9"), name="big", inputs=(big, big), output=big, rules=rules))
    shares = np.full((2, terms, terms), 1.0 / terms**2)
    fig = rule_tables(prepared, shares, ["hip", "knee"], "t", "s")
    assert len(figure_bytes(fig, "svg")) < most
