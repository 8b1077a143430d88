"""The families' equations written out a second time, in vectors, for tests; nothing here is shared with the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from tests.fuzzy.independent import exact_output
from torquebench.kernel import Array

Rules: TypeAlias = Callable[[Array, Array], Array]
State: TypeAlias = dict[str, Any]
NINE = np.array([-1.0, 0.0, 1.0])
"""Peaks of the terms of pd-9."""
TWENTY_FIVE = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
"""Peaks of the terms of pd-25."""


def rules_of(peaks: Array | None = None) -> Rules:
    """Return the output of a built-in system, 49 rules unless its terms' peaks are given, at arrays of inputs."""
    more = {} if peaks is None else {"peaks": peaks}
    return lambda x, y: np.array([exact_output(a, b, **more) for a, b in zip(x, y, strict=True)])


def sat(x: Array) -> Array:
    """Return x clipped to [-1, 1]."""
    return np.minimum(np.maximum(x, -1.0), 1.0)


def seven(x: Array) -> Array:
    """Return the degrees (7, n) to which x is each of the seven triangles at -1, -2/3 .. 1."""
    centres = np.arange(-3, 4)[:, None] / 3.0
    return np.maximum(0.0, 1.0 - 3.0 * np.abs(x - centres))


class Joints:
    """What the equations need of the arm and of the law's rules."""

    def __init__(self, tau_max: Array, mbar: Array, T: float, rules: Rules, supervisor: Rules) -> None:
        self.tau_max, self.mbar, self.T, self.rules, self.supervisor = tau_max, mbar, T, rules, supervisor


def fuzzy_layer(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """K FIS(s/phi, ds/gds), ds the last difference of s, 0 at first."""
    s = de + g["lam"] * e
    ds = (s - m["s"]) / a.T if m else np.zeros(len(e))
    return tau_eq + g["k"] * a.tau_max * a.rules(s / g["phi"], ds / g["gds"]), {"s": s}


def estimator(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """K sat(s/phi) + KF FIS(e/ge, de/gd), s = de + lam e + (lam/2)^2 int e."""
    integral = m.get("integral", np.zeros(len(e)))
    s = (0.0 if g.get("pi") else de) + g["lam"] * e + (0.5 * g["lam"]) ** 2 * integral
    switch = np.sign(s) if g.get("sign") else sat(s / g["phi"])
    tau = tau_eq + g["k"] * a.tau_max * switch + g["kf"] * a.tau_max * a.rules(e / g["ge"], de / g["gd"])
    waits = (np.abs(tau) > a.tau_max) & (tau * e > 0.0)
    return tau, {"s": s, "integral": integral + np.where(waits, 0.0, a.T * e)}


def supervised(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """K (1 + boost (1 + w)/2) FIS(s/phi, int s/gis), w = SUP(2|e|/ge - 1, 2|de|/gd - 1)."""
    sum_s = m.get("s_integral", np.zeros(len(e)))
    s = de + g["lam"] * e
    w = a.supervisor(2.0 * np.abs(e) / g["ge"] - 1.0, 2.0 * np.abs(de) / g["gd"] - 1.0)
    pushed = a.rules(s / g["phi"], sum_s / g["gis"])
    tau = tau_eq + g["k"] * a.tau_max * (1.0 + g["boost"] * (1.0 + w) / 2.0) * pushed
    waits = (np.abs(sum_s) >= g["gis"]) & (sum_s * s > 0.0)
    return tau, {"s": s, "s_integral": sum_s + np.where(waits, 0.0, a.T * s)}


def adaptive(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """Kd s + KI int s + theta' zeta(s/phi), dtheta = gamma Mbar zeta s, |theta| <= tau_max."""
    theta, sum_s = m.get("theta", np.zeros((7, len(e)))), m.get("s_integral", np.zeros(len(e)))
    s = de + g["lam"] * e
    zeta = seven(sat(s / g["phi"]))
    tau = g["kv"] * a.mbar * s + g["kis"] * a.mbar * sum_s + np.sum(theta * zeta, axis=0)
    learns = ~((np.abs(tau) > a.tau_max) & (tau * s > 0.0))
    grown = theta + learns * a.T * g["gamma"] * a.mbar * zeta * s
    return tau, {"s": s, "s_integral": sum_s + learns * a.T * s, "theta": np.clip(grown, -a.tau_max, a.tau_max)}


def one_input(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """K FIS(s/phi, 0)."""
    s = de + g["lam"] * e
    return g["k"] * a.tau_max * a.rules(s / g["phi"], np.zeros(len(e))), {"s": s}


def two_inputs(g: Mapping[str, Any], a: Joints, e: Array, de: Array, m: State, tau_eq: Array) -> tuple[Array, State]:
    """K FIS(s/phi, z), dz = s/gis - forget z, |z| <= 1."""
    z, s = m.get("z", np.zeros(len(e))), de + g["lam"] * e
    tau = g["k"] * a.tau_max * a.rules(s / g["phi"], z)
    return tau, {"s": s, "z": sat(z + a.T * (s / g["gis"] - g["forget"] * z))}


EQUATIONS: dict[str, Callable[..., tuple[Array, State]]] = {
    "fuzzy-boundary-layer": fuzzy_layer,
    "pi-smc-fuzzy-estimator": estimator,
    "pi-fuzzy-smc-supervised": supervised,
    "adaptive-fuzzy-pi-smc": adaptive,
    "sliding-mode-fuzzy": one_input,
    "two-input-sliding-mode-fuzzy": two_inputs,
}
