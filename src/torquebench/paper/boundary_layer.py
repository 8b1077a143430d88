"""The boundary-layer study: error against chattering over a grid of phi, K and lambda, and the front of the best."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.run import metrics_of
from torquebench.experiment.schema import Controller, Experiment
from torquebench.paper.runs import draws_of
from torquebench.robot.library import data_root
from torquebench.sim.simulate import Workers
from torquebench.statistics import Ratio, geometric_mean, undominated

PHI = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Half-widths of the band [rad/s]; 0 is sgn(s)."""
K = (0.1, 0.2, 0.3, 0.6)
"""Switching gains, fractions of the torque limit [1]."""
LAM = (10.0, 20.0)
"""Slopes [1/s]."""


class Point(NamedTuple):
    """One choice of gains and what it gives, geometric means over draws with 95 % intervals."""

    phi: float
    k: float
    lam: float
    rmse: Ratio
    """RMS error [rad]."""
    hf: Ratio
    """Chattering index [% of the torque limit]."""

    @property
    def failed(self) -> int:
        """Draws in which the run did not complete."""
        return self.rmse.failed[0]


def grid() -> tuple[Experiment, list[tuple[float, float, float]]]:
    """Return the experiment with a controller for each (phi, k, lambda), and these."""
    experiment = load_experiment(data_root() / "configs" / "paper" / "boundary-layer.yaml")
    (band,) = experiment.controllers
    choices = list(itertools.product(PHI, K, LAM))
    controllers = []
    for index, (phi, k, lam) in enumerate(choices):
        gains: dict[str, float | tuple[float, ...]] = {"lam": lam, "k": k}
        if phi > 0.0:
            gains["phi"] = phi
        options = band.options | {"switching": "saturation" if phi > 0.0 else "sign"}
        controllers.append(Controller(name=f"p{index}", law=band.law, options=options, gains=gains))
    return replace(experiment, controllers=tuple(controllers)), choices


def study(draws: int, workers: int, progress: Callable[[str, int], None] | None = None) -> list[Point]:
    """Run the grid.

    Args:
        draws: Draws of model error and noise for each point.
        workers: Threads.
        progress: Called with what has been run and its number of control instants.

    Raises:
        ResultError: a point has no completed run.
    """
    experiment, choices = grid()
    loop = build(experiment)
    errors: dict[str, list[float | None]] = {keys.name: [] for keys in experiment.controllers}
    chattering: dict[str, list[float | None]] = {keys.name: [] for keys in experiment.controllers}
    with Workers(loop.plant, workers) as own:
        for keys, _, (here, there), run in draws_of(own, experiment, loop, draws):
            metrics = metrics_of(here, there, keys, run) if run.completed else None
            errors[keys.name].append(None if metrics is None else metrics.rmse.value)
            chattering[keys.name].append(None if metrics is None else metrics.hf.value)
            if progress is not None:
                progress(f"phi, k, lambda = {choices[int(keys.name[1:])]}", experiment.n_steps)
    found = []
    for (phi, k, lam), name in zip(choices, errors, strict=True):
        if all(value is None for value in errors[name]):
            raise ResultError(f"no run completed at phi = {phi:g}, k = {k:g}, lambda = {lam:g}")
        found.append(Point(phi, k, lam, geometric_mean(errors[name]), geometric_mean(chattering[name])))
    return found


def front(points: Sequence[Point]) -> list[Point]:
    """Return the points that no other one beats in both error and chattering, by chattering; failures disqualify."""
    whole = [p for p in points if p.failed == 0]
    best = undominated([(p.rmse.ratio, p.hf.ratio) for p in whole])
    return sorted((whole[index] for index in best), key=lambda p: p.hf.ratio)
