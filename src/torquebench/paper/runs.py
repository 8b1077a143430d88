"""Running the paper's study: every block on its plants, its draws on all threads, the rest kept as records."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from torquebench.certificates import certify
from torquebench.experiment.build import Loop, build, redrawn
from torquebench.experiment.certify import sliding_law, truth_of
from torquebench.experiment.run import metrics_of, trial_of
from torquebench.experiment.schema import Controller, Experiment
from torquebench.paper.records import METRICS, Record, Records
from torquebench.paper.shares import fuzzy_share
from torquebench.paper.workload import FEW_DRAWS, NOMINAL, PLANTS, UNCERTAIN, Block, blocks, experiment_of
from torquebench.sim.session import SampledTrial
from torquebench.sim.simulate import Workers
from torquebench.sim.trajectory import Trajectory

CERTIFIED = ("conventional", "linear-band", "proposed-l", "proposed-m", "proposed-l-model", "proposed-m-model")
"""Controllers that have certificates under noise and model error on the ideal chain."""


class Apart(NamedTuple):
    """How far two runs are from one another."""

    position: float
    """Largest difference of a position [rad]; infinite when the runs do not end alike."""
    torques: int
    """Commanded torques that differ by more than a millionth of the joint's largest: 0 where both switch alike."""


@dataclass(slots=True)
class Study:
    """What came out."""

    records: Records
    kept: dict[tuple[str, str, str], tuple[Experiment, Loop, Trajectory]] = field(default_factory=dict)
    """Nominal runs on the ideal chain and the first uncertain draw of Fig 11, for the figures, by (config, condition,
    controller)."""
    apart: dict[tuple[str, str, str, str], Apart] = field(default_factory=dict)
    """How far the two plants' first draws are from one another, by (config, chain, condition, controller)."""
    redraws: int = 0
    """Rejected draws of the model's mismatch."""


def steps_of(draws: int) -> int:
    """Return the number of control instants of the whole study."""
    return sum(
        len(block.controllers) * sum(map(block.draws_on, PLANTS)) * experiment_of(block).n_steps
        for block in blocks(draws)
    )


def run_study(draws: int, workers: int, progress: Callable[[str, int], None] | None = None) -> Study:
    """Run everything.

    Args:
        draws: Draws of model error and noise behind each interval.
        workers: Threads.
        progress: Called with what has been run and its number of control instants.
    """
    found: list[Record] = []
    study = Study(Records(()))
    for block in blocks(draws):
        first: dict[str, Trajectory] = {}
        for plant in PLANTS:
            experiment = experiment_of(block, plant)
            loop = build(experiment)
            study.redraws += loop.redraws
            with Workers(loop.plant, workers) as own:
                for keys, draw, at, run in draws_of(own, experiment, loop, block.draws_on(plant)):
                    found.append(_record(block, keys, draw, plant, at, run))
                    name = keys.name
                    if draw == 0 and plant == "mujoco" and block.chain == "ideal":
                        study.kept[block.config, block.condition, name] = *at, run
                    if plant == "mujoco":
                        first[name] = run
                    elif draw == 0:
                        study.apart[block.config, block.chain, block.condition, name] = distance(first[name], run)
                    if progress is not None:
                        progress(f"{block.config}, {block.chain}, {block.condition}", experiment.n_steps)
    study.records = Records(found)
    return study


def distance(a: Trajectory, b: Trajectory) -> Apart:
    """Compare two runs of the same controller."""
    if a.outcome is not b.outcome or len(a.t) != len(b.t):
        return Apart(float("inf"), a.tau.size)
    differ = np.abs(a.tau - b.tau) > 1e-6 * np.max(np.abs(a.tau), axis=0)
    return Apart(float(np.max(np.abs(a.q - b.q))), int(np.sum(differ)))


def draws_of(
    own: Workers, experiment: Experiment, loop: Loop, draws: int
) -> Iterator[tuple[Controller, int, tuple[Experiment, Loop], Trajectory]]:
    """Run every controller of an experiment in each draw; yield controller, draw, what was run, and the run.

    Args:
        own: Threads with the experiment's plant.
        experiment: The experiment, whose own draw does not count.
        loop: Its objects.
        draws: Number of draws, counted from 0.
    """
    order: deque[tuple[Controller, int, tuple[Experiment, Loop]]] = deque()

    def trials() -> Iterator[SampledTrial]:
        for draw in range(draws):
            here = replace(experiment, run=replace(experiment.run, draw=draw))
            there = redrawn(here, loop)
            for keys, controller in zip(here.controllers, there.controllers, strict=True):
                order.append((keys, draw, (here, there)))
                yield trial_of(here, there, controller)

    for run in own.simulate(trials()):
        yield *order.popleft(), run


def _record(
    block: Block, keys: Controller, draw: int, plant: str, at: tuple[Experiment, Loop], run: Trajectory
) -> Record:
    experiment, loop = at
    values: dict[str, float | None] = {}
    if run.completed:
        metrics = metrics_of(experiment, loop, keys, run)
        values = {key: metrics[key].value for key in METRICS}
        drawn = block.condition == UNCERTAIN and block.chain == "ideal"
        judged = plant == ("mujoco" if block.draws == 1 else "analytic")  # the runs that verdicts rest on: see Records
        if judged and draw < FEW_DRAWS and (block.condition == NOMINAL or (drawn and keys.name in CERTIFIED)):
            values |= _stability(experiment, loop, keys, run)
        if judged and drawn and experiment.reference.kind == "sine" and keys.name in ("proposed-l", "proposed-m"):
            values |= fuzzy_share(experiment, loop, keys, run)
    return Record(
        experiment.reference.kind, block.chain, block.condition, keys.name, draw, plant, run.outcome.name, values
    )


def _stability(experiment: Experiment, loop: Loop, keys: Controller, run: Trajectory) -> dict[str, Any]:
    law = sliding_law(keys, loop, experiment.n)
    if law is None:
        return {}
    found = certify(run, truth_of(experiment), law, experiment.run.control_period)
    facts = found.to_json()
    return {"eta": found.least_eta, "outside": facts["share_outside"], "rising": facts["share_rising_outside"]}
