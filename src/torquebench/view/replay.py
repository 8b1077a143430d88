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
from torquebench.video.layout import spans
from torquebench.video.scene import Scene, scene_of_runs, shown_poses
from torquebench.view.arm import Arm

FRAME = 0.01
"""Shortest time between two frames [s]; the page interpolates between them."""
MOST_FRAMES = 6000
"""A longer run has frames further apart."""
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
    scene = scene_of_runs(footage.model, runs)
    arm = Arm(scene)
    document = {
        "title": footage.title,
        "speed": speed,
        "period": frames.period,
        "count": frames.total,
        "parts": [_part(part.moves, part.shape, part.colours) for part in arm.parts],
        "joints": scene.joints,
        "unit": scene.unit,
        "reach": scene.reach,
        "floor": arm.floor,
        "colours": [colours[j % len(colours)] for j in range(len(scene.joints))],
        "eye": arm.view.eye.tolist(),
        "target": arm.view.target.tolist(),
        "opening": arm.view.opening,
        "reference": _rounded(arm.at(longest.q_ref[:: frames.every])[0]),
        "controllers": [
            {"name": shot.name, "note": shot.note, "ending": run.ending, **_motion(arm, scene, run, frames.every)}
            for shot, run in zip(footage.shots, runs, strict=True)
        ],
    }
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def _part(moves: bool, shape: Any, colours: Array) -> dict[str, Any]:
    """Return one body: corner, normal and colour of each corner of its triangles, as base64 of little-endian floats."""
    block = np.concatenate([shape.corners, shape.normals, np.repeat(colours[:, None, :], 3, axis=1)], axis=2)
    return {"moves": moves, "data": base64.b64encode(block.astype("<f4").tobytes()).decode()}


def _motion(arm: Arm, scene: Scene, run: Trajectory, every: int) -> dict[str, Any]:
    """Return the frames of one run; a frame's torque and error are those of the samples up to the next frame."""
    cuts = np.arange(0, len(run.t), every)
    bodies, tool = arm.at(shown_poses(run)[cuts])
    return {
        "bodies": _rounded(bodies),
        "tool": _rounded(tool),
        "torque": _rounded(np.moveaxis(spans(run.tau / scene.limits, cuts), 0, 2)),
        "error": _rounded(np.moveaxis(spans(run.q_ref - run.q, cuts)[:2], 0, 2), 9),
    }


def _rounded(values: Array, digits: int = _DIGITS) -> list[float]:
    """Return numbers that JSON can hold, in one flat list."""
    numbers: list[float] = np.round(np.nan_to_num(values), digits).ravel().tolist()
    return numbers
