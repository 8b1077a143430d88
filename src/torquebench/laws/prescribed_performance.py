"""Prescribed-performance control: an error that stays within a funnel that narrows."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from torquebench.kernel import Array, clip, kernel
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Rate, Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import BRAKED, ERROR, Fit

EDGE = 0.999
"""Share of the funnel at which the transformation stops growing, so that an error outside of it has a torque [1]."""
ROOM = 1.5
"""Width of the funnel at the start, at least, over the error there [1]."""
WIDE = 10.0
"""Width of the inner funnel over lambda times the outer one's, where it is chosen [1]."""


@kernel
def stretched(x: float) -> float:
    """Return artanh(x) = ln((1 + x)/(1 - x))/2, which takes (-1, 1) to all numbers; held beyond `EDGE`.

    Args:
        x: Share of the funnel [1].
    """
    y = clip(x, EDGE)
    return 0.5 * (math.log1p(y) - math.log1p(-y))


def wide(fit: Fit) -> Array:
    """Funnel at the start: 0.1 rad."""
    return np.full_like(fit.limits.tau_max, BRAKED)


def narrow(fit: Fit) -> Array:
    """Funnel in the end: four times `ERROR`, 20 mrad."""
    return np.full_like(fit.limits.tau_max, 4.0 * ERROR)


def shrinking(fit: Fit) -> Array:
    """Rate of the funnel: lambda / 4, four times slower than the error decays."""
    return fit.lam / 4.0


def wide_rate(fit: Fit) -> Array:
    """Inner funnel: ten times lambda times the outer one's width in the end."""
    return WIDE * fit.lam * fit["rho_end"]


class PerformanceGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    kv: Rate
    rho: Annotated[
        Array, Gain("half-width of the funnel of the error at the start", "rad", True, None, wide, (0.05, 1.0, "log"))
    ]
    rho_end: Annotated[Array, Gain("half-width that it tends to", "rad", True, None, narrow, (2e-3, 0.1, "log"))]
    shrink: Annotated[Array, Gain("rate at which the funnels narrow", "1/s", auto=shrinking)]
    rho_s: Annotated[
        Array, Gain("half-width that the funnel of s tends to", "rad/s", True, None, wide_rate, (0.1, 30.0, "log"))
    ]
    equivalent_control: UseModel


class PerformanceMemory(NamedTuple):
    """The sliding variable, the funnels' half-widths at this instant [rad], [rad/s], and the velocity seen last."""

    s: Array
    rho: Array
    rho_s: Array
    velocity: Array


@controller("prescribed-performance", gains=PerformanceGains, memory=PerformanceMemory)
def prescribed_performance(
    gains: PerformanceGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: PerformanceMemory,
    tau: Array,
) -> None:
    """Prescribed performance: tau = [tau_eq +] kV Mbar rho_s artanh(s/rho_s), with s = de + lambda rho artanh(e/rho).

    The funnels narrow by themselves, d rho/dt = -shrink (rho - rho_end), likewise rho_s; as long as both hold, |e| <
    rho(t) and |s| < rho_s(t). They begin at 1.5 times the error at least, and at 1.5 times s. Bechlioulis and
    Rovithakis, IEEE Transactions on Automatic Control 53 (2008), 2090, with the two funnels of their Automatica 50
    (2014), 1217, which needs neither a model nor a bound on the disturbance; tau_eq is added here and may be left out.
    The promise is of exact, immediate measurement and of torque without a limit: near a funnel's edge the gain grows
    without bound, which a delay, a control period or noise turn into shaking. It fails there, when a limit is reached,
    and when a reference jumps; an error outside is pulled back as from 0.999 rho.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        left = math.exp(-gains.shrink[i] * model.control_period)
        if memory.rho[i] == 0.0:
            memory.rho[i] = gains.rho[i] if gains.rho[i] > ROOM * abs(e) else ROOM * abs(e)
            s = abs(de + gains.lam[i] * memory.rho[i] * stretched(e / memory.rho[i]))
            memory.rho_s[i] = gains.rho_s[i] if gains.rho_s[i] > ROOM * s else ROOM * s
        else:
            memory.rho[i] = gains.rho_end[i] + (memory.rho[i] - gains.rho_end[i]) * left
            memory.rho_s[i] = gains.rho_s[i] + (memory.rho_s[i] - gains.rho_s[i]) * left
        s = de + gains.lam[i] * memory.rho[i] * stretched(e / memory.rho[i])
        memory.s[i] = s
        force = memory.rho_s[i] * stretched(s / memory.rho_s[i])
        tau[i] += gains.kv[i] * model.inertia_scale[i] * force
