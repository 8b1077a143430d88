"""Two models or plants side by side: which term differs, by how much, on which joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from torquebench import references
from torquebench.analysis.sides import Dynamics, Side
from torquebench.kernel import Array
from torquebench.robot.flat_model import own_copy
from torquebench.robot.robot_model import RobotModel
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

ROLLOUT_TOLERANCE = 1e-12
"""Largest joint-angle gap of two closed loops that still counts as agreement [rad]."""
ROLLOUT_LAWS: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("sign", "smc", {"lam": 10, "k": 0.3}),
    ("linear band", "linear-band-smc", {"lam": 10, "k": 0.3, "phi": 0.3, "kv": 20}),
)
"""Laws of the closed loops: title, name, gains."""
ROLLOUT_MOTIONS = ("sine", "step", "ramp")
LOOPS = len(ROLLOUT_LAWS) * len(ROLLOUT_MOTIONS)
"""Number of closed loops on each side."""
SPEED, ACCELERATION = 3.0, 5.0
"""Random states: |qd| [rad/s] and |qdd| [rad/s^2] up to these, positions over the full circle."""


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
    """Which of the two is held against the limit."""

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the limit; NaN is not."""
        return bool(getattr(self, self.measure) <= self.limit)


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
    """Compare closed loops on both plants, linear band and sign, on `sine`, `step` and `ramp`.

    The law computes with the same `model` on both sides; only the plants differ. RK4, zero-order hold.

    Args:
        a, b: The two sides.
        model: The law's belief.
        duration: Length of each loop [s].
        timestep: Integration step and control period [s].
        progress: Called with the name of each loop before it runs.
    """
    n, rows = model.n, []
    odd = np.arange(n) % 2 == 1
    motions = (
        references.sine(np.where(odd, -1.0, 1.2), 0.4 + 0.6 * (np.arange(1, n + 1) / n)),
        references.step(np.where(odd, -0.8, 0.8), 0.2),
        references.ramp(np.where(odd, -1.5, 1.5), 3.0),
    )
    plant_a, plant_b = a.plant(timestep), b.plant(timestep)
    for title, law, gains in ROLLOUT_LAWS:
        controller = Controller.of(law, n, gains, name=title)
        for name, motion in zip(ROLLOUT_MOTIONS, motions, strict=True):
            progress(f"{title}, {name}")
            runs = [
                simulate(p, controller, model, motion, duration=duration, control_period=timestep, throw=False)
                for p in (plant_a, plant_b)
            ]
            rows.append(_rollout_row(f"closed loop, {title}, {name}", *runs))
    return rows


def _rollout_row(term: str, x: Trajectory, y: Trajectory) -> Row:
    nan = float("nan")
    if not (x.completed and y.completed):
        ends = ", ".join(f"{side} {run.outcome.name} at {run.t[-1]:g} s" for side, run in (("A", x), ("B", y)))
        return Row(term, "rad", nan, nan, ends, ROLLOUT_TOLERANCE, "absolute")
    return replace(_row(term, "rad", x.q, y.q, ROLLOUT_TOLERANCE), measure="absolute")


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
