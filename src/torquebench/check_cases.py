"""Cases on which `check_law` tries a law: two arms, its options, drawn gains, stretches of motion; and the answers."""

from __future__ import annotations

import contextlib
import io
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.references import Reference
from torquebench.robot import Puma560, RobotModel, load_model
from torquebench.robot.flat_model import own_copy
from torquebench.sim.closed_loop import COMPLETED, RAISED
from torquebench.sim.interpreted import Call

Options = Mapping[str, str | bool]
ARMS = ("puma560", "two-link")
"""Six joints and two, so that a law that counts on a number of joints is found."""
COMBINATIONS = 24
"""Combinations of options that are tried; where there are more, one option at a time is changed."""
LENGTH = 10
"""Control instants in a stretch of motion."""
CONTROL_PERIOD = 0.002
"""Control period [s] of the model that laws are given; not the default, so that a law that ignores it is seen."""


@cache
def arm(name: str) -> RobotModel:
    """Return one of ARMS."""
    return Puma560() if name == "puma560" else load_model(name)


def combinations(law: Law) -> list[dict[str, str | bool]]:
    """Return choices of the law's options, the defaults first."""
    values = [option.values for option in law.options.values()]
    choices = itertools.islice(itertools.product(*values), COMBINATIONS + 1)
    every = [dict(zip(law.options, choice, strict=True)) for choice in choices]
    if len(every) <= COMBINATIONS:
        return every
    return [every[0]] + [every[0] | {name: v} for name, o in law.options.items() for v in o.values[1:]]


def gains_of(law: Law, n: int, options: Options, draw: int, scale: float = 1.0) -> dict[str, Array]:
    """Draw positive gains, another for each joint.

    Args:
        law: The law.
        n: Number of joints.
        options: Choice of options; gains without effect under it are left out.
        draw: Number of the draw; its gains are the same whatever the options.
        scale: Middle of the gains.
    """
    gains = {}
    for k, name in enumerate(law.gains):
        drawn = scale * np.random.default_rng([draw, k]).uniform(0.5, 1.5, n)
        if law.gain_problem(name, True, options) is None:
            gains[name] = drawn
    return gains


class Motion(NamedTuple):
    """Inputs of a law at successive instants: times (L,) [s] and the rest (L, n)."""

    t: Array
    q: Array
    qd: Array
    q_ref: Array
    qd_ref: Array
    qdd_ref: Array


@cache
def motions(n: int, seed: int = 0) -> list[Motion]:
    """Draw ordinary stretches of motion: at rest on the reference, as every run begins; near to it; far from it."""
    rng = np.random.default_rng(seed)
    t: Array = 0.001 * np.arange(LENGTH, dtype=np.float64)
    found = [Motion(t, *([np.zeros((LENGTH, n))] * 5))]
    for size, start in ((1e-3, 0.0), (1e-2, 0.5), (0.1, 1.0), (0.1, 7.3), (1.0, 2.0), (1.0, 60.0)):
        phase, rate = rng.uniform(0.0, 6.3, n), rng.uniform(1.0, 3.0, n)
        angle = rate * t[:, None] + phase
        q_ref, qd_ref, qdd_ref = np.sin(angle), rate * np.cos(angle), -rate * rate * np.sin(angle)
        e, de = size * rng.normal(size=(LENGTH, n)), 3.0 * size * rng.normal(size=(LENGTH, n))
        found.append(Motion(t + start, q_ref - e, qd_ref - de, q_ref, qd_ref, qdd_ref))
    return found


@dataclass(frozen=True)
class Case:
    """An arm, a choice of options, and gains."""

    arm: str
    options: Options
    gains: Mapping[str, Array]

    def __str__(self) -> str:
        return self.arm + "".join(f", {name}: {str(value).lower()}" for name, value in self.options.items())


def case(law: Law, name: str, options: Options, draw: int = 1) -> Case:
    """Return a case with drawn gains; arguments as of `gains_of`, `name` one of ARMS."""
    return Case(name, options, gains_of(law, arm(name).n, options, draw))


def cases(law: Law, draw: int = 1) -> list[Case]:
    """Return every arm under every choice of options."""
    return [case(law, name, options, draw) for name in ARMS for options in combinations(law)]


