"""Judging the claims of a study from its runs: nothing but the runs decides."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

from torquebench.audit.run import Runs
from torquebench.audit.study import MAX_WORDS, Claim, Condition, Measure, Pair, Question, Study
from torquebench.audit.verdicts import Interval, Verdict, all_of, judge, mean, over_cases, ratio, share
from torquebench.certificates import FIGURES
from torquebench.metrics import METRICS
from torquebench.plain import plain

AS_WELL = 1.1
"""Ratio up to which one law does as well as another [1]."""


class Figure(NamedTuple):
    """One measure of one case."""

    measure: Measure
    interval: Interval
    of: float | None
    """Mean of the judged law's figure over draws, in the figure's unit."""
    beside: float | None
    """The same of what it is set against."""
    verdict: Verdict


class Case(NamedTuple):
    """One pair of controllers under one condition."""

    pair: Pair
    condition: Condition
    where: str
    """The condition in words; see `Study.words`."""
    figures: tuple[Figure, ...]
    verdict: Verdict


class Ablation(NamedTuple):
    """A simpler law beside the one that is judged."""

    label: str
    where: str
    """The condition in words."""
    interval: Interval
    """Ratio of the first measure's figure."""

    higher: bool
    """Whether more of the figure is better."""

    @property
    def as_well(self) -> bool:
        """Whether it does as well as the law itself: at most a tenth worse, whole interval included."""
        worst = 1.0 / self.interval.low if self.higher and self.interval.low > 0.0 else self.interval.high
        return not self.interval.failed[0] and self.interval.n > 0 and worst < AS_WELL


@dataclass(frozen=True)
class Judged:
    """A claim with its verdict and what it rests on."""

    key: str
    claim: Claim
    verdict: Verdict
    cases: tuple[Case, ...]
    """Those that are judged."""
    shown: tuple[Case, ...]
    """Those of unlike pairs, which are not."""
    vacuous: int
    """Cases left out: no joint ever leaves its layer, so that certificates say nothing."""
    ablations: tuple[Ablation, ...]

    @property
    def moved(self) -> bool:
        """Whether the verdict differs from the one that the study expects."""
        return self.claim.expect is not None and self.claim.expect != self.verdict

    @property
    def typical(self) -> tuple[float, float, float]:
        """Median, least and greatest of the first measure over the cases; NaN where none has a figure."""
        values = [case.figures[0].interval.value for case in self.cases]
        known = [value for value in values if not math.isnan(value)]
        return (statistics.median(known), min(known), max(known)) if known else (math.nan,) * 3

    @property
    def source(self) -> str:
        """Place of the claim in the text, and a note where the text only implies it."""
        return self.claim.where if self.claim.quoted else f"{self.claim.where}; implied, not said"

    @property
    def sentence(self) -> str:
        """The finding in at most `MAX_WORDS` words: where it turns, and the median with its range."""
        if not self.cases:
            return "no case: nothing is certified anywhere"
        middle, low, high = self.typical
        first = self.claim.measures[0]
        figures = "no figure" if math.isnan(middle) else f"median {shown(middle, first)}"
        if low < high:
            figures += f", {shown(low, first)} to {shown(high, first)}"
        texts = [f"{where}; {figures}" if figures else where for where in (self._groups(), self._counts())]
        return next((text for text in texts if len(text.split()) <= MAX_WORDS), texts[-1])

    def _counts(self) -> str:
        """Return in how many cases it holds, fails or is undecided."""
        counts = Counter(case.verdict for case in self.cases)
        n = len(self.cases)
        if len(counts) == 1:
            return "in the one case" if n == 1 else f"in all {n} cases"
        return " and ".join(f"{verdict} in {counts[verdict]}" for verdict in Verdict if counts[verdict]) + f" of {n}"

    def _groups(self) -> str:
        """Return on which levels of the first axis every case holds, every case fails, and where there are both."""
        groups: dict[str, set[Verdict]] = {}
        for case in self.cases:
            groups.setdefault(case.condition[0] if case.condition else "all", set()).add(case.verdict)
        named: dict[str, list[str]] = {}
        for group, verdicts in groups.items():
            named.setdefault(str(next(iter(verdicts))) if len(verdicts) == 1 else "mixed", []).append(group)
        if len(named) == 1:
            return self._counts()
        order = [*map(str, Verdict), "mixed"]
        return "; ".join(f"{verdict} on {', '.join(named[verdict])}" for verdict in order if verdict in named)

    @property
    def carried(self) -> str:
        """The simpler laws that do as well, in words."""
        if not self.ablations:
            return "none was tried"
        well = list(dict.fromkeys(one.label for one in self.ablations if one.as_well))
        worse = [label for label in dict.fromkeys(one.label for one in self.ablations) if label not in well]
        parts = [f"as well somewhere: {', '.join(well)}" if well else "nothing tried does as well"]
        return "; ".join(parts + ([f"worse: {', '.join(worse)}"] if worse else []))

    def to_json(self, commands: Mapping[Condition, str] = MappingProxyType({})) -> dict[str, Any]:
        """Return plain data, None for a figure that there is not.

        Args:
            commands: Condition -> the command that runs it.
        """
        middle, low, high = self.typical
        command = next((commands.get(case.condition, "") for case in self.cases), "")
        found: dict[str, Any] = plain(
            {
                "id": self.key,
                "claim": self.claim.says,
                "where": self.claim.where,
                "quoted": self.claim.quoted,
                "implied": self.claim.implied,
                "verdict": str(self.verdict),
                "expect": self.claim.expect,
                "figure": middle,
                "interval": [low, high],
                "condition": self.sentence,
                "command": command,
                "config": command.rpartition(" ")[2],
                "overrides": [],  # the condition's own config has them all
                "measure": "; ".join(measure_words(measure) for measure in self.claim.measures),
                "why": [measure.why for measure in self.claim.measures],
                "cases": [
                    _case(case) | {"command": commands.get(case.condition)} for case in (*self.cases, *self.shown)
                ],
                "vacuous": self.vacuous,
                "ablation": self.carried,
                "ablations": [
                    {"who": one.label, "where": one.where, "as_well": one.as_well} | _interval(one.interval)
                    for one in self.ablations
                ],
            }
        )
        return found


