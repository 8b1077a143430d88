"""Sliding mode control: the conventional law and the linear-band law."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array, sat, sign
from torquebench.laws.base import Gain, Option, controller
from torquebench.laws.parts import Band, Rate, Slope, Switching, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.model import Model

SIGN = 0


class SmcGains(NamedTuple):
    """Gains and options of the conventional law."""

    lam: Slope
    k: Switching
    phi: Annotated[Array, Gain("half-width phi of the band |s| <= phi", "rad/s", only_with=("switching", "saturation"))]
    equivalent_control: UseModel
    switching: Annotated[int, Option("switching function: sgn(s) (96), or sat(s/phi) (127)", ("sign", "saturation"))]


class LinearBandGains(NamedTuple):
    """Gains and options of the linear-band law."""

    lam: Slope
    k: Switching
    phi: Band
    kv: Rate
    equivalent_control: UseModel


class SlidingMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded."""

    s: Array


@controller("smc", gains=SmcGains, memory=SlidingMemory)
def smc(
    gains: SmcGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: SlidingMemory, tau: Array
) -> None:
    """Conventional sliding mode: tau = [tau_eq +] K sgn(s), or K sat(s/phi); s = de + lambda e; (97), (102), (126)."""
    equivalent_control(gains.equivalent_control, gains.lam, model, q, qd, ref, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        switch = sign(s) if gains.switching == SIGN else sat(s / gains.phi[i])
        memory.s[i] = s
        tau[i] += gains.k[i] * model.tau_max[i] * switch


@controller("linear-band-smc", gains=LinearBandGains, memory=SlidingMemory)
def linear_band_smc(
    gains: LinearBandGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: SlidingMemory,
    tau: Array,
) -> None:
    """Linear band: tau = [tau_eq +] K sat(s/phi) + Kd s, Kd = kV Mbar; (126), (148) with Kd, (149) with sat for sgn.

    (149) keeps sgn(s) beside the linear term and (148) takes Kd = 1 N m s/rad; so read, it chatters as much as the
    conventional law.
    """
    equivalent_control(gains.equivalent_control, gains.lam, model, q, qd, ref, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        memory.s[i] = s
        tau[i] += gains.k[i] * model.tau_max[i] * sat(s / gains.phi[i]) + gains.kv[i] * model.inertia_scale[i] * s
