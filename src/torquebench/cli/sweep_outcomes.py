"""What came out of a sweep, for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.cli.terminal import table
from torquebench.experiment.schema import slide_joints
from torquebench.report.tables import headlines, number
from torquebench.sweep.folder import StoredSweep


def summary(stored: StoredSweep, told: Mapping[str, Any]) -> str:
    """Return the table of what came out: of each controller the runs that completed, and means of its metrics.

    Args:
        stored: The sweep, finished.
        told: Its `sweep_facts`.
    """
    columns, rows = headlines(slide_joints(stored.plan.first.plant.model)), []
    for name, law in told["controllers"].items():
        figures = [number(law["means"][key], scale) for key, (_, scale) in columns.items()]
        last = "-" if law["worst_row"] is None else str(law["worst_row"])
        rows.append([name, f"{law['runs']:,}", f"{law['completed']:,}", *figures, last])
    header = ["controller", "runs", "completed", *(title for title, _ in columns.values()), "worst RMSE: run"]
    return f"{stored.plan.first.name}: means of the runs that completed\n\n{table(header, rows)}"
