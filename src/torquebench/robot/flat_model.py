"""The flat model that laws and the analytic plant compute with: arrays, a structure code, scratch space."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import Structure

EXACT = 0
"""Structure code: rigid-body dynamics of all joints."""
CLOSED_FORM = 1
"""Structure code: the paper's closed forms (36)-(75), each equation corrected or as printed."""
STRUCTURES = ("exact", "corrected", "printed")

PLAIN = frozenset(("constants", "control_period"))
"""Fields from which nothing is derived."""

HINGE = 0
SLIDE = 1


def force_unit(kind: int) -> str:
    """Return the unit of what drives a joint, HINGE or SLIDE, or of which it is said whether it slides."""
    return "N" if kind == SLIDE else "N m"


class Scratch(NamedTuple):
    """Working memory of the dynamics kernels, so that they allocate nothing; one per thread."""

    rotation: Annotated[Array, 3]
    """Orientation of frame i in frame i-1, (n, 3, 3)."""
    offset: Annotated[Array, 2]
    """Origin of frame i in frame i-1, (n, 3) [m]."""
    force: Annotated[Array, 2]
    """Force on link i, later composite first moments, (n, 3)."""
    moment: Annotated[Array, 2]
    """Moment on link i about its origin, (n, 3)."""
    composite: Annotated[Array, 2]
    """Composite mass, first moment and inertia of the links from i outwards, (n, 10)."""
    matrix: Annotated[Array, 2]
    """Mass matrix, destroyed by the solver, (n, n)."""
    vector: Array
    """Right-hand side of the solver, (n,)."""
    zeros: Array
    """Zeros, never written, (n,)."""
    free: Array
    """Free for a law's intermediate results within one call; the dynamics do not use it, (n,)."""


@dataclass(frozen=True, eq=False)
class Model(Structure):
    """A robot as the kernels see it. Frame i moves with link i and its z axis is joint i's axis.

    Its arrays are read-only but for the scratch space; `dataclasses.replace` makes a changed model.

    A belief (what a law computes with) and an analytic plant (the truth) are two objects of this type.
    """

    structure: int
    """EXACT or CLOSED_FORM."""
    kind: IntArray
    """HINGE or SLIDE for each joint, (n,)."""
    rotation: Annotated[Array, 3]
    """Orientation of frame i in frame i-1 at q = 0, (n, 3, 3)."""
    offset: Annotated[Array, 2]
    """Origin of frame i in frame i-1 at q = 0, (n, 3) [m]."""
    mass: Array
    """Link masses, (n,) [kg]."""
    com: Annotated[Array, 2]
    """Centres of mass in frame i, (n, 3) [m]."""
    inertia: Annotated[Array, 3]
    """Inertia tensors about the centre of mass, axes of frame i, (n, 3, 3) [kg m^2]."""
    armature: Array
    """Reflected rotor inertia added to the diagonal of the mass matrix, (n,) [kg m^2]."""
    gravity: Array
    """Acceleration of gravity in the base frame, (3,) [m/s^2]."""
    tool_rotation: Annotated[Array, 2]
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
    about_origin: Annotated[Array, 2] = field(init=False)
    """Each link about its frame's origin: mass, first moment x y z, inertia xx yy zz xy xz yz, (n, 10); derived."""

    def __post_init__(self) -> None:
        """Make the arrays read-only, as copies where somebody may write to them, and derive `about_origin`."""
        self._freeze(field_.name for field_ in fields(self) if field_.init)
        derived = about_origin(self.mass, self.com, self.inertia)
        derived.setflags(write=False)
        object.__setattr__(self, "about_origin", derived)

    def _freeze(self, names: Iterable[str]) -> None:
        for name in names:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                frozen = value.copy()
                frozen.setflags(write=False)
                object.__setattr__(self, name, frozen)


def about_origin(mass: Array, com: Array, inertia: Array) -> Array:
    """Return the inertial parameters of links about their frames' origins, (n, 10): see `Model.about_origin`.

    Args:
        mass: Masses, (n,) [kg].
        com: Centres of mass, (n, 3) [m].
        inertia: Inertias about them, (n, 3, 3) [kg m^2].
    """
    m, (x, y, z), J = mass, com.T, inertia
    return np.column_stack(
        [
            m,
            m * x,
            m * y,
            m * z,
            J[:, 0, 0] + m * (y * y + z * z),
            J[:, 1, 1] + m * (x * x + z * z),
            J[:, 2, 2] + m * (x * x + y * y),
            J[:, 0, 1] - m * x * y,
            J[:, 0, 2] - m * x * z,
            J[:, 1, 2] - m * y * z,
        ]
    )


def scratch_for(n: int) -> Scratch:
    """Return working memory for `n` joints."""
    return Scratch(
        np.zeros((n, 3, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 10)),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
    )


def own_copy(model: Model, **changes: Any) -> Model:
    """Return a copy that shares the read-only constants and has its own scratch space.

    Args:
        model: What to copy.
        changes: Fields to change, as for `dataclasses.replace`.
    """
    scratch = scratch_for(len(model.armature))
    if not changes.keys() <= PLAIN:
        return replace(model, **changes, scratch=scratch)
    # a tenth of the time of the above: a sweep makes two copies for each run
    twin: Model = object.__new__(type(model))
    twin.__dict__.update(model.__dict__, **changes, scratch=scratch)
    for derived in ("address", "_table", "_python_numbers"):  # of the model's own numbers
        twin.__dict__.pop(derived, None)
    twin._freeze(changes)
    return twin


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
        EXACT,
        np.array(kind, dtype=np.int64),
        own(rotation),
        own(offset),
        own(mass),
        own(com),
        own(inertia),
        own(armature),
        own(gravity),
        own(tool_rotation),
        own(tool_offset),
        np.zeros(0),
        np.zeros(0, dtype=np.int64),
        own(tau_max),
        own(inertia_scale),
        float(control_period),
        scratch_for(len(mass)),
    )
