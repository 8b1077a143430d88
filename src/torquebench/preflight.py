"""Preflight of a law on a robot: whether it would trip, saturate or shake, and which share of its gains would not.

A law flies a fixed set of small motions with the robot's chain, from home and from a drawn position, with and without a
load that it knows nothing of. What it asks for is judged before the chain limits it: a robot whose torque rate is
limited stops there, where a chain slews.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import Chain, period_of
from torquebench.diagnosis.margins import (
    ENOUGH,
    Margins,
    Slopes,
    backwards,
    leaves_gravity,
    margins_of,
    slopes_of,
    weight_along,
)
from torquebench.diagnosis.parts import as_yaml, layers, strengths, with_share
from torquebench.diagnosis.poles import Pole, poles_of
from torquebench.experiment.build import Builder, Loop
from torquebench.experiment.controllers import Controller
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.keys import altered, as_vector
from torquebench.metrics import from_joints, per_joint
from torquebench.metrics.chattering import STILL, is_of_motion
from torquebench.metrics.shaking import Shaking, shaking
from torquebench.metrics.torque import SATURATED
from torquebench.references import Reference
from torquebench.robot import RobotModel, load_model
from torquebench.robot.library import ArmSource
from torquebench.robot.payload import Payload
from torquebench.sim.friction import FRICTIONS
from torquebench.sim.session import SampledTrial, Session
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Outcome, Trajectory
from torquebench.tuning import integral

LOST = 0.5
"""Error from which on a motion counts as lost [rad], [m] of a joint that slides."""
JUMP = 0.5
"""First command, away from the gravity that the robot held until then, of a robot without a rate limit [tau_max]."""
ROUGH = 1.0
"""Chattering beyond which a law is refused though it is no limit cycle: noise passed on [% of tau_max]."""
SETTLED = 0.5
"""Time from which on shaking is looked for [s]."""
SWINGS, TURNS, FADES = 0.001, 4, 0.7
"""Swing about its mean [rad], and turns, that are left in the last third of a small step's rest, and the share of those
in the third before from which on they do not fade [1]."""
DURATION, STEP = 2.0, 0.5
"""Time of every motion, and within it of a small step [s]."""
GROWS = 0.1
"""Rate from which on a pole of the loop about rest grows [1/s]."""
SLOWEST_HZ, LONGEST = 0.1, 30.0
"""Slowest swing that a rest is looked at for [Hz], and the longest rest [s]."""
SMALL = (SWINGS, 10.0 * SWINGS)
"""Half the change of position [rad] and velocity [rad/s] by which laws are made linear: swings that count."""
SPREAD = 0.5
"""Largest distance of a drawn position from home [rad]."""
SHARES = (0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.06, 0.04, 0.03)
"""Shares of the gains that are tried in turn."""
REFINED = 2
"""Bisections between the largest of them that passes and the one above it."""
REMEDIES = {
    "wrong sign": "turn the sign of that joint: the law pushes it away from its target",
    "no gravity": "add gravity: at no error the law gives nothing that holds the arm",
    "unstable": "lower the integral, raise the damping, or shorten delay and lag: at rest an error grows by itself",
    "torque rate": "lower the gain on velocity, or filter it: noise times gain is the command's step; ramp what jumps",
    "jump at start": "begin with the torque that holds the arm: add gravity, start the reference where the arm is",
    "speed": "slow the reference, add damping",
    "range": "add gravity or stiffness, or stay away from the ends",
    "diverges": "lower the gains, or shorten delay and lag",
    "bad torque": "guard divisions and roots: torquebench check says where",
    "saturates": "lower the gains, slow the reference, or let the integral wait at the limit",
    "limit cycle": "lower the gains, or shorten delay and lag; torquebench why says which part of the chain does it",
    "chatters": "lower the gain on velocity, widen the layer, or filter: noise comes back as torque",
    "swings": "raise the damping, or lower the stiffness or the integral",
    "loses the motion": "add gravity, raise the stiffness, or lower the integral and the gain on velocity",
}
"""Reason -> what to change; the first two are found in the law itself, the others in a motion."""

LONG = "long rest"
"""Small step after which the arm is watched for as long as a slow pole takes."""
WIDENS = {"torque rate", "saturates", "limit cycle", "chatters"}
"""Reasons against which a wider layer is tried, of a law that can have one."""
RUNS_AWAY = ("speed", "range", "loses the motion", "diverges", "bad torque")
SHAKES = ("limit cycle", "chatters", "swings")
"""Findings about a motion that say nothing once the arm has run away."""


class Finding(NamedTuple):
    """One thing that is looked at in one motion."""

    reason: str
    """A key of `REMEDIES`."""
    flight: str
    """The motion, from where, with which load; empty for what is found in the law itself."""
    joint: str | None
    """Name of the joint."""
    t: float | None
    """Time at which it began; else that at which it was worst [s]."""
    value: float
    limit: float
    unit: str
    """Of both."""
    beyond: bool
    """Whether the robot would not stand it."""


class Flight(NamedTuple):
    """One motion to fly."""

    motion: str
    pose: str
    payload: float
    """Load of which the law knows nothing [kg]."""
    start: Array
    reference: Reference
    duration: float = DURATION
    """Its time [s]."""
    pole: Pole | None = None
    """Pole that is too slow for the other motions, if this flight is made for one."""

    @property
    def settles(self) -> bool:
        """Whether the arm must come to rest in this flight."""
        return self.motion in ("small step", LONG)

    def __str__(self) -> str:
        return f"{self.motion}, from {self.pose}, {self.payload:g} kg"


class Report(NamedTuple):
    """Result of the preflight of a law on a robot."""

    controller: str
    flights: tuple[str, ...]
    seen: tuple[Finding, ...]
    """Everything that was looked at, in the order of the flights."""
    scaled: tuple[str, ...]
    """Gains that a share is of."""
    share: float | None
    """Share of them that passes, where one at most 14 % larger does not; None where none does, or none was looked for.
    Of integrals alone where that of all gains does not help what is unstable."""
    layer: tuple[tuple[str, str], ...] = ()
    """Keys of a config, with their values, of a layer that passes; none where none was looked for, or none passes."""
    margins: Margins | None = None
    """Margins of the loop about rest where they are least; None where no loop crosses."""
    where: str = ""
    """Where they are least: position and load."""
    left: Margins | None = None
    """Likewise with that share of the gains; None where it passes as it is."""
    layer_left: Margins | None = None
    """Likewise with that layer."""
    calmer: float | None = None
    """Largest share tried that passes with a phase margin of `ENOUGH`, where the largest that passes leaves less."""
    calmer_left: Margins | None = None
    """Margins with that share."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings that a robot would not stand."""
        return tuple(one for one in self.seen if one.beyond)

    @property
    def passed(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    @property
    def closest(self) -> tuple[Finding, ...]:
        """Each thing where it came closest to its limit, or furthest beyond."""
        most: dict[str, Finding] = {}
        for one in self.seen:
            if one.flight and one.value / one.limit > most.get(one.reason, one._replace(value=-1.0)).value / one.limit:
                most[one.reason] = one
        return tuple(most[reason] for reason in REMEDIES if reason in most)


def experiment_of(
    law: str,
    robot: str | Path,
    chain: str,
    gains: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Experiment:
    """Return the experiment of a law on a robot with its friction, at the control period of its chain, else 1 ms.

    Args:
        law: Name of a registered law.
        robot: Name of the arm, or its file.
        chain: Name of its chain.
        gains: Gains that are given; the others are chosen.
        options: Options of the law.

    Raises:
        ConfigError: something of it is wrong.
    """
    period = period_of(chain) or 0.001
    controller = {"name": law, "law": law, "gains": {"from": "auto", **(gains or {})}, **(options or {})}
    plant = {"engine": "mujoco", "model": robot, "timestep": min(0.001, period), "limits": "ignore"}
    if robot in FRICTIONS:
        plant["friction"] = robot
    return Experiment.from_dict(
        {
            "name": "preflight",
            "plant": plant,
            "controllers": [controller],
            "reference": {"kind": "quintic", "target": 0.0, "rise_time": 1.0},
            "chain": chain,
            "run": {"duration": DURATION, "control_period": period, "initial_q": "home"},
        }
    )


def preflight(
    experiment: Experiment,
    payload: float = 1.0,
    progress: Callable[[str], None] = lambda what: None,
    share: bool = True,
) -> list[Report]:
    """Fly each controller of an experiment, and return what came of it.

    Args:
        experiment: Whose arm, chain, belief and controllers are taken, not its motion.
        payload: Load of half the motions [kg]; 0 for none.
        progress: Told what is being flown.
        share: Whether to look for the share of the gains that passes.
    """
    pilot = Pilot(experiment, payload)
    return [pilot.report(keys, progress, share) for keys in experiment.controllers]


class Pilot:
    """Flies controllers on one robot.

    Args:
        experiment, payload: As of `preflight`.
    """

    def __init__(self, experiment: Experiment, payload: float) -> None:
        run = dataclasses.replace(experiment.run, duration=DURATION, metrics_from=SETTLED)
        plant = dataclasses.replace(experiment.plant, limits="ignore", payload=None)
        self.experiment = altered(experiment, run=run, plant=plant, disturbances=())
        self.arm, self.room = load_model(experiment.plant.model), room_of(experiment.plant.model)
        self.flights = tuple(_flights(self.experiment, self.room, payload))
        self._builder, self._session = Builder(), Session()

    def report(self, keys: Controller, progress: Callable[[str], None], share: bool = True) -> Report:
        """Return what a controller does, and which share of its gains passes; arguments as of `preflight`."""
        seen, flown, failed = list[Finding](), list[Flight](), list[Flight]()
        for flight in self._motions(keys, self.flights, failed):
            progress(f"{keys.name}: {flight}")
            new = self.fly(keys, flight)
            seen += new
            flown.append(flight)
            failed += [flight] * any(one.beyond for one in new)
        names, (margins, where) = strengths(keys), self.margins(keys)
        report = Report(keys.name, tuple(map(str, flown)), tuple(seen), names, None, (), margins, where)
        if not failed:
            return report._replace(share=1.0)
        report = report._replace(seen=(*self.own(keys), *seen))
        return self._cured(report, keys, failed, progress) if share else report

    def _cured(
        self, report: Report, keys: Controller, failed: Sequence[Flight], progress: Callable[[str], None]
    ) -> Report:
        """Return a report with the layer and the share of the gains that pass; the worst flights are tried first."""
        reasons, flights = {one.reason for one in report.findings}, sorted(self.flights, key=lambda x: x not in failed)
        wider = self.wider(keys) if reasons & WIDENS else ()
        wide = next((one for one in wider if self._passes(one, flights, progress)), None)
        if wide is not None:
            form = () if "phi" in keys.gains else (("switching", "saturation"),)
            report = report._replace(
                layer=(*form, ("phi", as_yaml(wide.gains["phi"]))), layer_left=self.margins(wide)[0]
            )
        for names in (report.scaled, strengths(keys, (integral,)) if "unstable" in reasons else ()):
            share = self._share(keys, names, flights, progress)
            if share is not None:
                left = self.margins(with_share(keys, names, share))[0]
                report = report._replace(scaled=names, share=share, left=left)
                return report if left is None or _is_enough(left) else self._calmer(report, keys, flights, progress)
        return report

    def _calmer(
        self, report: Report, keys: Controller, flights: Sequence[Flight], progress: Callable[[str], None]
    ) -> Report:
        """Return a report with the largest of `SHARES` that passes and leaves a phase margin of `ENOUGH`."""
        for share in (share for share in SHARES if share < (report.share or 0.0)):
            fewer = with_share(keys, report.scaled, share)
            left = self.margins(fewer)[0]
            if left is not None and _is_enough(left) and self._passes(fewer, flights, progress):
                return report._replace(calmer=share, calmer_left=left)
        return report

    def _motions(self, keys: Controller, flights: Sequence[Flight], failed: Sequence[Flight]) -> Iterator[Flight]:
        """Yield the flights, and where none of them has `failed` a long rest if the loop has a pole that needs it."""
        yield from flights
        if not failed and (slow := self.slow(keys)) is not None:
            yield slow

    def slow(self, keys: Controller) -> Flight | None:
        """Return the flight that shows what grows at rest or swings on too slowly for the others; None for nothing.

        It lasts until a growth is a thousandfold, or for three times two and a half swings, but `LONGEST` at most. The
        law is linear for swings of `SMALL`: one that switches has the slope that belongs to them.
        """
        period, third = self.experiment.run.control_period, (DURATION - STEP) / 3.0
        found: list[tuple[Pole, float, Flight]] = []
        for flight, linear in self.linear(keys):
            for pole in poles_of(*linear):
                rest = 0.0
                if pole.rate > GROWS:
                    rest = math.log(1000.0) / pole.rate
                elif pole.rate > math.log(FADES) / third and pole.frequency > SLOWEST_HZ:
                    rest = 1.875 * TURNS / pole.frequency
                if rest > DURATION - STEP:
                    found.append((pole, min(rest, LONGEST), flight))
        if not found:
            return None
        pole, rest, flight = max(found, key=lambda one: one[0].rate)
        more = round((STEP + rest - DURATION) / period)
        longer = Reference(*(np.pad(signal, ((0, more), (0, 0)), "edge") for signal in flight.reference))
        return flight._replace(motion=LONG, reference=longer, duration=DURATION + more * period, pole=pole)

    def linear(self, keys: Controller) -> Iterator[tuple[Flight, tuple[Experiment, Loop, Slopes]]]:
        """Yield for each small step the loop about its start, with the law's slopes for swings of `SMALL`."""
        by = np.full(self.arm.n, SMALL[0]), np.full(self.arm.n, SMALL[1])
        for flight in (flight for flight in self.flights if flight.settles):
            experiment = self._loaded(keys, flight.payload, self.experiment.run.control_period)
            loop = self._builder(experiment)._replace(reference=flight.reference)
            yield flight, (experiment, loop, slopes_of(experiment, loop, by))

    def margins(self, keys: Controller) -> tuple[Margins | None, str]:
        """Return the margins about rest where the phase margin is least, the least delay and gain margin, and where."""
        found = list[tuple[float, Margins, str]]()
        for flight, linear in self.linear(keys):
            margins = margins_of(*linear)
            if margins is not None and margins.phase is not None:
                found.append((margins.phase, margins, f"{flight.pose}, {flight.payload:g} kg"))
        if not found:
            return None, ""
        _, worst, where = min(found, key=lambda one: one[0])
        if worst.delay is not None:
            delay = min(one.delay for _, one, _ in found if one.delay is not None)
            gain = min((one for _, one, _ in found), key=lambda one: one.factor or math.inf)
            worst = dataclasses.replace(worst, delay=delay, factor=gain.factor, oscillation=gain.oscillation)
        return worst, where

    def wider(self, keys: Controller) -> Iterator[Controller]:
        """Yield a controller with wider and wider layers; see `layers`."""
        experiment = self._loaded(keys, 0.0, self.experiment.run.control_period)
        yield from layers(experiment, self._builder(experiment)._replace(reference=self.flights[0].reference))

    def _loaded(self, keys: Controller, payload: float, duration: float) -> Experiment:
        """Return the experiment of one controller with a load [kg] that it knows nothing of, for a time [s]."""
        plant = dataclasses.replace(self.experiment.plant, payload=Payload(payload) if payload else None)
        run = dataclasses.replace(self.experiment.run, duration=duration, metrics_from=min(SETTLED, duration / 2))
        return altered(self.experiment, plant=plant, run=run, controllers=(keys,))

    def own(self, keys: Controller) -> list[Finding]:
        """Return what a law does wrong wherever it is used; see `torquebench.diagnosis.margins`."""
        experiment = altered(self.experiment, controllers=(keys,))
        loop = self._builder(experiment)._replace(reference=self.flights[0].reference)
        slopes, weight = slopes_of(experiment, loop), weight_along(experiment, loop)
        names, found = self.arm.joint_names, list[Finding]()
        joint = backwards(slopes)
        if joint is not None:
            pull = float(np.max(slopes.stiffness[:, joint, joint]))
            found.append(Finding("wrong sign", "", names[joint], None, pull, 0.0, "N m/rad of stiffness", True))
        if leaves_gravity(slopes, weight):
            heavy = int(np.argmax(np.max(np.abs(weight), axis=0)))
            rest, most = (float(np.max(np.abs(x[:, heavy]))) for x in (slopes.at_rest, weight))
            found.append(Finding("no gravity", "", names[heavy], None, rest, most, "N m", True))
        return found

    def _share(
        self, keys: Controller, names: Sequence[str], flights: Sequence[Flight], progress: Callable[[str], None]
    ) -> float | None:
        """Return a share of the gains that passes every flight; one at most 14 % larger does not. See `SHARES`."""

        def passes(share: float) -> bool:
            return self._passes(with_share(keys, names, share), flights, progress)

        above, low = 1.0, next((share for share in SHARES if names and passes(share)), None)
        if low is None:
            return None
        above = min((share for share in (1.0, *SHARES) if share > low), default=1.0)
        for _ in range(REFINED):
            middle = float(f"{math.sqrt(low * above):.2g}")
            low, above = (middle, above) if passes(middle) else (low, middle)
        return low

    def _passes(self, keys: Controller, flights: Sequence[Flight], progress: Callable[[str], None]) -> bool:
        """Whether a controller passes every flight."""
        changed = ", ".join(f"{name} {as_yaml(value)}" for name, value in keys.gains.items())
        progress(f"{keys.name}: {changed}")
        return not any(one.beyond for flight in self._motions(keys, flights, ()) for one in self.fly(keys, flight))

    def fly(self, keys: Controller, flight: Flight) -> list[Finding]:
        """Fly one motion, and return what was looked at, what began earliest first."""
        loop = self._builder(self._loaded(keys, flight.payload, flight.duration))
        trial = SampledTrial(
            loop.controllers[0],
            loop.model,
            flight.reference,
            self.experiment.run.control_period,
            self.experiment.chain,
            loop.drawn,
            None,
            flight.start,
        )
        with np.errstate(all="ignore"):
            flown = self._session.run(loop.plant, trial)
        held = loop.model.gravity(flight.start)
        seen = list(judge(flown, self.arm, self.room, self.experiment.chain, held, flight.settles, flight.duration))
        if flight.pole is not None and flight.pole.rate > GROWS:
            seen += self._growth(flown, flight.pole, any(one.beyond for one in seen))
        found = [one._replace(flight=str(flight)) for one in sorted(seen, key=lambda one: (not one.beyond, one.t))]
        if any(one.beyond and one.reason in RUNS_AWAY for one in found):
            found = [one for one in found if one.reason not in SHAKES]
        return found

    def _growth(self, run: Trajectory, pole: Pole, refused: bool) -> Iterator[Finding]:
        """Yield that a pole grows if the run shows it: it was `refused`, or its last third errs more than that before.

        Args:
            run: A long rest.
            pole: The pole.
            refused: Whether it ends otherwise than a robot would stand.
        """
        before, last = (np.max(np.abs(part)) for part in _thirds(run)) if run.completed else (0.0, 0.0)
        if refused or last > max(before, SWINGS):
            at = f" at {pole.frequency:.3g} Hz" if pole.frequency > 0.0 else ""
            yield Finding("unstable", "", self.arm.joint_names[pole.joint], 0.0, pole.rate, GROWS, f"1/s{at}", True)


def judge(
    run: Trajectory,
    arm: RobotModel,
    room: Room,
    chain: Chain,
    held: Array,
    settles: bool,
    duration: float = DURATION,
) -> Iterator[Finding]:
    """Yield what of a run a robot has to stand, each where it is closest to its limit.

    Args:
        run: The run.
        arm: The arm, without a load.
        room: How far its joints go.
        chain: Its chain; `torque_rate` is where the robot stops, behind a filter of its own if it has one.
        held: Torque that held the arm before, (n,) [N m].
        settles: Whether the motion ends, so that the arm must come to rest.
        duration: Time that was to be flown [s].
    """
    names, tau_max, n, period = arm.joint_names, arm.flat.tau_max, arm.n, float(run.t[1] - run.t[0])
    command = run.tau_law if run.completed else run.tau_law[:-1]
    if len(command):
        rate = None if chain.torque_rate is None else as_vector(chain.torque_rate, n)
        asked, behind = command, ""
        if chain.command_filter is not None:
            asked = filtered(command, held, chain.command_gain(period))
            behind = f" filtered at {chain.command_filter / math.tau:.3g} Hz"
        first = np.abs(asked[:1] - held)
        most = JUMP * tau_max if rate is None else rate * period
        yield _most("jump at start", run.t, names, first, most, f"N m{behind}")
        if rate is not None and len(command) > 1:
            steps = np.abs(np.diff(asked, axis=0)) / period
            yield _most("torque rate", run.t[1:], names, steps, rate, f"N m/s{behind}")
        beyond = np.abs(command) > tau_max
        joint = int(np.argmax(beyond.mean(axis=0)))
        share, t = float(beyond[:, joint].mean()), float(run.t[np.argmax(beyond[:, joint])])
        yield Finding(
            "saturates", "", names[joint], t, 100.0 * share, 100.0 * SATURATED, "% of the time", share >= SATURATED
        )
    fastest = np.array(arm.passive.speed)
    if chain.torque_speed is not None:
        fastest = np.minimum(fastest, as_vector(chain.torque_speed.no_load, n))
    if np.any(np.isfinite(fastest)):
        yield _most("speed", run.t, names, np.abs(run.qd), fastest, "rad/s")
    bounded = np.flatnonzero(np.isfinite(room.low) & np.isfinite(room.high))
    if len(bounded):
        low, high = room.low[bounded], room.high[bounded]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        away = np.abs(run.q[:, bounded] - middle)
        yield _most("range", run.t, [names[i] for i in bounded], away, half, "rad from its middle")
    yield _most("loses the motion", run.t, names, np.abs(run.q_ref - run.q), np.full(n, LOST), "rad of error")
    if not run.completed:
        reason = "diverges" if run.outcome in (Outcome.DIVERGED, Outcome.OUT_OF_RANGE) else "bad torque"
        yield Finding(reason, "", None, float(run.t[-1]), float(run.t[-1]), duration, "s flown", True)
        return
    if settles:
        yield _swing(run, names)
    metrics = from_joints(per_joint(run, tau_max=tau_max, metrics_from=SETTLED, control_period=period, step_like=False))
    shakes = shaking(metrics, tau_max.tolist())
    is_cycle = shakes is not None and shakes.is_cycle and not _moves(run, arm, shakes)
    reason, limit = ("limit cycle", STILL) if is_cycle else ("chatters", ROUGH)
    if shakes is None:
        yield Finding(reason, "", None, SETTLED, metrics.chattering.value or 0.0, limit, "% of tau_max", False)
        return
    unit = "% of tau_max" + (f" at {shakes.frequency:.3g} Hz" if math.isfinite(shakes.frequency) else "")
    refused = is_cycle or shakes.chattering > ROUGH
    yield Finding(reason, "", names[shakes.joint], SETTLED, shakes.chattering, limit, unit, refused)


def _moves(run: Trajectory, arm: RobotModel, shakes: Shaking) -> bool:
    """Whether the motion itself, with each turn of a swing, takes the torque that the arm has at its shaking frequency.

    Args:
        run: The run.
        arm: The arm.
        shakes: How it shakes.
    """
    late = run.t >= SETTLED
    needed = arm.inverse_dynamics(run.q_ref[late], run.qd_ref[late], run.qdd_ref[late])[:, shakes.joint]
    return is_of_motion(run.tau[late, shakes.joint], needed, float(run.t[1] - run.t[0]), shakes.frequency)


def _most(reason: str, t: Array, names: Sequence[str], values: Array, limits: Array, unit: str) -> Finding:
    """Return the joint that first goes beyond its limit and its largest value, else the one closest to it.

    Args:
        reason: A key of `REMEDIES`.
        t: Times, (N,) [s].
        names: Names of the joints.
        values: Values, (N, n).
        limits: Their limits, (n,).
        unit: Of both.
    """
    share = np.nan_to_num(values / limits, nan=np.inf)
    beyond = bool(np.any(share > 1.0))
    k = int(np.argmax(np.max(share, axis=1) > 1.0) if beyond else np.argmax(np.max(share, axis=1)))
    joint = int(np.argmax(share[k]))
    most = float(np.max(values[:, joint]))
    return Finding(reason, "", names[joint], float(t[k]), most, float(limits[joint]), unit, beyond)


def filtered(command: Array, held: Array, taken: float) -> Array:
    """Return commands (N, n) [N m] as a chain filters them: y += taken (u - y).

    Args:
        command: Commands u.
        held: The filter's torque y ahead of the first, (n,) [N m].
        taken: Share of a new command that it takes in [1].
    """
    y, out = held, np.empty_like(command)
    for k, u in enumerate(command):
        out[k] = y = y + taken * (u - y)
    return out


def _is_enough(margins: Margins) -> bool:
    """Whether the phase margin is at least as large as is usual."""
    return margins.phase is not None and margins.phase >= ENOUGH


def _thirds(run: Trajectory) -> tuple[Array, Array]:
    """Return the errors in the middle and the last third of the rest after a small step, (N, n) [rad]."""
    e, k = run.q_ref - run.q, len(run.t) - int(np.searchsorted(run.t, STEP))
    return e[-2 * (k // 3) : -(k // 3)], e[-(k // 3) :]


def _swing(run: Trajectory, names: Sequence[str]) -> Finding:
    """Return how much the joint that swings most still does long after a small step, and whether that fades."""
    before, last = _thirds(run)
    third = len(last) * float(run.t[1] - run.t[0])
    ramp = np.linspace(-1.0, 1.0, len(last))[:, None]
    bent = last - last.mean(axis=0)
    bent = bent - ramp * (np.sum(ramp * bent, axis=0) / np.sum(ramp * ramp))
    turns = np.count_nonzero(np.diff(np.signbit(bent), axis=0), axis=0)
    size = np.where(turns >= TURNS, math.sqrt(2.0) * bent.std(axis=0), 0.0)
    fades = math.sqrt(2.0) * before.std(axis=0) * FADES ** (3.0 * third / (DURATION - STEP)) > size
    joint = int(np.argmax(np.where(fades, 0.0, size)))
    swings = float(size[joint])
    beyond = bool(swings > SWINGS and not fades[joint])
    return Finding("swings", "", names[joint], float(run.t[-len(last)]), swings, SWINGS, "rad", beyond)


def _flights(experiment: Experiment, room: Room, payload: float) -> Iterator[Flight]:
    """Yield the motions: hold, a small step, a slow and a fast swing; from home and elsewhere; without and with load.

    Args:
        experiment, payload: As of `preflight`.
        room: The arm's.
    """
    home = room.home
    elsewhere = home + np.random.default_rng(experiment.run.seed).uniform(-SPREAD, SPREAD, len(home))
    low, high = room.low + SPREAD, room.high - SPREAD
    elsewhere = np.where(low < high, np.clip(elsewhere, low, high), home)
    t = control_instants(round(DURATION / experiment.run.control_period), experiment.run.control_period)
    for name, size, half in (
        ("hold", 0.0, 1.0),
        ("small step", 0.1, STEP),
        ("slow swing", 0.2, 1.0),
        ("fast swing", 0.2, 0.5),
    ):
        for pose, start in (("home", home), ("a drawn position", elsewhere)):
            # away from the nearer end of a range; by turns where there is none
            signs = np.where(high - start > start - low, 1.0, -1.0)
            signs = np.where(np.isfinite(low) & np.isfinite(high), signs, (-1.0) ** np.arange(len(start)))
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


class Room(NamedTuple):
    """Home position of an arm, and the range of its joints."""

    home: Array
    """Keyframe of that name, else zero, (n,) [rad]."""
    low: Array
    """Least position that the arm's file tells, enforced or not, -inf for none, (n,) [rad]."""
    high: Array
    """Greatest, likewise."""


def room_of(source: ArmSource) -> Room:
    """Return where an arm is at home and how far its joints go.

    Raises:
        ModelError: there is no such arm.
    """
    from torquebench.robot import mjcf

    m = mjcf.compile_arm(mjcf.read_arm(source))[0]
    return Room(mjcf.keyframes(m).get("home", np.zeros(m.njnt)), *mjcf.ranges(m))
