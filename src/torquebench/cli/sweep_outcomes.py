"""What came out of a sweep, for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from torquebench.cli.terminal import complain, table
from torquebench.experiment.schema import slide_joints
from torquebench.experiment.sweep_section import Worst
from torquebench.report.tables import headlines, number
from torquebench.sim.trajectory import Outcome
from torquebench.sweep.results import read_column
from torquebench.sweep.run import worst_rows
from torquebench.sweep.store import Stored

Outcomes: TypeAlias = Mapping[str, Mapping[str, int]]
"""Controller -> how its runs ended -> how many did."""
COMPLETED = Outcome.COMPLETED.name


def summary(stored: Stored, told: Mapping[str, Any]) -> str:
    """Return the table of what came out: of each controller the runs that completed, and means of its metrics.

    Args:
        stored: The sweep, finished.
        told: Its `facts`.
    """
    columns, rows = headlines(slide_joints(stored.plan.first.plant.model)), []
    for name, law in told["controllers"].items():
        figures = [number(law["means"][key], scale) for key, (_, scale) in columns.items()]
        last = "-" if law["worst_row"] is None else str(law["worst_row"])
        rows.append([name, f"{law['runs']:,}", f"{law['completed']:,}", *figures, last])
    header = ["controller", "runs", "completed", *(title for title, _ in columns.values()), "worst RMSE: run"]
    return f"{stored.plan.first.name}: means of the runs that completed\n\n{table(header, rows)}"


def worst(stored: Stored) -> list[int | None]:
    """Return the row of each controller's worst run, by RMSE; None where none ran.

    Args:
        stored: The sweep, finished.
    """
    count = len(stored.plan.controllers)
    found = {index % count: index for index in worst_rows(stored, Worst(worst=1, by="rmse"))}
    return [found.get(i) for i in range(count)]


def means(stored: Stored, key: str) -> list[float | None]:
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


def facts(stored: Stored, outcomes: Outcomes) -> dict[str, Any]:
    """Return what ``--json`` says of a finished sweep: its size, how its runs ended, and means in SI units.

    Args:
        stored: The sweep, finished.
        outcomes: How its runs ended.
    """
    plan = stored.plan
    last = worst(stored)
    centre = {key: means(stored, key) for key in headlines(())}
    found = {
        name: {
            "runs": plan.pairs,
            "completed": outcomes[name].get(COMPLETED, 0),
            "outcomes": outcomes[name],
            "means": {key: values[i] for key, values in centre.items()},
            "worst_row": last[i],
        }
        for i, name in enumerate(plan.controllers)
    }
    return {"name": plan.first.name, "cases": plan.cases, "draws": plan.draws, "rows": plan.rows, "controllers": found}


def unexpected(stored: Stored, outcomes: Outcomes) -> bool:
    """Name the controllers of which a run ended otherwise than the file expects; return whether there are any.

    Args:
        stored: The sweep.
        outcomes: How its runs ended.
    """
    found = False
    for keys in stored.plan.first.controllers:
        own = outcomes[keys.name]
        completed = own.get(COMPLETED, 0)
        if sum(own.values()) - completed if keys.expect == "completed" else completed:
            kinds = ", ".join(f"{count:,} {kind.lower().replace('_', ' ')}" for kind, count in own.items())
            complain(f"torquebench: controller '{keys.name}': {kinds}; the file expects: {keys.expect}")
            found = True
    return found
