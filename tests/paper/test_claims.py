"""Verdicts: pure functions of stored figures, decided by intervals, and as able to fail the paper as to praise it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.paper import figure_claims, theory_claims
from torquebench.paper.boundary_layer import Point, front
from torquebench.paper.claims import claims
from torquebench.paper.records import METRICS, Record, Records, ratio_of
from torquebench.paper.verdicts import FAILS, HOLDS, ONLY_IF, Claim, above, as_well, below, judged
from torquebench.paper.workload import (
    LIMIT_NOISE,
    MISMATCH,
    NOISE,
    NOMINAL,
    SLOW_NOISE,
    UNCERTAIN,
    blocks,
    experiment_of,
)
from torquebench.robot.library import data_root
from torquebench.statistics import Ratio, paired_ratio

DRAWS = 5
SPREAD = (0.98, 0.99, 1.0, 1.01, 1.02)
"""Factor of each draw, the same for every law, and a little of its own (see `made`)."""

FINE = {"eta": 0.5, "outside": 0.2, "rising": 0.0, "fuzzy_share": 0.9}
"""Figures of the certificates and of the fuzzy part as the paper would have them."""


def made(figures: Callable[[str, str, str, str], Mapping[str, float | None]]) -> Records:
    """Return records of the whole study whose figures are a function of (controller, reference, chain, condition)."""
    rows = []
    for block in blocks(DRAWS):
        reference = experiment_of(block).reference.kind
        for name in block.controllers:
            for draw in range(block.draws):
                plain = {key: 1.0 for key in METRICS} | dict(FINE)
                values = plain | dict(figures(name, reference, block.chain, block.condition))
                own = 1.0 + 0.001 * (len(name) % 7) * (draw - 2)
                spread = {k: None if v is None else v * SPREAD[draw] * own for k, v in values.items()}
                rows.append(
                    Record(reference, block.chain, block.condition, name, draw, "analytic", "COMPLETED", spread)
                )
    return Records(rows)


def praising(name: str, reference: str, chain: str, condition: str) -> dict[str, float]:
    """Figures of a world in which all that the paper says is true."""
    slow_riser = name.startswith("proposed")
    figures = {"hf": 30.0, "rmse": 2.0, "rise_time": 0.5, "settling_time": 1.0}
    if name in ("band", "linear-band"):
        figures |= {"hf": 0.1, "rmse": 1.0}
    if name == "equation-149":
        figures |= {"hf": 3.0}
    if slow_riser:
        figures |= {"rmse": 1.0, "rise_time": 0.9, "settling_time": 2.0}
    return figures


def test_a_world_as_the_paper_says_is_judged_so() -> None:
    """Every claim holds where the figures are made to bear it out."""
    assert {claim.claim: claim.verdict for claim in claims(made(praising))} == {
        claim.claim: HOLDS for claim in claims(made(praising))
    }


@pytest.mark.parametrize(
    ("judge", "one", "other"),
    [
        (figure_claims.removes_chattering, "linear-band", "conventional"),
        (figure_claims.removes_chattering_as_printed, "equation-149", "conventional"),
        (figure_claims.negligible_error, "linear-band", "conventional"),
        (figure_claims.rejects_noise, "proposed-m", "conventional-m"),
        (figure_claims.conventional_is_faster, "proposed-m", "conventional-m"),
    ],
)
def test_exchanging_two_controllers_changes_the_verdict(
    judge: Callable[[Records], Claim], one: str, other: str
) -> None:
    """The runs of two controllers exchanged by name: a claim that held no longer does."""
    names = {one: other, other: one}
    records = made(praising)
    swapped = Records(
        replace(r, controller=names.get(r.controller, r.controller))
        for r in records.all
        if {one, other} <= available(records, r) or r.controller not in names
    )
    assert judge(records).verdict == HOLDS
    assert judge(swapped).verdict in (FAILS, ONLY_IF)


def available(records: Records, at: Record) -> set[str]:
    """Return the controllers that were run where `at` was, and conventional ones, which stand beside every other."""
    return {
        r.controller
        for r in records.all
        if (r.reference, r.chain, r.condition) == (at.reference, at.chain, at.condition)
    }


@pytest.mark.parametrize(
    ("judge", "change", "verdict"),
    [
        (theory_claims.fuzzy_estimates_dynamics, {"fuzzy_share": 0.3}, FAILS),
        (theory_claims.proposed_is_stable, {"eta": -0.1}, FAILS),
        (figure_claims.removes_chattering, {"hf": 1.2}, FAILS),
    ],
)
def test_a_figure_on_the_wrong_side_fails_a_claim(
    judge: Callable[[Records], Claim], change: dict[str, float], verdict: str
) -> None:
    """The same world with one figure moved across its threshold."""
    assert judge(made(lambda *place: praising(*place) | change)).verdict == verdict


def test_one_chain_against_it_makes_a_claim_conditional() -> None:
    """The condition names the chain on which it fails, and those on which it holds."""

    def mixed(name: str, reference: str, chain: str, condition: str) -> dict[str, float]:
        figures = praising(name, reference, chain, condition)
        return figures | ({"hf": 5.0} if (name, chain) == ("linear-band", "slow") else {})

    claim = figure_claims.removes_chattering(made(mixed))
    assert claim.verdict == ONLY_IF
    holds, fails = claim.condition.split(". Fails for ")
    assert "ideal and fast" in holds
    assert "slow chain" not in holds
    assert "slow chain" in fails
    assert "ideal" not in fails


def test_an_interval_that_reaches_across_does_not_count() -> None:
    """Only a whole interval on the claim's side makes it true, on either side."""
    across = Ratio(0.95, 0.88, 1.02, 30, (0, 0), 0)
    assert not below("a", ("sine", "ideal", "nominal"), across).holds
    assert below("a", ("sine", "ideal", "nominal"), across._replace(high=0.99)).holds
    assert not above("a", ("sine", "ideal", "nominal"), across, 0.9).holds
    assert above("a", ("sine", "ideal", "nominal"), across, 0.87).holds


