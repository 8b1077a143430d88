"""Gains that suit an arm: from each joint's torque limit, and from what its inertia can stand at the control period.

In one period T a linear term D s of a law moves s by T M^-1 D s: the sampled loop rings from T rho(M^-1 D) = 1 on, and
is unstable from 2 on. One that answers after a time r has r in place of T. So the terms of a law share

    r D_i <= SHARE I_i,    I_i = min over poses of 1 / (a_ii sum_j |a_ij| / sqrt(a_ii a_jj)),    a = M^-1,

by which r rho(M^-1 D) <= SHARE at each of the poses: D M^-1 is similar to a matrix whose row i, in size, sums to at
most D_i / I_i. The rest follows: a law that holds s within a layer phi = lambda ERROR may have K = SHARE phi I / r.

A joint that the arm's file damps by b stands more: in a time r its velocity goes to tau / b as 1 - exp(-r b / I), so
that r b / (1 - exp(-r b / I)) is in place of I. What its file says of friction, F = coulomb + b x 2 rad/s, gains are
made to overcome: slopes may be quicker, and K is beyond F. What they leave of it, `friction_text` says.

Drives that give g N m for 1 N m of a law (`chain.torque_gain`) make all that the arm takes, I, M, gravity, b and F, 1/g
of it to the law. What they leak from joint to joint, and how they weaken on the way, is not looked at.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from torquebench.kernel import Array
from torquebench.keys import Vector
from torquebench.robot.flat_model import SLIDE
from torquebench.robot.robot_model import RobotModel

SHARE = 0.8
"""Share of s by which all linear terms of a law together may move it in the time that the loop takes to answer [1]."""
QUICKEST = 20.0
"""Largest slope lambda [1/s]."""
ERROR = 0.005
"""Error of a joint at the edge of its layer [rad]."""
BRAKED = 0.1
"""Error that the torque limit alone must be able to brake along the slope [rad]."""
MOST = 0.3
"""Largest share of the torque limit that switches against what a model leaves over [1]."""
HELD = 0.25
"""Share of the torque beyond gravity's that a law without a model uses [1]."""
CRAWL = 0.02
"""Speed above which what a law believes of Coulomb friction is full [rad/s]."""
OVERCOME = 1.5
"""Torque that switches or holds against the friction of an arm's file, over this friction [1]."""
RUBBED = 2.0
"""Speed at which that friction is looked at [rad/s]: that of a brisk motion."""
POSES = 200
"""Random poses at which the arm is looked at, besides that at zero."""
REACH = 0.5
"""Largest displacement of slide joints in these poses, either way [m]."""
DIGITS = 3
"""Significant digits of a gain that is chosen."""
ROUNDING = 0.01
"""Relative change of a gain by rounding it, at most [1]."""


@dataclass(frozen=True)
class Limits:
    """Limits of an arm's joints, and of the demands that a law may make on them, (n,) each."""

    tau_max: Array
    """Torque limit [N m]."""
    least: Array
    """I, the least inertia that the terms of a law on all joints meet [kg m^2]; see the module."""
    heaviest: Array
    """Largest inertia M_ii, the other joints held [kg m^2]."""
    gravity: Array
    """Largest torque of gravity [N m]."""
    scale: Array
    """Inertia scale Mbar of the model [kg m^2]."""
    viscous: Array
    """Viscous friction of the arm's file [N m s/rad]."""
    coulomb: Array
    """Coulomb friction of the arm's file [N m]."""

    def behind(self, drives: Array) -> Limits:
        """Return the limits of the arm as it is to a law whose torque the drives multiply: all it takes is over that.

        Args:
            drives: Torque of each joint's drive for 1 N m of the law's, (n,) [1].
        """
        arm = self.least, self.heaviest, self.gravity, self.viscous, self.coulomb
        least, heaviest, gravity, viscous, coulomb = (of_joints / drives for of_joints in arm)
        return Limits(self.tau_max, least, heaviest, gravity, self.scale, viscous, coulomb)

    @property
    def drag(self) -> Array:
        """Friction of the arm's file at `RUBBED` [N m]."""
        return self.coulomb + RUBBED * self.viscous

    @property
    def friction(self) -> Array:
        """F, `drag`, at most what gravity leaves of the limit over `OVERCOME` [N m]."""
        return np.minimum(self.drag, self.spare / OVERCOME)

    def stands(self, reaction: float) -> Array:
        """Return the inertia that a term of a law seems to meet, I where the file has no damping [kg m^2].

        Args:
            reaction: Time until the loop answers [s].
        """
        damped = reaction * np.where(self.viscous > 0.0, self.viscous, 1.0)
        return np.where(self.viscous > 0.0, damped / -np.expm1(-damped / self.least), self.least)

    @property
    def spare(self) -> Array:
        """Torque beyond gravity's [N m]; a tenth of the limit at least."""
        return np.maximum(self.tau_max - self.gravity, 0.1 * self.tau_max)


