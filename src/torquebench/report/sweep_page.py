"""The page of a sweep: which laws and gains are best, error against chattering, each law's spread, what matters."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.experiment.reference import unit_of
from torquebench.kernel import Array
from torquebench.metrics import METRICS
from torquebench.report.looks import looks
from torquebench.report.render import render
from torquebench.report.sweep_tables import (
    SHOWN,
    Titles,
    answer,
    border_table,
    columns_of,
    failures_table,
    influences,
    ratio_text,
    silent_text,
    value_text,
)
from torquebench.report.tables import headlines, number
from torquebench.sweep.best import conditions, distinct, short_names
from torquebench.sweep.sensitivity import Sensitivity
from torquebench.sweep.summary import TAIL, Figure, Summary
from torquebench.sweep.table import Table, metric_values, rows_by

MOST_GROUPS = 20_000
"""Laws in a case that a page has room for; of more it has the answer, and every law over all cases."""
SPREAD = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles of a law's runs that its strip shows."""


class SweepInfo(NamedTuple):
    """Facts about a sweep that its page gives besides the table."""

    name: str
    description: str
    conditions: str
    """Conditions of the first case in draw 0, in two lines."""
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
    raws: Mapping[str, Mapping[float | str, Any]]
    """Key of the grid -> value as in the table -> value as in the config."""
    plugins: Sequence[str] = ()
    """Paths of the files of its own laws."""
    overrides: Sequence[str] = ()
    """Edits ``key=value`` that were made to its file."""
    border: str = ""
    """Gain along which it was searched where laws start to shake; empty if it was not."""


def sweep_page(table: Table, summary: Summary, info: SweepInfo, found: Sequence[Sensitivity] = ()) -> bytes:
    """Return the page of a sweep; the same arguments give the same bytes.

    Args:
        table: The sweep's table.
        summary: Its summary.
        info: What it is.
        found: What its metrics depend on; of those in `SHOWN` it is told.
    """
    titles = headlines(info.slides, steps=True, tool=True)
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
    return render(
        "sweep",
        scripts=("page", "sweep"),
        data=best_data(summary, info, titles),
        title=info.name,
        lead=info.description or info.workload,
        answer=answer(summary, titles),
        borders=border_table(table) if info.border else None,
        border=info.border,
        laws=law_rows(table, summary, titles, info.laws) if len(summary.overall) > 1 else [],
        shown=[titles[key][0] for key in SHOWN if key in summary.metrics],
        worst=bool(conditions(summary)),
        most=MOST_GROUPS if len(summary.groups) > MOST_GROUPS else 0,
        tail=f"{100 * TAIL:g} %",
        reference=summary.reference,
        failures=failures_table(summary),
        influences=influences(told),
        silent=silent_text(told),
        asked=asked,
        config=info.config,
        facts=json.dumps(dict(info.facts), indent=2),
    )


def best_data(summary: Summary, info: SweepInfo, titles: Titles) -> dict[str, Any]:
    """Return what the page's script needs: laws, keys, metrics, and a row for each law in each case, in SI units.

    Args:
        summary: The sweep's summary.
        info: What it is.
        titles: Titles and scales of the metrics.
    """
    groups, apart, names = distinct(summary), conditions(summary), short_names(summary.grid)
    groups = groups if len(groups) <= MOST_GROUPS else []
    metrics = columns_of(summary, titles)
    colours, laws = looks(info.laws), [law.controller for law in summary.overall]
    keys, places = list[dict[str, Any]](), list[list[int]]()
    for key in summary.grid:
        known = list(dict.fromkeys(value for group in groups if (value := group.values[key]) is not None))
        is_numeric = all(isinstance(value, float) for value in known)
        values: list[Any] = sorted(known) if is_numeric else known
        place = {value: i for i, value in enumerate(values)} | {None: -1}
        places.append([place[group.values[key]] for group in groups])
        unit = unit_of(key) if is_numeric else None
        keys.append(
            {
                "key": key,
                "name": names[key],
                "unit": "" if unit in (None, "1") else unit,
                "words": [value_text(value) for value in values],
                "sets": [_yaml(info.raws.get(key, {}).get(value, value)) for value in values],
                "worst": key in apart,
            }
        )
    figures = {key: [group.figures.get(key) for group in groups] for key in metrics}
    return {
        "laws": [[name, colours[name].colour] for name in laws],
        "plugins": "".join(f" --plugin {shlex.quote(path)}" for path in info.plugins),
        "settings": "".join(f" --set {shlex.quote(text)}" for text in info.overrides),
        "keys": keys,
        "metrics": [
            {"key": key, "title": titles[key][0], "scale": titles[key][1], "lower": METRICS[key].better == "lower"}
            | {
                name: [_end(figure, name) for figure in figures[key]]
                for name in ("mean", "low", "high")[: 3 if key in SHOWN else 1]
            }
            for key in metrics
        ],
        "case": [group.case for group in groups],
        "law": [laws.index(group.controller) for group in groups],
        "places": places,
        "runs": [group.successes.trials for group in groups],
        "completed": [group.successes.successes for group in groups],
    }


def _end(figure: Figure | None, name: str) -> float | None:
    value = None if figure is None else float(getattr(figure, name))
    return None if value is None or math.isnan(value) else value


def _yaml(raw: Any) -> str:
    """Return a value as it is written in a config."""
    return raw if isinstance(raw, str) and raw.isidentifier() else json.dumps(raw, default=str)


def law_rows(table: Table, summary: Summary, titles: Titles, laws: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return what the page says of each law over all cases, the least median error first.

    Args:
        table: The sweep's table.
        summary: Its summary.
        titles: Titles and scales of the metrics.
        laws: Controller -> name of its law.
    """
    shown, colours = [key for key in SHOWN if key in summary.metrics], looks(laws)
    own = {law: rows for (law,), rows in rows_by(table, "controller").items()}
    strips = {key: _strips({law: metric_values(table, rows, key) for law, rows in own.items()}) for key in shown}
    return [
        {
            "name": law.controller,
            "colour": colours[law.controller].colour,
            "completed": f"{law.successes:,} of {law.runs:,}",
            "metrics": [
                {
                    "strip": strips[key].get(law.controller),
                    "median": number(figure and figure.median, titles[key][1]),
                    "tail": number(figure and figure.cvar, titles[key][1]),
                    "ratio": ratio_text(law.ratios.get(key)),
                }
                for key in shown
                for figure in (law.figures.get(key),)
            ],
        }
        for law in sorted(summary.overall, key=lambda law: _median(law.figures.get(SHOWN[0])))
    ]


def _median(figure: Figure | None) -> float:
    return math.inf if figure is None else figure.median


def _strips(values: Mapping[str, Array]) -> dict[str, list[float]]:
    """Return quantiles of each law's values as places on an axis that all share, 0 to 100."""
    known = {law: own[np.isfinite(own)] for law, own in values.items() if np.isfinite(own).any()}
    ends = {law: np.quantile(own, SPREAD) for law, own in known.items()}
    least, most = (end(np.concatenate(list(ends.values()))) for end in (np.min, np.max))
    is_wide = least > 0.0 and most > 3.0 * least
    x = {law: np.log(own / least) / np.log(most / least) if is_wide else own - least for law, own in ends.items()}
    span = 1.0 if is_wide else max(most - least, 1e-300)
    return {law: np.round(100.0 * own / span, 2).tolist() for law, own in x.items()}
