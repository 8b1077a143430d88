"""Summary, sensitivities, page, figures and headline numbers of a finished sweep, all from its table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from torquebench.experiment.describe import conditions_text
from torquebench.experiment.run import Progress
from torquebench.experiment.schema import slide_joints
from torquebench.experiment.store import json_bytes, machine
from torquebench.experiment.sweep_section import Worst
from torquebench.report.render import PAGE
from torquebench.report.sweep_page import SweepInfo, sweep_page
from torquebench.report.sweep_tables import SHOWN
from torquebench.report.tables import headlines
from torquebench.sim.trajectory import Outcome
from torquebench.sweep.best import best_choices, distinct
from torquebench.sweep.border import level_of
from torquebench.sweep.folder import TABLE, StoredSweep, read_column
from torquebench.sweep.run import worst_rows
from torquebench.sweep.sensitivity import Sensitivity, sensitivities
from torquebench.sweep.summary import Figure, Summary, summarise
from torquebench.sweep.table import Table, grid_keys, metric_keys, read_table, rows_by, words

if TYPE_CHECKING:
    from matplotlib import figure

    from torquebench.report.figures.files import Wish

MOST_ROWS = 2_000_000
"""Rows up to which the table is looked at as a whole, in memory."""
MOST_TOLD = 1000
"""Choices that ``--json`` tells."""

Outcomes: TypeAlias = Mapping[str, Mapping[str, int]]
"""Controller -> how its runs ended -> how many did."""
COMPLETED = Outcome.COMPLETED.name


def report_files(stored: StoredSweep, progress: Progress | None = None) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of every file about a sweep's table; the same table gives the same bytes.

    A table of more than `MOST_ROWS` rows has none.

    Args:
        stored: The sweep, with its final table.
        progress: Told what is being worked out.
    """
    if stored.plan.rows > MOST_ROWS:
        return
    table = read_table(stored.folder / TABLE)
    summary = summarise(table)
    yield "summary.json", json_bytes(summary.to_json())
    if progress is not None:
        progress("what the metrics depend on", 0, 0)
    found = dependences(stored, table)
    yield "sensitivity.json", json_bytes([one.to_json() for one in found])
    yield PAGE, sweep_page(table, summary, info_of(stored), found)


def draw_sweep(
    stored: StoredSweep, only: Sequence[str], wish: Wish, progress: Progress | None = None, place: str = "only"
) -> dict[str, bytes]:
    """Draw figures of a sweep; return each file's name and content.

    Args:
        stored: The sweep, with its final table.
        only: Names of the figures that are wanted; all if there are none.
        wish: How they are written.
        progress: Told each figure when it is drawn.
        place: What messages call `only`.

    Raises:
        ConfigError: the sweep has no figure of one of the names.
    """
    from torquebench.report.figures.files import chosen_files

    table = read_table(stored.folder / TABLE)
    jobs = jobs_of(info_of(stored), table, dependences(stored, table))
    return chosen_files(jobs, only, wish, progress, place)


def dependences(stored: StoredSweep, table: Table) -> list[Sensitivity]:
    """Return what every metric depends on, where constants of the model or keys are drawn."""
    plan = stored.plan
    drawn_keys = any(random.choices is None for random in plan.keys.random)
    if plan.draws < 2 or not (drawn_keys or any(plan.fixed(case).model.mismatch for case in range(plan.cases))):
        return []
    return sensitivities(table, plan.experiment, metric_keys(table))


def jobs_of(info: SweepInfo, table: Table, found: list[Sensitivity]) -> dict[str, partial[figure.Figure]]:
    """Return what draws each figure of a sweep, by name.

    Args:
        info: What the page tells of the sweep.
        table: Its table.
        found: What its metrics depend on.
    """
    from torquebench.report.figures.sweep import sweep_jobs

    subtitle = f"{info.workload}\nfirst case, draw 0: {info.conditions}"
    return sweep_jobs(table, info.name, subtitle, found, info.slides, info.laws, info.border)


def info_of(stored: StoredSweep) -> SweepInfo:
    """Return what the page tells of a sweep besides its table."""
    plan = stored.plan
    shown = ("digest", "software", "plugins", "model_files")
    facts: dict[str, Any] = {key: getattr(stored.facts, key) for key in shown}
    return SweepInfo(
        plan.first.name,
        plan.first.description or "",
        conditions_text(plan.experiment(0, 0)),
        workload_text(stored),
        plan.text.decode(),
        {"seed": plan.seed} | facts | {"machine": machine()},
        slide_joints(plan.first.plant.model),
        plan.first.laws,
        {
            axis.key: dict(zip(words(axis), (value.raw for value in axis.values), strict=True))
            for axis in plan.keys.axes
        },
        [str(path) for path in plan.source.plugins],
        plan.source.overrides,
        "" if plan.keys.border is None else plan.keys.border.key,
    )


