"""Inverse dynamics as a linear function of the links' inertias: what adaptive laws compute and learn with.

With Y the regressor of Slotine and Li, Y a = M(q) qddr + C(q, qd) qdr + g(q) for ten numbers a of each link. Y is never
formed: one pass over the links gives Y a and Y' (qdr - qd). Each link adds the spatial force

    f = I a_r + v_r x* (I v),

with v and v_r its spatial velocities under qd and qdr and a_r the rate of v_r. The second term is v x* (I v) for qdr =
qd, and linear in v_r by a skew-symmetric matrix, x' (x x* h) = 0, so that dM/dt = C + C' as the proof of Slotine and Li
needs it. Spatial vectors as by Featherstone (2008), in link frames.
"""

from __future__ import annotations

from torquebench.kernel import Array, kernel
from torquebench.robot.flat_model import HINGE, Model
from torquebench.robot.rigid_body import place_frames, rotate


@kernel
def into_child(
    R: Array, p: Array, wx: float, wy: float, wz: float, lx: float, ly: float, lz: float
) -> tuple[float, float, float, float, float, float]:
    """Return a motion of a parent frame as that of a frame at pose (R, p) that is fixed to it.

    Args:
        R, p: Orientation (3, 3) and origin (3,) [m] of the child frame in the parent's.
        wx, wy, wz: Angular velocity in the parent frame [rad/s].
        lx, ly, lz: Velocity of the parent frame's origin [m/s].
    """
    lx, ly, lz = lx + wy * p[2] - wz * p[1], ly + wz * p[0] - wx * p[2], lz + wx * p[1] - wy * p[0]
    return (
        R[0, 0] * wx + R[1, 0] * wy + R[2, 0] * wz,
        R[0, 1] * wx + R[1, 1] * wy + R[2, 1] * wz,
        R[0, 2] * wx + R[1, 2] * wy + R[2, 2] * wz,
        R[0, 0] * lx + R[1, 0] * ly + R[2, 0] * lz,
        R[0, 1] * lx + R[1, 1] * ly + R[2, 1] * lz,
        R[0, 2] * lx + R[1, 2] * ly + R[2, 2] * lz,
    )


@kernel
def momentum_of(
    b: Array, wx: float, wy: float, wz: float, lx: float, ly: float, lz: float
) -> tuple[float, float, float, float, float, float]:
    """Return the momentum I v of a body, angular and linear.

    Args:
        b: The body, (10,), as in `Model.about_origin`.
        wx, wy, wz: Its angular velocity [rad/s].
        lx, ly, lz: Velocity of its frame's origin [m/s].
    """
    return (
        b[4] * wx + b[7] * wy + b[8] * wz + b[2] * lz - b[3] * ly,
        b[7] * wx + b[5] * wy + b[9] * wz + b[3] * lx - b[1] * lz,
        b[8] * wx + b[9] * wy + b[6] * wz + b[1] * ly - b[2] * lx,
        b[0] * lx + wy * b[3] - wz * b[2],
        b[0] * ly + wz * b[1] - wx * b[3],
        b[0] * lz + wx * b[2] - wy * b[1],
    )


@kernel
def generalized_momentum(model: Model, q: Array, qd: Array, p: Array, turning: Array) -> None:
    """Fill `p` (n,) with M(q) qd and `turning` (n,) with C(q, qd)' qd, the derivative of qd' M(q) qd / 2 by q.

    Both come of the composite momentum h of the links from i outwards: p_i = S_i' h and C' qd = (v_i x S_i)' h, with
    S_i the axis of joint i and v_i the spatial velocity of its link.

    Args:
        model: An EXACT model.
        q, qd: Position [rad] and velocity [rad/s], (n,).
        p, turning: Results [N m s], [N m].
    """
    n, kind = len(q), model.kind
    place_frames(model, q)
    rotation, offset = model.scratch.rotation, model.scratch.offset
    force, moment = model.scratch.force, model.scratch.moment
    velocity = model.scratch.composite
    wx = wy = wz = lx = ly = lz = 0.0
    for i in range(n):
        wx, wy, wz, lx, ly, lz = into_child(rotation[i], offset[i], wx, wy, wz, lx, ly, lz)
        if kind[i] == HINGE:
            wz += qd[i]
        else:
            lz += qd[i]
        velocity[i, 0], velocity[i, 1], velocity[i, 2], velocity[i, 3] = wx, wy, lx, ly
        moment[i, 0], moment[i, 1], moment[i, 2], force[i, 0], force[i, 1], force[i, 2] = momentum_of(
            model.about_origin[i], wx, wy, wz, lx, ly, lz
        )
    for k in range(n):
        i = n - 1 - k
        v, F, L = velocity[i], force[i], moment[i]
        if kind[i] == HINGE:
            p[i] = L[2] + model.armature[i] * qd[i]
            turning[i] = v[1] * L[0] - v[0] * L[1] + v[3] * F[0] - v[2] * F[1]
        else:
            p[i] = F[2] + model.armature[i] * qd[i]
            turning[i] = v[1] * F[0] - v[0] * F[1]
        if i > 0:
            to_parent(model, i)


