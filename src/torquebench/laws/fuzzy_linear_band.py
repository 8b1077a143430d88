"""The paper's proposed law: linear band, fuzzy compensation and integral."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat
from torquebench.laws.base import Gain, Rules, controller
from torquebench.laws.parts import Band, Integral, Rate, Slope, Switching, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.model import Model


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
    """Gains and options of the fuzzy linear-band law."""

    lam: Slope
    k: Switching
    phi: Band
    kv: Rate
    kf: Annotated[
        Array,
        Gain(
            "fuzzy gain kF, a fraction of the torque limit, KF = kF tau_max; zero leaves the fuzzy part out", "1", False
        ),
    ]
    gd: Annotated[
        Array,
        Gain(
            "rate of the error that the fuzzy system sees as 1; the error that it sees as 1 is ge = gd/lambda", "rad/s"
        ),
    ]
    ki: Integral
    equivalent_control: UseModel
    fis: Annotated[Fis, Rules("fuzzy system FIS(e/ge, de/gd) whose output is multiplied by KF", scaled_errors)]


class FuzzyBandMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded, and the integral of the error."""

    s: Array
    integral: Array


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
    (151) adds it.
    """
    equivalent_control(gains.equivalent_control, gains.lam, model, q, qd, ref, tau)
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        s = de + gains.lam[i] * e
        x, y = scaled_errors(gains, i, e, de)
        memory.s[i] = s
        tau[i] += model.tau_max[i] * (gains.k[i] * sat(s / gains.phi[i]) + gains.kf[i] * infer(gains.fis, x, y))
        tau[i] += model.inertia_scale[i] * (gains.kv[i] * s + gains.ki[i] * memory.integral[i])
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
