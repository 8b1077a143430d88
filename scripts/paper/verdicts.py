"""How a verdict follows from figures: a claim holds where the whole interval is on its side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, TypeAlias

from paper.runs_table import Runs, ratio_of
from paper.workload import CHAINS, UNCERTAIN
from torquebench.plain import plain
from torquebench.statistics import Ratio, mean_interval

HOLDS, FAILS, ONLY_IF = "holds", "fails", "holds only if"
NO_CHANGE = 1.1
"""Ratio of errors up to which one law does as well as another, an error is negligible, or a law insensitive [1]."""
ATTENUATED = 0.9
"""Ratio below which something counts as attenuated [1]."""

Place: TypeAlias = tuple[str, str, str]
"""Reference, chain and condition of runs."""


class Case(NamedTuple):
    """One condition under which a claim is judged."""

    who: str
    """Gain set or controller."""
    place: Place
    """Reference, chain and condition."""
    figure: float
    low: float
    high: float
    """Figure with its 95 % interval; all three equal where nothing is drawn, NaN where no run has a figure."""
    pairs: int
    """Draws behind it."""
    failed: tuple[int, int]
    """Draws without a value for the one, and for the other: the run did not complete, or never settled."""
    holds: bool

    @property
    def where(self) -> str:
        """The place in words."""
        reference, chain, condition = self.place
        return f"{reference}, {chain} chain, {condition}"


def below(who: str, place: Place, ratio: Ratio, limit: float = 1.0) -> Case:
    """Judge that a ratio is below a limit; the claimed law's failed runs speak against the claim.

    Args:
        who: Gain set or controller.
        place: Where it was run.
        ratio: The figure, of the law that the claim praises over another's. Where the other one failed in every draw
            there is none, and the praised one needs only not to have failed.
        limit: What it must be below, interval and all.
    """
    return _case(who, place, ratio, ratio.high < limit)


def _case(who: str, place: Place, ratio: Ratio, true: bool) -> Case:
    holds = ratio.failed[0] == 0 and (true if ratio.pairs else ratio.failed[1] > 0)
    return Case(who, place, ratio.ratio, ratio.low, ratio.high, ratio.pairs, ratio.failed, holds)


def above(who: str, place: Place, ratio: Ratio, limit: float) -> Case:
    """Judge that a figure is above a limit; a run that failed speaks against the claim.

    Args:
        who: Gain set or controller.
        place: Where it was run.
        ratio: The figure.
        limit: What it must be above, interval and all.
    """
    return _case(who, place, ratio, ratio.low > limit)


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper, judged."""

    claim: str
    where: str
    """Equation or figure."""
    verdict: str
    """``holds``, ``fails`` or ``holds only if``."""
    figure: float
    """Of the first case; see `measure`; NaN where no run has one."""
    interval: tuple[float, float]
    """95 % interval of `figure`."""
    condition: str
    """Under which conditions it holds and fails, where it does both; else what was tried."""
    ablation: str
    """What does as well, or what a simpler law gives."""
    config: str
    """Config that shows it."""
    overrides: tuple[str, ...]
    """What `torquebench run` needs beside the config to show the first case, each after ``--set``."""
    measure: str
    """What the figure is, and when the claim counts as true."""
    cases: tuple[Case, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain data; cases as a list of objects, None for a figure that there is not."""
        cases = [case._asdict() | {"where": case.where} for case in self.cases]
        found: dict[str, Any] = plain(
            asdict(self) | {"interval": self.interval, "cases": cases, "command": self.command}
        )
        return found

    @property
    def command(self) -> str:
        """Command that runs the first case."""
        return " ".join(["torquebench run", self.config, *(f"--set '{change}'" for change in self.overrides)])

    @property
    def figure_text(self) -> str:
        """The figure with its interval; where nothing is drawn there is none."""
        if math.isnan(self.figure):
            return "none: no run has a figure"
        if self.cases[0].pairs == 1:
            return f"{self.figure:.3g} (nothing is drawn)"
        return f"{self.figure:.3g} [{self.interval[0]:.3g}, {self.interval[1]:.3g}]"


def judged(
    claim: str,
    where: str,
    measure: str,
    cases: Sequence[Case],
    *,
    ablation: str,
    config: str,
    overrides: tuple[str, ...] = (),
) -> Claim:
    """Return a claim with the verdict that its cases give: all hold, none, or some.

    Args:
        claim, where, measure, ablation, config, overrides: See `Claim`.
        cases: At least one; the first is the headline.
    """
    held = sum(case.holds for case in cases)
    verdict = HOLDS if held == len(cases) else FAILS if held == 0 else ONLY_IF
    if verdict == ONLY_IF:
        condition = f"holds for {_listed(cases, True)}. Fails for {_listed(cases, False)}"
    else:
        condition = f"in all {len(cases)} conditions tried" if len(cases) > 1 else f"{cases[0].who}, {cases[0].where}"
    first = cases[0]
    return Claim(
        claim,
        where,
        verdict,
        first.figure,
        (first.low, first.high),
        condition,
        ablation,
        config,
        overrides,
        measure,
        tuple(cases),
    )


def _listed(cases: Sequence[Case], side: bool) -> str:
    """Return the cases on one side as text: those of one law together, those on several chains in one phrase."""
    found = []
    for who in dict.fromkeys(case.who for case in cases if case.holds == side):
        own = [case for case in cases if case.who == who]
        groups: dict[tuple[str, str], list[str]] = {}
        for reference, chain, condition in (case.place for case in own if case.holds == side):
            groups.setdefault((reference, condition), []).append(chain)
        places = [f"{reference} {condition} on {_chains(chains)}" for (reference, condition), chains in groups.items()]
        found.append(who if all(case.holds == side for case in own) else f"{who} ({', '.join(places)})")
    return "; ".join(found)


def _chains(chains: Sequence[str]) -> str:
    return "all chains" if set(chains) == set(CHAINS) else f"{' and '.join(chains)} chain"


def typical(values: Sequence[float | None]) -> Ratio:
    """Return the geometric mean of a positive figure over draws, with its interval; NaN where no draw has one."""
    return ratio_of(values, [1.0] * len(values))


def average(values: Sequence[float | None]) -> Ratio:
    """Return the mean over draws of a figure of either sign, with Student's interval; NaN where no draw has one."""
    known = [value for value in values if value is not None]
    if not known:
        return Ratio(math.nan, math.nan, math.nan, 0, (len(values), 0), len(values))
    mean, half = mean_interval(known)
    return Ratio(mean, mean - half, mean + half, len(known), (len(values) - len(known), 0), len(values) - len(known))


def ablated(x: Runs, form: str, chain: str) -> Ratio:
    """Return the RMSE of an ablation, such as ``l-no-fuzzy``, over that of the law it is taken from."""
    return x.ratio("rmse", form, f"proposed-{form[0]}", "sine", chain, UNCERTAIN)


def as_well(tried: Mapping[str, Ratio]) -> str:
    """Return which of the laws tried have an error at most a tenth larger, interval and all, and which do not."""
    well = [f"{name} x{text(ratio)}" for name, ratio in tried.items() if ratio.high < NO_CHANGE and not ratio.failed[0]]
    others = [f"{name} x{text(ratio)}" for name, ratio in tried.items() if f"{name} x{text(ratio)}" not in well]
    parts = [f"as well: {', '.join(well)}" if well else "nothing tried does as well"]
    return "; ".join(parts + ([f"worse: {', '.join(others)}"] if others else []))


def text(ratio: Ratio) -> str:
    """Return a ratio and its interval as text."""
    return f"{ratio.ratio:.3g} [{ratio.low:.3g}, {ratio.high:.3g}]" if ratio.pairs > 1 else f"{ratio.ratio:.3g}"