def _case(case: Case) -> dict[str, Any]:
    return {
        "who": case.pair.label,
        "of": case.pair.of,
        "beside": case.pair.over,
        "like": case.pair.like,
        "place": list(case.condition),
        "where": case.where,
        "verdict": str(case.verdict),
        "figures": [
            {"figure": one.measure.figure, "as": one.measure.relation, "of": one.of, "over": one.beside}
            | _interval(one.interval)
            | {"verdict": str(one.verdict)}
            for one in case.figures
        ],
    }


def _interval(interval: Interval) -> dict[str, Any]:
    return {
        "value": interval.value,
        "low": interval.low,
        "high": interval.high,
        "n": interval.n,
        "failed": list(interval.failed),
    }


def judge_study(study: Study, runs: Runs, reduced: bool = False) -> list[Judged]:
    """Judge every claim of a study, in its order; arguments as of `judge_claim`."""
    return [judge_claim(study, question, runs, reduced) for question in study.questions]


def judge_claim(study: Study, question: Question, runs: Runs, reduced: bool = False) -> Judged:
    """Judge one claim.

    Args:
        study: The study.
        question: The claim.
        runs: What came out.
        reduced: Whether there were other draws than the study asks for; see `over_cases`.
    """
    cases, other, vacuous = list[Case](), list[Case](), 0
    certified = [measure.figure for measure in question.claim.measures if measure.figure in FIGURES]
    for pair in question.pairs:
        for condition, draws in question.conditions.items():
            idle = [runs.values(figure, pair.of, condition, draws) for figure in certified]
            if any(all(x is not None and math.isnan(x) for x in values) for values in idle):
                vacuous += pair.like
                continue
            figures = tuple(
                _figure(study, runs, measure, pair, condition, draws) for measure in question.claim.measures
            )
            case = Case(pair, condition, study.words(condition), figures, all_of([one.verdict for one in figures]))
            (cases if pair.like else other).append(case)
    first = question.claim.measures[0]
    ablations = tuple(
        Ablation(
            pair.label,
            study.words(condition),
            _ratio(runs, first, pair, condition, draws),
            first.figure in METRICS and METRICS[first.figure].better == "higher",
        )
        for pair in question.ablations
        for condition, draws in question.ablated.items()
    )
    verdict = over_cases([case.verdict for case in cases], reduced) if cases else Verdict.UNDECIDED
    return Judged(question.key, question.claim, verdict, tuple(cases), tuple(other), vacuous, ablations)


