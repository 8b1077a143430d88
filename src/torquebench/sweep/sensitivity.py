"""Finds the constants of the model and the drawn keys on which a law's figures depend in a sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

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
from torquebench.sweep.table import Table, check_table, controllers, grid_keys, metric_values, rows_by, varied_keys

MOST_DRAWS = 1000
"""Draws that are looked at: beyond these an effect that is still unseen is too small to matter."""


class Sensitivity(NamedTuple):
    """Effects of constants and drawn keys on one metric of one law."""

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
        table: The sweep's table, its rows in the order in which a sweep writes them.
        experiment_of: Case and draw -> what was run.
        metrics: Names of metrics.
        confidence: Probability that nothing is found for a metric where there is nothing to find [1].

    Raises:
        ResultError: it is no sweep's table, or of an arm without a table of constants and without drawn keys.
    """
    check_table(table)
    rows = {place: own[:MOST_DRAWS] for place, own in rows_by(table, "case", "controller").items()}
    grid, draws = grid_keys(table), np.unique(table["draw"])[:MOST_DRAWS].tolist()
    drawn = [key for key in varied_keys(table) if key not in grid and table[key].dtype.kind == "f"]
    together = _alike(np.unique(table["case"]).tolist(), draws, experiment_of)
    places = [(*alike, law) for alike in together if alike[1] or drawn for law in controllers(table)]
    found = []
    for cases, changes, law in places:
        own = {key: table[key][rows[cases[0], law]] for key in drawn}
        inputs = changes | {key: values for key, values in own.items() if np.isfinite(values).any()}
        for metric in metrics:
            figures = _ranked([metric_values(table, rows[case, law], metric) for case in cases])
            known = np.isfinite(np.array([figures, *inputs.values()])).all(axis=0)
            effects, reason = None, ""
            try:
                samples = {key: values[known] for key, values in inputs.items()}
                effects = effects_on(figures[known], samples, confidence, len(places))
            except ResultError as error:
                reason = str(error)
            found.append(Sensitivity(law, metric, cases, int(known.sum()), int((~known).sum()), effects, reason))
    return found


def _alike(
    cases: Sequence[int], draws: Sequence[int], experiment_of: Callable[[int, int], Experiment]
) -> list[tuple[tuple[int, ...], dict[str, Array]]]:
    """Return cases whose constants are off alike, and the changes of those that vary in the first of them."""
    cache: dict[str, dict[str, Array]] = {}
    groups: dict[bytes, tuple[list[int], dict[str, Array]]] = {}
    for case in cases:
        experiments = [experiment_of(case, draw) for draw in draws]
        key = "\n".join(f"{e.plant.model} {e.run.seed} {e.model}" for e in experiments)
        if key not in cache:
            changes = constant_changes(experiments) if any(e.model.mismatch for e in experiments) else {}
            cache[key] = {name: x for name, x in changes.items() if np.unique(x[np.isfinite(x)]).size > 1}
        mark = b"".join(name.encode() + ranks(x).tobytes() for name, x in cache[key].items())
        groups.setdefault(mark, ([], cache[key]))[0].append(case)
    return [(tuple(alike), changes) for alike, changes in groups.values()]


def _ranked(found: Sequence[Array]) -> Array:
    """Return the mean of each draw's ranks in several cases, (D,); NaN where it has no figure in one of them."""
    values = np.array(found)
    whole = np.all(np.isfinite(values), axis=0)
    figures = np.full(values.shape[1], np.nan)
    figures[whole] = np.mean(ranks(values[:, whole]), axis=0)
    return figures
