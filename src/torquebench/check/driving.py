"""Calling a law through a stretch of motion, and what came of it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from torquebench.check.cases import Motion
from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot import RobotModel
from torquebench.robot.flat_model import own_copy
from torquebench.sim.closed_loop import COMPLETED, RAISED
from torquebench.sim.interpreted import call_law

CONTROL_PERIOD = 0.002
"""Control period [s] of the model that laws are given; not the default, so that a law that ignores it is seen."""


@dataclass
class Driver:
    """A law with gains, a belief and a memory of its own."""

    law: Law
    gains: Any
    belief: Any
    memory: Any

    def call(self, motion: Motion, k: int) -> tuple[Array, int, str, tuple[str, ...]]:
        """Call the law at instant k and return its torque, how that went, what was wrong, and the inputs it changed."""
        q, qd = motion.q[k].copy(), motion.qd[k].copy()
        ref = Reference(motion.q_ref[k].copy(), motion.qd_ref[k].copy(), motion.qdd_ref[k].copy())
        inputs = {"gains": self.gains, "model": self.belief, "q": q, "qd": qd, "ref": ref}
        before = dict(_bytes(inputs))
        tau, status, detail = call_law(self.law, self.gains, self.belief, float(motion.t[k]), q, qd, ref, self.memory)
        return tau, status, detail, tuple(name for name, data in _bytes(inputs) if before.get(name) != data)

    def move_memory(self) -> None:
        """Put what the memory holds into other arrays."""
        self.memory = type(self.memory)(*(x.copy() for x in self.memory))


@dataclass
class Answer:
    """What a law did in a stretch of motion."""

    tau: Array
    """Torque, (L, n) [N m]; NaN where there was none."""
    memory: Array
    """Memory after each call, (L, m, n)."""
    shape: str = ""
    """First thing that was wrong with a call or with what it returned."""
    finite: str = ""
    """First torque or memory that was not a finite number."""
    changed: tuple[str, ...] = ()
    """Inputs that were changed."""

    def same(self, other: Answer) -> bool:
        """Whether another answer has the same bytes."""
        return self.tau.tobytes() + self.memory.tobytes() == other.tau.tobytes() + other.memory.tobytes()


def driver(law: Law, arm: RobotModel, options: Mapping[str, str | bool], gains: Mapping[str, Array]) -> Driver:
    """Return a law ready to be called, with copies of its own of all it is given.

    Args:
        law: The law.
        arm: What it believes.
        options, gains: As for `Law.pack_gains`.
    """
    belief = replace(own_copy(arm.flat), control_period=CONTROL_PERIOD)
    return Driver(law, law.pack_gains(arm.n, gains, options), belief, law.new_memory(arm.n))


def drive(driver: Driver, motion: Motion) -> Answer:
    """Call a law at every instant of a stretch."""
    length, n = motion.q.shape
    answer = Answer(np.full((length, n), np.nan), np.zeros((length, len(driver.memory), n)))
    for k in range(length):
        record(answer, driver, motion, k)
    return answer


def record(answer: Answer, driver: Driver, motion: Motion, k: int) -> None:
    """Call a law at one instant and take down what it did.

    Args:
        answer: Where.
        driver: The law.
        motion: The stretch of motion.
        k: Index of the instant.
    """
    tau, status, detail, changed = driver.call(motion, k)
    answer.changed = tuple(dict.fromkeys(answer.changed + changed))
    at = f"t = {motion.t[k]:g} s: "
    if status == COMPLETED:
        answer.tau[k] = tau
        for c, channel in enumerate(driver.memory):
            answer.memory[k, c] = channel if len(channel) else 0.0
        finite = np.isfinite(tau)
        bad = [name for name, x in driver.memory._asdict().items() if not np.all(np.isfinite(x))]
        if not np.all(finite):
            joint = int(np.argmin(finite))
            why = " (not written by the law, or not a number)" if np.isnan(tau[joint]) else ""
            detail = f"joint {joint + 1}: tau = {tau[joint]}{why}"
        elif bad:
            detail = f"memory.{bad[0]} is not finite"
        answer.finite = answer.finite or (at + detail if detail else "")
    elif status == RAISED:
        answer.finite = answer.finite or at + detail
    else:
        answer.shape = answer.shape or at + detail


def _bytes(value: Any, name: str = "") -> Iterator[tuple[str, bytes]]:
    """Every array and number in a structure by dotted name, scratch space left out."""
    if isinstance(value, np.ndarray):
        yield name, value.tobytes()
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from _bytes(part, f"{name}.{key}" if name else key)
    elif hasattr(value, "_asdict"):
        yield from _bytes(value._asdict(), name)
    elif hasattr(value, "__dataclass_fields__"):
        names = [key for key in value.__dataclass_fields__ if key != "scratch"]
        yield from _bytes({key: getattr(value, key) for key in names}, name)
    else:
        yield name, repr(value).encode()


@contextlib.contextmanager
def silence() -> Iterator[io.StringIO]:
    """Catch what a law prints."""
    caught = io.StringIO()
    with contextlib.redirect_stdout(caught), contextlib.redirect_stderr(caught):
        yield caught
