"""Fuzzy control without a model: PD-, PI- and PID-like, Mamdani or Sugeno, with whatever rules the config names."""

from __future__ import annotations

from typing import Annotated, NamedTuple, TypeAlias

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat
from torquebench.laws.declare import Gain, Rules
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import fuzzy_torque, fuzzy_width, slow_integral

Torque: TypeAlias = Annotated[
    Array, Gain("fuzzy gain kF, a fraction of the torque limit, KF = kF tau_max", "1", auto=fuzzy_torque)
]
ErrorScale: TypeAlias = Annotated[Array, Gain("error that the fuzzy system sees as 1", "rad")]
RateScale: TypeAlias = Annotated[
    Array, Gain("rate of the error that the fuzzy system sees as 1", "rad/s", auto=fuzzy_width)
]
IntegralScale: TypeAlias = Annotated[
    Array, Gain("integral of the error that the fuzzy system sees as 1", "rad s", auto=slow_integral("ge"))
]


@kernel
def error_and_rate(gains: FuzzyPdGains | FuzzyPidGains, joint: int, e: float, de: float) -> tuple[float, float]:
    """Return e/ge and de/gd, clipped to [-1, 1].

    Args:
        gains: The law's gains.
        joint: Which joint.
        e, de: Its error [rad] and the error's rate [rad/s].
    """
    return sat(e / gains.ge[joint]), sat(de / gains.gd[joint])


class FuzzyPdGains(NamedTuple):
    """Gains of the PD-like law."""

    kf: Torque
    ge: ErrorScale
    gd: RateScale
    fis: Annotated[Fis, Rules("fuzzy system FIS(e/ge, de/gd) whose output is multiplied by KF", error_and_rate)]


class FuzzyPiGains(NamedTuple):
    """Gains of the PI-like law."""

    kf: Torque
    ge: ErrorScale
    gi: IntegralScale
    fis: Annotated[Fis, Rules("fuzzy system FIS(e/ge, int e/gi) whose output is multiplied by KF")]


class FuzzyPidGains(NamedTuple):
    """Gains of the PID-like law."""

    kf: Torque
    ge: ErrorScale
    gd: RateScale
    gi: IntegralScale
    fis: Annotated[Fis, Rules("fuzzy system of both parts; the output's sum is multiplied by KF/2", error_and_rate)]


class IntegralMemory(NamedTuple):
    """The integral of the error."""

    integral: Array


@kernel
def integrate(integral: Array, joint: int, e: float, scale: float, control_period: float) -> None:
    """Integrate the error, unless the integral already lies beyond the fuzzy system's range.

    Args:
        integral: Integral of the error, (n,) [rad s]; written.
        joint: Which joint.
        e: Its error [rad].
        scale: Integral that the fuzzy system sees as 1 [rad s].
        control_period: Time between control instants [s].
    """
    if not (abs(integral[joint]) >= scale and integral[joint] * e > 0.0):
        integral[joint] += control_period * e


@controller("fuzzy-pd", gains=FuzzyPdGains)
def fuzzy_pd(
    gains: FuzzyPdGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array
) -> None:
    """PD-like fuzzy control: tau = KF FIS(e/ge, de/gd), KF = kF tau_max; the paper's "Fuzzy Controller Operation".

    With pd-25 and pd-49 it is pure fuzzy control with 25 and 49 rules. Form: Driankov, Hellendoorn and Reinfrank, An
    Introduction to Fuzzy Control, 1993, chapter 3.
    """
    for i in range(len(tau)):
        x, y = error_and_rate(gains, i, ref.q[i] - q[i], ref.qd[i] - qd[i])
        tau[i] = gains.kf[i] * model.tau_max[i] * infer(gains.fis, x, y)


@controller("fuzzy-pi", gains=FuzzyPiGains, memory=IntegralMemory)
def fuzzy_pi(
    gains: FuzzyPiGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: IntegralMemory,
    tau: Array,
) -> None:
    """PI-like fuzzy control: tau = KF FIS(e/ge, int e/gi), KF = kF tau_max; inputs as the paper names them.

    Nothing in it damps a joint: on an arm without friction it oscillates. The integral stops growing at its scale gi.
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        x, y = sat(e / gains.ge[i]), sat(memory.integral[i] / gains.gi[i])
        tau[i] = gains.kf[i] * model.tau_max[i] * infer(gains.fis, x, y)
        integrate(memory.integral, i, e, gains.gi[i], model.control_period)


@controller("fuzzy-pid", gains=FuzzyPidGains, memory=IntegralMemory)
def fuzzy_pid(
    gains: FuzzyPidGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: IntegralMemory,
    tau: Array,
) -> None:
    """PID-like fuzzy control: tau = KF/2 (FIS(e/ge, de/gd) + FIS(e/ge, int e/gi)), KF = kF tau_max.

    The paper names three inputs, error, rate and integral. A system of three inputs with seven terms has 343 rules;
    this is the usual parallel form of two systems with the same rules: Xu, Hang and Liu, Parallel structure and tuning
    of a fuzzy PID controller, Automatica 36, 2000. The integral stops growing at its scale gi.
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        x, y = error_and_rate(gains, i, e, ref.qd[i] - qd[i])
        z = sat(memory.integral[i] / gains.gi[i])
        tau[i] = 0.5 * gains.kf[i] * model.tau_max[i] * (infer(gains.fis, x, y) + infer(gains.fis, x, z))
        integrate(memory.integral, i, e, gains.gi[i], model.control_period)
