"""Every key of an experiment: its type, default, meaning and unit, in one place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from torquebench.errors import Fault
from torquebench.experiment.controllers import LAWS, MAX_CONTROLLERS
from torquebench.experiment.controllers import Controller as Controller
from torquebench.experiment.fuzzy_schema import MAX_SYSTEMS, SYSTEMS, FuzzyKeys
from torquebench.experiment.groups import SLUG, Ints, Many, ManyNamed, Named, OneOf, Text
from torquebench.experiment.scenario_schema import (
    BandLimitedNoise,
    Chain,
    Disturbance,
    Friction,
    Mismatch,
    Payload,
    Perturbation,
    disturbance,
)
from torquebench.keys import Key, Kinds, Vector
from torquebench.robot import load_model
from torquebench.robot.flat_model import SLIDE
from torquebench.timing import Timing, whole_steps

MAX_DISTURBANCES = 64
LEAST_SIDE, LARGEST_SIDE = 160, 3840
"""Sides of a film's frame [px]; its format takes even ones only."""
MAX_SEED = 2**63 - 1

StructureName: TypeAlias = Literal["exact", "corrected", "printed"]
ConstantsName: TypeAlias = Literal["fitted", "printed"]
plant = Kinds("plant", "engine")
reference = Kinds("reference")
CHAINS = ("ideal", "fast", "slow")


def joint_count(model_name: str) -> int:
    """Return the number of joints of the model called `model_name`.

    Raises:
        ModelError: there is no such model, or it is malformed.
    """
    return load_model(model_name).n


def slide_joints(model_name: str) -> tuple[bool, ...]:
    """Return whether each joint of the model called `model_name` slides instead of turning.

    Raises:
        ModelError: there is no such model, or it is malformed.
    """
    return tuple(kind == SLIDE for kind in load_model(model_name).flat.kind)


@dataclass(frozen=True)
class AnyPlant:
    """Keys that every plant has."""

    engine: ClassVar[str]
    model: Annotated[str, Key("Arm: the name of a folder in models/")]
    timestep: Annotated[float, Key("Physics step", "s", above=0)] = 0.001
    integrator: Annotated[
        Literal["rk4", "euler"],
        Key("Integration scheme: rk4 is 4th-order Runge-Kutta; euler is semi-implicit, 1st-order"),
    ] = "rk4"
    payload: Annotated[Payload | None, Key("Load that the last link takes up")] = None
    friction: Annotated[Friction | None, Key("Friction of the joints")] = None
    perturb: Annotated[
        Perturbation | None, Key("Drawn changes of the arm itself; not with structure corrected or printed")
    ] = None


@plant("mujoco")
@dataclass(frozen=True)
class MujocoPlant(AnyPlant):
    """The arm as MuJoCo simulates it."""


@plant("analytic")
@dataclass(frozen=True)
class AnalyticPlant(AnyPlant):
    """The arm simulated from equations of motion, without MuJoCo."""

    structure: Annotated[StructureName, Key("Equations of motion of the plant: as in model.structure")] = "exact"
    constants: Annotated[ConstantsName, Key("Numbers in the plant's equations: as in model.constants")] = "fitted"


@dataclass(frozen=True)
class Belief:
    """The model of the arm that the laws compute with; the plant may differ from it."""

    structure: Annotated[
        StructureName,
        Key(
            "Equations of motion: exact is the rigid body; corrected and printed are the paper's, puma560 only",
        ),
    ] = "exact"
    constants: Annotated[
        ConstantsName,
        Key(
            "Numbers in the equations: fitted fit a rigid body; printed are the paper's tables, puma560 only and not "
            "with structure exact"
        ),
    ] = "fitted"
    mismatch: Annotated[Mismatch | None, Key("Errors put on purpose into the constants")] = None