@functools.lru_cache(maxsize=4)
def limits_of(model: RobotModel) -> Limits:
    """Return the limits of an arm, from its dynamics at zero and at random poses."""
    flat, reach = model.flat, np.where(model.flat.kind == SLIDE, REACH, np.pi)
    q = np.concatenate([np.zeros((1, model.n)), np.random.default_rng(0).uniform(-reach, reach, (POSES, model.n))])
    M = model.mass_matrix(q)
    heaviest = np.max(np.diagonal(M, axis1=1, axis2=2), axis=0)
    return Limits(
        flat.tau_max,
        least_inertia(M),
        heaviest,
        np.max(np.abs(model.gravity(q)), axis=0),
        flat.inertia_scale,
        np.array(model.passive.viscous),
        np.array(model.passive.coulomb),
    )


def least_inertia(M: Array) -> Array:
    """Return I of the module's text for mass matrices (N, n, n), (n,) [kg m^2]."""
    mobility = np.linalg.inv(M)
    own = np.diagonal(mobility, axis1=1, axis2=2)
    shared = np.sum(np.abs(mobility) / np.sqrt(own[:, :, None] * own[:, None, :]), axis=2)
    least: Array = np.min(1.0 / (own * shared), axis=0)
    return least


@dataclass
class Fit:
    """A law on an arm, as the rules of its gains see it: ``fit["lam"]`` is a gain that was given or is chosen."""

    limits: Limits
    """Those of the arm behind its drives."""
    reaction: float
    """Time from a change of the state to the torque that answers it [s]; see `Chain.reaction`."""
    control_period: float
    """Time between control instants [s]."""
    rules: Mapping[str, Rule]
    """Gains that act in the law -> their rules."""
    has_model: bool
    """Whether the law cancels the arm's dynamics with its model."""
    drives: Array
    """Torque of each joint's drive for 1 N m of the law's, which `limits` have in them, (n,) [1]."""
    known: dict[str, Array] = field(default_factory=dict)
    """Gains that were given, and those chosen so far, (n,)."""

    def __contains__(self, name: str) -> bool:
        return name in self.rules

    def __getitem__(self, name: str) -> Array:
        if name not in self.known:
            self.known[name] = rounded(self.rules[name](self))
        return self.known[name]

    @property
    def whole(self) -> Array:
        """The most that the law's linear terms may be together [N m s/rad]."""
        return SHARE * self.limits.stands(self.reaction) / self.reaction

    @property
    def terms(self) -> int:
        """Number of the law's linear terms."""
        return sum(rule in TERMS for rule in self.rules.values())

    @property
    def room(self) -> Array:
        """The most that one of them may be, D_i [N m s/rad]: `whole` is divided among them."""
        return self.whole / max(self.terms, 1)

    @property
    def answered(self) -> Array:
        """Acceleration of the arm for 1 rad/s^2 that a law of accelerations asks for, (n,) [1]."""
        return self.drives if self.has_model else np.ones_like(self.drives)

    @property
    def lam(self) -> Array:
        """Slope of the law, or the one that would do for a law without [1/s]."""
        return self["lam"] if "lam" in self.rules else slope(self)


