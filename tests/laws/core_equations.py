"""The paper's, the vendors' and plain laws written out a second time, in vectors; nothing shared with the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from tests.fuzzy.independent import exact_output
from torquebench.kernel import Array


class State(NamedTuple):
    """What a law's equation needs: the errors, the arm, and what the law remembers."""

    e: Array
    de: Array
    qdd_ref: Array
    qd: Array
    M: Array
    velocity: Array
    """C(q, qd) qd [N m]."""
    gravity: Array
    tau_max: Array
    mbar: Array
    T: float
    """Control period [s]."""
    integral: Array
    last_qd: Array
    """Velocity at the instant before."""


class Answer(NamedTuple):
    """Torque, and the memory after the call."""

    tau: Array
    s: Array | None = None
    integral: Array | None = None
    velocity: Array | None = None
    """The velocity that is remembered, where one is."""


_output = cache(exact_output)
Gains = Mapping[str, Array]
Options = Mapping[str, Any]


def sat(x: Array) -> Array:
    """Return x clipped to [-1, 1]."""
    return np.minimum(np.maximum(x, -1.0), 1.0)


def fis(x: Array, y: Array) -> Array:
    """Return the output of the 49 rules at arrays of inputs."""
    return np.array([_output(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)])


def equivalent(options: Options, g: Gains, a: State, pull: Array | float = 0.0) -> tuple[Array, Array | None]:
    """Nothing; M (qdd_ref + lam de + pull) + C qd + g; or with qdd_ref - qdd for qdd_ref. And the velocity kept."""
    match options["equivalent_control"]:
        case False:
            return np.zeros(len(a.e)), None
        case True:
            return a.M @ (a.qdd_ref + g["lam"] * a.de + pull) + a.velocity + a.gravity, None
    measured = (a.qd - a.last_qd) / a.T
    return a.M @ (a.qdd_ref - measured + g["lam"] * a.de + pull) + a.velocity + a.gravity, a.qd


def grown(a: State, tau: Array) -> Array:
    """Return the integral after an instant: it waits where the torque is beyond its limit along the error."""
    waits = (np.abs(tau) > a.tau_max) & (tau * a.e > 0.0)
    return a.integral + np.where(waits, 0.0, a.T * a.e)


def pd(options: Options, g: Gains, a: State) -> Answer:
    """Kp e + Kd de, Kd = kV Mbar, Kp = lam Kd; (137)."""
    return Answer(g["kv"] * a.mbar * a.de + g["lam"] * g["kv"] * a.mbar * a.e)


def pd_gravity(options: Options, g: Gains, a: State) -> Answer:
    """PD and g(q)."""
    return Answer(pd(options, g, a).tau + a.gravity)


def pid(options: Options, g: Gains, a: State) -> Answer:
    """PD and kI Mbar int e."""
    tau = pd(options, g, a).tau + g["ki"] * a.mbar * a.integral
    return Answer(tau, integral=grown(a, tau))


def computed_torque(options: Options, g: Gains, a: State) -> Answer:
    """M (qdd_ref + kV de + lam kV e + kI int e) + C qd + g."""
    wanted = a.qdd_ref + g["kv"] * a.de + g["lam"] * g["kv"] * a.e + g["ki"] * a.integral
    tau = a.M @ wanted + a.velocity + a.gravity
    return Answer(tau, integral=grown(a, tau))


def smc(options: Options, g: Gains, a: State) -> Answer:
    """[tau_eq +] K sgn(s) or K sat(s/phi) on the surfaces (83), (85) and (86)."""
    squared = (g["lam"] / 2.0) ** 2
    proportional, rate, total = g["lam"] * a.e, a.de, squared * a.integral
    s = {"pd": proportional + rate, "pi": proportional + total, "pid": proportional + rate + total}[options["surface"]]
    has_integral = options["surface"] != "pd"
    tau, velocity = equivalent(options, g, a, squared * a.e if has_integral else 0.0)
    tau = tau + g["k"] * a.tau_max * (np.sign(s) if options["switching"] == "sign" else sat(s / g["phi"]))
    return Answer(tau, s, grown(a, tau) if has_integral else None, velocity)


def linear_band(options: Options, g: Gains, a: State) -> Answer:
    """[tau_eq +] K sat(s/phi) or K sgn(s), + Kd s; (147)-(149)."""
    s = a.de + g["lam"] * a.e
    tau, velocity = equivalent(options, g, a)
    switch = np.sign(s) if options["switching"] == "sign" else sat(s / g["phi"])
    return Answer(tau + g["k"] * a.tau_max * switch + g["kv"] * a.mbar * s, s, None, velocity)


