"""Forward kinematics: how far (8), (10)-(22) and Table 2 are from each other and from the arm of the dynamics."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.puma560.puma import Puma560

from .elements import POSE, pose_index, pose_tree
from .formula import evaluate
from .independent import modified_chain, standard_chain, table2


@cache
def pose_error(number: int) -> float:
    """Largest difference between one of (11)-(22) as printed and repaired, over all six angles."""
    printed, repaired = pose_tree(number, repaired=False), pose_tree(number, repaired=True)
    if printed == repaired:
        return 0.0

    def gap(theta: Array) -> Array:
        values = {f"theta{i + 1}": theta[:, i] for i in range(6)}
        return np.abs(evaluate(printed, values) - evaluate(repaired, values))

    return largest(gap)


def largest(function: Callable[[Array], Array], starts: int = 4000, rounds: int = 120) -> float:
    """Largest value of `function` (N, 6) -> (N,) found over six angles: random starts, the best refined at random.

    The result is a lower bound; the functions here are smooth, and the last refinements are of 1e-4 rad.
    """
    rng = np.random.default_rng(1)
    theta = rng.uniform(-np.pi, np.pi, (starts, 6))
    best = theta[np.argsort(function(theta))[-20:]]
    width = 0.5
    for _ in range(rounds):
        trial = best[:, None, :] + width * rng.normal(size=(20, 30, 6))
        trial[:, 0] = best
        values = function(trial.reshape(-1, 6)).reshape(20, 30)
        best = trial[np.arange(20), values.argmax(axis=1)]
        width *= 0.93
    return float(function(best).max())


@cache
def pose_gaps() -> dict[str, float]:
    """How far the literal (10) is from a rotation, and its determinant's range."""
    model = Puma560("printed")

    def defect(theta: Array) -> Array:
        R = model.forward_kinematics(theta)[:, :3, :3]
        return np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2))

    def determinant(theta: Array) -> Array:
        return np.linalg.det(model.forward_kinematics(theta)[:, :3, :3])

    return {
        "defect": largest(defect),
        "most": largest(determinant),
        "least": -largest(lambda theta: -determinant(theta)),
    }


def to_paper(q: Array) -> Array:
    """The arm's joint positions q (..., 6) in the coordinates of the repaired (11)-(22)."""
    sign = np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    return sign * q + np.array([0.0, 0.0, np.pi, 0.0, np.pi, 0.0])


def repaired(theta: Array) -> Array:
    """(10) filled with the repaired (11)-(22) at theta (..., 6), (..., 4, 4)."""
    values = {f"theta{i + 1}": theta[..., i] for i in range(6)}
    T = np.broadcast_to(np.eye(4), (*theta.shape[:-1], 4, 4)).copy()
    for number in POSE:
        T[(..., *pose_index(number))] = evaluate(pose_tree(number, repaired=True), values)
    return T


def wrist(rows: list[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """The rows of Table 2 without d6, so that their chain ends at the wrist centre."""
    return [*rows[:5], (*rows[5][:2], 0.0)]


PAPER_CHAIN = [
    (np.pi / 2, 0.0, 0.0),
    (0.0, 0.4318, -0.1491),
    (np.pi / 2, 0.0203, 0.0),
    (np.pi / 2, 0.0, 0.4331),
    (np.pi / 2, 0.0, 0.0),
    (0.0, 0.0, 0.0),
]
"""Standard Denavit-Hartenberg rows (alpha, a, d) of the repaired (11)-(22), in their own coordinates."""


def _metres(first: Callable[[Array], Array], second: Callable[[Array], Array]) -> float:
    return largest(lambda q: np.linalg.norm(first(q)[:, :3, 3] - second(q)[:, :3, 3], axis=1))


@cache
def chain_gaps() -> dict[str, float]:
    """Largest distances between positions [m] that different readings of (8), Table 2 and (20)-(22) give."""
    used, printed = table2(a3_as_printed=False), table2(a3_as_printed=True)
    return {
        "row": _metres(
            lambda q: modified_chain(printed, q, same_row=True), lambda q: modified_chain(printed, q, same_row=False)
        ),
        "a3": _metres(lambda q: standard_chain(printed, q), lambda q: standard_chain(used, q)),
        "digits": _metres(lambda q: repaired(to_paper(q)), lambda q: standard_chain(wrist(used), q)),
        "coordinates": _metres(repaired, lambda q: standard_chain(wrist(used), q)),
        "tool": used[5][2],
    }