def test_a_failed_run_speaks_against_the_law_that_failed() -> None:
    """However good its other runs are; the other law's failure speaks for a claim that praises this one."""
    place = "sine", "ideal", "nominal"
    ratio = paired_ratio([0.1, None, 0.1], [1.0, 1.0, 1.1])
    assert ratio.high < 1.0
    assert not below("a", place, ratio).holds
    assert below("a", place, ratio_of([0.1, 0.2, 0.1], [1.0, None, 1.1])).holds
    assert not below("a", place, ratio_of([1.2, 1.2, 1.2], [1.0, None, 1.1])).holds
    assert below("a", place, ratio_of([1.2, 1.2], [None, None])).holds
    assert not below("a", place, ratio_of([None, None], [None, None])).holds


def test_every_claim_survives_failures() -> None:
    """Whichever law fails in all of its runs, every claim is still judged, none by its failure, and JSON has no NaN."""
    records = made(praising)
    for name in {record.controller for record in records.all}:
        broken = Records(replace(r, outcome="DIVERGED", values={}) if r.controller == name else r for r in records.all)
        table = claims(broken)
        assert len(table) == len(claims(records))
        json.dumps([claim.to_json() for claim in table], allow_nan=False)
        for claim, before in zip(table, claims(records), strict=True):
            assert claim.figure_text
            assert before.verdict == HOLDS


def test_what_does_as_well_is_told_from_what_does_not() -> None:
    """A tenth more error, interval and all, is as well; a failed run is not."""
    near, far = Ratio(1.02, 1.0, 1.05, 30, (0, 0), 0), Ratio(1.08, 1.0, 1.15, 30, (0, 0), 0)
    assert as_well({"near": near, "far": far}) == "as well: near x1.02 [1, 1.05]; worse: far x1.08 [1, 1.15]"
    assert as_well({"near": near._replace(failed=(1, 0))}).startswith("nothing tried does as well; worse: near")