def _figure(study: Study, runs: Runs, measure: Measure, pair: Pair, condition: Condition, draws: int) -> Figure:
    """Compute one measure of one case, and judge it; arguments as they are called elsewhere here."""
    of = runs.values(measure.figure, pair.of, condition, draws)
    beside: list[float | None] | None = None
    if measure.against is not None:
        other = runs.values(measure.figure, pair.of, study.moved(condition, measure.against), draws)
        beside = [math.nan if x is None else x for x in other]  # its own failure there is nothing in its favour
    elif pair.over is not None and measure.relation in ("ratio", "difference"):
        beside = runs.values(measure.figure, pair.over, condition, draws)
    if beside is not None:
        of, beside = _paired(of, beside)
    if measure.relation == "ratio":
        interval = ratio(of, beside or [], measure.floor)
    elif measure.relation == "share":
        interval = share(of, measure.counted)
    else:
        interval = mean(of, beside)
    others = study.moved(condition, measure.against or {})
    if interval.n == 1 and any(runs.experiments[one].is_drawn for one in (condition, others)):
        interval = interval._replace(low=-math.inf, high=math.inf)  # one draw of something random has no spread
    return Figure(measure, interval, _mean(of), _mean(beside), judge(interval, measure.threshold))


def _ratio(runs: Runs, measure: Measure, pair: Pair, condition: Condition, draws: int) -> Interval:
    of, over = (runs.values(measure.figure, name, condition, draws) for name in (pair.of, pair.over or pair.of))
    return ratio(of, over, measure.floor)


def _paired(a: list[float | None], b: list[float | None]) -> tuple[list[float | None], list[float | None]]:
    """Return the draws that both have; where one has nothing to draw, its one run stands for all."""
    if 1 in (len(a), len(b)):
        n = max(len(a), len(b))
        return a * (n // len(a)), b * (n // len(b))
    n = min(len(a), len(b))
    return a[:n], b[:n]


def _mean(values: list[float | None] | None) -> float | None:
    known = [x for x in values or () if x is not None and not math.isnan(x)]
    return statistics.fmean(known) if known else None


def unit_of(figure: str) -> tuple[str, float]:
    """Return the unit in which a figure is shown, and by how much the stored value is multiplied."""
    if figure in METRICS:
        info = METRICS[figure]
        return info.shown_unit, info.scale
    return FIGURES[figure].unit if figure in FIGURES else "1", 1.0


def shown(value: float, measure: Measure) -> str:
    """Return a value of a measure with its unit."""
    if measure.relation == "ratio":
        return f"x{value:.3g}"
    if measure.relation == "share":
        return f"{100.0 * value:.3g} %"
    unit, scale = unit_of(measure.figure)
    return f"{value * scale:.3g}{'' if unit == '1' else f' {unit}'}"


def measure_words(measure: Measure) -> str:
    """Return a measure and its threshold in words."""
    relations: Mapping[str, str] = {"value": "", "ratio": "ratio of ", "difference": "difference of ", "share": ""}
    what = f"{relations[measure.relation]}{measure.figure}"
    if measure.relation == "share":
        counted = replace(measure, relation="value")
        what = f"share of draws with {measure.figure} {measure.counted.side} {shown(measure.counted.limit, counted)}"
    if measure.against is not None:
        what += f", against {', '.join(measure.against.values())}"
    limit = measure.threshold
    return f"{what}: holds {limit.side} {shown(limit.limit, measure)}"
