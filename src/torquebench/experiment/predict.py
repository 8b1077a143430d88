"""Predicts by describing functions, before a run, whether a controller of an experiment shakes."""

from __future__ import annotations

import numpy as np

from torquebench.certificates import Phases
from torquebench.describing import Arm, relay_cycle, square_wave, swings
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
    """Whether the first controller is predicted to shake; None where there is no prediction for law or friction.

    There is one for K sgn(s) and K sat(s/phi), Kd s beside it or not, with or without a model, on joints whose friction
    is a line through zero up to Coulomb's. A joint under K sgn(s) cycles where K is more than its Coulomb friction and
    what gravity asks of it beyond the model; its torque is then a square wave between +-K whose mean is that, of which
    the harmonics above the corner are chattering. The slope is the largest of the joints'.

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
        if not friction.is_line:
            return None
        viscous, coulomb, speed = as_vector(friction.viscous, n), as_vector(friction.coulomb, n), friction.speed
    lam, belief = float(np.max(law.lam)), law.belief
    if law.phi is None:
        cycle = relay_cycle(chain, period, lam, 1.0, float(belief is not None))
        if cycle is None:
            return False
        load = arm.gravity(q) - (0.0 if belief is None else belief.gravity(q))
        heard = law.K * square_wave(load / law.K, cycle.frequency, experiment.chattering_from_hz)
        power = np.mean(np.where(law.K > coulomb + np.abs(load), heard**2, 0.0), axis=0)
        return not is_still(float(np.mean(100.0 * np.sqrt(power) / np.asarray(loop.plant.tau_max))))
    Kd, M = np.zeros(n) if law.Kd is None else law.Kd, arm.mass_matrix(q)
    believed = np.zeros_like(M) if belief is None else belief.mass_matrix(q)
    return swings(Arm(M, viscous, coulomb, speed), chain, period, lam, believed, law.K, law.phi, Kd)
