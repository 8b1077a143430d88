"""The replay of a stored run as the one JSON document that the page in the browser loads."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.sim.trajectory import Trajectory
from torquebench.video.job import Footage
from torquebench.view.arm import Arm

FRAME = 0.01
"""Shortest time between two frames [s]; the page interpolates between them."""
MOST_FRAMES = 6000
"""A longer run has frames further apart."""
CAMERA_POSES = 100
"""Poses of each run from which a camera is placed if the arm's files have none."""
_DIGITS = 5
"""Decimals of lengths, quaternions and torques over their limits."""


class Frames(NamedTuple):
    """The samples that become frames: every `every`-th."""

    every: int
    total: int
    """Frames of the whole run."""
    period: float
    """Time between frames [s]."""


def frames_of(samples: int, control_period: float) -> Frames:
    """Choose the frames of a run.

    Args:
        samples: Number of control instants.
        control_period: Time between them [s].
    """
    every = max(1, round(FRAME / control_period), -(-samples // MOST_FRAMES))
    return Frames(every, -(-samples // every), every * control_period)


def replay_json(footage: Footage, runs: Sequence[Trajectory], colours: Sequence[str], speed: float) -> bytes:
    """Return the document that the page shows.

    Args:
        footage: The stored run.
        runs: Trajectory of each of its controllers.
        colours: Colours of the joints as CSS writes them; they repeat if there are more joints.
        speed: Simulated seconds shown in one second at the start.

    Raises:
        ModelError: the arm cannot be read or drawn.
    """
    longest = max(runs, key=lambda run: len(run.t))
    frames = frames_of(len(longest.t), footage.control_period)
    poses = [x[:: max(1, len(x) // CAMERA_POSES)] for run in runs for x in (run.q, run.q_ref)]
    arm = Arm(footage.model, np.nan_to_num(np.concatenate(poses)))
    document = {
        "title": footage.title,
        "speed": speed,
        "period": frames.period,
        "count": frames.total,
        "parts": [_part(part.moves, part.shape, part.colours) for part in arm.parts],
        "joints": arm.joints,
        "unit": "/".join(dict.fromkeys(arm.units)),
        "reach": arm.reach,
        "floor": arm.floor,
        "colours": [colours[j % len(colours)] for j in range(len(arm.joints))],
        "eye": arm.view.eye.tolist(),
        "target": arm.view.target.tolist(),
        "opening": arm.view.opening,
        "reference": _rounded(arm.at(longest.q_ref[:: frames.every])[0]),
        "controllers": [
            {"name": shot.name, "note": shot.note, "ending": run.ending, **_motion(arm, run, frames.every)}
            for shot, run in zip(footage.shots, runs, strict=True)
        ],
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _part(moves: bool, shape: Any, colours: Array) -> dict[str, Any]:
    """Return one body: corner, normal and colour of each corner of its triangles, as base64 of little-endian floats."""
    block = np.concatenate([shape.corners, shape.normals, np.repeat(colours[:, None, :], 3, axis=1)], axis=2)
    return {"moves": moves, "data": base64.b64encode(block.astype("<f4").tobytes()).decode()}


def _motion(arm: Arm, run: Trajectory, every: int) -> dict[str, Any]:
    """Return the frames of one run; a frame's torque and error are those of the samples up to the next frame.

    Where the position is not a number the last pose is held; samples of torque or error that are none are left out.
    """
    cuts = np.arange(0, len(run.t), every)
    finite = np.flatnonzero(np.isfinite(run.q).all(axis=1))
    bodies, tool = arm.at(np.nan_to_num(run.q[np.minimum(cuts, finite[-1] if len(finite) else 0)]))
    load, error = run.tau / arm.limits, run.q_ref - run.q
    known = np.isfinite(load)
    mean = np.add.reduceat(np.where(known, load, 0.0), cuts)
    mean /= np.maximum(np.add.reduceat(known, cuts, dtype=int), 1)
    return {
        "bodies": _rounded(bodies),
        "tool": _rounded(tool),
        "torque": _rounded(np.stack([*_range(load, cuts), mean], axis=2)),
        "error": _rounded(np.stack(_range(error, cuts), axis=2), 9),
    }


def _range(values: Array, cuts: Any) -> tuple[Array, Array]:
    return np.fmin.reduceat(values, cuts, axis=0), np.fmax.reduceat(values, cuts, axis=0)


def _rounded(values: Array, digits: int = _DIGITS) -> list[float]:
    """Return numbers that JSON can hold, in one flat list."""
    numbers: list[float] = np.round(np.nan_to_num(values), digits).ravel().tolist()
    return numbers
