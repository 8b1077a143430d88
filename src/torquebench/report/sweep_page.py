"""The page of a sweep: every law over all cases and in each, what failed, figures, what matters, what was run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from torquebench.metrics import METRICS
from torquebench.report.render import Picture, render
from torquebench.report.sweep_tables import (
    SHOWN,
    case_table,
    case_text,
    effects_table,
    failures_table,
    means_table,
    overall_table,
    silent_text,
)
from torquebench.report.tables import headlines
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import Group, Summary, summarise
from torquebench.sweep.table import Table

MOST_CASES = 64
"""Cases whose tables are shown."""
HEADINGS = {
    "spread": "Every run",
    "over": "Over {}",
    "map": "{} over two keys",
    "front": "Error against chattering",
    "effects": "What the {} depends on",
}
CAPTIONS = {
    "spread": "All cases and draws of each law together; runs that failed are counted under its name and not drawn.",
    "over": "Geometric means over draws and all other keys, with 95 % intervals over draws. A law is missing where in "
    "every draw one of its runs failed, or where one has the value 0, and altogether where it does not have the key.",
    "map": "Geometric means over draws and all other keys; in brackets how many runs failed.",
    "front": "Each law and choice in the condition in which it is worst, for error and for chattering: geometric means "
    "over draws with 95 % intervals. Ringed: no other one has both less error and less chattering, by these means; one "
    "with a failed run does not take part.",
    "effects": "Standardised rank regression coefficients, the strongest first, with intervals that hold for all laws "
    "and constants at once.",
}


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
    replay: str
    """Command that replays a row, without the row's index."""


def sweep_page(
    table: Table,
    info: SweepInfo,
    figures: Mapping[str, bytes] | None = None,
    found: Sequence[Sensitivity] = (),
    reference: str | None = None,
) -> bytes:
    """Return the page of a sweep; the same arguments give the same bytes.

    Args:
        table: The sweep's table.
        info: What it is.
        figures: Name, as `figures.sweep` has them, -> SVG document, in order.
        found: What its metrics depend on; of those in `SHOWN` it is told.
        reference: Controller that the ratios are to; None for the first.

    Raises:
        ResultError: it is no sweep's table, or the reference is none of its controllers.
    """
    summary = summarise(table, reference)
    shown = [metric for metric in SHOWN if metric in summary.metrics]
    titles, cases = headlines(info.slides, steps=True), by_case(summary)
    first, _, second = info.conditions.partition("\n")
    told = [one for one in found if one.metric in SHOWN]
    drawn = f"; drawn: {', '.join(summary.drawn)}" if summary.drawn else ""
    asked = [
        ("sweep", info.name),
        ("varied", (", ".join(summary.grid) or "nothing but the draw") + drawn),
        ("work", info.workload),
        ("first case, draw 0", first),
        ("its conditions", second),
    ]
    return render(
        "sweep",
        title=info.name,
        lead=info.description or info.workload,
        asked=asked,
        reference=summary.reference,
        means=means_table(summary, titles),
        failures=failures_table(summary),
        replay=info.replay,
        overall=[(_heading(metric), overall_table(summary, metric, titles)) for metric in shown],
        cases=[
            (case_text(*groups), [(_heading(one), case_table(summary, groups, one, titles)) for one in shown])
            for groups in list(cases.values())[:MOST_CASES]
        ],
        more=max(0, len(cases) - MOST_CASES),
        effects=effects_table(told),
        silent=silent_text(told),
        config=info.config,
        facts=json.dumps(dict(info.facts), indent=2),
        figures=[picture(name, svg) for name, svg in (figures or {}).items()],
    )


def by_case(summary: Summary) -> dict[int, list[Group]]:
    """Return the groups of each case."""
    found: dict[int, list[Group]] = {}
    for group in summary.groups:
        found.setdefault(group.case, []).append(group)
    return found


def _heading(metric: str) -> str:
    return _sentence(METRICS[metric].title)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def picture(name: str, svg: bytes) -> Picture:
    """Return a figure with its heading and what it shows.

    Args:
        name: File name without its ending.
        svg: SVG document.
    """
    kind, _, rest = name.partition("-")
    subject = METRICS[rest].title if rest in METRICS else rest.replace("-", " ")
    return Picture(_sentence(HEADINGS.get(kind, name).format(subject)), svg, CAPTIONS.get(kind, ""))
