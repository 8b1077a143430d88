"""Bodies of laws within the dialect and outside it, for the tests of what is said about them."""

from __future__ import annotations

HEAD = '''"""A user's file."""

import math
import random
import time
from typing import Annotated, Any, NamedTuple

import numpy as np
from torquebench import Array, Fis, Gain, Option, controller, gravity, inverse_dynamics, mass_matrix, sat, sign
from torquebench.kernel import kernel

LIMIT = 3.0
drift = 0.5
BUFFER = np.zeros(6)
SEEN = []
RNG = np.random.default_rng(0)
STEP = np.float64(0.5)
COUNT = 0


class Gains(NamedTuple):
    lam: Annotated[Array, Gain("slope", "1/s")]
    k: Array
    mode: Annotated[int, Option("mode", ("a", "b"))]


class Memory(NamedTuple):
    s: Array
    work: Array


def plain(x):
    return 2.0 * x


@kernel
def soft(x: float) -> float:
    return x / (1.0 + abs(x))


@kernel
def fill(a: Array, b: Array) -> None:
    for i in range(len(a)):
        b[i] = a[i]


@kernel
def swap(a: Array, b: Array) -> None:
    fill(b, a)


@kernel
def held(m, x: Array, y: Array) -> None:
    gravity(m, x, y)


@kernel
def short(m) -> None:
    gravity(m, m.scratch.force[1], m.scratch.free)


@kernel
def shifting(x: float) -> float:
    return x + drift


@kernel
def scratch(model: Any, x: Array) -> None:
    work = model.scratch.vector
    for i in range(len(x)):
        work[i] = x[i]


@kernel
def heavier(model: Any) -> None:
    model.mass[0] = 2.0


@controller("user-law", gains=Gains, memory=Memory)
def user_law(gains, model, t, q, qd, ref, memory, tau):
    """A law."""
'''
LINE = HEAD.count("\n") + 1
"""Line of the first statement of the law."""

LOOP = "for i in range(len(tau)):\n    "
GOOD = {
    "everything allowed": """gravity(model, q, tau)
inverse_dynamics(model, q, qd, memory.work, tau)
mass_matrix(model, q, model.scratch.matrix)
M, work = model.scratch.matrix, memory.work
fill(q, work)
scratch(model, qd)
total, i = 0.0, 0
while i < len(tau):
    work[i] += soft(M[i, i]) * sat(gains.lam[i] * (ref.q[i] - q[i]) / LIMIT) - sign(qd[i])
    memory.s[i] = total if gains.mode == 1 and not total < 0.0 else -abs(t)
    total += math.sin(q[i]) + math.exp(-t) + model.tau_max[i] * model.control_period
    tau[i], i = work[i], i + 1""",
    "parts under names": LOOP + "e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]\n    tau[i] = gains.k[i] * (de + e)",
    "whole numbers": LOOP + "n = i // 2 + len(q) % 3\n    tau[i] = math.floor(q[i]) + n",
    "another time": "t = 2.0 * t\n" + LOOP + "tau[i] = t",
    "swapped by a kernel": "swap(tau, q)",
}

