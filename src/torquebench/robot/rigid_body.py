r"""Rigid-body dynamics of a serial arm: recursive Newton-Euler and composite inertias, in link frames.

Newton-Euler after Luh, Walker and Paul (1980); composite rigid bodies after Walker and Orin (1982). Frame i has
its z axis along joint i. Nothing here knows MuJoCo, nor how many joints there are.
"""

from __future__ import annotations

import math

from torquebench.kernel import Array, kernel
from torquebench.robot.flat_model import HINGE, Model


@kernel
def place_frames(model: Model, q: Array) -> None:
    """Write the pose of each frame in the previous one, at joint position `q` (n,), into the scratch space."""
    kind, fixed_rotation, fixed_offset = model.kind, model.rotation, model.offset
    moved_rotation, moved_offset = model.scratch.rotation, model.scratch.offset
    for i in range(len(q)):
        fixed, rotation, offset = fixed_rotation[i], moved_rotation[i], moved_offset[i]
        c, s, z = 1.0, 0.0, q[i]
        if kind[i] == HINGE:
            c, s, z = math.cos(q[i]), math.sin(q[i]), 0.0
        for r in range(3):
            rotation[r, 0] = fixed[r, 0] * c + fixed[r, 1] * s
            rotation[r, 1] = fixed[r, 1] * c - fixed[r, 0] * s
            rotation[r, 2] = fixed[r, 2]
            offset[r] = fixed_offset[i, r] + fixed[r, 2] * z


@kernel
def newton_euler(model: Model, qd: Array, qdd: Array, gravity: float, tau: Array) -> None:
    """Fill `tau` with M(q) qdd + C(q, qd) qd + gravity * g(q), armature included; frames are already placed.

    Args:
        model: An EXACT model.
        qd, qdd: Joint velocity [rad/s] and acceleration [rad/s^2], (n,).
        gravity: 1 to include gravity, 0 to leave it out.
        tau: Result, (n,) [N m].
    """
    n = len(qd)
    kind, mass, com, inertia, armature = model.kind, model.mass, model.com, model.inertia, model.armature
    rotation, offset = model.scratch.rotation, model.scratch.offset
    force, moment = model.scratch.force, model.scratch.moment
    wx = wy = wz = 0.0  # angular velocity of frame i, in its own axes
    ax = ay = az = 0.0  # angular acceleration
    lx = -gravity * model.gravity[0]  # linear acceleration of the origin; gravity enters as the base accelerating
    ly = -gravity * model.gravity[1]
    lz = -gravity * model.gravity[2]
    for i in range(n):
        R, p = rotation[i], offset[i]
        # a_origin = a_parent + alpha x p + w x (w x p), in the parent's axes
        ux, uy, uz = wy * p[2] - wz * p[1], wz * p[0] - wx * p[2], wx * p[1] - wy * p[0]
        tx = lx + ay * p[2] - az * p[1] + wy * uz - wz * uy
        ty = ly + az * p[0] - ax * p[2] + wz * ux - wx * uz
        tz = lz + ax * p[1] - ay * p[0] + wx * uy - wy * ux
        lx = R[0, 0] * tx + R[1, 0] * ty + R[2, 0] * tz
        ly = R[0, 1] * tx + R[1, 1] * ty + R[2, 1] * tz
        lz = R[0, 2] * tx + R[1, 2] * ty + R[2, 2] * tz
        tx, ty, tz = ax, ay, az
        ax = R[0, 0] * tx + R[1, 0] * ty + R[2, 0] * tz
        ay = R[0, 1] * tx + R[1, 1] * ty + R[2, 1] * tz
        az = R[0, 2] * tx + R[1, 2] * ty + R[2, 2] * tz
        tx, ty, tz = wx, wy, wz
        wx = R[0, 0] * tx + R[1, 0] * ty + R[2, 0] * tz
        wy = R[0, 1] * tx + R[1, 1] * ty + R[2, 1] * tz
        wz = R[0, 2] * tx + R[1, 2] * ty + R[2, 2] * tz
        if kind[i] == HINGE:
            ax += wy * qd[i]
            ay -= wx * qd[i]
            az += qdd[i]
            wz += qd[i]
        else:
            lx += 2.0 * wy * qd[i]
            ly -= 2.0 * wx * qd[i]
            lz += qdd[i]
        # centre of mass, then Newton and Euler
        c, J, m = com[i], inertia[i], mass[i]
        ux, uy, uz = wy * c[2] - wz * c[1], wz * c[0] - wx * c[2], wx * c[1] - wy * c[0]
        fx = m * (lx + ay * c[2] - az * c[1] + wy * uz - wz * uy)
        fy = m * (ly + az * c[0] - ax * c[2] + wz * ux - wx * uz)
        fz = m * (lz + ax * c[1] - ay * c[0] + wx * uy - wy * ux)
        hx = J[0, 0] * wx + J[0, 1] * wy + J[0, 2] * wz
        hy = J[1, 0] * wx + J[1, 1] * wy + J[1, 2] * wz
        hz = J[2, 0] * wx + J[2, 1] * wy + J[2, 2] * wz
        force[i, 0], force[i, 1], force[i, 2] = fx, fy, fz
        moment[i, 0] = J[0, 0] * ax + J[0, 1] * ay + J[0, 2] * az + wy * hz - wz * hy + c[1] * fz - c[2] * fy
        moment[i, 1] = J[1, 0] * ax + J[1, 1] * ay + J[1, 2] * az + wz * hx - wx * hz + c[2] * fx - c[0] * fz
        moment[i, 2] = J[2, 0] * ax + J[2, 1] * ay + J[2, 2] * az + wx * hy - wy * hx + c[0] * fy - c[1] * fx
    for k in range(n):
        i = n - 1 - k
        tau[i] = (moment[i, 2] if kind[i] == HINGE else force[i, 2]) + armature[i] * qdd[i]
        if i > 0:
            R, p = rotation[i], offset[i]
            fx, fy, fz = rotate(R, force[i, 0], force[i, 1], force[i, 2])
            tx, ty, tz = rotate(R, moment[i, 0], moment[i, 1], moment[i, 2])
            force[i - 1, 0] += fx
            force[i - 1, 1] += fy
            force[i - 1, 2] += fz
            moment[i - 1, 0] += tx + p[1] * fz - p[2] * fy
            moment[i - 1, 1] += ty + p[2] * fx - p[0] * fz
            moment[i - 1, 2] += tz + p[0] * fy - p[1] * fx


