"""Signals that are sampled before a loop begins: control instants, and the torques that disturb the joints."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from torquebench.disturbances import Stream, generator
from torquebench.kernel import Array


class Disturbance(Protocol):
    """A torque on the joints in addition to the actuators', which samples itself."""

    def sample(self, n: int, t: Array, control_period: float, rng: np.random.Generator) -> Array:
        """Return the torque from each control instant to the next, (N, n) [N m].

        Args:
            n: Number of joints.
            t: Control instants, (N,) [s].
            control_period: Time between them [s].
            rng: Source of all randomness.
        """
        ...


@lru_cache(maxsize=8)
def control_instants(n_steps: int, control_period: float) -> Array:
    """Return the control instants k control_period, k = 0 .. n_steps - 1, (N,) [s]; read-only."""
    t: Array = np.arange(n_steps, dtype=np.float64) * control_period
    t.setflags(write=False)
    return t


def total_torque(
    disturbances: Iterable[Disturbance], n: int, n_steps: int, control_period: float, seed: int, draw: int
) -> Array | None:
    """Sample disturbances and add them up, (N, n) [N m]; None where there are none.

    Each has a random stream of its own. Only disturbances that draw from it are counted in its key, so that adding one
    without randomness changes no other.

    Args:
        disturbances: What acts on the joints.
        n: Number of joints.
        n_steps: Number of control instants N.
        control_period: Time between them [s].
        seed, draw: Key of the random streams; see `generator`.

    Raises:
        TypeError: something in `disturbances` cannot sample itself.
        ValueError: a disturbance is of another shape than (N, n), or not finite.
    """
    total: Array | None = None
    drawing = 0
    for i, disturbance in enumerate(check_disturbances(disturbances)):
        rng = generator(seed, draw, Stream.TORQUE_NOISE, drawing)
        unused = rng.bit_generator.state
        torque = np.asarray(disturbance.sample(n, control_instants(n_steps, control_period), control_period, rng))
        if torque.shape != (n_steps, n):
            raise ValueError(f"disturbances[{i}] has shape {torque.shape}, wanted {(n_steps, n)}")
        if not np.isfinite(torque).all():
            raise ValueError(f"disturbances[{i}] has torques that are not finite")
        drawing += rng.bit_generator.state != unused
        total = (0.0 if total is None else total) + torque
    return total


def check_disturbances(disturbances: Any) -> tuple[Disturbance, ...]:
    """Return disturbances as a tuple.

    Raises:
        TypeError: something in it cannot sample itself.
    """
    wanted = "an object with a method sample(n, t, control_period, rng) that returns the torque at each t, (N, n) [N m]"
    if hasattr(disturbances, "sample") or not isinstance(disturbances, Iterable):
        raise TypeError(f"disturbances is {_kind(disturbances)}, wanted a sequence, each item {wanted}")
    if isinstance(disturbances, np.ndarray):
        raise TypeError(f"disturbances is {_kind(disturbances)}, wanted a sequence, each item {wanted}")
    each = tuple(disturbances)
    for i, disturbance in enumerate(each):
        if not hasattr(disturbance, "sample") or isinstance(disturbance, type):
            raise TypeError(f"disturbances[{i}] is {_kind(disturbance)}, wanted {wanted}")
    return each


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
