"""Sliding mode with an integral in its surface, whose dynamics a fuzzy system estimates in parallel."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat, sign
from torquebench.laws.declare import Option, Rules
from torquebench.laws.fuzzy_pid import ErrorScale, RateScale, Torque
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, Switching, equivalent_control
from torquebench.laws.sliding_mode import PI, PID, SIGN, Switch, SwitchBand, surface_of
from torquebench.references import Reference
from torquebench.robot.flat_model import Model

WITH_RATE = 0
"""Place of pid among the choices of the surface."""


@kernel
def error_and_rate(gains: EstimatorGains, joint: int, e: float, de: float) -> tuple[float, float]:
    """Return e/ge and de/gd, clipped to [-1, 1].

    Args:
        gains: The law's gains.
        joint: Which joint.
        e, de: Its error [rad] and the error's rate [rad/s].
    """
    return sat(e / gains.ge[joint]), sat(de / gains.gd[joint])


class EstimatorGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    k: Switching
    phi: SwitchBand
    kf: Torque
    ge: ErrorScale
    gd: RateScale
    switching: Switch
    surface: Annotated[
        int,
        Option("sliding variable: pid is de + lambda e + (lambda/2)^2 int e (86), pi has no de (85)", ("pid", "pi")),
    ]
    equivalent_control: Annotated[
        int,
        Option(
            "add the model's equivalent control to the estimate; the choices are those of the law smc",
            (False, True, "measured-acceleration"),
        ),
    ]
    fis: Annotated[Fis, Rules("fuzzy system FIS(e/ge, de/gd) whose output, times KF, is the estimate", error_and_rate)]


class EstimatorMemory(NamedTuple):
    """The sliding variable; the integral of the error; the velocity seen last."""

    s: Array
    integral: Array
    velocity: Array


@controller("pi-smc-fuzzy-estimator", gains=EstimatorGains, memory=EstimatorMemory)
def pi_smc_fuzzy_estimator(
    gains: EstimatorGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: EstimatorMemory,
    tau: Array,
) -> None:
    """PI sliding mode, fuzzy estimator: tau = [tau_eq +] KF FIS(e/ge, de/gd) + K sgn(s), or K sat(s/phi).

    With s = de + lambda e + (lambda/2)^2 int e and KF = kF tau_max. After Wu et al., the paper's [22]: PI
    sliding mode for an electro-hydraulic drive, with a fuzzy system in parallel that estimates the equivalent part. The
    paper does not print the law; the estimate is taken as the paper's own (150) has it, a static system of error and
    rate. On the surface pi nothing slides, as for `smc`. The integral stops growing while the torque is beyond its
    limit in the error's direction.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.25, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        s = surface_of(PID if gains.surface == WITH_RATE else PI, gains.lam[i], e, de, memory.integral[i])
        switch = sign(s) if gains.switching == SIGN else sat(s / gains.phi[i])
        x, y = error_and_rate(gains, i, e, de)
        memory.s[i] = s
        tau[i] += model.tau_max[i] * (gains.k[i] * switch + gains.kf[i] * infer(gains.fis, x, y))
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
