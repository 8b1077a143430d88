"""Certificates of an experiment's controllers: before the run the gain each needs, after it what its run shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from torquebench.certificates import UNSTABLE, Certificate, Phases, SlidingLaw, certify, held_to, required_gain
from torquebench.experiment import schema
from torquebench.experiment.arm import also, planned_range, planned_speed
from torquebench.experiment.build import Loop, plant_factors
from torquebench.experiment.controllers import Controller
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.laws import Law, find_law
from torquebench.references import Reference
from torquebench.robot import RobotModel
from torquebench.robot.flat_model import SLIDE, force_unit
from torquebench.robot.joint_facts import ROUNDED, holding, without_rotor
from torquebench.robot.payload import phases
from torquebench.sim.friction import steady
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Trajectory
from torquebench.timing import whole_steps
from torquebench.tuning import rate

LOADED = 20
"""Rounds after which friction under its own load is known to load^20 of it."""
POSES = 100
"""Poses along the motion at which the arm's inertia is looked at."""
TINY = 1e-300
INSTANTS = 2000
"""Instants of a reference at which its torque is looked at."""
TOO_MUCH = "the reference needs more torque than the arm has"
"""Beginning of the remark on it; a stored run has it as text."""
SMALL = 0.005
"""Share of a torque below which one of its parts is not told [1]."""


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

    @property
    def cause(self) -> str:
        """Cause to name where the run goes wrong, in words."""
        return f"K = {self.gain:.4g} {self.unit} of {self.joint} is below what its motion needs, {self.needed:.4g}"

    def __str__(self) -> str:
        return (
            f"controller '{self.controller}' cannot meet its reaching condition (123) on its reference: "
            f"{self.joint} needs K > {self.needed:.4g} {self.unit}, has {self.gain:.4g}; "
            f"k > {self.k_needed:.3g} would do for all joints"
        )


@dataclass(frozen=True, slots=True)
class Coarse:
    """A controller whose switching gain moves s farther in one control period than s can be held to."""

    controller: str
    joint: str
    """The joint that exceeds most."""
    gain: float
    """K there [`unit`]."""
    period: float
    """Control period [s]."""
    step: float
    """Amount by which K moves s in it [rad/s]."""
    most: float
    """The most that it may [rad/s]."""
    has_layer: bool
    """Whether the limit is that of the layer, instead of a tenth of the joint's motion."""
    share: float
    """Largest share of k that does on every joint, and of the control period [1]; 0 where kv alone is too much."""
    k_most: float
    """Largest k = K/tau_max that does on every joint [1]."""
    unit: str = "N m"
    """N for a joint that slides."""

    @property
    def cause(self) -> str:
        """Cause to name where the run goes wrong, in words."""
        thin = "its layer is thinner than a step of travel: " if self.has_layer else "K is too large for the period: "
        speed = "m/s" if self.unit == "N" else "rad/s"
        return f"{thin}K moves s of {self.joint} by {self.step:.3g} {speed} in one, {self.most:.3g} can be held"

    def __str__(self) -> str:
        speed = "m/s" if self.unit == "N" else "rad/s"
        end = "comes to rest in its layer" if self.has_layer else "errs by less than a tenth of its motion"
        cure = f"k <= {self.k_most:.3g} would do for all joints, or a period of {self.share * self.period:.2g} s"
        return (
            f"controller '{self.controller}' cannot hold s at its control period: in {1e3 * self.period:.4g} ms "
            f"K = {self.gain:.4g} {self.unit} moves s of {self.joint} by {self.step:.3g} {speed}, and it {end} only up "
            f"to {self.most:.3g}; {cure if self.share else 'no k would do: the rate gain kv alone is too large'}"
        )


@dataclass(frozen=True, slots=True)
class Overdriven:
    """A controller whose rate gain alone makes s grow from one control period to the next."""

    controller: str
    joint: str
    """The joint that moves most in the motion that grows."""
    gain: float
    """Kd there [`unit`]."""
    period: float
    """Control period [s]."""
    times: float
    """Amount by which Kd moves s in it, as a multiple of s: period x rho(M^-1 Kd) [1]."""
    unit: str = "N m s/rad"
    """N s/m for a joint that slides."""

    @property
    def cause(self) -> str:
        """Cause to name where the run goes wrong, in words."""
        return f"Kd moves s of {self.joint} by {self.times:.3g} s in a control period, and s grows from {UNSTABLE:g} on"

    def __str__(self) -> str:
        return (
            f"controller '{self.controller}' is unstable at its control period: in {1e3 * self.period:.4g} ms its rate "
            f"gain, Kd = {self.gain:.4g} {self.unit} of {self.joint}, moves s by {self.times:.3g} s, and s grows from "
            f"{UNSTABLE:g} on; {1.0 / self.times:.2g} kv would do without ringing, and so would gains: auto"
        )


