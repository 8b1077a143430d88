"""Terminal sliding modes: surfaces with roots of the error, along which it is gone in a finite or in a fixed time."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array, kernel, sign
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics
from torquebench.robot.flat_model import Model
from torquebench.tuning import ERROR, Fit, acceleration_rate, as_much, pole

CORE = 0.1
"""Below this the square root goes on as a parabola with the same value and slope, steepest at zero [1]."""
STEEPEST = 1.5 / math.sqrt(CORE)
"""Its slope there [1]."""
KNEE = 10.0
"""Error at which the powers meet, over `ERROR`, where it is chosen [1]."""


@kernel
def root(x: float) -> float:
    """Return the square root of x >= 0, below `CORE` the parabola (3 y - y^2)/2 sqrt(`CORE`), y = x / `CORE`.

    Args:
        x: Where [1].
    """
    if x >= CORE:
        return math.sqrt(x)
    y = x / CORE
    return 0.5 * math.sqrt(CORE) * y * (3.0 - y)


@kernel
def root_slope(x: float) -> float:
    """Return the derivative of `root`.

    Args:
        x: Where [1].
    """
    if x >= CORE:
        return 0.5 / math.sqrt(x)
    return 0.5 / math.sqrt(CORE) * (3.0 - 2.0 * x / CORE)


def terminal_slope(fit: Fit) -> Array:
    """Slope: 0.4 of `pole`, as that of the surface at an error of E/250 is 4.2 lambda."""
    return 0.4 * pole(fit)


def near_slope(fit: Fit) -> Array:
    """Slope: 0.8 of `pole` where the root is steepest."""
    return 0.8 * pole(fit) / STEEPEST


def knee(fit: Fit) -> Array:
    """Error at which the powers meet: ten times `ERROR`."""
    return np.full_like(fit.limits.tau_max, KNEE * ERROR)


Knee: TypeAlias = Annotated[
    Array, Gain("error E at which the powers of the surface are equal", "rad", True, None, knee, (5e-3, 0.5, "log"))
]
Reach: TypeAlias = Annotated[
    Array, Gain("rate kV of the reaching law, an acceleration over s", "1/s", auto=acceleration_rate)
]


class NonsingularGains(NamedTuple):
    """Gains of the non-singular law."""

    lam: Annotated[Array, Gain("slope lambda of the surface, that of its powers at E", "1/s", auto=terminal_slope)]
    knee: Knee
    fast: Annotated[
        Array,
        Gain(
            "share of the square of the error; zero is Feng, Yu and Man's surface",
            "1",
            False,
            None,
            as_much,
            (0.01, 10, "log"),
        ),
    ]
    kv: Reach


class TerminalMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded."""

    s: Array


@controller("nonsingular-terminal-smc", gains=NonsingularGains, memory=TerminalMemory)
def nonsingular_terminal_smc(
    gains: NonsingularGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: TerminalMemory,
    tau: Array,
) -> None:
    """Non-singular fast terminal sliding mode: s = lambda e (1 + fast |e|/E) + S |v|^3/2 sgn(v), v = de/S.

    S = lambda E, tau = M^ (qdd_ref + (2/3) lambda S (1 + 2 fast |e|/E) |v|^1/2 sgn(v) + kV (s + S root(|s|/S) sgn(s)))
    + N^. On s = 0 the error is gone in at most 3 (|e|/E)^1/3 / lambda; with fast > 0 sooner. Yang and Yang,
    International Journal of Robust and Nonlinear Control 21 (2011), 1865, with the powers 2 and 3/2; with fast = 0
    Feng, Yu and Man, Automatica 38 (2002), 2159. Needs a model. Its reaching law is continuous, so that what the model
    leaves over keeps s near zero and not at it; and as that moves s by |v|^1/2 times itself, s is hardly held where de
    passes zero. `root` is the square root that is a parabola below a tenth, lest the sampled loop ring at zero.
    """
    for i in range(len(tau)):
        e, de, scale = ref.q[i] - q[i], ref.qd[i] - qd[i], gains.lam[i] * gains.knee[i]
        far, sharp = gains.fast[i] * abs(e) / gains.knee[i], math.sqrt(abs(de) / scale)
        s = gains.lam[i] * e * (1.0 + far) + de * sharp
        memory.s[i] = s
        along = gains.lam[i] * scale * (1.0 + 2.0 * far) * sharp * sign(de) / 1.5
        model.scratch.free[i] = ref.qdd[i] + along + gains.kv[i] * (s + scale * root(abs(s) / scale) * sign(s))
    inverse_dynamics(model, q, qd, model.scratch.free, tau)


class FixedTimeGains(NamedTuple):
    """Gains of the fixed-time law."""

    lam: Annotated[Array, Gain("slope lambda of the surface, that of its powers at E", "1/s", auto=near_slope)]
    knee: Knee
    kv: Reach


@controller("fixed-time-smc", gains=FixedTimeGains, memory=TerminalMemory)
def fixed_time_smc(
    gains: FixedTimeGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: TerminalMemory,
    tau: Array,
) -> None:
    """Fixed-time terminal sliding mode: s = de + S f(|e|/E) sgn(e), f(x) = root(x) + x^3/2, S = lambda E.

    tau = M^ (qdd_ref + lambda f'(|e|/E) de + kV S f(|s|/S) sgn(s)) + N^. From any start s is below S/10 within pi / kV,
    and on s = 0 the error is below E/10 within pi / lambda, from where on both decay by the exponential of a slope of
    4.7. Polyakov, IEEE Transactions on Automatic Control 57 (2012), 2106; Zuo, IET Control Theory and Applications 9
    (2015), 545; that both times are pi for the powers 1/2 and 3/2 is by Parsegov, Polyakov and Shcherbakov, Doklady
    Mathematics 87 (2013), 133. Needs a model, and torque: a limit that is reached voids the bound. What the model
    leaves over keeps s near zero and not at it. `root`, the square root that is a parabola below a tenth, keeps f'
    finite at zero.
    """
    for i in range(len(tau)):
        e, de, scale = ref.q[i] - q[i], ref.qd[i] - qd[i], gains.lam[i] * gains.knee[i]
        x = abs(e) / gains.knee[i]
        s = de + scale * (root(x) + x * math.sqrt(x)) * sign(e)
        y = abs(s) / scale
        memory.s[i] = s
        along = gains.lam[i] * (root_slope(x) + 1.5 * math.sqrt(x)) * de
        model.scratch.free[i] = ref.qdd[i] + along + gains.kv[i] * scale * (root(y) + y * math.sqrt(y)) * sign(s)
    inverse_dynamics(model, q, qd, model.scratch.free, tau)
