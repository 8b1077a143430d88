"""Adaptive super-twisting: gains that grow while s is outside a layer and shrink inside."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench.kernel import Array, sign
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import ERROR, Fit, twist

LEAST = 0.2
"""Least gain over the largest one where both are chosen [1]."""
LAYER = 0.1
"""Layer that is chosen, over that of laws with a band [1]."""


def least_twist(fit: Fit) -> Array:
    """Least gain k1: a fifth of the largest."""
    return LEAST * fit["most"]


def growth(fit: Fit) -> Array:
    """Rate of k1: from nothing to the largest gain in 2 / lambda."""
    return 0.5 * fit.lam * fit["most"]


def ratio(fit: Fit) -> Array:
    """Gain eps: with the largest k1, k2 = 2 eps k1 is half of what critically damps the heaviest inertia near s = 0."""
    return fit["most"] * fit.limits.scale / (8.0 * fit.limits.heaviest)


def narrow(fit: Fit) -> Array:
    """Layer: a tenth of `ERROR` times lambda."""
    return LAYER * ERROR * fit.lam


class AdaptiveTwistGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    most: Annotated[Array, Gain("largest k1, times the inertia scale Mbar", "rad^0.5/s^1.5", True, None, twist)]
    least: Annotated[Array, Gain("least k1, where it starts", "rad^0.5/s^1.5", True, None, least_twist)]
    omega: Annotated[Array, Gain("rate at which k1 grows and shrinks", "rad^0.5/s^2.5", auto=growth)]
    eps: Annotated[Array, Gain("half of k2 over k1", "rad^0.5/s^1.5", auto=ratio)]
    mu: Annotated[Array, Gain("layer |s| <= mu in which k1 shrinks", "rad/s", auto=narrow)]
    equivalent_control: UseModel


class AdaptiveTwistMemory(NamedTuple):
    """The sliding variable; the integral w [rad/s^2]; the gain k1; the velocity seen last."""

    s: Array
    w: Array
    k1: Array
    velocity: Array


@controller("adaptive-super-twisting", gains=AdaptiveTwistGains, memory=AdaptiveTwistMemory)
def adaptive_super_twisting(
    gains: AdaptiveTwistGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: AdaptiveTwistMemory,
    tau: Array,
) -> None:
    """Adaptive super-twisting: tau = [tau_eq +] Mbar (k1 |s|^1/2 sgn(s) + w), dw = k2 sgn(s), with k1 adapting.

    With s = de + lambda e, k2 = 2 eps k1 and dk1/dt = omega sgn(|s| - mu). Shtessel, Taleb and Plestan, Automatica 48
    (2012), 759; k1 is kept within its least and its largest value, where the paper lets it grow without a bound. It
    needs no bound on the disturbance or on its rate, and |s| comes below some value above mu in finite time. It fails
    where noise or delay alone keep |s| above mu: k1 then climbs to its largest value, and the law is `super-twisting`
    with that. w and k1 stop growing while the torque is beyond its limit in the direction of s.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        switch, k1 = sign(s), memory.k1[i]
        k1 = k1 if k1 > gains.least[i] else gains.least[i]
        memory.s[i] = s
        tau[i] += model.inertia_scale[i] * (k1 * math.sqrt(abs(s)) * switch + memory.w[i])
        outside = abs(s) > gains.mu[i]
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * s > 0.0):
            memory.w[i] += model.control_period * 2.0 * gains.eps[i] * k1 * switch
            k1 += model.control_period * gains.omega[i] if outside else 0.0
        k1 -= 0.0 if outside else model.control_period * gains.omega[i]
        k1 = k1 if k1 < gains.most[i] else gains.most[i]
        memory.k1[i] = k1 if k1 > gains.least[i] else gains.least[i]
