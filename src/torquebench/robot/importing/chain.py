"""The chain of joints that a law drives, found in a compiled model: what is welded, what is left out, what branches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import did_you_mean
from torquebench.kernel import Array
from torquebench.robot.importing.findings import Part
from torquebench.robot.mjcf_links import ON_JOINT, joint_name

_ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Options:
    """Options for making a published arm into a plain chain."""

    fix: tuple[str, ...] = ()
    """Joints that are welded where the keyframe home has them; of a body: all its joints and those beyond."""
    base: str = ""
    """Body that the chain starts at: it is welded to the world, and what does not hang from it is left out."""
    tip: str = ""
    """Body that the chain ends with: what hangs from it is left out, and so are moving branches on the way to it."""
    tool: str = ""
    """Site or body that is the tool; without it a site by a usual name, else the last body before any branches."""
    torque_limits: tuple[float, ...] | Mapping[str, float] = ()
    """Torque limit of each joint, or of some by name [N m; N for slides]; the file's own without it."""
    drop: tuple[str, ...] = ()
    """Forces that are left out although they move the arm: some of `forces.DROPS`."""
    name: str = ""
    """Name of the arm; that of the file without it."""


@dataclass
class Chain:
    """Joints and bodies of a compiled model that make up the chain, and those that are left out."""

    model: Any
    home: Array
    """``qpos`` of the whole model, (nq,)."""
    joints: tuple[int, ...]
    """Joints that are kept, from the base on."""
    fixed: tuple[int, ...]
    """Joints that are welded at home."""
    removed: frozenset[int]
    """Bodies that are left out."""
    findings: list[Part] = field(default_factory=list)

    @property
    def dofs(self) -> list[int]:
        """Degrees of freedom of the kept joints."""
        return [int(self.model.jnt_dofadr[j]) for j in self.joints]

    @property
    def places(self) -> list[int]:
        """Places of the kept joints in ``qpos``."""
        return [int(self.model.jnt_qposadr[j]) for j in self.joints]

    def link(self, body: int) -> int:
        """Return the body with kept joints that `body` is, or is welded to; 0 for the world."""
        moving = {int(self.model.jnt_bodyid[j]) for j in self.joints}
        while body > 0 and body not in moving:
            body = int(self.model.body_parentid[body])
        return body

    def at(self, q: Array) -> Any:
        """Return data of the whole model with the kept joints at `q` (n,) and all others at home, kinematics done."""
        d = mujoco.MjData(self.model)
        d.qpos[:] = self.home
        d.qpos[self.places] = q
        mujoco.mj_kinematics(self.model, d)
        mujoco.mj_comPos(self.model, d)
        return d


def name_of(m: Any, kind: Any, index: int) -> str:
    """Return the name of an element, or its kind and number where it has none.

    Args:
        m: The compiled model.
        kind: Of ``mujoco.mjtObj``.
        index: Its number.
    """
    word = kind.name.removeprefix("mjOBJ_").lower()
    return mujoco.mj_id2name(m, kind, index) or f"{word} {index + (word == 'joint')}"


def body_name(m: Any, body: int) -> str:
    """Return the name of a body, or its number."""
    return mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"


def subtree(m: Any, body: int) -> set[int]:
    """Return a body and all that hang from it."""
    found = {body}
    for b in range(body + 1, m.nbody):  # parents come before their children
        if int(m.body_parentid[b]) in found:
            found.add(b)
    return found