def workload_text(stored: StoredSweep) -> str:
    """Return how much was run, in words."""
    plan = stored.plan
    words = ((plan.cases, "case"), (plan.draws, "draw"), (len(plan.controllers), "controller"))
    parts = " x ".join(f"{count:,} {word}{'s' * (count != 1)}" for count, word in words)
    # each case is an experiment that is checked anew: not read where all last equally long
    differ = any(axis.key in ("run", "run.duration") for axis in plan.keys.axes)
    lengths = sorted({plan.fixed(case).run.duration for case in range(plan.cases if differ else 1)})
    span = f"{lengths[0]:g} to {lengths[-1]:g}" if len(lengths) > 1 else f"{lengths[0]:g}"
    return f"{parts}: {plan.rows:,} runs of {span} s"


def means(stored: StoredSweep, key: str) -> list[float | None]:
    """Return the mean of a metric over each controller's runs that have it; a row's controller follows from it.

    Args:
        stored: The sweep, finished.
        key: The metric.
    """
    column, count, found = read_column(stored, key), len(stored.plan.controllers), list[float | None]()
    for i in range(count):
        values = column[i::count]
        defined = values[~np.isnan(values)]
        found.append(float(np.mean(defined)) if len(defined) else None)
    return found


def summary_of(stored: StoredSweep) -> Summary | None:
    """Return the summary of a finished sweep; None of one of more than `MOST_ROWS` rows."""
    return summarise(read_table(stored.folder / TABLE)) if stored.plan.rows <= MOST_ROWS else None


def sweep_facts(stored: StoredSweep, outcomes: Outcomes, summary: Summary | None) -> dict[str, Any]:
    """Return what ``--json`` says of a finished sweep: its size, how its runs ended, means and the best in SI units.

    Args:
        stored: The sweep, finished.
        outcomes: How its runs ended.
        summary: Its summary, if it has one.
    """
    plan = stored.plan
    count = len(plan.controllers)
    worst = {row % count: row for row in worst_rows(stored, Worst(worst=1, by="rmse"))}
    centre = {key: means(stored, key) for key in headlines(())}
    found = {
        name: {
            "runs": plan.pairs,
            "completed": outcomes[name].get(COMPLETED, 0),
            "outcomes": outcomes[name],
            "means": {key: values[i] for key, values in centre.items()},
            "worst_row": worst.get(i),
        }
        for i, name in enumerate(plan.controllers)
    }
    size = {"name": plan.first.name, "cases": plan.cases, "draws": plan.draws, "rows": plan.rows}
    best, cases = ([], []) if summary is None else (best_facts(summary), case_facts(summary))
    searched = summary is not None and plan.keys.border is not None
    borders = border_facts(read_table(stored.folder / TABLE)) if searched else []
    return {**size, "controllers": found, "best": best, "cases": cases, "borders": borders}


def border_facts(table: Table) -> list[dict[str, Any]]:
    """Return where each law starts to shake in each case, as in `Level`; what is infinite or unknown is None."""
    keys, found = grid_keys(table), list[dict[str, Any]]()
    for (controller, *values), rows in rows_by(table, "controller", *grid_keys(table)).items():
        level = level_of(table, rows)._asdict()
        if not np.isnan(level["border"]):
            told = {key: x if np.isfinite(x) else None for key, x in level.items()}
            found.append({"controller": controller, "values": dict(zip(keys, values, strict=True)), **told})
    return found


def best_facts(summary: Summary) -> list[dict[str, Any]]:
    """Return the best choices of a sweep, the least error first, at most `MOST_TOLD`, each mean with its interval."""
    by = next((key for key in SHOWN if key in summary.metrics), None)
    return [
        {"controller": one.controller, "case": one.worst.case, "values": one.worst.values}
        | {"cases": one.cases, "runs": one.runs, "completed": one.completed}
        | {"chatters": one.chatters, "metrics": _means(one.figures)}
        for one in (best_choices(summary, by)[:MOST_TOLD] if by else ())
    ]


def case_facts(summary: Summary) -> list[dict[str, Any]]:
    """Return every law in every case, at most `MOST_TOLD`, each mean with its interval."""
    return [
        {"controller": one.controller, "case": one.case, "values": one.values}
        | {"runs": one.successes.trials, "completed": one.successes.successes, "metrics": _means(one.figures)}
        for one in distinct(summary)[:MOST_TOLD]
    ]


def _means(figures: Mapping[str, Figure]) -> dict[str, dict[str, float]]:
    return {key: {"mean": x.mean, "low": x.low, "high": x.high} for key, x in figures.items()}


def unexpected_outcomes(stored: StoredSweep, outcomes: Outcomes) -> dict[str, str]:
    """Return the controllers of which a run ended otherwise than the file expects, and how theirs ended.

    Args:
        stored: The sweep.
        outcomes: How its runs ended.
    """
    found = {}
    for keys in stored.plan.first.controllers:
        own = outcomes[keys.name]
        completed = own.get(COMPLETED, 0)
        if sum(own.values()) - completed if keys.expect == "completed" else completed:
            kinds = ", ".join(f"{count:,} {kind.lower().replace('_', ' ')}" for kind, count in own.items())
            found[keys.name] = f"{kinds}; the file expects: {keys.expect}"
    return found
