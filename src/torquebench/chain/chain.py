"""The chain between a law and the plant: the keys of its sensors and drives, and the chains that configs name."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple, get_args

import numpy as np

from torquebench.chain.drives import CrossTalk, CurrentLoop, Derating, Drives, ThermalLimit, TorqueSpeed
from torquebench.chain.sensors import KALMAN, VELOCITIES, Ripple, Sensors, kalman_gains
from torquebench.disturbances import Stream, generator
from torquebench.errors import Fault
from torquebench.kernel import Array, IntArray
from torquebench.keys import Key, Units, Vector, as_vector, check_numbers, in_words
from torquebench.registry import Registry, docstring
from torquebench.timing import Timing, control_instant, multiple_of, substeps_per_period, whole_steps

VelocityName = Literal["exact", "differentiated", "tachometer", "kalman"]


class Drawn(NamedTuple):
    """Random values that a chain draws for one run of N control instants and n joints; None for those that it lacks."""

    position: Array | None = None
    """Noise of the encoders, (N, n) [rad]."""
    velocity: Array | None = None
    """Noise of the tachometers, (N, n) [rad/s]."""
    late: Array | None = None
    """Time by which each command is late, (N,) [s]; infinite where it is missed."""


NOTHING = Drawn()
"""Nothing drawn."""


@dataclass(frozen=True)
class Chain:
    """Sensors and actuators, each imperfection by itself; a single number stands for every joint.

    Raises:
        ValueError: a number is out of range or not finite, or there is no such kind of velocity.
    """

    encoder_noise: Annotated[
        float,
        Key(
            "Standard deviation of the noise added to each measured position at each control instant",
            "rad",
            at_least=0,
        ),
    ] = 0.0
    encoder_offset: Annotated[Vector, Key("Constant error of the measured position", "rad")] = 0.0
    encoder_ripple: Annotated[Ripple | None, Key("Periodic error of the measured position")] = None
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
        VelocityName,
        Key(
            "Measured velocity: exact is the true one; differentiated is the change of the measured position since the "
            "last control instant over run.control_period, zero at first; tachometer is the true one with noise; "
            "kalman is that of a steady Kalman filter of the measured position"
        ),
    ] = "exact"
    velocity_filter: Annotated[
        float | None,
        Key(
            "Corner of a first-order filter through which the differentiated velocity, or that of a tachometer, "
            "passes; if left out there is none",
            "rad/s",
            above=0,
        ),
    ] = None
    velocity_noise: Annotated[
        float,
        Key("Standard deviation of the noise of tachometers at each control instant", "rad/s", at_least=0),
    ] = 0.0
    kalman_acceleration: Annotated[
        float | None,
        Key(
            "Standard deviation of the acceleration that the Kalman filter expects, from one control instant to the "
            "next; its noise is that of encoder_noise and of the rounding, quantisation/sqrt(12)",
            "rad/s^2",
            above=0,
        ),
    ] = None
    measurement_delay: Annotated[
        float,
        Key(
            "Time after which the law sees a measurement, less than run.duration and a whole multiple of "
            "run.control_period; until then it sees that of t = 0",
            "s",
            at_least=0,
        ),
    ] = 0.0
    command_filter: Annotated[
        float | None,
        Key(
            "Corner of a first-order filter of the law's commands ahead of torque_rate, as a robot's own interface has "
            "it; if left out there is none",
            "rad/s",
            above=0,
        ),
    ] = None
    torque_rate: Annotated[
        Vector | None,
        Key(
            "Fastest change of the command: from one control instant to the next at most this times "
            "run.control_period; if left out there is no limit",
            "N m/s",
            ", in N/s for slide joints",
            above=0,
        ),
    ] = None
    missed_deadlines: Annotated[
        float,
        Key(
            "Share of the commands that come too late and are lost: the one before is held", "1", at_least=0, at_most=1
        ),
    ] = 0.0
    jitter: Annotated[
        float,
        Key(
            "Each command comes into force after its control instant by a time drawn evenly from 0 to this, in whole "
            "steps of plant.timestep; at most run.control_period",
            "s",
            at_least=0,
        ),
    ] = 0.0
    command_delay: Annotated[
        float,
        Key(
            "Time after which a command reaches the drives, less than run.duration and a whole multiple of "
            "run.control_period; until then they have the first one",
            "s",
            at_least=0,
        ),
    ] = 0.0
    torque_quantum: Annotated[
        float,
        Key("Step of the drives: commands are rounded to a whole multiple of it; 0 for none", "N m", at_least=0),
    ] = 0.0
    torque_gain: Annotated[
        Vector, Key("Torque of the drives for 1 N m of command: 1 unless they are badly calibrated", "1", at_least=0)
    ] = 1.0
    torque_offset: Annotated[Vector, Key("Torque that the drives add to every command", "N m")] = 0.0
    actuator_lag: Annotated[float, Key("Time constant of the actuators; 0 for none", "s", at_least=0)] = 0.0
    current_loop: Annotated[CurrentLoop | None, Key("Torque loop of second order, in place of actuator_lag")] = None
    torque_speed: Annotated[TorqueSpeed | None, Key("Torque that the motors can give at a speed")] = None
    thermal_limit: Annotated[ThermalLimit | None, Key("Torque that the motors can give for ever")] = None
    derating: Annotated[Derating | None, Key("Motors that weaken in the middle of a run")] = None
    cross_talk: Annotated[CrossTalk | None, Key("Torque that leaks from one joint to the next")] = None
    torque_delay: Annotated[
        float,
        Key(
            "Time after which the motors' torque acts on the joints, a whole multiple of plant.timestep; until then "
            "that of t = 0 acts",
            "s",
            at_least=0,
        ),
    ] = 0.0
    name: str = "custom"
    """Name under which it is registered."""

    def __post_init__(self) -> None:
        """Refuse sizes that mean nothing."""
        check_numbers(self)
        if self.velocity not in VELOCITIES:
            raise ValueError(f"chain: velocity is {self.velocity!r}, wanted one of {', '.join(get_args(VelocityName))}")

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the chain, or the run."""
        for key, kinds in (
            ("velocity_filter", ("differentiated", "tachometer")),
            ("velocity_noise", ("tachometer",)),
            ("kalman_acceleration", ("kalman",)),
        ):
            if getattr(self, key) and self.velocity not in kinds:
                text = f"has no effect with velocity: {self.velocity} (it belongs to velocity: {', '.join(kinds)})"
                yield Fault((key,), text, at="key")
        if self.velocity == "kalman" and self.kalman_acceleration is None:
            yield Fault(("kalman_acceleration",), "missing", at="key", wanted="a number, as velocity is kalman")
        if self.velocity == "kalman" and self.position_noise == 0.0:
            text = "needs noise to filter: wanted encoder_noise or quantisation above zero"
            yield Fault(("velocity",), text)
        if self.current_loop is not None and self.actuator_lag > 0.0:
            yield Fault(("actuator_lag",), "current_loop is given already", at="key", wanted="one of the two")
        for key in ("measurement_delay", "command_delay"):
            yield from control_instant((key,), getattr(self, key), timing)
        if timing.timestep is not None and timing.whole:
            if self.torque_delay:
                yield from multiple_of(("torque_delay",), self.torque_delay, "plant.timestep", timing.timestep)
            if self.jitter > timing.control_period:
                wanted = f"at most run.control_period, {timing.control_period:.12g} s"
                yield Fault(("jitter",), got=f"{self.jitter:.12g} s", wanted=wanted)
            elif 0.0 < self.jitter < timing.timestep:
                wanted = f"at least plant.timestep, {timing.timestep:.12g} s, or 0"
                yield Fault(("jitter",), got=f"{self.jitter:.12g} s", wanted=wanted)

    @property
    def is_random(self) -> bool:
        """Whether a run draws random numbers for this chain."""
        return any((self.encoder_noise, self.velocity_noise, self.jitter, self.missed_deadlines))

    @property
    def position_noise(self) -> float:
        """Standard deviation of the measured position, rounding included [rad]."""
        return math.hypot(self.encoder_noise, self.quantisation / math.sqrt(12.0))

    def draw(self, n: int, n_steps: int, seed: int, draw: int) -> Drawn:
        """Draw what is random in it for one run.

        Args:
            n: Number of joints.
            n_steps: Number of control instants N.
            seed, draw: Key of the random streams; see `generator`.
        """

        def normal(deviation: float, stream: Stream) -> Array | None:
            if deviation == 0.0:
                return None
            noise: Array = generator(seed, draw, stream).standard_normal((n_steps, n))
            noise *= deviation
            return noise

        late = None
        if self.jitter > 0.0 or self.missed_deadlines > 0.0:
            times, chances = generator(seed, draw, Stream.DEADLINES).random((2, n_steps))
            late = np.where(chances < self.missed_deadlines, np.inf, self.jitter * times)
        return Drawn(
            normal(self.encoder_noise, Stream.POSITION_NOISE), normal(self.velocity_noise, Stream.VELOCITY_NOISE), late
        )

    def sensors(self, n: int, control_period: float, drawn: Drawn) -> Sensors:
        """Return the sensors for kernels.

        Args:
            n: Number of joints.
            control_period: Control period T [s].
            drawn: What is drawn for the run.
        """
        none, ripple, alpha, beta = np.zeros((0, n)), self.encoder_ripple, 0.0, 0.0
        kind = VELOCITIES.index(self.velocity)
        if kind == KALMAN and self.kalman_acceleration is not None:
            alpha, beta = kalman_gains(self.kalman_acceleration, self.position_noise, control_period)
        parts = () if ripple is None else (ripple.amplitude, ripple.cycles, ripple.phase)
        return Sensors(
            noise=none if drawn.position is None else np.ascontiguousarray(drawn.position, dtype=np.float64),
            offset=_each(self.encoder_offset, n),
            ripple=np.array([as_vector(part, n) for part in parts]).reshape(-1, n),
            quantum=self.quantisation,
            velocity=kind,
            gain=self.velocity_gain(control_period),
            velocity_noise=none if drawn.velocity is None else np.ascontiguousarray(drawn.velocity, dtype=np.float64),
            alpha=alpha,
            beta=beta,
            estimate=np.zeros(n if kind == KALMAN else 0),
        )

    def drives(self, n: int, n_steps: int, timestep: float, control_period: float, drawn: Drawn) -> Drives:
        """Return the drives for kernels.

        Args:
            n: Number of joints.
            n_steps: Number of control instants N.
            timestep: Physics step [s].
            control_period: Control period T [s].
            drawn: What is drawn for the run.
        """
        loop, speed, heat, square = self.current_loop, self.torque_speed, self.thermal_limit, np.zeros((0, 2))
        weak, talk, none = self.derating, self.cross_talk, np.zeros((0, n))
        commands = min(_steps(self.command_delay, control_period, "command_delay"), n_steps)
        torques = _steps(self.torque_delay, timestep, "torque_delay")
        drives = Drives(
            active=False,
            taken=self.command_gain(control_period),
            rate=np.zeros(0) if self.torque_rate is None else control_period * as_vector(self.torque_rate, n),
            decay=self.decay(timestep, control_period),
            late=late_steps(drawn.late, timestep, control_period),
            commands=np.zeros((commands, n)),
            quantum=self.torque_quantum,
            gain=np.zeros(0) if np.all(np.equal(self.torque_gain, 1.0)) else as_vector(self.torque_gain, n),
            offset=_each(self.torque_offset, n),
            half=square if loop is None else loop.transition(0.5 * timestep),
            whole=square if loop is None else loop.transition(timestep),
            corner=np.zeros(0) if speed is None else as_vector(speed.corner, n),
            no_load=np.zeros(0) if speed is None else as_vector(speed.no_load, n),
            continuous=np.zeros(0) if heat is None else as_vector(heat.torque, n),
            cooling=1.0 if heat is None else math.exp(-timestep / heat.time),
            fade_from=0 if weak is None else whole_steps(weak.at, timestep),
            fade_steps=0 if weak is None else whole_steps(weak.over, timestep),
            weaker=none if weak is None else np.array([as_vector(x, n) for x in (weak.limit, weak.gain)]),
            leaks=none if talk is None else np.array([as_vector(x, n) for x in (talk.following, talk.preceding)]),
            torques=np.zeros((torques, 3, n)),
            target=np.zeros(n),
            held=np.zeros(n),
            rising=np.zeros(n),
            heat=np.zeros(n),
        )
        parts = (drives.late, drives.commands, drives.gain, drives.offset, drives.half, drives.corner)
        more = (drives.continuous, drives.weaker, drives.leaks, drives.torques)
        active = drives.quantum > 0.0 or any(len(part) for part in (*parts, *more))
        return replace(drives, active=active)

    def velocity_gain(self, control_period: float) -> float:
        """Return the share a = 1 - exp(-rate T) of a new velocity that the filter takes in; 1 without a filter."""
        return 1.0 if self.velocity_filter is None else 1.0 - math.exp(-self.velocity_filter * control_period)

    def command_gain(self, control_period: float) -> float:
        """Return the share a = rate T/(1 + rate T) of a new command that its filter takes in; 1 without a filter."""
        ahead = 0.0 if self.command_filter is None else self.command_filter * control_period
        return 1.0 if self.command_filter is None else ahead / (1.0 + ahead)

    def lateness(self, control_period: float) -> float:
        """Return the time by which draws make a command late on average [s]: J/2 for a jitter J, T p/(1 - p) if p miss.

        Args:
            control_period: Control period T [s].
        """
        missed = self.missed_deadlines
        return 0.5 * self.jitter + control_period * missed / max(1.0 - missed, 1e-3)

    def reaction(self, control_period: float) -> float:
        """Return the time from a change of the state to the torque that answers it [s].

        The control period, the delays, the mean lateness of a command, the time constants of the velocity's filter,
        of that of commands and of the actuators, and for a Kalman filter T alpha/beta, by which its velocity is late on
        a steady acceleration.

        Args:
            control_period: Control period T [s].
        """
        filtering = 0.0 if self.velocity_filter is None else 1.0 / self.velocity_filter
        commanded = 0.0 if self.command_filter is None else 1.0 / self.command_filter
        if self.velocity == "kalman" and self.kalman_acceleration is not None:
            alpha, beta = kalman_gains(self.kalman_acceleration, self.position_noise, control_period)
            filtering = control_period * alpha / beta
        loop = self.current_loop
        acting = self.actuator_lag if loop is None else 2.0 * loop.damping / loop.frequency
        waiting = self.measurement_delay + self.command_delay + self.torque_delay + self.lateness(control_period)
        return control_period + waiting + filtering + commanded + acting

    def decay(self, timestep: float, control_period: float) -> Array:
        """Return the share of an actuator's lag left after half a physics step, a whole one, and on average.

        u(t) = tau + (u(0) - tau) exp(-t/lag); its mean over a control period T has (lag/T) (1 - exp(-T/lag)) in
        place of the exponential.

        Args:
            timestep: Physics step [s].
            control_period: Control period T [s].

        Returns:
            (3,), or (0,) without a lag.
        """
        lag = self.actuator_lag
        if lag == 0.0:
            return np.zeros(0)
        mean = -math.expm1(-control_period / lag) * lag / control_period
        return np.array([math.exp(-0.5 * timestep / lag), math.exp(-timestep / lag), mean])

    def measurement_steps(self, control_period: float) -> int:
        """Return the delay of measurements in control periods.

        Raises:
            ValueError: it is not a whole number of them.
        """
        return _steps(self.measurement_delay, control_period, "measurement_delay")

    def describe(self, units: Units) -> str:
        """Return its name, or its imperfections in one line."""
        named = self.name in CHAINS
        if named and not ABOUT[self.name].origins:
            return self.name
        parts = [f"noise {1e3 * self.encoder_noise:g} {units.milli}"] * (self.encoder_noise > 0)
        parts += [f"encoder offset {in_words(self.encoder_offset)} rad"] * bool(np.any(self.encoder_offset))
        if self.encoder_ripple is not None:
            parts.append(f"encoder ripple {in_words(self.encoder_ripple.amplitude)} rad")
        parts += [f"encoder step {1e3 * self.quantisation:g} {units.milli}"] * (self.quantisation > 0)
        if self.velocity != "exact":
            noisy = f" with noise {self.velocity_noise:g} rad/s" if self.velocity_noise else ""
            filtered = "" if self.velocity_filter is None else f", filtered at {self.velocity_filter:g} rad/s"
            by = {"differentiated": "differentiated", "tachometer": "by tachometer", "kalman": "by Kalman filter"}
            parts.append(f"velocity {by[self.velocity]}{noisy}{filtered}")
        parts += [f"measurement delay {1e3 * self.measurement_delay:g} ms"] * (self.measurement_delay > 0)
        if self.command_filter is not None:
            parts.append(f"commands filtered at {self.command_filter:g} rad/s")
        if self.torque_rate is not None:
            parts.append(f"torque rate {in_words(self.torque_rate)} {units.torque}/s")
        parts += [f"{100 * self.missed_deadlines:g} % of deadlines missed"] * (self.missed_deadlines > 0)
        parts += [f"jitter {1e3 * self.jitter:g} ms"] * (self.jitter > 0)
        parts += [f"command delay {1e3 * self.command_delay:g} ms"] * (self.command_delay > 0)
        parts += [f"torque step {self.torque_quantum:g} {units.torque}"] * (self.torque_quantum > 0)
        gained = np.any(np.not_equal(self.torque_gain, 1.0))
        parts += [f"torque gain {in_words(self.torque_gain)}"] * bool(gained)
        parts += [f"torque offset {in_words(self.torque_offset)} {units.torque}"] * bool(np.any(self.torque_offset))
        parts += [f"actuator lag {1e3 * self.actuator_lag:g} ms"] * (self.actuator_lag > 0)
        if self.current_loop is not None:
            loop = self.current_loop
            parts.append(f"current loop {loop.frequency:g} rad/s, damping {loop.damping:g}")
        if self.torque_speed is not None:
            parts.append(f"full torque up to {in_words(self.torque_speed.corner)} rad/s")
        if self.thermal_limit is not None:
            parts.append(f"continuous torque {in_words(self.thermal_limit.torque)} {units.torque}")
        if self.derating is not None:
            weak = self.derating
            ramp = f" within {weak.over:g} s" * (weak.over > 0)
            parts.append(
                f"torque limit x {in_words(weak.limit)} and torque x {in_words(weak.gain)} from {weak.at:g} s on{ramp}"
            )
        if self.cross_talk is not None:
            talk = self.cross_talk
            parts.append(f"cross-talk {in_words(talk.following)} back, {in_words(talk.preceding)} ahead")
        parts += [f"torque delay {1e3 * self.torque_delay:g} ms"] * (self.torque_delay > 0)
        text = f"({', '.join(parts)})" if parts else "ideal"
        return f"{self.name} {text}" if named else text


