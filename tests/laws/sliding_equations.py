"""Sliding modes since 1990 written out a second time, in vectors, for tests; nothing shared with the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array

State: TypeAlias = dict[str, Any]


class Joints(NamedTuple):
    """What the equations need of the arm at one instant."""

    tau_max: Array
    mbar: Array
    T: float
    M: Array
    rest: Array
    """M^ qdd_ref + N^."""
    blind: bool = False
    """Whether the law is without its model."""

    def torque(self, acceleration: Array) -> Array:
        """Return M^ a + N^ of a wanted acceleration a beyond qdd_ref."""
        return np.asarray(self.M @ acceleration + self.rest)

    def equivalent(self, acceleration: Array) -> Array:
        """Return the equivalent control."""
        return np.zeros(len(self.tau_max)) if self.blind else self.torque(acceleration)

    def waits(self, tau: Array, along: Array) -> Array:
        """Return where the torque is beyond its limit in a direction."""
        return np.asarray((np.abs(tau) > self.tau_max) & (tau * along > 0.0))


Law: TypeAlias = Callable[[Mapping[str, Any], Joints, Array, Array, State], tuple[Array, State]]


def adaptive_twist(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """Mbar (k1 |s|^1/2 sgn s + w), dw = 2 eps k1 sgn s, dk1 = omega sgn(|s| - mu), least <= k1 <= most."""
    s, w = de + g["lam"] * e, m.get("w", 0.0)
    k1 = m.get("k1", g["least"])
    tau = a.equivalent(g["lam"] * de) + a.mbar * (k1 * np.abs(s) ** 0.5 * np.sign(s) + w)
    free, outside = np.logical_not(a.waits(tau, s)), np.abs(s) > g["mu"]
    rate = np.where(outside, free, -1.0) * g["omega"]
    grown = np.clip(k1 + a.T * rate, g["least"], g["most"])
    return tau, {"s": s, "w": w + free * a.T * 2.0 * g["eps"] * k1 * np.sign(s), "k1": grown}


def gain_adaptive(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """K tau_max sgn s, dK = gamma |s| sgn(|s| - phi), least <= K <= 1."""
    s, K = de + g["lam"] * e, m.get("gain", g["least"])
    tau = a.equivalent(g["lam"] * de) + K * a.tau_max * np.sign(s)
    outside = np.abs(s) > g["phi"]
    rate = np.where(outside, np.where(a.waits(tau, s), 0.0, 1.0), -1.0) * g["gamma"] * np.abs(s)
    return tau, {"s": s, "gain": np.clip(K + a.T * rate, g["least"], 1.0)}


def integral(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """M (qdd_ref + lam de + (lam/2)^2 e) + N + K sgn s, or K sat(s/phi); s is the PID surface less its first value."""
    total, square = m.get("integral", np.zeros(len(e))), (0.5 * g["lam"]) ** 2
    surface = de + g["lam"] * e + square * total
    start = m.get("start", surface)
    s = surface - start
    switch = np.clip(s / g["phi"], -1.0, 1.0) if "phi" in g else np.sign(s)
    tau = a.torque(g["lam"] * de + square * e) + g["kr"] * a.tau_max * switch
    return tau, {"s": s, "start": start, "integral": total + np.where(a.waits(tau, e), 0.0, a.T * e)}


def core(x: Array) -> Array:
    """Return the square root, below 0.1 the parabola through zero with the same value and slope at 0.1."""
    # b x + c x^2 with b 0.1 + c 0.01 = sqrt(0.1) and b + 0.2 c = 1/(2 sqrt(0.1))
    b, c = np.linalg.solve([[0.1, 0.01], [1.0, 0.2]], [0.1**0.5, 0.5 / 0.1**0.5])
    return np.where(x < 0.1, b * x + c * x * x, x**0.5)


def core_slope(x: Array) -> Array:
    """Return its derivative, by a central difference of a step that leaves ten digits."""
    h = 1e-5 * np.maximum(x, 1e-3)
    return (core(x + h) - core(x - h)) / (2.0 * h)


def terminal(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """A wanted acceleration such that ds = -(3/2) |v|^1/2 kV (s + S core(|s|/S) sgn s) on an arm without mass."""
    E, lam = g["knee"], g["lam"]
    S = lam * E
    s = S * (e / E + g["fast"] * (e / E) ** 2 * np.sign(e) + (np.abs(de) / S) ** 1.5 * np.sign(de))
    by_e, by_de = lam * (1.0 + 2.0 * g["fast"] * np.abs(e) / E), 1.5 * (np.abs(de) / S) ** 0.5
    reach = g["kv"] * (s + S * core(np.abs(s) / S) * np.sign(s))
    return a.torque(by_e * de / by_de + reach), {"s": s}


def fixed_time(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """A wanted acceleration such that ds = -kV S f(|s|/S) sgn s, s = de + S f(|e|/E) sgn e, f = core(x) + x^3/2."""
    E, lam = g["knee"], g["lam"]
    S, x = lam * E, np.abs(e) / E
    s = de + S * (core(x) + x**1.5) * np.sign(e)
    y = np.abs(s) / S
    slope = core_slope(x) + 1.5 * x**0.5
    return a.torque(lam * slope * de + g["kv"] * S * (core(y) + y**1.5) * np.sign(s)), {"s": s}


def performance(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """KV Mbar rho_s artanh(s/rho_s), s = de + lam rho artanh(e/rho); each funnel tends to its end exponentially."""

    def stretch(x: Array) -> Array:
        return np.arctanh(np.clip(x, -0.999, 0.999))

    left = np.exp(-g["shrink"] * a.T)
    rho = g["rho_end"] + (m["rho"] - g["rho_end"]) * left if m else np.maximum(g["rho"], 1.5 * np.abs(e))
    s = de + g["lam"] * rho * stretch(e / rho)
    inner = g["rho_s"] + (m["rho_s"] - g["rho_s"]) * left if m else np.maximum(g["rho_s"], 1.5 * np.abs(s))
    tau = a.equivalent(g["lam"] * de) + g["kv"] * a.mbar * inner * stretch(s / inner)
    return tau, {"s": s, "rho": rho, "rho_s": inner}


def sliding_pi(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State) -> tuple[Array, State]:
    """Mbar (kV s + kis int s)."""
    s, total = de + g["lam"] * e, m.get("s_integral", np.zeros(len(e)))
    tau = a.equivalent(g["lam"] * de) + a.mbar * (g["kv"] * s + g["kis"] * total)
    return tau, {"s": s, "s_integral": total + np.where(a.waits(tau, s), 0.0, a.T * s)}


EQUATIONS: dict[str, Law] = {
    "adaptive-super-twisting": adaptive_twist,
    "gain-adaptive-smc": gain_adaptive,
    "integral-smc": integral,
    "nonsingular-terminal-smc": terminal,
    "fixed-time-smc": fixed_time,
    "prescribed-performance": performance,
    "sliding-pi": sliding_pi,
}
