"""Closed loops on signals that a test has made itself, instead of drawn ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from torquebench.kernel import Array
from torquebench.references import Reference, ReferenceSource
from torquebench.robot import RobotModel
from torquebench.sim.plants import Plant, substeps_per_period
from torquebench.sim.session import Controller, PathName, SampledTrial, Session
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Trajectory


def sampled_trial(
    controller: Controller,
    model: RobotModel,
    reference: ReferenceSource | Reference,
    duration: float,
    control_period: float = 0.001,
    **signals: Any,
) -> SampledTrial:
    """Return a trial whose motion is sampled for a duration [s]; `signals` and the chain as of `SampledTrial`."""
    n_steps = substeps_per_period(duration, control_period, ("duration", "control_period"))
    t = control_instants(n_steps, control_period)
    desired = reference if isinstance(reference, Reference) else reference(t)
    return SampledTrial(controller, model, desired, control_period, **signals)


def simulate_sampled(
    plant: Plant,
    controller: Controller,
    model: RobotModel,
    reference: ReferenceSource | Reference,
    *,
    path: PathName = "auto",
    throw: bool = True,
    progress: Any = None,
    **options: Any,
) -> Trajectory:
    """Run one closed loop as `simulate` does, with the arrays of `SampledTrial` in place of what is drawn."""
    trial = sampled_trial(controller, model, reference, **options)
    trajectory = Session().run(plant, trial, path, progress)
    assert trajectory.completed or not throw, trajectory.detail
    return trajectory


class Torque:
    """A disturbance whose samples a test has made itself.

    Args:
        samples: Torque at each control instant, (N, n) [N m].
    """

    def __init__(self, samples: Array) -> None:
        self.samples = samples

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the samples."""
        return self.samples
