"""Times of a run that must fit one another, and what is told of one that does not."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from torquebench.errors import Fault

FAR_OFF = 10.0
"""A number this many times too large is not what its counterpart should be changed to."""
RELATIVE = 1e-9
"""Decimal periods are not exact in binary; a real mismatch is far larger."""


class Timing(NamedTuple):
    """Facts about the run that a kind's own rules may use."""

    duration: float
    """Length of the run [s]."""
    control_period: float
    """Time between control instants [s]."""
    whole: bool = True
    """Whether the control period itself fits; where it does not, nothing is said of its multiples."""
    n: int | None = None
    """Number of the plant's joints; None where the plant is not valid."""
    timestep: float | None = None
    """Physics step [s]; likewise."""


def whole_steps(duration: float, step: float) -> int:
    """Return the number of steps nearest to a duration; both in the same unit."""
    return round(duration / step)


def multiple_of(
    path: tuple[str | int, ...], value: float, unit_key: str, unit: float, unless: tuple[str | int, ...] = ()
) -> Iterator[Fault]:
    """Yield a fault where a time is not a whole number, at least 1, of another.

    Args:
        path: Key of the time.
        value: The time [s].
        unit_key, unit: The other time, likewise.
        unless: As of a `Fault`.
    """
    if not math.isfinite(value / unit):
        return
    steps = max(whole_steps(value, unit), 1)
    if abs(value / unit - steps) <= RELATIVE * steps:
        return
    note = f"the nearest is {steps * unit:.12g}"
    if unit > FAR_OFF * value:  # surely the unit is wrong, not the value
        note = f"{unit_key} must not be longer than that"
    wanted = f"a whole multiple of {unit_key}, {unit:.12g} s"
    yield Fault(path, got=f"{value:.12g} s", wanted=wanted, note=note, unless=unless)


def control_instant(path: tuple[str | int, ...], time: float, timing: Timing) -> Iterator[Fault]:
    """Yield a fault where a time that is not zero is not one of a control instant of the run.

    Args:
        path: Key of the time.
        time: The time [s].
        timing: The run's times.
    """
    if not time:
        return
    wrong = list(multiple_of(path, time, "run.control_period", timing.control_period)) if timing.whole else []
    yield from wrong
    if not wrong and time >= timing.duration:
        yield Fault(path, got=f"{time:.12g} s", wanted=f"less than run.duration, {timing.duration:.12g} s")


def substeps_per_period(
    control_period: float, timestep: float, names: tuple[str, str] = ("control_period", "timestep")
) -> int:
    """Return how many time steps make one control period.

    Args:
        control_period: Time between control instants [s].
        timestep: Integration step [s].
        names: What the caller calls the two, for messages.

    Raises:
        ValueError: either is not finite and positive, or the ratio is not a whole number.
    """
    for name, value in zip(names, (control_period, timestep), strict=True):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}, wanted a finite positive number of seconds")
    ratio = control_period / timestep
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > 1e-9 * ratio:
        raise ValueError(
            f"{names[0]} {control_period} s is not a whole multiple of {names[1]} {timestep} s "
            f"(nearest: {max(whole, 1) * timestep:.12g} s)"
        )
    return whole
