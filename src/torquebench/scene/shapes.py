"""Triangles of boxes, cylinders, capsules and ellipsoids about their own origin, with normals for smooth shading."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torquebench.kernel import Array

SIDES = 24
"""Corners of a circle."""
BANDS = 5
"""Rings between equator and pole of a ball."""


class Triangles(NamedTuple):
    """A closed surface, corners counterclockwise seen from outside."""

    corners: Array
    """(T, 3, 3) [m]: triangle, corner, coordinate."""
    normals: Array
    """(T, 3, 3), outward unit vectors at the corners."""


def spun(profile: Array) -> Triangles:
    """Return the surface of revolution of a profile about the z axis.

    Args:
        profile: Points from the lower pole to the upper, (P, 4): distance from the axis, height, and the outward
            normal's components in these directions. At a crease a point is given twice, with two normals.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    spoke = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    spoke[-1] = spoke[0]  # so that it closes without a gap
    rings = np.concatenate([profile[:, None, :1] * spoke, np.repeat(profile[:, None, 1:2], SIDES + 1, axis=1)], axis=2)
    normal = np.concatenate([profile[:, None, 2:3] * spoke, np.repeat(profile[:, None, 3:], SIDES + 1, axis=1)], axis=2)

    def faces(x: Array) -> Array:
        a, b, c, d = x[:-1, :-1], x[:-1, 1:], x[1:, 1:], x[1:, :-1]
        return np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)

    corners, normals = faces(rings), faces(normal)
    solid = np.linalg.norm(areas(corners), axis=1) > 1e-12 * np.max(np.abs(profile[:, :2])) ** 2
    return Triangles(corners[solid], normals[solid])


def areas(corners: Array) -> Array:
    """Return each triangle's normal times its area, (T, 3) [m^2]."""
    product: Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return 0.5 * product


def _half_ball(radius: float, up: float, centre: float) -> Array:
    """Return the profile of half a ball from equator to pole (`up` = 1), or from pole to equator (-1)."""
    rise = np.linspace(0.0, np.pi / 2.0, BANDS + 1)
    points = np.stack([np.cos(rise), up * np.sin(rise)], axis=1)
    profile = np.concatenate([radius * points + [0.0, centre], points], axis=1)
    return profile if up > 0 else profile[::-1]


def capsule(radius: float, half: float) -> Triangles:
    """Return a capsule along z whose cylinder is 2 `half` long; a ball if `half` is zero."""
    return spun(np.concatenate([_half_ball(radius, -1.0, -half), _half_ball(radius, 1.0, half)]))


def cylinder(radius: float, half: float) -> Triangles:
    """Return a cylinder along z, 2 `half` long."""
    return spun(
        np.array(
            [
                [0, -half, 0, -1],
                [radius, -half, 0, -1],
                [radius, -half, 1, 0],
                [radius, half, 1, 0],
                [radius, half, 0, 1],
                [0, half, 0, 1],
            ],
            dtype=np.float64,
        )
    )


def ellipsoid(semi_axes: Array) -> Triangles:
    """Return an ellipsoid with semi-axes (3,) [m]."""
    ball = capsule(1.0, 0.0)
    normals = ball.normals / semi_axes
    return Triangles(ball.corners * semi_axes, normals / np.linalg.norm(normals, axis=2, keepdims=True))


def box(half: Array) -> Triangles:
    """Return a box with half edges (3,) [m]."""
    corners = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3] * sign
            middle = sign * np.eye(3)[axis]
            a, b, c, d = middle - u - v, middle + u - v, middle + u + v, middle - u + v
            corners += [[a, b, c], [a, c, d]]
    return flat(np.array(corners) * half)


def flat(corners: Array) -> Triangles:
    """Return a surface of flat faces, without triangles of zero area."""
    normal = areas(corners)
    size = np.linalg.norm(normal, axis=1)
    solid = size > 0.0
    unit = normal[solid] / size[solid, None]
    return Triangles(corners[solid], np.repeat(unit[:, None, :], 3, axis=1))
