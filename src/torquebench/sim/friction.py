"""Joint friction: Coulomb's and viscous, Stribeck's curve, a part that grows with the load, and LuGre's bristles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from torquebench.chain import Origin
from torquebench.chain.robots import TOOLBOX
from torquebench.errors import Fault
from torquebench.kernel import Array, kernel, sat
from torquebench.kernel.struct import Structure
from torquebench.kernel.twin import Column, on_columns
from torquebench.keys import Key, Units, Vector, declared_keys, in_words
from torquebench.registry import Registry
from torquebench.robot.robot_model import Passive
from torquebench.timing import Timing

SPEED = 0.01
"""Speed above which Coulomb friction is fully developed [rad/s]."""
STRIBECK = 0.1
"""Speed over which friction falls from break-away to Coulomb's, an assumption [rad/s]."""
SERIES = tuple(factor * 10.0**power for power in range(-8, 10) for factor in (1.0, 2.0, 5.0))
"""Round numbers, for what is chosen or proposed."""
SPEEDS = tuple(x for x in SERIES if 0.009 < x < 51.0)
"""Such speeds for the friction that an arm has of its own: the least that the integrator can follow [rad/s]."""
STABLE = {"rk4": 2.785, "euler": 2.0}
"""Largest (rate of decay) x (time step) at which an integrator decays: the end of its stability interval."""
RINGING = 1.0
"""Largest (frequency of joints on their bristles) x (time step) [rad]; from 2 on the motion would grow."""
POSES = 300


class FrictionError(ValueError):
    """Friction does not fit the arm or the time step."""


class SteepError(FrictionError):
    """Friction is too steep near standstill for the time step."""


@dataclass(frozen=True, eq=False)
class Resistance(Structure):
    """Friction as kernels see it; arrays of no elements stand for none."""

    viscous: Array
    """Viscous friction, (n,) [N m s/rad]."""
    coulomb: Array
    """Coulomb friction, (n,) [N m]."""
    speed: float
    """Speed above which Coulomb friction is fully developed [rad/s]."""
    excess: Array
    """Break-away torque beyond Coulomb friction, (n,) [N m]."""
    stribeck_speed: float
    """Speed over which that fades [rad/s]."""
    load: Array
    """Share of the torque at the joint that adds to Coulomb friction where it drives, (n,) [1]."""
    held: Array
    """Likewise where it holds the motion back, (n,) [1]."""
    bristle_stiffness: Array
    """LuGre's sigma_0, (n,) [N m/rad]; (0,) for friction that is a function of velocity, and so for the next two."""
    bristle_damping: Array
    """LuGre's sigma_1, (n,) [N m s/rad]."""
    bristles: Array
    """Their deflection z, the state of the friction, (n,) [rad]."""
    steep: Array
    """Steepest rise of friction with velocity, near standstill at the torque limits, (n,) [N m s/rad]."""


_NONE = np.zeros(0)
NONE = Resistance(_NONE, _NONE, 1.0, _NONE, 1.0, _NONE, _NONE, _NONE, _NONE, _NONE, _NONE)


@kernel
def level(friction: Resistance, i: int, qd: float, torque: float) -> float:
    """Return g = coulomb + (breakaway - coulomb) exp(-(qd/stribeck_speed)^2) + load |torque| of joint `i` [N m].

    Where the torque holds the motion back, torque qd < 0, `held` takes the place of `load`.

    Args:
        friction: The friction.
        i: Number of the joint.
        qd: Its velocity [rad/s].
        torque: Torque at it [N m].
    """
    g: float = friction.coulomb[i]
    if friction.excess[i] > 0.0:
        x = qd / friction.stribeck_speed
        g += friction.excess[i] * math.exp(-(x * x))
    if friction.load[i] > 0.0 or friction.held[i] > 0.0:
        g += (friction.load[i] + (friction.held[i] - friction.load[i]) * (torque * qd < 0.0)) * abs(torque)
    return g