def test_stability_is_judged_where_something_is_demanded() -> None:
    """Places in which no joint ever leaves its layer are counted, and are no cases."""

    def still(name: str, reference: str, chain: str, condition: str) -> dict[str, float | None]:
        idle = reference == "sine" and name == "proposed-m"
        return praising(name, reference, chain, condition) | ({"eta": None, "outside": 0.0} if idle else {})

    claim = theory_claims.proposed_is_stable(made(still))
    assert claim.verdict == HOLDS
    assert not any(case.who == "set M" and case.place[0] == "sine" for case in claim.cases)
    assert "in 4 of 32 conditions no joint leaves its layer" in claim.measure


def test_the_command_of_a_claim_runs_its_first_case() -> None:
    """Its config with its overrides is the experiment of the block that the figure comes from, laws and all."""
    for claim in claims(made(praising)):
        reference, chain, condition = claim.cases[0].place
        own = load_experiment(data_root() / claim.config, claim.overrides)
        found = [
            block
            for block in blocks(DRAWS)
            if (block.chain, block.condition) == (chain, condition) and experiment_of(block).reference.kind == reference
        ]
        studied = [experiment_of(block) for block in found]
        keys = {keys.name: keys for experiment in studied for keys in experiment.controllers}
        assert any(keys.get(c.name) == c for c in own.controllers), claim.claim
        same = replace(own, controllers=(), name="", description="")
        assert all(replace(experiment, controllers=(), name="", description="") == same for experiment in studied), (
            claim.claim
        )


def test_a_claim_without_cases_is_no_claim() -> None:
    """The headline is the first case; there must be one."""
    with pytest.raises(IndexError):
        judged("c", "w", "m", [], ablation="", config="")


def test_records_survive_json_and_refuse_doubles() -> None:
    """Claims from stored records are the claims; a run that is there twice is refused, one that is missing named."""
    records = made(praising)
    again = Records.from_json(json.loads(json.dumps(records.to_json())))
    assert [c.to_json() for c in claims(again)] == [c.to_json() for c in claims(records)]
    with pytest.raises(ResultError, match="run twice: "):
        Records([*records.all, records.all[0]])
    with pytest.raises(ResultError, match="not run: sine, ideal, nominal, nobody"):
        records.values("rmse", "nobody", "sine", "ideal", "nominal")


def test_the_front_is_what_nothing_beats() -> None:
    """Four points worked out by hand: one is beaten in both, one failed once, two are the front in order of HF."""

    def point(rmse: float, hf: float, failed: int = 0) -> Point:
        return Point(
            0.1, 0.3, 10.0, Ratio(rmse, rmse, rmse, 3, (failed, 0), failed), Ratio(hf, hf, hf, 3, (failed, 0), failed)
        )

    a, b, beaten, failed = point(1.0, 5.0), point(3.0, 2.0), point(3.5, 6.0), point(0.5, 0.5, 1)
    assert front([beaten, a, failed, b]) == [b, a]


def test_the_study_is_what_the_protocol_asks_for() -> None:
    """Every chain for Figs 9 to 11, thirty draws where something is drawn, the first of them on both plants."""
    every: list[Any] = blocks(30)
    for config in ("fig9-chattering", "fig9-step", "fig9-ramp", "fig10-following", "fig10-step", "fig11-noise"):
        assert {b.chain for b in every if b.config == config} == {"ideal", "fast", "slow"}, config
    drawn = (NOISE, UNCERTAIN, MISMATCH, SLOW_NOISE, LIMIT_NOISE)
    assert all(b.draws == 30 for b in every if b.condition in drawn)
    assert all(b.draws > 1 for b in every if b.condition == NOMINAL and b.chain != "ideal" and b.config != "families")
    assert all(b.draws == 1 for b in every if b.condition not in drawn and b.chain == "ideal")
    assert all((b.draws_on("mujoco"), b.draws_on("analytic")) == (1, b.draws) for b in every)
    for b in every:
        assert {keys.name for keys in experiment_of(b).controllers} == set(b.controllers)