def fuzzy_linear_band(options: Options, g: Gains, a: State) -> Answer:
    """[tau_eq +] K sat(s/phi) + Kd s + KF FIS(e/ge, de/gd) + KI int e, each term as its option says; (149)-(151)."""
    s = a.de + g["lam"] * a.e
    tau, velocity = equivalent(options, g, a)
    band = {"saturation": sat(s / g["phi"]), "sign": np.sign(s), "off": 0.0 * s}[options["band"]]
    x, y = sat(a.e / (g["gd"] / g["lam"])), sat(a.de / g["gd"])
    rules = {"fuzzy": fis(x, y), "clipped-sum": sat(x + y), "off": 0.0 * x}[options["compensation"]]
    tau = tau + a.tau_max * (g["k"] * band + g["kf"] * rules)
    if options["linear"]:
        tau = tau + g["kv"] * a.mbar * s
    if options["integral"]:
        tau = tau + g["ki"] * a.mbar * a.integral
    return Answer(tau, s, grown(a, tau) if options["integral"] else None, velocity)


def super_twisting(options: Options, g: Gains, a: State) -> Answer:
    """[tau_eq +] Mbar k1 |s|^1/2 sgn(s); its integral w is zero at a first call."""
    s = a.de + g["lam"] * a.e
    tau, velocity = equivalent(options, g, a)
    return Answer(tau + a.mbar * g["k1"] * np.abs(s) ** 0.5 * np.sign(s), s, None, velocity)


def kept_within(a: State, scale: Array) -> Array:
    """Return the integral after an instant: it waits beyond what the fuzzy system sees as 1, along the error."""
    waits = (np.abs(a.integral) >= scale) & (a.integral * a.e > 0.0)
    return a.integral + np.where(waits, 0.0, a.T * a.e)


def fuzzy_pd(options: Options, g: Gains, a: State) -> Answer:
    """KF FIS(e/ge, de/gd)."""
    return Answer(g["kf"] * a.tau_max * fis(a.e / g["ge"], a.de / g["gd"]))


def fuzzy_pi(options: Options, g: Gains, a: State) -> Answer:
    """KF FIS(e/ge, int e/gi)."""
    tau = g["kf"] * a.tau_max * fis(a.e / g["ge"], a.integral / g["gi"])
    return Answer(tau, integral=kept_within(a, g["gi"]))


def fuzzy_pid(options: Options, g: Gains, a: State) -> Answer:
    """KF/2 (FIS(e/ge, de/gd) + FIS(e/ge, int e/gi))."""
    both = fis(a.e / g["ge"], a.de / g["gd"]) + fis(a.e / g["ge"], a.integral / g["gi"])
    return Answer(0.5 * g["kf"] * a.tau_max * both, integral=kept_within(a, g["gi"]))


def joint_impedance(options: Options, g: Gains, a: State) -> Answer:
    """Kp e - Kd qd or Kp e + Kd de, + C qd + g."""
    rate = {"velocity": -a.qd, "velocity-error": a.de}[options["damping"]]
    return Answer(g["kp"] * a.e + g["kd"] * rate + a.velocity + a.gravity)


def gravity_friction(options: Options, g: Gains, a: State) -> Answer:
    """Kp e + Kd de + g + viscous v + coulomb sat(v/speed)."""
    v = {"desired": a.qd + a.de, "measured": a.qd}[options["friction_at"]]
    believed = g["viscous"] * v + g["coulomb"] * sat(v / g["speed"])
    return Answer(g["kp"] * a.e + g["kd"] * a.de + a.gravity + believed)


def position_servo(options: Options, g: Gains, a: State) -> Answer:
    """Kp e - kd qd + ki int e."""
    tau = g["kp"] * a.e - g["kd"] * a.qd + g["ki"] * a.integral
    return Answer(tau, integral=grown(a, tau))


EQUATIONS: dict[str, Callable[[Options, Gains, State], Answer]] = {
    "pd": pd,
    "pd-gravity": pd_gravity,
    "pid": pid,
    "computed-torque": computed_torque,
    "smc": smc,
    "linear-band-smc": linear_band,
    "super-twisting": super_twisting,
    "fuzzy-linear-band-smc": fuzzy_linear_band,
    "fuzzy-pd": fuzzy_pd,
    "fuzzy-pi": fuzzy_pi,
    "fuzzy-pid": fuzzy_pid,
    "joint-impedance": joint_impedance,
    "gravity-friction": gravity_friction,
    "position-servo": position_servo,
}
