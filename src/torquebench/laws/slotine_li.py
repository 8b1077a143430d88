"""Adaptive control of Slotine and Li: the law learns the inertias of the arm's links."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, get_args

from torquebench.kernel import Array, kernel
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Rate, Slope
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.robot.regressor import regress
from torquebench.tuning import as_much, learning, pole


class Gains(NamedTuple):
    """Gains of the law."""

    lam: Annotated[Array, get_args(Slope)[1]._replace(auto=pole)]
    kv: Rate
    gamma: Annotated[
        Array,
        Gain("rate gamma at which a link is learnt, zero for a model that stays", "1/J", False, auto=learning)._replace(
            search=(1e-3, 10.0, "log")
        ),
    ]
    bound: Annotated[
        Array,
        Gain("most that may be learnt of a link, in mean links", "1", auto=as_much, search=(0.1, 10.0, "log")),
    ]


class Memory(NamedTuple):
    """The sliding variable, and what was learnt of each link beyond the model.

    Mass [kg], first moment about the link's frame [kg m], inertia about it [kg m^2], the rotor's inertia [kg m^2].
    """

    s: Array
    mass: Array
    moment_x: Array
    moment_y: Array
    moment_z: Array
    inertia_xx: Array
    inertia_yy: Array
    inertia_zz: Array
    inertia_xy: Array
    inertia_xz: Array
    inertia_yz: Array
    rotor: Array


@kernel
def learn(learnt: Array, i: int, step: float, bound: float, model: float) -> None:
    """Add a step to what was learnt of a number, within a bound and, with what the model has of it, not below zero.

    Args:
        learnt: What was learnt of each link, (n,); written.
        i: Which link.
        step: What is added.
        bound: Largest size of the sum.
        model: What the model has; infinity for a number that may be negative.
    """
    least = -bound if bound < model else -model
    value = learnt[i] + step
    learnt[i] = bound if value > bound else least if value < least else value


@controller("slotine-li", gains=Gains, memory=Memory, rigid_only=True)
def slotine_li(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: Memory, tau: Array
) -> None:
    """Slotine and Li's adaptive law: tau = M^ qddr + C^ qdr + g^ + Kd s, da/dt = Gamma Y' s, with s = de + lambda e.

    qdr = qd_ref + lambda e = qd + s, Kd = kV Mbar, and Y a = M^ qddr + C^ qdr + g^ for the inertias a of M^, C^ and g^.
    Slotine and Li, International Journal of Robotics Research 6(3) (1987), 49. On a rigid body with inertias a*
    V = (s' M s + (a - a*)' Gamma^-1 (a - a*)) / 2 falls by s' Kd s. All eleven numbers of every link adapt: mass, first
    moment, inertia, rotor. Gamma = gamma a0^2, a0 the size of each number in a mean link of mass m0 and radius of
    gyration l0: m0, m0 l0, m0 l0^2, and Mbar for a rotor.

    Each number stays within `bound` a0 of the model's and no mass, moment of inertia or rotor below zero: a projection,
    which V bears (Ioannou and Sun, Robust Adaptive Control, 1996). Nothing is learnt while any joint is beyond its
    limit. What the inertias cannot be (friction, noise, lag) is learnt all the same: inertias drift up to their bounds,
    and a motion without variety leaves them wrong where it does not matter. Only structure `exact` has links.
    """
    n, bodies = len(tau), model.scratch.composite
    mass, spread = 0.0, 0.0
    for i in range(n):
        own = model.about_origin[i]
        mass += own[0]
        spread += 0.5 * (own[4] + own[5] + own[6])
        memory.s[i] = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        model.scratch.free[i] = ref.qdd[i] + gains.lam[i] * (ref.qd[i] - qd[i])
        bodies[i, 0] = own[0] + memory.mass[i]
        bodies[i, 1] = own[1] + memory.moment_x[i]
        bodies[i, 2] = own[2] + memory.moment_y[i]
        bodies[i, 3] = own[3] + memory.moment_z[i]
        bodies[i, 4] = own[4] + memory.inertia_xx[i]
        bodies[i, 5] = own[5] + memory.inertia_yy[i]
        bodies[i, 6] = own[6] + memory.inertia_zz[i]
        bodies[i, 7] = own[7] + memory.inertia_xy[i]
        bodies[i, 8] = own[8] + memory.inertia_xz[i]
        bodies[i, 9] = own[9] + memory.inertia_yz[i]
    regress(model, q, qd, memory.s, model.scratch.free, bodies, tau, bodies)
    frozen = False
    for i in range(n):
        rotor = (model.armature[i] + memory.rotor[i]) * model.scratch.free[i]
        tau[i] += rotor + gains.kv[i] * model.inertia_scale[i] * memory.s[i]
        frozen = frozen or abs(tau[i]) > model.tau_max[i]
    if frozen:
        return
    m0 = mass / n
    l0 = math.sqrt(spread / mass) if mass > 0.0 else 0.0
    j0 = m0 * l0 * l0
    for i in range(n):
        own, slopes, bound = model.about_origin[i], bodies[i], gains.bound[i]
        step, scale = model.control_period * gains.gamma[i], model.inertia_scale[i]
        learn(memory.mass, i, step * m0 * m0 * slopes[0], bound * m0, own[0])
        learn(memory.moment_x, i, step * m0 * j0 * slopes[1], bound * m0 * l0, math.inf)
        learn(memory.moment_y, i, step * m0 * j0 * slopes[2], bound * m0 * l0, math.inf)
        learn(memory.moment_z, i, step * m0 * j0 * slopes[3], bound * m0 * l0, math.inf)
        learn(memory.inertia_xx, i, step * j0 * j0 * slopes[4], bound * j0, own[4])
        learn(memory.inertia_yy, i, step * j0 * j0 * slopes[5], bound * j0, own[5])
        learn(memory.inertia_zz, i, step * j0 * j0 * slopes[6], bound * j0, own[6])
        learn(memory.inertia_xy, i, step * j0 * j0 * slopes[7], bound * j0, math.inf)
        learn(memory.inertia_xz, i, step * j0 * j0 * slopes[8], bound * j0, math.inf)
        learn(memory.inertia_yz, i, step * j0 * j0 * slopes[9], bound * j0, math.inf)
        turn = scale * scale * model.scratch.free[i] * memory.s[i]
        learn(memory.rotor, i, step * turn, bound * scale, model.armature[i])
