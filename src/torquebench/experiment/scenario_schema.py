"""Keys of what a law has to cope with: sensors, actuators, disturbances, and a model that is wrong on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from torquebench.errors import Fault
from torquebench.keys import Key, Kinds, Vector
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.timing import Timing, control_instant, multiple_of

disturbance = Kinds("disturbance")


@dataclass(frozen=True)
class Chain:
    """Sensors and actuators, each imperfection by itself; the same on every joint."""

    encoder_noise: Annotated[
        float,
        Key(
            "Standard deviation of the noise added to each measured position at each control instant", "rad", at_least=0
        ),
    ] = 0.0
    quantisation: Annotated[
        float,
        Key(
            "Step of the encoders: the measured position, noise included, is rounded to a whole multiple of it; 0 for "
            "none",
            "rad",
            at_least=0,
        ),
    ] = 0.0
    velocity: Annotated[
        Literal["exact", "differentiated"],
        Key(
            "Measured velocity: exact is the true one; differentiated is the change of the measured position since the "
            "last control instant over run.control_period, zero at first"
        ),
    ] = "exact"
    velocity_filter: Annotated[
        float | None,
        Key(
            "Corner of a first-order filter through which the differentiated velocity passes; if left out there is "
            "none",
            "rad/s",
            above=0,
        ),
    ] = None
    delay: Annotated[
        float,
        Key(
            "Time after which the law sees a measurement, less than run.duration and a whole multiple of "
            "run.control_period; until then it sees that of t = 0",
            "s",
            at_least=0,
        ),
    ] = 0.0
    actuator_lag: Annotated[float, Key("Time constant of the actuators; 0 for none", "s", at_least=0)] = 0.0

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the chain, or the run."""
        if self.velocity == "exact" and self.velocity_filter is not None:
            text = "has no effect with velocity: exact (it belongs to velocity: differentiated)"
            yield Fault(("velocity_filter",), text, at="key")
        yield from control_instant(("delay",), self.delay, timing)


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


class AnyDisturbance:
    """What every disturbance has."""

    kind: ClassVar[str]
    channel: ClassVar[str] = "torque"
    also: ClassVar = {"channel": "What it is added to: the joint torque, after saturation and actuator lag"}


@disturbance("band-limited-noise")
@dataclass(frozen=True)
class BandLimitedNoise(AnyDisturbance):
    """Gaussian torque, each value held for a while."""

    sigma: Annotated[Vector, Key("Standard deviation before clipping", "N m", at_least=0)]
    hold: Annotated[float, Key("Time each value lasts, a whole multiple of run.control_period", "s", above=0)] = 0.01
    clip_sigma: Annotated[float, Key("Values are clipped at this many standard deviations", "1", above=0)] = 3.0

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield a fault where a value does not last whole control periods."""
        if timing.whole:
            period = ("run", "control_period")
            yield from multiple_of(("hold",), self.hold, "run.control_period", timing.control_period, period)


@disturbance("bias")
@dataclass(frozen=True)
class Bias(AnyDisturbance):
    """Constant torque."""

    value: Annotated[Vector, Key("Torque", "N m", ", in N for slide joints")]


@disturbance("sinusoid")
@dataclass(frozen=True)
class Sinusoid(AnyDisturbance):
    """Torque a sin(2 pi f t), held from each control instant to the next."""

    amplitude: Annotated[Vector | None, Key("Amplitude a, unless rms gives it", "N m", ", in N for slide joints")] = (
        None
    )
    rms: Annotated[
        Vector | None,
        Key("Root mean square of the torque, a/sqrt(2), unless amplitude is given", "N m", at_least=0),
    ] = None
    frequency_hz: Annotated[Vector, Key("Frequency f, less than half of 1/run.control_period", "Hz", above=0)] = 1.0

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit: two sizes, none, or a frequency that cannot be sampled."""
        if self.amplitude is None and self.rms is None:
            yield Fault((), "missing: amplitude, or rms (size of the sinusoid [N m])")
        elif self.amplitude is not None and self.rms is not None:
            yield Fault(("rms",), "amplitude is given already", wanted="one of the two", at="key")
        highest = max(self.frequency_hz) if isinstance(self.frequency_hz, tuple) else self.frequency_hz
        most = 0.5 / timing.control_period
        if highest >= most:
            wanted = f"less than half of 1/run.control_period, {most:g} Hz"
            period = ("run", "control_period")
            yield Fault(("frequency_hz",), got=f"{highest:g} Hz", wanted=wanted, unless=period)


Disturbance = BandLimitedNoise | Bias | Sinusoid
ChainName = Literal["ideal", "fast", "slow"]
