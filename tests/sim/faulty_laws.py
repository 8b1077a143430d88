"""Laws with a fault that time and joint decide, written in the dialect so that both paths can run them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array, kernel
from torquebench.laws.law import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.sim.session import Controller


class FaultGains(NamedTuple):
    """When and where a law fails."""

    at: Array
    """Time of the fault, the same for every joint, (n,) [s]."""
    here: Array
    """1 for the joint that fails, else 0, (n,)."""
    size: Array
    """How large a torque the fault asks for, the same for every joint, (n,) [N m]."""


class FaultMemory(NamedTuple):
    """A sliding variable and a count of calls, so that what memory holds at the fault is compared too."""

    s: Array
    count: Array


@kernel
def healthy(model: Model, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array) -> None:
    """Fill `tau` with PD, and the memory."""
    for i in range(len(tau)):
        memory.count[i] += 1.0
        memory.s[i] = ref.qd[i] - qd[i] + 8.0 * (ref.q[i] - q[i])
        tau[i] = 12.0 * model.inertia_scale[i] * memory.s[i]


def sound(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Never fail."""
    healthy(model, q, qd, ref, memory, tau)


def not_a_number(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Ask for NaN."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        if t >= gains.at[i] and gains.here[i] > 0.0:
            tau[i] = math.nan


def infinite(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Ask for infinity, of the sign of the size."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        if t >= gains.at[i] and gains.here[i] > 0.0:
            tau[i] = math.copysign(math.inf, gains.size[i])


def huge(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Ask for a torque that no arm stands, but a finite one."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        if t >= gains.at[i] and gains.here[i] > 0.0:
            tau[i] = gains.size[i]


def division(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Divide by zero, in the middle of filling the memory."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        memory.s[i] += 1.0
        if gains.here[i] > 0.0:
            memory.s[i] /= gains.at[i] - t if t >= gains.at[i] else 1.0
        memory.count[i] += 0.5


def domain(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Take the root of a negative number."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        if gains.here[i] > 0.0:
            tau[i] += 0.0 * math.sqrt(1.0 if t < gains.at[i] else -1.0)


def overflow(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Take an exponential beyond the range of numbers, and hide it in a bounded function."""
    healthy(model, q, qd, ref, memory, tau)
    for i in range(len(tau)):
        if gains.here[i] > 0.0:
            tau[i] += math.tanh(math.exp(1.0 if t < gains.at[i] else 1e4))


def forgotten(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Leave one joint out."""
    for i in range(len(tau)):
        memory.count[i] += 1.0
        memory.s[i] = ref.qd[i] - qd[i] + 8.0 * (ref.q[i] - q[i])
        if t < gains.at[i] or gains.here[i] == 0.0:
            tau[i] = 12.0 * model.inertia_scale[i] * memory.s[i]


def controller(function: Callable[..., Any], n: int, at: float, joint: int = 0, size: float = 1.0) -> Controller:
    """Return a controller of one of these laws.

    Args:
        function: The law.
        n: Number of joints.
        at: Time of the fault [s].
        joint: Which joint fails.
        size: Torque that the fault asks for [N m].
    """
    law = Law(function.__name__.replace("_", "-"), function, FaultGains, FaultMemory, {}, {})
    return Controller(law.name, law, FaultGains(np.full(n, at), np.eye(n)[joint], np.full(n, size)))