def _each(value: Vector, n: int) -> Array:
    """Return one number for each joint, (n,); of no elements where all are zero."""
    vector = as_vector(value, n)
    return vector if np.any(vector) else np.zeros(0)


def late_steps(late: Array | None, timestep: float, control_period: float) -> IntArray:
    """Return in physics steps by how much commands are late: to the nearest one; one more than a period if missed."""
    if late is None:
        return np.zeros(0, dtype=np.int64)
    never = control_period + timestep
    steps: IntArray = np.rint(np.where(np.isinf(late), never, np.minimum(late, control_period)) / timestep)
    return steps.astype(np.int64)


def _steps(time: float, step: float, key: str) -> int:
    """Return a time in whole steps.

    Raises:
        ValueError: it is not a whole number of them.
    """
    if time == 0.0:
        return 0
    return substeps_per_period(time, step, (f"the chain's {key}", "the step"))


CHAINS: Registry[Chain] = Registry("chain")
"""The chains that configs name."""


class Origin(NamedTuple):
    """Source of a number of a chain."""

    source: str
    """Document; or ``assumed:`` and why it has that size."""
    link: str = ""
    """Address of the document."""

    def __str__(self) -> str:
        """Return both in a line."""
        return f"{self.source} {self.link}".rstrip()


class About(NamedTuple):
    """Description of a named chain, with the sources of its numbers."""

    summary: str
    note: str = ""
    control_period: float | None = None
    """Control period of the robot [s]; None for a chain of no robot."""
    origins: Mapping[str, Origin] = MappingProxyType({})
    """Key, ``control_period`` among them, -> where its number comes from; empty for a chain of no robot."""


