"""Paths of the tool in space, turned into joint motions by inverse kinematics; one class a shape.

A shape of your own derives from `ClosedToolPath`, says in ``along(u)`` where the tool is after `u` rounds, and is
registered as any kind is: ``@reference("tool-ellipse")``.
"""

from __future__ import annotations

import functools
import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array, IntArray
from torquebench.keys import Key, Vector, as_vector, values_of
from torquebench.references.quintic import Quintic
from torquebench.references.reference import ORIGIN, Reference, reference
from torquebench.robot import RobotModel
from torquebench.robot.inverse_kinematics import JointPath, PathError, Task, joint_path, tool_frames

Point: TypeAlias = tuple[float, float, float]
Plane: TypeAlias = Literal["xy", "xz", "yz"]
Piece: TypeAlias = Callable[[Array], Array]
"""A smooth part of a path: from how far along it, (N,), 0 to 1, to the tool's place from the start, (N, 3) [m]."""
IN_PLANE = Key("Plane of the base frame that it lies in")


class Clock(NamedTuple):
    """Position of the tool along a path at N times."""

    piece: IntArray
    """Number of the piece."""
    u: Array
    """How far along it, 0 to 1."""
    rate: Array
    """Derivative of `u` [1/s]."""
    acceleration: Array
    """Its second derivative [1/s^2]."""


@dataclass(frozen=True, kw_only=True)
class ToolPath(ABC):
    """Base of all tool paths: where they begin and how the tool is turned."""

    start: Annotated[
        Vector,
        Key(
            "Position of each joint where the path begins; the tool is turned as there",
            "rad",
            ", in m for slide joints",
        ),
    ]
    at: Annotated[
        Point | None,
        Key(
            "Place of the tool in the base frame where the path begins, to which joints near start take it; its place "
            "at start if left out",
            "m",
            wanted="three numbers, x, y and z [m]",
        ),
    ] = None
    orientation: Annotated[
        Literal["kept", "free"],
        Key(
            "Whether the tool keeps its orientation; free needs three joints instead of six. Of the joint positions "
            "that are left to choose from, the nearest to those at the path's beginning is taken"
        ),
    ] = "kept"
    origin: Annotated[Vector | None, ORIGIN] = None
    approach: Annotated[
        float,
        Key("Time of the minimum-jerk joint motion from the origin to the path's beginning, ahead of it", "s", above=0),
    ] = 1.0

    @property
    def metrics_from(self) -> float:
        """Start of the window for metrics [s]: the path's."""
        return self.approach

    @abstractmethod
    def pieces(self) -> Sequence[Piece]:
        """Return the path's smooth parts, in order."""

    @abstractmethod
    def clock(self, t: Array) -> Clock:
        """Return where on the path the tool is at times since its beginning (N,), at least 0 [s]."""

    @property
    @abstractmethod
    def span(self) -> float:
        """Time of the whole path, or of the first round [s]."""

    def on_arm(self, model: RobotModel) -> ToolMotion:
        """Return the path as a motion of an arm's joints.

        Raises:
            PathError: the arm cannot follow it.
        """
        flat = model.flat
        places = (x.tobytes() for x in (flat.kind, flat.rotation, flat.offset, flat.tool_rotation, flat.tool_offset))
        kept: dict[Any, ToolMotion] = vars(self).setdefault("_solved", {})
        key = (repr(values_of(self)), *places)
        if key not in kept:
            kept[key] = self._solve(model)
        return kept[key]

    def _solve(self, model: RobotModel) -> ToolMotion:
        q = as_vector(self.start, model.n)
        frames = tool_frames(model, q[None])
        task = Task(model, frames.turn[0] if self.orientation == "kept" else None, q)
        begin, parts = frames.place[0], list[JointPath]()
        if self.at is not None:
            begin = np.array(self.at)
            try:
                task.check_size(q, begin[None], np.zeros(1))
            except PathError as error:
                raise self._told(error, 0, begin) from error
            found, reached = task.solve(q[None], begin[None])
            if not reached[0]:
                raise self._told(task.refusal(q, begin[None], np.zeros(1)), 0, begin)
            q = found[0]
            task = Task(model, task.turn, q)
        first = q
        for number, piece in enumerate(self.pieces()):

            def place(u: Array, piece: Piece = piece) -> Array:
                there: Array = begin + piece(u)
                return there

            try:
                parts.append(joint_path(task, q, place, isinstance(self, ClosedToolPath)))
            except PathError as error:
                raise self._told(error, number, place(np.array([error.where]))[0]) from error
            q = parts[-1].at(np.ones(1))[0][0]
        return ToolMotion(self, first, tuple(parts))

    def _told(self, error: PathError, number: int, place: Array) -> PathError:
        """Return an error with its time and place."""
        t = np.linspace(0.0, self.span, 10_000, endpoint=False)
        clock = self.clock(t)
        on = clock.piece == number
        when = self.approach + float(np.interp(error.where, clock.u[on], t[on]))
        x, y, z = (round(number, 6) + 0.0 for number in place.tolist())
        return PathError(error.where, f"t = {when:.4g} s, tool at [{x:.4g}, {y:.4g}, {z:.4g}] m: {error.text}")