def find_chain(m: Any, options: Options, home: Array) -> Chain:
    """Return what of a model moves; what is wrong with the options or the model is among its findings.

    Args:
        m: The compiled model.
        options: What is welded, and what is left out.
        home: Its ``qpos`` where joints are welded, (nq,).
    """
    findings: list[Part] = []
    joints = {joint_name(m, j): j for j in range(m.njnt)}
    bodies = {body_name(m, b): b for b in range(m.nbody)}
    fixed = set[int]()
    for name in options.fix:
        if name in joints:
            fixed.add(joints[name])
        elif name in bodies:
            inside = subtree(m, bodies[name])
            fixed |= {j for j in range(m.njnt) if int(m.jnt_bodyid[j]) in inside}
        else:
            findings.append(_unknown("--fix", "joint or body", name, [*joints, *bodies]))
    base, tip = 0, -1
    for flag, name in (("--base", options.base), ("--tip", options.tip)):
        if name and name not in bodies:
            findings.append(_unknown(flag, "body", name, list(bodies)))
        elif name and flag == "--base":
            base = bodies[name]
        elif name:
            tip = bodies[name]
    below = subtree(m, base)
    if tip >= 0 and tip not in below:
        findings.append(Part("refused", "--tip", (options.tip,), f"does not hang from --base {options.base}"))
        tip = -1
    removed = set[int]()
    if base:
        above, body = {0}, base
        while body:
            above.add(body)
            body = int(m.body_parentid[body])
        fixed |= {j for j in range(m.njnt) if int(m.jnt_bodyid[j]) in above}
        removed |= _jointed(m, set(range(1, m.nbody)) - below - above, fixed)
    if tip >= 0:
        path, body = set[int]((tip,)), tip
        while body:
            body = int(m.body_parentid[body])
            path.add(body)
        removed |= subtree(m, tip) - {tip}
        removed |= _jointed(m, below - path - removed, fixed)
    kept = [j for j in range(m.njnt) if j not in fixed and int(m.jnt_bodyid[j]) not in removed]
    welded = tuple(sorted(j for j in fixed if int(m.jnt_bodyid[j]) not in removed))
    chain = Chain(m, home, tuple(kept), welded, frozenset(removed), findings)
    _check(chain)
    return chain


def _unknown(flag: str, kind: str, name: str, names: Iterable[str]) -> Part:
    return Part("refused", flag, (name,), f"the file has no such {kind}{did_you_mean(name, names)}")


def _jointed(m: Any, among: set[int], fixed: set[int]) -> set[int]:
    """Return the bodies of some that move with a joint that is not welded, and what hangs from them."""
    found = set[int]()
    for j in range(m.njnt):
        if j not in fixed and int(m.jnt_bodyid[j]) in among:
            found |= subtree(m, int(m.jnt_bodyid[j]))
    return found


def _check(chain: Chain) -> None:
    """Add to a chain's findings why it is none."""
    m, findings = chain.model, chain.findings
    odd = [j for j in chain.joints if int(m.jnt_type[j]) not in _ONE_DOF]
    for j in odd:
        kind = "free joint" if m.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE else "ball joint"
        carrier = body_name(m, int(m.jnt_bodyid[j]))
        name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_JOINT, j)
        findings.append(
            Part(
                "refused",
                kind,
                (name or f"body {carrier}",),
                "no torque of one joint moves it",
                ("--fix", name or carrier),
            )
        )
    if not chain.joints:
        findings.append(Part("refused", "joints", (), "nothing that is left moves"))
    children: dict[int, list[int]] = {}
    for body in dict.fromkeys(int(m.jnt_bodyid[j]) for j in chain.joints if j not in odd):
        children.setdefault(chain.link(int(m.body_parentid[body])), []).append(body)
    point = 0
    while branches := children.get(point):
        if len(branches) == 1:
            point = branches[0]
            continue
        size = {b: _size(chain, b) for b in branches}
        trunk = _trunk(size)
        others = [b for b in branches if b != trunk]
        names = tuple(body_name(m, b) for b in branches)
        where = body_name(m, point) if point else "the world"
        most = max(size.values())
        if trunk is None and most[1] >= max(3, _before(chain, point) + 1):  # more than what carries it: no finger
            largest = [b for b in branches if size[b] == most]
            tips = " or ".join(f"--tip {body_name(m, _last(b, children))}" for b in largest)
            tip = body_name(m, _last(largest[0], children))
            findings.append(
                Part("refused", "branches", names, f"several arms stand on {where}: {tips} takes one", ("--tip", tip))
            )
            return
        weld = ",".join(body_name(m, b) for b in others)
        leave = body_name(m, point) if point and trunk is None else ""
        also = f" welds them; --tip {leave} leaves them out" if leave else " welds the smaller"
        if _rides(chain, point):
            also += f"; --base {where} beside it leaves the joints before {where} at home too"
        findings.append(
            Part("refused", "branches", names, f"they part at {where}: --fix {weld}{also}", ("--fix", weld))
        )
        if trunk is None:
            return
        point = trunk