@kernel
def resist(friction: Resistance, qd: Array, torque: Array, net: Array) -> None:
    """Fill `net` with `torque` minus the friction at velocity `qd`, each (n,) [N m, rad/s].

    Friction is viscous qd + g sat(qd/speed), see `level`; with bristles viscous qd + sigma_0 z + sigma_1 dz/dt, where
    dz/dt = qd - sigma_0 |qd| z / g and z is what `drag_along` made of it for this time step.
    """
    for i in range(len(qd)):
        g = level(friction, i, qd[i], torque[i])
        if len(friction.bristles) == 0:
            drag = friction.viscous[i] * qd[i] + g * sat(qd[i] / friction.speed)
        elif g > 0.0:
            bent = friction.bristle_stiffness[i] * friction.bristles[i]
            drag = friction.viscous[i] * qd[i] + bent + friction.bristle_damping[i] * (qd[i] - abs(qd[i]) * bent / g)
        else:
            drag = friction.viscous[i] * qd[i]
        net[i] = torque[i] - drag


@kernel
def drag_along(friction: Resistance, qd: Array, torque: Array, h: float) -> None:
    """Bend the bristles, if there are any, for the coming time step, before its first stage.

    dz/dt = qd - sigma_0 |qd| z / g has at constant velocity and g the solution z = zs + (z0 - zs) exp(-sigma_0 |qd| h /
    g), zs = g sgn(qd) / sigma_0, which overshoots at no time step. With the velocity and g at the start z stands half a
    step ahead of the joints, as velocities do in the leapfrog method, and that is of second order as well.

    Args:
        friction: The friction; its bristles are moved.
        qd: Velocity at the start of the step, (n,) [rad/s].
        torque: Torque there, (n,) [N m].
        h: Time step [s].
    """
    for i in range(len(friction.bristles)):
        g = level(friction, i, qd[i], torque[i])
        stiffness = friction.bristle_stiffness[i]
        if g > 0.0 and qd[i] != 0.0:
            end = (g if qd[i] > 0.0 else -g) / stiffness
            friction.bristles[i] = end + (friction.bristles[i] - end) * math.exp(-stiffness * abs(qd[i]) * h / g)


def steady(friction: Resistance, qd: Array, torque: Array) -> Array:
    """Return the friction of joints that move steadily, (N, n) [N m].

    Args:
        friction: The friction; of bristles the curve on which they slide.
        qd: Velocities, (N, n) [rad/s].
        torque: Torque at the joints there, (N, n) [N m].
    """
    on, each = on_columns(level), zip(qd.T.copy().view(Column), torque.T.copy().view(Column), strict=True)
    g = np.stack([np.broadcast_to(on(friction, i, v, tau), len(qd)) for i, (v, tau) in enumerate(each)], axis=1)
    rising = np.sign(qd) if len(friction.bristles) else np.clip(qd / friction.speed, -1.0, 1.0)
    drag: Array = friction.viscous * qd + g * rising
    return drag


def own_bristles(friction: Resistance) -> Resistance:
    """Return the same friction with bristles that are shared with no other plant."""
    return replace(friction, bristles=friction.bristles.copy())


