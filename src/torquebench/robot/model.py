"""The flat model that laws and the analytic plant compute with: arrays, a structure code, scratch space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array, IntArray

EXACT = 0
"""Structure code: rigid-body dynamics of all joints."""
CLOSED_FORM = 1
"""Structure code: the paper's closed forms (36)-(75), each equation corrected or as printed."""
STRUCTURES = ("exact", "corrected", "printed")

HINGE = 0
SLIDE = 1


class Scratch(NamedTuple):
    """Working memory of the dynamics kernels, so that they allocate nothing; one per thread."""

    rotation: Array
    """Orientation of frame i in frame i-1, (n, 3, 3)."""
    offset: Array
    """Origin of frame i in frame i-1, (n, 3) [m]."""
    force: Array
    """Force on link i, later composite first moments, (n, 3)."""
    moment: Array
    """Moment on link i about its origin, (n, 3)."""
    composite: Array
    """Composite mass, first moment and inertia of the links from i outwards, (n, 10)."""
    matrix: Array
    """Mass matrix, destroyed by the solver, (n, n)."""
    vector: Array
    """Right-hand side of the solver, (n,)."""
    zeros: Array
    """Zeros, never written, (n,)."""


class Model(NamedTuple):
    """A robot as the kernels see it. Frame i moves with link i and its z axis is joint i's axis.

    A belief (what a law computes with) and an analytic plant (the truth) are two objects of this type.
    """

    structure: int
    """EXACT or CLOSED_FORM."""
    kind: IntArray
    """HINGE or SLIDE for each joint, (n,)."""
    rotation: Array
    """Orientation of frame i in frame i-1 at q = 0, (n, 3, 3)."""
    offset: Array
    """Origin of frame i in frame i-1 at q = 0, (n, 3) [m]."""
    mass: Array
    """Link masses, (n,) [kg]."""
    com: Array
    """Centres of mass in frame i, (n, 3) [m]."""
    inertia: Array
    """Inertia tensors about the centre of mass, axes of frame i, (n, 3, 3) [kg m^2]."""
    armature: Array
    """Reflected rotor inertia added to the diagonal of the mass matrix, (n,) [kg m^2]."""
    gravity: Array
    """Acceleration of gravity in the base frame, (3,) [m/s^2]."""
    tool_rotation: Array
    """Orientation of the tool frame in the last link's frame, (3, 3)."""
    tool_offset: Array
    """Origin of the tool frame in the last link's frame, (3,) [m]."""
    constants: Array
    """Closed forms only: I1..I23, Im1..Im6, g1..g5, (34,) [kg m^2, N m]; empty for EXACT."""
    literal: IntArray
    """Closed forms only: 1 where an equation is taken as printed, 0 where corrected; empty for EXACT."""
    tau_max: Array
    """Torque limits, (n,) [N m]."""
    inertia_scale: Array
    """Typical diagonal of the mass matrix, Mbar, by which gains are scaled, (n,) [kg m^2]."""
    control_period: float
    """Time between control instants [s]."""
    scratch: Scratch


def scratch_for(n: int) -> Scratch:
    """Return working memory for `n` joints."""
    return Scratch(
        np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros((n, 10)), np.zeros((n, n)), np.zeros(n), np.zeros(n),
    )  # fmt: skip


def own_copy(model: Model) -> Model:
    """Return a model that shares no array with `model`, with scratch space of its own."""
    fields: dict[str, Any] = model._asdict()
    arrays = {name: value.copy() for name, value in fields.items() if isinstance(value, np.ndarray)}
    return Model(**(fields | arrays | {"scratch": scratch_for(len(model.armature))}))


def rigid_model(
    *,
    kind: Sequence[int] | IntArray,
    rotation: Array,
    offset: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    armature: Array,
    gravity: Array,
    tool_rotation: Array,
    tool_offset: Array,
    tau_max: Array,
    inertia_scale: Array,
    control_period: float = 0.001,
) -> Model:
    """Return an EXACT model; arguments as the fields of `Model`, copied."""

    def own(x: Array) -> Array:
        return np.array(x, dtype=np.float64, order="C")

    return Model(
        EXACT, np.array(kind, dtype=np.int64), own(rotation), own(offset), own(mass), own(com), own(inertia),
        own(armature), own(gravity), own(tool_rotation), own(tool_offset), np.zeros(0), np.zeros(0, dtype=np.int64),
        own(tau_max), own(inertia_scale), float(control_period), scratch_for(len(mass)),
    )  # fmt: skip
