"""Tables of a sweep as text: each law over all cases and in each case, failures, sensitivities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from torquebench.metrics import METRICS
from torquebench.report.tables import Cells, number
from torquebench.statistics import Ratio, Share
from torquebench.sweep.effects import Effects, ranked
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import TAIL, Group, Overall, Summary

SHOWN = ("rmse", "chattering")
"""Metrics with tables and figures of their own: error against chattering."""
Titles = Mapping[str, tuple[str, float]]
"""Title with unit and scale of each metric, as of `headlines`."""


def means_table(summary: Summary, titles: Titles) -> Cells:
    """Return a row for each law: how many runs completed, and their means over all cases and draws.

    Args:
        summary: The sweep's summary.
        titles: Titles and scales of the metrics.
    """
    keys = [key for key in titles if key in summary.metrics]
    rows = [
        [
            law.controller,
            f"{law.successes:,} of {law.runs:,}",
            *(number(law.figures[key].mean, titles[key][1]) if key in law.figures else "-" for key in keys),
        ]
        for law in summary.overall
    ]
    return ["controller", "completed", *(titles[key][0] for key in keys)], rows


def law_table(summary: Summary, laws: Sequence[Group | Overall], metric: str, titles: Titles) -> Cells:
    """Return a row for each law with one metric: mean, tail, worst run, ratio to the reference.

    In one case there are completed runs with their interval, too, and the median: over all cases, where these differ
    much, it is a figure that no run has.

    Args:
        summary: The sweep's summary.
        laws: Laws over all cases, or their groups of one case.
        metric: Name of the metric.
        titles: Titles and scales of the metrics.
    """
    title, scale = titles[metric]
    rows = []
    for law in laws:
        figure = law.figures.get(metric)
        mean, median, tail, worst = (None,) * 4 if figure is None else (figure[1:5])
        row = {"controller": law.controller}
        if isinstance(law, Group):
            row["completed [95 %]"] = share_text(law.successes)
        row[f"mean {title}"] = number(mean, scale)
        if isinstance(law, Group):
            row["median"] = number(median, scale)
        row[f"worst {100 * TAIL:g} %"] = number(tail, scale)
        row["worst"] = number(worst, scale)
        row["its index"] = "-" if figure is None else str(figure.worst_row)
        row[f"over {summary.reference}'s [95 %]"] = ratio_text(law.ratios.get(metric))
        rows.append(row)
    return list(rows[0]), [list(row.values()) for row in rows]


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
    """Return the values of a case as text; keys that none of these laws has are left out."""
    merged: dict[str, float | str | None] = {}
    for group in groups:
        merged |= {key: value for key, value in group.values.items() if value is not None or key not in merged}
    known = {key: value for key, value in merged.items() if value is not None}
    values = [f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}" for key, value in known.items()]
    return ", ".join(values) or "the only case"


def failures_table(summary: Summary) -> Cells:
    """Return a row for each law and case in which runs failed: how many, how, and the earliest of them."""
    rows = []
    for group in summary.groups:
        first = group.earliest_failure
        if first is not None:
            kinds = ", ".join(f"{n} {kind.lower().replace('_', ' ')}" for kind, n in group.outcomes.items())
            rows.append([group.controller, case_text(group), kinds, str(first.row), str(first.draw)])
    return ["controller", "case", "outcomes", "index of the earliest failure", "its draw"], rows


def effects_table(found: Sequence[Sensitivity]) -> Cells:
    """Return a row for each law and metric that depends on something: on what, ranked, and how strongly."""
    rows = []
    for one in found:
        effects = () if one.effects is None else one.effects.effects
        named = [f"{e.name} {e.strength:+.2f} [{e.low:.2f}, {e.high:.2f}]" for e in effects if e.matters]
        if one.effects is not None and named:
            cases, order = ", ".join(map(str, one.cases)), ", ".join(ranked(effects))
            row = [one.controller, METRICS[one.metric].short_title, cases, str(one.draws), order, "; ".join(named)]
            rows.append([*row, explained_text(one.effects)])
    header = ["controller", "metric", "cases", "draws", "what matters", "how [95 %, all at once]", "without products"]
    return header, rows


def explained_text(effects: Effects) -> str:
    """Return how much the inputs explain without their products."""
    explained = effects.explained
    return "one at a time" if explained is None else f"{100 * max(explained, 0.0):.0f} % explained"


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