Rule: TypeAlias = Callable[[Fit], Array]
"""From a law on an arm to a gain, (n,)."""


def rounded(x: Array) -> Array:
    """Return numbers with `DIGITS` significant digits."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in x])


def pole(fit: Fit) -> Array:
    """Slope of a law that cancels the dynamics: SHARE / (4 r), at most 20, and such that 0.1 rad can be braked.

    Where that leaves friction an error of more than `ERROR` it is quicker than 20: lambda D `ERROR` = F, with D =
    4 lambda M, or what there is room for of a law's linear terms. Beside a given rate kV of an acceleration it is at
    most kV / 4.
    """
    limits = fit.limits
    asked = np.sqrt(limits.friction / (4.0 * ERROR * limits.heaviest))
    if fit.terms:
        asked = np.maximum(asked, limits.friction / (ERROR * fit.whole))
    most = braked(limits)
    if fit.rules.get("kv") is acceleration_rate and "kv" in fit.known:
        most = np.minimum(most, fit.known["kv"] * fit.answered / 4.0)
    return np.minimum(most, np.minimum(np.maximum(QUICKEST, asked), SHARE / (4.0 * fit.reaction)))


def braked(limits: Limits) -> Array:
    """Largest slope along which torque limit and damping brake `BRAKED`: M lambda^2 e = spare + b lambda e [1/s]."""
    half = limits.viscous / (2.0 * limits.heaviest)
    slowed: Array = half + np.sqrt(half * half + limits.spare / (limits.heaviest * BRAKED))
    return slowed


def friction_text(fit: Fit, names: Sequence[str], slides: Sequence[bool], given: Collection[str] = ()) -> str:
    """Return what gains leave of the friction of the arm's file, and what keeps it from less; nothing below `ERROR`.

    It is F / (lambda D) where a term D s holds s = de + lambda e: D = K / phi + Kd; of a stiffness Kp it is F / Kp.

    Args:
        fit: A law with its gains.
        names: The joints.
        slides: Which of them slide.
        given: Gains that were not chosen.
    """
    limits, known, held = fit.limits, fit.known, np.zeros_like(fit.limits.tau_max)
    if {"lam", "k", "phi"} <= known.keys():
        held = known["lam"] * known["k"] * limits.tau_max / known["phi"]
    if "lam" in known and fit.rules.get("kv") is rate:
        held = held + known["lam"] * known["kv"] * limits.scale
    lam, drag = known.get("lam", np.zeros_like(held)), limits.drag
    if fit.rules.get("kp") is stiffness:
        held, lam = known["kp"], known["kp"] / known["kd"]
    left = np.divide(drag, held, out=np.zeros_like(drag), where=held > 0.0)
    worst = int(np.argmax(left))
    if left[worst] <= (1.0 + ROUNDING) * ERROR:
        return ""
    small, speed = ("mm", "m/s") if slides[worst] else ("mrad", "rad/s")
    if drag[worst] > limits.spare[worst]:
        why = "friction is more than gravity leaves of the torque limit"
    elif own := [name for name in ("lam", "k", "phi", "kv", "kp", "kd") if name in given]:
        why = f"so it is with {' and '.join(own)} as given"
    elif left[worst] <= (1.0 + 2.0 * ROUNDING) * ERROR * drag[worst] / limits.friction[worst]:
        why = f"friction is more than gravity leaves of the torque limit, over {OVERCOME:g}"
    elif lam[worst] >= (1.0 - ROUNDING) * braked(limits)[worst]:
        why = f"a quicker slope is more than the torque limit brakes {BRAKED:g} {small.removeprefix('m')} along"
    else:
        why = f"slope and damping are the most that a reaction of {1e3 * fit.reaction:.3g} ms stands"
    sums = any(rule in SUMS and name in known and known[name][worst] > 0.0 for name, rule in fit.rules.items())
    until = ", until its integral takes that up" if sums else ""
    return (
        f"friction of the arm's file leaves about {1e3 * left[worst]:.3g} {small} of {names[worst]} "
        f"at {RUBBED:g} {speed}{until}: {why}"
    )


def slope(fit: Fit) -> Array:
    """Slope: `pole`; without a model at most D / M, beyond which the heaviest inertia is damped by less than 0.5."""
    if fit.has_model:
        return pole(fit)
    limits = fit.limits
    damper = fit.known["kv"] * limits.scale if "kv" in fit.known else fit.whole
    return np.minimum(pole(fit), (damper + limits.viscous) / limits.heaviest)


def damping(fit: Fit) -> Array:
    """Rate gain Kd: 4 lambda M of the heaviest inertia, as far as there is room.

    Where friction asks for more, so that lambda Kd `ERROR` = F, it is that. Beside a given Kp it damps that
    critically: 2 sqrt(Kp M).
    """
    limits = fit.limits
    if fit.rules.get("kp") is stiffness and "kp" in fit.known:
        return np.minimum(2.0 * np.sqrt(fit.known["kp"] * limits.heaviest), fit.room)
    lam = fit.known["lam"] if "lam" in fit.known else pole(fit)
    wanted = np.maximum(4.0 * lam * limits.heaviest, limits.friction / (ERROR * lam))
    return np.minimum(wanted, fit.room)


def stiffness(fit: Fit) -> Array:
    """Position gain Kp = lambda Kd: `pole`, at most D / M, beyond which the heaviest inertia is damped too little."""
    damper = fit["kd"] + fit.limits.viscous
    return fit["kd"] * np.minimum(pole(fit), damper / fit.limits.heaviest)


def rate(fit: Fit) -> Array:
    """Rate gain kV of a torque Kd = kV Mbar: `damping`."""
    return damping(fit) / fit.limits.scale


def acceleration_rate(fit: Fit) -> Array:
    """Rate gain kV of an acceleration: 4 lambda, critically damped, over what the drives make of it."""
    return 4.0 * fit.lam / fit.answered


def integral(fit: Fit) -> Array:
    """Integral gain kI = kV lambda^2 / 4: with kV = 4 lambda three real poles, at 0.38, 1 and 2.6 lambda.

    Beside given gains by which the rate decays at w < lambda it is kV lambda w / 4, a quarter of what is stable, in a
    law that has no other damping.
    """
    kv, lam, limits = fit["kv"] if "kv" in fit else rate(fit), fit.lam, fit.limits
    if fit.terms > 1:
        return kv * lam**2 / 4.0
    decay = kv * fit.answered if fit.rules.get("kv") is acceleration_rate else kv * limits.scale / limits.heaviest
    decay = decay + limits.viscous / limits.heaviest
    return kv * lam * np.where(decay < (1.0 - 2.0 * ROUNDING) * lam, decay, lam) / 4.0


def pull(fit: Fit) -> Array:
    """Slope of the error's integral in a surface: lambda^2 / 4, critically damped."""
    return fit.lam**2 / 4.0


