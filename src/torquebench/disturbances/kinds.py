"""The rules for a kind of disturbance, and the decorator that registers one.

A kind is a frozen dataclass whose fields are its keys (see `Key`), with two methods::

    sample(n, t, control_period, rng) -> torque at each control instant, (N, n) [N m]
    describe(units) -> what it is in one line, as it stands beside every result

and, if it likes, ``check(timing)``, which yields a `Fault` for each key that does not fit the run or another key, and
``sized(rms)``, which returns it with torques in place of shares of the motion's RMS torque, (n,) [N m]. One
that draws from `rng` says so by ``is_random = True``, so that seed and draw stand beside its results.
"""

from __future__ import annotations

from torquebench.keys import Kinds

DISTURBANCES = Kinds(
    "disturbance",
    defaults={
        "channel": "torque",
        "also": {"channel": "What it is added to: the joint torque, after saturation and actuator lag"},
        "is_random": False,
    },
    methods=("sample(n, t, control_period, rng)", "describe(units)"),
)
disturbance = DISTURBANCES
"""Decorator of a class: ``@disturbance("triangle-wave")``."""
