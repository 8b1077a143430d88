"""Joints that give: a motor turns its link through a spring, a damper and a gap, and has a state of its own.

A plant integrates the states of its joints together with those of its links, at every stage of the Runge-Kutta method:
`begin` before the first stage, where it bends the bristles of their friction too, `transmit` for the torques and rates
at each, `advance` after each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

import numpy as np

from torquebench.kernel import Array, kernel
from torquebench.kernel.struct import Structure
from torquebench.keys import Key, Units, Vector, as_vector, check_numbers, in_words
from torquebench.sim.friction import Resistance, drag_along, poses, resist

FASTEST = 1.0
"""Largest (frequency) x (time step) of an oscillation [rad]: there rk4 adds 0.7 % of critical damping of its own."""
DECAY = 2.785
"""Largest (rate) x (time step) of a decay that rk4 follows: the end of its stability interval."""


class SpringError(ValueError):
    """The joints are no such joints, or too fast for the time step."""


@dataclass(frozen=True, eq=False)
class Joints(Structure):
    """Joints as kernels see them; `state` has no rows where they have no state, and then the plant is rigid."""

    stiffness: Array
    """Stiffness k of the spring, (n,) [N m/rad]; (0,) for rigid joints, and so for the next three."""
    damping: Array
    """Damping d beside it, (n,) [N m s/rad]."""
    inertia: Array
    """Inertia B of the motor as seen at the joint, (n,) [kg m^2]."""
    gap: Array
    """Half the backlash, (n,) [rad]."""
    state: Annotated[Array, 2]
    """States of the joints, (rows, n): position [rad] and velocity [rad/s] of the motors."""
    rate: Annotated[Array, 2]
    """Their rates, (rows, n), as `transmit` leaves them."""
    work: Annotated[Array, 3]
    """Working memory: the states at the start of a step, and the weighted sum of the rates, (2, rows, n)."""


def rigid(n: int) -> Joints:
    """Return `n` joints without states of their own."""
    none = np.zeros(0)
    return Joints(none, none, none, none, np.zeros((0, n)), np.zeros((0, n)), np.zeros((2, 0, n)))


def own_states(joints: Joints) -> Joints:
    """Return the same joints with states that are shared with no other plant."""
    return replace(joints, state=joints.state.copy(), rate=joints.rate.copy(), work=joints.work.copy())


def motors_in(joints: Joints) -> Array:
    """Return position [rad] and velocity [rad/s] of the motors, (2, n), not copied; (0, n) where joints are rigid."""
    return joints.state[: 2 if len(joints.stiffness) > 0 else 0]


@kernel
def pressed(joints: Joints, i: int, wound: float, speed: float) -> float:
    """Return the torque by which motor `i` turns its link [N m]: k wound + d speed, and nothing within the gap.

    Flanks of a gap press and never pull: where the damper would hold them together as they part, there is no torque.

    Args:
        joints: The joints.
        i: Number of the joint.
        wound: How far the motor is ahead of the link [rad]; of that the gap is taken off.
        speed: How much faster it turns [rad/s].
    """
    gap: float = joints.gap[i]
    if gap > 0.0:
        if abs(wound) <= gap:
            return 0.0
        wound -= gap if wound > 0.0 else -gap
    torque: float = joints.stiffness[i] * wound + joints.damping[i] * speed
    if gap > 0.0 and torque * wound < 0.0:
        return 0.0
    return torque


@kernel
def transmit(joints: Joints, friction: Resistance, q: Array, qd: Array, torque: Array, net: Array) -> None:
    """Fill `net` (n,) [N m] with the torque on the links, and ``joints.rate`` with the rates of the joints' states.

    B thdd = tau - friction(thd) - tau_J with tau_J = k (th - q) + d (thd - qd) on the links (Spong 1987, Trans. ASME J.
    Dyn. Syst. Meas. Control 109(4), 310-319): the rotor turns about its own axis as if the link below stood still.

    Args:
        joints: The joints, at their states.
        friction: Friction; it acts on the motors.
        q, qd: Position [rad] and velocity [rad/s] of the links, (n,).
        torque: Torque of the motors, (n,) [N m].
        net: The result; may be `torque`.
    """
    theta, thetad = joints.state[0], joints.state[1]
    if len(friction.viscous) > 0:
        resist(friction, thetad, torque, net)
    else:
        for i in range(len(q)):
            net[i] = torque[i]
    for i in range(len(q)):
        through = pressed(joints, i, theta[i] - q[i], thetad[i] - qd[i])
        joints.rate[0, i] = thetad[i]
        joints.rate[1, i] = (net[i] - through) / joints.inertia[i]
        net[i] = through


@kernel
def begin(joints: Joints, friction: Resistance, qd: Array, torque: Array, h: float) -> None:
    """Begin a Runge-Kutta step at the joints' states, and bend the bristles of their friction for it.

    Args:
        joints: The joints, at their states.
        friction: Friction of the motors, which are the links where joints are rigid.
        qd: Velocity of the links, (n,) [rad/s].
        torque: Torque of the motors at the start of the step, (n,) [N m].
        h: Step [s].
    """
    if len(joints.state) > 0:
        drag_along(friction, joints.state[1], torque, h)
    else:
        drag_along(friction, qd, torque, h)
    for row in range(len(joints.state)):
        for i in range(len(joints.state[row])):
            joints.work[0, row, i] = joints.state[row, i]
            joints.work[1, row, i] = 0.0


@kernel
def advance(joints: Joints, stage: int, h: float) -> None:
    """Move the joints' states on to the next stage of a step of length `h` [s]; after stage 3 to the end of it."""
    weight = 2.0 if stage == 1 or stage == 2 else 1.0
    ahead = h if stage == 2 else 0.5 * h
    for row in range(len(joints.state)):
        for i in range(len(joints.state[row])):
            rate = joints.rate[row, i]
            total = joints.work[1, row, i] + weight * rate
            joints.work[1, row, i] = total
            joints.state[row, i] = joints.work[0, row, i] + (h / 6.0 * total if stage == 3 else ahead * rate)