@dataclass
class Answer:
    """Response of a law to a stretch of motion."""

    tau: Array
    """Torque, (L, n) [N m]; NaN where there was none."""
    memory: Array
    """Memory after each call, (L, m, n)."""
    wrong: dict[str, str] = field(default_factory=dict)
    """``torque``: the first thing that was wrong with a call; ``finite``: the first torque or memory that was not."""
    changed: list[str] = field(default_factory=list)
    """Inputs that were changed."""

    def bytes(self) -> bytes:
        """Return torque and memory in bytes."""
        return self.tau.tobytes() + self.memory.tobytes()


class Driver:
    """A law with gains, a belief and a memory of its own, ready to be called.

    Args:
        law: The law.
        case: What it is tried on.
        watched: Whether it is written down which inputs the law changes.
    """

    def __init__(self, law: Law, case: Case, watched: bool = True) -> None:
        self.law, n = law, arm(case.arm).n
        self.belief = replace(own_copy(arm(case.arm).flat), control_period=CONTROL_PERIOD)
        self.gains = law.pack_gains(n, case.gains, case.options)
        self.memory = law.new_memory(n)
        self._call = Call(law, self.gains, self.belief, self.memory)
        self._inputs = list(_arrays({"gains": self.gains, "model": self.belief})) if watched else []
        self.answer = Answer(np.full((LENGTH, n), np.nan), np.zeros((LENGTH, len(self.memory), n)))
        """Its response so far."""

    def move_memory(self) -> None:
        """Put the law's memory into other arrays."""
        self.memory = type(self.memory)(*(x.copy() for x in self.memory))
        self._call = Call(self.law, self.gains, self.belief, self.memory)

    def call(self, motion: Motion, k: int) -> None:
        """Call the law at instant k of a stretch and write down what it did."""
        answer = self.answer
        q, qd, *desired = (x[k].copy() for x in motion[1:])
        ref = Reference(*desired)
        inputs = [*self._inputs, *_arrays({"q": q, "qd": qd, "ref": ref})] if self._inputs else []
        before = [x.tobytes() for _, x in inputs]
        tau, status, detail = self._call(float(motion.t[k]), q, qd, ref)
        answer.changed += [name for (name, x), was in zip(inputs, before, strict=True) if was != x.tobytes()]
        if status == COMPLETED:
            answer.tau[k] = tau
            for c, channel in enumerate(self.memory):
                answer.memory[k, c] = channel if len(channel) else 0.0
            detail = _not_finite(tau, self.memory)
        if detail:
            name = "finite" if status in (COMPLETED, RAISED) else "torque"
            answer.wrong.setdefault(name, f"t = {motion.t[k]:g} s: {detail}")


def drive(law: Law, case: Case, motion: Motion, watched: bool = True) -> Answer:
    """Call a law that starts anew at every instant of a stretch; arguments as of `Driver`."""
    driver = Driver(law, case, watched)
    for k in range(LENGTH):
        driver.call(motion, k)
    return driver.answer


def _not_finite(tau: Array, memory: Any) -> str:
    bad = [name for name, x in memory._asdict().items() if not np.all(np.isfinite(x))]
    if np.all(np.isfinite(tau)):
        return f"memory.{bad[0]} is not finite" if bad else ""
    joint = int(np.argmin(np.isfinite(tau)))
    why = " (not written by the law, or not a number)" if np.isnan(tau[joint]) else ""
    return f"joint {joint + 1}: tau = {tau[joint]}{why}"


def _arrays(value: Any, name: str = "") -> Iterator[tuple[str, Array]]:
    """Yield every array in a structure by dotted name, scratch space left out."""
    if isinstance(value, np.ndarray):
        yield name, value
    parts = value._asdict() if hasattr(value, "_asdict") else value if isinstance(value, dict) else {}
    if is_dataclass(value):
        parts = {part.name: getattr(value, part.name) for part in fields(value)}
    for key, part in parts.items():
        if key != "scratch":
            yield from _arrays(part, f"{name}.{key}".lstrip("."))


@contextlib.contextmanager
def silence() -> Iterator[io.StringIO]:
    """Catch what a law prints."""
    caught = io.StringIO()
    with contextlib.redirect_stdout(caught), contextlib.redirect_stderr(caught):
        yield caught
