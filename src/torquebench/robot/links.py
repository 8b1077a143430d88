"""Reading ``links.yaml``: link frames, masses, inertias and motors of an arm, without MuJoCo."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot.flat_model import HINGE, SLIDE, Model, rigid_model

KINDS = {"hinge": HINGE, "slide": SLIDE}


def modified_dh(alpha: float, a: float, d: float) -> tuple[Array, Array]:
    """Return orientation (3, 3) and origin (3,) of frame i in frame i-1 at zero joint angle.

    Modified Denavit-Hartenberg (Craig): Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d), with the parameters
    alpha_{i-1} [rad], a_{i-1} [m], d_i [m].
    """
    c, s = math.cos(alpha), math.sin(alpha)
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return rotation, np.array([a, -s * d, c * d])


def inertia_tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric tensor (3, 3) with these elements; the products are tensor elements, sign included."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_yaml(path: Path) -> Any:
    """Return what a YAML file of an arm holds.

    Raises:
        OSError, UnicodeDecodeError, yaml.YAMLError: it cannot be read.
    """
    return yaml.load(path.read_text(encoding="utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def read_links(path: Path) -> Model:
    """Read a model from a ``links.yaml``.

    Args:
        path: File as written by ``scripts/fit_puma560.py``; ``models/puma560/README.md`` has its keys.

    Raises:
        ModelError: the file cannot be read, lacks a key, or has a mass or an inertia that no rigid body has.
    """
    try:
        data: Any = read_yaml(path)
        joints = data["joints"]
        frames = [modified_dh(*(float(j["dh"][key]) for key in ("alpha", "a", "d"))) for j in joints]
        tool_rotation, tool_offset = modified_dh(*(float(data["tool"][key]) for key in ("alpha", "a", "d")))
        model = rigid_model(
            kind=[KINDS[j["kind"]] for j in joints],
            rotation=np.array([rotation for rotation, _ in frames]),
            offset=np.array([offset for _, offset in frames]),
            mass=np.array([float(j["mass"]) for j in joints]),
            com=np.array([[float(x) for x in j["com"]] for j in joints]),
            inertia=np.array([inertia_tensor(*(float(x) for x in j["inertia"])) for j in joints]),
            armature=np.array([float(j["armature"]) for j in joints]),
            gravity=np.array([float(x) for x in data["gravity"]]),
            tool_rotation=tool_rotation,
            tool_offset=tool_offset,
            tau_max=np.array([float(j["tau_max"]) for j in joints]),
            inertia_scale=np.array([float(j["inertia_scale"]) for j in joints]),
        )
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path}: not a valid links file ({type(error).__name__}: {error})") from error
    check_physical(model, str(path))
    return model


def pseudo_inertia(mass: float, com: Array, inertia: Array) -> Array:
    """Return the pseudo-inertia (4, 4): positive definite exactly for a body with positive mass everywhere.

    [[tr(J)/2 1 - J, h], [h^T, m]] with J about the frame's origin and h = m com; Wensing, Kim and Slotine (2018).

    Args:
        mass: Mass [kg].
        com: Centre of mass, (3,) [m].
        inertia: Inertia about the centre of mass, (3, 3) [kg m^2].
    """
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia + mass * np.outer(com, com)
    h = mass * com
    return np.block([[second, h[:, None]], [h[None, :], np.array([[mass]])]])


def check_physical(model: Model, where: str) -> None:
    """Refuse numbers that no rigid body has.

    Raises:
        ModelError: a value is not finite, a mass or armature is negative, an inertia violates the triangle
            inequality, or a joint would move without any inertia.
    """
    for name in ("rotation", "offset", "mass", "com", "inertia", "armature", "gravity", "tau_max", "inertia_scale"):
        if not np.all(np.isfinite(getattr(model, name))):
            raise ModelError(f"{where}: {name} has values that are not finite")
    for i in range(len(model.mass)):
        if model.mass[i] < 0 or model.armature[i] < 0:
            raise ModelError(f"{where}: joint {i + 1}: mass and armature must not be negative")
        principal = np.linalg.eigvalsh(model.inertia[i])
        if principal[0] < -1e-12 or principal[0] + principal[1] < principal[2] * (1.0 - 1e-9):
            raise ModelError(
                f"{where}: joint {i + 1}: principal inertias {principal.tolist()} are not those of a body "
                "(wanted: not negative, the two smaller adding up to at least the largest)"
            )
    if np.any(model.tau_max <= 0) or np.any(model.inertia_scale <= 0):
        raise ModelError(f"{where}: tau_max and inertia_scale must be positive")
