"""Keys of a plant in a config: those that all plants have, those of each engine, and how each plant is built.

A kind of plant is a frozen dataclass below `PlantKeys` with a method ``build(factors)`` that returns a `Plant`; it
imports what it needs when it is called.
"""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from torquebench.disturbances import Stream, generator
from torquebench.errors import Fault
from torquebench.kernel import Array
from torquebench.keys import Key, Kinds, Units
from torquebench.robot import RobotModel, load_model
from torquebench.robot.library import ArmFile
from torquebench.robot.lock import Lock
from torquebench.robot.payload import Payload
from torquebench.robot.perturbation import Perturbation, perturbed
from torquebench.sim.friction import SPEED, Friction, acting
from torquebench.sim.joints import Transmission, moved_by
from torquebench.sim.plants import Plant
from torquebench.timing import Timing

StructureName: TypeAlias = Literal["exact", "corrected", "printed"]
ConstantsName: TypeAlias = Literal["fitted", "printed"]
PLANTS = Kinds("plant", "engine", methods=("build(factors)", "describe(units)"))
plant = PLANTS
"""Decorator of a class: ``@plant("my-simulator")``."""


@dataclass(frozen=True)
class PlantKeys(ABC):
    """Keys that every plant has."""

    engine: ClassVar[str]
    model: Annotated[
        str | ArmFile,
        Key(
            "Arm: the name of a folder in models/, or an MJCF or URDF file at or below this config's folder; another "
            "place takes --model FILE, or --allow-outside"
        ),
    ]
    timestep: Annotated[float, Key("Physics step", "s", above=0)] = 0.001
    integrator: Annotated[
        Literal["rk4", "euler"],
        Key("Integration scheme: rk4 is 4th-order Runge-Kutta; euler is semi-implicit, 1st-order"),
    ] = "rk4"
    payload: Annotated[Payload | None, Key("Load that the last link takes up")] = None
    lock: Annotated[Lock | None, Key("Joint that locks on the way; not with structure corrected or printed")] = None
    friction: Annotated[
        Friction | None,
        Key("Friction of the joints; if left out that which the arm's file gives them, none for no friction at all"),
    ] = None
    transmission: Annotated[
        Transmission | None,
        Key(
            "Springs, dampers and gaps between the motors and the links, where friction and disturbances act on the "
            "motors; integrator must be rk4. Without it, or with the word rigid, joints are rigid"
        ),
    ] = None
    limits: Annotated[
        Literal["warn", "stop", "ignore"],
        Key(
            "What comes of a joint that leaves the range which the arm's file gives it: a remark, the end of the run "
            "there (OUT_OF_RANGE), or nothing; no plant holds a joint back. Of speed limits there is a remark but with "
            "ignore"
        ),
    ] = "warn"
    perturb: Annotated[
        Perturbation | None, Key("Drawn changes of the arm itself; not with structure corrected or printed")
    ] = None

    @property
    def form(self) -> tuple[StructureName, ConstantsName]:
        """Structure and constants of the equations by which the arm moves."""
        return "exact", "fitted"

    @property
    def load(self) -> Payload | None:
        """Payload that the arm takes up; one without mass is none."""
        return None if self.payload is None or self.payload.mass == 0.0 else self.payload

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what the plant's structure cannot have."""
        closed = self.form[0] != "exact"
        if closed and self.payload is not None and any(self.payload.offset):
            text = "structures corrected and printed hold a payload at the wrist centre only"
            yield Fault(("payload", "offset"), text, wanted="[0, 0, 0]")
        if closed and self.lock is not None:
            text = "needs structure exact: corrected and printed have constants in place of a motor to hold"
            yield Fault(("lock",), text, at="key")
        if closed and self.transmission is not None:
            text = "needs structure exact: it takes the motors off the links, and corrected and printed have constants"
            yield Fault(("transmission",), text, at="key")
        if self.integrator != "rk4" and self.transmission is not None:
            yield Fault(("integrator",), "the motors of a transmission move too fast for euler", wanted="rk4")
        if closed and self.perturb is not None:
            text = "needs structure exact: it changes links, and corrected and printed have constants"
            yield Fault(("perturb",), text, at="key")

    def factors(self, n: int, seed: int, draw: int) -> Array | None:
        """Draw what the links are multiplied by, (n, 8); None for the links as they are.

        Args:
            n: Number of joints.
            seed, draw: Key of the random stream; see `generator`.
        """
        return None if self.perturb is None else self.perturb.draw(n, generator(seed, draw, Stream.PERTURBATION))

    def twin(self, factors: Array | None) -> RobotModel:
        """Return the analytic model of the arm as it is, without its load."""
        model = load_model(self.model, *self.form)
        return model if factors is None else perturbed(model, factors)

    @property
    def acting(self) -> Friction | None:
        """Friction that acts: the config's, else the arm's own, if any."""
        if self.friction is not None and not self.friction.is_partial:
            return self.friction
        own = _own_friction if isinstance(self.model, ArmFile) else _own_friction.__wrapped__
        return own(self.friction, self.model, self.timestep, self.integrator, self.transmission)

    def remarks(self) -> list[str]:
        """Return what was left out of the arm's file, or is not quite as it says."""
        found = [f"arm {self.model}: {text}" for text in getattr(self.model, "remarks", ())]
        if self.transmission is not None:
            found.append("joints that give: certificates and gains: auto hold for rigid joints, so none is certified")
        if self.lock is not None:
            found.append(f"joint {self.lock.joint} locks: certificates hold for arms that move, so none is certified")
        chosen = self.friction is None or (self.friction.is_partial and self.friction.speed == SPEED)
        own = self.acting if chosen else None
        if own is not None and own.speed > SPEED:
            why = f"{self.integrator} at {1e3 * self.timestep:g} ms follows no steeper friction on joints so light"
            text = f"its Coulomb friction is fully developed above {own.speed:g} rad/s, as {why}: a shorter timestep"
            text += " brings that down, and on bristles, plant.friction.bristle_stiffness, joints stick"
            found.append(f"arm {self.model}: {text}")
        return found

    @abstractmethod
    def build(self, factors: Array | None) -> Plant:
        """Make the plant.

        Args:
            factors: What its links are multiplied by; see `factors`.

        Raises:
            FrictionError: its friction does not fit the arm, or its time step.
            SpringError: its joints are too fast for it, or have no motors.
            ModelError: the arm cannot carry the payload.
        """
        ...

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        form = "".join(f":{part}" for part in self.form) if "structure" in self.__dict__ else ""
        parts = [f"{self.engine}:{self.model}{form} ({self.integrator}, {1e3 * self.timestep:g} ms)"]
        friction = self.acting
        own = None if friction is self.friction else friction
        burdens = (self.perturb, self.payload, self.lock, self.friction if own is None else None, self.transmission)
        parts += [burden.describe(units) for burden in burdens if burden is not None]
        return ", ".join([*parts, *([] if own is None else [f"the arm's own {own.describe(units)}"])])


