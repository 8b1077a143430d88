"""Laws with observers, with adaptation and of least cost, written out a second time for a textbook's two-joint arm.

Nothing here is shared with the package. Each takes its gains, the arm, the state and what it remembers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tests.arms import C1, C2, J1, J2, L1, M1, M2, R1, R2, G, two_link_terms
from torquebench.kernel import Array

Memory: TypeAlias = dict[str, Any]


class At(NamedTuple):
    """An instant: the state, what is wanted, and the arm's limits."""

    q: Array
    qd: Array
    e: Array
    de: Array
    qdd_ref: Array
    tau_max: Array
    mbar: Array
    T: float


def outer(g: Mapping[str, Array], a: At) -> Array:
    """qdd_ref + kv de + lam kv e."""
    return a.qdd_ref + g["kv"] * a.de + g["lam"] * g["kv"] * a.e


def time_delay(g: Mapping[str, Array], a: At, m: Memory) -> tuple[Array, Memory]:
    """The torque before, and m Mbar times what is missing of the acceleration."""
    measured = (a.qd - m.get("velocity", 0.0)) / a.T
    tau = m.get("torque", 0.0) + g["m"] * a.mbar * (outer(g, a) - measured)
    return tau, {"torque": np.clip(tau, -a.tau_max, a.tau_max), "velocity": a.qd}


def disturbance_observer(g: Mapping[str, Array], a: At, m: Memory) -> tuple[Array, Memory]:
    """Computed torque less r; r in the form of an integral, r = L (p - p0 - int), L = (1 - exp(-wo T))/T."""
    M, velocity, gravity = two_link_terms(a.q, a.qd)
    h = 1e-3  # C' qd = dM/dt qd - C qd; the mass matrix's cosines by central differences, good to h^2 = 1e-6
    rate = (two_link_terms(a.q + h * a.qd, a.qd)[0] - two_link_terms(a.q - h * a.qd, a.qd)[0]) / (2.0 * h)
    load, p = rate @ a.qd - velocity - gravity, M @ a.qd
    total = m.get("total", 0.0)
    if m:
        total = total + a.T * (m["torque"] + 0.5 * (m["load"] + load) + m["residual"])
    first = m.get("first", p)
    r = (1.0 - np.exp(-g["wo"] * a.T)) / a.T * (p - first - total)
    tau = M @ outer(g, a) + velocity + gravity - r
    torque = np.clip(tau, -a.tau_max, a.tau_max)
    return tau, {"residual": r, "total": total, "first": first, "load": load, "torque": torque}


def adrc(g: Mapping[str, Array], a: At, m: Memory) -> tuple[Array, Memory]:
    """Predict by the matrix exponential of three integrators, correct with three poles at exp(-wo T)."""
    inertia, b, T = g["m"] * a.mbar, np.exp(-g["wo"] * a.T), a.T
    z = np.array([a.q, a.qd, 0.0 * a.q])
    if m:
        z = np.array([[1.0, T, T * T / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]]) @ m["z"]
        z = z + np.outer([T * T / 2.0, T, 0.0], m["torque"] / inertia)
    correct = np.array([1.0 - b**3, 1.5 * (1.0 - b) ** 2 * (1.0 + b) / T, (1.0 - b) ** 3 / T**2])
    z = z + correct * (a.q - z[0])
    tau = inertia * (a.qdd_ref + g["kv"] * (a.qd + a.de - z[1]) + g["lam"] * g["kv"] * (a.q + a.e - z[0]) - z[2])
    memory = {"position": z[0], "velocity": z[1], "disturbance": z[2]}
    return tau, memory | {"z": z, "torque": np.clip(tau, -a.tau_max, a.tau_max)}


def lqr(g: Mapping[str, Array], a: At, m: Memory) -> tuple[Array, Memory]:
    """Feed-forward at the desired state, and each joint's PD of least cost."""
    M, velocity, gravity = two_link_terms(a.q + a.e, a.qd + a.de)
    P = a.tau_max / g["error"]
    D = np.sqrt((a.tau_max / g["rate"]) ** 2 + 2.0 * np.diag(M) * P)
    return M @ a.qdd_ref + velocity + gravity + P * a.e + D * a.de, {"kept": True}


