"""The page of several runs: every controller beside itself, with ratios to the first run, and what differs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from markupsafe import Markup

from torquebench.experiment.dump import plain
from torquebench.experiment.run import ExperimentResult
from torquebench.experiment.store import other_machines
from torquebench.metrics import MetricInfo
from torquebench.report.render import render
from torquebench.report.run_page import Cell, changed_arm, number_cells
from torquebench.report.tables import heading, headline_columns, headline_table, outcome_text
from torquebench.sweep.plan import flattened

SHOWN = ("rmse", "max_error", "chattering", "total_variation", "effort")
"""Metrics with a column of ratios; the others are in each run's own table."""
SAME = 0.01
"""Ratios within this of 1 are no news."""


class Row(NamedTuple):
    """One controller of one run."""

    controller: str
    run: str
    outcome: str
    bad: bool
    cells: Sequence[Cell]
    """For each metric its value and, but for the first run's, its ratio to the first run's."""


def comparison_page(results: Mapping[str, ExperimentResult]) -> bytes:
    """Return a page with several runs side by side, and the keys in which their experiments differ.

    Args:
        results: Name of a run, such as its folder's -> the run.
    """
    first = next(iter(results))
    rows, titles = compared(results)
    keys = {
        name: {key: json.dumps(value) for key, value in flattened(plain(result.experiment))}
        for name, result in results.items()
    }
    return render(
        "comparison",
        scripts=["page"],
        title=" against ".join(results),
        lead="Runs of different experiments are comparable where their keys are the same.",
        answer=answer(rows, first, titles),
        first=first,
        titles=titles,
        rows=rows,
        failed=any(row.outcome != "completed" or row.bad for row in rows),
        alone=alone(results),
        tables={name: headline_table(result) for name, result in results.items()},
        changed=[
            *other_machines({name: result.facts["machine"] for name, result in results.items()}),
            *(f"{name}: {line}" for name, result in results.items() for line in changed_arm(result)),
        ],
        differences=(["key", *results], differences(keys)),
    )


def alone(results: Mapping[str, ExperimentResult]) -> dict[str, list[str]]:
    """Return the controllers that only one run has, by the run."""
    names = {run: [keys.name for keys in result.experiment.controllers] for run, result in results.items()}
    every = [name for own in names.values() for name in own]
    found = {run: [name for name in own if every.count(name) == 1] for run, own in names.items()}
    return {run: own for run, own in found.items() if own}


def compared(results: Mapping[str, ExperimentResult]) -> tuple[list[Row], list[str]]:
    """Return the rows of the controllers that several runs have, and the titles of their metrics' columns.

    Args:
        results: As of `comparison_page`.
    """
    columns: dict[str, tuple[MetricInfo, dict[tuple[str, str], float | None]]] = {}
    for run, result in results.items():
        for info, slides, values in headline_columns(result):
            if info.key in SHOWN:
                _, all_values = columns.setdefault(heading(info, (slides,)), (info, {}))
                all_values |= {(run, name): value for name, value in values.items()}
    names = dict.fromkeys(keys.name for result in results.values() for keys in result.experiment.controllers)
    pairs = [(name, [run for run, result in results.items() if name in result.runs]) for name in names]
    places = [(name, run, runs[0]) for name, runs in pairs if len(runs) > 1 for run in runs]
    cells: list[list[Cell]] = [[] for _ in places]
    for info, table in columns.values():
        known = [table.get((run, name)) for name, run, _ in places]
        shown = number_cells([None if x is None else x * info.scale for x in known])
        for row, cell, x, (name, run, base) in zip(cells, shown, known, places, strict=True):
            row += [cell, Cell("", None) if run == base else ratio_cell(x, table.get((base, name)), info)]
    rows = [
        Row(name, run, outcome_text(results[run], name), name in results[run].unexpected, row)
        for (name, run, _), row in zip(places, cells, strict=True)
    ]
    return rows, list(columns)


def ratio_cell(value: float | None, base: float | None, info: MetricInfo) -> Cell:
    """Return a value over another, told good or bad where it is neither the same.

    Args:
        value: The value.
        base: What it is compared with.
        info: The metric, which knows what is better.
    """
    if value is None or base is None:
        return Cell("-", None)
    if value == base:
        return Cell("x1", 1.0)
    if base == 0.0:
        return Cell("-", None)
    ratio = value / base
    better = (ratio < 1.0) == (info.better == "lower")
    kind = "" if not ratio > 0.0 or abs(math.log(ratio)) < SAME else "holds" if better else "fails"
    return Cell(f"x{ratio:.3g}" if ratio < 999.5 else f"x{float(f'{ratio:.3g}'):,.0f}", ratio, kind)


def answer(rows: Sequence[Row], first: str, titles: Sequence[str]) -> Markup:
    """Return the largest changes of error and chattering in a sentence.

    Args:
        rows: As of `compared`.
        first: The run with which others are compared.
        titles: Of the metrics.
    """
    parts = []
    for place, title in enumerate(titles):
        ratios = [(row, cell) for row in rows for cell in [row.cells[2 * place + 1]] if cell.value and cell.kind]
        if ratios and (title.startswith("RMSE") or title.startswith("chattering")):
            row, cell = max(ratios, key=lambda pair: abs(math.log(pair[1].value or 1.0)))
            words = Markup("{} of <b>{}</b> in <b>{}</b> is {} times that in <b>{}</b>")
            parts.append(words.format(title.partition(" [")[0], row.controller, row.run, cell.text[1:], first))
    if not rows:
        return Markup("No controller is in more than one of these runs.")
    if not parts:
        return Markup("Errors and chattering of the controllers that the runs share differ by less than 1 %.")
    return Markup("Largest changes: {}.").format(Markup("; ").join(parts))


def differences(configs: Mapping[str, Mapping[str, str]]) -> list[list[str]]:
    """Return a row for each key whose value is not the same in all configs: the key, and each config's value.

    Args:
        configs: Name of a run -> its keys and values.
    """
    keys = dict.fromkeys(key for config in configs.values() for key in config)
    rows = [[key, *(config.get(key, "-") for config in configs.values())] for key in keys]
    return [row for row in rows if len(set(row[1:])) > 1]
