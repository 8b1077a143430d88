"""Names the terms in which two arms differ: explains the difference in torque by one candidate after another.

Each candidate (armature, damping, a payload, ...) predicts a torque over random states that is linear in its numbers,
or, for a payload and a centre of mass, in ten numbers that follow from them (`about_origin`). Least squares gives the
numbers. A candidate that leaves nothing but round-off is the answer, the one with the fewest numbers first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.flat_model import SLIDE, Model, about_origin, own_copy
from torquebench.robot.robot_model import RobotModel

if TYPE_CHECKING:
    from torquebench.robot.mjcf_written import Written

LEFT = 1e-7
"""Share of the difference in torque that an explanation may leave [1]."""
ROUNDED = 1e-11
"""Share of the torque itself that is round-off [1]."""
SMALL = 1e-7
"""Share of the difference below which one number of an explanation is nothing [1]."""
ALIKE = 1e-9
"""Largest difference of two frames that count as one [1, m]."""
STEPS = 30
"""Rounds of Gauss and Newton, at most."""
DEGREES = 180.0 / math.pi
MOST = 6
"""Terms that one explanation has, at most."""
States: TypeAlias = tuple[Array, Array, Array]


@dataclass(frozen=True, slots=True)
class Term:
    """One term in which two arms differ."""

    name: str
    """``armature``, ``damping``, ..."""
    where: str
    """The joint or link; empty for what the whole arm has."""
    number: str
    """By how much B differs from A, with its unit."""

    def __str__(self) -> str:
        return f"{self.name}{self.where and f' of {self.where}'}: {self.number}"


class Explained(NamedTuple):
    """Terms that a comparison of two arms names."""

    terms: tuple[Term, ...]
    left: float
    """Share of the difference in torque that these terms leave [1]; 0 where there is none."""

    @property
    def whole(self) -> bool:
        """Whether these terms leave nothing but round-off."""
        return self.left <= LEFT


class Arm(NamedTuple):
    """One of two arms."""

    model: RobotModel | None
    """Its links; None for closed forms."""
    written: Written | None
    """Its file; None where it has none."""
    torque: Array
    """Torque at the states, friction and springs included, (N, n) [N m]."""
    pose: Array
    """Pose of its tool at the states, (N, 4, 4)."""


class Found(NamedTuple):
    """Part of the torque that a candidate explains."""

    name: str
    numbers: Array
    """One or more for each joint of `names`, or those of one link."""
    torque: Array
    """The torque that it explains, (N n,) [N m]."""
    left: float
    """Norm of what it leaves [N m]."""
    link: int = -1
    """The link that it is about; -1 for candidates that have numbers of each joint."""

    @property
    def takes(self) -> int:
        """Number of its parameters whose part of the torque is more than `SMALL`."""
        return int(np.count_nonzero(self.numbers))


def missing_terms(a: Arm, b: Arm, states: States, names: tuple[str, ...], tolerance: float = 0.0) -> Explained:
    """Return the terms in which two arms differ.

    Args:
        a, b: The arms, with the same joints.
        states: Position, velocity and acceleration of the states, (N, n) each.
        names: Names of the joints.
        tolerance: Share of the torque that counts as no difference.
    """
    if a.written is not None and b.written is not None:
        if told := _unit(a.written, b.written, states):
            return Explained((told,), 0.0)
        settings = tuple(_settings(a.written, b.written, states, names))
    else:
        settings = ()
    sign = 1.0
    if a.model is None and b.model is not None:
        a, b, sign = b, a, -1.0
    dynamics = _Dynamics(a, b, states, names, sign, max(tolerance, ROUNDED)).explain()
    return Explained((*settings, *dynamics.terms), dynamics.left)


def _unit(a: Written, b: Written, states: States) -> Term | None:
    """Return that the arms are one if the angles of a file are read in the other unit; else nothing."""
    from torquebench.errors import ModelError

    def same(x: Written, y: Written) -> bool:
        q = states[0]
        pairs = ((x.torque(*states), y.torque(*states)), (x.pose(q), y.pose(q)), (x.range, y.range))
        return all(np.linalg.norm(u - v) <= LEFT * np.linalg.norm(u) + ALIKE for u, v in pairs)

    if same(a, b):
        return None
    for one, other, letter in ((a, b, "B"), (b, a, "A")):
        try:
            turned = other.in_other_unit()
        except ModelError:
            continue
        if same(one, turned):
            return Term("unit", "angles", f"those of {letter} are read in the other unit, degrees or radians")
    return None


def _settings(a: Written, b: Written, states: States, names: tuple[str, ...]) -> Iterator[Term]:
    q, qd, _ = states
    if a.integrator != b.integrator:
        one, two = (a.stepped(q, qd, each.integrator) for each in (a, b))
        if np.linalg.norm(one - two) > ALIKE * np.linalg.norm(one):
            gap = np.max(np.abs(one - two))
            yield Term(
                "integrator", "", f"{b.integrator} in B, {a.integrator} in A: {gap:.3g} rad/s apart after a step"
            )
    for j in np.flatnonzero(np.abs(a.gears - b.gears) > ALIKE * np.abs(a.gears)):
        yield Term("gear", f"joint '{names[j]}'", f"{b.gears[j]:.6g} in B, {a.gears[j]:.6g} in A")


class _Dynamics:
    """The difference of two arms in torque, and what explains it."""

    def __init__(self, a: Arm, b: Arm, states: States, names: tuple[str, ...], sign: float, rounded: float) -> None:
        self.a, self.b, self.states, self.names, self.sign = a, b, states, names, sign
        self.rounded = rounded * float(np.linalg.norm(a.torque))

    def explain(self) -> Explained:
        """Return the terms that explain it."""
        if np.max(np.abs(self.a.pose - self.b.pose)) <= ALIKE or self.a.model is None or self.b.model is None:
            return self._of(self.a.model, self.b.torque - self.a.torque)
        best: Explained | None = None
        for terms, model in self._frames(self.a.model, self.b.model):
            if np.max(np.abs(model.forward_kinematics(self.states[0]) - self.b.pose)) > ALIKE:
                continue
            moved = self.a.torque + model.inverse_dynamics(*self.states) - self.a.model.inverse_dynamics(*self.states)
            found = self._of(model, self.b.torque - moved)
            whole = Explained((*terms, *found.terms), found.left)
            if best is None or (not whole.whole, len(whole.terms)) < (not best.whole, len(best.terms)):
                best = whole
        return best or Explained((), 1.0)

    def _frames(self, a: RobotModel, b: RobotModel) -> Iterator[tuple[tuple[Term, ...], RobotModel]]:
        """Yield what turns one joint of A, or all, into those of B, and A so turned."""

        def arm(flat: Model) -> RobotModel:
            return RobotModel(a.name, a.joint_names, own_copy(flat))

        (Wa, oa), (Wb, ob) = _placed(a.flat), _placed(b.flat)
        moves, changes = list[Term](), dict[int, tuple[Array, Array]]()
        for j in range(a.n):
            where = f"joint '{self.names[j]}'"
            axis, shift = Wa[j].T @ Wb[j][:, 2], Wa[j].T @ (ob[j] - oa[j])
            turn, slip = a.flat.rotation[j].T @ b.flat.rotation[j], b.flat.offset[j] - a.flat.offset[j]
            if np.linalg.norm(axis - [0, 0, 1]) > ALIKE or np.linalg.norm(shift) > ALIKE:
                if axis[2] < ALIKE - 1.0 and np.linalg.norm(shift) <= ALIKE:
                    term = Term("sign", f"the axis of {where}", "the opposite in B")
                else:
                    told = [f"turned by {_angle(axis):.4g} deg"] * bool(np.linalg.norm(axis - [0, 0, 1]) > ALIKE)
                    told += [f"moved by {_vector(self.sign * shift)} m"] * bool(np.linalg.norm(shift) > ALIKE)
                    term = Term("frame", f"the axis of {where}", " and ".join(told) + " in B, its links are not")
                yield (term,), arm(_turned(a.flat, j, axis, shift))
            if np.linalg.norm(turn - np.eye(3)) <= ALIKE and np.linalg.norm(slip) <= ALIKE:
                continue
            slides, along = a.flat.kind[j] == SLIDE, a.flat.rotation[j].T @ slip
            if slides and np.linalg.norm(turn - np.eye(3)) + np.linalg.norm(along[:2]) <= ALIKE:
                term = Term("ref", where, f"{-self.sign * along[2]:+.6g} m in B")
            elif not slides and turn[2, 2] > 1.0 - ALIKE and np.linalg.norm(slip) <= ALIKE:
                angle = -self.sign * math.atan2(turn[1, 0], turn[0, 0])
                term = Term("ref", where, f"{angle:+.6g} rad in B ({angle * DEGREES:.4g} deg): its zero is elsewhere")
            else:
                cosine = np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)
                told = [f"turned by {math.degrees(math.acos(cosine)):.4g} deg"] * bool(
                    np.linalg.norm(turn - np.eye(3)) > ALIKE
                )
                told += [f"moved by {_vector(self.sign * slip)} m"] * bool(np.linalg.norm(slip) > ALIKE)
                term = Term("frame", where, " and ".join(told) + " in B, and all that it carries")
            moves.append(term)
            changes[j] = b.flat.rotation[j], b.flat.offset[j]
            yield (term,), arm(_with_frames(a.flat, {j: changes[j]}))
        tool: dict[str, Any] = {"tool_rotation": b.flat.tool_rotation, "tool_offset": b.flat.tool_offset}
        if any(not np.allclose(getattr(a.flat, key), value, 0.0, ALIKE) for key, value in tool.items()):
            term = Term(
                "frame", "the tool", f"moved by {_vector(self.sign * (tool['tool_offset'] - a.flat.tool_offset))} m"
            )
            yield (term,), arm(replace(a.flat, **tool))
        if len(moves) > 1:
            yield tuple(moves), arm(replace(_with_frames(a.flat, changes), **tool))

    def _of(self, model: RobotModel | None, difference: Array) -> Explained:
        """Return the terms that explain a difference in torque, (N, n), beside a model."""
        whole = difference.ravel()
        size = float(np.linalg.norm(whole))
        if size <= self.rounded:
            return Explained((), 0.0)
        if not math.isfinite(size):
            return Explained((), 1.0)
        groups = self._groups(model)
        if single := self._single(model, groups, whole):
            return Explained(tuple(self._terms(single)), single.left / size)
        if (left := _fit(np.hstack(list(groups.values())), whole)[1]) > LEFT * size + self.rounded:
            return Explained((), left / size)
        chosen, left = list[str](), size
        while left > LEFT * size + self.rounded and len(chosen) < min(MOST, len(groups)):
            tried = {
                name: _fit(np.hstack([groups[each] for each in (*chosen, name)]), whole)[1]
                for name in groups
                if name not in chosen
            }
            name = min(tried, key=tried.__getitem__)
            chosen, left = [*chosen, name], tried[name]
        if left > LEFT * size + self.rounded:
            return Explained((), left / size)
        for name in tuple(chosen):
            fewer = [groups[each] for each in chosen if each != name]
            if fewer and _fit(np.hstack(fewer), whole)[1] <= LEFT * size + self.rounded:
                chosen.remove(name)
        numbers, _ = _fit(np.hstack([groups[name] for name in chosen]), whole)
        ends = np.cumsum([0, *(groups[name].shape[1] for name in chosen)])
        terms = list[Term]()
        for name, (start, end) in zip(chosen, itertools.pairwise(ends), strict=True):
            part = groups[name] @ numbers[start:end]
            found = self._single(model, {name: groups[name]}, part)
            terms += self._terms(found) if found else []
        return Explained(tuple(terms), left / size)

    def _groups(self, model: RobotModel | None) -> dict[str, Array]:
        """Return each candidate's torque per unit of each of its numbers, (N n, k)."""
        q, qd, qdd = self.states
        own, count = np.eye(q.shape[1]), q.shape[1]

        def at_joints(x: Array) -> Array:
            return (x[:, :, None] * own).reshape(-1, count)

        groups = {
            "armature": at_joints(qdd),
            "damping": at_joints(qd),
            "frictionloss": at_joints(np.sign(qd)),
            "springref": at_joints(np.ones_like(q)),
            "stiffness": np.hstack([at_joints(q), at_joints(np.ones_like(q))]),
        }
        if model is None:
            return groups
        flat = model.flat

        def torque(changes: Mapping[str, Array], still: bool = False) -> Array:
            changed = RobotModel(model.name, model.joint_names, own_copy(flat, **changes))
            return (changed.gravity(q) if still else changed.inverse_dynamics(q, qd, qdd)).ravel()

        one, two = self.a.written, self.b.written
        if one is None or two is None or not np.array_equal(one.gravity, two.gravity):
            groups["gravity"] = np.column_stack([torque({"gravity": axis}, still=True) for axis in np.eye(3)])
        empty = {"mass": np.zeros(count), "armature": np.zeros(count), "inertia": np.zeros((count, 3, 3))}
        weights = [torque(empty | {"mass": flat.mass * own[j]}, still=True) for j in range(count)]
        groups["gravcomp"] = -np.column_stack(weights)
        for j in range(count):
            columns = np.empty((q.size, 10))
            for k, (r, c) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
                inertia = np.zeros((count, 3, 3))
                inertia[j, r, c] = inertia[j, c, r] = 1.0
                columns[:, 4 + k] = torque(empty | {"inertia": inertia})
            columns[:, 0] = torque(empty | {"mass": own[j], "com": np.zeros((count, 3))})
            for k in range(3):
                turning = columns[:, 4:7].sum(axis=1) - columns[:, 4 + k]
                moved = torque(empty | {"mass": own[j], "com": np.outer(own[j], np.eye(3)[k])})
                columns[:, 1 + k] = moved - columns[:, 0] - turning
            groups[f"link {j}"] = columns
        return groups

    def _single(self, model: RobotModel | None, groups: Mapping[str, Array], whole: Array) -> Found | None:
        """Return the one candidate that explains a torque with the fewest numbers; None where none does."""
        size, found = float(np.linalg.norm(whole)), list[Found]()
        for name, columns in groups.items():
            if name.startswith("link ") and model is not None:
                found += _of_link(model.flat, int(name[5:]), columns, whole)
            else:
                numbers, left = _fit(columns, whole)
                found.append(Found(name, numbers, columns @ numbers, left))
        exact = [each for each in found if each.left <= LEFT * size + self.rounded]
        return min(exact, key=lambda each: (each.takes, not self._told(each)), default=None)

    def _told(self, found: Found) -> bool:
        """Whether the two arms' links differ in a candidate, which is then preferred to others that explain as much."""
        if self.a.model is None or self.b.model is None:
            return False
        a, b = self.a.model.flat, self.b.model.flat
        key = {"armature": "armature", "gravity": "gravity", "COM": "com", "inertia": "inertia", "payload": "mass"}
        return found.name in key and not np.array_equal(getattr(a, key[found.name]), getattr(b, key[found.name]))

    def _terms(self, found: Found) -> Iterator[Term]:
        numbers, n = self.sign * found.numbers, len(self.names)
        if found.link >= 0:
            yield self._of_link(found)
        elif found.name == "gravity":
            own = self.a.model.flat.gravity if self.a.model is not None else np.zeros(3)
            yield Term("gravity vector", "", f"{_vector(own + found.numbers)} m/s^2, against {_vector(own)}")
        else:
            for j in range(n):
                if np.any(numbers[j::n]):
                    yield Term(found.name, f"joint '{self.names[j]}'", self._at_joint(found.name, j, numbers[j::n]))

    def _at_joint(self, name: str, j: int, number: Array) -> str:
        """Return by how much B differs in a number of one joint."""
        slides = self.a.model is not None and self.a.model.flat.kind[j] == SLIDE
        force, per = ("N", "m") if slides else ("N m", "rad")
        unit = {
            "armature": "kg" if slides else "kg m^2",
            "damping": f"{force} s/{per}",
            "frictionloss": force,
            "stiffness": f"{force}/{per}",
            "gravcomp": "of its link's weight",
        }
        files = [None if arm.written is None else arm.written for arm in (self.a, self.b)]
        if name == "springref":
            k = next((float(file.stiffness[j]) for file in files if file is not None), 0.0)
            return f"{-number[0] / k:+.6g} {per} in B" if k > 0.0 else f"a constant {number[0]:+.6g} {force} in B"
        if name == "stiffness" and number[0] != 0.0:
            return f"{number[0]:+.6g} {unit[name]} in B, about {-number[1] / number[0]:.6g} {per}"
        text = f"{number[0]:+.6g} {unit[name]} in B"
        if name == "damping" and files[0] is not None and files[1] is not None and files[0].damping[j] > 0.0:
            ratio = files[1].damping[j] / files[0].damping[j]
            if any(abs(ratio / unit_ratio - 1.0) < 1e-3 for unit_ratio in (DEGREES, 1.0 / DEGREES)):
                text += ", a ratio of 180/pi: per degree?"
        return text

    def _of_link(self, found: Found) -> Term:
        link, numbers = f"the link of joint '{self.names[found.link]}'", self.sign * found.numbers
        if found.name == "COM":
            return Term("COM", link, f"{_vector(numbers, '+')} m in B, in the joint's frame")
        if found.name == "payload":
            own = self.a.model.flat.com[found.link] if self.a.model is not None else np.zeros(3)
            at_centre = ", the link's centre of mass: so may be its own mass" * bool(
                np.allclose(found.numbers[1:], own, 0, 1e-6)
            )
            return Term("payload", link, f"{numbers[0]:+.6g} kg in B at {_vector(found.numbers[1:])} m{at_centre}")
        if found.name == "inertia":
            told = [f"I{x} {v:+.6g}" for x, v in zip(("xx", "yy", "zz", "xy", "xz", "yz"), numbers, strict=True) if v]
            return Term("inertia", link, f"{', '.join(told)} kg m^2 in B")
        return Term(
            "mass, COM and inertia", link, f"{numbers[0]:+.6g} kg, first moment {_vector(numbers[1:4], '+')} kg m in B"
        )


