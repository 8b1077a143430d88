"""Every key of an experiment: its type, default, meaning and unit, in one place."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import ConfigDict, Field

from torquebench.experiment.fuzzy_schema import MAX_SYSTEMS, FuzzyKeys
from torquebench.experiment.keys import Keys
from torquebench.experiment.scenario_schema import (
    BandLimitedNoise,
    Chain,
    ChainName,
    Disturbance,
    Friction,
    Mismatch,
    Payload,
    Perturbation,
)
from torquebench.experiment.values import (
    AnyVector,
    FrameSize,
    HomeOrVector,
    NotNegative,
    NotNegativeVector,
    Positive,
    Slug,
)
from torquebench.robot import load_model
from torquebench.robot.flat_model import SLIDE

MAX_CONTROLLERS = 64
MAX_DISTURBANCES = 64

StructureName: TypeAlias = Literal["exact", "corrected", "printed"]
ConstantsName: TypeAlias = Literal["fitted", "printed"]


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


class AnyPlant(Keys):
    """Keys that every plant has."""

    engine: str = Field(description="What simulates the arm.")
    model: str = Field(description="Arm: the name of a folder in models/.")
    timestep: Positive = Field(0.001, description="Physics step [s].")
    integrator: Literal["rk4", "euler"] = Field(
        "rk4", description="Integration scheme: rk4 is 4th-order Runge-Kutta; euler is semi-implicit, 1st-order."
    )
    payload: Payload | None = Field(None, description="Load that the last link takes up.")
    friction: Friction | None = Field(None, description="Friction of the joints.")
    perturb: Perturbation | None = Field(
        None, description="Drawn changes of the arm itself; not with structure corrected or printed."
    )


class MujocoPlant(AnyPlant):
    """The arm as MuJoCo simulates it."""

    engine: Literal["mujoco"] = Field(description="What simulates the arm.")


class AnalyticPlant(AnyPlant):
    """The arm simulated from equations of motion, without MuJoCo."""

    engine: Literal["analytic"] = Field(description="What simulates the arm.")
    structure: StructureName = Field("exact", description="Equations of motion of the plant: as in model.structure.")
    constants: ConstantsName = Field("fitted", description="Numbers in the plant's equations: as in model.constants.")


class Belief(Keys):
    """The model of the arm that the laws compute with; the plant may differ from it."""

    structure: StructureName = Field(
        "exact",
        description="Equations of motion: exact is the rigid body; corrected and printed are the paper's, "
        "puma560 only.",
    )
    constants: ConstantsName = Field(
        "fitted",
        description="Numbers in the equations: fitted fit a rigid body; printed are the paper's tables, puma560 only "
        "and not with structure exact.",
    )
    mismatch: Mismatch | None = Field(None, description="Errors put on purpose into the constants.")


class ControllerKeys(Keys):
    """Keys that every controller has, whatever its law."""

    name: Slug = Field(
        description="Name of the controller, unique in the file; also the name of its folder, so not figures."
    )
    law: str = Field(description="Name of the torque law.")
    expect: Literal["completed", "failed"] = Field(
        "completed",
        description="Outcome that counts as right; failed makes a failing run the expected outcome, "
        "and one that completes the wrong one.",
    )


class Controller(ControllerKeys):
    """One controller: a law, the choices that set its form, and its gains."""

    options: dict[str, str | bool] = Field(description="Option name -> value; in the file at the controller's level.")
    gains: dict[str, AnyVector] = Field(description="Gain name -> one number, or one for each joint.")
    fuzzy: str | None = Field(None, description="Name of the law's fuzzy system, of a law that has one.")


class AnyReference(Keys):
    """Keys that every reference has."""

    metrics_from: ClassVar[float] = 1.0
    kind: str = Field(description="Form of the desired motion.")


class SineReference(AnyReference):
    """Raised sine A/2 (1 - cos 2 pi f t), at rest at zero when it starts."""

    kind: Literal["sine"] = Field(description="Form of the desired motion.")
    amplitude: AnyVector = Field(description="Peak-to-peak excursion A of each joint [rad], in m for slide joints.")
    frequency_hz: NotNegativeVector = Field(description="Frequency f of each joint [Hz].")


class StepReference(AnyReference):
    """Zero, then a constant."""

    metrics_from: ClassVar[float] = 2.0
    kind: Literal["step"] = Field(description="Form of the desired motion.")
    target: AnyVector = Field(description="Position of each joint after the step [rad], in m for slide joints.")
    at: NotNegative = Field(description="Time of the step; less than run.duration [s].")


class _Rising(AnyReference):
    target: AnyVector = Field(description="Final position of each joint [rad], in m for slide joints.")
    rise_time: Positive = Field(description="Time from zero to the target [s].")


class RampReference(_Rising):
    """Constant speed from zero to the target, then held; a run may end before the target is reached."""

    kind: Literal["ramp"] = Field(description="Form of the desired motion.")


class QuinticReference(_Rising):
    """Minimum-jerk polynomial from zero to the target, then held."""

    kind: Literal["quintic"] = Field(description="Form of the desired motion.")
    rise_time: Positive = Field(description="Time from zero to the target, at most run.duration [s].")


def _metrics_from_is_optional(schema: dict[str, Any]) -> None:
    schema["required"] = [key for key in schema["required"] if key != "metrics_from"]


class Run(Keys):
    """How long, how often, from where, and with which random numbers."""

    model_config = ConfigDict(json_schema_extra=_metrics_from_is_optional)

    duration: Positive = Field(description="Length of the run, a whole multiple of run.control_period [s].")
    control_period: Positive = Field(
        0.001, description="Time between two calls of a law, a whole multiple of plant.timestep [s]."
    )
    initial_q: HomeOrVector = Field(
        "home",
        description="Position at the start, at rest [rad], in m for slide joints; home is every joint at zero. "
        "References start at zero whatever initial_q is.",
    )
    seed: int = Field(
        0, ge=0, le=2**63 - 1, description="Source of all random numbers: the same seed and draw, the same numbers [1]."
    )
    metrics_from: NotNegative = Field(
        description="Start of the window for metrics, at least 0.5 s before the end of the run; if left out, 2 for a "
        "step and 1 for other references [s]."
    )
    draw: int = Field(
        0,
        ge=0,
        le=2**63 - 1,
        description="Number of the random draw under one seed: each draw has its own mismatch, perturbation and "
        "noise [1].",
    )


class Video(Keys):
    """A film of the run, made when it has ended; one that fails does not fail the run."""

    quality: Literal["fast", "pretty"] = Field("fast", description="pretty has shadows and takes many times as long.")
    size: FrameSize = Field((640, 480), description="Width and height, even numbers [px].")
    speed: float = Field(1.0, ge=1e-3, le=1e3, description="Simulated seconds shown in one second [1].")
    camera: str | None = Field(
        None, description="Name of a camera of the arm: of its scene.xml, else overview or side; the first if left out."
    )


Plant: TypeAlias = MujocoPlant | AnalyticPlant
Reference: TypeAlias = SineReference | StepReference | RampReference | QuinticReference


class Experiment(Keys):
    """One experiment: a plant, the belief about it, a motion to follow, and the controllers to compare."""

    name: Slug = Field(description="Name of the experiment; also the start of its folder's name.")
    description: str | None = Field(None, max_length=4000, description="What the experiment is for, in words.")
    plant: Plant = Field(discriminator="engine", description="The arm as it is.")
    model: Belief = Field(
        default_factory=Belief,
        json_schema_extra={"default": {}},
        description="The arm as the laws believe it to be.",
    )
    controllers: tuple[Controller, ...] = Field(
        min_length=1, max_length=MAX_CONTROLLERS, description="What is compared."
    )
    fuzzy: dict[Slug, Annotated[FuzzyKeys, Field(discriminator="kind")]] = Field(
        default_factory=dict,
        max_length=MAX_SYSTEMS,
        json_schema_extra={"additionalProperties": False},
        description="Fuzzy systems for laws that take one, by name; pd-49, pd-25, pd-9 and s-7 are built in.",
    )
    reference: Reference = Field(
        discriminator="kind", description="Desired motion; starts at zero whatever run.initial_q is."
    )
    chain: ChainName | Chain = Field(
        "ideal",
        description="Sensors and actuators. ideal: exact and instantaneous; fast: position with noise of 0.1 mrad, "
        "velocity differentiated from it and filtered at 500 rad/s, actuators lagging by 2 ms; slow: the same noise, "
        "200 rad/s, 8 ms; or each imperfection by itself.",
    )
    disturbances: tuple[Annotated[Disturbance, Field(discriminator="kind")], ...] = Field(
        (), max_length=MAX_DISTURBANCES, description="What acts on the joints besides the law."
    )
    run: Run = Field(description="Length, sampling, start and randomness of the run.")
    video: Video | None = Field(None, description="Film to make of the run; none if left out, {} for one as usual.")

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

    def hold_steps(self, disturbance: BandLimitedNoise) -> int:
        """Control periods for which one value of a disturbance lasts, at most the whole run."""
        return whole_steps(min(disturbance.hold, self.run.duration), self.run.control_period)


def whole_steps(duration: float, step: float) -> int:
    """Return the number of steps nearest to a duration; both in the same unit."""
    return round(duration / step)