@kernel
def to_parent(model: Model, i: int) -> None:
    """Add force and moment of link i in the scratch space to those of the link before it."""
    R, p, force, moment = model.scratch.rotation[i], model.scratch.offset[i], model.scratch.force, model.scratch.moment
    fx, fy, fz = rotate(R, force[i, 0], force[i, 1], force[i, 2])
    tx, ty, tz = rotate(R, moment[i, 0], moment[i, 1], moment[i, 2])
    force[i - 1, 0] += fx
    force[i - 1, 1] += fy
    force[i - 1, 2] += fz
    moment[i - 1, 0] += tx + p[1] * fz - p[2] * fy
    moment[i - 1, 1] += ty + p[2] * fx - p[0] * fz
    moment[i - 1, 2] += tz + p[0] * fy - p[1] * fx


@kernel
def add_slopes(
    side: float,
    aw: float, bw: float, cw: float, al: float, bl: float, cl: float,
    xw: float, yw: float, zw: float, xl: float, yl: float, zl: float,
    slopes: Array,
) -> None:  # fmt: skip
    """Add to `slopes` (10,) the derivatives of side x' I y by the numbers of I, as in `Model.about_origin`.

    Args:
        side: A factor.
        aw, bw, cw, al, bl, cl: The motion x, angular and linear.
        xw, yw, zw, xl, yl, zl: The motion y.
        slopes: Result.
    """
    slopes[0] += side * (al * xl + bl * yl + cl * zl)
    slopes[1] += side * (yl * cw - zl * bw + bl * zw - cl * yw)
    slopes[2] += side * (zl * aw - xl * cw + cl * xw - al * zw)
    slopes[3] += side * (xl * bw - yl * aw + al * yw - bl * xw)
    slopes[4] += side * aw * xw
    slopes[5] += side * bw * yw
    slopes[6] += side * cw * zw
    slopes[7] += side * (aw * yw + bw * xw)
    slopes[8] += side * (aw * zw + cw * xw)
    slopes[9] += side * (bw * zw + cw * yw)


@kernel
def regress(model: Model, q: Array, qd: Array, s: Array, qddr: Array, bodies: Array, tau: Array, slopes: Array) -> None:
    """Fill `tau` with Y a and `slopes` with Y' s, Y = Y(q, qd, qdr, qddr), qdr = qd + s; see the module.

    Rotors are not among the numbers a: armature_i qddr_i and qddr_i s_i are to be added.

    Args:
        model: An EXACT model; of its links only kinds of joints, geometry and gravity are used.
        q, qd: Position [rad] and velocity [rad/s], (n,).
        s: What the reference velocity qdr is beyond `qd`, (n,) [rad/s].
        qddr: Reference acceleration, (n,) [rad/s^2].
        bodies: The numbers a of each link, as `Model.about_origin`, (n, 10).
        tau: Result, (n,) [N m].
        slopes: Result, (n, 10); may be the array `bodies`.
    """
    n, kind = len(q), model.kind
    place_frames(model, q)
    rotation, offset = model.scratch.rotation, model.scratch.offset
    force, moment = model.scratch.force, model.scratch.moment
    wx = wy = wz = lx = ly = lz = 0.0  # velocity of frame i under qd, in its own axes
    rx = ry = rz = kx = ky = kz = 0.0  # under qdr
    ax = ay = az = 0.0  # rate of the latter
    bx, by, bz = -model.gravity[0], -model.gravity[1], -model.gravity[2]
    for i in range(n):
        R, p = rotation[i], offset[i]
        wx, wy, wz, lx, ly, lz = into_child(R, p, wx, wy, wz, lx, ly, lz)
        rx, ry, rz, kx, ky, kz = into_child(R, p, rx, ry, rz, kx, ky, kz)
        ax, ay, az, bx, by, bz = into_child(R, p, ax, ay, az, bx, by, bz)
        if kind[i] == HINGE:
            ax += qd[i] * ry
            ay -= qd[i] * rx
            bx += qd[i] * ky
            by -= qd[i] * kx
            az += qddr[i]
            wz += qd[i]
            rz += qd[i] + s[i]
        else:
            bx += qd[i] * ry
            by -= qd[i] * rx
            bz += qddr[i]
            lz += qd[i]
            kz += qd[i] + s[i]
        Lx, Ly, Lz, Px, Py, Pz = momentum_of(bodies[i], wx, wy, wz, lx, ly, lz)
        tx, ty, tz, fx, fy, fz = momentum_of(bodies[i], ax, ay, az, bx, by, bz)
        force[i, 0], force[i, 1], force[i, 2] = fx + ry * Pz - rz * Py, fy + rz * Px - rx * Pz, fz + rx * Py - ry * Px
        moment[i, 0] = tx + ry * Lz - rz * Ly + ky * Pz - kz * Py
        moment[i, 1] = ty + rz * Lx - rx * Lz + kz * Px - kx * Pz
        moment[i, 2] = tz + rx * Ly - ry * Lx + kx * Py - ky * Px
        # (v_r - v)' (I a_r + v_r x* (I v)) = (v_r - v)' I a_r - (v x v_r)' I v
        for c in range(10):
            slopes[i, c] = 0.0
        add_slopes(1.0, rx - wx, ry - wy, rz - wz, kx - lx, ky - ly, kz - lz, ax, ay, az, bx, by, bz, slopes[i])
        ux, uy, uz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
        gx, gy = wy * kz - wz * ky + ly * rz - lz * ry, wz * kx - wx * kz + lz * rx - lx * rz
        gz = wx * ky - wy * kx + lx * ry - ly * rx
        add_slopes(-1.0, ux, uy, uz, gx, gy, gz, wx, wy, wz, lx, ly, lz, slopes[i])
    for k in range(n):
        i = n - 1 - k
        tau[i] = moment[i, 2] if kind[i] == HINGE else force[i, 2]
        if i > 0:
            to_parent(model, i)
