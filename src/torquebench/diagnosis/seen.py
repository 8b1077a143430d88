"""From a run to what it shows: how it ended, shakes, errs and saturates, and whether a joint sticks and slips."""

from __future__ import annotations

import itertools
import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.shaking import Shaking
from torquebench.metrics.torque import SATURATED
from torquebench.sim.trajectory import Trajectory

Kind: TypeAlias = Literal["fails", "shakes", "errs", "saturates"]
KINDS: tuple[Kind, ...] = ("fails", "shakes", "errs", "saturates")
ERROR = 0.05
"""RMS error from which on a joint errs, as a share of its motion [1]."""
GROWTH = 2.0
"""Times the torque above the corner in the first half of a window that a run has in the second if it grows [1]."""
GONE = 2.0
"""Error, as a share of the motion, of a joint that has run away [1]."""
LITTLE = 1e-5
"""Growth that says nothing of the loop, for what hold and motion leave varies by as much: of torque as a share of the
largest torque [1], and of an error [rad]."""
STILL, AWAY = 0.02, 0.2
"""Speeds below which a joint stands, and beyond which it has broken away, as shares of its fastest [1]."""


class Seen(NamedTuple):
    """Observations from one run: its ending, shaking, errors and torques."""

    ending: str
    """How it failed; empty if it completed."""
    shaking: Shaking | None
    torque: Array
    """RMS of the torque above the corner, (n,) [N m]."""
    share: float
    """Its RMS over the joints [% of the limit]."""
    rmse: Array
    """RMS error, (n,) [rad]."""
    error: Array
    """RMS error as a share of the motion, (n,) [1]."""
    saturated: Array
    """Share of the window for metrics at the torque limit, (n,) [1]."""
    swings: Array
    """Frequency at which the error changes its sign and back, (n,) [Hz]."""
    grows: bool
    """Whether its torque above the corner grows."""
    strays: bool
    """Whether its error grows."""
    slips: Array
    """Frequency at which each joint that sticks breaks away, (n,) [Hz]; see `slips`."""
    t: Array
    """Instants of the window for metrics, (m,) [s]."""
    tau: Array
    """Torque that is asked of the drives then, (m, n) [N m]."""
    e: Array
    """Error then, (m, n) [rad]."""
    forced: bool = False
    """Whether a disturbance shakes it at its own frequency."""
    motion_hz: float = math.inf
    """Frequency above which an error that swings does not follow the motion [Hz]."""

    @property
    def hammers(self) -> bool:
        """Whether the joint with most error swings from limit to limit, faster than its motion: the loop cycles."""
        joint = self.joint("errs")
        return bool(self.saturated[joint] >= SATURATED and self.swings[joint] > self.motion_hz)

    def unstable(self, kind: Kind) -> bool:
        """Whether a symptom grows, or has grown into a swing from limit to limit or an error beyond the motion."""
        if kind == "shakes":
            at_limit = self.shaking is not None and bool(np.max(self.saturated) >= SATURATED)
            return self.grows or self.strays or at_limit
        return kind == "errs" and (self.strays or self.hammers or self.size("errs") >= GONE)

    def size(self, kind: Kind, joint: int | None = None) -> float:
        """Return how much of a symptom there is, at a joint or at the worst one; infinite where the run failed."""
        if kind == "fails":
            return 1.0 if self.ending else 0.0
        if self.ending:
            return math.inf
        if kind == "shakes":
            return self.share
        at = self.joint(kind) if joint is None else joint
        return float((self.error if kind == "errs" else self.saturated)[at])

    def joint(self, kind: Kind) -> int:
        """Return the number of the joint that has most of a symptom."""
        if kind == "shakes" and self.shaking is not None:
            return self.shaking.joint
        return int(np.argmax(self.error if kind == "errs" else self.saturated))

    def has(self, kind: Kind) -> bool:
        """Whether the run has a symptom."""
        if kind == "fails" or self.ending:
            return bool(self.ending) and kind == "fails"
        if kind == "shakes":
            return self.shaking is not None
        return self.size(kind) >= (ERROR if kind == "errs" else SATURATED)

    def text(self, kind: Kind, joint: int) -> str:
        """Return a symptom of a joint as a number with its unit."""
        if self.ending or kind == "fails":
            return self.ending or "it completes"
        if kind == "shakes":
            return f"{_short(self.torque[joint])} N m"
        if kind == "errs":
            return f"{_short(self.rmse[joint])} rad"
        return f"{100 * self.saturated[joint]:.3g} % of the time"