@functools.lru_cache(maxsize=64)
def _own_friction(
    given: Friction | None,
    model: str | ArmFile,
    timestep: float,
    integrator: str,
    transmission: Transmission | None,
) -> Friction | None:
    arm = load_model(model)
    masses = moved_by(transmission, arm.flat.armature, arm.mass_matrix)
    return acting(given, arm.passive, masses, timestep, integrator, arm.flat.tau_max)[0]


@plant("mujoco")
@dataclass(frozen=True)
class Mujoco(PlantKeys):
    """The arm as MuJoCo simulates it."""

    def build(self, factors: Array | None) -> Plant:
        """Make the plant; MuJoCo is imported only here."""
        from torquebench.sim.plants.mujoco import MujocoPlant

        return MujocoPlant(
            self.model,
            self.timestep,
            self.integrator,
            payload=self.load,
            lock=self.lock,
            friction=self.friction,
            transmission=self.transmission,
            factors=factors,
            stops=self.limits == "stop",
        )


@plant("analytic")
@dataclass(frozen=True)
class Analytic(PlantKeys):
    """The arm simulated from equations of motion, without MuJoCo."""

    structure: Annotated[StructureName, Key("Equations of motion of the plant: as in model.structure")] = "exact"
    constants: Annotated[ConstantsName, Key("Numbers in the plant's equations: as in model.constants")] = "fitted"

    @property
    def form(self) -> tuple[StructureName, ConstantsName]:
        """Structure and constants of the equations by which the arm moves."""
        return self.structure, self.constants

    def build(self, factors: Array | None) -> Plant:
        """Make the plant."""
        from torquebench.sim.plants.analytic import AnalyticPlant

        return AnalyticPlant(
            self.twin(factors),
            self.timestep,
            self.integrator,
            payload=self.load,
            lock=self.lock,
            friction=self.friction,
            transmission=self.transmission,
            stops=self.limits == "stop",
        )
