"""Compare two models or plants: which term differs, by how much, on which joint."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from torquebench import references
from torquebench.errors import ConfigError, ModelError, Problem, did_you_mean
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references.reference import against_rate
from torquebench.robot import RobotModel, load_model
from torquebench.robot.flat_model import STRUCTURES, own_copy
from torquebench.robot.library import ArmFile, ArmSource, is_path
from torquebench.robot.missing_terms import DEGREES, Arm, Explained, States, Term, missing_terms
from torquebench.sim.plants import Plant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

if TYPE_CHECKING:
    from torquebench.robot.mjcf_written import Written

ROLLOUT_TOLERANCE = 1e-12
"""Largest joint-angle gap of two closed loops that still counts as agreement [rad]."""
STEP_TOLERANCE = 1e-11
"""Largest torque that one step from equal states may leave unexplained, over the loop's own, to count as agreement."""
ROUNDINGS = 8.0
"""Number of roundings that the velocities of such a step may suffer."""
STEPS = 500
"""Control instants of each closed loop from which one step is compared."""
START = 0.01
"""Position at which the closed loops start [rad]: not zero, where s is nothing but the sign of round-off."""
ULP = 2.0**-52
"""Offset of the second start where the loop of one plant is compared with itself [rad]."""
AMPLIFIED = 1e3
"""Times more than a plant apart from itself may two plants be apart for round-off to explain it: ULP enters that loop
once, rounding at each of thousands of steps."""
ROLLOUT_LAWS = (("sign", "smc"), ("linear band", "linear-band-smc"))
"""Laws of the closed loops, title and name; their gains are chosen for the arm."""
ROLLOUT_MOTIONS = ("sine", "step", "ramp")
LOOPS = len(ROLLOUT_LAWS) * len(ROLLOUT_MOTIONS)
"""Number of closed loops on each side."""
SPEED, ACCELERATION = 3.0, 5.0
"""Random states: |qd| [rad/s] and |qdd| [rad/s^2] up to these, positions over the full circle."""
ENGINES = ("mujoco", "analytic")


