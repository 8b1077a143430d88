"""Keys of what a law has to cope with: sensors, actuators, disturbances, and a model that is wrong on purpose."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, ConfigDict, Field

from torquebench.experiment.keys import Keys
from torquebench.experiment.values import (
    AnyVector,
    NotNegative,
    NotNegativeVector,
    Positive,
    PositiveVector,
    Triple,
    positive_zero,
)
from torquebench.robot.puma560.symbols import CONSTANTS

ChainName: TypeAlias = Literal["ideal", "fast", "slow"]
ConstantName: TypeAlias = Literal[CONSTANTS]  # type: ignore[valid-type]  # a computed tuple
Spread: TypeAlias = Annotated[float, Field(ge=0, lt=1), AfterValidator(positive_zero)]
Factor: TypeAlias = Annotated[float, AfterValidator(positive_zero)]


class Chain(Keys):
    """Sensors and actuators, each imperfection by itself; the same on every joint."""

    encoder_noise: NotNegative = Field(
        0.0,
        description="Standard deviation of the noise added to each measured position at each control instant [rad].",
    )
    quantisation: NotNegative = Field(
        0.0,
        description="Step of the encoders: the measured position, noise included, is rounded to a whole multiple of "
        "it; 0 for none [rad].",
    )
    velocity: Literal["exact", "differentiated"] = Field(
        "exact",
        description="Measured velocity: exact is the true one; differentiated is the change of the measured position "
        "since the last control instant over run.control_period, zero at first.",
    )
    velocity_filter: Positive | None = Field(
        None,
        description="Corner of a first-order filter through which the differentiated velocity passes; if left out "
        "there is none [rad/s].",
    )
    delay: NotNegative = Field(
        0.0,
        description="Time after which the law sees a measurement, less than run.duration and a whole multiple of "
        "run.control_period; until then it sees that of t = 0 [s].",
    )
    actuator_lag: NotNegative = Field(0.0, description="Time constant of the actuators; 0 for none [s].")


class Payload(Keys):
    """A point mass on the last link, with a belief that knows nothing of it."""

    mass: NotNegative = Field(description="Mass; 0 for none [kg].")
    at: NotNegative = Field(
        0.0,
        description="Time at which it is taken up, at the joints' position and velocity of then: a whole multiple of "
        "run.control_period, less than run.duration [s].",
    )
    offset: Triple = Field(
        (0.0, 0.0, 0.0),
        description="Where it is, in the frame of the last joint (z along its axis): zero is a point of the axis, for "
        "puma560 the wrist centre [m].",
    )


class Friction(Keys):
    """Friction of the joints, of which the belief knows nothing: viscous qd + coulomb sat(qd/speed)."""

    viscous: NotNegativeVector = Field(
        0.0, description="Viscous friction [N m s/rad], in N s/m for slide joints; of the PUMA 5.8 9.3 4.0 .36 .36 .22."
    )
    coulomb: NotNegativeVector = Field(
        0.0, description="Coulomb friction [N m], in N for slide joints; of the PUMA 26 14 6.5 1.0 1.3 0.7."
    )
    speed: Positive = Field(
        0.01,
        description="Speed from which on Coulomb friction is whole; below it falls linearly to zero, so that a joint "
        "at rest creeps [rad/s], in m/s for slide joints.",
    )


class Perturbation(Keys):
    """A plant that differs from its model's file, and is a rigid body still."""

    relative: Spread = Field(
        description="Masses, centres of mass, second moments about them along the link's axes and motor inertias are "
        "each multiplied by a number drawn evenly between 1 - r and 1 + r; r is a fraction [1]."
    )


class Mismatch(Keys):
    """Errors put on purpose into the model that the laws use: one of these keys."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    relative: Spread | None = Field(
        None,
        description="Every constant is multiplied by 1 + r or 1 - r, as drawn; with structure exact the links are "
        "scaled as by plant.perturb; r is a fraction, 0.3 for 30 % [1].",
    )
    tolerance: Positive | None = Field(
        None,
        description="Constants are drawn within this many times the tolerances of the paper's tables, such that a "
        "rigid body has them; puma560 only [1].",
    )
    constants: dict[ConstantName, Factor] | None = Field(
        None,
        description="Name of a constant, I1 to I23, Im1 to Im6 or g1 to g5, -> its factor; puma560 only and not with "
        "structure exact [1].",
    )


class AnyDisturbance(Keys):
    """Keys that every disturbance has."""

    kind: str = Field(description="Form of the disturbance.")
    channel: Literal["torque"] = Field(
        description="What it is added to: the joint torque, after saturation and actuator lag."
    )


class BandLimitedNoise(AnyDisturbance):
    """Gaussian torque, each value held for a while."""

    kind: Literal["band-limited-noise"] = Field(description="Form of the disturbance.")
    sigma: NotNegativeVector = Field(description="Standard deviation before clipping [N m].")
    hold: Positive = Field(0.01, description="Time each value lasts, a whole multiple of run.control_period [s].")
    clip_sigma: Positive = Field(3.0, description="Values are clipped at this many standard deviations [1].")


class Bias(AnyDisturbance):
    """Constant torque."""

    kind: Literal["bias"] = Field(description="Form of the disturbance.")
    value: AnyVector = Field(description="Torque [N m], in N for slide joints.")


class Sinusoid(AnyDisturbance):
    """Torque a sin(2 pi f t), held from each control instant to the next."""

    kind: Literal["sinusoid"] = Field(description="Form of the disturbance.")
    amplitude: AnyVector | None = Field(
        None, description="Amplitude a, unless rms gives it [N m], in N for slide joints."
    )
    rms: NotNegativeVector | None = Field(
        None, description="Root mean square of the torque, a/sqrt(2), unless amplitude is given [N m]."
    )
    frequency_hz: PositiveVector = Field(1.0, description="Frequency f, less than half of 1/run.control_period [Hz].")


Disturbance: TypeAlias = BandLimitedNoise | Bias | Sinusoid
