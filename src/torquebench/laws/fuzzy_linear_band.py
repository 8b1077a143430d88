"""The paper's proposed law: linear band, fuzzy compensation and integral."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat, sign
from torquebench.laws.declare import Gain, Option, Rules
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import fuzzy_torque, fuzzy_width, rate

FUZZY, CLIPPED_SUM = 0, 1
"""Choices of ``compensation``; the third is none."""
SATURATION, SIGN = 0, 1
"""Choices of ``band``; the third is none."""


@kernel
def scaled_errors(gains: FuzzyBandGains, joint: int, e: float, de: float) -> tuple[float, float]:
    """Return the inputs of the fuzzy system, e/ge and de/gd with ge = gd/lambda, clipped to [-1, 1].

    Args:
        gains: The law's gains.
        joint: Which joint.
        e, de: Its error [rad] and the error's rate [rad/s].
    """
    return sat(gains.lam[joint] * e / gains.gd[joint]), sat(de / gains.gd[joint])


class FuzzyBandGains(NamedTuple):
    """Gains and options of the fuzzy linear-band law; all options but the model's are ablations."""

    lam: Slope
    k: Annotated[
        Array,
        Gain(
            "switching gain kK, a fraction of the torque limit, K = kK tau_max",
            "1",
            only_with=("band", "saturation", "sign"),
        ),
    ]
    phi: Annotated[Array, Gain("half-width phi of the band |s| <= phi", "rad/s", only_with=("band", "saturation"))]
    kv: Annotated[
        Array,
        Gain(
            "rate gain kV, Kd = kV Mbar with Mbar the model's inertia scale; the position gain is lambda Kd",
            "1/s",
            only_with=("linear", True),
            auto=rate,
        ),
    ]
    kf: Annotated[
        Array,
        Gain(
            "fuzzy gain kF, a fraction of the torque limit, KF = kF tau_max",
            "1",
            False,
            ("compensation", "fuzzy", "clipped-sum"),
            fuzzy_torque,
        ),
    ]
    gd: Annotated[
        Array,
        Gain(
            "rate of the error that the fuzzy system sees as 1; it sees the error ge = gd/lambda as 1",
            "rad/s",
            only_with=("compensation", "fuzzy", "clipped-sum"),
            auto=fuzzy_width,
        ),
    ]
    ki: Annotated[Array, Gain("integral gain kI, KI = kI Mbar", "1/s^3", False, ("integral", True))]
    equivalent_control: UseModel
    compensation: Annotated[
        int,
        Option(
            "what compensates the arm's dynamics: the fuzzy system, clip(x + y) of its two inputs, or nothing",
            ("fuzzy", "clipped-sum", "off"),
        ),
    ]
    integral: Annotated[int, Option("whether there is an integral", (True, False))]
    band: Annotated[
        int,
        Option("switching term: K sat(s/phi); K sgn(s), as (149) prints it; or none", ("saturation", "sign", "off")),
    ]
    linear: Annotated[int, Option("whether there is the linear term Kd s", (True, False))]
    fis: Annotated[
        Fis,
        Rules(
            "fuzzy system FIS(e/ge, de/gd) whose output is multiplied by KF",
            scaled_errors,
            only_with=("compensation", "fuzzy"),
        ),
    ]


class FuzzyBandMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded, the integral of the error, the velocity seen last."""

    s: Array
    integral: Array
    velocity: Array


@controller("fuzzy-linear-band-smc", gains=FuzzyBandGains, memory=FuzzyBandMemory)
def fuzzy_linear_band_smc(
    gains: FuzzyBandGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: FuzzyBandMemory,
    tau: Array,
) -> None:
    """Fuzzy linear band: tau = [tau_eq +] K sat(s/phi) + Kd s + KF FIS(e/ge, de/gd) + KI int e; (149)-(151).

    With sat for the sgn of (149), ge = gd/lambda, KF = kF tau_max and KI = kI Mbar. The integral stops growing while
    the torque is beyond its limit in the error's direction. The paper's text lets the fuzzy system replace tau_eq,
    (151) adds it. Each term can be left out or replaced, to see what carries the law.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        s = de + gains.lam[i] * e
        memory.s[i] = s
        limited, scaled = 0.0, 0.0
        if gains.band == SATURATION:
            limited = gains.k[i] * sat(s / gains.phi[i])
        elif gains.band == SIGN:
            limited = gains.k[i] * sign(s)
        if gains.compensation <= CLIPPED_SUM:
            x, y = scaled_errors(gains, i, e, de)
            limited += gains.kf[i] * (infer(gains.fis, x, y) if gains.compensation == FUZZY else sat(x + y))
        if gains.linear:
            scaled = gains.kv[i] * s
        if gains.integral:
            scaled += gains.ki[i] * memory.integral[i]
        tau[i] += model.tau_max[i] * limited
        tau[i] += model.inertia_scale[i] * scaled
        if gains.integral and not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