class Dynamics(Protocol):
    """Terms of the dynamics, each for a batch of states (N, n)."""

    n: int
    joint_names: tuple[str, ...]

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """M(q), (N, n, n) [kg m^2]."""
        ...

    def bias_forces(self, q: npt.ArrayLike, qd: npt.ArrayLike) -> Array:
        """N(q, qd), (N, n) [N m]."""
        ...

    def gravity(self, q: npt.ArrayLike) -> Array:
        """g(q), (N, n) [N m]."""
        ...

    def inverse_dynamics(self, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike) -> Array:
        """Torque for the acceleration `qdd`, (N, n) [N m]."""
        ...

    def forward_kinematics(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool, (N, 4, 4) [-, m]."""
        ...


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a comparison."""

    label: str
    """As the user wrote it."""
    engine: str
    """``mujoco`` or ``analytic``."""
    source: ArmSource
    """Model name, path of an MJCF file, or what an import makes of one."""
    dynamics: Any
    """Terms of the dynamics; see `Dynamics`."""
    links: RobotModel | None
    """Link parameters behind it; None for closed forms, which have none."""
    written: Written | None = None
    """MuJoCo's arm with what plants of the testbed leave out, where the side is a file."""

    def arm(self, states: States) -> Arm:
        """Return what its missing terms are named by: of a file all that it has, else what the testbed takes of it."""
        q, qd, qdd = states
        pose = self.dynamics.forward_kinematics(q)
        if self.written is not None:
            return Arm(self.links, self.written, self.written.torque(q, qd, qdd), pose)
        torque = self.dynamics.inverse_dynamics(q, qd, qdd)
        friction = getattr(self.dynamics, "passive", None)
        if friction is not None:
            torque = torque + np.array(friction.viscous) * qd + np.array(friction.coulomb) * np.sign(qd)
        return Arm(self.links, None, torque, pose)

    def plant(self, timestep: float) -> Plant:
        """Return this side as a plant, RK4."""
        if self.engine == "mujoco":
            from torquebench.sim.plants.mujoco import MujocoPlant

            return MujocoPlant(self.source, timestep)
        from torquebench.sim.plants.analytic import AnalyticPlant

        return AnalyticPlant(self.dynamics, timestep)


def parse_side(text: str, argument: str) -> Side:
    """Read ``mujoco:MODEL``, ``analytic:MODEL[:STRUCTURE[:CONSTANTS]]`` or a file.

    Args:
        text: What the user wrote.
        argument: Name of the argument, for messages.

    Raises:
        ConfigError: it is none of these, or the model cannot be used.
    """
    engine, _, rest = text.partition(":")
    if is_path(text):
        engine, rest = ("mujoco", text) if engine not in ENGINES else (engine, rest)
    try:
        if engine == "mujoco":
            return _mujoco_side(text, rest)
        if engine == "analytic":
            source, *more = rest.split(":")
            if len(more) > 2:
                raise ModelError("too many parts, wanted analytic:MODEL[:STRUCTURE[:CONSTANTS]]")
            if more and more[0] not in STRUCTURES:
                raise ModelError(f"unknown structure '{more[0]}'{did_you_mean(more[0], STRUCTURES)}")
            model = load_model(source, *more)
            exact = not more or more[0] == "exact"
            return Side(text, engine, source, model, model if exact else None)
        raise ModelError(
            f"unknown engine '{engine}', wanted mujoco:MODEL, analytic:MODEL[:STRUCTURE[:CONSTANTS]] or a file"
            + did_you_mean(engine, ENGINES)
        )
    except (ModelError, ValueError) as error:
        reasons, source = getattr(error, "reasons", (str(error),)), f"{source_of(text)}: "
        raise ConfigError([Problem(argument, text, reason.removeprefix(source)) for reason in reasons]) from error


def parse_sides(first: str, second: str, places: tuple[str, str]) -> tuple[Side, Side]:
    """Return both sides of a comparison.

    Args:
        first, second: What is compared; see `parse_side`.
        places: What each is called in messages.

    Raises:
        ConfigError: one of them cannot be compared, or neither; the mistakes of both at once.
    """
    sides: list[Side] = []
    problems: list[Problem] = []
    for text, place in zip((first, second), places, strict=True):
        try:
            sides.append(parse_side(text, place))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return sides[0], sides[1]


def source_of(text: str) -> str:
    """Name or file of the model in a side's text."""
    engine, _, rest = text.partition(":")
    return rest.split(":")[0] if engine in ENGINES else text


BEYOND = ("springs", "fluid", "gravcomp", "nonlinear-damping")
"""Features that a file may have although no plant does: its missing terms are named all the same."""


def _mujoco_side(text: str, source: str) -> Side:
    from torquebench.robot import mjcf
    from torquebench.robot.mjcf_written import written
    from torquebench.sim.plants.mujoco import MujocoModel

    try:
        arm = mjcf.read_arm(source)
    except ModelError as refused:
        if text != source:
            raise
        from torquebench.robot.importing import Options, import_arm

        try:
            made = import_arm(Path(source), Options(drop=BEYOND))
        except ModelError:
            raise refused from None
        arm = mjcf.read_arm(ArmFile(made.name, made.mjcf))
    compiled, passive = mjcf.compile_arm(arm)
    links = RobotModel(source, tuple(mjcf.joint_names(compiled)), mjcf.flatten(compiled, source), passive)
    file = written(arm, Path(source) if text == source else None)
    return Side(text, "mujoco", arm, MujocoModel(arm), links, file)


@dataclass(frozen=True, slots=True)
class Row:
    """One compared quantity."""

    term: str
    unit: str
    absolute: float
    """Largest difference of one element."""
    relative: float
    """Largest norm of the difference at a state, over the root mean square of the norm of A's value."""
    where: str
    """Element with the largest difference."""
    limit: float
    """Largest value of `relative` (for rollouts: of `absolute`) that counts as agreement."""
    measure: str = "relative"
    """Name of the field that is held against the limit: ``relative`` or ``absolute``."""
    own: float | None = None
    """Of a closed loop, how far A comes apart from itself when it starts `ULP` beside where it did [rad]."""
    growth: float | None = None
    """Of a closed loop, the rate at which it does, ln(own / ULP) over its length [1/s]; 0 where it does not."""

    @property
    def verdict(self) -> str:
        """Verdict: ``agrees``, ``differs``, or ``undecided`` for a closed loop that amplifies round-off.

        A loop is undecided where the two are farther apart than the limit, and no more than `AMPLIFIED` times as far
        as A is from itself: that says something about the loop, nothing about the two. NaN differs.
        """
        value = getattr(self, self.measure)
        if value <= self.limit:
            return "agrees"
        amplified = self.own is not None and value <= AMPLIFIED * self.own
        return "undecided" if amplified else "differs"

    @property
    def agrees(self) -> bool:
        """Whether the row shows no difference: it agrees, or is undecided."""
        return self.verdict != "differs"

    def to_json(self) -> dict[str, Any]:
        """Return its fields and the verdict."""
        return asdict(self) | {"agrees": self.agrees, "verdict": self.verdict}


class Comparison(NamedTuple):
    """Result of a comparison: its rows, and the terms that differ."""

    rows: list[Row]
    named: Explained
    """The terms that differ."""

    @property
    def agree(self) -> bool:
        """Whether the comparison shows no difference."""
        return not self.named.terms and all(row.agrees for row in self.rows)

    @property
    def sentence(self) -> str:
        """The difference in one line, for whoever has to fix it."""
        told = "; ".join(map(str, self.named.terms))
        if self.named.whole:
            if told:
                return f"B differs from A by {told}"
            return "no difference" if self.agree else "no term: no torque at the joints shows what differs"
        missed = f"{100.0 * self.named.left:.3g} % of the difference in torque is not one of the terms that are known"
        return f"B differs from A by {told}; {missed}" if told else missed


def compare(
    a: Side,
    b: Side,
    *,
    states: int = 1000,
    seed: int = 0,
    tolerance: float = 1e-6,
    frozen: Sequence[int] = (),
    rollout: float = 0.0,
    motion: Motion | None = None,
    progress: Callable[[str], None] = lambda loop: None,
) -> Comparison:
    """Compare two models or plants: every term of the dynamics, link parameters, and closed loops if asked for.

    Args:
        a, b: The two sides, with the same joints; see `parse_side`.
        states: Number of random states.
        seed: Seed of the states.
        tolerance: Relative difference that counts as agreement.
        frozen: Joints, counted from 0, at zero position and speed.
        rollout: Length of the closed loops [s]; 0 for none.
        motion: A motion whose states take the place of the random ones.
        progress: Called with the name of each closed loop before it runs.
    """
    drawn = random_states(a.dynamics.n, states, seed, frozen) if motion is None else motion[1:]
    rows = compare_terms(a.dynamics, b.dynamics, drawn, tolerance)
    if a.links is not None and b.links is not None:
        rows += compare_links(a.links, b.links, tolerance)
    if rollout > 0:
        rows += compare_rollouts(a, b, slightly_wrong(a, b), rollout, progress=progress)
    return Comparison(rows, name_terms(a, b, drawn, motion, tolerance))


TINY = 1e-300
NAMED = 40
"""Number of states by which missing terms are named."""


def name_terms(a: Side, b: Side, states: States, motion: Motion | None = None, tolerance: float = 0.0) -> Explained:
    """Return the terms in which two sides differ, friction, springs, gears and integrator included; see `Explained`.

    A side that is a file stands for all that it has, ``mujoco:FILE`` and ``analytic:FILE`` for what the testbed takes.

    Args:
        a, b: The two sides, with the same joints.
        states: Positions, velocities and accelerations, each (N, n); `NAMED` of them are used.
        motion: The motion that the states are of, if they are: whether its velocity is its position's derivative.
        tolerance: Share of the torque that counts as no difference.
    """
    q, qd, qdd = (each[:: -(-len(each) // NAMED)] for each in states)
    some = q, qd, qdd
    named = missing_terms(a.arm(some), b.arm(some), some, a.dynamics.joint_names, tolerance)
    if motion is None:
        return named
    return named._replace(terms=(*rate_terms(motion, a.dynamics.joint_names), *named.terms))


class Motion(NamedTuple):
    """A sampled motion."""

    t: Array
    """Instants, evenly spaced, (N,) [s]."""
    q: Array
    """Positions, (N, n) [rad]."""
    qd: Array
    """Velocities, (N, n) [rad/s]."""
    qdd: Array
    """Accelerations, (N, n) [rad/s^2]."""


def read_motion(path: str, n: int, argument: str) -> Motion:
    """Read a motion from a CSV file with the columns t, q1 to qN, qd1 to qdN and, if it likes, qdd1 to qddN.

    Args:
        path: The file.
        n: Number of joints.
        argument: Name of the argument, for messages.

    Raises:
        ConfigError: there is no such file, or something else is in it.
    """
    try:
        with Path(path).open(encoding="utf-8") as file:
            header = [word.strip() for word in file.readline().split(",")]
            table = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, ValueError) as error:
        raise ConfigError([Problem(argument, path, f"cannot be read: {error}")]) from error
    wanted = ["t", *(f"{name}{j}" for name in ("q", "qd") for j in range(1, n + 1))]
    if missing := [name for name in wanted if name not in header]:
        raise ConfigError([Problem(argument, path, f"has no column {', '.join(missing)}")])
    if len(table) < 3 or table.shape[1] != len(header) or not np.all(np.isfinite(table)):
        raise ConfigError([Problem(argument, path, f"wanted 3 rows or more of {len(header)} finite numbers")])

    def columns(name: str) -> Array:
        return np.ascontiguousarray(table[:, [header.index(f"{name}{j}") for j in range(1, n + 1)]])

    t = table[:, header.index("t")]
    if not (t[1] > t[0] and np.allclose(np.diff(t), t[1] - t[0], rtol=1e-6, atol=0.0)):
        raise ConfigError([Problem(argument, path, "column t: wanted times evenly spaced and rising")])
    qd = columns("qd")
    has = all(f"qdd{j}" in header for j in range(1, n + 1))
    return Motion(t, columns("q"), qd, columns("qdd") if has else np.gradient(qd, t, axis=0))


def rate_terms(motion: Motion, names: Sequence[str]) -> list[Term]:
    """Return each joint of a motion whose velocity is not the derivative of its position, and what it is instead."""
    h, found = float(motion.t[1] - motion.t[0]), list[Term]()
    change, integral, excess = against_rate(h, motion.q, motion.qd)
    known = {1.0 / DEGREES: "rad/s beside degrees?", DEGREES: "degrees/s beside radians?", -1.0: "the opposite sign"}
    for j in np.flatnonzero(np.max(excess, axis=0) > 1.0).tolist():
        k = int(np.argmax(excess[:, j]))
        factor = float(change[:, j] @ integral[:, j]) / max(float(change[:, j] @ change[:, j]), TINY)
        left = float(np.linalg.norm(integral[:, j] - factor * change[:, j]))
        if left <= 0.01 * float(np.linalg.norm(integral[:, j])) and factor != 0.0:
            text = f"{factor:.6g} times the derivative of the position"
            text += "".join(f": {words}" for ratio, words in known.items() if abs(factor / ratio - 1.0) < 0.01)
        else:
            text = (
                f"not the derivative of the position: at t = {motion.t[k + 1]:g} s this changes by {change[k, j]:.4g} "
                f"rad, the velocity integrates to {integral[k, j]:.4g} rad"
            )
        found.append(Term("reference velocity", f"joint '{names[j]}'", text))
    return found


def random_states(n: int, count: int, seed: int, frozen: Sequence[int] = ()) -> tuple[Array, Array, Array]:
    """Return positions [rad], velocities [rad/s] and accelerations [rad/s^2], each (count, n).

    Args:
        n: Number of joints.
        count: Number of states.
        seed: Seed of the states.
        frozen: Joints, counted from 0, at zero position and speed.
    """
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, n))
    qd = rng.uniform(-SPEED, SPEED, (count, n))
    qdd = rng.uniform(-ACCELERATION, ACCELERATION, (count, n))
    q[:, list(frozen)] = qd[:, list(frozen)] = 0.0
    return q, qd, qdd


def compare_terms(a: Dynamics, b: Dynamics, states: tuple[Array, Array, Array], tolerance: float) -> list[Row]:
    """Compare every term of the dynamics over a batch of states.

    Args:
        a, b: The two sides, with the same joints.
        states: Positions, velocities and accelerations, each (N, n).
        tolerance: Relative difference that counts as agreement.
    """
    q, qd, qdd = states
    gravity_a, gravity_b = a.gravity(q), b.gravity(q)
    torque_a = a.inverse_dynamics(q, qd, qdd)
    # a term that is zero but for round-off (gravity of a vertical axis) is held to the arm's torques
    floor = {"N m": 1e-3 * _typical(torque_a)}
    pairs = (
        ("mass matrix", "kg m^2", a.mass_matrix(q), b.mass_matrix(q)),
        ("gravity", "N m", gravity_a, gravity_b),
        ("Coriolis + centrifugal", "N m", a.bias_forces(q, qd) - gravity_a, b.bias_forces(q, qd) - gravity_b),
        ("inverse dynamics", "N m", torque_a, b.inverse_dynamics(q, qd, qdd)),
        ("tool pose", "-, m", a.forward_kinematics(q), b.forward_kinematics(q)),
    )
    return [_row(term, unit, x, y, tolerance, floor.get(unit, 0.0)) for term, unit, x, y in pairs]


def compare_links(a: RobotModel, b: RobotModel, tolerance: float) -> list[Row]:
    """Compare the link parameters themselves: some inertias (link 1's Ixx, say) no joint torque can show.

    Args:
        a, b: Two models with link parameters in the same frames.
        tolerance: Relative difference that counts as agreement.
    """
    parameters = (
        ("link masses", "kg", "mass"),
        ("centres of mass", "m", "com"),
        ("link inertias", "kg m^2", "inertia"),
        ("armatures", "kg m^2", "armature"),
        ("torque limits", "N m", "tau_max"),
    )
    return [_row(title, unit, getattr(a.flat, key), getattr(b.flat, key), tolerance) for title, unit, key in parameters]


def slightly_wrong(a: Side, b: Side) -> RobotModel:
    """Return the model the laws use on both plants: links 5 % too heavy.

    With a perfect model s is mere round-off while the arm rests, and its sign differs between any two plants.
    """
    true = a.links or b.links
    if true is None:
        closed_form: RobotModel = a.dynamics
        return closed_form
    flat = own_copy(true.flat, mass=1.05 * true.flat.mass, inertia=1.05 * true.flat.inertia)
    return RobotModel(true.name, true.joint_names, flat)


def compare_rollouts(
    a: Side,
    b: Side,
    model: RobotModel,
    duration: float,
    timestep: float = 0.001,
    progress: Callable[[str], None] = lambda loop: None,
) -> list[Row]:
    """Compare closed loops on both plants, linear band and sign, on `sine`, `step` and `ramp`, and single steps.

    The law computes with the same `model` on both sides; only the plants differ. RK4, zero-order hold. Gains are chosen
    for the model. A loop is also run on A from a start `ULP` beside, and from states of A's run, `STEPS` a loop, B is
    stepped once with A's torque: what that leaves of position, and of torque, M (qd_B - qd_A) / timestep, in which no
    loop amplifies anything.

    Args:
        a, b: The two sides.
        model: The law's belief.
        duration: Length of each loop [s].
        timestep: Integration step and control period [s].
        progress: Called with the name of each loop before it runs.
    """
    n, rows, steps = model.n, list[Row](), list[tuple[Row, Row]]()
    odd = np.arange(n) % 2 == 1
    motions = (
        references.Sine(tuple(np.where(odd, -1.0, 1.2)), tuple(0.4 + 0.6 * (np.arange(1, n + 1) / n))),
        references.Step(tuple(np.where(odd, -0.8, 0.8)), 0.2),
        references.Ramp(tuple(np.where(odd, -1.5, 1.5)), 3.0),
    )
    plant_a, plant_b = a.plant(timestep), b.plant(timestep)
    start = np.full(n, START)
    for title, law in ROLLOUT_LAWS:
        controller = Controller.of(law, n, find_law(law).choose_gains(model, timestep), name=title)
        for name, motion in zip(ROLLOUT_MOTIONS, motions, strict=True):
            progress(f"{title}, {name}")
            x, y, beside = (
                simulate(
                    plant,
                    controller,
                    model,
                    motion,
                    duration=duration,
                    control_period=timestep,
                    initial_q=begin,
                    throw=False,
                )
                for plant, begin in ((plant_a, start), (plant_b, start), (plant_a, start + ULP))
            )
            rows.append(_rollout_row(f"closed loop, {title}, {name}", x, y, beside))
            if x.completed:
                steps.append(_one_step(x, plant_b, model, timestep))
    return [_worst(each) for each in zip(*steps, strict=True)] + rows


def _rollout_row(term: str, x: Trajectory, y: Trajectory, beside: Trajectory) -> Row:
    nan = float("nan")
    if not (x.completed and y.completed):
        ends = ", ".join(f"{side} {run.outcome.name} at {run.t[-1]:g} s" for side, run in (("A", x), ("B", y)))
        return Row(term, "rad", nan, nan, ends, ROLLOUT_TOLERANCE, "absolute")
    row = replace(_row(term, "rad", x.q, y.q, ROLLOUT_TOLERANCE), measure="absolute")
    if not beside.completed:
        return row
    own = float(np.max(np.abs(x.q - beside.q)))
    length = float(x.t[-1] - x.t[0]) or 1.0
    return replace(row, own=own, growth=max(0.0, float(np.log(max(own, ULP) / ULP))) / length)


def _one_step(x: Trajectory, plant: Plant, model: RobotModel, timestep: float) -> tuple[Row, Row]:
    """Return what one step of a plant from states of a run leaves, of position and of torque.

    Velocities of size v, and changes of velocity of size v, are rounded by v `ULP`, which is a torque of |M| v ULP /
    timestep: a few of them are allowed.
    """
    instants = np.unique(np.linspace(0, len(x.t) - 2, STEPS).astype(int))
    q, qd = np.empty((2, len(instants), model.n))
    for i, k in enumerate(instants):
        plant.reset(x.q[k], x.qd[k])
        plant.step(x.tau[k], 1)
        q[i], qd[i] = plant.state()
    M, tau = model.mass_matrix(x.q[instants]), x.tau[instants]
    missing = np.einsum("kij,kj->ki", M, qd - x.qd[instants + 1]) / timestep
    speeds = np.abs(x.qd[instants]) + np.abs(x.qd[instants + 1] - x.qd[instants])
    rounding = ROUNDINGS * ULP * _typical(np.abs(M) @ speeds[:, :, None]) / timestep
    limit = STEP_TOLERANCE + rounding / max(_typical(tau), rounding)
    position = _row("one step, position", "rad", x.q[instants + 1], q, ROLLOUT_TOLERANCE)
    return replace(position, measure="absolute"), _row("one step, torque", "N m", tau, tau + missing, limit)


def _worst(rows: Iterable[Row]) -> Row:
    return max(rows, key=lambda row: getattr(row, row.measure) / row.limit)


def _typical(x: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(x.reshape(len(x), -1) ** 2, axis=1))))


def _row(term: str, unit: str, x: Array, y: Array, limit: float, floor: float = 0.0) -> Row:
    if x.shape != y.shape:
        return Row(term, unit, float("nan"), float("nan"), f"shapes {x.shape} and {y.shape}", limit)
    gap = np.abs(x - y)
    missed = np.linalg.norm(gap.reshape(len(x), -1), axis=1)
    # over the typical, not the state's own size: at some state a term is zero, and any difference infinite
    scale = max(_typical(x), floor)
    largest = float(np.max(missed))
    relative = largest / scale if scale > 0 else (0.0 if largest == 0 else float("inf"))
    worst = np.unravel_index(int(np.argmax(gap)), gap.shape)
    element = ", ".join(str(i + 1) for i in worst[1:]) or str(worst[0] + 1)
    return Row(term, unit, float(np.max(gap)), relative, element, limit)
