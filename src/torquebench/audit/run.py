"""Running a study: a sweep for each condition, with the controllers that some claim needs there."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.audit.study import FEEDFORWARD, Condition, Study
from torquebench.certificates import FIGURES
from torquebench.experiment.build import build
from torquebench.experiment.conditions import set_keys
from torquebench.experiment.config import check_experiment
from torquebench.experiment.dump import dump_tree
from torquebench.experiment.groups import AUDIT
from torquebench.experiment.schema import Experiment
from torquebench.experiment.source import Document
from torquebench.metrics import METRICS
from torquebench.references import Reference
from torquebench.robot import load_model
from torquebench.robot.flat_model import own_copy
from torquebench.robot.library import ArmFile
from torquebench.sim.interpreted import Call
from torquebench.sweep.executors import Threads
from torquebench.sweep.folder import TABLE, open_sweep, verify
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.repeats import Known
from torquebench.sweep.run import run_sweep
from torquebench.sweep.table import Table, completed, read_table

CONDITIONS = "conditions"
"""Folder of a study's sweeps, one for each condition."""
SAMPLES = 100
"""Instants at which a law is asked for its torque at zero error."""


class Runs:
    """Results of a study: the figures of each controller under each condition, by draw."""

    def __init__(self, experiments: dict[Condition, Experiment], tables: dict[Condition, Table]) -> None:
        self.experiments, self.tables = experiments, tables

    def values(self, figure: str, controller: str, condition: Condition, draws: int) -> list[float | None]:
        """Return a figure of one controller by draw, see `Values`.

        None where the run failed, or never rose or settled on a step; NaN where the figure is not defined, such as a
        certificate of a run in which no joint leaves its layer.

        Args:
            figure: Metric, figure of the certificates, or `FEEDFORWARD`.
            controller: Name of the controller.
            condition: Where it was run.
            draws: How many draws, at most.
        """
        table, experiment = self.tables[condition], self.experiments[condition]
        rows = np.flatnonzero((table["controller"] == controller) & (table["draw"] < draws))
        ended = completed(table, rows)
        if figure == FEEDFORWARD:
            share = feedforward(experiment, controller)
            return [share if own else None for own in ended]
        must = figure in METRICS and METRICS[figure].steps_only and experiment.reference.is_step_like
        return [
            None if not own or (must and math.isnan(x)) else x
            for x, own in zip(table[figure][rows].tolist(), ended, strict=True)
        ]


@dataclass(frozen=True)
class Part:
    """The sweep of one condition."""

    condition: Condition
    words: str
    folder: str
    experiment: Experiment
    text: str
    """Its config, which can be run by itself."""
    arms: Mapping[str, tuple[Path | None, ArmFile]]
    """Arms that the study reads from files, as of a `Document`."""

    @cached_property
    def plan(self) -> Plan:
        """The sweep's rows."""
        arms = tuple((path, arm) for path, (_, arm) in sorted(self.arms.items()))
        return Plan(Source(self.text.encode(), f"{self.folder}/sweep.yaml", arms=arms))


def parts_of(study: Study, draws: int | None = None) -> list[Part]:
    """Return the sweeps that a study needs, in the order of its conditions.

    Args:
        study: The study.
        draws: Draws in place of those of the study.

    Raises:
        ConfigError: a condition makes an experiment with mistakes; all of them, with their places.
    """
    certified = _certified(study)
    parts = list[Part]()
    for condition, (names, most) in study.needs().items():
        document = _document(study, condition, names)
        experiment = check_experiment(document)
        sweep: dict[str, Any] = {"draws": min(most, draws or most) if experiment.is_drawn else 1}
        if condition in certified:
            sweep["certificates"] = True
        slug = re.sub(r"[^a-z0-9]+", "-", study.words(condition).lower()).strip("-")[:60]
        root = json.loads(json.dumps(document.root))
        root["name"] = f"{slug or 'case'}"
        text = dump_tree(root | {"sweep": sweep})
        parts.append(
            Part(condition, study.words(condition), f"{len(parts) + 1:02d}-{slug}", experiment, text, document.arms)
        )
    return parts


