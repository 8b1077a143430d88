"""Laws that break the contract, each in its own way, and laws that only leave the dialect."""

from __future__ import annotations

HEAD = '''"""A user's file."""

import math
import random
import time
from typing import Annotated, NamedTuple

import numpy as np
from torquebench import Array, Gain, Option, controller, gravity, inverse_dynamics, sat
from torquebench.kernel import kernel

COUNT = 0
SEEN = []
KEPT = {}
LAST = np.zeros(6)


class Gains(NamedTuple):
    lam: Annotated[Array, Gain("slope", "1/s")]
    k: Annotated[Array, Gain("share of the torque limit", "1")]


class Memory(NamedTuple):
    s: Array


@controller("user-law", gains=Gains, memory=Memory)
def user_law(gains, model, t, q, qd, ref, memory, tau):
'''
SPRING = """for i in range(len(tau)):
    memory.s[i] = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
    tau[i] = gains.k[i] * model.tau_max[i] * sat(memory.s[i])
"""
LAW = HEAD.count("\n") - 1
"""Line of the decorator."""

# a marked line is where the law does it; the report names it
BAD: dict[str, tuple[str, set[str]]] = {
    "not a number at times": (SPRING + "    if t > 5.0:\n        tau[i] = math.nan", {"finite"}),
    "a root of what may be negative": (
        SPRING + "    tau[i] += math.sqrt(memory.s[i])  # here",
        {"finite", "loop"},
    ),
    "divides by the error": (SPRING + "    tau[i] += 1e-9 / (ref.q[i] - q[i])  # here", {"finite", "loop"}),
    "forgets a joint": (SPRING.replace("len(tau)", "len(tau) - 1"), {"finite", "loop"}),
    "counts on six joints": (
        SPRING.replace("len(tau)", "6").replace("(ref.q[i] - q[i])\n", "(ref.q[i] - q[i])  # here\n"),
        {"torque", "loop"},
    ),
    "counts on two joints": (SPRING.replace("len(tau)", "2"), {"finite", "loop"}),
    "wrong shape": ("return np.zeros(3)  # here", {"torque", "loop"}),
    "complex": ("return 1j * (ref.q - q)  # here", {"torque", "loop"}),
    "raises": (SPRING + "if t > 1.0:\n    raise RuntimeError('no solution')  # here", {"torque"}),
    "mutates q": (SPRING + "    q[i] = 0.0  # here", {"inputs"}),
    "mutates qd by a kernel": (SPRING + "gravity(model, q, qd)  # here", {"inputs"}),
    "mutates all of q": (SPRING + "q += 1.0  # here", {"inputs"}),
    "mutates gains": (SPRING + "    gains.k[i] *= 1.01  # here", {"inputs"}),
    "mutates the reference": (SPRING + "    ref.q[i] -= 0.1  # here", {"inputs"}),
    "mutates the model": (SPRING + "    model.inertia_scale[i] = 1.0  # here", {"?inputs", "?torque", "?loop"}),
    "counts in a global": (
        "global COUNT  # here\nCOUNT += 1\n" + SPRING + "    tau[i] += COUNT",
        {"repeatable", "state"},
    ),
    "keeps a list": (
        "SEEN.append(q[0])  # here\n" + SPRING + "    tau[i] += SEEN[-2] if len(SEEN) > 1 else 0.0",
        {"repeatable", "state"},
    ),
    "keeps a list, cleared at the start": (
        "if t < 0.0005 or t in (0.5, 1.0, 7.3, 2.0, 60.0):\n    SEEN.clear()  # here\n"
        + SPRING
        + "    tau[i] += SEEN[-1] if SEEN else 0.0\nSEEN.append(q[0])",
        {"state"},
    ),
    "keeps something by the place of its memory": (
        SPRING + "KEPT[id(memory)] = KEPT.get(id(memory), 0.0) + 1.0  # here\ntau[0] += KEPT[id(memory)]",
        {"state", "?repeatable"},
    ),
    "keeps something by the place of its memory, begun anew in each run": (
        "if t in (0.0, 0.5, 1.0, 7.3, 2.0, 60.0):\n    KEPT[id(memory)] = 0.0  # here\n"
        + SPRING
        + "KEPT[id(memory)] = KEPT.get(id(memory), 0.0) + q[0]\ntau[0] += KEPT[id(memory)]",
        {"state"},
    ),
    "keeps a global array": (
        SPRING + "    tau[i] += LAST[i]\n    LAST[i] = q[i]  # here",
        {"repeatable", "state"},
    ),
    "random": (SPRING + "    tau[i] += random.gauss(0.0, 0.1)  # here", {"repeatable", "state"}),
    "numpy's random": (SPRING + "    tau[i] += np.random.normal()  # here", {"repeatable", "state"}),
    "looks at the clock": (SPRING + "    tau[i] += time.perf_counter()  # here", {"repeatable", "state"}),
    "ignores a gain": (SPRING.replace("gains.k[i] * ", "0.5 * "), {"gains"}),
    "ignores a joint's gain": (SPRING.replace("gains.k[i]", "gains.k[0]"), {"gains"}),
    "swaps joints": (
        "n = len(tau)\nfor i in range(n):\n    j = n - 1 - i\n"
        "    s = ref.qd[j] - qd[j] + gains.lam[j] * (ref.q[j] - q[j])\n"
        "    tau[i] = gains.k[i] * model.tau_max[i] * sat(s)",
        {"joints"},
    ),
    "holds a joint still": (SPRING + "tau[1] = 0.0", {"joints", "gains"}),
    "rebinds the torque": ("tau = gains.k * (ref.q - q)  # here", {"finite", "loop"}),
    "ends the program": (SPRING + "raise SystemExit(0)  # here", {"torque", "loop"}),
    "changes the size of its memory": (SPRING + "memory.s.resize(9, refcheck=False)  # here", {"torque", "loop"}),
    "is an integer in one case and a float in another": (
        SPRING + "    n = 0\n    if q[i] > 100.0:\n        n = q[i]\n    memory.s[i] = -n",
        {"paths"},
    ),
    "an infinite memory": (SPRING + "    memory.s[i] = math.inf", {"finite"}),
}
assert len(BAD) >= 30
FIELDS = {"ignores a gain": "k", "ignores a joint's gain": "k", "holds a joint still": ""}
"""Cases in which the line of a field of Gains is named."""

SIGNATURES = {
    "seven arguments": ("def user_law(gains, model, t, q, qd, ref, tau):", {"arguments"}),
    "nine arguments": ("def user_law(gains, model, t, q, qd, ref, memory, tau, more):", {"arguments"}),
    "a default that is kept": (
        "def user_law(gains, model, t, q, qd, ref, memory, tau, seen=[]):\n    seen.append(1.0)",
        {"repeatable", "state"},
    ),
}

NOTES = {
    "a power": (SPRING.replace("sat(memory.s[i])", "sat(memory.s[i]) ** 3  # here"), "** 3"),
    "numpy's exponential": (SPRING.replace("sat(memory.s[i])", "np.exp(-abs(memory.s[i]))  # here"), "np.exp()"),
    "an array returned": (
        "return gains.k * np.tanh(gains.lam * (ref.q - q) + ref.qd - qd)  # here",
        "a value is returned",
    ),
    "a slice": ("tau[:] = gains.k * (gains.lam * (ref.q - q) + ref.qd - qd)  # here", "tau[:]"),
    "a helper": ("def f(x):  # here\n    return math.tanh(x)\n" + SPRING.replace("sat(", "f("), "def f(x)"),
}
