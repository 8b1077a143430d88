"""Shaking of a run, if any: the joint, its frequency and amplitude, and whether it is a limit cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from torquebench.metrics.chattering import STILL
from torquebench.metrics.torque import SATURATED
from torquebench.metrics.values import Metrics


class Shaking(NamedTuple):
    """The shaking of a run's worst joint."""

    joint: int
    """Number of the joint, from 0."""
    frequency: float
    """Frequency of the torque's largest line above the corner [Hz]; NaN where none stands out."""
    amplitude: float
    """RMS of the torque above the corner [N m]; [N] of a joint that slides."""
    chattering: float
    """Headline chattering of the run, the mean over joints [% of the torque limit]."""
    is_cycle: bool
    """Whether most of it is a limit cycle."""

    @property
    def verb(self) -> str:
        """The word for it."""
        return "limit-cycles" if self.is_cycle else "chatters"


def is_still(chattering: float) -> bool:
    """Whether a headline chattering [% of the torque limit] is too small to count: less than 0.1 %."""
    return chattering < STILL


def shaking(metrics: Metrics, tau_max: Sequence[float]) -> Shaking | None:
    """Return how a completed run shakes; None where it does not, or its window cannot tell.

    A joint whose torque is cut off at its limit has corners, which count as chattering; that is no shaking.

    Args:
        metrics: Metrics of the run.
        tau_max: Torque limit of each joint, (n,) [N m].
    """
    headline, by_joint = metrics.chattering.value, metrics.chattering.per_joint
    if headline is None or is_still(headline):
        return None
    own = [0.0 if share is None or _is_clipped(metrics, i) else share for i, share in enumerate(by_joint)]
    joint = max(range(len(own)), key=own.__getitem__)
    share = own[joint]
    if is_still(share):
        return None
    peak, cycle = metrics.chattering_peak.per_joint[joint], metrics.limit_cycle.per_joint[joint]
    frequency = math.nan if peak is None else peak
    return Shaking(joint, frequency, share / 100.0 * tau_max[joint], headline, bool(cycle))


def _is_clipped(metrics: Metrics, joint: int) -> bool:
    """Whether the corners of saturation explain a joint's chattering.

    They do where it is at its limit for `SATURATED` of the time or longer, has no limit cycle, and its torque turns
    round less than half as often as a swing at the frequency of its peak would.
    """
    peak, cycle = metrics.chattering_peak.per_joint[joint], metrics.limit_cycle.per_joint[joint]
    turns, at_limit = metrics.reversals.per_joint[joint], metrics.saturation_fraction.per_joint[joint]
    if peak is None or cycle is None or turns is None or at_limit is None:
        return False
    return at_limit >= SATURATED and not cycle and turns < peak