@dataclass(frozen=True)
class ToolMotion:
    """A path as a motion of an arm's joints.

    Args:
        path: The path.
        start: Joint position at its beginning, (n,) [rad].
        parts: Its pieces.
    """

    path: ToolPath
    start: Array
    parts: tuple[JointPath, ...]

    @property
    def missed(self) -> float:
        """Largest distance of the tool from the path between knots [m, rad]."""
        return max(part.missed for part in self.parts)

    def sample(self, t: Array, n: int | None = None) -> Reference:
        """Return the desired motion at times (N,) [s]; `n`, the number of joints, is the arm's."""
        lead = self.path.approach
        q, qd, qdd = Quintic(tuple(self.start.tolist()), lead, origin=self.path.origin).sample(t, n)
        on = np.flatnonzero(t > lead)
        clock = self.path.clock(t[on] - lead)
        for number, part in enumerate(self.parts):
            here = clock.piece == number
            rows, rate = on[here], clock.rate[here, None]
            q[rows], slope, bend = part.at(clock.u[here])
            qd[rows] = slope * rate
            qdd[rows] = bend * rate * rate + slope * clock.acceleration[here, None]
        return Reference(q, qd, qdd)


@dataclass(frozen=True, kw_only=True)
class ClosedToolPath(ToolPath):
    """A closed path, gone round and round; up to its full rate over the first half period."""

    period: Annotated[float, Key("Time of one round at full rate; the first takes a quarter longer", "s", above=0)]

    @abstractmethod
    def along(self, u: Array) -> Array:
        """Return where the tool is after `u` rounds, (N,), from where it began, (N, 3) [m]; a round is from 0 to 1."""

    def pieces(self) -> Sequence[Piece]:
        """Return the path."""
        return (self.along,)

    @property
    def span(self) -> float:
        """Time of the first round [s]."""
        return 1.25 * self.period

    def clock(self, t: Array) -> Clock:
        """Return where on the path the tool is; the rate rises as the polynomial of least jerk."""
        rise = self.period / 2.0
        x = np.clip(t / rise, 0.0, 1.0)
        u = (rise * x**4 * (2.5 + x * (x - 3.0)) + np.maximum(t - rise, 0.0)) / self.period
        rate = x**3 * (10.0 + x * (6.0 * x - 15.0)) / self.period
        return Clock(
            np.zeros(len(t), dtype=np.int64), u % 1.0, rate, 30.0 * (x * (1.0 - x)) ** 2 / (rise * self.period)
        )

    def _in_plane(self, plane: Plane, across: Array, up: Array) -> Array:
        """Return points by their coordinates in a plane, (N, 3) [m]."""
        points = np.zeros((len(across), 3))
        points[:, "xyz".index(plane[0])], points[:, "xyz".index(plane[1])] = across, up
        return points