@dataclass(frozen=True)
class Transmission:
    """What lies between the motors and the links, of which the belief knows nothing: springs, dampers and gaps.

    Each key is one number for all joints, or one for each.

    Raises:
        ValueError: a number is out of range or not finite.
    """

    stiffness: Annotated[
        Vector, Key("Stiffness of each joint between motor and link", "N m/rad", ", in N/m for slide joints", above=0)
    ]
    damping: Annotated[
        Vector, Key("Damping beside the spring", "N m s/rad", ", in N s/m for slide joints", at_least=0)
    ] = 0.0
    inertia: Annotated[
        Vector | None,
        Key(
            "Inertia of the motors as seen at the joints; if left out the armature of the arm's file. Either way the "
            "links lose that armature",
            "kg m^2",
            ", in kg for slide joints",
            above=0,
        ),
    ] = None
    backlash: Annotated[
        Vector,
        Key(
            "Width of the gap within which the motor turns and neither spring nor damper acts",
            "rad",
            ", in m for slide joints",
            at_least=0,
        ),
    ] = 0.0
    sensor: Annotated[
        Literal["motor", "link"], Key("Side on which position and velocity are measured; metrics are of the link")
    ] = "motor"

    def __post_init__(self) -> None:
        """Refuse what is no transmission."""
        check_numbers(self)
        if self.sensor not in ("motor", "link"):
            raise ValueError(f"transmission: sensor is {self.sensor!r}, wanted motor or link")

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        per = units.viscous.rpartition("/")[2]
        parts = [f"joints of stiffness {in_words(self.stiffness)} {units.torque}/{per}"]
        if any(np.atleast_1d(self.damping)):
            parts.append(f"damping {in_words(self.damping)} {units.viscous}")
        if any(np.atleast_1d(self.backlash)):
            parts.append(f"backlash {in_words(self.backlash)} {per}")
        return ", ".join([*parts, f"sensors on the {self.sensor}s"])

    def motors(self, armature: Array) -> Array:
        """Return the inertia of the motors, (n,) [kg m^2], of an arm of this armature (n,).

        Raises:
            SpringError: it is neither given nor the arm's.
        """
        if self.inertia is not None:
            return np.array(as_vector(self.inertia, len(armature)))
        if not np.all(armature > 0.0):
            bare = ", ".join(str(i + 1) for i in np.flatnonzero(armature <= 0.0))
            raise SpringError(f"the arm's file gives joints {bare} no armature: wanted `inertia`, that of the motors")
        return np.array(armature)

    def of_joints(self, armature: Array) -> Joints:
        """Return it for kernels, on an arm of this armature (n,) [kg m^2]; errors as of `motors`.

        Raises:
            ValueError: it has numbers for another count of joints.
        """
        n = len(armature)
        for name in ("stiffness", "damping", "inertia", "backlash"):
            values = np.asarray(0.0 if getattr(self, name) is None else getattr(self, name))
            if values.shape not in ((), (n,)):
                raise ValueError(f"transmission: {name} has shape {values.shape}, wanted one number or {n}")
        k, d, gap = (np.array(as_vector(x, n)) for x in (self.stiffness, self.damping, self.backlash))
        return Joints(k, d, self.motors(armature), 0.5 * gap, np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, 2, n)))


