"""Verdicts: pure functions of stored figures, decided by intervals, and as able to fail the paper as to praise it."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from paper import figure_claims, theory_claims
from paper.claims import claims
from paper.runs_table import JUDGED, Runs, ratio_of
from paper.verdicts import FAILS, HOLDS, ONLY_IF, Claim, above, as_well, below, judged
from paper.workload import (
    LIMIT_NOISE,
    MISMATCH,
    NOISE,
    NOMINAL,
    PLANTS,
    SLOW_NOISE,
    UNCERTAIN,
    blocks,
    plan_of,
)

from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.metrics import METRICS
from torquebench.shipped import data_root
from torquebench.statistics import Ratio, paired_ratio

DRAWS = 5
SPREAD = (0.98, 0.99, 1.0, 1.01, 1.02)
"""Factor of each draw, the same for every law, and a little of its own (see `made`)."""

WHERE = ["reference", "chain", "condition"]

FINE = {"eta": 0.5, "outside": 0.2, "rising": 0.0, "fuzzy_share": 0.9}
"""Figures of the certificates and of the fuzzy part as the paper would have them."""


def made(figures: Callable[[str, str, str, str], Mapping[str, float | None]]) -> Runs:
    """Return the runs of a study whose figures are a function of (controller, reference, chain, condition)."""
    rows = []
    for block in blocks(DRAWS):
        reference = plan_of(block).first.reference.kind
        for chain, name, draw in itertools.product(block.chains, block.controllers, range(block.draws)):
            plain = dict.fromkeys(METRICS.names(), 1.0) | FINE
            values = plain | dict(figures(name, reference, chain, block.condition))
            own = 1.0 + 0.001 * (len(name) % 7) * (draw - 2)
            spread = {k: math.nan if v is None else v * SPREAD[draw] * own for k, v in values.items()}
            place = {"reference": reference, "chain": chain, "condition": block.condition, "controller": name}
            rows.append(place | {"draw": draw, "plant": "analytic", "outcome": "COMPLETED"} | spread)
    return Runs(pd.DataFrame(rows))


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
def test_exchanging_two_controllers_changes_the_verdict(judge: Callable[[Runs], Claim], one: str, other: str) -> None:
    """The runs of two controllers exchanged by name: a claim that held no longer does."""
    runs = made(praising)
    table = runs.table
    both = {place for place, group in table.groupby(WHERE) if {one, other} <= set(group["controller"])}
    where = pd.Series(list(table[WHERE].itertuples(index=False, name=None)))
    kept = table[where.isin(both) | ~table["controller"].isin([one, other])]
    swapped = Runs(kept.assign(controller=kept["controller"].replace({one: other, other: one})))
    assert judge(runs).verdict == HOLDS
    assert judge(swapped).verdict in (FAILS, ONLY_IF)


@pytest.mark.parametrize(
    ("judge", "change", "verdict"),
    [
        (theory_claims.fuzzy_estimates_dynamics, {"fuzzy_share": 0.3}, FAILS),
        (theory_claims.proposed_is_stable, {"eta": -0.1}, FAILS),
        (figure_claims.removes_chattering, {"hf": 1.2}, FAILS),
    ],
)
def test_a_figure_on_the_wrong_side_fails_a_claim(
    judge: Callable[[Runs], Claim], change: dict[str, float], verdict: str
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
    runs = made(praising)
    whole = claims(runs)
    figures = [*METRICS.names(), *JUDGED]
    for name in runs.table["controller"].unique():
        table = runs.table.copy()
        table.loc[table["controller"] == name, "outcome"] = "DIVERGED"
        table.loc[table["controller"] == name, figures] = math.nan
        broken = claims(Runs(table))
        assert len(broken) == len(whole)
        json.dumps([claim.to_json() for claim in broken], allow_nan=False)
        assert all(claim.figure_text for claim in broken)
    assert {claim.verdict for claim in whole} == {HOLDS}


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
        found = [block for block in blocks(DRAWS) if chain in block.chains and block.condition == condition]
        every = [plan_of(block).experiment(block.chains.index(chain), 0) for block in found]
        studied = [experiment for experiment in every if experiment.reference.kind == reference]
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


def test_runs_survive_their_file_and_refuse_doubles(tmp_path: Path) -> None:
    """Claims from the stored runs are the claims; a run that is there twice is refused, one that is missing named."""
    runs = made(praising)
    (tmp_path / "runs.csv").write_bytes(runs.to_csv())
    again = Runs.read(tmp_path / "runs.csv")
    assert [c.to_json() for c in claims(again)] == [c.to_json() for c in claims(runs)]
    with pytest.raises(ResultError, match="run twice: "):
        Runs(pd.concat([runs.table, runs.table[:1]]))
    with pytest.raises(ResultError, match="not run: sine, ideal, nominal, nobody"):
        runs.values("rmse", "nobody", "sine", "ideal", "nominal")


def test_the_study_is_what_the_protocol_asks_for() -> None:
    """Every chain for Figs 9 to 11, thirty draws where something is drawn, the first of them on both plants."""
    every: list[Any] = blocks(30)
    for config in ("fig9-chattering", "fig9-step", "fig9-ramp", "fig10-following", "fig10-step", "fig11-noise"):
        assert {chain for b in every if b.config == config for chain in b.chains} == {"ideal", "fast", "slow"}, config
    drawn = (NOISE, UNCERTAIN, MISMATCH, SLOW_NOISE, LIMIT_NOISE)
    assert all(b.draws == 30 for b in every if b.condition in drawn)
    assert all(b.draws > 1 for b in every if b.condition == NOMINAL and "ideal" not in b.chains)
    assert all(b.draws == 1 for b in every if b.condition not in drawn and "ideal" in b.chains)
    assert all((b.draws_on("mujoco"), b.draws_on("analytic")) == (1, b.draws) for b in every)
    for b in every:
        assert {plan_of(b, plant).draws for plant in PLANTS} == {1, b.draws}
        assert set(plan_of(b).controllers) == set(b.controllers)
