"""Whether describing functions predict that a controller of an experiment shakes, before it is run."""

from __future__ import annotations

import numpy as np

from torquebench.certificates import Phases
from torquebench.describing import Arm, relay_cycle, swings
from torquebench.experiment import schema
from torquebench.experiment.build import Loop
from torquebench.experiment.certify import sliding_law
from torquebench.keys import as_vector
from torquebench.laws import find_law
from torquebench.metrics.shaking import is_still
from torquebench.robot import RobotModel

POSES = 3
"""Poses along the motion at which the arm is looked at, most, from the time on from which chattering is counted."""


def predicted_to_shake(experiment: schema.Experiment, loop: Loop, truth: RobotModel | Phases) -> bool | None:
    """Whether the first controller is predicted to shake; None where there is no prediction for its law.

    There is one for K sgn(s) and K sat(s/phi), Kd s beside it or not, with or without a model, which counts as right.
    A joint under K sgn(s) cycles unless its Coulomb friction is more than K; its torque is then a square wave of +-K,
    of which the harmonics above the corner are chattering. The slope is the largest of the joints'.

    Args:
        experiment: The experiment.
        loop: Its objects.
        truth: The true arm.
    """
    keys, n, period, chain = experiment.controllers[0], experiment.n, experiment.run.control_period, experiment.chain
    law = None if find_law(keys.law).rules else sliding_law(keys, loop, n)
    if law is None:
        return None
    arm, friction = truth.later if isinstance(truth, Phases) else truth, experiment.plant.acting
    counted = loop.reference.q[min(round(experiment.run.metrics_from / period), experiment.n_steps - 1) :]
    q = np.unique(counted[:: -(-len(counted) // POSES)], axis=0)
    viscous, coulomb, speed = np.zeros(n), np.zeros(n), 1.0
    if friction is not None:
        viscous, coulomb, speed = as_vector(friction.viscous, n), as_vector(friction.coulomb, n), friction.speed
    model, lam = float(law.belief is not None), float(np.max(law.lam))
    if law.phi is None:
        cycle = relay_cycle(chain, period, lam, 1.0, model)
        if cycle is None:
            return False
        odd = np.arange(1.0, 100.0, 2.0)
        heard = odd[odd * cycle.frequency >= experiment.chattering_from_hz]
        square = np.sqrt(8.0 * np.sum(1.0 / heard**2)) / np.pi
        shares = np.where(law.K > coulomb, law.K / np.asarray(loop.plant.tau_max), 0.0)
        return not is_still(100.0 * float(square * np.mean(shares)))
    Kd = np.zeros(n) if law.Kd is None else law.Kd
    at_rest = Arm(arm.mass_matrix(q), viscous, coulomb, speed)
    return swings(at_rest, chain, period, lam, model, law.K, law.phi, Kd)
