"""How a verdict follows from figures: a claim holds where the whole interval is on its side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from torquebench.paper.records import Records
from torquebench.paper.workload import UNCERTAIN
from torquebench.statistics import Ratio, paired_ratio

HOLDS, FAILS, ONLY_IF = "holds", "fails", "holds only if"


class Case(NamedTuple):
    """One condition under which a claim is judged."""

    who: str
    """Gain set or controller."""
    where: str
    """Reference, chain and disturbance."""
    figure: float
    low: float
    high: float
    """Figure with its 95 % interval; all three equal where one run is all there is."""
    pairs: int
    """Draws behind it."""
    failed: tuple[int, int]
    """Draws in which the claim's law, and the one it is compared with, did not complete."""
    holds: bool


def below(who: str, where: str, ratio: Ratio, limit: float = 1.0) -> Case:
    """Judge that a ratio is below a limit; a run that failed speaks against the claim."""
    holds = ratio.high < limit and not any(ratio.failed)
    return Case(who, where, ratio.ratio, ratio.low, ratio.high, ratio.pairs, ratio.failed, holds)


def above(who: str, where: str, ratio: Ratio, limit: float) -> Case:
    """Judge that a figure is above a limit; a run that failed speaks against the claim."""
    return below(who, where, ratio)._replace(holds=ratio.low > limit and not any(ratio.failed))


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper, judged."""

    claim: str
    where: str
    """Equation or figure."""
    verdict: str
    """``holds``, ``fails`` or ``holds only if``."""
    figure: float
    """Of the first case; see `measure`."""
    interval: tuple[float, float]
    """95 % interval of `figure`."""
    condition: str
    """Under which conditions it holds and fails, where it does both; else what was tried."""
    ablation: str
    """What does as well, or what a simpler law gives."""
    config: str
    """Config that shows it."""
    measure: str
    """What the figure is, and when the claim counts as true."""
    cases: tuple[Case, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain data; cases as a list of objects."""
        return asdict(self) | {"interval": list(self.interval), "cases": [case._asdict() for case in self.cases]}


def judged(claim: str, where: str, measure: str, cases: Sequence[Case], *, ablation: str, config: str) -> Claim:
    """Return a claim with the verdict that its cases give: all hold, none, or some.

    Args:
        claim, where, measure, ablation, config: See `Claim`.
        cases: At least one; the first is the headline.
    """
    held = sum(case.holds for case in cases)
    verdict = HOLDS if held == len(cases) else FAILS if held == 0 else ONLY_IF
    if verdict == ONLY_IF:
        true, false = [c for c in cases if c.holds], [c for c in cases if not c.holds]
        condition = f"holds for {_listed(true)}; fails for {_listed(false)}"
    else:
        condition = f"in all {len(cases)} conditions tried" if len(cases) > 1 else f"{cases[0].who}, {cases[0].where}"
    first = cases[0]
    return Claim(
        claim, where, verdict, first.figure, (first.low, first.high), condition, ablation, config, measure, tuple(cases)
    )


def _listed(cases: Sequence[Case]) -> str:
    """Return cases as text, those of one law together."""
    groups: dict[str, list[str]] = {}
    for case in cases:
        groups.setdefault(case.who, []).append(case.where)
    return "; ".join(f"{who} ({', '.join(places)})" for who, places in groups.items())


def geometric_mean(values: Sequence[float | None]) -> Ratio:
    """Return the geometric mean of a positive figure over draws, with its interval."""
    return paired_ratio(values, [1.0] * len(values))


def average(values: Sequence[float | None]) -> Ratio:
    """Return the mean over draws of a figure of either sign, with Student's interval."""
    known = np.array([value for value in values if value is not None])
    half = float(stats.t.ppf(0.975, len(known) - 1) * stats.sem(known)) if len(known) > 1 else 0.0
    mean = float(np.mean(known))
    return Ratio(mean, mean - half, mean + half, len(known), (len(values) - len(known), 0))


def ablated(x: Records, form: str, chain: str) -> Ratio:
    """Return the RMSE of an ablation, such as ``l-no-fuzzy``, over that of the law it is taken from."""
    return x.ratio("rmse", form, f"proposed-{form[0]}", "sine", chain, UNCERTAIN)


def text(ratio: Ratio) -> str:
    """Return a ratio and its interval as text."""
    return f"{ratio.ratio:.3g} [{ratio.low:.3g}, {ratio.high:.3g}]" if ratio.pairs > 1 else f"{ratio.ratio:.3g}"
