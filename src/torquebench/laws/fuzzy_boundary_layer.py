"""Fuzzy boundary layer: sliding mode whose switching function is a fuzzy system of s and its rate."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array
from torquebench.laws.declare import Gain, Rules
from torquebench.laws.law import controller
from torquebench.laws.parts import Band, Slope, Switching, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import turn_width


class FuzzyLayerGains(NamedTuple):
    """Gains and option of the law."""

    lam: Slope
    k: Switching
    phi: Band
    gds: Annotated[
        Array, Gain("rate of s that the fuzzy system sees as 1; it sees s = phi as 1", "rad/s^2", auto=turn_width)
    ]
    equivalent_control: UseModel
    fis: Annotated[Fis, Rules("fuzzy system FIS(s/phi, ds/gds) whose output is multiplied by K")]


class FuzzyLayerMemory(NamedTuple):
    """The sliding variable; 1 once it has been seen, so that it has a rate; the velocity seen last."""

    s: Array
    seen: Array
    velocity: Array


@controller("fuzzy-boundary-layer", gains=FuzzyLayerGains, memory=FuzzyLayerMemory)
def fuzzy_boundary_layer(
    gains: FuzzyLayerGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: FuzzyLayerMemory,
    tau: Array,
) -> None:
    """Fuzzy boundary layer: tau = [tau_eq +] K FIS(s/phi, ds/gds), with s = de + lambda e and ds its rate.

    After R. Palm, Sliding mode fuzzy control, IEEE International Conference on Fuzzy Systems, 1992, the paper's [21],
    of which it says two inputs and 49 rules. s and its rate as the inputs are the form of later work; the torque grows
    while s leaves the surface and shrinks while it returns. The rate is the last difference of s over the control
    period, zero at the first instant. It contains the acceleration, which the torque moves at once: the sampled loop
    rings where the slope of the rules times K / (gds M) reaches 1.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        rate = memory.seen[i] * (s - memory.s[i]) / model.control_period
        tau[i] += gains.k[i] * model.tau_max[i] * infer(gains.fis, s / gains.phi[i], rate / gains.gds[i])
        memory.s[i] = s
        memory.seen[i] = 1.0