@dataclass(frozen=True)
class Friction:
    """Friction of the joints, of which the belief knows nothing: viscous qd + g sat(qd/speed).

    g is `coulomb`; with `breakaway` more near standstill, with `load` more under load; with `bristle_stiffness`
    bristles take the place of the line through zero. Where neither `viscous` nor `coulomb` is given both are the arm's.

    One number for all joints, or one for each; an array is as good. Below `speed` friction falls linearly to zero,
    because the sign function has no meaning inside a Runge-Kutta step. A joint therefore creeps under a torque that
    would not move it; on bristles it does not.

    Raises:
        ValueError: a number is negative or not finite, a speed is zero, or a share of the load is 1 or more.
    """

    viscous: Annotated[
        Vector,
        Key(
            "Viscous friction",
            "N m s/rad",
            ", in N s/m for slide joints; with neither this nor coulomb given, both are the arm's",
            at_least=0,
        ),
    ] = 0.0
    coulomb: Annotated[
        Vector,
        Key(
            "Coulomb friction",
            "N m",
            ", in N for slide joints; that of the PUMA is the word puma560 in place of these keys",
            at_least=0,
        ),
    ] = 0.0
    speed: Annotated[
        float,
        Key(
            "Speed above which Coulomb friction is fully developed; below it falls linearly to zero, so that a joint "
            "at rest creeps; without meaning on bristles",
            "rad/s",
            ", in m/s for slide joints",
            above=0,
        ),
    ] = SPEED
    breakaway: Annotated[
        Vector,
        Key(
            "Torque that sets a joint at rest in motion, at least its Coulomb friction; 0 for no more than that",
            "N m",
            ", in N for slide joints",
            at_least=0,
        ),
    ] = 0.0
    stribeck_speed: Annotated[
        float,
        Key(
            "Speed over which friction falls from breakaway to coulomb, by exp(-(qd/stribeck_speed)^2)",
            "rad/s",
            ", in m/s for slide joints",
            above=0,
        ),
    ] = STRIBECK
    load: Annotated[
        Vector,
        Key(
            "Share of the torque that motor and disturbance give a joint which its Coulomb friction grows by",
            "1",
            at_least=0,
            below=1,
        ),
    ] = 0.0
    load_backdriving: Annotated[
        Vector | None,
        Key(
            "That share where the torque holds the motion back, as gears have another efficiency when they are driven "
            "from behind: 1/eta - 1 for an efficiency eta, 1 - eta for load; if left out it is load",
            "1",
            at_least=0,
        ),
    ] = None
    bristle_stiffness: Annotated[
        Vector,
        Key(
            "Stiffness of a joint at rest on the bristles of LuGre's friction, which then sticks instead of creeping; "
            "0 for no bristles, on all joints alike",
            "N m/rad",
            ", in N/m for slide joints",
            at_least=0,
        ),
    ] = 0.0
    bristle_damping: Annotated[
        Vector, Key("Damping of those bristles", "N m s/rad", ", in N s/m for slide joints", at_least=0)
    ] = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no friction."""
        for name, _, _, key, _ in declared_keys(Friction):
            given = getattr(self, name)
            if given is None:
                continue
            for x in np.asarray(given, dtype=np.float64).ravel().tolist():
                if (wanted := key.fault(x)) is not None:
                    raise ValueError(f"friction: {name} is {given}, wanted {wanted}")

    @property
    def name(self) -> str:
        """The word for it in a config, if there is one."""
        return "none" if self == FRICTIONS["none"] else ""

    @property
    def is_partial(self) -> bool:
        """Whether viscous and Coulomb friction are taken from the arm, as other keys are given and neither of these."""
        more = (self.speed, self.stribeck_speed) != (SPEED, STRIBECK) or np.any(self.bristle_damping)
        return not (np.any(self.viscous) or np.any(self.coulomb)) and bool(more or not self.is_line)

    @property
    def is_line(self) -> bool:
        """Whether the friction is viscous qd + coulomb sat(qd/speed) and no more."""
        return not (np.any(self.breakaway) or self.bears or np.any(self.bristle_stiffness))

    @property
    def bears(self) -> bool:
        """Whether the friction grows with the load."""
        return bool(np.any(self.load) or np.any(self.held))

    @property
    def held(self) -> Vector:
        """Share of a torque that holds the motion back [1]."""
        return self.load if self.load_backdriving is None else self.load_backdriving

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where there is no friction, or where its keys contradict each other."""
        if self is not FRICTIONS["none"] and self.name:
            yield Fault((), "neither viscous nor coulomb is given: write none, or leave it out for the arm's own")
        if np.any(self.breakaway) and not self.speed < self.stribeck_speed and not np.any(self.bristle_stiffness):
            text = f"is {self.stribeck_speed:g} rad/s, where friction still rises linearly"
            yield Fault(("stribeck_speed",), text, wanted=f"more than speed, {self.speed:g} rad/s")
        if np.any(self.bristle_damping) and not np.any(self.bristle_stiffness):
            yield Fault(("bristle_damping",), "there are no bristles", wanted="a bristle_stiffness beside it")

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        if self.name:
            return "no friction"
        per = units.viscous.rpartition("/")[2]
        parts = [f"friction viscous {in_words(self.viscous)} {units.viscous}"]
        parts.append(f"Coulomb {in_words(self.coulomb)} {units.torque}")
        if np.any(self.breakaway):
            fades = f"fading over {self.stribeck_speed:g} {per}/s"
            parts.append(f"break-away {in_words(self.breakaway)} {units.torque} {fades}")
        if np.any(self.load):
            parts.append(f"{in_words(self.load)} of the torque")
        if self.load_backdriving is not None:
            parts.append(f"{in_words(self.held)} of one that holds back")
        if np.any(self.bristle_stiffness):
            parts.append(f"on bristles of {in_words(self.bristle_stiffness)} {units.torque}/{per}")
        return ", ".join(parts)

    def of_joints(self, n: int, tau_max: Array | float = 0.0) -> Resistance:
        """Return it for kernels, the bristles straight.

        Args:
            n: Number of joints.
            tau_max: Torque up to which the part that grows with the load is followed, (n,) [N m].

        Raises:
            ValueError: it has numbers for another count of joints than `n`, a break-away torque is below Coulomb
                friction, some joints have bristles and others none, or bristles bear nothing but the load.
        """
        each = {}
        for name in ("viscous", "coulomb", "breakaway", "load", "held", "bristle_stiffness", "bristle_damping"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.shape not in ((), (n,)):
                raise FrictionError(f"friction: {name} has shape {values.shape}, wanted one number or {n}")
            each[name] = np.array(np.broadcast_to(values, (n,)))
        viscous, coulomb, breakaway, load, held, stiffness, damping = each.values()
        share = np.maximum(load, held)
        for i in np.flatnonzero((breakaway > 0.0) & (breakaway < coulomb)).tolist():
            raise FrictionError(
                f"breakaway of joint {i + 1} is {breakaway[i]:g}, wanted at least its coulomb, "
                f"{coulomb[i]:g}, or 0 for no more than that"
            )
        excess = np.where(breakaway > 0.0, breakaway - coulomb, 0.0)
        most = coulomb + excess + share * np.where(share > 0.0, tau_max, 0.0)
        if np.any(stiffness) and not np.all(stiffness):
            raise FrictionError(f"bristle_stiffness is {self.bristle_stiffness}, wanted more than 0 everywhere, or 0")
        if np.any(stiffness):
            for i in np.flatnonzero((share > 0.0) & (coulomb == 0.0)).tolist():
                raise FrictionError(f"coulomb of joint {i + 1} is 0, wanted more than 0 where bristles bear a load")
            bent = most / np.where(
                coulomb > 0.0, coulomb, 1.0
            )  # as they may be when g falls, over what g holds them to
            steep, bristles = viscous + damping * (1.0 + bent), np.zeros(n)
        else:
            steep, bristles = viscous + most / self.speed, _NONE
            stiffness, damping = np.zeros(0), np.zeros(0)
        for array in (viscous, coulomb, excess, load, held, stiffness, damping, steep):
            array.setflags(write=False)
        return Resistance(
            viscous,
            coulomb,
            float(self.speed),
            excess,
            float(self.stribeck_speed),
            load,
            held,
            stiffness,
            damping,
            bristles,
            steep,
        )


FRICTIONS: Registry[Friction] = Registry("friction")
"""Friction by a word: none, whatever the arm's file says, or that of a known arm."""
PUMA_MOTORS = (
    (-62.6111, 1.48e-3, 0.395, -0.435),
    (107.815, 0.817e-3, 0.126, -0.071),
    (-53.7063, 1.38e-3, 0.132, -0.105),
    (76.0364, 71.2e-6, 11.2e-3, -16.9e-3),
    (71.923, 82.6e-6, 9.26e-3, -14.5e-3),
    (76.686, 36.7e-6, 3.96e-3, -10.5e-3),
)
"""Gear ratio G [1], viscous friction B [N m s/rad] and Coulomb friction Tc in both directions [N m], at the motors.

Source: Corke and Armstrong-Helouvry (ICRA 1994), as the robotics toolbox has it, see docs/chains.md.
"""


def _at_joints(motors: tuple[tuple[float, float, float, float], ...]) -> Friction:
    """Return viscous friction B G^2 and the mean of both directions of Coulomb friction times G, to three digits."""
    return Friction(
        tuple(float(f"{B * G**2:.3g}") for G, B, _, _ in motors),
        tuple(float(f"{(abs(one) + abs(other)) / 2.0 * abs(G):.3g}") for G, _, one, other in motors),
    )


PUMA = _at_joints(PUMA_MOTORS)
"""That of the PUMA 560 at its joints."""
_COULOMB = np.asarray(PUMA.coulomb)
FRICTIONS.register("none", Friction())
FRICTIONS.register("puma560", PUMA)
FRICTIONS.register(
    "puma560-sticking",
    replace(
        PUMA,
        breakaway=tuple((1.5 * _COULOMB).tolist()),
        bristle_stiffness=tuple((1000.0 * _COULOMB).tolist()),
        bristle_damping=tuple((5.0 * _COULOMB).tolist()),
    ),
)

FRICTION_ORIGINS = {
    "puma560": Origin(
        "Corke and Armstrong-Helouvry (ICRA 1994), from motors to joints: viscous B G^2, the mean of both Coulomb Tc G",
        TOOLBOX,
    ),
    "puma560-sticking": Origin("that of puma560; assumed: break-away of 1.5 times Coulomb friction, and its bristles"),
}
"""Friction with a name -> where its numbers are from."""


def acting(
    given: Friction | None,
    own: Passive,
    masses: Callable[[Array], Array],
    timestep: float,
    integrator: str,
    tau_max: Array,
) -> tuple[Friction | None, Resistance]:
    """Return the friction of a plant's joints, also for kernels: the given one, else the arm's own.

    Coulomb friction of its own is fully developed above the least of `SPEEDS` that the integrator can follow, unless a
    speed is given, or bristles, which need none.

    Args:
        given: What is asked for; None for what the arm's file says.
        own: What the arm's file says.
        masses: Returns the mass matrices at positions (N, n), (N, n, n) [kg m^2].
        timestep, integrator: Integration step [s] and the integrator's name.
        tau_max: Torque limits, (n,) [N m].

    Raises:
        FrictionError: it does not fit the arm, or is too steep near standstill for the time step.
    """
    n = len(own.viscous)
    if given is None and not own.rubs:
        return None, NONE
    friction, is_own = given or Friction(), given is None or given.is_partial
    if is_own:
        if not own.rubs and not (friction.bears or np.any(friction.breakaway)):
            raise FrictionError(
                "neither viscous nor coulomb is given, and the arm's file gives its joints neither: wanted one of them"
            )
        viscous, coulomb = (each[0] if len(set(each)) == 1 else each for each in (own.viscous, own.coulomb))
        friction = replace(friction, viscous=viscous, coulomb=coulomb)
    resistance, M = friction.of_joints(n, tau_max), masses(poses(n))
    if is_own and friction.speed == SPEED and any(own.coulomb) and len(resistance.bristles) == 0:
        for speed in SPEEDS:
            friction = replace(friction, speed=speed)
            resistance = friction.of_joints(n, tau_max)
            if decay(resistance, M) * timestep <= STABLE[integrator]:
                break
    try:
        check_stable(resistance, M, timestep, integrator)
    except SteepError as error:
        raise SteepError(f"of the arm's own: {error}, or `friction: none`" if is_own else str(error)) from error
    return friction, resistance


def poses(n: int) -> Array:
    """Return the positions at which `check_stable` wants the mass matrix, (POSES, n) [rad]."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, n))


def check_stable(friction: Resistance, mass_matrix: Array, timestep: float, integrator: str) -> None:
    """Refuse friction that is too steep near standstill for the time step.

    There it is a damping of `Resistance.steep`; the joints' velocities then decay at the eigenvalues of M^-1
    diag(steep), and an explicit integrator can follow a decay only up to `STABLE` per time step. Joints that stick on
    bristles ring at the roots of the eigenvalues of M^-1 diag(sigma_0), which `drag_along` follows up to `RINGING`.

    Args:
        friction: The friction.
        mass_matrix: At `poses`, (POSES, n, n) [kg m^2].
        timestep: Integration step [s].
        integrator: Name of the integrator.

    Raises:
        SteepError: at one of the poses the decay or the ringing is faster.
    """
    if (fastest := decay(friction, mass_matrix)) * timestep > STABLE[integrator]:
        raise SteepError(
            f"friction near standstill decays at up to {fastest:.3g} 1/s, and {integrator} follows "
            f"{STABLE[integrator] / timestep:.3g} 1/s at a time step of {timestep:g} s: wanted a shorter time step, "
            f"{_step_for(STABLE[integrator] / fastest)}"
            f"{_flatter(friction, mass_matrix, timestep, STABLE[integrator] / timestep)}"
        )
    if len(friction.bristles) == 0:
        return
    if (fastest := math.sqrt(_fastest(friction.bristle_stiffness, mass_matrix))) * timestep > RINGING:
        raise SteepError(
            f"joints at rest on their bristles ring at up to {fastest:.3g} rad/s, and a time step of {timestep:g} s "
            f"follows {RINGING / timestep:.3g} rad/s: wanted a shorter time step, {_step_for(RINGING / fastest)}, or "
            f"a bristle_stiffness of at most {(RINGING / timestep / fastest) ** 2:.2g} times that"
        )


def _step_for(most: float) -> str:
    step = max((x for x in SERIES if x <= most), default=most)
    return f"plant.timestep of {step:g} s or less"


def _flatter(friction: Resistance, mass_matrix: Array, timestep: float, most: float) -> str:
    """Return proposals of friction that decays at no more than `most` [1/s], as far as there is any."""
    if len(friction.bristles) > 0:
        return ", or less bristle_damping"
    if _fastest(friction.viscous, mass_matrix) > most:
        return ", or less viscous friction"
    rising = (friction.steep - friction.viscous) * friction.speed
    speeds = (x for x in SERIES if x > friction.speed)
    speed = next((x for x in speeds if _fastest(friction.viscous + rising / x, mass_matrix) <= most), SERIES[-1])
    stiff = (RINGING / timestep) ** 2 / _fastest(np.ones(len(rising)), mass_matrix)
    stiff = max((x for x in SERIES if x <= stiff), default=stiff)
    return (
        f", or a higher speed than {friction.speed:g} rad/s, `speed: {speed:g}`, or bristles, on which joints stick, "
        f"`bristle_stiffness: {stiff:g}`"
    )


def decay(friction: Resistance, mass_matrix: Array) -> float:
    """Return the fastest decay of a joint's velocity near standstill [1/s]; arguments as of `check_stable`."""
    return _fastest(friction.steep, mass_matrix)


def _fastest(factor: Array, mass_matrix: Array) -> float:
    """Return the largest eigenvalue of M^-1 diag(factor)."""
    rates = np.abs(np.linalg.eigvals(np.linalg.solve(mass_matrix, np.broadcast_to(np.diag(factor), mass_matrix.shape))))
    return float(rates.max())
