"""Which constants of the model, and which drawn keys, a law's figures depend on in a sweep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import ConfigError, ResultError
from torquebench.experiment.build import build_belief
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.robot import load_model
from torquebench.robot.flat_model import CLOSED_FORM
from torquebench.robot.puma560.constants import fitted_constants
from torquebench.robot.puma560.puma import puma_files
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.robot.robot_model import RobotModel
from torquebench.sweep.effects import Effects, effects_on, ranked, ranks
from torquebench.sweep.table import (
    Rows,
    Table,
    check_table,
    controllers,
    grid_keys,
    metric_values,
    rows_by,
    varied_keys,
)

MOST_DRAWS = 1000
"""Draws that are looked at: beyond these an effect that is still unseen is too small to matter."""


class Sensitivity(NamedTuple):
    """What one metric of one law depends on."""

    controller: str
    metric: str
    cases: tuple[int, ...]
    """Cases that are taken together: in these the same constants are off alike."""
    draws: int
    """Draws behind it."""
    left_out: int
    """Draws in which a run failed or has no such figure."""
    effects: Effects | None
    """None where nothing can be said."""
    reason: str
    """Why not; empty otherwise."""

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        effects = self.effects
        return self._asdict() | {
            "cases": list(self.cases),
            "effects": None
            if effects is None
            else effects._asdict()
            | {
                "effects": [e._asdict() | {"inputs": list(e.inputs), "matters": e.matters} for e in effects.effects],
                "ranked": ranked(effects.effects),
            },
        }


def constant_changes(experiments: Sequence[Experiment]) -> dict[str, Array]:
    """Draw the constants of the laws' model again and return by how much each is off [1], one for each experiment.

    Where no acceptable model is drawn, and hence nothing was run, all are NaN.

    Args:
        experiments: Experiments of one arm, such as one for each draw.

    Raises:
        ResultError: the arm has no table of constants: only puma560 has.
    """
    rows = []
    for experiment in experiments:
        if experiment.plant.model != "puma560":
            raise ResultError(f"model '{experiment.plant.model}' has no table of constants: only puma560 has")
        keys = experiment.model
        right = _constants(load_model(experiment.plant.model, keys.structure, keys.constants))
        try:
            rows.append(_constants(build_belief(experiment)[0]) / right - 1.0)
        except ConfigError:
            rows.append(np.full(len(CONSTANTS), np.nan))
    return dict(zip(CONSTANTS, np.array(rows).T, strict=True))


def _constants(model: RobotModel) -> Array:
    if model.flat.structure == CLOSED_FORM:
        return model.flat.constants
    return fitted_constants(model.flat, puma_files()[2])


def sensitivities(
    table: Table, experiment_of: Callable[[int, int], Experiment], metrics: Sequence[str], confidence: float = 0.95
) -> list[Sensitivity]:
    """Return what each metric of each law depends on; all intervals of one metric hold together with the confidence.

    Cases in which the constants are off alike, as ranks tell, are taken together: a draw's figure is then the mean of
    its ranks in each. Drawn keys that are numbers count beside the constants.

    Args:
        table: The sweep's table.
        experiment_of: Case and draw -> what was run.
        metrics: Names of metrics.
        confidence: Probability that nothing is found for a metric where there is nothing to find [1].

    Raises:
        ResultError: it is no sweep's table, or of an arm without a table of constants and without drawn keys.
    """
    check_table(table)
    draws = np.unique(table["draw"].to_numpy())[:MOST_DRAWS]
    by_group = rows_by(table, "case", "controller")
    drawn = _drawn_keys(table, draws)
    together = _alike(table, draws, experiment_of, drawn)
    places = [(cases, inputs, law) for cases, inputs in together for law in controllers(table)]
    return [
        _one(
            law,
            metric,
            cases,
            _ranked(table, [by_group[case, law] for case in cases], metric, draws),
            {name: x for name, x in inputs.items() if name not in drawn or _has(table, by_group[cases[0], law], name)},
            confidence,
            len(places),
        )
        for cases, inputs, law in places
        for metric in metrics
    ]


def _has(table: Table, rows: Rows, key: str) -> bool:
    return bool(np.isfinite(table[key].to_numpy()[rows]).any())


def _drawn_keys(table: Table, draws: NDArray[np.int64]) -> dict[str, Array]:
    """Return the drawn keys that are numbers, each with its value in each draw, (D,)."""
    grid = grid_keys(table)
    keys = [key for key in varied_keys(table) if key not in grid and table[key].dtype.kind == "f"]
    columns = {key: table[key].to_numpy() for key in keys}
    return {key: _by_draw(table, np.flatnonzero(np.isfinite(x)), x, draws) for key, x in columns.items()}


def _by_draw(table: Table, rows: Rows, values: Array, draws: NDArray[np.int64]) -> Array:
    """Return the values of some rows in order of their draws, (D,); NaN for a draw without a row."""
    place = np.searchsorted(draws, table["draw"].to_numpy()[rows])
    kept = place < len(draws)
    found = np.full(len(draws), np.nan)
    found[place[kept]] = values[rows[kept]]
    return found


def _alike(
    table: Table, draws: NDArray[np.int64], experiment_of: Callable[[int, int], Experiment], drawn: Mapping[str, Array]
) -> list[tuple[tuple[int, ...], dict[str, Array]]]:
    """Return cases that are taken together, and what varies from draw to draw in the first of them."""
    cache: dict[str, dict[str, Array]] = {}
    groups: dict[bytes, tuple[list[int], dict[str, Array]]] = {}
    for case in np.unique(table["case"].to_numpy()).tolist():
        experiments = [experiment_of(case, draw) for draw in draws.tolist()]
        key = "\n".join(f"{e.plant.model} {e.run.seed} {e.model}" for e in experiments)
        if key not in cache:
            changes = constant_changes(experiments) if any(e.model.mismatch for e in experiments) else {}
            varying = {name: x for name, x in {**changes, **drawn}.items() if _varies(x)}
            cache[key] = varying
        inputs = cache[key]
        if inputs:
            mark = b"".join(name.encode() + ranks(x).tobytes() for name, x in inputs.items())
            groups.setdefault(mark, ([], inputs))[0].append(case)
    return [(tuple(cases), inputs) for cases, inputs in groups.values()]


def _varies(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 0 and bool(np.ptp(known) > 0.0)


def _ranked(table: Table, parts: Sequence[Rows], metric: str, draws: NDArray[np.int64]) -> Array:
    """Return a figure for each draw, (D,): the mean of its ranks in several cases; NaN where it failed in any."""
    values = metric_values(table, np.arange(len(table)), metric)
    found = np.array([_by_draw(table, rows, values, draws) for rows in parts])
    whole = np.isfinite(found).all(axis=0)
    figures = np.full(len(draws), np.nan)
    figures[whole] = np.mean([ranks(own[whole]) for own in found], axis=0)
    return figures


def _one(
    law: str,
    metric: str,
    cases: tuple[int, ...],
    figures: Array,
    inputs: Mapping[str, Array],
    confidence: float,
    outputs: int,
) -> Sensitivity:
    known = np.isfinite(np.array([figures, *inputs.values()])).all(axis=0)
    counts = int(known.sum()), int((~known).sum())
    try:
        found = effects_on(figures[known], {name: x[known] for name, x in inputs.items()}, confidence, outputs)
    except ResultError as error:
        return Sensitivity(law, metric, cases, *counts, None, str(error))
    return Sensitivity(law, metric, cases, *counts, found, "")
