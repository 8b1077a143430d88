"""Certificates of an experiment's controllers: before the run the gain each needs, after it what its run shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from torquebench.certificates import Certificate, Phases, SlidingLaw, certify, required_gain
from torquebench.experiment import schema
from torquebench.experiment.build import Loop, plant_factors
from torquebench.experiment.controllers import Controller
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.laws import find_law
from torquebench.robot import RobotModel
from torquebench.robot.flat_model import SLIDE
from torquebench.robot.payload import phases
from torquebench.sim.trajectory import Trajectory
from torquebench.timing import whole_steps


@dataclass(frozen=True, slots=True)
class Flag:
    """A controller whose switching gain is too small for its own reaching condition along its reference."""

    controller: str
    joint: str
    """The joint that lacks most, as a fraction of its torque limit."""
    gain: float
    """K there [`unit`]."""
    needed: float
    """Least K that suffices there [`unit`]."""
    k_needed: float
    """Least k = K/tau_max that suffices on every joint [1]."""
    unit: str = "N m"
    """N for a joint that slides."""

    def __str__(self) -> str:
        return (
            f"controller '{self.controller}' cannot meet its reaching condition (123) on its reference: "
            f"{self.joint} needs K > {self.needed:.4g} {self.unit}, has {self.gain:.4g}; "
            f"k > {self.k_needed:.3g} would do for all joints"
        )


def truth_of(experiment: schema.Experiment) -> RobotModel | Phases:
    """Return the analytic twin of an experiment's plant, its perturbation and its payload included."""
    plant, factors = experiment.plant, plant_factors(experiment)
    model, payload = plant.twin(factors), plant.load
    first, later = phases(model, payload)
    if payload is None or later is None:
        return first
    return Phases(first, later, whole_steps(payload.at, experiment.run.control_period))


def resistance(experiment: schema.Experiment, qd: Array) -> Array:
    """Return the torque of an experiment's friction at joint velocities (N, n) [rad/s], as it acts, (N, n) [N m]."""
    friction, n = experiment.plant.friction, experiment.n
    if friction is None:
        return np.zeros_like(qd)
    rising = np.clip(qd / friction.speed, -1.0, 1.0)
    return -(as_vector(friction.viscous, n) * qd + as_vector(friction.coulomb, n) * rising)


def sliding_law(keys: Controller, loop: Loop, n: int) -> SlidingLaw | None:
    """Return what a controller's certificates need, or None where they are not defined for its law.

    They are for laws with a slope ``lam`` [1/s], a switching gain ``k`` over the torque limit [1] that acts, and the
    surface s = de + lambda e, whose equivalent control, if any, is the model's without the measured acceleration. Gains
    of these names in other units are something else.
    """
    law = find_law(keys.law)
    units = {name: law.gains[name].unit for name in ("lam", "k") if name in law.gains}
    if units != {"lam": "1/s", "k": "1"}:
        return None
    options = {name: keys.options.get(name, option.values[0]) for name, option in law.options.items()}
    if options.get("surface", "pd") != "pd" or not law.gains["k"].acts(options):
        return None
    if options.get("equivalent_control") == "measured-acceleration":
        return None
    phi = keys.gains.get("phi")
    return SlidingLaw(
        as_vector(keys.gains["lam"], n),
        as_vector(keys.gains["k"], n) * np.asarray(loop.plant.tau_max),
        None if phi is None else as_vector(phi, n),
        loop.model if options.get("equivalent_control") else None,
    )


def flags(experiment: schema.Experiment, loop: Loop) -> tuple[Flag, ...]:
    """Return the controllers that cannot meet their reaching condition, before anything is run."""
    truth, found = truth_of(experiment), []
    acting = resistance(experiment, loop.reference.qd) + (0.0 if loop.disturbance is None else loop.disturbance)
    for keys in experiment.controllers:
        law = sliding_law(keys, loop, experiment.n)
        if law is None:
            continue
        needed = required_gain(truth, law, *loop.reference, acting)
        if np.any(needed >= law.K):
            worst = int(np.argmax((needed - law.K) / np.asarray(loop.plant.tau_max)))
            k_needed = float(np.max(needed / np.asarray(loop.plant.tau_max)))
            unit = "N" if loop.model.flat.kind[worst] == SLIDE else "N m"
            gain, least = float(law.K[worst]), float(needed[worst])
            found.append(Flag(keys.name, loop.joint_names[worst], gain, least, k_needed, unit))
    return tuple(found)


def certificate_of(
    experiment: schema.Experiment,
    loop: Loop,
    keys: Controller,
    run: Trajectory,
    truth: RobotModel | Phases | None = None,
) -> Certificate | None:
    """Return the certificate of one run; None where it did not complete, or its law has none.

    Args:
        experiment: What was run.
        loop: Its objects.
        keys: The controller.
        run: Its run.
        truth: The arm, where it is at hand; see `truth_of`.
    """
    law = sliding_law(keys, loop, experiment.n)
    if law is None or not run.completed:
        return None
    return certify(run, truth or truth_of(experiment), law, experiment.run.control_period)


def certificates(experiment: schema.Experiment, loop: Loop, runs: Mapping[str, Trajectory]) -> dict[str, Certificate]:
    """Return the certificates of every completed run of a law that has them."""
    truth = truth_of(experiment)
    found = {
        keys.name: certificate_of(experiment, loop, keys, runs[keys.name], truth) for keys in experiment.controllers
    }
    return {name: certificate for name, certificate in found.items() if certificate is not None}
