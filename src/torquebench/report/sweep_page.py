"""The page of a sweep: every law over all cases and in each, what failed, figures, what matters, what was run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from torquebench.metrics import METRICS
from torquebench.report.render import Picture, render
from torquebench.report.sweep_tables import (
    SHOWN,
    case_text,
    effects_table,
    failures_table,
    law_table,
    means_table,
    silent_text,
)
from torquebench.report.tables import Cells, headlines
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import Group, Overall, summarise
from torquebench.sweep.table import Table

MOST_CASES = 64
"""Cases whose tables are shown."""


class SweepInfo(NamedTuple):
    """What a page tells of a sweep besides its table."""

    name: str
    description: str
    conditions: str
    """What the first case is in draw 0, in two lines."""
    workload: str
    """How many cases, draws, laws and runs, in words."""
    config: str
    """The sweep's file."""
    facts: Mapping[str, Any]
    """Seeds, software and machine."""
    slides: Sequence[bool]
    """Of each joint of the arm, whether it slides."""
    laws: Mapping[str, str]
    """Controller -> name of its law."""


def sweep_page(
    table: Table,
    info: SweepInfo,
    figures: Sequence[Picture] = (),
    found: Sequence[Sensitivity] = (),
) -> bytes:
    """Return the page of a sweep; the same arguments give the same bytes.

    Args:
        table: The sweep's table.
        info: What it is.
        figures: Figures to show, in order.
        found: What its metrics depend on; of those in `SHOWN` it is told.

    Raises:
        ResultError: it is no sweep's table.
    """
    summary = summarise(table)
    titles = headlines(info.slides, steps=True)
    shown = [metric for metric in SHOWN if metric in summary.metrics]
    cases = [list(groups) for _, groups in groupby(summary.groups, lambda group: group.case)]
    told = [one for one in found if one.metric in SHOWN]
    drawn = f"; drawn: {', '.join(summary.drawn)}" if summary.drawn else ""
    first, _, second = info.conditions.partition("\n")
    asked = {
        "sweep": info.name,
        "varied": (", ".join(summary.grid) or "nothing but the draw") + drawn,
        "work": info.workload,
        "first case, draw 0": first,
        "its conditions": second,
    }

    def tables(laws: Sequence[Group | Overall]) -> dict[str, Cells]:
        return {METRICS[metric].title: law_table(summary, laws, metric, titles) for metric in shown}

    return render(
        "sweep",
        title=info.name,
        lead=info.description or info.workload,
        asked=asked,
        reference=summary.reference,
        means=means_table(summary, titles),
        failures=failures_table(summary),
        overall=tables(summary.overall),
        cases={case_text(*groups): tables(groups) for groups in cases[:MOST_CASES]},
        more=max(0, len(cases) - MOST_CASES),
        effects=effects_table(told),
        silent=silent_text(told),
        config=info.config,
        facts=json.dumps(dict(info.facts), indent=2),
        figures=figures,
    )
