"""What a finished sweep's table says: summary, what matters, figures and page; all made again from the table alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from torquebench.cli.conditions import conditions_text
from torquebench.cli.terminal import progress_bar, warn
from torquebench.experiment.schema import slide_joints
from torquebench.experiment.store import json_bytes, machine
from torquebench.report.render import PAGE
from torquebench.report.sweep_page import SweepInfo, sweep_page
from torquebench.sweep.folder import TABLE, StoredSweep
from torquebench.sweep.sensitivity import Sensitivity, sensitivities
from torquebench.sweep.summary import summarise
from torquebench.sweep.table import Table, metric_keys, read_table

MOST_ROWS = 2_000_000
"""Rows up to which the table is looked at as a whole, in memory."""


def report_files(stored: StoredSweep, figures: bool) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of every file about a sweep's table; the same table gives the same bytes.

    Args:
        stored: The sweep, with its final table.
        figures: Whether to draw.
    """
    plan = stored.plan
    if plan.rows > MOST_ROWS:
        warn(f"torquebench: no summary, figures and page of more than {MOST_ROWS:,} runs; the tables are there")
        return
    table = read_table(stored.folder / TABLE)
    yield "summary.json", json_bytes(summarise(table).to_json())
    with progress_bar(0, "draw", "what the figures depend on"):
        found = dependences(stored, table)
    yield "sensitivity.json", json_bytes([one.to_json() for one in found])
    info, svgs = info_of(stored), dict[str, bytes]()
    if figures:
        for name, content in drawn(info, table, found):
            if name.endswith(".svg"):
                svgs[name.removeprefix("figures/").removesuffix(".svg")] = content
            yield name, content
    yield PAGE, sweep_page(table, info, svgs, found)


def dependences(stored: StoredSweep, table: Table) -> list[Sensitivity]:
    """Return what every metric depends on, where constants of the model or keys are drawn."""
    plan = stored.plan
    drawn_keys = any(random.choices is None for random in plan.keys.random)
    if plan.draws < 2 or not (drawn_keys or any(plan.fixed(case).model.mismatch for case in range(plan.cases))):
        return []
    return sensitivities(table, plan.experiment, metric_keys(table))


def drawn(info: SweepInfo, table: Table, found: list[Sensitivity]) -> Iterator[tuple[str, bytes]]:
    """Yield the figures as SVG and PNG files.

    Args:
        info: What the page tells of the sweep.
        table: Its table.
        found: What its metrics depend on.
    """
    from torquebench.analysis.style import figure_bytes
    from torquebench.analysis.sweep_figures import sweep_figures

    with progress_bar(0, "figure", "drawing") as bar:
        said = f"{info.workload}\nfirst case, draw 0: {info.conditions}"
        pages = sweep_figures(table, info.name, said, found, slides=info.slides)
        for name, figure in pages.items():
            for fmt in ("svg", "png"):
                yield f"figures/{name}.{fmt}", figure_bytes(figure, fmt)
            bar.update(1)


def info_of(stored: StoredSweep) -> SweepInfo:
    """Return what the page tells of a sweep besides its table."""
    plan = stored.plan
    facts: dict[str, Any] = {key: stored.facts[key] for key in ("digest", "software", "plugins", "model_files")}
    return SweepInfo(
        plan.first.name,
        plan.first.description or "",
        conditions_text(plan.experiment(0, 0)),
        workload_text(stored),
        plan.source.text.decode(),
        {"seed": plan.seed} | facts | {"machine": machine()},
        slide_joints(plan.first.plant.model),
        "torquebench run --from-sweep DIR --index",
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