def robust(fit: Fit) -> Array:
    """Gain k of K = k tau_max against what a model leaves over: K = D phi with D the room; at most 0.3.

    Where the arm's file has friction, at least `OVERCOME` times that.
    """
    phi, limits = fit.known["phi"] if "phi" in fit.known else ERROR * fit.lam, fit.limits
    return np.maximum(np.minimum(MOST, fit.room * phi / limits.tau_max), OVERCOME * limits.friction / limits.tau_max)


def holding(fit: Fit) -> Array:
    """Gain k of K = k tau_max that carries the arm: gravity's torque, friction's, a quarter of the rest.

    With a model it is `robust`.
    """
    if fit.has_model:
        return robust(fit)
    limits = fit.limits
    held = limits.gravity + limits.friction + HELD * (limits.spare - limits.friction)
    return np.minimum(1.0, held / limits.tau_max)


def switching(fit: Fit) -> Array:
    """Gain k: `robust` where a model or another term carries the arm, else `holding`."""
    return robust(fit) if fuzzy_torque in fit.rules.values() else holding(fit)


def fuzzy_torque(fit: Fit) -> Array:
    """Gain kF: `holding`."""
    return holding(fit)


def width(fit: Fit) -> Array:
    """Layer phi: `ERROR` times lambda, and so wide that K / phi has room."""
    return _wide(fit, ("k", "kf"))