@kernel
def rotate(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R (x, y, z)."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel
def composite_mass_matrix(model: Model, M: Array) -> None:
    """Fill `M` (n, n) [kg m^2] with the mass matrix, armature included; frames are already placed.

    Composite k is (mass, first moment (3), inertia about the frame's origin xx yy zz xy xz yz) of links k..n-1.
    """
    n = len(model.mass)
    comp, about_origin = model.scratch.composite, model.about_origin
    rotation, offset, kind, armature = model.scratch.rotation, model.scratch.offset, model.kind, model.armature
    for i in range(n):
        for c in range(10):
            comp[i, c] = about_origin[i, c]
    for k in range(n):
        i = n - 1 - k
        m, hx, hy = comp[i, 0], comp[i, 1], comp[i, 2]
        # force and moment that accelerate the composite by one unit of joint i, in frame i
        if kind[i] == HINGE:
            fx, fy, fz = -hy, hx, 0.0
            tx, ty, tz = comp[i, 8], comp[i, 9], comp[i, 6]
            M[i, i] = tz + armature[i]
        else:
            fx, fy, fz = 0.0, 0.0, m
            tx, ty, tz = hy, -hx, 0.0
            M[i, i] = fz + armature[i]
        for back in range(i):
            j = i - 1 - back
            R, p = rotation[j + 1], offset[j + 1]
            fx, fy, fz = rotate(R, fx, fy, fz)
            tx, ty, tz = rotate(R, tx, ty, tz)
            tx += p[1] * fz - p[2] * fy
            ty += p[2] * fx - p[0] * fz
            tz += p[0] * fy - p[1] * fx
            M[j, i] = tz if kind[j] == HINGE else fz
            M[i, j] = M[j, i]
        if i > 0:
            add_to_parent(comp[i], rotation[i], offset[i], comp[i - 1])


@kernel
def add_to_parent(child: Array, R: Array, p: Array, parent: Array) -> None:
    """Add a composite body, given in a child frame with pose (R, p), to its parent's composite (10,)."""
    m = child[0]
    hx, hy, hz = rotate(R, child[1], child[2], child[3])
    # columns of R J, then J' = R J R^T
    ax, ay, az = rotate(R, child[4], child[7], child[8])
    bx, by, bz = rotate(R, child[7], child[5], child[9])
    cx, cy, cz = rotate(R, child[8], child[9], child[6])
    jxx, jxy, jxz = rotate(R, ax, bx, cx)
    _, jyy, jyz = rotate(R, ay, by, cy)
    _, _, jzz = rotate(R, az, bz, cz)
    # shift the reference point by p: J += m (p.p 1 - p p^T) + 2 (h.p) 1 - h p^T - p h^T
    x, y, z = p[0], p[1], p[2]
    parent[0] += m
    parent[1] += hx + m * x
    parent[2] += hy + m * y
    parent[3] += hz + m * z
    parent[4] += jxx + m * (y * y + z * z) + 2.0 * (hy * y + hz * z)
    parent[5] += jyy + m * (x * x + z * z) + 2.0 * (hx * x + hz * z)
    parent[6] += jzz + m * (x * x + y * y) + 2.0 * (hx * x + hy * y)
    parent[7] += jxy - m * x * y - hx * y - hy * x
    parent[8] += jxz - m * x * z - hx * z - hz * x
    parent[9] += jyz - m * y * z - hy * z - hz * y