def truth_of(experiment: schema.Experiment) -> RobotModel | Phases:
    """Return the analytic twin of an experiment's plant, its perturbation and its payload included."""
    plant, factors = experiment.plant, plant_factors(experiment)
    model, payload = plant.twin(factors), plant.load
    first, later = phases(model, payload)
    if payload is None or later is None:
        return first
    return Phases(first, later, whole_steps(payload.at, experiment.run.control_period))


def needed_torque(arm: RobotModel | Phases, motion: Reference) -> Array:
    """Return M qdd + N(q, qd) along a motion, (N, n) [N m]."""
    q, qd, qdd = motion
    torque: Array = np.einsum("kij,kj->ki", arm.mass_matrix(q), qdd) + arm.bias_forces(q, qd)
    return torque


def resistance(experiment: schema.Experiment, arm: RobotModel | Phases, motion: Reference) -> Array:
    """Return the torque of an experiment's friction along a motion, as it acts, (N, n) [N m].

    What grows with the load grows with the torque that the motion takes, friction included.

    Args:
        experiment: The experiment.
        arm: The true arm.
        motion: Position, velocity and acceleration, (N, n) each [rad, rad/s, rad/s^2].
    """
    qd = motion[1]
    friction = experiment.plant.acting
    if friction is None:
        return np.zeros_like(qd)
    acting = friction.of_joints(experiment.n)
    if not np.any(acting.load):
        return -steady(acting, qd, qd)
    needed = needed_torque(arm, motion)
    drag = steady(acting, qd, needed)
    for _ in range(LOADED):
        drag = steady(acting, qd, needed + drag)
    return -drag


