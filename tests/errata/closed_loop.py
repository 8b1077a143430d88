"""What a misprint does to a controller: computed torque on the exact arm, with one equation of its model literal."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

import torquebench.laws.computed_torque  # noqa: F401  registers the law
from torquebench.kernel import Array
from torquebench.laws.law import find_law
from torquebench.references import sine
from torquebench.robot.flat_model import scratch_for
from torquebench.robot.puma560.puma import Puma560
from torquebench.robot.puma560.symbols import MISPRINTED
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate

GAINS = {"lam": 10.0, "kv": 20.0, "ki": 0.0}
DURATION = 4.0
WINDOW = 1000
"""First sample of the window in which the error is averaged: t >= 1 s."""
REFERENCE = sine(np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0]), np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0]))


def belief(literal: tuple[str, ...], constants: str = "fitted") -> RobotModel:
    """The corrected model with the equations `literal` taken as printed."""
    model = Puma560("corrected", constants)  # type: ignore[arg-type]
    flags = np.array([int(number in literal) for number in MISPRINTED])
    flat = replace(model.flat, literal=flags, scratch=scratch_for(6))
    return RobotModel("belief", model.joint_names, flat)


class Effect(NamedTuple):
    """What a belief does, compared with the corrected one."""

    mass: float
    """Largest change of A(q_ref) qdd_ref along the reference [N m]."""
    bias: float
    """Largest change of N(q_ref, qd_ref) along the reference [N m]."""
    joint: int
    """Joint whose torque A qdd + N changes most, from 1; 0 if none does."""
    rms: float
    """Rms tracking error, all joints, t >= 1 s [rad]."""
    shift: float
    """Largest distance of a joint from where it is with the corrected belief [rad]."""


@cache
def positions(literal: tuple[str, ...], constants: str = "fitted", structure: str = "corrected") -> tuple[Array, Array]:
    """Joint positions of one run, (4000, 6), and its tracking error [rad]."""
    model = Puma560() if structure == "exact" else belief(literal, constants)
    law = find_law("computed-torque")
    controller = Controller("computed-torque", law, law.pack_gains(6, GAINS, {}))
    run = simulate(AnalyticPlant(Puma560()), controller, model, REFERENCE, duration=DURATION)
    return run.q, run.q_ref - run.q


@cache
def effect(literal: tuple[str, ...], constants: str = "fitted", structure: str = "corrected") -> Effect:
    """Run the belief and compare it with the corrected one."""
    model, base = Puma560() if structure == "exact" else belief(literal, constants), belief(())
    q, qd, qdd = REFERENCE(0.001 * np.arange(round(DURATION / 0.001)))
    bias = model.bias_forces(q, qd) - base.bias_forces(q, qd)
    both = model.inverse_dynamics(q, qd, qdd) - base.inverse_dynamics(q, qd, qdd)
    peaks = np.abs(both).max(axis=0)
    path, error = positions(literal, constants, structure)
    return Effect(
        float(np.abs(both - bias).max()),
        float(np.abs(bias).max()),
        int(peaks.argmax()) + 1 if peaks.max() > 1e-9 else 0,
        float(np.sqrt(np.mean(error[WINDOW:] ** 2))),
        float(np.abs(path - positions(())[0]).max()),
    )
