"""PD control, with and without gravity compensation, and PID."""

from __future__ import annotations

from typing import NamedTuple

from torquebench.kernel import Array
from torquebench.laws.law import controller
from torquebench.laws.parts import Integral, Rate, Slope
from torquebench.references import Reference
from torquebench.robot.dynamics import gravity
from torquebench.robot.flat_model import Model


class PdGains(NamedTuple):
    """Gains of PD laws."""

    lam: Slope
    kv: Rate


class PidGains(NamedTuple):
    """Gains of the PID law."""

    lam: Slope
    kv: Rate
    ki: Integral


class PidMemory(NamedTuple):
    """State of the PID law."""

    integral: Array


@controller("pd", gains=PdGains)
def pd(gains: PdGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array) -> None:
    """PD: tau = Kp e + Kd de, Kd = kV Mbar, Kp = lambda Kd; equation (137) with e = q_ref - q."""
    for i in range(len(tau)):
        tau[i] = gains.kv[i] * model.inertia_scale[i] * (ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i]))


@controller("pd-gravity", gains=PdGains)
def pd_gravity(
    gains: PdGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array
) -> None:
    """PD with gravity compensation: tau = Kp e + Kd de + g^(q); Takegaki and Arimoto (1981)."""
    gravity(model, q, tau)
    for i in range(len(tau)):
        tau[i] += gains.kv[i] * model.inertia_scale[i] * (ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i]))


@controller("pid", gains=PidGains, memory=PidMemory)
def pid(
    gains: PidGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: PidMemory, tau: Array
) -> None:
    """PID: tau = Kp e + Kd de + KI int e, Kd = kV Mbar, Kp = lambda Kd, KI = kI Mbar.

    Arimoto and Miyazaki, Robotics Research: The First International Symposium (1984), 783, for an arm. The integral is
    a sum over control instants and does not grow while the torque is beyond its limit in the error's direction
    (conditional integration).
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        scale = model.inertia_scale[i]
        tau[i] = scale * (gains.kv[i] * (ref.qd[i] - qd[i] + gains.lam[i] * e) + gains.ki[i] * memory.integral[i])
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
