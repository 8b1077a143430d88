"""A learned policy as a law: written by train_policy.py, trained on paper/sine."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench import Array, Gain, controller


class Gains(NamedTuple):
    """Gains of the learned policy."""

    lam: Annotated[Array, Gain("bandwidth at which the net is used; it was trained at 20", "1/s")]


class Memory(NamedTuple):
    """State of the learned policy."""

    integral: Array


@controller("learned-policy", gains=Gains, memory=Memory)
def learned_policy(gains, model, t, q, qd, ref, memory, tau):
    """A net without a model: tau = lam Mbar sum_j w_j tanh(a_j lam e + b_j de + c_j lam^2 int e) on every joint.

    The integral stands still while the torque is beyond its limit in the error's direction.
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        a, b, c = gains.lam[i] * e, ref.qd[i] - qd[i], gains.lam[i] * gains.lam[i] * memory.integral[i]
        y = 13.7102 * math.tanh(0.349476 * a + 0.254682 * b + 0.0880173 * c)
        y += -2.99486 * math.tanh(-0.227532 * a - 0.149183 * b + 0.0283944 * c)
        y += 11.2167 * math.tanh(-0.0802477 * a + 0.119358 * b + 0.454466 * c)
        y += 8.30899 * math.tanh(0.12331 * a + 0.0475287 * b + 0.540631 * c)
        tau[i] = gains.lam[i] * model.inertia_scale[i] * y
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