JOINTS: Mapping[str, None] = {"rigid": None}
"""Joints by a word: rigid, where a case of a sweep takes the transmission away."""


def moved_by(
    transmission: Transmission | None, armature: Array, arm: Callable[[Array], Array]
) -> Callable[[Array], Array]:
    """Return the function that has the masses (N, n, n) on which friction acts: the arm's, or the motors alone.

    Args:
        transmission: What lies between motors and links, if anything.
        armature: The arm's, (n,) [kg m^2].
        arm: Returns the mass matrices of the arm at positions (N, n), (N, n, n) [kg m^2].
    """
    if transmission is None:
        return arm
    B = np.diag(transmission.motors(armature))
    return lambda q: np.broadcast_to(B, (len(q), *B.shape))


def settle(joints: Joints, q: Array, load: Array) -> None:
    """Put the motors at rest where they hold links at rest at `q` (n,) [rad] against `load` (n,) [N m]."""
    if len(joints.stiffness) > 0:
        pressed_on = np.abs(load) > 1e-9 * np.max(np.abs(load))  # what rounding leaves of no load stays amid the gap
        joints.state[0] = q + load / joints.stiffness + joints.gap * np.sign(load) * pressed_on
        joints.state[1] = 0.0


class Mode(NamedTuple):
    """A motion of motors against links."""

    rate: complex
    """Its eigenvalue [1/s]."""
    joint: int
    """The joint whose motor or link moves most in it."""


def modes(joints: Joints, friction: Resistance, masses: Array) -> list[Mode]:
    """Return the fastest motion at each of some poses: eigenvalues of the free joints about rest.

    Args:
        joints: The joints.
        friction: Friction of the motors, at its steepest and, on bristles, its stiffest.
        masses: Mass matrices of the links, (N, n, n) [kg m^2].
    """
    n, N = len(joints.inertia), len(masses)
    K, D = np.diag(joints.stiffness), np.diag(joints.damping)
    steep, held = (x if len(x) else np.zeros(n) for x in (friction.steep, friction.bristle_stiffness))
    A, B = np.zeros((N, 4 * n, 4 * n)), joints.inertia[:, None]
    A[:, : 2 * n, 2 * n :] = np.eye(2 * n)  # states q, th, qd, thd
    A[:, 2 * n : 3 * n] = np.linalg.solve(masses, np.broadcast_to(np.hstack([-K, K, -D, D]), (N, n, 4 * n)))
    A[:, 3 * n :] = np.hstack([K, -K - np.diag(held), D, -D - np.diag(steep)]) / B
    values, ways = np.linalg.eig(A)
    worst = np.argmax(np.abs(values), axis=1)
    at = np.arange(N)
    moving = np.abs(ways[at, 2 * n :, worst]).reshape(N, 2, n).max(axis=1)
    return [Mode(complex(values[i, worst[i]]), int(np.argmax(moving[i]))) for i in at]


def check_followed(joints: Joints, friction: Resistance, masses: Callable[[Array], Array], timestep: float) -> None:
    """Refuse joints that are too fast for the time step of the Runge-Kutta method.

    Args:
        joints: The joints.
        friction: Their friction.
        masses: Returns the mass matrices of the links alone at positions (N, n), (N, n, n) [kg m^2].
        timestep: Integration step [s].

    Raises:
        SpringError: at one of 300 poses a motion is faster than it follows; says the largest time step that does.
    """
    if len(joints.stiffness) == 0:
        return
    found = modes(joints, friction, masses(poses(len(joints.stiffness))))
    worst = max(found, key=lambda mode: abs(mode.rate))
    swings = abs(worst.rate.imag) > 1e-9 * abs(worst.rate)
    most = FASTEST if swings else DECAY
    if abs(worst.rate) * timestep > most:
        largest = most / abs(worst.rate)
        digit = 10.0 ** (math.floor(math.log10(largest)) - 1)
        moves = f"rings at {abs(worst.rate) / math.tau:.3g} Hz" if swings else f"settles at {abs(worst.rate):.3g} 1/s"
        raise SpringError(
            f"joint {worst.joint + 1} {moves}, too fast for rk4 at a time step of {timestep:g} s: wanted a "
            f"plant.timestep of at most {digit * math.floor(largest / digit):.2g} s, or a softer joint"
        )
