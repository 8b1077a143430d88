"""A motion as the messages that a page is fed: the arm once, then frames of each controller as they become known."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.view.arm import Arm

FRAME = 0.01
"""Least time between two frames [s]; the page interpolates between them."""
MOST_FRAMES = 6000
"""A longer run has frames further apart."""
_DIGITS = 5
"""Of metres, quaternions and torques over their limits."""

Message = Mapping[str, Any]


class Grid(NamedTuple):
    """Which samples are frames: every `every`-th."""

    every: int
    total: int
    """Frames of a whole run."""
    period: float
    """Time between frames [s]."""


def grid(samples: int, control_period: float) -> Grid:
    """Return the frames of a run.

    Args:
        samples: Control instants of the whole run.
        control_period: Time between them [s].
    """
    every = max(1, round(FRAME / control_period), -(-samples // MOST_FRAMES))
    return Grid(every, -(-samples // every), every * control_period)


def scene_message(
    arm: Arm,
    frames: Grid,
    title: str,
    controllers: Sequence[tuple[str, str]],
    colours: Sequence[str],
    speed: float,
    live: bool,
) -> Message:
    """Return the first message: what is drawn and what it is called.

    Args:
        arm: The arm.
        frames: The frames that will follow.
        title: Name of the experiment.
        controllers: Name and note of each.
        colours: One of each joint, as CSS has them.
        speed: Simulated seconds shown in one second, to begin with.
        live: Whether the run is still going on.
    """
    parts = []
    for part in arm.parts:
        block = np.concatenate(
            [part.shape.corners, part.shape.normals, np.repeat(part.colours[:, None, :], 3, axis=1)], axis=2
        )
        parts.append({"moves": part.moves, "data": base64.b64encode(block.astype("<f4").tobytes()).decode()})
    return {
        "kind": "scene",
        "title": title,
        "live": live,
        "speed": speed,
        "period": frames.period,
        "count": frames.total,
        "controllers": [{"name": name, "note": note} for name, note in controllers],
        "parts": parts,
        "joints": arm.joints,
        "unit": "/".join(dict.fromkeys(arm.units)),
        "reach": arm.reach,
        "floor": arm.floor,
        "colours": [colours[j % len(colours)] for j in range(len(arm.joints))],
        "eye": arm.view.eye.tolist(),
        "target": arm.view.target.tolist(),
        "opening": arm.view.opening,
    }


def reference_message(arm: Arm, frames: Grid, q_ref: Array) -> Message:
    """Return the poses of the reference.

    Args:
        arm: The arm.
        frames: The frames.
        q_ref: (N, n) [rad].
    """
    return {"kind": "reference", "bodies": _rounded(arm.at(q_ref[:: frames.every])[0])}


def frames_message(
    arm: Arm, frames: Grid, controller: int, q: Array, q_ref: Array, tau: Array, first: int, last: int
) -> Message:
    """Return frames `first` to `last` - 1 of one controller: a frame's torque and error are those until the next.

    Args:
        arm: The arm.
        frames: The frames.
        controller: Its number.
        q, q_ref, tau: The run up to where it is known, (N, n); what is not a number is held (`q`) or left out.
        first, last: Numbers of frames.
    """
    start, stop = first * frames.every, min(last * frames.every, len(q))
    cuts = np.arange(0, stop - start, frames.every)
    whole = np.flatnonzero(np.isfinite(q[:stop]).all(axis=1))
    held = np.minimum(start + cuts, whole[-1] if len(whole) else 0)
    bodies, tool = arm.at(np.nan_to_num(q[held]))
    load, error = tau[start:stop] / arm.limits, q_ref[start:stop] - q[start:stop]
    known = np.isfinite(load)
    mean = np.add.reduceat(np.where(known, load, 0.0), cuts)
    mean /= np.maximum(np.add.reduceat(known, cuts, dtype=int), 1)
    return {
        "kind": "frames",
        "controller": controller,
        "first": first,
        "bodies": _rounded(bodies),
        "tool": _rounded(tool),
        "torque": _rounded(np.stack([*_range(load, cuts), mean], axis=2)),
        "error": _rounded(np.stack(_range(error, cuts), axis=2), 9),
    }


def ended_message(controller: int, ending: str) -> Message:
    """Return that a controller's run is over.

    Args:
        controller: Its number.
        ending: How and when it failed; empty if it completed.
    """
    return {"kind": "ended", "controller": controller, "ending": ending}


def _range(values: Array, cuts: Any) -> tuple[Array, Array]:
    return np.fmin.reduceat(values, cuts, axis=0), np.fmax.reduceat(values, cuts, axis=0)


def _rounded(values: Array, digits: int = _DIGITS) -> list[float]:
    """Return numbers that JSON can hold, in one list."""
    found: list[float] = np.round(np.nan_to_num(values), digits).ravel().tolist()
    return found
