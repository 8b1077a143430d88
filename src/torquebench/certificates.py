"""Stability certificates along a run: Lyapunov function, its rate, the reaching condition and the reaching time.

Everything is computed from the stored trajectory and the true arm's mass matrix, so that it holds whatever else acted:
payload, friction and disturbances count through the acceleration they caused. Source: equations (90)-(91), (108)-(109),
(122)-(124) and (142)-(144) of the paper; Slotine and Li, Applied Nonlinear Control, 1991, section 7.3 and 9.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.trajectory import Trajectory

LONGER = "vacuous: longer than the run"
"""Of a bound on the reaching time: the run may have ended before."""


class FigureInfo(NamedTuple):
    """A headline figure of a certificate, as in ``certificates.json`` and in the table of a sweep that certifies."""

    unit: str
    meaning: str


FIGURES: Mapping[str, FigureInfo] = {
    "V_max": FigureInfo("J", "largest V, (108)"),
    "share_outside": FigureInfo("1", "share of instants with a joint outside its layer"),
    "share_rising_outside": FigureInfo("1", "share of those in which V rises"),
    "least_eta_over_K": FigureInfo("1", "least eta_i / K_i, (124), of a joint outside its layer"),
    "reaching_time": FigureInfo("s", "time from the largest V until every joint is in its layer"),
    "set_point_rising": FigureInfo("1", "share of instants outside the layer in which the V of (142) rises, at rest"),
    "set_point_zeta": FigureInfo("N m", "least zeta of (144) outside the layer, at rest"),
}


class Arm(Protocol):
    """Dynamics of the true arm; row k of every argument and result belongs to control instant k of a run."""

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix, (N, n, n) [kg m^2]."""
        ...

    def bias_forces(self, q: Array, qd: Array) -> Array:
        """Coriolis, centrifugal and gravity torque, (N, n) [N m]."""
        ...

    def sliding_terms(self, q: Array, qd: Array, s: Array) -> tuple[Array, Array, Array]:
        """Mass matrix M, C(q, qd) s, and gravity torque; see `RobotModel.sliding_terms`."""
        ...


@dataclass(frozen=True, slots=True)
class Phases:
    """An arm that takes up a payload: an `Arm` with one model before instant `at` and another from then on."""

    first: RobotModel
    later: RobotModel
    at: int
    """Control instant from which the second model holds."""

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix, (N, n, n) [kg m^2]."""
        return np.concatenate([self.first.mass_matrix(q[: self.at]), self.later.mass_matrix(q[self.at :])])

    def bias_forces(self, q: Array, qd: Array) -> Array:
        """Coriolis, centrifugal and gravity torque, (N, n) [N m]."""
        k = self.at
        return np.concatenate([self.first.bias_forces(q[:k], qd[:k]), self.later.bias_forces(q[k:], qd[k:])])

    def sliding_terms(self, q: Array, qd: Array, s: Array) -> tuple[Array, Array, Array]:
        """Mass matrix M, C(q, qd) s, and gravity torque; see `RobotModel.sliding_terms`."""
        parts = (self.first, slice(0, self.at)), (self.later, slice(self.at, None))
        M, turning, g = zip(*(arm.sliding_terms(q[own], qd[own], s[own]) for arm, own in parts), strict=True)
        return np.concatenate(M), np.concatenate(turning), np.concatenate(g)


@dataclass(frozen=True, slots=True)
class SlidingLaw:
    """Parameters of a law that the certificates use: s = de + lambda e, its switching gain and its model."""

    lam: Array
    """Slope lambda, (n,) [1/s]."""
    K: Array
    """Switching gain, (n,) [N m]."""
    phi: Array | None
    """Half-width of the boundary layer, (n,) [rad/s]; None for a law that switches."""
    belief: RobotModel | None
    """Model of the law's equivalent control; None for a law without one."""
    Kp: Array | None = None
    """Position gain of the law's linear term, (n,) [N m/rad]; None for a law without one, which has no (142)."""
    Kd: Array | None = None
    """Rate gain of that term, (n,) [N m s/rad]."""