@reference("sine")
@dataclass(frozen=True)
class SineReference:
    """Raised sine A/2 (1 - cos 2 pi f t), at rest at zero when it starts."""

    kind: ClassVar[str]
    metrics_from: ClassVar[float] = 1.0
    amplitude: Annotated[Vector, Key("Peak-to-peak excursion A of each joint", "rad", ", in m for slide joints")]
    frequency_hz: Annotated[Vector, Key("Frequency f of each joint", "Hz", at_least=0)]


@reference("step")
@dataclass(frozen=True)
class StepReference:
    """Zero, then a constant."""

    kind: ClassVar[str]
    metrics_from: ClassVar[float] = 2.0
    target: Annotated[Vector, Key("Position of each joint after the step", "rad", ", in m for slide joints")]
    at: Annotated[float, Key("Time of the step; less than run.duration", "s", at_least=0)]

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where the run ends before the step."""
        if self.at >= timing.duration:
            wanted = f"less than run.duration, {timing.duration:.12g} s: there would be no step"
            yield Fault(("at",), got=f"{self.at:.12g} s", wanted=wanted)


@reference("ramp")
@dataclass(frozen=True)
class RampReference:
    """Constant speed from zero to the target, then held; a run may end before the target is reached."""

    kind: ClassVar[str]
    metrics_from: ClassVar[float] = 1.0
    target: Annotated[Vector, Key("Final position of each joint", "rad", ", in m for slide joints")]
    rise_time: Annotated[float, Key("Time from zero to the target", "s", above=0)]


@reference("quintic")
@dataclass(frozen=True)
class QuinticReference:
    """Minimum-jerk polynomial from zero to the target, then held."""

    kind: ClassVar[str]
    metrics_from: ClassVar[float] = 1.0
    target: Annotated[Vector, Key("Final position of each joint", "rad", ", in m for slide joints")]
    rise_time: Annotated[float, Key("Time from zero to the target, at most run.duration", "s", above=0)]

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where the run ends before the target is reached."""
        if self.rise_time > timing.duration * (1.0 + 1e-9):
            wanted = f"at most run.duration, {timing.duration:.12g} s"
            reason = "the metrics of the motion would be measured against a target that is never reached"
            yield Fault(("rise_time",), got=f"{self.rise_time:.12g} s", wanted=f"{wanted}: {reason}")


@dataclass(frozen=True)
class Run:
    """How long, how often, from where, and with which random numbers."""

    duration: Annotated[float, Key("Length of the run, a whole multiple of run.control_period", "s", above=0)]
    control_period: Annotated[
        float, Key("Time between two calls of a law, a whole multiple of plant.timestep", "s", above=0)
    ] = 0.001
    initial_q: Annotated[
        Vector | Literal["home"],
        Key(
            "Position at the start, at rest",
            "rad",
            ", in m for slide joints; home is every joint at zero. References start at zero whatever initial_q is",
        ),
    ] = "home"
    seed: Annotated[
        int,
        Key(
            "Source of all random numbers: the same seed and draw, the same numbers",
            "1",
            at_least=0,
            at_most=MAX_SEED,
        ),
    ] = 0
    metrics_from: Annotated[
        float,
        Key(
            "Start of the window for metrics, at least 0.5 s before the end of the run; if left out, 2 for a step and "
            "1 for other references",
            "s",
            at_least=0,
        ),
    ] = None  # type: ignore[assignment]  # until the reference's own is filled in
    draw: Annotated[
        int,
        Key(
            "Number of the random draw under one seed: each draw has its own mismatch, perturbation and noise",
            "1",
            at_least=0,
            at_most=MAX_SEED,
        ),
    ] = 0


@dataclass(frozen=True)
class Video:
    """A film of the run, made when it has ended; one that fails does not fail the run."""

    quality: Annotated[Literal["fast", "pretty"], Key("pretty has shadows and takes many times as long")] = "fast"
    size: Annotated[
        tuple[int, int],
        Key("Width and height, even numbers", "px", wanted="width and height, as [640, 480]"),
        Ints(LEAST_SIDE, LARGEST_SIDE, 2),
    ] = (640, 480)
    speed: Annotated[float, Key("Simulated seconds shown in one second", "1", at_least=1e-3, at_most=1e3)] = 1.0
    camera: Annotated[
        str | None,
        Key("Name of a camera of the arm: of its scene.xml, else overview or side; the first if left out"),
    ] = None


