"""Path of a law's torque to the joints: rate limit, late commands, drive, current loop, motor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.chain.sensors import nearest_multiple
from torquebench.errors import Fault
from torquebench.kernel import Array, IntArray, clip, kernel
from torquebench.kernel.struct import Structure
from torquebench.keys import Key, Vector, check_numbers
from torquebench.timing import Timing, control_instant


@dataclass(frozen=True)
class CurrentLoop:
    """Torque loop of second order, exact between commands: u'' = frequency^2 (tau - u) - 2 damping frequency u'.

    Raises:
        ValueError: a number is not finite and positive.
    """

    frequency: Annotated[float, Key("Natural frequency", "rad/s", above=0)]
    damping: Annotated[float, Key("Damping ratio", "1", "; 1 is critical", above=0)] = 0.7

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)

    def transition(self, time: float) -> Array:
        """Return the matrix (2, 2) that moves the gap (u - tau, u') on by `time` [s], while tau is held."""
        from scipy.linalg import expm

        w = self.frequency
        moved: Array = expm(time * np.array([[0.0, 1.0], [-w * w, -2.0 * self.damping * w]]))
        return moved


@dataclass(frozen=True)
class TorqueSpeed:
    """Torque that a motor can give at a speed, in four quadrants.

    Where it drives (tau qd > 0), full torque up to the corner speed, then a straight line down to nothing at the speed
    without load, beyond which it gives none. Where it brakes, full torque at any speed: there the back-EMF helps.

    Raises:
        ValueError: a number is not finite and positive.
    """

    corner: Annotated[Vector, Key("Speed up to which the motor gives full torque", "rad/s", at_least=0)]
    no_load: Annotated[Vector, Key("Speed at which it gives none", "rad/s", "; more than corner", above=0)]

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where the line does not fall."""
        if np.any(np.asarray(self.no_load) <= np.asarray(self.corner)):
            yield Fault(("no_load",), "is not more than corner", wanted="more than corner on every joint")


@dataclass(frozen=True)
class ThermalLimit:
    """Torque that a motor can give for ever: above it, it warms up, h' = ((u/torque)^2 - h)/time with h = 0 at first.

    While h >= 1 no more than that torque is given. A constant torque u is cut after -time ln(1 - (torque/u)^2).

    Raises:
        ValueError: a number is not finite and positive.
    """

    torque: Annotated[Vector, Key("Continuous torque", "N m", ", in N for slide joints", above=0)]
    time: Annotated[float, Key("Thermal time constant", "s", above=0)]

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)


@dataclass(frozen=True)
class CrossTalk:
    """Torque that leaks from joint to joint: joint i gets u_i + following u_(i+1) + preceding u_(i-1).

    Raises:
        ValueError: a number is not finite.
    """

    following: Annotated[Vector, Key("Share of the next joint's torque that acts on a joint as well", "1")] = 0.0
    preceding: Annotated[Vector, Key("Share of the torque of the joint before it", "1")] = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)


@dataclass(frozen=True)
class Derating:
    """Motors that weaken in the middle of a run: torque and torque limit fall in a straight line, and stay there.

    Raises:
        ValueError: a number is out of range or not finite.
    """

    at: Annotated[
        float,
        Key("When it begins: a whole multiple of run.control_period, less than run.duration", "s", at_least=0),
    ]
    limit: Annotated[Vector, Key("Share of the torque limit that is left", "1", at_least=0, at_most=1)] = 1.0
    gain: Annotated[Vector, Key("Share of the torque that is left", "1", at_least=0, at_most=1)] = 1.0
    over: Annotated[float, Key("Time over which they fall; 0 for at once", "s", at_least=0)] = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the run."""
        yield from control_instant(("at",), self.at, timing)


@dataclass(frozen=True, eq=False)
class Drives(Structure):
    """The drives of n joints as kernels see them, over N control instants; arrays of no rows stand for none."""

    active: bool
    """Whether any of what follows is there, `taken`, `rate` and `decay` excepted."""
    taken: float
    """Share of a new command that a filter ahead of the rate limit takes in; 1 without one."""
    rate: Array
    """Largest change of the commanded torque from one control instant to the next, (n,) or (0,) [N m]."""
    decay: Array
    """Share of a lag that is left after half a physics step, a whole one, and on average over a control period, (3,) or
    (0,)."""
    late: IntArray
    """Physics steps by which each command is late, more than a control period for a missed one, (N,) or (0,)."""
    commands: Annotated[Array, 2]
    """Commands on their way, in a ring, (d, n), d the command's delay in control periods."""
    quantum: float
    """Commands are rounded to a multiple of this; 0 for none [N m]."""
    gain: Array
    """Factors by which commands are multiplied, (n,) or (0,)."""
    offset: Array
    """Torque that is added to them, (n,) or (0,) [N m]."""
    half: Annotated[Array, 2]
    whole: Annotated[Array, 2]
    """Transition of the current loop's gap over half a physics step and a whole one, (2, 2) or (0, 2)."""
    corner: Array
    no_load: Array
    """Speeds of the torque-speed line, (n,) or (0,) [rad/s]."""
    continuous: Array
    """Continuous torque, (n,) or (0,) [N m]."""
    cooling: float
    """Share of a difference of temperature that is left after a physics step."""
    fade_from: int
    fade_steps: int
    """Physics step at which motors begin to weaken, and over how many they do."""
    weaker: Annotated[Array, 2]
    """Shares of torque limit and torque that are left in the end, (2, n) or (0, n)."""
    leaks: Annotated[Array, 2]
    """Shares of the next joint's torque and of that of the one before that act on a joint, (2, n) or (0, n)."""
    torques: Annotated[Array, 3]
    """Torques on their way to the joints, in a ring, (d, 3, n), d the torque's delay in physics steps."""
    target: Array
    """Command that the drives have received, (n,) [N m]."""
    held: Array
    """Command that they follow, (n,) [N m]."""
    rising: Array
    """Rate of change of the current loop's torque, (n,) [N m/s]."""
    heat: Array
    """Share of the temperature that the continuous torque leads to, (n,)."""

    @property
    def states(self) -> tuple[Array, ...]:
        """Arrays that a run moves on; all zero at its start."""
        return self.commands, self.torques, self.target, self.held, self.rising, self.heat


@kernel
def command(drives: Drives, k: int, tau_law: Array, before: Array, tau_max: Array, tau: Array) -> None:
    """Fill `tau` (n,) with the command of control instant k: the law's torque within its limits, filtered, then slewed.

    A filter goes on from the command before, as a robot's does that stops beyond its rate: y += taken (u - y).

    Args:
        drives: The drives.
        k: Number of the control instant; the first command is neither filtered nor limited in rate.
        tau_law: The law's torque, (n,) [N m].
        before: Command of the instant before, (n,) [N m].
        tau_max: Torque limits, (n,) [N m].
        tau: The command, filled.
    """
    limited, filtered = k > 0 and len(drives.rate) > 0, k > 0 and drives.taken < 1.0
    for i in range(len(tau)):
        x = clip(tau_law[i], tau_max[i])
        if filtered:
            x = before[i] + drives.taken * (x - before[i])
        if limited:
            x = before[i] + clip(x - before[i], drives.rate[i])
        tau[i] = x


@kernel
def receive(drives: Drives, k: int, tau: Array) -> None:
    """Take in the command `tau` (n,) of control instant k: late, rounded, scaled and shifted, it becomes the target.

    Until the first command has arrived that one is taken, as if the arm had been held there; so nothing is held back at
    k = 0.
    """
    ring, target = drives.commands, drives.target
    for i in range(len(tau)):
        x = tau[i]
        if len(ring) > 0:
            slot = k % len(ring)
            if k == 0:
                for j in range(len(ring)):
                    ring[j, i] = x
            ring[slot, i], x = x, ring[slot, i]
        if drives.quantum > 0.0:
            x = nearest_multiple(x, drives.quantum)
        if len(drives.gain) > 0:
            x *= drives.gain[i]
        if len(drives.offset) > 0:
            x += drives.offset[i]
        target[i] = x
        if k == 0:
            drives.held[i] = x


@kernel
def most_torque(drives: Drives, i: int, u: float, qd: float, tau_max: float) -> float:
    """Return the most that a motor gives in the direction of a torque [N m].

    Args:
        drives: The drives.
        i: The joint.
        u: The torque [N m].
        qd: Speed of the joint [rad/s].
        tau_max: Its torque limit [N m].
    """
    most = tau_max
    if len(drives.corner) > 0 and u * qd > 0.0:
        left = (drives.no_load[i] - abs(qd)) / (drives.no_load[i] - drives.corner[i])
        if left < 1.0:
            most = tau_max * left if left > 0.0 else 0.0
    if len(drives.continuous) > 0 and drives.heat[i] >= 1.0 and drives.continuous[i] < most:
        most = drives.continuous[i]
    return most


@kernel
def faded_at(drives: Drives, step: int) -> float:
    """Return how far motors have weakened at a physics step: 0 before, 1 in the end."""
    if step < drives.fade_from:
        return 0.0
    gone: float = 1.0 if drives.fade_steps == 0 else (step - drives.fade_from) / drives.fade_steps
    return gone if gone < 1.0 else 1.0


@kernel
def leak(shares: Array, u: Array) -> None:
    """Add to the torques `u` (n,) [N m] what they get of their neighbours'; see `CrossTalk`."""
    before, n = 0.0, len(u)
    for i in range(n):
        own = u[i]
        if i + 1 < n:
            u[i] += shares[0, i] * u[i + 1]
        u[i] += shares[1, i] * before
        before = own


@kernel
def drive(
    drives: Drives,
    step: int,
    qd: Array,
    tau_max: Array,
    output: Array,
    torque: Array,
) -> None:
    """Fill `torque` (3, n) [N m] with what the motors give at the start, middle and end of a physics step.

    The speed and the temperature at its start decide what they can give.

    Args:
        drives: The drives; moved on by the step.
        step: Number of the physics step since the start of the run.
        qd: Velocity at its start, (n,) [rad/s].
        tau_max: Torque limits, (n,) [N m].
        output: Torque of the current loop, (n,) [N m]; moved on.
        torque: Filled.
    """
    first_order, second_order = len(drives.decay) > 0, len(drives.half) > 0
    fading = len(drives.weaker) > 0
    limited = fading or len(drives.corner) > 0 or len(drives.continuous) > 0
    ring, faded = drives.torques, faded_at(drives, step) if fading else 0.0
    for i in range(len(qd)):
        goal = drives.held[i]
        if second_order:
            gap, rising = output[i] - goal, drives.rising[i]
            torque[0, i] = output[i]
            torque[1, i] = goal + drives.half[0, 0] * gap + drives.half[0, 1] * rising
            output[i] = goal + drives.whole[0, 0] * gap + drives.whole[0, 1] * rising
            drives.rising[i] = drives.whole[1, 0] * gap + drives.whole[1, 1] * rising
            torque[2, i] = output[i]
        elif first_order:
            gap = output[i] - goal
            torque[0, i] = output[i]
            torque[1, i] = goal + gap * drives.decay[0]
            output[i] = goal + gap * drives.decay[1]
            torque[2, i] = output[i]
        else:
            torque[0, i] = torque[1, i] = torque[2, i] = goal
        if limited:
            full, share = tau_max[i], 1.0
            if fading:
                full *= 1.0 + faded * (drives.weaker[0, i] - 1.0)
                share += faded * (drives.weaker[1, i] - 1.0)
            for stage in range(3):
                u = share * torque[stage, i]
                torque[stage, i] = clip(u, most_torque(drives, i, u, qd[i], full))
            if len(drives.continuous) > 0:
                load = torque[0, i] / drives.continuous[i]
                load *= load
                drives.heat[i] = load + (drives.heat[i] - load) * drives.cooling
        if len(ring) > 0:
            slot = step % len(ring)
            for stage in range(3):
                if step == 0:
                    for j in range(len(ring)):
                        ring[j, stage, i] = torque[0, i]
                ring[slot, stage, i], torque[stage, i] = torque[stage, i], ring[slot, stage, i]
    if len(drives.leaks) > 0:
        for stage in range(3):
            leak(drives.leaks, torque[stage])
