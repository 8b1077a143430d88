"""A law with a fault that time, joint and kind decide, in the dialect so that both paths can run it.

It is one law, so that one is compiled, whatever the kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
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
    kind: Array
    """Kind of the fault, the same for every joint, (n,)."""


class FaultMemory(NamedTuple):
    """A sliding variable and a count of calls, so that what memory holds at the fault is compared too."""

    s: Array
    count: Array


SOUND, NOT_A_NUMBER, INFINITE, HUGE, DIVISION, DOMAIN, OVERFLOW, FORGOTTEN = map(float, range(8))
"""Kinds of fault: none; NaN; infinity, or a finite torque that no arm stands, of the given size and sign; division by
zero, in the middle of filling the memory; the root of a negative number; an exponential beyond the range of numbers,
hidden in a bounded function; a joint that is left out."""


def faulty(
    gains: FaultGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: FaultMemory, tau: Array
) -> None:
    """Fill `tau` with PD, and the memory; at the time of the fault one joint does what its kind says."""
    for i in range(len(tau)):
        memory.count[i] += 1.0
        memory.s[i] = ref.qd[i] - qd[i] + 8.0 * (ref.q[i] - q[i])
        if gains.kind[i] != FORGOTTEN or t < gains.at[i] or gains.here[i] == 0.0:
            tau[i] = 12.0 * model.inertia_scale[i] * memory.s[i]
    for i in range(len(tau)):
        if gains.kind[i] == DIVISION:
            memory.s[i] += 1.0
            if gains.here[i] > 0.0:
                memory.s[i] /= gains.at[i] - t if t >= gains.at[i] else 1.0
            memory.count[i] += 0.5
        elif gains.kind[i] == DOMAIN and gains.here[i] > 0.0:
            tau[i] += 0.0 * math.sqrt(1.0 if t < gains.at[i] else -1.0)
        elif gains.kind[i] == OVERFLOW and gains.here[i] > 0.0:
            tau[i] += math.tanh(math.exp(1.0 if t < gains.at[i] else 1e4))
        elif t >= gains.at[i] and gains.here[i] > 0.0:
            if gains.kind[i] == NOT_A_NUMBER:
                tau[i] = math.nan
            elif gains.kind[i] == INFINITE:
                tau[i] = math.copysign(math.inf, gains.size[i])
            elif gains.kind[i] == HUGE:
                tau[i] = gains.size[i]


def controller(
    kind: float, n: int, at: float, joint: int = 0, size: float = 1.0, function: Callable[..., Any] = faulty
) -> Controller:
    """Return a controller with a fault.

    Args:
        kind: Of the fault.
        n: Number of joints.
        at: Time of the fault [s].
        joint: Which joint fails.
        size: Torque that the fault asks for [N m].
        function: The law.
    """
    law = Law(function.__name__.replace("_", "-"), function, FaultGains, FaultMemory, {}, {})
    gains = FaultGains(np.full(n, at), np.eye(n)[joint], np.full(n, size), np.full(n, kind))
    return Controller(law.name, law, gains)
