"""Tables of a sweep as text: each law over all cases and in each case, failures, sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from torquebench.metrics import METRICS
from torquebench.report.tables import number
from torquebench.statistics import Ratio, Share
from torquebench.sweep.effects import ranked
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import TAIL, Figure, Group, Overall, Summary

SHOWN = ("rmse", "hf")
"""Metrics with tables of their own."""
Titles = Mapping[str, tuple[str, float]]
"""Title with unit and scale of each metric, as of `headlines`."""
Cells = tuple[list[str], list[list[str]]]
"""Header and rows."""


def means_table(summary: Summary, titles: Titles) -> Cells:
    """A row for each law: how many runs completed, and their means over all cases and draws.

    Args:
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    keys = [key for key in titles if key in summary.metrics]
    rows = [
        [law.controller, f"{law.successes:,} of {law.runs:,}", *(_mean(law.figures, key, titles) for key in keys)]
        for law in summary.overall
    ]
    return ["controller", "completed", *(titles[key][0] for key in keys)], rows


def overall_table(summary: Summary, metric: str, titles: Titles) -> Cells:
    """A row for each law with one metric over all cases: mean, tail, worst run, ratio to the reference.

    There is no median: where cases differ much it is a figure that no run has.

    Args:
        summary: The sweep's summary.
        metric: Name of the metric.
        titles: Titles and scales of the metrics.
    """
    rows = [[law.controller, *_cells(law, metric, titles)] for law in summary.overall]
    return _without_median(_header(summary, titles[metric][0])), [_without_median(row) for row in rows]


def _without_median(cells: list[str]) -> list[str]:
    return cells[:2] + cells[3:]


def case_table(summary: Summary, groups: Sequence[Group], metric: str, titles: Titles) -> Cells:
    """A row for each law in one case: completed runs with interval, median, and the columns of `overall_table`.

    Args:
        summary: The sweep's summary.
        groups: The laws' groups of the case.
        metric: Name of the metric.
        titles: Titles and scales of the metrics.
    """
    header = _header(summary, titles[metric][0])
    rows = [[group.controller, share_text(group.successes), *_cells(group, metric, titles)] for group in groups]
    return [header[0], "completed [95 %]", *header[1:]], rows


def _header(summary: Summary, title: str) -> list[str]:
    return [
        "controller",
        f"mean {title}",
        "median",
        f"worst {100 * TAIL:g} %",
        "worst",
        "its index",
        f"over {summary.reference}'s [95 %]",
    ]


def _cells(own: Group | Overall, metric: str, titles: Titles) -> list[str]:
    figure, scale = own.figures.get(metric), titles[metric][1]
    if figure is None:
        return ["-"] * 6
    values = (figure.mean, figure.median, figure.cvar, figure.worst)
    return [*(number(value, scale) for value in values), str(figure.worst_row), ratio_text(own.ratios.get(metric))]


def _mean(figures: Mapping[str, Figure], key: str, titles: Titles) -> str:
    return number(figures[key].mean, titles[key][1]) if key in figures else "-"


def ratio_text(ratio: Ratio | None) -> str:
    """Format a ratio with its interval, if draws differ, and the number of draws that were left out."""
    if ratio is None:
        return "-"
    interval = f" [{ratio.low:.3g}, {ratio.high:.3g}]" if math.isfinite(ratio.low) else ""
    missing = f", {ratio.left_out} left out" if ratio.left_out else ""
    return f"{ratio.ratio:.3g}{interval}{missing}"


def share_text(share: Share) -> str:
    """Format a share with the interval of its probability in %, if draws differ."""
    if not math.isfinite(share.low):
        return f"{share.successes} of {share.trials}, all alike"
    return f"{share.successes} of {share.trials} [{100 * share.low:.3g}, {100 * share.high:.3g}] %"


def case_text(*groups: Group) -> str:
    """Values of a case as text; keys that none of these laws has are left out."""
    merged: dict[str, float | str | None] = {}
    for group in groups:
        merged |= {key: value for key, value in group.values.items() if value is not None or key not in merged}
    values = [
        f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}"
        for key, value in merged.items()
        if value is not None
    ]
    return ", ".join(values) or "the only case"


def failures_table(summary: Summary) -> Cells:
    """A row for each law and case in which runs failed: how many, how, and the earliest of them."""
    rows = []
    for group in summary.groups:
        first = group.earliest_failure
        if first is not None:
            kinds = ", ".join(f"{n} {kind.lower().replace('_', ' ')}" for kind, n in group.outcomes.items())
            rows.append([group.controller, case_text(group), kinds, str(first.row), str(first.draw)])
    return ["controller", "case", "outcomes", "index of the earliest failure", "its draw"], rows


def effects_table(found: Sequence[Sensitivity]) -> Cells:
    """A row for each law and metric that depends on something: on what, ranked, and how strongly."""
    rows = []
    for one in found:
        effects = () if one.effects is None else one.effects.effects
        named = [f"{e.name} {e.strength:+.2f} [{e.low:.2f}, {e.high:.2f}]" for e in effects if e.matters]
        if one.effects is not None and named:
            explained = one.effects.explained
            share = "one at a time" if explained is None else f"{100 * max(explained, 0.0):.0f} % explained"
            cases = ", ".join(map(str, one.cases))
            order = ", ".join(ranked(effects))
            rows.append(
                [
                    one.controller,
                    METRICS[one.metric].short_title,
                    cases,
                    str(one.draws),
                    order,
                    "; ".join(named),
                    share,
                ]
            )
    header = ["controller", "metric", "cases", "draws", "what matters", "how [95 %, all at once]", "without products"]
    return header, rows


def silent_text(found: Sequence[Sensitivity]) -> str:
    """Explain where no effect was found; empty if every law and metric has one."""
    reasons: dict[str, list[str]] = {}
    for one in found:
        if one.effects is None:
            reason = one.reason
        elif any(effect.matters for effect in one.effects.effects):
            continue
        else:
            count = len(one.effects.effects)
            reason = f"none of {count} and of their {one.effects.pairs} products shows in {one.draws} draws"
        reasons.setdefault(reason, []).append(f"{METRICS[one.metric].short_title} of {one.controller}")
    return "; ".join(f"{', '.join(dict.fromkeys(names))}: {reason}" for reason, names in reasons.items())