def fuzzy_width(fit: Fit) -> Array:
    """Rate that a fuzzy system sees as 1: as `width`, for KF."""
    return _wide(fit, ("kf", "k"))


def _wide(fit: Fit, fractions: tuple[str, ...]) -> Array:
    name = next((name for name in fractions if name in fit), None)
    lam = fit.lam
    least = ERROR * lam
    if name is None:
        return least
    wide = fit[name] * fit.limits.tau_max / fit.room
    return np.where(wide > (1.0 + ROUNDING) * least, wide, least)


def error_width(fit: Fit) -> Array:
    """Error that a fuzzy system sees as 1: the rate that it sees as 1, over lambda."""
    own = next((name for name in ("gd", "phi") if name in fit), None)
    return (fuzzy_width(fit) if own is None else fit[own]) / fit.lam


def slow_integral(of: str) -> Rule:
    """Return a rule for the integral that a fuzzy system sees as 1: 4 / lambda times the width `of` its other input."""

    def rule(fit: Fit) -> Array:
        return 4.0 * fit[of] / fit.lam

    return rule


def twist(fit: Fit) -> Array:
    """Gain k1: at the edge of the layer, |s| = lambda `ERROR`, Mbar k1 / |s|^1/2 is what there is room for."""
    return fit.room * np.sqrt(ERROR * fit.lam) / fit.limits.scale


def twist_rate(fit: Fit) -> Array:
    """Gain k2 = k1^2 Mbar / (4 M), half of what critically damps the heaviest inertia near s = 0."""
    return fit["k1"] ** 2 * fit.limits.scale / (4.0 * fit.limits.heaviest)


def slow_pull(fit: Fit) -> Array:
    """Gain of the integral of s: kV^2 Mbar / (8 M), half of what leaves s critically damped on the heaviest inertia."""
    return fit["kv"] ** 2 * fit.limits.scale / (8.0 * fit.limits.heaviest)


def slow_forgetting(fit: Fit) -> Array:
    """Rate lambda / 40: slow beside the integral that it forgets."""
    return fit.lam / 40.0


def turn_width(fit: Fit) -> Array:
    """Rate of s that a fuzzy system sees as 1: twice what K does to I, over `SHARE`; from half of it on rules ring."""
    return 2.0 * fit["k"] * fit.limits.tau_max / (SHARE * fit.limits.least)


def delayed_inertia(fit: Fit) -> Array:
    """Inertia m of time-delay control: m Mbar / T is what there is room for."""
    return fit.control_period * fit.room / fit.limits.scale


def integrating_slope(fit: Fit) -> Array:
    """Slope of time-delay control: `pole`, at most D / (8 M), so that kV = 4 lambda is half of what the law reaches."""
    return np.minimum(pole(fit), fit.room / (8.0 * fit.limits.heaviest))


def observed_slope(fit: Fit) -> Array:
    """Slope of a law with a momentum observer: two thirds of `pole`, as its 4 lambda shares with L = 2 lambda."""
    return pole(fit) / 1.5


def residual_pole(fit: Fit) -> Array:
    """Pole of the momentum observer: 2 lambda, the double pole that kV = 4 lambda makes."""
    return 2.0 * fit.lam


def observing_slope(fit: Fit) -> Array:
    """Slope of a law with an extended-state observer: `pole`, at most D / (4 M); see `observed_inertia`."""
    return np.minimum(pole(fit), fit.room / (4.0 * fit.limits.heaviest))


