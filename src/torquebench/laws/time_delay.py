"""Time-delay control: what the arm did one control instant ago stands for its dynamics."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array, clip
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import acceleration_rate, delayed_inertia, integrating_slope


class Gains(NamedTuple):
    """Gains of the law; lambda and kV act on accelerations."""

    lam: Annotated[Array, Gain("slope lambda; the position gain is lambda kV", "1/s", auto=integrating_slope)]
    kv: Annotated[Array, Gain("rate gain kV of an acceleration", "1/s", auto=acceleration_rate)]
    m: Annotated[
        Array,
        Gain("inertia that the law takes, over Mbar", "1", auto=delayed_inertia, search=(0.003, 1.0, "log")),
    ]


class Memory(NamedTuple):
    """Torque that was given last, within its limit [N m], and the velocity seen then [rad/s]."""

    torque: Array
    velocity: Array


@controller("time-delay", gains=Gains, memory=Memory)
def time_delay(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array
) -> None:
    """Time-delay control: tau = tau(t-T) + m Mbar (qdd_ref + kV de + lambda kV e - qdd(t-T)).

    Youcef-Toumi and Ito, ASME Journal of Dynamic Systems, Measurement, and Control 112 (1990), 133; Hsia, Lasky and
    Guo, IEEE Transactions on Industrial Electronics 38 (1991), 24. The arm's dynamics and loads are taken to be what
    they were one control period T ago, and qdd(t-T) is the last difference of the measured velocity over T: no model,
    and no error under a load that stays. Stable where I - m M^-1 Mbar has its eigenvalues within the unit circle and
    everything varies little in T.

    The sum over instants is m Mbar / T (int (qdd_ref + kV de + lambda kV e) - qd): a rate gain m Mbar / T, which noise
    of the velocity and a delay bear as little as any other. There m has to be so small that the law is slow. tau(t-T)
    is the torque within its limit, so that nothing winds up.
    """
    for i in range(len(tau)):
        wanted = ref.qdd[i] + gains.kv[i] * (ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i]))
        missing = wanted - (qd[i] - memory.velocity[i]) / model.control_period
        tau[i] = memory.torque[i] + gains.m[i] * model.inertia_scale[i] * missing
        memory.torque[i] = clip(tau[i], model.tau_max[i])
        memory.velocity[i] = qd[i]
