"""Sliding mode fuzzy control: one input, s, and seven rules."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat
from torquebench.laws.declare import Gain, Rules
from torquebench.laws.law import controller
from torquebench.laws.parts import Slope, Switching
from torquebench.references import Reference
from torquebench.robot.flat_model import Model


@kernel
def scaled_surface(gains: SlidingFuzzyGains, joint: int, e: float, de: float) -> tuple[float, float]:
    """Return s/phi, clipped to [-1, 1], and zero, which a system of two inputs gets as its second.

    Args:
        gains: The law's gains.
        joint: Which joint.
        e, de: Its error [rad] and the error's rate [rad/s].
    """
    return sat((de + gains.lam[joint] * e) / gains.phi[joint]), 0.0


class SlidingFuzzyGains(NamedTuple):
    """Gains of the law."""

    lam: Slope
    k: Switching
    phi: Annotated[Array, Gain("sliding variable that the fuzzy system sees as 1", "rad/s")]
    fis: Annotated[Fis, Rules("fuzzy system FIS(s/phi) whose output is multiplied by K", scaled_surface, "s-7")]


class SlidingFuzzyMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded."""

    s: Array


@controller("sliding-mode-fuzzy", gains=SlidingFuzzyGains, memory=SlidingFuzzyMemory)
def sliding_mode_fuzzy(
    gains: SlidingFuzzyGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: SlidingFuzzyMemory,
    tau: Array,
) -> None:
    """Sliding mode fuzzy control: tau = K FIS(s/phi), with s = de + lambda e, one input and seven rules; no model.

    The built-in system `s-7` has one input. Of a system of two the row at zero of the second is used: with `pd-49`, in
    which the middle term alone fires there, that is the same seven rules. After Weng and Yu, the paper's
    [29]: Adaptive fuzzy sliding mode control for linear time-varying uncertain systems, IEEE International Conference
    on Fuzzy Systems, 2008; and of Lhee, Park, Ahn and Kim, its [26]: Sliding mode-like fuzzy logic control with
    self-tuning the dead zone parameters, IEEE Transactions on Fuzzy Systems 9, 2001. The paper prints neither law.
    Left out is what each of them adds: the tuning of the rules (Weng) and of the layer's thickness (Lhee).
    """
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        x, y = scaled_surface(gains, i, e, de)
        memory.s[i] = de + gains.lam[i] * e
        tau[i] = gains.k[i] * model.tau_max[i] * infer(gains.fis, x, y)