NUMBERS = ("mass", "moment_x", "moment_y", "inertia_zz", "rotor")
"""Numbers of a link that matter in a plane."""
TRUE = {
    "mass": np.array([M1, M2]),
    "moment_x": np.array([M1 * C1, M2 * C2]),
    "moment_y": np.zeros(2),
    "inertia_zz": np.array([J1 + M1 * C1 * C1, J2 + M2 * C2 * C2]),
    "rotor": np.array([R1, R2]),
}
"""What they are, moments and inertias about each joint."""


def planar(a: Mapping[str, Array], q: Array, qd: Array, qdr: Array, qddr: Array) -> Array:
    """M qddr + C(q, qd) qdr + g of a two-joint arm whose links have these numbers; C of Christoffel's symbols."""
    (_, m2), (h1x, h2x), (h1y, h2y), (i1, i2), rotors = (a[name] for name in NUMBERS)
    c, s = np.cos(q[1]), np.sin(q[1])
    along, across = L1 * (h2x * c - h2y * s), -L1 * (h2x * s + h2y * c)
    M = np.array([[i1 + i2 + m2 * L1 * L1 + 2.0 * along, i2 + along], [i2 + along, i2]]) + np.diag(rotors)
    C = across * np.array([[qd[1], qd[0] + qd[1]], [-qd[0], 0.0]])
    low = G * (h2x * np.cos(q[0] + q[1]) - h2y * np.sin(q[0] + q[1]))
    high = G * ((h1x + m2 * L1) * np.cos(q[0]) - h1y * np.sin(q[0]))
    return M @ qddr + C @ qdr + np.array([high + low, low])


def sizes(mbar: Array) -> dict[str, Array]:
    """Return the size of each number in a mean link: its inertias here are [0, J, J], and add up over both links."""
    m0 = (M1 + M2) / 2.0
    spread = (2.0 * (J1 + J2 + M1 * C1 * C1 + M2 * C2 * C2)) / 2.0
    l0 = np.sqrt(spread / (M1 + M2))
    one = np.ones(2)
    return dict(zip(NUMBERS, (m0 * one, m0 * l0 * one, m0 * l0 * one, m0 * l0 * l0 * one, mbar), strict=True))


def slotine_li(g: Mapping[str, Array], a: At, m: Memory) -> tuple[Array, Memory]:
    """Y a + Kd s; each number moves by its derivative of s' Y a, by differences of what is linear in it."""
    s = a.de + g["lam"] * a.e
    qdr, qddr = a.qd + s, a.qdd_ref + g["lam"] * a.de
    learnt = {name: m.get(name, np.zeros(2)) for name in NUMBERS}
    known = {name: TRUE[name] + learnt[name] for name in NUMBERS}
    base = planar(known, a.q, a.qd, qdr, qddr)
    tau = base + g["kv"] * a.mbar * s
    if np.any(np.abs(tau) > a.tau_max):
        return tau, {"s": s} | learnt
    after: Memory = {"s": s}
    for name in NUMBERS:
        size = sizes(a.mbar)[name]
        slope = np.array(
            [s @ (planar(known | {name: known[name] + unit}, a.q, a.qd, qdr, qddr) - base) for unit in np.eye(2)]
        )
        bound = g["bound"] * size
        least = -bound if name.startswith("moment") else np.maximum(-bound, -TRUE[name])
        after[name] = np.clip(learnt[name] + a.T * g["gamma"] * size**2 * slope, least, bound)
    return tau, after


EQUATIONS: dict[str, Callable[[Mapping[str, Array], At, Memory], tuple[Array, Memory]]] = {
    "time-delay": time_delay,
    "disturbance-observer": disturbance_observer,
    "adrc": adrc,
    "lqr": lqr,
    "slotine-li": slotine_li,
}