def _fit(columns: Array, whole: Array) -> tuple[Array, float]:
    """Return least squares' numbers, those without effect zero, and the norm of what they leave."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    numbers = np.linalg.lstsq(columns / scale, whole, rcond=1e-10)[0]
    numbers[np.abs(numbers) <= SMALL * np.linalg.norm(whole)] = 0.0
    numbers /= scale
    return numbers, float(np.linalg.norm(whole - columns @ numbers))


def _of_link(flat: Model, j: int, columns: Array, whole: Array) -> Iterator[Found]:
    """Yield what a link's payload, centre of mass, inertia, or all ten numbers explain of a torque."""
    m, c, zero = float(flat.mass[j]), flat.com[j], np.zeros((1, 3, 3))
    own = about_origin(np.array([m]), c[None], zero)[0]

    def loaded(p: Array) -> Array:
        torque: Array = columns @ about_origin(p[:1], p[None, 1:], zero)[0]
        return torque

    def moved(p: Array) -> Array:
        torque: Array = columns @ (about_origin(np.array([m]), (c + p)[None], zero)[0] - own)
        return torque

    all_ten, left = _fit(columns, whole)
    at = all_ten[1:4] / all_ten[0] if all_ten[0] else c
    for name, torque, start in (("payload", loaded, np.array([all_ten[0] or 0.1, *at])), ("COM", moved, np.zeros(3))):
        found, remains = _newton(torque, start, whole)
        yield Found(name, found, torque(found), remains, j)
    inertia, remains = _fit(columns[:, 4:], whole)
    yield Found("inertia", inertia, columns[:, 4:] @ inertia, remains, j)
    yield Found("link", all_ten, columns @ all_ten, left, j)


