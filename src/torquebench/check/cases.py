"""What a law is tried on: two arms, its options, positive gains, and stretches of motion."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.laws import Law
from torquebench.robot import Puma560, RobotModel, load_model

ARMS = ("puma560", "two-link")
"""Six joints and two, so that a law that counts on a number of joints is found."""
COMBINATIONS = 24
"""Combinations of options that are tried; where there are more, one option at a time is changed."""
LENGTH = 10
"""Control instants in a stretch."""


@cache
def arm(name: str) -> RobotModel:
    """Return one of ARMS."""
    return Puma560() if name == "puma560" else load_model(name)


def combinations(law: Law) -> list[dict[str, str | bool]]:
    """Return choices of the law's options, the defaults first."""
    values = [option.values for option in law.options.values()]
    every = [
        dict(zip(law.options, chosen, strict=True)) for chosen in itertools.islice(itertools.product(*values), 1000)
    ]
    if len(every) <= COMBINATIONS:
        return every
    return [every[0]] + [every[0] | {name: v} for name, o in law.options.items() for v in o.values[1:]]


def label(options: Mapping[str, Any]) -> str:
    """Return a choice of options in words."""
    return "".join(f", {name}: {str(value).lower()}" for name, value in options.items())


def gains_of(law: Law, n: int, options: Mapping[str, str | bool], draw: int, scale: float = 1.0) -> dict[str, Array]:
    """Return positive gains, another for each joint.

    Args:
        law: The law.
        n: Number of joints.
        options: Choice of options; gains without effect under it are left out.
        draw: Number of the draw; its gains are the same whatever the options.
        scale: Middle of the gains.
    """
    found = {}
    for k, name in enumerate(law.gains):
        rng = np.random.default_rng([draw, k])
        drawn = scale * rng.uniform(0.5, 1.5, n)
        if law.gain_problem(name, True, options) is None:
            found[name] = drawn
    return found


class Motion(NamedTuple):
    """What a law sees at some instants in a row: times (L,) [s] and the rest (L, n)."""

    t: Array
    q: Array
    qd: Array
    q_ref: Array
    qd_ref: Array
    qdd_ref: Array


def motions(n: int, seed: int = 0) -> Iterator[Motion]:
    """Ordinary stretches of motion: at rest on the reference, as every run begins; near to it; and far from it."""
    rng = np.random.default_rng(seed)
    t: Array = 0.001 * np.arange(LENGTH, dtype=np.float64)
    zero: Array = np.zeros((LENGTH, n))
    yield Motion(t, zero, zero, zero, zero, zero)
    for size, start in ((1e-3, 0.0), (1e-2, 0.5), (0.1, 1.0), (0.1, 7.3), (1.0, 2.0), (1.0, 60.0)):
        phase, rate = rng.uniform(0.0, 6.3, n), rng.uniform(1.0, 3.0, n)
        angle = rate * t[:, None] + phase
        q_ref, qd_ref, qdd_ref = np.sin(angle), rate * np.cos(angle), -rate * rate * np.sin(angle)
        e, de = size * rng.normal(size=(LENGTH, n)), 3.0 * size * rng.normal(size=(LENGTH, n))
        yield Motion(t + start, q_ref - e, qd_ref - de, q_ref, qd_ref, qdd_ref)