def _before(chain: Chain, body: int) -> int:
    """Return how many kept joints there are from the base to a body, its own included."""
    count = 0
    while body:
        count += sum(int(chain.model.jnt_bodyid[j]) == body for j in chain.joints)
        body = int(chain.model.body_parentid[body])
    return count


def _rides(chain: Chain, body: int) -> bool:
    """Return whether what carries an arm up to a body begins with a slide, as carriages and torsos do."""
    m, carrying = chain.model, list[int]()
    while body:
        carrying[:0] = [j for j in chain.joints if int(m.jnt_bodyid[j]) == body]
        body = int(m.body_parentid[body])
    return bool(carrying) and bool(m.jnt_type[carrying[0]] == mujoco.mjtJoint.mjJNT_SLIDE)


def _size(chain: Chain, body: int) -> tuple[int, int]:
    """Return how many kept joints from a body on an actuator drives, and how many there are."""
    m, inside = chain.model, subtree(chain.model, body)
    here = {j for j in chain.joints if int(m.jnt_bodyid[j]) in inside}
    return len(here & driven(m)), len(here)


def driven(m: Any) -> set[int]:
    """Return the joints that actuators drive."""
    return {int(m.actuator_trnid[a, 0]) for a in range(m.nu) if int(m.actuator_trntype[a]) in ON_JOINT}


def _trunk(size: Mapping[int, tuple[int, int]]) -> int | None:
    """Return the branch that is the arm: the only one that is driven, or by far the longest; None where none is."""
    moved = [b for b, (driving, _) in size.items() if driving]
    if len(moved) == 1:
        return moved[0]
    first, second = sorted(size.values(), key=lambda pair: pair[1], reverse=True)[:2]
    return max(size, key=lambda b: size[b][1]) if first[1] >= second[1] + 3 else None


def _last(body: int, children: Mapping[int, list[int]]) -> int:
    """Return the last moving body of the chain that begins at one, up to where it branches."""
    while len(children.get(body, ())) == 1:
        body = children[body][0]
    return body


def home_of(m: Any) -> tuple[Array, str]:
    """Return the ``qpos`` at which an arm is at home, (nq,), and what says so.

    The keyframe ``home``, else the first one, else the model's own reference position; there joints with limits are
    moved into them.
    """
    key = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_KEY, "home")
    if key >= 0 or m.nkey:
        key = max(key, 0)
        qpos: Array = m.key_qpos[key].copy()
        return qpos, f"keyframe {name_of(m, mujoco.mjtObj.mjOBJ_KEY, key)}"
    qpos = m.qpos0.copy()
    moved = False
    for j in range(m.njnt):
        if m.jnt_limited[j] and int(m.jnt_type[j]) in _ONE_DOF:
            at = m.jnt_qposadr[j]
            low, high = m.jnt_range[j]
            if not low <= qpos[at] <= high:
                qpos[at], moved = min(max(qpos[at], low), high), True
    return qpos, "no keyframe: the zero position" + (", moved into the joints' ranges" if moved else "")


def is_zero(values: Any) -> bool:
    """Return whether all of some numbers are zero."""
    return not np.any(np.asarray(values) != 0)