def _newton(torque: Callable[[Array], Array], start: Array, whole: Array) -> tuple[Array, float]:
    """Return the numbers of which a torque comes nearest to another, by Gauss and Newton, and what they leave."""
    p, size = start.copy(), float(np.linalg.norm(whole))
    best, least = p, float(np.linalg.norm(whole - torque(p)))
    for i in range(STEPS):
        h = 1e-4 * np.maximum(np.abs(p), 0.1)
        slopes = np.column_stack(
            [(torque(p + d) - torque(p - d)) / (2.0 * x) for d, x in zip(np.diag(h), h, strict=True)]
        )
        step = np.linalg.lstsq(slopes, whole - torque(p), rcond=1e-10)[0]
        p = p + step
        left = float(np.linalg.norm(whole - torque(p)))
        if not math.isfinite(left):
            break
        if left < least:
            best, least = p, left
        if least <= 1e-13 * size or (left > 0.999 * least and i > 5):
            break
    effect = np.array(
        [np.linalg.norm(torque(best) - torque(np.where(np.arange(len(p)) == k, 0.0, best))) for k in range(len(p))]
    )
    return np.where(effect <= SMALL * size, 0.0, best), least


def _placed(flat: Model) -> tuple[list[Array], list[Array]]:
    """Return orientation and origin of each joint's frame in the base frame at q = 0."""
    R, p, frames, origins = np.eye(3), np.zeros(3), list[Array](), list[Array]()
    for rotation, offset in zip(flat.rotation, flat.offset, strict=True):
        p, R = p + R @ offset, R @ rotation
        frames.append(R)
        origins.append(p)
    return frames, origins


