"""The 34 constants of Tables 3 and 4: as printed, and as the fitted arm realises them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.flat_model import Model
from torquebench.robot.links import read_yaml
from torquebench.robot.puma560.symbols import CONSTANTS


class Table(NamedTuple):
    """Tables 3 and 4 as printed, in the order of `CONSTANTS`."""

    value: Array
    """Printed values, (34,) [kg m^2, N m]."""
    tolerance: Array
    """Printed tolerances, (34,)."""


class Geometry(NamedTuple):
    """Lengths of Table 2 that enter the constants [m]; a3 carries the sign of the dynamics."""

    a2: float
    a3: float
    d2: float
    d4: float
    d6: float


def read_constants(path: Path) -> tuple[Table, Geometry]:
    """Read ``constants.yaml``.

    Raises:
        ModelError: the file cannot be read or lacks a constant.
    """
    try:
        data: Any = read_yaml(path)
        entries = data["inertial"] | data["motor"] | data["gravitational"]
        rows = {row["joint"]: row for row in data["dh"]["rows"]}
        table = Table(
            np.array([float(entries[name]["value"]) for name in CONSTANTS]),
            np.array([float(entries[name]["tolerance"]) for name in CONSTANTS]),
        )
        geometry = Geometry(rows[2]["a_used"], rows[3]["a_used"], rows[2]["d"], rows[4]["d"], rows[6]["d"])
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path}: not a valid constants file ({type(error).__name__}: {error})") from error
    return table, geometry


class Body(NamedTuple):
    """Inertial parameters of one link about its frame's origin (a linear parametrisation)."""

    m: Any
    hx: Any
    hy: Any
    hz: Any
    xx: Any
    yy: Any
    zz: Any
    xy: Any
    xz: Any
    yz: Any


def link_constants(bodies: list[Body], geometry: Geometry, g: float) -> Array:
    """Return I1..I23 and g1..g5, (28,), of an arm with these six links: linear in the links' parameters.

    Armstrong, Khatib and Burdick (1986), written out for links with products of inertia; link frames are those
    of ``links.yaml`` (modified Denavit-Hartenberg). Motor inertias are not part of it.

    Args:
        bodies: Links 1..6.
        geometry: Lengths [m].
        g: Magnitude of gravity [m/s^2].
    """
    one, two, three, four, five, six = bodies
    a2, a3, d, d4, _ = geometry
    wrist = four.m + five.m + six.m
    outer = three.m + wrist
    mu = six.hz - five.hy
    return np.array(
        [
            one.zz
            + d * d * two.m
            + 2 * d * two.hz
            + two.xx
            + d * d * three.m
            + 2 * d * three.hz
            + three.yy
            + (a3 * a3 + d * d) * wrist
            + four.zz
            + five.yy
            + six.zz,
            two.zz + a2 * a2 * outer,
            two.yy - two.xx + a2 * a2 * outer,
            d * two.hx - two.xz + a2 * d * outer + a2 * three.hz,
            a2 * (-three.hy + d4 * wrist + four.hz),
            three.zz + (a3 * a3 + d4 * d4) * wrist + 2 * d4 * four.hz + four.yy + five.zz + six.xx,
            three.xx
            - three.yy
            + (d4 * d4 - a3 * a3) * wrist
            + 2 * d4 * four.hz
            + four.yy
            - four.zz
            + five.zz
            - five.yy
            + six.xx
            - six.zz,
            d * three.hy - three.yz - d * d4 * wrist - d * four.hz,
            d * two.hy - two.yz,
            2 * three.xy + 2 * a3 * d4 * wrist + 2 * a3 * four.hz,
            2 * two.xy,
            a2 * (three.hx + a3 * wrist),
            d * three.hx - three.xz + a3 * d * wrist,
            four.zz + five.yy + six.zz,
            d4 * mu,
            a2 * mu,
            five.zz + six.xx,
            d * mu,
            four.yy - four.xx + five.zz - five.yy + six.xx - six.zz,
            five.yy - five.xx - six.xx + six.zz,
            four.xx - four.yy + five.xx - five.zz,
            a3 * mu,
            six.zz,
            -g * (two.hx + a2 * outer),
            g * (three.hy - d4 * wrist - four.hz),
            g * two.hy,
            -g * (three.hx + a3 * wrist),
            -g * mu,
        ]
    )


def fitted_constants(model: Model, geometry: Geometry) -> Array:
    """Return the 34 constants that the links of `model` realise, in the order of `CONSTANTS`.

    Args:
        model: The EXACT model read from ``links.yaml``.
        geometry: Lengths of Table 2 [m].
    """
    bodies = []
    for i in range(6):
        m, c, J = model.mass[i], model.com[i], model.inertia[i]
        about_origin = J + m * (np.dot(c, c) * np.eye(3) - np.outer(c, c))
        xx, yy, zz = np.diag(about_origin)
        xy, xz, yz = about_origin[0, 1], about_origin[0, 2], about_origin[1, 2]
        bodies.append(Body(m, m * c[0], m * c[1], m * c[2], xx, yy, zz, xy, xz, yz))
    rigid = link_constants(bodies, geometry, float(-model.gravity[2]))
    return np.concatenate([rigid[:23], model.armature, rigid[23:]])