def observing_pole(fit: Fit) -> Array:
    """Pole of the extended-state observer: 10 lambda, five times the double pole that kV = 4 lambda makes."""
    return 10.0 * fit.lam


def observed_inertia(fit: Fit) -> Array:
    """Inertia m that an extended-state observer takes: the heaviest, at most D / (wo/3 + kV).

    Beyond 2 lambda and below 3 wo the observer and its law are a rate gain of about (wo/3 + kV) m Mbar.
    """
    own = fit.room / (fit["wo"] / 3.0 + fit["kv"])
    return np.minimum(own, fit.limits.heaviest) / fit.limits.scale


def costly_error(fit: Fit) -> Array:
    """Error that costs as much as the torque limit: P = D lambda, at most D^2 / (4 M), as a double pole has it."""
    rate_gain = damping(fit)
    return fit.limits.tau_max / (rate_gain * np.minimum(pole(fit), rate_gain / (4.0 * fit.limits.heaviest)))


def costly_rate(fit: Fit) -> Array:
    """Rate that costs as much: so that D, of the heaviest inertia M, is `damping`: (tau_max / rate)^2 = D^2 - 2 M P."""
    rate_gain, stiff = damping(fit), fit.limits.tau_max / fit["error"]
    least = 0.25 * rate_gain * rate_gain
    return fit.limits.tau_max / np.sqrt(np.maximum(least, rate_gain * rate_gain - 2.0 * fit.limits.heaviest * stiff))


def learning(fit: Fit) -> Array:
    """Rate gamma of a law that learns the links: what a mean link weighs is learnt at lambda / 2.

    A number's torque y makes it swing with sqrt(gamma y^2 / M); y is taken as the torque of gravity and a quarter of
    the rest, on that joint of those before the link for which gamma is the least.
    """
    limits = fit.limits
    each = 0.25 * fit.lam**2 * limits.heaviest / (limits.gravity + HELD * limits.spare) ** 2
    return np.minimum.accumulate(each)


def none(fit: Fit) -> Array:
    """Zero: the part is left out."""
    return np.zeros_like(fit.limits.tau_max)


def crawl(fit: Fit) -> Array:
    """Speed of 0.02 rad/s, below which a sign is smoothed."""
    return np.full_like(fit.limits.tau_max, CRAWL)


def as_much(fit: Fit) -> Array:
    """One: as much again."""
    return np.ones_like(fit.limits.tau_max)


TERMS = (rate, damping, switching, fuzzy_torque)
"""Rules of gains that make a linear term near s = 0."""

SUMS = (integral, pull, slow_pull)
"""Rules of gains that sum up an error: what friction leaves fades."""

BY_UNIT: Mapping[str, Rule] = {
    "1/s": slope,
    "1": switching,
    "rad/s": width,
    "rad": error_width,
    "1/s^2": pull,
    "1/s^3": integral,
}
"""Unit -> the rule of a gain that says nothing else."""

Search: TypeAlias = tuple[float, float, Literal["log", "linear"]]
"""Range in which tuning looks for a gain: least, greatest, and whether equal ratios or equal steps weigh alike."""

BOXES: Mapping[str, Search] = {
    "1/s": (1.0, 200.0, "log"),
    "1": (0.001, 1.0, "log"),
    "rad/s": (0.01, 10.0, "log"),
    "rad": (0.001, 1.0, "log"),
}
"""Unit -> box of a gain that declares none, one number for all joints: of units that mean the same on every arm."""
MULTIPLES: Search = (0.1, 10.0, "log")
"""Box of a gain of another unit, such as N m/rad: multiples of what ``gains: auto`` chooses for each joint."""


def choose(fit: Fit) -> dict[str, Vector]:
    """Return the gains of a law: one number where all joints have the same, else a tuple."""
    chosen = {name: fit[name].tolist() for name in fit.rules}
    return {name: x[0] if len(set(x)) == 1 else tuple(x) for name, x in chosen.items()}