@reference("tool-line")
@dataclass(frozen=True, kw_only=True)
class ToolLine(ClosedToolPath):
    """The tool goes along a straight line and back, as (1 - cos 2 pi u) / 2."""

    to: Annotated[
        Point, Key("Other end of the line, from where it begins", "m", wanted="three numbers, x, y and z [m]")
    ]

    def along(self, u: Array) -> Array:
        """Return where the tool is after `u` rounds, from where it began, (N, 3) [m]."""
        return np.outer((1.0 - np.cos(2.0 * np.pi * u)) / 2.0, self.to)


@reference("tool-circle")
@dataclass(frozen=True, kw_only=True)
class ToolCircle(ClosedToolPath):
    """The tool goes round a circle, from its point that is farthest along the plane's first axis towards the second."""

    radius: Annotated[float, Key("Radius", "m", above=0)]
    plane: Annotated[Plane, IN_PLANE] = "xy"

    def along(self, u: Array) -> Array:
        """Return where the tool is after `u` rounds, from where it began, (N, 3) [m]."""
        angle = 2.0 * np.pi * u
        return self._in_plane(self.plane, self.radius * (np.cos(angle) - 1.0), self.radius * np.sin(angle))


@reference("tool-lemniscate")
@dataclass(frozen=True, kw_only=True)
class ToolLemniscate(ClosedToolPath):
    """The tool draws a figure of eight, Gerono's lemniscate, from its crossing: w/2 sin 2 pi u, w/4 sin 4 pi u."""

    width: Annotated[float, Key("Width w along the plane's first axis; it is half as high", "m", above=0)]
    plane: Annotated[Plane, IN_PLANE] = "xy"

    def along(self, u: Array) -> Array:
        """Return where the tool is after `u` rounds, from where it began, (N, 3) [m]."""
        angle = 2.0 * np.pi * u
        return self._in_plane(self.plane, self.width / 2.0 * np.sin(angle), self.width / 4.0 * np.sin(2.0 * angle))


@reference("tool-waypoints")
@dataclass(frozen=True, kw_only=True)
class ToolWaypoints(ToolPath):
    """The tool goes straight from point to point, with least jerk and at rest at each, and stays at the last."""

    points: Annotated[
        tuple[Point, ...],
        Key("Points in order, each from where the path begins", "m", wanted="a list of points [x, y, z] [m]"),
    ]
    speed: Annotated[float, Key("Greatest speed of the tool between two points", "m/s", above=0)]

    @property
    def _ends(self) -> Array:
        """Start of each piece, and end of the last, (K + 1, 3) [m]; a point twice in a row counts once."""
        points = [point for point, _ in itertools.groupby([(0.0, 0.0, 0.0), *self.points])]
        return np.array(points if len(points) > 1 else points * 2)

    @property
    def _times(self) -> Array:
        """Time at which each piece begins, and the last ends, (K + 1,) [s]."""
        lengths = np.linalg.norm(np.diff(self._ends, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(1.875 * lengths / self.speed)])

    def pieces(self) -> Sequence[Piece]:
        """Return the lines between the points."""
        return [functools.partial(_between, begin, end) for begin, end in itertools.pairwise(self._ends)]

    @property
    def span(self) -> float:
        """Time of the whole path [s]."""
        return float(self._times[-1])

    def clock(self, t: Array) -> Clock:
        """Return where on the path the tool is."""
        times = self._times
        piece = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        took = np.maximum(np.diff(times), 1e-300)[piece]
        x = np.clip((t - times[piece]) / took, 0.0, 1.0)
        u = x**3 * (10.0 + x * (6.0 * x - 15.0))
        moves = 1.0 / took if self.span else np.zeros(len(t))
        return Clock(piece, u, 30.0 * (x * (1.0 - x)) ** 2 * moves, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) * moves**2)


def _between(begin: Array, end: Array, u: Array) -> Array:
    return begin + np.outer(u, end - begin)