ABOUT: dict[str, About] = {}
"""Name of a chain -> what it stands for."""


def chain(
    name: str,
    control_period: float | None = None,
    origins: Mapping[str, Origin] = MappingProxyType({}),
) -> Callable[[Callable[[], Chain]], Callable[[], Chain]]:
    """Register the chain that a function returns under `name`, with the function's docstring as its summary.

    Args:
        name: Its name.
        control_period: Control period of the robot that has it [s].
        origins: Key -> where its number comes from.

    Raises:
        RegistryError: the name is taken, or is not a slug.
    """

    def register(make: Callable[[], Chain]) -> Callable[[], Chain]:
        CHAINS.register(name, replace(make(), name=name), make)
        summary, _, note = docstring(make).partition("\n\n")
        ABOUT[name] = About(" ".join(summary.split()), " ".join(note.split()), control_period, origins)
        return make

    return register


def period_of(name: str) -> float | None:
    """Return the control period of a named chain's robot [s]; None where the chain has none, or no name of its own."""
    return ABOUT[name].control_period if name in ABOUT else None


def rate_remarks(found: Chain, control_period: float) -> list[str]:
    """Return remarks on a chain: a robot's at another control period [s] than its own, noise that no velocity has."""
    if found.encoder_noise > 0.0 and found.velocity == "exact":
        noise = f"chain.encoder_noise of {1e3 * found.encoder_noise:g} mrad is in the measured position alone"
        return [f"{noise}: chain.velocity is exact, wanted differentiated or kalman for the velocity to have it"]
    own = period_of(found.name)
    if own is None or math.isclose(own, control_period, rel_tol=1e-9):
        return []
    times = f"{1e3 * own:g} ms, this run's {1e3 * control_period:g} ms"
    return [f"chain {found.name}: the robot's control period is {times} (run.control_period)"]


@chain("ideal")
def ideal() -> Chain:
    """Exact and instantaneous."""
    return Chain()


@chain("fast")
def fast() -> Chain:
    """Position with noise of 0.1 mrad, velocity differentiated and filtered at 500 rad/s, actuators lagging by 2 ms."""
    return Chain(encoder_noise=1e-4, velocity="differentiated", velocity_filter=500.0, actuator_lag=0.002)


@chain("slow")
def slow() -> Chain:
    """The same noise, velocity filtered at 200 rad/s, actuators lagging by 8 ms."""
    return Chain(encoder_noise=1e-4, velocity="differentiated", velocity_filter=200.0, actuator_lag=0.008)


@chain("slow-delay")
def slow_delay() -> Chain:
    """`slow` with measurements that come 2 ms late."""
    return replace(slow(), measurement_delay=0.002)


IDEAL = CHAINS["ideal"]