def _short(value: float) -> str:
    """Return a number with two digits or whole, one that is next to nothing as less than a thousandth."""
    if value >= 100.0:
        return f"{value:.0f}"
    return f"{value:.2g}" if value >= 1e-3 else "< 0.001"


def swings(run: Trajectory, since: float) -> Array:
    """Return the frequency at which each joint's error changes its sign and back, (n,) [Hz], from `since` [s] on."""
    late = run.t >= since
    e = (run.q_ref - run.q)[late]
    up = np.signbit(e - np.mean(e, axis=0))
    turns = np.count_nonzero(up[1:] != up[:-1], axis=0)
    return np.asarray(0.5 * turns / (run.t[late][-1] - run.t[late][0]))


def grows(run: Trajectory, since: float, corner: float) -> tuple[bool, bool]:
    """Whether a joint's torque above the corner, and its error, is `GROWTH` times as large in the window's second half.

    An error also grows that varies more, by the same measure, in each quarter than in the one before.

    Args:
        run: The run.
        since: Start of the window [s].
        corner: Frequency above which torque counts [Hz].
    """
    late = run.t >= since
    tau, e = run.tau_law[late], (run.q_ref - run.q)[late]
    half = len(tau) // 2
    above = np.fft.rfftfreq(half, float(run.t[1] - run.t[0])) >= corner
    taper = np.hanning(half)[:, None]

    def fast(part: Array) -> Array:
        return np.asarray(np.linalg.norm(np.fft.rfft(taper * (part - np.mean(part, axis=0)), axis=0)[above], axis=0))

    def more(first: Array, second: Array, least: float) -> bool:
        return bool(np.any(second > GROWTH * first + least))

    shakes = more(fast(tau[:half]), fast(tau[-half:]), LITTLE * half * float(np.max(np.abs(tau))))
    away = e - np.mean(e, axis=0)  # of the whole window: half of a swing may be its crest, which varies little
    first, second = (np.sqrt(np.mean(np.square(part), axis=0)) for part in (away[:half], away[-half:]))
    quarters = [np.std(part, axis=0) for part in np.array_split(e, 4)]  # what creeps away has no crest
    creeps = [after > math.sqrt(GROWTH) * before + LITTLE for before, after in itertools.pairwise(quarters)]
    return shakes, more(first, second, LITTLE) or bool(np.any(np.all(creeps, axis=0)))


def slips(run: Trajectory, since: float, joint: int) -> float:
    """Return how often a joint that sticks breaks away in a second [Hz]; 0 where it stands no oftener than its target.

    It stands where it is slower than `STILL` of its fastest, and breaks away where it is faster than `AWAY` after that.

    Args:
        run: The run.
        since: Time from which on it is looked at [s].
        joint: Number of the joint, from 0.
    """
    late = run.t >= since
    duration = float(run.t[late][-1] - run.t[late][0])

    def starts(qd: Array) -> int:
        speed = np.abs(qd) / (np.max(np.abs(qd)) or 1.0)
        turning = speed[(speed <= STILL) | (speed >= AWAY)] >= AWAY  # in between it does what it did
        return int(np.count_nonzero(turning[1:] & ~turning[:-1]))

    own, wanted = starts(run.qd[late, joint]), starts(run.qd_ref[late, joint])
    return own / duration if own > wanted + 1 else 0.0
