"""Preflight of a law on a robot: whether it would trip, saturate or shake, and which share of its gains would not.

A law flies a fixed set of small motions with the robot's chain, from home and from a drawn position, with and without a
load that it knows nothing of. What it asks for is judged before the chain limits it: a robot whose torque rate is
limited stops there, where a chain slews.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import ABOUT, Chain
from torquebench.errors import ModelError
from torquebench.experiment.build import Builder
from torquebench.experiment.config import parse_experiment
from torquebench.experiment.controllers import Controller
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.keys import altered, as_vector
from torquebench.laws import Gain, Law, find_law
from torquebench.metrics import from_joints, per_joint
from torquebench.metrics.shaking import shaking
from torquebench.references import Reference
from torquebench.robot import RobotModel, load_model
from torquebench.robot.loading import keyframes
from torquebench.robot.payload import Payload
from torquebench.sim.session import SampledTrial, Session
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Outcome, Trajectory
from torquebench.tuning import (
    acceleration_rate,
    damping,
    fuzzy_torque,
    integral,
    rate,
    stiffness,
    switching,
    twist,
    twist_rate,
)

LOST = 0.5
"""Error from which on a motion counts as lost [rad], [m] of a joint that slides."""
JUMP = 0.5
"""First command, away from the gravity that the robot held until then, of a robot without a rate limit [tau_max]."""
SATURATED = 0.01
"""Share of a motion for which the command may be beyond the torque limit [1]."""
ROUGH = 1.0
"""Chattering beyond which a law is refused though it is no limit cycle: noise passed on [% of tau_max]."""
SETTLED = 0.5
"""Time from which on shaking is looked for [s]."""
SPREAD = 0.5
"""How far a drawn position is from home, at most [rad]."""
SHARES = (0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.06, 0.04, 0.03)
"""Shares of the gains that are tried in turn."""
REFINED = 2
"""Bisections between the largest of them that passes and the one above it."""
STRENGTHS = (
    rate,
    acceleration_rate,
    damping,
    stiffness,
    switching,
    fuzzy_torque,
    integral,
    twist,
    twist_rate,
)
"""Rules of the gains that are scaled: the torque's, not those of slopes and widths."""
SPEEDS: Mapping[str, tuple[float, ...]] = {
    "fr3": (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    "ur5e": (math.pi,) * 6,
    "iiwa14": tuple(math.radians(x) for x in (85, 85, 100, 75, 130, 135, 135)),
}
"""Largest joint speeds [rad/s]: Franka's and KUKA's data sheets, UR's 180 degrees/s."""

REMEDIES = {
    "torque rate": "lower the gains on velocity, or filter it: noise times gain is the command's step; ramp what jumps",
    "jump at start": "begin with the torque that holds the arm: add gravity, start the reference where the arm is",
    "speed": "slow the reference, add damping; a law that runs away has a wrong sign or no damping",
    "range": "add gravity or stiffness; a law that runs away has a wrong sign or no damping",
    "diverges": "check each joint's sign, then lower the gains",
    "bad torque": "guard divisions and roots: torquebench check says where",
    "saturates": "lower the gains, slow the reference, or wait with the integral at the limit",
    "limit cycle": "lower the gains, or shorten delay and lag: the loop answers too late for them",
    "chatters": "lower the gain on velocity, widen the layer, or filter: noise comes back as torque",
    "loses the motion": "check each joint's sign; add gravity or stiffness",
}
"""Reason -> what to change."""


class Finding(NamedTuple):
    """One thing that a law would do in one motion."""

    reason: str
    """A key of `REMEDIES`."""
    flight: str
    """The motion, from where, with which load."""
    joint: str | None
    """Name of the joint."""
    t: float
    """When it began [s]."""
    value: float
    limit: float
    unit: str


class Flight(NamedTuple):
    """One motion to fly."""

    motion: str
    pose: str
    payload: float
    """Load of which the law knows nothing [kg]."""
    start: Array
    reference: Reference

    def __str__(self) -> str:
        return f"{self.motion}, from {self.pose}, {self.payload:g} kg"


class Report(NamedTuple):
    """What came of a law on a robot."""

    controller: str
    flights: tuple[str, ...]
    findings: tuple[Finding, ...]
    scaled: tuple[str, ...]
    """Gains that a share is of."""
    share: float | None
    """Largest share of them that passes; None where none does."""

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    @property
    def first(self) -> Finding | None:
        """What happens first, in the order of the flights."""
        return self.findings[0] if self.findings else None


def experiment_of(
    law: str, robot: str, chain: str | None = None, gains: Mapping[str, Any] | None = None, period: float | None = None
) -> Experiment:
    """Return the experiment of a law on a robot.

    Args:
        law: Name of a registered law.
        robot: The arm.
        chain: Name of its chain; None for the chain of the robot's name.
        gains: Gains that are given; the others are chosen.
        period: Control period [s]; None for the robot's, else 1 ms.

    Raises:
        ConfigError: something of it is wrong.
    """
    chain = robot if chain is None else chain
    if period is None:
        period = (ABOUT[chain].control_period if chain in ABOUT else None) or 0.001
    document = {
        "name": "preflight",
        "plant": {"engine": "mujoco", "model": robot, "timestep": min(0.001, period), "limits": "ignore"},
        "controllers": [{"name": law, "law": law, "gains": {"from": "auto", **(gains or {})}}],
        "reference": {"kind": "quintic", "target": 0.0, "rise_time": 1.0},
        "chain": chain,
        "run": {"duration": 2.0, "control_period": period, "initial_q": "home"},
    }
    return parse_experiment(json.dumps(document), "preflight")


def preflight(
    experiment: Experiment, payload: float = 1.0, progress: Callable[[str], None] = lambda what: None
) -> list[Report]:
    """Fly each controller of an experiment, and return what came of it.

    Args:
        experiment: Whose arm, chain, belief and controllers are taken, not its motion.
        payload: Load of half the motions [kg]; 0 for none.
        progress: Told what is being flown.
    """
    pilot = Pilot(experiment, payload)
    return [pilot.report(keys, progress) for keys in experiment.controllers]


class Pilot:
    """Flies controllers on one robot.

    Args:
        experiment, payload: As of `preflight`.
    """

    def __init__(self, experiment: Experiment, payload: float) -> None:
        self.experiment = experiment
        self.arm = load_model(experiment.plant.model)
        self.flights = tuple(_flights(experiment, self.arm, payload))
        self._builder, self._session = Builder(), Session()

    def report(self, keys: Controller, progress: Callable[[str], None]) -> Report:
        """Return what a controller does, and which share of its gains passes."""
        found, failed = list[Finding](), list[Flight]()
        for flight in self.flights:
            progress(f"{keys.name}: {flight}")
            new = self.fly(keys, flight)
            found += new
            failed += [flight] * bool(new)
        names = scaled_gains(find_law(keys.law), keys)
        others = [flight for flight in self.flights if flight not in failed]
        share = 1.0 if not found else self._share(keys, names, [*failed, *others], progress)
        return Report(keys.name, tuple(map(str, self.flights)), tuple(found), names, share)

    def _share(
        self, keys: Controller, names: Sequence[str], flights: Sequence[Flight], progress: Callable[[str], None]
    ) -> float | None:
        """Return the largest share of the gains that passes every flight; see `SHARES`."""

        def passes(share: float) -> bool:
            progress(f"{keys.name}: at {100.0 * share:.3g} % of its gains")
            less = with_share(keys, names, share)
            return not any(self.fly(less, flight) for flight in flights)

        above, low = 1.0, next((share for share in SHARES if names and passes(share)), None)
        if low is None:
            return None
        above = min((share for share in (1.0, *SHARES) if share > low), default=1.0)
        for _ in range(REFINED):
            middle = math.sqrt(low * above)
            low, above = (middle, above) if passes(middle) else (low, middle)
        return float(f"{low:.2g}")

    def fly(self, keys: Controller, flight: Flight) -> list[Finding]:
        """Fly one motion, and return what happened there, the earliest first."""
        load = Payload(flight.payload) if flight.payload else None
        plant = dataclasses.replace(self.experiment.plant, payload=load, limits="ignore")
        loop = self._builder(altered(self.experiment, plant=plant, controllers=(keys,)))
        run, n = self.experiment.run, self.experiment.n
        drawn = self.experiment.chain.draw(n, len(flight.reference.q), run.seed, run.draw)
        trial = SampledTrial(
            loop.controllers[0],
            loop.model,
            flight.reference,
            run.control_period,
            self.experiment.chain,
            drawn,
            None,
            flight.start,
        )
        with np.errstate(all="ignore"):
            flown = self._session.run(loop.plant, trial)
        found = judge(flown, self.arm, self.experiment.chain, run.control_period, loop.model.gravity(flight.start))
        return [one._replace(flight=str(flight)) for one in sorted(found, key=lambda one: one.t)]


def scaled_gains(law: Law, keys: Controller) -> tuple[str, ...]:
    """Return the names of the gains that make a law's torque: of a user's gain nothing is known, so that all count."""

    def is_strength(gain: Gain) -> bool:
        return gain.rule is None or gain.rule in STRENGTHS or gain.unit == "N m/(rad s)"

    return tuple(name for name in keys.gains if is_strength(law.gains[name]))


def with_share(keys: Controller, names: Sequence[str], share: float) -> Controller:
    """Return a controller with a share of some of its gains."""

    def less(value: Any) -> Any:
        return tuple(share * x for x in value) if isinstance(value, tuple) else share * value

    return dataclasses.replace(
        keys, gains={name: less(value) if name in names else value for name, value in keys.gains.items()}
    )


def judge(run: Trajectory, arm: RobotModel, chain: Chain, period: float, held: Array) -> Iterator[Finding]:
    """Yield what a run shows that a robot would not stand.

    Args:
        run: The run.
        arm: The arm, without a load.
        chain: Its chain; `torque_rate` is where the robot stops.
        period: Control period [s].
        held: Torque that held the arm before, (n,) [N m].
    """
    names, tau_max, n = arm.joint_names, arm.flat.tau_max, arm.n
    command = run.tau_law if run.completed else run.tau_law[:-1]
    steps = np.diff(np.vstack([held, command]), axis=0)
    if chain.torque_rate is not None:
        limit = as_vector(chain.torque_rate, n)
        yield from _beyond("torque rate", run, names, np.abs(steps) / period, limit, "N m/s")
    else:
        yield from _beyond("jump at start", run, names, np.abs(steps[:1]), JUMP * tau_max, "N m")
    q, qd = run.q, run.qd
    speed = SPEEDS.get(arm.name)
    if speed is None and chain.torque_speed is not None:
        speed = tuple(as_vector(chain.torque_speed.no_load, n).tolist())
    if speed is not None:
        yield from _beyond("speed", run, names, np.abs(qd), np.array(speed), "rad/s")
    low, high = np.array(arm.passive.low), np.array(arm.passive.high)
    over, centre = np.maximum(low - q, q - high), np.zeros(n)
    yield from _beyond("range", run, names, np.where(np.isfinite(over), over, -1.0), centre, "rad beyond")
    yield from _beyond("loses the motion", run, names, np.abs(run.q_ref - q), np.full(n, LOST), "rad")
    beyond = np.abs(command) > tau_max
    shares = beyond.mean(axis=0) if len(command) else np.zeros(n)
    if np.any(shares > SATURATED):
        worst = int(np.argmax(shares))
        began = float(run.t[np.argmax(beyond[:, worst])])
        yield Finding(
            "saturates", "", names[worst], began, 100.0 * float(shares[worst]), 100.0 * SATURATED, "% of time"
        )
    if not run.completed:
        reason = "diverges" if run.outcome in (Outcome.DIVERGED, Outcome.OUT_OF_RANGE) else "bad torque"
        yield Finding(reason, "", None, float(run.t[-1]), float(run.t[-1]), math.inf, "s")
        return
    metrics = from_joints(per_joint(run, tau_max=tau_max, metrics_from=SETTLED, control_period=period, step_like=False))
    shakes = shaking(metrics, tau_max.tolist())
    if shakes is not None and (shakes.is_cycle or shakes.chattering > ROUGH):
        reason = "limit cycle" if shakes.is_cycle else "chatters"
        limit_here = ROUGH if reason == "chatters" else 0.1
        unit = "% of tau_max" + (f" at {shakes.frequency:.3g} Hz" if math.isfinite(shakes.frequency) else "")
        yield Finding(reason, "", names[shakes.joint], SETTLED, shakes.chattering, limit_here, unit)


def _beyond(
    reason: str, run: Trajectory, names: Sequence[str], values: Array, limits: Array, unit: str
) -> Iterator[Finding]:
    """Yield the first time at which values (N, n) are beyond limits (n,), with the largest value of that joint.

    Args:
        reason: Key of `REMEDIES`; the first command's step is a jump at start.
        run: The run.
        names: Names of the joints.
        values, limits: What is compared.
        unit: Of both.
    """
    beyond = values > limits
    if not np.any(beyond):
        return
    k = int(np.argmax(np.any(beyond, axis=1)))
    joint = int(np.argmax(np.where(beyond[k], values[k] - limits, -np.inf)))
    if reason == "torque rate" and k == 0:
        reason = "jump at start"
    most = float(np.max(values[:, joint]))
    yield Finding(reason, "", names[joint], float(run.t[k]), most, float(limits[joint]), unit)


def _flights(experiment: Experiment, arm: RobotModel, payload: float) -> Iterator[Flight]:
    """Yield the motions: hold, a small step, a slow and a fast swing; from home and elsewhere; without and with load.

    Args:
        experiment, payload: As of `preflight`.
        arm: The arm.
    """
    home = _home(experiment, arm)
    elsewhere = home + np.random.default_rng(experiment.run.seed).uniform(-SPREAD, SPREAD, arm.n)
    low, high = np.array(arm.passive.low) + SPREAD, np.array(arm.passive.high) - SPREAD
    elsewhere = np.where(low < high, np.clip(elsewhere, low, high), home)
    for name, size, half, duration in (
        ("hold", 0.0, 1.0, 1.5),
        ("small step", 0.1, 0.5, 1.5),
        ("slow swing", 0.2, 1.0, 2.0),
        ("fast swing", 0.2, 0.5, 2.0),
    ):
        t = control_instants(round(duration / experiment.run.control_period), experiment.run.control_period)
        for pose, start in (("home", home), ("a drawn position", elsewhere)):
            # away from the nearer end of a range; by turns where there is none
            signs = np.where(high - start > start - low, 1.0, -1.0)
            signs = np.where(np.isfinite(low) & np.isfinite(high), signs, (-1.0) ** np.arange(arm.n))
            motion = swing(t, size * signs, half, name == "small step")
            placed = motion._replace(q=motion.q + start)
            for mass in (0.0, payload) if payload > 0.0 else (0.0,):
                yield Flight(name, pose, mass, start, placed)


def swing(t: Array, size: Array, half: float, once: bool = False) -> Reference:
    """Return a minimum-jerk motion to `size` and back, again and again, with no step in its acceleration.

    Args:
        t: Times, (N,) [s].
        size: How far each joint goes, (n,) [rad].
        half: Time for one way [s].
        once: Go there and stay.
    """
    turn = np.floor(t / half + 1e-9)
    x = np.clip(t / half - turn, 0.0, 1.0)
    back = (turn % 2.0 == 1.0) & (not once)
    if once:
        x = np.where(turn >= 1.0, 1.0, x)
    sign, x = np.where(back, -1.0, 1.0)[:, None], x[:, None]
    way = x * x * x * (10.0 + x * (-15.0 + 6.0 * x))
    q = np.where(back[:, None], 1.0 - way, way)
    qd = sign * 30.0 * x * x * (1.0 - x) * (1.0 - x) / half
    qdd = sign * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (half * half)
    return Reference(q * size, qd * size, qdd * size)


def _home(experiment: Experiment, arm: RobotModel) -> Array:
    """Return where an arm is at home: the keyframe of that name, else zero."""
    try:
        return keyframes(experiment.plant.model).get("home", np.zeros(arm.n))
    except ModelError:
        return np.zeros(arm.n)