Plant: TypeAlias = MujocoPlant | AnalyticPlant
Reference: TypeAlias = SineReference | StepReference | RampReference | QuinticReference


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment: a plant, the belief about it, a motion to follow, and the controllers to compare."""

    name: Annotated[str, Key("Name of the experiment; also the start of its folder's name"), SLUG]
    description: Annotated[str | None, Key("What the experiment is for, in words"), Text(longest=4000)] = None
    plant: Annotated[Plant, Key("The arm as it is"), OneOf(plant, "What simulates the arm.")]
    model: Annotated[Belief, Key("The arm as the laws believe it to be")] = Belief()
    controllers: Annotated[
        tuple[Controller, ...], Key("What is compared"), Many("controllers", 1, MAX_CONTROLLERS, LAWS)
    ]
    fuzzy: Annotated[
        Mapping[str, FuzzyKeys],
        Key("Fuzzy systems for laws that take one, by name; pd-49, pd-25, pd-9 and s-7 are built in"),
        ManyNamed(
            "fuzzy systems",
            0,
            MAX_SYSTEMS,
            OneOf(SYSTEMS, "Method: consequents are terms (mamdani) or functions of the inputs."),
        ),
    ] = field(default_factory=dict)
    reference: Annotated[
        Reference,
        Key("Desired motion; starts at zero whatever run.initial_q is"),
        OneOf(reference, "Form of the desired motion."),
    ]
    chain: Annotated[
        str | Chain,
        Key(
            "Sensors and actuators. ideal: exact and instantaneous; fast: position with noise of 0.1 mrad, velocity "
            "differentiated from it and filtered at 500 rad/s, actuators lagging by 2 ms; slow: the same noise, 200 "
            "rad/s, 8 ms; or each imperfection by itself"
        ),
        Named(CHAINS, Chain),
    ] = "ideal"
    disturbances: Annotated[
        tuple[Disturbance, ...],
        Key("What acts on the joints besides the law"),
        Many("disturbances", 0, MAX_DISTURBANCES, OneOf(disturbance, "Form of the disturbance.")),
    ] = ()
    run: Annotated[Run, Key("Length, sampling, start and randomness of the run")]
    video: Annotated[Video | None, Key("Film to make of the run; none if left out, {} for one as usual")] = None

    @cached_property
    def n(self) -> int:
        """Number of joints."""
        return joint_count(self.plant.model)

    @property
    def n_steps(self) -> int:
        """Number of control instants."""
        return whole_steps(self.run.duration, self.run.control_period)

    @property
    def substeps(self) -> int:
        """Physics steps in one control period."""
        return whole_steps(self.run.control_period, self.plant.timestep)

    @property
    def is_drawn(self) -> bool:
        """Whether anything in it is random."""
        noisy = self.chain in ("fast", "slow") or (isinstance(self.chain, Chain) and self.chain.encoder_noise > 0)
        noisy |= any(isinstance(disturbance, BandLimitedNoise) for disturbance in self.disturbances)
        mismatch = self.model.mismatch
        return noisy or self.plant.perturb is not None or (mismatch is not None and mismatch.constants is None)

    def with_(self, changes: Mapping[str, Any]) -> Experiment:
        """Return this experiment with some keys changed, checked again.

        Args:
            changes: Dotted key, as for ``--set``, -> value: ``{"run.duration": 2, "controllers.band.gains.phi": 0.1}``.

        Raises:
            ConfigError: a key does not exist, or a value does not go with the rest.
        """
        from torquebench.experiment.change import with_changes

        return with_changes(self, changes)

    def hold_steps(self, disturbance: BandLimitedNoise) -> int:
        """Control periods for which one value of a disturbance lasts, at most the whole run."""
        return whole_steps(min(disturbance.hold, self.run.duration), self.run.control_period)