def _turned(flat: Model, j: int, axis: Array, shift: Array) -> Model:
    """Return an arm whose joint j turns about another axis, all links where they were at q = 0.

    Args:
        flat: The arm.
        j: The joint, from 0.
        axis: Its axis in the joint's frame, (3,).
        shift: How far its origin moves, in that frame, (3,) [m].
    """
    v = np.cross([0.0, 0.0, 1.0], axis)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    Q = np.diag([1.0, -1.0, -1.0]) if axis[2] < ALIKE - 1.0 else np.eye(3) + cross + cross @ cross / (1.0 + axis[2])
    rotation, offset, com, inertia = (np.array(x) for x in (flat.rotation, flat.offset, flat.com, flat.inertia))
    offset[j] += rotation[j] @ shift
    rotation[j] = rotation[j] @ Q
    com[j], inertia[j] = Q.T @ (com[j] - shift), Q.T @ inertia[j] @ Q
    tool: dict[str, Any] = {}
    if j + 1 < len(rotation):
        rotation[j + 1], offset[j + 1] = Q.T @ rotation[j + 1], Q.T @ (offset[j + 1] - shift)
    else:
        tool = {"tool_rotation": Q.T @ flat.tool_rotation, "tool_offset": Q.T @ (flat.tool_offset - shift)}
    return replace(flat, rotation=rotation, offset=offset, com=com, inertia=inertia, **tool)


def _with_frames(flat: Model, frames: Mapping[int, tuple[Array, Array]]) -> Model:
    rotation, offset = np.array(flat.rotation), np.array(flat.offset)
    for j, (R, p) in frames.items():
        rotation[j], offset[j] = R, p
    return replace(flat, rotation=rotation, offset=offset)


def _angle(axis: Array) -> float:
    return math.degrees(math.acos(float(np.clip(axis[2], -1.0, 1.0))))


def _vector(x: Array, sign: str = "") -> str:
    return f"({', '.join(f'{v:{sign}.6g}' for v in np.where(np.abs(x) < 1e-12, 0.0, x))})"