class TooWide(NamedTuple):
    """A joint whose layer is so wide that a certificate shows nothing of it."""

    joint: int
    """Its number, from 1."""
    layer: float
    """Half-width of the layer [rad/s]."""
    phi: float | None
    """That of the law [rad/s]; None for a law that switches."""
    error: float
    """Error at the edge of the layer, where the joint rests, layer / lambda [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """Certificates at the control instants but the last, (N-1, ...)."""

    K: Array
    """Switching gain, (n,) [N m]."""
    t: Array
    """Control instants [s]."""
    s: Array
    """True sliding variable s = de + lambda e, (N-1, n) [rad/s]."""
    V: Array
    """Lyapunov function V = s' M s / 2, (108) [J]; the energy that the arm would have at the velocity s."""
    V_rate: Array
    """Mean of dV/dt over the control period, (109), (s + T ds/2)' (M ds + C s) [W]; without jumps of the reference."""
    demand: Array
    """Torque that the law must exceed beyond its equivalent control, (123): |M ds + C s + tau - tau_eq|, (N-1, n)
    [N m]."""
    margin: Array
    """K less the demand, (N-1, n) [N m]: the eta_i of (124) of a law that adds K sgn(s) to its equivalent control; an
    integral, a fuzzy part or a saturated torque can take from it."""
    eta: Array
    """The eta_i of (124) as it came out, whatever the law: -sgn(s_i) (M ds + C s)_i, (N-1, n) [N m]."""
    K_u: Array
    """K_u of (122) as printed, |M ds| + |C s| + |g|, its greatest value on the run, (n,) [N m]."""
    layer: Array
    """|s| within which a joint counts as sliding, (n,) [rad/s]: phi, and at least what K moves s before
    the loop answers, |M^-1| K times `Chain.reaction`."""
    reaching_from: float | None
    """Instant of the largest V outside the layer, from which the reaching time counts [s]; None when nothing ever is
    outside, so that nothing was reached."""
    reaching_time: float | None
    """Time from there until every joint is in its layer for the first time [s]; infinite when that never happens."""
    reaching_bound: float | None
    """Bound on it, sqrt(2 V max sum |M_ij|) / min(-V_rate / sum |s|); infinite when V grew on the way."""
    set_point: SetPoint | None = None
    """The paper's own function for its law, (142), while the desired position stands still; None for other laws."""
    too_wide: tuple[TooWide, ...] = ()
    """Joints of which nothing is shown: what K moves s before the loop answers is over `WIDE` phi, or, without a phi,
    over lambda times the joint's motion."""

    @property
    def covers_nothing(self) -> bool:
        """Whether every joint is in `too_wide`."""
        return len(self.too_wide) == len(self.K)

    @property
    def outside(self) -> npt.NDArray[np.bool_]:
        """Whether any joint is outside its layer, (N-1,), so that (124) demands something."""
        return outside_of(self.s, self.layer)

    @property
    def is_vacuous(self) -> bool:
        """Whether the certificate shows nothing: no joint is ever outside its layer, or every layer is too wide."""
        return self.covers_nothing or not self.outside.any()

    @property
    def no_bound(self) -> str | None:
        """Reason, in words, why there is no bound on the reaching time; None where there is one that says something."""
        if self.covers_nothing:
            return "vacuous: the layer is too wide"
        if self.reaching_bound is None:
            return "vacuous: nothing is ever outside the layer"
        if math.isinf(self.reaching_bound):
            return "none: V grew on the way"
        length = float(self.t[-1] - self.t[0])
        return LONGER if self.reaching_bound > length else None

    @property
    def least_eta(self) -> float | None:
        """Least eta_i / K_i of a joint outside its layer; None if none ever is. 1 where nothing opposes K."""
        outside = np.abs(self.s) > self.layer
        return float(np.min((self.eta / self.K)[outside])) if outside.any() else None

    @property
    def figures(self) -> dict[str, float]:
        """Return those of `FIGURES` that there are."""
        facts = self.to_json()
        own = facts["set_point"] or {}
        facts |= {"set_point_rising": own.get("share_rising_outside"), "set_point_zeta": own.get("least_zeta")}
        return {key: float(facts[key]) for key in FIGURES if facts[key] is not None}

    def to_json(self) -> dict[str, Any]:
        """Return the headline figures; infinite times are None."""
        k, joint = np.unravel_index(int(np.argmin(self.margin)), self.margin.shape)
        outside = self.outside
        rising = outside & (self.V_rate > 0.0)
        time = None if self.covers_nothing else self.reaching_time
        rises = float(np.sum(rising) / np.sum(outside)) if not self.is_vacuous else None
        return {
            "vacuous": self.is_vacuous,
            "V_max": float(np.max(self.V)),
            "V_rate_max_outside": float(np.max(self.V_rate[outside])) if outside.any() else None,
            "share_outside": float(np.mean(outside)),
            "share_rising_outside": rises,
            "least_eta_over_K": self.least_eta,
            "worst_margin": {"value": float(self.margin[k, joint]), "joint": int(joint) + 1, "t": float(self.t[k])},
            "margin_min": [float(x) for x in np.min(self.margin, axis=0)],
            "demand_max": [float(x) for x in np.max(self.demand, axis=0)],
            "K_u_printed": [float(x) for x in self.K_u],
            "layer": [float(x) for x in self.layer],
            "too_wide": [one._asdict() for one in self.too_wide],
            "reaching_from": self.reaching_from,
            "reaching_time": None if time is None or math.isinf(time) else time,
            "reaching_bound": self.reaching_bound if self.no_bound is None else None,
            "no_bound": self.no_bound,
            "set_point": None if self.set_point is None else self.set_point.to_json(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class SetPoint:
    """The Lyapunov function (142) of the paper for its proposed law, while the desired position stands still.

    V = s' M s / 2 + (qd' M qd + e' Kp e) / 2 has the arm's kinetic energy in it, which a moving reference feeds: it is
    a function for set points, and there is none for tracking. (144) wants V to fall by zeta_i |s_i| or more.
    """

    V: Array
    """V at the control instants from which on the desired position stands still, (m,) [J]; empty when it never does."""
    V_rate: Array
    """Mean of dV/dt over the control period, (143): the difference of V, (m,) [W]."""
    zeta: Array
    """The zeta of (144) as it came out, -(dV/dt) / sum |s_i|, (m,) [N m]."""
    outside: npt.NDArray[np.bool_]
    """Whether any joint is outside its layer, (m,)."""
    saturated: npt.NDArray[np.bool_]
    """Whether the law asked any joint for more than its torque limit, (m,)."""

    @property
    def says(self) -> str:
        """The finding, in words."""
        if not len(self.V):
            return "no function for tracking"
        if not self.outside.any():
            return "vacuous"
        rising = self.outside & (self.V_rate > 0.0)
        if not rising.any():
            return "falls"
        return "rises" if np.any(rising & ~self.saturated) else "lost to saturation"

    def to_json(self) -> dict[str, Any]:
        """Return the headline figures; None where nothing is outside the layer."""
        counted = self.outside
        rising, some = counted & (self.V_rate > 0.0), bool(counted.any())
        return {
            "says": self.says,
            "V_max": float(np.max(self.V)) if len(self.V) else None,
            "share_outside": float(np.mean(counted)) if len(self.V) else None,
            "share_rising_outside": float(np.sum(rising) / np.sum(counted)) if some else None,
            "share_of_rising_saturated": float(np.mean(self.saturated[rising])) if rising.any() else None,
            "least_zeta": float(np.min(self.zeta[counted])) if some else None,
        }


def outside_of(s: Array, layer: Array) -> npt.NDArray[np.bool_]:
    """Return whether any joint's s, (N, n), is outside its layer, (n,); (N,)."""
    return np.asarray(np.any(np.abs(s) > layer, axis=1))


def certify(
    run: Trajectory, truth: Arm, law: SlidingLaw, control_period: float, reaction: float | None = None
) -> Certificate:
    """Compute the certificates of a completed run.

    With tau = tau_eq + K sgn(s) + .., (118) becomes dV/dt = s' (M ds + C s), and it is at most -sum eta |s| when K
    exceeds every joint's |M ds + C s + tau - tau_eq| by eta: (123), in which the paper's A^, V and G are read as what
    is left of the arm after the equivalent control. ds is taken over the control period, whose torque is constant.

    Args:
        run: The run.
        truth: The true arm.
        law: Parameters of the law.
        control_period: Time between control instants [s].
        reaction: Time from a change of the state to the torque that answers it [s], see `Chain.reaction`; None for one
            control period. What the gains move s in it belongs to the layer.

    Raises:
        ResultError: the run did not complete, or is shorter than two instants.
    """
    if not run.completed or len(run.t) < 2:
        raise ResultError("certificates need a completed run of at least two control instants")
    e, de = run.q_ref - run.q, run.qd_ref - run.qd
    s = de + law.lam * e
    ds = run.qdd_ref[:-1] + law.lam * de[:-1] - np.diff(run.qd, axis=0) / control_period
    M, turning, g = truth.sliding_terms(run.q, run.qd, s)
    turning = turning[:-1]
    V = 0.5 * np.einsum("ki,kij,kj->k", s, M, s)
    if law.belief is None:
        tau_eq = np.zeros_like(turning)
    else:
        seen = law.lam * (run.qd_ref - run.qd_meas)[:-1]
        tau_eq = law.belief.inverse_dynamics(run.q_meas[:-1], run.qd_meas[:-1], run.qdd_ref[:-1] + seen)
    inertial = np.einsum("kij,kj->ki", M[:-1], ds)
    demand = np.abs(inertial + turning + run.tau[:-1] - tau_eq)
    middle = s[:-1] + 0.5 * control_period * ds
    V_rate = np.einsum("ki,ki->k", middle, inertial + turning)
    eta = -np.sign(s[:-1]) * (inertial + turning)
    size = np.sum(np.abs(middle), axis=1)
    fall = -V_rate / np.where(size > 0.0, size, np.nan)
    K_u = np.max(np.abs(inertial) + np.abs(turning) + np.abs(g[:-1]), axis=0)
    moved = (reaction or control_period) * np.max(np.abs(np.linalg.inv(M)) @ law.K, axis=0)
    layer = moved if law.phi is None else np.maximum(law.phi, moved)
    margin = law.K - demand
    first, time, bound = _reaching(run.t, s, V, M, fall, layer)
    found = Certificate(law.K, run.t[:-1], s[:-1], V[:-1], V_rate, demand, margin, eta, K_u, layer, first, time, bound)
    found = replace(found, too_wide=_too_wide(law, moved, layer, np.max(np.abs(run.q_ref - run.q[0]), axis=0)))
    return found if law.Kp is None else replace(found, set_point=_set_point(found, run, law.Kp, M, V))


def _too_wide(law: SlidingLaw, moved: Array, layer: Array, span: Array) -> tuple[TooWide, ...]:
    """Return the joints whose layer is too wide.

    Args:
        law: Parameters of the law.
        moved: What K moves s before the loop answers, (n,) [rad/s].
        layer: The layers, (n,) [rad/s].
        span: How far each joint's desired position is from where it starts, at most, (n,) [rad].
    """
    span = np.where(span > 0.0, span, np.max(span))
    most = law.lam * span if law.phi is None else WIDE * law.phi
    phi = [None] * len(layer) if law.phi is None else law.phi.tolist()
    beyond = np.flatnonzero((moved > most) & (most > 0.0)).tolist()
    return tuple(TooWide(i + 1, float(layer[i]), phi[i], float((layer / law.lam)[i])) for i in beyond)


def _set_point(found: Certificate, run: Trajectory, Kp: Array, M: Array, V: Array) -> SetPoint:
    """Return the figures of (142) for a run.

    Args:
        found: Its certificates.
        run: The run.
        Kp: Position gain of the law, (n,) [N m/rad].
        M: Mass matrix at each control instant, (N, n, n) [kg m^2].
        V: s' M s / 2 there, (N,) [J].
    """
    moving = np.any(run.q_ref != run.q_ref[-1], axis=1) | np.any((run.qd_ref != 0.0) | (run.qdd_ref != 0.0), axis=1)
    still = slice(int(np.flatnonzero(moving)[-1]) + 1 if moving.any() else 0, None)
    e = run.q_ref - run.q
    V = V + 0.5 * np.einsum("ki,kij,kj->k", run.qd, M, run.qd) + 0.5 * np.einsum("ki,i,ki->k", e, Kp, e)
    V_rate = np.diff(V) / np.diff(run.t)
    size = np.sum(np.abs(found.s), axis=1)
    zeta = -V_rate / np.where(size > 0.0, size, np.nan)
    beyond = np.any(run.tau != run.tau_law, axis=1)[:-1]
    return SetPoint(V[:-1][still], V_rate[still], zeta[still], found.outside[still], beyond[still])


def _reaching(
    t: Array, s: Array, V: Array, M: Array, fall: Array, layer: Array
) -> tuple[float | None, float | None, float | None]:
    """Return the instant of the largest V outside the layer, the time from there into it, and the bound on that time.

    V <= m |s|^2 / 2 and dV/dt <= -eta sum |s_i| <= -eta |s| give d sqrt(V)/dt <= -eta / sqrt(2 m): the (91) of an
    arm, with eta the least `fall` = -dV/dt / sum |s_i| on the way. m is the largest row sum of |M|, which no
    eigenvalue of M exceeds.
    """
    outside = outside_of(s[:-1], layer)
    if not outside.any():
        return None, None, None
    first = int(np.argmax(np.where(outside, V[:-1], -np.inf)))
    inside = np.all(np.abs(s[first:]) <= layer, axis=1)
    reached = bool(inside.any())
    last = first + int(np.argmax(inside)) if reached else len(fall)
    least = float(np.min(fall[first:last]))
    heaviest = float(np.max(np.sum(np.abs(M), axis=2)))
    bound = math.sqrt(2.0 * float(V[first]) * heaviest) / least if least > 0.0 else math.inf
    return float(t[first]), float(t[last] - t[first]) if reached else math.inf, bound


def required_gain(
    truth: Arm, law: SlidingLaw, q_ref: Array, qd_ref: Array, qdd_ref: Array, disturbance: Array | None
) -> Array:
    """Return the least K with which a law can hold s = 0 along its reference, (n,) [N m]; (123) at e = 0, eta = 0.

    Args:
        truth: The true arm.
        law: Parameters of the law.
        q_ref, qd_ref, qdd_ref: Desired motion, (N, n).
        disturbance: Torque that will be added, friction included, (N, n) [N m], or None.
    """
    needed = np.einsum("kij,kj->ki", truth.mass_matrix(q_ref), qdd_ref) + truth.bias_forces(q_ref, qd_ref)
    if law.belief is not None:
        needed = needed - law.belief.inverse_dynamics(q_ref, qd_ref, qdd_ref)
    if disturbance is not None:
        needed = needed - disturbance
    return np.asarray(np.max(np.abs(needed), axis=0))


WIDE = 10.0
"""Times phi from which on a layer is so wide that nothing is shown of its joint [1]."""
UNSTABLE = 2.0
"""T (K/phi + Kd) / M from which a joint sampled with period T does not come to rest in its layer [1]."""
COARSE = 0.1
"""Share of a joint's motion that its error may take from K moving s by T K / M in one control period [1]."""


class Held(NamedTuple):
    """Effect of one control period's switching torque on each joint, and the most that it may be; arrays (n,)."""

    step: Array
    """Amount by which K moves s in one control period, T K / M [rad/s]."""
    most: Array
    """The most that it may move s for the joint to be held [rad/s]; 0 where the rate gain alone moves s too far."""
    K: Array
    """Switching gain that would do [N m]."""

    @property
    def coarse(self) -> npt.NDArray[np.bool_]:
        """Whether K moves s by more than `most`, (n,)."""
        return np.asarray(self.step > self.most * (1.0 + 1e-9))


def held_to(truth: Arm, law: SlidingLaw, poses: Array, span: Array, control_period: float) -> Held:
    """Return the change of s that K makes in one control period, and its limit; joint by joint, the others left free.

    M is the least inertia that the joint has at the poses, 1 / (M^-1)_ii. In its layer a joint under K sat(s/phi) +
    Kd s and a perfect equivalent control has s_next = (1 - T (K/phi + Kd) / M) s, which dies out while that T (..) / M
    is below 2 and, with no ringing, up to 1: the K that would do has 1. A law that switches leaves s at T K / M, and
    so an error of up to T K / (M lambda): at most a tenth of the joint's motion.

    Args:
        truth: The true arm.
        law: Parameters of the law.
        poses: Positions along the motion, (m, n) [rad].
        span: How far each joint moves, (n,) [rad].
        control_period: Time between control instants [s].
    """
    mobility = np.max(np.diagonal(np.linalg.inv(truth.mass_matrix(poses)), axis1=1, axis2=2), axis=0) * control_period
    step = mobility * law.K
    if law.phi is None:
        most = COARSE * law.lam * span
        return Held(step, most, most / mobility)
    linear = 0.0 if law.Kd is None else mobility * law.Kd
    return Held(
        step,
        law.phi * np.maximum(UNSTABLE - linear, 0.0),
        law.phi * np.maximum(1.0 - linear, 0.0) / mobility,
    )
