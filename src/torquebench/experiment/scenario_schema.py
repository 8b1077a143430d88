"""Keys of what a law has to cope with: sensors, actuators, disturbances, and a model that is wrong on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from torquebench.errors import Fault
from torquebench.keys import Key, Vector
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.timing import Timing, control_instant


@dataclass(frozen=True)
class Payload:
    """A point mass on the last link, with a belief that knows nothing of it."""

    mass: Annotated[float, Key("Mass; 0 for none", "kg", at_least=0)]
    at: Annotated[
        float,
        Key(
            "Time at which it is taken up, at the joints' position and velocity of then: a whole multiple of "
            "run.control_period, less than run.duration",
            "s",
            at_least=0,
        ),
    ] = 0.0
    offset: Annotated[
        tuple[float, float, float],
        Key(
            "Where it is, in the frame of the last joint (z along its axis): zero is a point of the axis, for puma560 "
            "the wrist centre",
            "m",
            wanted="a list of 3 numbers",
        ),
    ] = (0.0, 0.0, 0.0)

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the run."""
        yield from control_instant(("at",), self.at, timing)


@dataclass(frozen=True)
class Friction:
    """Friction of the joints, of which the belief knows nothing: viscous qd + coulomb sat(qd/speed)."""

    viscous: Annotated[
        Vector,
        Key(
            "Viscous friction",
            "N m s/rad",
            ", in N s/m for slide joints; of the PUMA 5.8 9.3 4.0 .36 .36 .22",
            at_least=0,
        ),
    ] = 0.0
    coulomb: Annotated[
        Vector, Key("Coulomb friction", "N m", ", in N for slide joints; of the PUMA 26 14 6.5 1.0 1.3 0.7", at_least=0)
    ] = 0.0
    speed: Annotated[
        float,
        Key(
            "Speed from which on Coulomb friction is whole; below it falls linearly to zero, so that a joint at rest "
            "creeps",
            "rad/s",
            ", in m/s for slide joints",
            above=0,
        ),
    ] = 0.01

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where there is no friction."""
        if not any(any(x if isinstance(x, tuple) else (x,)) for x in (self.viscous, self.coulomb)):
            yield Fault((), "neither viscous nor coulomb is given: without friction leave it out")


@dataclass(frozen=True)
class Perturbation:
    """A plant that differs from its model's file, and is a rigid body still."""

    relative: Annotated[
        float,
        Key(
            "Masses, centres of mass, second moments about them along the link's axes and motor inertias are each "
            "multiplied by a number drawn evenly between 1 - r and 1 + r; r is a fraction",
            "1",
            at_least=0,
            below=1,
        ),
    ]


@dataclass(frozen=True)
class Mismatch:
    """Errors put on purpose into the model that the laws use: one of these keys."""

    one_of: ClassVar[bool] = True
    relative: Annotated[
        float | None,
        Key(
            "Every constant is multiplied by 1 + r or 1 - r, as drawn; with structure exact the links are scaled as by "
            "plant.perturb; r is a fraction, 0.3 for 30 %",
            "1",
            at_least=0,
            below=1,
        ),
    ] = None
    tolerance: Annotated[
        float | None,
        Key(
            "Constants are drawn within this many times the tolerances of the paper's tables, such that a rigid body "
            "has them; puma560 only",
            "1",
            above=0,
        ),
    ] = None
    constants: Annotated[
        dict[Literal[CONSTANTS], float] | None,  # type: ignore[valid-type]  # a computed tuple
        Key(
            "Name of a constant, I1 to I23, Im1 to Im6 or g1 to g5, -> its factor; puma560 only and not with structure "
            "exact",
            "1",
            wanted="a mapping of constants to factors, such as {g1: 1.3}",
        ),
    ] = None

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault unless just one of the keys is given."""
        ways = ("relative", "tolerance", "constants")
        given = [way for way in ways if getattr(self, way) is not None]
        if not given:
            yield Fault((), f"missing: one of {', '.join(ways)}", at="key")
        for way in given[1:]:
            yield Fault((way,), f"{given[0]} is given already", wanted="one of the two", at="key")
        if self.constants == {}:
            yield Fault(("constants",), "no constant is given", wanted="at least one, such as g1: 1.3")