BAD: dict[str, tuple[str, int, str, str]] = {
    # body, line from the first on, what, cure
    "power": ("x = q[0]\ntau[0] = x ** 2", 1, "x ** 2", "write x * x, or math.sqrt for a root"),
    "numpy exponential": ("tau[0] = np.exp(q[0])", 0, "np.exp()", "write math.exp(x)"),
    "numpy clip": ("tau[0] = np.clip(q[0], -1.0, 1.0)", 0, "np.clip()", "sat(x)"),
    "numpy sum": ("tau[0] = np.sum(q)", 0, "np.sum()", "loop over the elements"),
    "allocation": ("x = np.zeros(6)\ntau[0] = x[0]", 0, "np.zeros()", "a field of memory as working memory"),
    "minimum": ("tau[0] = min(q[0], 1.0)", 0, "min()", "x if x < y else y"),
    "power of math": ("tau[0] = math.pow(q[0], 2)", 0, "math.pow()", "x * x"),
    "misspelt math": ("tau[0] = math.sinn(q[0])", 0, "math.sinn, which is not defined", "did you mean 'sin'?"),
    "print": ("print(q)", 0, "print()", "every field of memory is recorded"),
    "plain function": ("tau[0] = plain(q[0])", 0, "plain()", "decorate plain with kernel"),
    "unknown function": ("tau[0] = satt(q[0])", 0, "satt, which is not defined", "did you mean 'sat'?"),
    "unknown name": ("tau[0] = LIMITS", 0, "LIMITS, which is not defined", "did you mean 'LIMIT'?"),
    "method": ("tau[0] = q.sum()", 0, "a call of q.sum()", "loop over the elements"),
    "slice": ("tau[:] = 0.0", 0, "tau[:]", "loop over the elements"),
    "text": ("x = 'a'", 0, "the constant 'a'", "numbers only"),
    "list": ("x = [0.0]\ntau[0] = x[0]", 0, "[0.0]", "working memory"),
    "returned array": ("return np.zeros(6)", 0, "a value is returned", "fill tau[i]"),
    "returned sum": ("return gains.k * (ref.q - q)", 0, "a value is returned", "allocated at every call"),
    "rebinding": ("tau = q", 0, "tau = ... only rebinds the name", "fill tau[i]"),
    "rebinding in place": ("q += 1.0", 0, "q = ... only rebinds the name", "another name"),
    "writing q": ("q[0] = 0.0", 0, "writes to q (q[0] = ...)", "tau and memory only"),
    "writing qd": ("qd[0] += 0.1", 0, "writes to qd (qd[0] = ...)", "tau and memory only"),
    "writing a gain": ("gains.lam[0] = 1.0", 0, "writes to gains.lam", "tau and memory only"),
    "writing the reference": ("ref.qd[1] = 0.0", 0, "writes to ref.qd", "tau and memory only"),
    "writing the model": ("model.mass[0] *= 1.1", 0, "writes to model.mass", "tau and memory only"),
    "writing through a name": (
        "a = gains\nb, c = a.lam, t\nb[0] = c",
        2,
        "writes to gains.lam (b[0] = ...)",
        "tau and",
    ),
    "writing through a branch": (
        "x = memory.s if t > 1.0 else q\nx[0] = 1.0",
        1,
        "writes to q (x[0] = ...)",
        "tau and",
    ),
    "writing a row": ("row = model.rotation[0]\nrow[0, 0] = 1.0", 1, "writes to model.rotation", "tau and memory"),
    "filling an input": ("gravity(model, q, qd)", 0, "writes to qd (gravity() fills it)", "tau and memory only"),
    "filling through two kernels": ("swap(q, tau)", 0, "writes to q (swap() fills it)", "tau and memory only"),
    "filling the model": ("heavier(model)", 0, "writes to model.mass (heavier() fills it)", "tau and memory only"),
    "an attribute": ("memory.s = q", 0, "the attribute memory.s is assigned", "memory.s[i] = ..."),
    "the address of an array": ("tau[0] = tau.ctypes.data", 0, "tau.ctypes.data", "with fields"),
    "the array of which it is a part": ("x = ref.q.base\ntau[0] = x[9]", 0, "ref.q.base", "with fields"),
    "an array's attribute by another name": ("g = gains.k\ntau[0] = g.T[0]", 1, "g.T", "with fields"),
    "an attribute of Python's": ("x = gains.__class__", 0, "gains.__class__", "with fields"),
    "too short an output": (
        "gravity(model, q, model.scratch.offset[5])",
        0,
        "is given model.scratch.offset[]",
        "joint",
    ),
    "too narrow an output": ("mass_matrix(model, q, model.scratch.force)", 0, "is given model.scratch.force", "joint"),
    "too short an input": ("gravity(model, model.gravity, tau)", 0, "is given model.gravity", "each joint"),
    "too short through a kernel": ("held(model, model.gravity, tau)", 0, "held() is given model.gravity", "each joint"),
    "too short inside a kernel": ("short(model)", 0, "short() is given model.scratch.force[]", "each joint"),
    "a fuzzy system of its own": ("x = Fis(0, 1)", 0, "Fis() makes a fuzzy system", "declare it"),
    "a global array": ("BUFFER[0] = q[0]", 0, "BUFFER, a ndarray outside the law", "memory"),
    "reading a global array": ("tau[0] = BUFFER[0]", 0, "BUFFER, a ndarray outside the law", "memory"),
    "a global list": ("SEEN.append(q[0])", 0, "SEEN, a list outside the law", "memory"),
    "global COUNT": ("global COUNT\nCOUNT = COUNT + 1", 0, "global COUNT", "memory"),
    "a global in small letters": ("tau[0] = drift", 0, "the global drift", "call it DRIFT"),
    "a constant of numpy's": ("tau[0] = STEP", 0, "STEP, a float64", "plain Python number"),
    "a random number": ("tau[0] = random.gauss(0, 1)", 0, "random.gauss()", "noise belongs to the experiment"),
    "numpy's random numbers": ("tau[0] = np.random.rand()", 0, "np.random.rand()", "noise belongs to the experiment"),
    "a generator": ("tau[0] = RNG.normal()", 0, "RNG, a Generator", "noise belongs to the experiment"),
    "the clock": ("tau[0] = time.time()", 0, "time.time()", "the time is t"),
    "no value yet": ("if t > 1.0:\n    x = 1.0\ntau[0] = x", 2, "x may not have a value yet", "before the branch"),
    "an array changed in place": ("x = q\nx += 1.0", 1, "x += 1.0, which changes a whole array", "write x[i]"),
    "an import": ("import math", 0, "import math", "top of the file"),
    "a try": ("try:\n    tau[0] = 1.0\nexcept ValueError:\n    tau[0] = 0.0", 0, "try", "test for the case"),
    "a yield": ("yield q[0]", 0, "yield q[0]", "arithmetic"),
}
