"""A run as its page's script draws it: signals at full rate, packed, and the arm.

Signals are for looking: 16-bit integers times a scale for each block of samples, so that a sample is within 2e-5 of its
block's largest value. Every figure that a page states is the stored one.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench.errors import ModelError
from torquebench.experiment.run import ExperimentResult, band_of
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.references.reference import depends_on_arm
from torquebench.robot.flat_model import force_unit
from torquebench.scene.shapes import Triangles
from torquebench.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from torquebench.scene.arm import Arm

BLOCK = 128
"""Samples that share a scale."""
MOST_VALUES = 6_000_000
"""More values than that are thinned: the page of a long run stays one that a browser opens."""
MOST_TRIANGLES = 60_000
"""An arm whose looks have more is drawn by its links on the page; one of more without its looks is not drawn."""


def replay_data(result: ExperimentResult, colours: Mapping[str, str]) -> dict[str, Any]:
    """Return what the page's script draws.

    Args:
        result: The run.
        colours: Colour of each controller, ``#RRGGBB``.
    """
    runs, joints, n = result.runs, result.joints, len(result.joints.names)
    longest = max(runs.values(), key=lambda run: len(run.t))
    every = math.ceil(sum(3 * run.q.size for run in runs.values()) / MOST_VALUES)
    arm, why = _arm(result)
    reference, (joint, told) = result.experiment.reference, _telling_joint(result)
    return {
        "period": result.experiment.run.control_period * every,
        "every": every,
        "samples": len(thinned(longest.q_ref, every)),
        "joint": joint,
        "joint_why": told,
        "joints": [
            {"name": name, "limit": limit, "angle": "m" if slides else "rad", "torque": force_unit(slides)}
            for name, limit, slides in zip(joints.names, joints.tau_max, joints.slides, strict=True)
        ],
        "reference": packed(longest.q_ref[::every] if every > 1 else longest.q_ref),
        "controllers": [
            {
                "name": keys.name,
                "colour": colours[keys.name],
                "band": None if band is None else as_vector(band, n).tolist(),
                "chattering": None if metrics is None else metrics["chattering"].value,
            }
            | _signals(runs[keys.name], every)
            for keys in result.experiment.controllers
            for band in [band_of(keys.law, keys.gains)]
            for metrics in [result.metrics.get(keys.name)]
        ],
        "path_from": reference.metrics_from if depends_on_arm(reference) else None,
        "arm": arm,
        "why": why,
    }


def _telling_joint(result: ExperimentResult) -> tuple[int, str]:
    """Return the joint that chatters most, or else the one that is followed worst, and that; 0 where nothing is."""
    for key, told in (("chattering", ", which chatters most"), ("rmse", ", of the largest error")):
        rows = [[x or 0.0 for x in metrics[key].per_joint] for metrics in result.metrics.values()]
        worst = np.max(rows, axis=0, initial=0.0) if rows else np.zeros(1)
        if np.max(worst) > (0.1 if key == "chattering" else 0.0):
            return int(np.argmax(worst)), told
    return 0, ""


def _signals(run: Trajectory, every: int) -> dict[str, Any]:
    error, known = thinned(run.q_ref - run.q, every), bool(np.isfinite(run.s).any())
    return {
        "ending": run.ending,
        "samples": len(error),
        "error": packed(error),
        "torque": packed(thinned(run.tau, every)),
        "sliding": packed(thinned(run.s, every)) if known else None,
        "deflection": None if run.motor_q is None else packed(thinned(run.motor_q - run.q, every)),
    }


def thinned(signal: Array, every: int) -> Array:
    """Return the least and the greatest of each 2 `every` samples, in their order in time, joint by joint.

    Args:
        signal: (N, n).
        every: How many samples become one; 1 returns the signal.
    """
    if every == 1:
        return signal
    whole = len(signal) // (2 * every)
    blocks = signal[: whole * 2 * every].reshape(whole, 2 * every, -1)
    finite = np.nan_to_num(blocks)
    ends = np.sort(np.stack([finite.argmin(axis=1), finite.argmax(axis=1)], axis=1), axis=1)
    kept: Array = np.take_along_axis(blocks, ends, axis=1).reshape(2 * whole, -1)
    return kept


def packed(signal: Array) -> dict[str, Any]:
    """Return a signal (N, n) as base64: little-endian int16, joint after joint, and a float32 scale for each block."""
    samples, n = signal.shape
    blocks = -(-samples // BLOCK)
    padded = np.full((n, blocks * BLOCK), np.nan)
    padded[:, :samples] = np.clip(signal.T, -1e30, 1e30)
    grouped = padded.reshape(n, blocks, BLOCK)
    scale = np.maximum(np.max(np.abs(np.nan_to_num(grouped)), axis=2) / 32766.0, 1e-30).astype("<f4")
    whole = np.where(np.isnan(grouped), -32768.0, np.round(np.nan_to_num(grouped) / scale[:, :, None]))
    values = whole.astype("<i2").reshape(n, -1)[:, :samples]
    return {"block": BLOCK, "scale": _text(scale), "values": _text(values)}


def _text(values: Any) -> str:
    return base64.b64encode(values.tobytes()).decode()


def _arm(result: ExperimentResult) -> tuple[dict[str, Any] | None, str]:
    """Return the arm, or None and why it cannot be drawn."""
    if result.arm_changed:
        return None, "the files of the arm have changed since the run"
    try:
        from torquebench.scene.arm import read_arm
        from torquebench.scene.look import scene_of_runs
    except ImportError as error:  # the analytic plant runs without MuJoCo
        return None, f"MuJoCo cannot be loaded ({error})"
    try:
        for bare in (False, True):
            scene = scene_of_runs(result.experiment.plant.model, list(result.runs.values()), bare)
            arm = read_arm(scene)
            count = sum(len(part.surface.corners) for body in arm.bodies for part in body.parts)
            if count <= MOST_TRIANGLES:
                break
    except ModelError as error:
        return None, str(error)
    if count > MOST_TRIANGLES:
        return None, f"its shape has {count} triangles, more than {MOST_TRIANGLES}; torquebench video draws it"
    nodes, last = _nodes(arm)
    return {
        "reach": scene.reach,
        "floor": arm.floor,
        "tool": {"node": last[arm.tool[0]], "place": arm.tool[1].tolist()},
        "eye": arm.view.eye.tolist(),
        "target": arm.view.target.tolist(),
        "opening": arm.view.opening,
        "nodes": nodes,
    }, ""


def _nodes(arm: Arm) -> tuple[list[dict[str, Any]], list[int]]:
    """Return frames, each within its parent's (-1: the world), and for each body the one that moves with its shapes.

    A body is a frame with, for each joint, one about a point of its axis, which the joint moves, and one back from it.
    """
    nodes: list[dict[str, Any]] = []
    last: list[int] = []

    def add(parent: int, place: Array, turn: Array | None = None, joint: dict[str, Any] | None = None) -> int:
        w, x, y, z = (1.0, 0.0, 0.0, 0.0) if turn is None else turn.tolist()
        node = {"parent": parent, "place": place.tolist(), "turn": [x, y, z, w], "joint": joint}
        nodes.append(node | {"moves": False, "parts": []})
        return len(nodes) - 1

    for number, body in enumerate(arm.bodies):
        own = add(last[body.parent] if number else -1, body.place, body.turn)
        for joint in body.joints:
            moved = {"of_q": joint.of_q, "slides": joint.slides, "axis": joint.axis.tolist(), "zero": joint.zero}
            own = add(add(own, joint.place, joint=moved), -joint.place)
        parts = [{"colour": part.colour.tolist()} | _surface(part.surface) for part in body.parts]
        nodes[own] |= {"moves": body.moves, "parts": parts}
        last.append(own)
    return nodes, last


def _surface(surface: Triangles) -> dict[str, Any]:
    """Return corners as int16 times a scale, within 2e-5 of the part's size, and normals as int8 over 127."""
    scale = float(np.max(np.abs(surface.corners))) / 32767.0
    return {
        "scale": scale,
        "corners": _text(np.round(surface.corners / scale).astype("<i2")),
        "normals": _text(np.round(127.0 * surface.normals).astype("i1")),
    }