def planned_torque(experiment: schema.Experiment, loop: Loop) -> list[str]:
    """Return a line where the reference needs more torque than the arm has, one where gravity at the start does.

    And one where joints without armature are too light for the control period. The torque is M qdd_ref + N(q_ref,
    qd_ref), friction included, of the true arm with what it carries, at up to `INSTANTS` instants; what is drawn,
    disturbances, is no part of it. The line splits it into gravity, inertia, velocity terms (Coriolis and centrifugal)
    and friction, signed so that they add up to the size that is told.

    Args:
        experiment: What is to be run.
        loop: Its objects.
    """
    step, truth = -(-len(loop.reference.q) // INSTANTS), truth_of(experiment)
    if isinstance(truth, Phases):
        truth = replace(truth, at=-(-truth.at // step))
    motion = Reference(*(x[::step] for x in loop.reference))
    limits, units = np.asarray(loop.plant.tau_max), [force_unit(kind) for kind in loop.model.flat.kind]
    first = truth.first if isinstance(truth, Phases) else truth
    text, is_too_much = holding(first, loop.initial_q, limits, "where it starts")
    rotor = without_rotor(first, loop.initial_q, experiment.run.control_period)
    still = [line for line, is_so in ((text, is_too_much), (rotor, bool(rotor))) if is_so]
    drag = -resistance(experiment, truth, motion)
    tau = needed_torque(truth, motion) + drag
    share = np.abs(tau) / limits
    over = np.flatnonzero(share.max(axis=0) > 1.0 + ROUNDED)
    if not len(over):
        return still
    worst = int(over[np.argmax(share[:, over].max(axis=0))])
    at, unit = int(np.argmax(share[:, worst])), units[worst]
    others = [loop.joint_names[j] for j in over if j != worst]
    zero = np.zeros_like(motion.qd)
    gravity, bias = (truth.bias_forces(motion.q, qd)[at, worst] for qd in (zero, motion.qd))
    friction, sign = drag[at, worst], np.sign(tau[at, worst])
    parts = {
        "gravity": gravity,
        "inertia": tau[at, worst] - bias - friction,
        "velocity terms": bias - gravity,
        "friction": friction,
    }
    told = [f"{name} {sign * x:.3g}" for name, x in parts.items() if abs(x) >= SMALL * abs(tau[at, worst])]
    return [
        f"{TOO_MUCH}: {loop.joint_names[worst]} {abs(tau[at, worst]):.4g} {unit} "
        f"at {at * step * experiment.run.control_period:.4g} s, its limit is {limits[worst]:.4g} {unit}"
        f" ({', '.join(told)})" + also(others),
        *still,
    ]


def planned(experiment: schema.Experiment, loop: Loop) -> list[str]:
    """Return what the arm cannot do, whatever the law: leave ranges, exceed speed or torque, stand the period."""
    t = control_instants(experiment.n_steps, experiment.run.control_period)
    motion = [*planned_range(experiment, t, loop.reference.q), *planned_speed(experiment, t, loop.reference.qd)]
    return [*motion, *planned_torque(experiment, loop)]


def _slides(law: Law, options: Mapping[str, str | bool]) -> bool:
    units = {name: law.gains[name].unit for name in ("lam", "k") if name in law.gains}
    return units == {"lam": "1/s", "k": "1"} and law.gains["k"].acts(options)


def takes_its_own(keys: Controller) -> bool:
    """Return whether a controller's law slides, and takes from the model what no option of it says."""
    law = find_law(keys.law)
    options = {name: keys.options.get(name, option.values[0]) for name, option in law.options.items()}
    takes = "equivalent_control" not in options and bool(law.terms or law.has_model(options))
    return takes and _slides(law, options)


def sliding_law(keys: Controller, loop: Loop, n: int) -> SlidingLaw | None:
    """Return what a controller's certificates need, or None where they are not defined for its law.

    They are for laws with a slope ``lam`` [1/s], a switching gain ``k`` over the torque limit [1] that acts, and the
    surface s = de + lambda e, whose equivalent control, if any, is the model's without the measured acceleration. Gains
    of these names in other units are something else. A law that takes from the model what it likes, without an option
    ``equivalent_control``, has none: what K is left with is known to nobody but the law.
    """
    law = find_law(keys.law)
    options = {name: keys.options.get(name, option.values[0]) for name, option in law.options.items()}
    if not _slides(law, options) or takes_its_own(keys):
        return None
    if options.get("surface", "pd") != "pd":
        return None
    if options.get("equivalent_control") == "measured-acceleration":
        return None
    phi, lam = keys.gains.get("phi"), as_vector(keys.gains["lam"], n)
    rate = law.gains.get("kv")
    has_rate = rate is not None and rate.unit == "1/s" and rate.acts(options)
    Kd = as_vector(keys.gains["kv"], n) * loop.model.flat.inertia_scale if has_rate else None
    return SlidingLaw(
        lam,
        as_vector(keys.gains["k"], n) * np.asarray(loop.plant.tau_max),
        None if phi is None else as_vector(phi, n),
        loop.model if options.get("equivalent_control") else None,
        None if Kd is None else lam * Kd,
        Kd,
    )


def flags(experiment: schema.Experiment, loop: Loop) -> tuple[Flag | Coarse | Overdriven, ...]:
    """Return what the controllers cannot do, before anything is run: meet their reaching condition, or hold s.

    All of that is said of rigid joints that move: there is nothing to say where the plant's joints give, or one locks.
    """
    if experiment.plant.transmission is not None or experiment.plant.lock is not None:
        return ()
    truth, found = truth_of(experiment), list[Flag | Coarse | Overdriven]()
    acting = resistance(experiment, truth, loop.reference) + (0.0 if loop.disturbance is None else loop.disturbance)
    for keys in experiment.controllers:
        law = sliding_law(keys, loop, experiment.n)
        if law is None:
            found += overdriven(experiment, loop, keys, truth)
            continue
        needed = required_gain(truth, law, *loop.reference, acting)
        if np.any(needed >= law.K):
            worst = int(np.argmax((needed - law.K) / np.asarray(loop.plant.tau_max)))
            k_needed = float(np.max(needed / np.asarray(loop.plant.tau_max)))
            unit = force_unit(loop.model.flat.kind[worst])
            gain, least = float(law.K[worst]), float(needed[worst])
            found.append(Flag(keys.name, loop.joint_names[worst], gain, least, k_needed, unit))
        coarse = too_coarse(experiment, loop, keys.name, law, truth)
        if coarse is not None:
            found.append(coarse)
    return tuple(found)


def certificate_of(
    experiment: schema.Experiment,
    loop: Loop,
    keys: Controller,
    run: Trajectory,
    truth: RobotModel | Phases | None = None,
) -> Certificate | None:
    """Return the certificate of one run; None where it did not complete, joints give or lock, or its law has none.

    Args:
        experiment: What was run.
        loop: Its objects.
        keys: The controller.
        run: Its run.
        truth: The arm, where it is at hand; see `truth_of`.
    """
    law = sliding_law(keys, loop, experiment.n)
    plant = experiment.plant
    if law is None or not run.completed or plant.transmission is not None or plant.lock is not None:
        return None
    period = experiment.run.control_period
    return certify(run, truth or truth_of(experiment), law, period, experiment.chain.reaction(period))


def too_coarse(
    experiment: schema.Experiment, loop: Loop, name: str, law: SlidingLaw, truth: RobotModel | Phases
) -> Coarse | None:
    """Return where a controller's K moves s too far in one control period, or None where it does not.

    Args:
        experiment: What is to be run.
        loop: Its objects.
        name: The controller.
        law: What its certificates need.
        truth: The true arm.
    """
    span = np.max(np.abs(loop.reference.q - loop.initial_q), axis=0)
    span = np.where(span > 0.0, span, np.max(span))  # a joint that is to stay is held as well as those that move
    poses, arm = _poses(loop), truth.later if isinstance(truth, Phases) else truth
    period = experiment.run.control_period
    held = held_to(arm, law, poses, span, period)
    if not (held.coarse.any() and np.max(span) > 0.0):
        return None
    worst = int(np.argmax(held.step / np.maximum(held.most, TINY)))
    return Coarse(
        name,
        loop.joint_names[worst],
        float(law.K[worst]),
        period,
        float(held.step[worst]),
        float(held.most[worst]),
        law.phi is not None,
        float(np.min(held.K / law.K)),
        float(np.min(held.K / np.asarray(loop.plant.tau_max))),
        force_unit(loop.model.flat.kind[worst]),
    )


def overdriven(
    experiment: schema.Experiment, loop: Loop, keys: Controller, truth: RobotModel | Phases
) -> list[Overdriven]:
    """Return whether a law's rate gain, Kd = kV Mbar, is too large for the control period: the remark, or nothing.

    Args:
        experiment: What is to be run.
        loop: Its objects.
        keys: The controller, whose law has no switching gain.
        truth: The true arm.
    """
    gain = find_law(keys.law).gains.get("kv")
    if gain is None or gain.rule is not rate or "kv" not in keys.gains:
        return []
    arm = truth.later if isinstance(truth, Phases) else truth
    Kd, period = (
        as_vector(keys.gains["kv"], experiment.n) * loop.model.flat.inertia_scale,
        experiment.run.control_period,
    )
    root = np.sqrt(Kd)
    moved, ways = np.linalg.eigh(period * root[:, None] * np.linalg.inv(arm.mass_matrix(_poses(loop))) * root)
    worst = int(np.argmax(moved[:, -1]))
    if not moved[worst, -1] > UNSTABLE:
        return []
    joint = int(np.argmax(np.abs(ways[worst, :, -1])))
    unit = "N s/m" if loop.model.flat.kind[joint] == SLIDE else "N m s/rad"
    name, times = loop.joint_names[joint], float(moved[worst, -1])
    return [Overdriven(keys.name, name, float(Kd[joint]), period, times, unit)]


def _poses(loop: Loop) -> Array:
    """Return poses along the motion of a loop, with that at its start, (m, n)."""
    q_ref = loop.reference.q
    return np.concatenate([loop.initial_q[None], q_ref[:: max(1, len(q_ref) // POSES)]])


def certificates(experiment: schema.Experiment, loop: Loop, runs: Mapping[str, Trajectory]) -> dict[str, Certificate]:
    """Return the certificates of every completed run of a law that has them."""
    truth = truth_of(experiment)
    found = {
        keys.name: certificate_of(experiment, loop, keys, runs[keys.name], truth) for keys in experiment.controllers
    }
    return {name: certificate for name, certificate in found.items() if certificate is not None}
