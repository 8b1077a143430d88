"""The forces of a published arm: what is kept or mapped, what moves no joint, and what the testbed has no part for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from torquebench.errors import did_you_mean
from torquebench.kernel import Array
from torquebench.robot.importing.chain import Chain, Options, body_name, is_zero, name_of
from torquebench.robot.importing.findings import LIMITS, Part
from torquebench.robot.mjcf_links import ON_JOINT, SPEEDS, joint_name, speed_limits

_OBJ, _OFF, _TRN, _EQ = mujoco.mjtObj, mujoco.mjtDisableBit, mujoco.mjtTrn, mujoco.mjtEq
_NO_STATE = mujoco.mjtDyn.mjDYN_NONE
_STATES = 20
_SAME = 1e-12
DROPS = ("springs", "fluid", "tendons", "equalities", "gravcomp", "nonlinear-damping", "impossible-inertia")
"""Forces that `Options.drop` leaves out."""


@dataclass(frozen=True)
class Forces:
    """Forces on the kept joints, besides weight and inertia; arrays (n,), zero where there is none."""

    armature: Array
    damping: Array
    friction: Array
    torque_limits: Array
    """[N m]; NaN where the file states none."""
    limited: Array
    """Whether the range is a limit."""
    range: Array
    """(n, 2) [rad or m]."""
    gravity: Array
    """(3,) [m/s^2]."""
    speeds: Array
    """Greatest speed [rad/s]; infinite where the file states none."""
    given: Array
    """Whether the torque limit is one that was given."""


def forces_of(chain: Chain, options: Options, stated: Mapping[str, float]) -> Forces:
    """Return the forces of a chain; what it does with each is added to the chain's findings.

    Args:
        chain: The chain; it has joints.
        options: What is left out, and torque limits.
        stated: Greatest speeds of some joints, as of `Source.speeds`.
    """
    m, dofs, joints = chain.model, chain.dofs, chain.joints
    names = tuple(joint_name(m, j) for j in joints)
    off = int(m.opt.disableflags)
    for word in options.drop:
        if word not in DROPS:
            chain.findings.append(Part("refused", "--drop", (word,), f"no such force{did_you_mean(word, DROPS)}"))
    armature, damping, nonlinear = m.dof_armature[dofs].copy(), m.dof_damping[dofs].copy(), m.dof_dampingpoly[dofs] != 0
    nonlinear = nonlinear.any(axis=1)
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) in ON_JOINT and int(m.actuator_trnid[a, 0]) in joints:
            i, gear = joints.index(int(m.actuator_trnid[a, 0])), float(m.actuator_gear[a, 0])
            armature[i] += gear * gear * float(m.actuator_armature[a])
            damping[i] += gear * gear * float(m.actuator_damping[a])
            nonlinear[i] |= not is_zero(m.actuator_dampingpoly[a])
    friction = m.dof_frictionloss[dofs].copy()
    if off & _OFF.mjDSBL_DAMPER:
        _switched(chain, "joint damping", damping != 0, names, "damper")
        damping[:], nonlinear[:] = 0.0, False
    if off & (_OFF.mjDSBL_FRICTIONLOSS | _OFF.mjDSBL_CONSTRAINT):
        _switched(chain, "joint friction", friction != 0, names, "frictionloss or constraint")
        friction[:] = 0.0
    limited = m.jnt_limited[list(joints)].astype(bool)
    if off & (_OFF.mjDSBL_LIMIT | _OFF.mjDSBL_CONSTRAINT):
        _switched(chain, "joint limits", limited, names, "limit or constraint")
        limited[:] = False
    add = chain.findings.append
    if np.any(armature):
        add(Part("kept", "armature", _where(names, armature != 0), "inertia of the rotor, as seen at the joint"))
    if np.any(damping):
        add(Part("mapped", "joint damping", _where(names, damping != 0), "viscous friction, the same force"))
    if np.any(friction):
        text = (
            "Coulomb friction, which falls linearly to zero near standstill: a joint at rest creeps under a torque "
            "below it, where MuJoCo's frictionloss holds the joint"
        )
        add(Part("mapped", "frictionloss", _where(names, friction != 0), text))
    if np.any(limited):
        add(Part("kept", "joint limits", _where(names, limited), "range of the joint"))
    if np.any(nonlinear):
        _optional(chain, options, "nonlinear-damping", "damping that is not linear", _where(names, nonlinear))
    _springs(chain, options, names)
    _fluid(chain, options)
    _tendons(chain, options)
    _equalities(chain, options)
    torque_limits, given = _torque_limits(chain, options, names)
    return Forces(
        armature,
        damping,
        friction,
        torque_limits,
        limited,
        m.jnt_range[list(joints)].copy(),
        _gravity(chain, options),
        _speeds(chain, names, stated),
        given,
    )


def _speeds(chain: Chain, names: Sequence[str], stated: Mapping[str, float]) -> Array:
    """Return the greatest speeds of the kept joints, (n,) [rad/s]: those stated, else what velocity servos can ask."""
    m = chain.model
    own = speed_limits(m)
    if own is None:
        text = f"wants a number for each of {m.njnt} joints, 0 for no limit"
        chain.findings.append(Part("refused", f"<numeric {SPEEDS}>", (), text))
    speeds = np.full(len(names), np.inf) if own is None else own[list(chain.joints)]
    for a in range(m.nu):
        if int(m.actuator_trntype[a]) in ON_JOINT and int(m.actuator_trnid[a, 0]) in chain.joints:
            i, gear = chain.joints.index(int(m.actuator_trnid[a, 0])), abs(float(m.actuator_gear[a, 0]))
            gain, (_, stiff, damped) = float(m.actuator_gainprm[a, 0]), m.actuator_biasprm[a, :3]
            plain = m.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED and m.actuator_dyntype[a] == _NO_STATE
            if plain and m.actuator_ctrllimited[a] and stiff == 0 and gain > 0 and damped == -gain and gear > 0:
                most = float(np.max(np.abs(m.actuator_ctrlrange[m.actuator_ctrladr[a]])))
                speeds[i] = min(speeds[i], most / gear) if most > 0 else speeds[i]
    for i, name in enumerate(names):
        speeds[i] = min(speeds[i], stated.get(name, np.inf))
    if np.any(some := np.isfinite(speeds)):
        slides = {bool(m.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in chain.joints}
        unit = "m/s" if slides == {True} else "rad/s" if slides == {False} else "rad/s, m/s of slides"
        text = f"{' '.join(f'{x:g}' for x in speeds[some])} {unit}: a run tells where they are exceeded"
        chain.findings.append(Part("kept", "speed limits", _where(names, some), text))
    return speeds


def _where(names: Sequence[str], here: Iterable[Any]) -> tuple[str, ...]:
    return tuple(name for name, there in zip(names, here, strict=True) if there)


def _switched(chain: Chain, what: str, here: Array, names: Sequence[str], flag: str) -> None:
    if np.any(here):
        chain.findings.append(Part("dropped", what, _where(names, here), f"the file's flag {flag} switches it off"))


def _optional(chain: Chain, options: Options, word: str, what: str, places: tuple[str, ...]) -> None:
    """Refuse a force that the testbed has no part for, unless the options leave it out."""
    if word in options.drop:
        chain.findings.append(Part("dropped", what, places, f"left out by --drop {word}: the arm moves differently"))
    else:
        text = f"the testbed has none; --drop {word} leaves it out"
        chain.findings.append(Part("refused", what, places, text, ("--drop", word)))


def _springs(chain: Chain, options: Options, names: Sequence[str]) -> None:
    m, joints = chain.model, list(chain.joints)
    here = (
        (m.jnt_stiffness[joints] != 0)
        | (m.jnt_stiffnesspoly[joints] != 0).any(axis=1)
        | (m.jnt_plasticadr[joints] >= 0)
    )
    if not np.any(here):
        return
    if m.opt.disableflags & _OFF.mjDSBL_SPRING:
        _switched(chain, "springs of joints", here, names, "spring")
    else:
        _optional(chain, options, "springs", "springs of joints", _where(names, here))


def _fluid(chain: Chain, options: Options) -> None:
    m = chain.model
    if m.opt.density or m.opt.viscosity:
        _optional(chain, options, "fluid", "a fluid around the arm", ("option",))


def _moves(chain: Chain, tendon: int) -> set[int]:
    """Return the links that a tendon joins: for one of joints, those that its kept joints move and the world."""
    m = chain.model
    found = set[int]()
    for w in range(m.tendon_adr[tendon], m.tendon_adr[tendon] + m.tendon_num[tendon]):
        kind, index = m.wrap_type[w], int(m.wrap_objid[w])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            found |= {0, int(m.jnt_bodyid[index])} if index in chain.joints else {0}
        elif kind == mujoco.mjtWrap.mjWRAP_SITE and int(m.site_bodyid[index]) not in chain.removed:
            found.add(chain.link(int(m.site_bodyid[index])))
    return found


def _tendons(chain: Chain, options: Options) -> None:
    m = chain.model
    driven = {int(m.actuator_trnid[a, 0]) for a in range(m.nu) if m.actuator_trntype[a] == _TRN.mjTRN_TENDON}
    idle, acting = list[str](), list[str]()
    for t in range(m.ntendon):
        passive = (
            m.tendon_stiffness[t],
            m.tendon_damping[t],
            m.tendon_frictionloss[t],
            m.tendon_armature[t],
            m.tendon_limited[t],
            *m.tendon_stiffnesspoly[t],
            *m.tendon_dampingpoly[t],
        )
        acts = len(_moves(chain, t)) > 1 and (t in driven or not is_zero(passive))
        (acting if acts else idle).append(name_of(m, _OBJ.mjOBJ_TENDON, t))
    if idle:
        chain.findings.append(Part("dropped", "tendons", tuple(idle), "they pull on no joint that is kept"))
    if acting:
        _optional(chain, options, "tendons", "tendons on kept joints", tuple(acting))


def _equalities(chain: Chain, options: Options) -> None:
    m = chain.model
    off = m.opt.disableflags & (_OFF.mjDSBL_CONSTRAINT | _OFF.mjDSBL_EQUALITY)
    idle, acting, weld = list[str](), list[str](), list[str]()
    for e in range(m.neq):
        first, second = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
        name = mujoco.mj_id2name(m, _OBJ.mjOBJ_EQUALITY, e)
        if m.eq_type[e] == _EQ.mjEQ_JOINT:
            acts = first in chain.joints or second in chain.joints
            name = name or f"{joint_name(m, first)} = f({joint_name(m, second) if second >= 0 else ''})"
            follower = first if first in chain.joints else second
        elif m.eq_type[e] == _EQ.mjEQ_TENDON:
            acts = any(len(_moves(chain, t)) > 1 for t in (first, second) if t >= 0)
            follower = -1
        elif int(m.eq_type[e]) in (int(_EQ.mjEQ_CONNECT), int(_EQ.mjEQ_WELD)):
            pair = (first, second)
            if m.eq_objtype[e] == _OBJ.mjOBJ_SITE:
                pair = (int(m.site_bodyid[first]), int(m.site_bodyid[second]))
            acts = not chain.removed & set(pair) and chain.link(pair[0]) != chain.link(pair[1])
            name = name or f"{body_name(m, pair[0])} to {body_name(m, pair[1])}"
            follower = -1
        else:
            acts, follower = True, -1
        if acts and m.eq_active0[e] and not off:
            acting.append(name or f"equality {e}")
            weld += [joint_name(m, follower)] if follower >= 0 else []
        else:
            idle.append(name or f"equality {e}")
    if idle:
        text = "they hold no joint that is kept, or are switched off"
        chain.findings.append(Part("dropped", "equality constraints", tuple(idle), text))
    if acting and "equalities" in options.drop:
        _optional(chain, options, "equalities", "equality constraints", tuple(acting))
    elif acting:
        what = f"--fix {','.join(weld)} welds the joints that follow, " if weld else ""
        flags = ("--fix", ",".join(weld)) if len(weld) == len(acting) else ("--drop", "equalities")
        text = f"they couple kept joints: {what}--drop equalities leaves them out"
        chain.findings.append(Part("refused", "equality constraints", tuple(acting), text, flags))


def _gravity(chain: Chain, options: Options) -> Array:
    """Return gravity, smaller by what the file compensates on every link alike."""
    m = chain.model
    off = bool(m.opt.disableflags & _OFF.mjDSBL_GRAVITY)
    gravity: Array = np.zeros(3) if off else np.array(m.opt.gravity)
    here = [b for b in range(1, m.nbody) if m.body_gravcomp[b] and b not in chain.removed and chain.link(b)]
    places = tuple(body_name(m, b) for b in here)
    if not here or not np.any(gravity):
        return gravity
    if "gravcomp" in options.drop:
        text = "left out by --drop gravcomp: the law carries the arm's whole weight"
        chain.findings.append(Part("dropped", "gravity compensation", places, text))
        return gravity
    random, whole, carried = np.random.default_rng(0), list[Array](), list[Array]()
    for _ in range(_STATES):
        d = chain.at(random.uniform(-np.pi, np.pi, len(chain.joints)))
        for gravcomp, weights in ((0.0, whole), (m.body_gravcomp, carried)):
            force = np.zeros(m.nv)
            for b in range(1, m.nbody):
                if b not in chain.removed:
                    share = gravcomp if isinstance(gravcomp, float) else float(gravcomp[b])
                    jacobian = np.zeros((3, m.nv))
                    mujoco.mj_jac(m, d, jacobian, None, d.xipos[b], b)
                    force -= jacobian.T @ gravity * float(m.body_mass[b]) * (1.0 - share)
            weights.append(force[chain.dofs])
    full, left = np.array(whole), np.array(carried)
    scale = float(np.sum(full * left) / np.sum(full * full)) if np.any(full) else 1.0
    rounded = float(f"{scale:.12g}") if abs(scale) > _SAME else 0.0
    if np.max(np.abs(left - rounded * full)) > _SAME * max(float(np.max(np.abs(full))), 1e-300):
        text = "not the same on all links; --drop gravcomp leaves it out, so that the law carries the whole weight"
        chain.findings.append(Part("refused", "gravity compensation", places, text, ("--drop", "gravcomp")))
        return gravity
    text = f"gravity times {rounded:g}; --drop gravcomp would give the arm its weight back"
    chain.findings.append(Part("mapped", "gravity compensation", places, text))
    return rounded * gravity


def _torque_limits(chain: Chain, options: Options, names: Sequence[str]) -> tuple[Array, Array]:
    """Return the torque limits of the kept joints, NaN where nothing states one, and which of them were given."""
    m, n = chain.model, len(chain.joints)
    total, told = np.zeros(n), dict[str, list[str]]()
    skewed, idle, others = list[str](), list[str](), list[str]()
    for a in range(m.nu):
        name = name_of(m, _OBJ.mjOBJ_ACTUATOR, a)
        if int(m.actuator_trntype[a]) not in ON_JOINT:
            others.append(name)
            continue
        joint = int(m.actuator_trnid[a, 0])
        if joint not in chain.joints:
            idle.append(name)
            continue
        i = chain.joints.index(joint)
        limit, kind = _actuator_limit(m, a, skewed)
        total[i] += abs(float(m.actuator_gear[a, 0])) * limit
        told.setdefault(kind, []).append(name)
    limits = np.where(total > 0, total, np.inf)
    own = list[str]()
    for i, j in enumerate(chain.joints):
        if m.jnt_actfrclimited[j]:
            low, high = (float(x) for x in m.jnt_actfrcrange[j])
            if min(-low, high) > 0:
                if -low != high:
                    skewed.append(names[i])
                if min(-low, high) < limits[i]:
                    own.append(names[i])
                limits[i] = min(limits[i], -low, high)
    limits[~np.isfinite(limits)] = np.nan
    add = chain.findings.append
    for kind, which in told.items():
        add(Part("mapped", kind, tuple(which), "a motor: the law's torque in place of the file's own control"))
    if own:
        add(Part("mapped", "actuatorfrcrange, effort", tuple(own), "torque limit"))
    if skewed:
        add(Part("mapped", "force ranges that are not symmetric", tuple(dict.fromkeys(skewed)), "the smaller side"))
    if idle:
        add(Part("dropped", "actuators", tuple(idle), "they drive no joint that is kept"))
    if others:
        add(Part("dropped", "actuators", tuple(others), "they act on no single joint"))
    given = options.torque_limits
    if isinstance(given, Mapping):
        for name in given:
            if name not in names:
                reason = f"no kept joint is called so{did_you_mean(name, names)}"
                add(Part("refused", "--torque-limits", (name,), reason))
        table = np.array([given.get(name, np.nan) for name in names])
    elif given and len(given) != n:
        add(Part("refused", "--torque-limits", tuple(names), f"{len(given)} numbers for {n} joints"))
        return limits, np.zeros(n, dtype=bool)
    else:
        table = np.array(given) if given else np.full(n, np.nan)
    asked = np.array([name in given for name in names]) if isinstance(given, Mapping) else np.full(n, bool(given))
    wrong = asked & ~(np.isfinite(table) & (table > 0))
    if np.any(wrong):
        add(Part("refused", "--torque-limits", _where(names, wrong), "wanted finite numbers above zero"))
    if np.any(asked):
        stated = asked & ~np.isnan(limits)
        if np.any(stated):
            add(Part("mapped", "--torque-limits", _where(names, stated), "in place of the file's"))
        if np.any(only := asked & np.isnan(limits)):
            add(Part("mapped", "--torque-limits", _where(names, only), "given: the file states none"))
    limits = np.where(asked, table, limits)
    if not np.all(np.isnan(limits)):
        some = ~np.isnan(limits)
        slides = [int(m.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE) for j in chain.joints]
        unit = "N" if all(slides) else "N m, N for slides" if any(slides) else "N m"
        text = " ".join(f"{x:g}" for x in limits[some]) + f" {unit}"
        add(Part("mapped", LIMITS, _where(names, some), text))
    if np.any(np.isnan(limits)):
        text = f"the file states none; --torque-limits takes {n} numbers [N m], or NAME=NUMBER of these joints alone"
        add(Part("refused", LIMITS, _where(names, np.isnan(limits)), text))
    return limits, asked


def _actuator_limit(m: Any, a: int, skewed: list[str]) -> tuple[float, str]:
    """Return an actuator's largest force on either side, infinite where none is stated, and its kind."""
    fixed = m.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
    motor = bool(fixed and m.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE)
    plain = motor and m.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_NONE
    limit = np.inf
    ranges = []
    if m.actuator_forcelimited[a]:
        ranges.append((1.0, m.actuator_forcerange[a]))
    if motor:
        gain = abs(float(m.actuator_gainprm[a, 0]))
        if m.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_INTEGRATOR:
            if m.actuator_actlimited[a]:
                ranges.append((gain, m.actuator_actrange[a]))
        elif m.actuator_ctrllimited[a] and not m.opt.disableflags & _OFF.mjDSBL_CLAMPCTRL:
            ranges.append((gain, m.actuator_ctrlrange[m.actuator_ctrladr[a]]))
    for gain, (low, high) in ranges:
        if min(-low, high) > 0:
            if -low != high:
                skewed.append(name_of(m, _OBJ.mjOBJ_ACTUATOR, a))
            limit = min(limit, gain * min(-low, high))
    return float(limit), "motors" if plain else "motors with a lag" if motor else "servo actuators"
