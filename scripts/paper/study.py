"""Running the study: a sweep of each block on each plant, and a second look at the runs that need their trajectory."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from paper.runs_table import JUDGED, Runs
from paper.shares import fuzzy_share
from paper.workload import FEW_DRAWS, NOMINAL, PLANTS, UNCERTAIN, Block, blocks, plan_of
from torquebench.certificates import certify
from torquebench.experiment.certify import sliding_law, truth_of
from torquebench.experiment.run import ExperimentResult, run_experiment
from torquebench.sim.trajectory import Trajectory
from torquebench.sweep.executors import Threads
from torquebench.sweep.folder import TABLE
from torquebench.sweep.plan import Plan
from torquebench.sweep.run import run_sweep
from torquebench.sweep.table import read_table

CERTIFIED = ("conventional", "linear-band", "proposed-l", "proposed-m", "proposed-l-model", "proposed-m-model")
"""Controllers that have certificates under noise and model error on the ideal chain."""


Kept: TypeAlias = tuple[str, str, str]
"""Config, condition, controller."""
Placed: TypeAlias = tuple[str, str, str, str]
"""Config, chain, condition, controller."""


class Apart(NamedTuple):
    """How far two runs are from one another."""

    position: float
    """Largest difference of a position [rad]; infinite when the runs do not end alike."""
    torques: int
    """Commanded torques that differ by more than a millionth of the joint's largest: 0 where both switch alike."""


class Study(NamedTuple):
    """What came out."""

    runs: Runs
    kept: Mapping[Kept, ExperimentResult]
    """First draw of each run on the ideal chain on MuJoCo, for the figures, by (config, condition, controller)."""
    apart: Mapping[Placed, Apart]
    """How far the two plants' first draws are from one another, by (config, chain, condition, controller)."""
    redraws: int
    """Rejected draws of the model's mismatch, in first draws."""


def count_runs(draws: int) -> int:
    """Return the number of runs of the whole study."""
    return sum(len(block.controllers) * len(block.chains) * sum(map(block.draws_on, PLANTS)) for block in blocks(draws))


def run_study(draws: int, workers: int, progress: Callable[[str, int], None] = lambda what, runs: None) -> Study:
    """Run everything.

    Args:
        draws: Draws of model error and noise behind each interval.
        workers: Threads.
        progress: Called with what is being run, and with how many runs are done since the last call.
    """
    tables, kept, apart, redraws = list[pd.DataFrame](), dict[Kept, ExperimentResult](), dict[Placed, Apart](), 0
    for block in blocks(draws):
        first: dict[tuple[str, str], Trajectory] = {}
        for plant in PLANTS:
            plan, what = plan_of(block, plant), f"{block.config}, {block.condition}"
            table = _sweep(plan, workers, functools.partial(progress, what))
            table["reference"], table["condition"], table["plant"] = plan.first.reference.kind, block.condition, plant
            judged = plant == ("mujoco" if block.draws == 1 else "analytic")  # what verdicts rest on: see `Runs`
            for key in JUDGED:
                table[key] = np.nan
            rows = [
                (index, chain, draw, name)
                for index, chain, draw, name in table[["index", "chain", "draw", "controller"]].itertuples(index=False)
                if draw == 0 or (judged and (is_certified(block, chain, draw, name) or has_share(block, chain, name)))
            ]
            for (index, chain, draw, name), result in zip(rows, _again(plan, rows, workers), strict=True):
                for key, value in (_examine(block, chain, draw, result) if judged else {}).items():
                    table.loc[index, key] = value
                if draw > 0:
                    continue
                run = result.runs[name]
                if plant == "mujoco":
                    first[chain, name] = run
                    if chain == "ideal":
                        kept[block.config, block.condition, name] = result
                else:
                    apart[block.config, chain, block.condition, name] = distance(first[chain, name], run)
                redraws += result.loop.redraws if name == plan.controllers[0] else 0
            tables.append(table)
    return Study(Runs(pd.concat(tables, ignore_index=True)), kept, apart, redraws)


def _again(plan: Plan, rows: Sequence[tuple[Any, ...]], workers: int) -> Iterator[ExperimentResult]:
    """Run some rows of a sweep again, for their trajectories; the first entry of each is its index."""
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda row: run_experiment(plan.experiment_of(plan.row(row[0]))), rows)


def _sweep(plan: Plan, workers: int, progress: Callable[[int], None]) -> pd.DataFrame:
    """Run a sweep and return its table; `progress` is called with the number of runs done since the last call."""
    done = 0

    def report(rows: int, _all: int) -> None:
        nonlocal done
        progress(rows - done)
        done = rows

    with tempfile.TemporaryDirectory(prefix="torquebench-paper-") as folder:
        stored = run_sweep(plan, Path(folder) / "sweep", Threads(workers), progress=report)
        return pd.DataFrame(read_table(stored.folder / TABLE))


def is_certified(block: Block, chain: str, draw: int, name: str) -> bool:
    """Return whether claims need the certificate of a run."""
    drawn = block.condition == UNCERTAIN and chain == "ideal"
    return draw < FEW_DRAWS and (block.condition == NOMINAL or (drawn and name in CERTIFIED))


def has_share(block: Block, chain: str, name: str) -> bool:
    """Return whether claims need the share of the dynamics that the fuzzy part of a run supplies."""
    proposed = name in ("proposed-l", "proposed-m")
    return proposed and block.config == "fig11-noise" and (block.condition, chain) == (UNCERTAIN, "ideal")


def _examine(block: Block, chain: str, draw: int, result: ExperimentResult) -> dict[str, float | None]:
    """Return the figures of a run's certificate and of its fuzzy part, where claims need them."""
    (keys,) = result.experiment.controllers
    run, figures = result.runs[keys.name], dict[str, float | None]()
    law = sliding_law(keys, result.loop, result.experiment.n)
    if run.completed and law is not None and is_certified(block, chain, draw, keys.name):
        found = certify(run, truth_of(result.experiment), law, result.experiment.run.control_period)
        facts = found.to_json()
        figures |= {
            "eta": found.least_eta,
            "outside": facts["share_outside"],
            "rising": facts["share_rising_outside"],
        }
    if run.completed and has_share(block, chain, keys.name):
        figures |= fuzzy_share(result.experiment, result.loop, keys, run)
    return figures


def distance(a: Trajectory, b: Trajectory) -> Apart:
    """Compare two runs of the same controller."""
    if a.outcome is not b.outcome or len(a.t) != len(b.t):
        return Apart(float("inf"), a.tau.size)
    differ = np.abs(a.tau - b.tau) > 1e-6 * np.max(np.abs(a.tau), axis=0)
    return Apart(float(np.max(np.abs(a.q - b.q))), int(np.sum(differ)))