def _certified(study: Study) -> set[Condition]:
    """Return the conditions under which a claim needs certificates."""
    found = set[Condition]()
    for question in study.questions:
        for measure in question.claim.measures:
            if measure.figure in FIGURES:
                found |= {*question.conditions, *question.ablated}
                found |= {study.moved(condition, measure.against or {}) for condition in question.conditions}
    return found


def _document(study: Study, condition: Condition, names: Sequence[str]) -> Document:
    """Return the experiment of a condition, with some of the study's controllers, unchecked."""
    document = study.document.copy()
    for (axis, levels), level in zip(study.axes.items(), condition, strict=True):
        set_keys(document, levels[level], study.file, (AUDIT, "conditions", axis, level))
    controllers = document.root["controllers"]
    for i in reversed(range(len(controllers))):
        if controllers[i]["name"] not in names:
            del controllers[i], controllers.places[i]
    return document


def run_parts(
    parts: Sequence[Part],
    folder: Path,
    workers: int,
    progress: Callable[[str, int], None] = lambda what, runs: None,
) -> Runs:
    """Run the sweeps of a study, or what is left of them; those that are finished are verified and read.

    Args:
        parts: The sweeps.
        folder: Where their folders are, or will be.
        workers: How many are run at once, each on a thread.
        progress: Called with what is being run, and with the number of runs done since the last call.

    Raises:
        ResultError: a stored file was altered.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = Known(sum(part.plan.rows * part.experiment.n_steps for part in parts))

    def run(part: Part) -> Table:
        done = 0

        def report(rows: int, _all: int) -> None:
            nonlocal done
            progress(part.words, rows - done)
            done = rows

        stored = run_sweep(part.plan, folder / part.folder, Threads(1, known), progress=report)
        return read_table(stored.folder / TABLE)

    with ThreadPoolExecutor(workers) as pool:
        tables = list(pool.map(run, parts))
    return Runs(
        {part.condition: part.experiment for part in parts},
        {part.condition: table for part, table in zip(parts, tables, strict=True)},
    )


def read_parts(parts: Sequence[Part], folder: Path, plugins: tuple[Path, ...] = ()) -> Runs:
    """Return the results of a study whose sweeps are finished.

    Args:
        parts: The sweeps.
        folder: Where their folders are.
        plugins: Files of laws of one's own.

    Raises:
        ConfigError: a folder is not its sweep's.
        ResultError: one is not finished, or a stored file was altered.
    """
    tables = {}
    for part in parts:
        stored = open_sweep(folder / part.folder, plugins, "RUN", to_read=True)
        verify(stored)
        tables[part.condition] = read_table(stored.folder / TABLE)
    return Runs({part.condition: part.experiment for part in parts}, tables)


def feedforward(experiment: Experiment, controller: str) -> float | None:
    """Return the share of the inverse dynamics that a law supplies at zero error, with an empty memory.

    1 - sum |tau_need - tau|^2 / sum |tau_need|^2, each joint over its torque limit, at instants along the reference
    within the window of metrics: 1 for a law that knows the arm, 0 for one that only reacts to errors. tau_need is the
    inverse dynamics of the arm, without payload; tau what the law commands where q = q_ref and qd = qd_ref.

    Args:
        experiment: What was run.
        controller: Name of the controller.
    """
    loop = build(experiment)
    own = next(c for c in loop.controllers if c.name == controller)
    first = round(experiment.run.metrics_from / experiment.run.control_period)
    instants = np.unique(np.linspace(first, len(loop.reference.q) - 1, SAMPLES).astype(int))
    belief = own_copy(loop.model.flat, control_period=experiment.run.control_period)
    limit = np.asarray(loop.plant.tau_max)
    given = []
    for k in instants:
        ref = Reference(*(x[k].copy() for x in loop.reference))
        t = float(k * experiment.run.control_period)
        law = Call(own.law, own.gains, belief, own.law.new_memory(experiment.n))
        tau, _, detail = law(t, ref.q.copy(), ref.qd.copy(), ref)
        if detail:
            return None
        given.append(np.clip(tau, -limit, limit))
    truth = load_model(experiment.plant.model)
    needed = truth.inverse_dynamics(*(x[instants] for x in loop.reference))
    left = (needed - np.array(given)) / limit
    return float(1.0 - np.sum(left**2) / np.sum((needed / limit) ** 2))
