"""Sliding mode fuzzy control with two inputs: s, and a function of its past that tunes itself."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, sat
from torquebench.laws.declare import Gain, Rules
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, Switching
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import slow_forgetting, slow_integral


class TwoInputGains(NamedTuple):
    """Gains of the law."""

    lam: Slope
    k: Switching
    phi: Annotated[Array, Gain("sliding variable that the fuzzy system sees as 1", "rad/s")]
    gis: Annotated[
        Array, Gain("integral of s that moves the self-tuning function by 1", "rad", auto=slow_integral("phi"))
    ]
    forget: Annotated[
        Array,
        Gain(
            "rate at which the self-tuning function forgets; zero for never",
            "1/s",
            False,
            auto=slow_forgetting,
            search=(0.01, 10.0, "log"),
        ),
    ]
    fis: Annotated[Fis, Rules("fuzzy system FIS(s/phi, z) whose output is multiplied by K")]


class TwoInputMemory(NamedTuple):
    """The sliding variable, and the self-tuning function z."""

    s: Array
    z: Array


@controller("two-input-sliding-mode-fuzzy", gains=TwoInputGains, memory=TwoInputMemory)
def two_input_sliding_mode_fuzzy(
    gains: TwoInputGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: TwoInputMemory,
    tau: Array,
) -> None:
    """Two-input sliding mode fuzzy control: tau = K FIS(s/phi, z), dz = s/gis - forget z, |z| <= 1; no model.

    With s = de + lambda e. After Zhang et al., the paper's [28], whose inputs are the sliding surface and a
    "self tuning mechanism function". The paper does not print that function; here it is the bounded integral of s with
    forgetting, by which adaptive control tunes a bias: P. Ioannou and P. Kokotovic, Instability analysis and
    improvement of robustness of adaptive control, Automatica 20, 1984. It supplies the torque that s alone would need
    an error for. The second input of `fuzzy-boundary-layer` is the rate of s, which looks ahead; this one looks back.
    The bound on z is what keeps it from winding up.
    """
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        memory.s[i] = s
        tau[i] = gains.k[i] * model.tau_max[i] * infer(gains.fis, s / gains.phi[i], memory.z[i])
        rate = s / gains.gis[i] - gains.forget[i] * memory.z[i]
        memory.z[i] = sat(memory.z[i] + model.control_period * rate)
