"""Sliding mode whose switching gain adapts to what is needed."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from torquebench.kernel import Array, sign
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import Fit

QUICKEST, FED = 10.0, 0.07
"""Largest rate gamma that is chosen [1/rad], and the most that it is times the time until the loop answers [s/rad]."""
LEAST = 0.005
"""Least share of the torque limit that is chosen [1]."""


def least_share(fit: Fit) -> Array:
    """Least gain: 0.5 % of the torque limit."""
    return np.full_like(fit.limits.tau_max, LEAST)


def learning(fit: Fit) -> Array:
    """Rate gamma: 10/rad, less where the loop answers late, as a quick K feeds on the shaking that it makes."""
    return np.full_like(fit.limits.tau_max, min(QUICKEST, FED / fit.reaction))


class GainAdaptiveGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    gamma: Annotated[
        Array,
        Gain(
            "rate gamma at which K, a fraction of the torque limit, adapts",
            "1/rad",
            True,
            None,
            learning,
            (1, 1e3, "log"),
        ),
    ]
    phi: Annotated[Array, Gain("layer |s| <= phi in which K shrinks", "rad/s")]
    least: Annotated[
        Array, Gain("least K, a fraction of the torque limit", "1", True, None, least_share, (1e-4, 0.1, "log"))
    ]
    equivalent_control: UseModel


class GainAdaptiveMemory(NamedTuple):
    """The sliding variable; the switching gain K, a fraction of the torque limit; the velocity seen last."""

    s: Array
    gain: Array
    velocity: Array


@controller("gain-adaptive-smc", gains=GainAdaptiveGains, memory=GainAdaptiveMemory)
def gain_adaptive_smc(
    gains: GainAdaptiveGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: GainAdaptiveMemory,
    tau: Array,
) -> None:
    """Gain-adaptive sliding mode: tau = [tau_eq +] K tau_max sgn(s), dK = gamma |s| sgn(|s| - phi), least <= K <= 1.

    With s = de + lambda e. Plestan, Shtessel, Bregeault and Poznyak, International Journal of Control 83 (2010), 1907,
    their second law; they advise a layer of 4 K tau_max T / M, what s moves by in four control periods T. It needs no
    bound on the disturbance, and |s| comes within some layer, wider than phi, in finite time; that K is no larger than
    needed holds there only. It fails where delay or noise alone keep |s| above phi, as K then climbs to the torque
    limit, and is slow to lower a K that a large start has raised, as the rate is gamma |s|. K stops growing while the
    torque is beyond its limit in the direction of s.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        gain = memory.gain[i]
        gain = gain if gain > gains.least[i] else gains.least[i]
        memory.s[i] = s
        tau[i] += gain * model.tau_max[i] * sign(s)
        grows = abs(s) > gains.phi[i]
        if not (grows and abs(tau[i]) > model.tau_max[i] and tau[i] * s > 0.0):
            gain += model.control_period * gains.gamma[i] * abs(s) * (1.0 if grows else -1.0)
        gain = gain if gain < 1.0 else 1.0
        memory.gain[i] = gain if gain > gains.least[i] else gains.least[i]
