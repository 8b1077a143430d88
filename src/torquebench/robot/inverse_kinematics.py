"""Joint positions that take an arm's tool along a path: Newton's method at knots, and a spline through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from torquebench.errors import TorquebenchError
from torquebench.kernel import Array
from torquebench.robot.flat_model import HINGE
from torquebench.robot.robot_model import RobotModel

REACHED = 1e-12
"""The tool is at a pose if it is this close [rad, and as a fraction of the arm's length]."""
MISSED = 1e-9
"""Between knots the tool leaves the path by no more than this [m, rad]: knots are added until it does not."""
FEWEST, MOST = 64, 4096
"""Knots of a path."""
ROUNDS = 40
"""Steps of Newton's method; it takes about four where it converges."""
SINGULAR = 1e-3
"""Least singular value of the scaled Jacobian at which the arm still follows [1]: 0 where it has lost a way to move."""
JUMP = 0.5
"""From one knot to the next no joint moves further [rad or m]."""
TURNED = 1e4
"""A joint position beyond this is none that an arm has, and its sine no longer exact [rad or m]."""
FAR = 100.0
"""Times the arm's length; a place so far away is a slip of the pen."""
FINER = 16
"""Steps between two knots where the arm does not get from one to the next in one."""
AHEAD = 9
"""Points of the rest of a path that are tried to tell how far out of reach it leads."""


class PathError(TorquebenchError):
    """The tool cannot follow a path.

    Args:
        where: How far along the path, 0 to 1.
        text: Why.
    """

    def __init__(self, where: float, text: str) -> None:
        super().__init__(text)
        self.where, self.text = where, text


class Frames(NamedTuple):
    """The tool at N joint positions, in the base frame."""

    turn: Array
    """Orientation, (N, 3, 3)."""
    place: Array
    """Origin, (N, 3) [m]."""
    linear: Array
    """Derivative of the origin by each joint, (N, 3, n) [m/rad, or 1 for slides]."""
    angular: Array
    """Angular velocity of the tool for each joint's, (N, 3, n) [1; 0 for slides]."""


def tool_frames(model: RobotModel, q: Array) -> Frames:
    """Return pose and Jacobian of the tool at joint positions (N, n) [rad]."""
    flat, (count, n) = model.flat, q.shape
    R, p = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    axes, anchors, hinges = np.empty((count, 3, n)), np.empty((count, 3, n)), flat.kind == HINGE
    for i in range(n):
        p, R = p + R @ flat.offset[i], R @ flat.rotation[i]
        axes[:, :, i] = R[:, :, 2]
        if hinges[i]:
            c, s = np.cos(q[:, i])[:, None], np.sin(q[:, i])[:, None]
            x, y = R[:, :, 0], R[:, :, 1]
            R = np.stack([x * c + y * s, y * c - x * s, R[:, :, 2]], axis=2)
        else:
            p = p + R[:, :, 2] * q[:, i : i + 1]
        anchors[:, :, i] = p
    p, R = p + R @ flat.tool_offset, R @ flat.tool_rotation
    turning = np.cross(axes, p[:, :, None] - anchors, axis=1)
    return Frames(R, p, np.where(hinges, turning, axes), np.where(hinges, axes, 0.0))


@dataclass(frozen=True)
class Task:
    """Task of an arm's tool: places to reach, in one orientation or in any.

    Args:
        model: The arm.
        turn: Orientation of the tool in the base frame, (3, 3); None for any.
        rest: Joint position to stay near where the tool's pose leaves a choice, (n,) [rad].
    """

    model: RobotModel
    turn: Array | None
    rest: Array

    @property
    def length(self) -> float:
        """Length of the stretched arm, which scales places beside angles [m]."""
        flat = self.model.flat
        return float(np.sum(np.linalg.norm(flat.offset[1:], axis=1)) + np.linalg.norm(flat.tool_offset)) or 1.0

    def miss(self, frames: Frames, places: Array) -> Array:
        """Return what is missing to the wanted poses, (N, 3 or 6): places [m], then turns [rad]."""
        gap: Array = places - frames.place
        if self.turn is None:
            return gap
        from scipy.spatial.transform import Rotation

        return np.hstack([gap, Rotation.from_matrix(self.turn @ frames.turn.transpose(0, 2, 1)).as_rotvec()])

    def jacobian(self, frames: Frames) -> Array:
        """Return the Jacobian of what is asked, places over the arm's length, (N, 3 or 6, n)."""
        rows = [frames.linear / self.length] if self.turn is None else [frames.linear / self.length, frames.angular]
        return np.concatenate(rows, axis=1)

    def solve(self, q: Array, places: Array) -> tuple[Array, Array]:
        """Return the joint positions nearest to `rest` that bring the tool to places, and whether they do.

        Newton's method on the Lagrangian of |q - rest|^2 / 2 with the pose as its constraint: where an arm has just the
        joints that it needs, this is Newton's method on the pose.

        Args:
            q: Where to begin, (N, n) [rad].
            places: Wanted origins of the tool, (N, 3) [m].
        """
        count, n = q.shape
        scale, multipliers = np.array([self.length] * 3 + [1.0] * 3), None
        for _ in range(ROUNDS):
            frames = tool_frames(self.model, q)
            J, gap = self.jacobian(frames), self.miss(frames, places)
            m = J.shape[1]
            gap = gap / scale[:m]
            if multipliers is None:
                multipliers = -np.einsum("kni,kn->ki", np.linalg.pinv(J, 1e-10), q - self.rest)
            matrix = np.zeros((count, n + m, n + m))
            matrix[:, :n, :n] = np.eye(n) + self._curvature(frames, multipliers)
            matrix[:, n:, :n], matrix[:, :n, n:] = J, J.transpose(0, 2, 1)
            right = np.hstack([self.rest - q, gap])
            found = np.einsum("kij,kj->ki", np.linalg.pinv(matrix, 1e-11, hermitian=True), right)
            step, multipliers = found[:, :n], found[:, n:]
            step *= np.minimum(1.0, 1.0 / np.maximum(np.max(np.abs(step), axis=1), 1e-300))[:, None]  # at most 1 rad
            q = q + step
            if np.max(np.abs(step)) < 1e-13 * (1.0 + np.max(np.abs(q))):
                break
        miss = np.abs(self.miss(tool_frames(self.model, q), places)) / scale[:m]
        settled = np.max(np.abs(step), axis=1) < 1e-9
        return q, settled & (np.max(miss, axis=1) < REACHED)

    def _curvature(self, frames: Frames, multipliers: Array) -> Array:
        """Return the second derivative of the pose by the joints, weighed by the multipliers, (N, n, n)."""
        n = frames.linear.shape[2]
        first, last = np.minimum.outer(range(n), range(n)), np.maximum.outer(range(n), range(n))
        nearer = frames.angular[:, :, first]
        bent = np.cross(nearer, frames.linear[:, :, last], axis=1) / self.length
        weighed: Array = np.einsum("kcij,kc->kij", bent, multipliers[:, :3])
        if self.turn is not None:
            turned = np.cross(nearer, frames.angular[:, :, last], axis=1) / 2.0
            weighed = weighed + np.einsum("kcij,kc->kij", turned, multipliers[:, 3:])
        return weighed

    def ways(self) -> int:
        """Return in how many ways the tool can move, as far as is asked."""
        spread = np.random.default_rng(0).uniform(-1.0, 1.0, (8, self.model.n))
        J = self.jacobian(tool_frames(self.model, self.rest + spread))
        return int(np.max(np.linalg.matrix_rank(J, tol=1e-8)))

    def check(self, q: Array, where: Array, ways: int) -> None:
        """Refuse joint positions at which the arm is singular.

        Args:
            q: The positions, (N, n) [rad].
            where: How far along the path each is, (N,).
            ways: What `ways` returns.

        Raises:
            PathError: at one of them the tool cannot move in every way in which it could elsewhere.
        """
        J = self.jacobian(tool_frames(self.model, q))
        least = np.linalg.svd(J, compute_uv=False)[:, ways - 1]
        k = int(np.argmin(least))
        if least[k] < SINGULAR:
            said = f"the least singular value of its scaled Jacobian is {least[k]:.2g}, wanted at least {SINGULAR:g}"
            raise PathError(float(where[k]), f"the arm is singular there: {said}")

    def check_size(self, q: Array, places: Array, where: Array) -> None:
        """Refuse numbers that are none of an arm, before Newton's method meets them.

        Args:
            q: Where the search would begin, (n,) [rad].
            places: Wanted origins of the tool, (N, 3) [m].
            where: How far along the path each is, (N,).

        Raises:
            PathError: a joint would be beyond `TURNED`, or a place is `FAR` times as far from the first joint as the
                stretched arm is long; beyond `TURNED` where the arm slides.
        """
        if not np.max(np.abs(q)) <= TURNED:
            raise PathError(float(where[0]), f"a joint would be at {np.max(np.abs(q)):.3g}, wanted at most {TURNED:g}")
        most = FAR * self.length if np.all(self.model.flat.kind == HINGE) else TURNED
        away = np.max(np.abs(places), axis=1)
        if not np.max(away) <= most:
            k = int(np.argmax(~(away <= most)))
            raise PathError(
                float(where[k]), f"out of reach: it is {away[k]:.3g} m away, the arm {self.length:.3g} m long"
            )

    def refusal(self, q: Array, places: Array, where: Array) -> PathError:
        """Return why the tool does not get from a joint position along a path: out of reach, or only by a jump.

        Args:
            q: The last joint position, (n,) [rad].
            places: Where the tool should be from then on, (N, 3) [m].
            where: How far along the path each is, (N,).
        """
        ahead = np.unique(np.linspace(0, len(places) - 1, AHEAD).astype(int))
        nearest = [self._nearest(q, places[k]) for k in ahead]
        turned = np.array([np.linalg.norm(miss[3:]) for _, miss in nearest])
        away = np.array([np.linalg.norm(miss[:3]) for _, miss in nearest])
        if max(away[0] / self.length, turned[0]) < 1e-7:
            j = int(np.argmax(np.abs(nearest[0][0] - q)))
            moved = f"{self.model.joint_names[j]} would have to jump by {abs(nearest[0][0][j] - q[j]):.3g} rad"
            return PathError(float(where[0]), f"no joint motion leads on from here: {moved}")
        k = int(np.argmax(away / self.length + turned))
        turn = f" and {turned[k]:.3g} rad" if self.turn is not None else ""
        return PathError(float(where[0]), f"out of reach from here on, by up to {away[k]:.3g} m{turn}")

    def _nearest(self, q: Array, place: Array) -> tuple[Array, Array]:
        """Return the joint position near `q` that brings the tool nearest to a place, and what it misses [m, rad]."""
        from scipy.optimize import least_squares

        scale = np.array([self.length] * 3 + [1.0] * 3)

        def gap(x: Array) -> Array:
            miss: Array = self.miss(tool_frames(self.model, x[None]), place[None])[0]
            scaled: Array = miss / scale[: len(miss)]
            return scaled

        best = least_squares(gap, q, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        return best.x, best.fun * scale[: len(best.fun)]


class JointPath(NamedTuple):
    """Joint positions along a piece of a path, as a spline of degree five in how far along it is, 0 to 1."""

    spline: Any
    missed: float
    """Largest distance of the tool from the path half-way between knots [m, rad]."""

    def at(self, u: Array) -> tuple[Array, Array, Array]:
        """Return joint positions and their first two derivatives by `u`, (N, n) each."""
        return self.spline(u), self.spline(u, 1), self.spline(u, 2)


def joint_path(task: Task, start: Array, path: Callable[[Array], Array], closed: bool) -> JointPath:
    """Return the joint positions that take the tool along a smooth piece of a path.

    Args:
        task: The arm and the orientation.
        start: Joint position at its beginning, (n,) [rad].
        path: From how far along (N,), 0 to 1, to the tool's place, (N, 3) [m].
        closed: Whether it ends where it begins, joints included.

    Raises:
        PathError: the arm cannot follow, or only through a singular position or with a jump.
    """
    from scipy.interpolate import make_interp_spline

    u = np.linspace(0.0, 1.0, FEWEST + 1)
    task.check_size(start, path(u), u)
    ways = task.ways()
    task.check(start[None], np.zeros(1), ways)
    q = np.empty((len(u), task.model.n))
    q[0] = start
    for k in range(FEWEST):
        steps = u[k + 1 : k + 2]
        some = _march(task, q[k], path(steps))
        if not len(some):
            steps = np.linspace(u[k], u[k + 1], FINER + 1)[1:]
            some = _march(task, q[k], path(steps))
        if len(some) < len(steps):
            last = some[-1] if len(some) else q[k]
            rest = np.append(steps[len(some) :], u[k + 2 :])
            task.check(np.vstack([q[: k + 1], last]), np.append(u[: k + 1], rest[0]), ways)
            raise task.refusal(last, path(rest), rest)
        q[k + 1] = some[-1]
    if closed:
        j = int(np.argmax(np.abs(q[-1] - q[0])))
        off = float(abs(q[-1, j] - q[0, j]))
        if off > 1e-6:
            raise PathError(1.0, f"the joints do not come back: {task.model.joint_names[j]} ends {off:.3g} rad away")
        q[-1] = q[0]
    while True:
        task.check(q, u, ways)
        spline = make_interp_spline(u, q, k=5, bc_type="periodic" if closed else None)
        between = (u[1:] + u[:-1]) / 2.0
        guess, places = spline(between), path(between)
        missed = np.max(np.abs(task.miss(tool_frames(task.model, guess), places)), axis=1)
        worst = int(np.argmax(missed))
        if missed[worst] <= MISSED:
            return JointPath(spline, float(missed[worst]))
        more, reached = task.solve(guess, places)
        if not reached.all() or len(u) > MOST:
            k = worst if reached.all() else int(np.argmin(reached))
            raise task.refusal(q[k], places[k : k + 1], between[k : k + 1])
        both = np.empty((len(q) + len(more), q.shape[1]))
        both[::2], both[1::2] = q, more
        u, q = np.linspace(0.0, 1.0, len(both)), both


def _march(task: Task, q: Array, places: Array) -> Array:
    """Return joint positions at places, each found from the one before; they end where one could not be reached.

    Args:
        task: The arm and the orientation.
        q: Joint position before the first place, (n,) [rad].
        places: Wanted origins of the tool, (N, 3) [m].
    """
    found = [q]
    for k in range(len(places)):
        more, reached = task.solve(found[-1][None], places[k : k + 1])
        if not reached[0] or np.max(np.abs(more[0] - found[-1])) > JUMP:
            break
        found.append(more[0])
    return np.array(found[1:])
