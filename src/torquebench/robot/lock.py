"""A joint that locks in the middle of a run: its brake falls in, and the other joints go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np

from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Units, check_numbers
from torquebench.robot.payload import Payload
from torquebench.timing import Timing, control_instant

HELD = 1e12
"""Inertia that a locked joint has more [kg m^2]: 1000 N m for a minute move it by 2 urad."""


@dataclass(frozen=True)
class Lock:
    """One joint is held where it is from an instant on, by a brake that takes any torque; the law is not told.

    The run goes on, and is judged on all joints. The brake falls in at once: an impulse J on the joint takes its speed,
    qd+ = qd - M^-1 e_i qd_i / (M^-1)_ii, and the other joints take up what momentum it passes on. With a transmission
    it stops the motor, and the link swings on its spring.

    Raises:
        ValueError: a number is out of range or not finite.
    """

    joint: Annotated[int, Key("Number of the joint, from 1 on", "1", at_least=1)]
    at: Annotated[
        float,
        Key(
            "Time from which it is held: a whole multiple of run.control_period, less than run.duration",
            "s",
            at_least=0,
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_numbers(self)

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit the run, or the arm."""
        yield from control_instant(("at",), self.at, timing)
        if timing.n is not None and self.joint > timing.n:
            yield Fault(("joint",), got=str(self.joint), wanted=f"a joint of the arm, 1 to {timing.n}")

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        return f"joint {self.joint} locked" + (f" from {self.at:g} s" if self.at > 0 else "")

    def on(self, inertia: Array) -> Array:
        """Return the inertias of motors, (n,) [kg m^2], with the brake on."""
        held = inertia.copy()
        held[self.joint - 1] += HELD
        return held

    def stop(self, motors: Array, qd: Array, mass_matrix: Callable[[], Array]) -> None:
        """Have the brake fall in: change the velocities to those just after it; see the class.

        Args:
            motors: Position and velocity of the motors, (2, n) [rad, rad/s], or (0, n) where joints are rigid; changed.
            qd: Velocities of the joints, (n,) [rad/s]; changed where joints are rigid.
            mass_matrix: Returns the mass matrix without the brake, (n, n) [kg m^2].
        """
        i = self.joint - 1
        if len(motors) > 0:
            motors[1, i] = 0.0
            return
        way = np.linalg.solve(mass_matrix(), np.eye(len(qd))[i])
        qd[:] = qd - way * (qd[i] / way[i])
        qd[i] = 0.0


Phase: TypeAlias = tuple[float, Payload | None, Lock | None]
"""Time from which an arm has a payload and a locked joint [s], and these."""


def falling_in(phases: Sequence[Phase], number: int) -> Lock | None:
    """Return the lock whose brake falls in as a phase begins; None for none.

    Args:
        phases: As of `phases_of`.
        number: Of the phase, from 1.
    """
    return phases[number][2] if phases[number - 1][2] is None else None


def phases_of(payload: Payload | None, lock: Lock | None) -> list[Phase]:
    """Return from which time on [s] an arm has a payload and a locked joint; the first phase begins at 0."""
    times = sorted({0.0, *(part.at for part in (payload, lock) if part is not None)})
    return [
        (t, payload if payload and payload.at <= t else None, lock if lock and lock.at <= t else None) for t in times
    ]
