"""PI control of the sliding variable: what is left of a sliding-mode law without switching."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Rate, Slope, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import slow_pull


class SlidingPiGains(NamedTuple):
    """Gains and options of the law."""

    lam: Slope
    kv: Rate
    kis: Annotated[
        Array,
        Gain("gain of the integral of s, times Mbar; zero leaves the integral out", "1/s^2", False, auto=slow_pull),
    ]
    equivalent_control: UseModel


class SlidingPiMemory(NamedTuple):
    """The sliding variable, its integral [rad], and the velocity seen last."""

    s: Array
    s_integral: Array
    velocity: Array


@controller("sliding-pi", gains=SlidingPiGains, memory=SlidingPiMemory)
def sliding_pi(
    gains: SlidingPiGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: SlidingPiMemory,
    tau: Array,
) -> None:
    """PI of s: tau = [tau_eq +] Mbar (kV s + kis int s), with s = de + lambda e.

    Slotine and Li, International Journal of Robotics Research 6 (1987), 49, for Kd s; with its integral Parra-Vega et
    al., IEEE Transactions on Robotics and Automation 19 (2003), 967, there with sgn(s) under the integral. Without a
    model it is a PID law; with one, a constant torque that the model does not know leaves no error. It is the ablation
    of every law here that switches: a disturbance that moves leaves an error of its rate over kis Mbar lambda. The
    integral stops growing while the torque is beyond its limit in the direction of s.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        memory.s[i] = s
        tau[i] += model.inertia_scale[i] * (gains.kv[i] * s + gains.kis[i] * memory.s_integral[i])
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * s > 0.0):
            memory.s_integral[i] += model.control_period * s
