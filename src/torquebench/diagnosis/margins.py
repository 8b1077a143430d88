"""The loop's frequency response along a motion: crossover, phase, gain and delay margin, phase lost to each part."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from torquebench.certificates import Phases
from torquebench.chain import Chain, mixing, response
from torquebench.diagnosis.owners import OWNERS, Owner, owner_of
from torquebench.experiment.build import Loop
from torquebench.experiment.certify import truth_of
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.references import Reference
from torquebench.robot import RobotModel
from torquebench.robot.flat_model import own_copy
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.interpreted import Call
from torquebench.sim.joints import Joints
from torquebench.timing import whole_steps

INSTANTS = 5
"""Instants along the motion at which the loop is linearised."""
LINES = 400
"""Frequencies at which its response is worked out."""
LOWEST_HZ = 0.1
STEPS = (1e-5, 1e-4)
"""Least change of position [rad] and velocity [rad/s] by which a law is differentiated."""
TINY = 1e-9
"""Change of velocity so small that only a law that switches answers it [rad/s]."""
JUMP = 1e-3
"""Share of the torque limit that such an answer must have [1]."""
ENOUGH, AMPLE = 30.0, 60.0
"""Phase margin that a loop is to have [deg]: Astrom and Murray, Feedback Systems, in "Stability Margins"."""
SMALL = 0.02
"""Share of gravity's torque that a law without gravity may give at no error [1]."""

NEAR = 1.5
"""Times a frequency up to which modes are near it [1]."""

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Slopes:
    """A law's derivatives at instants along the motion; (m, n, n) and (m, n)."""

    stiffness: Array
    """-d tau_i / d q_j [N m/rad]."""
    damping: Array
    """-d tau_i / d qd_j [N m s/rad]."""
    pull: Array
    """d tau_i / d q_ref,i, (m, n) [N m/rad]."""
    integral: Array
    """Growth of that per second under a lasting error of position [N m/(rad s)]."""
    integral_damping: Array
    """Likewise of velocity [N m/rad]."""
    at_rest: Array
    """Torque at no error and no speed, (m, n) [N m]."""
    jumps: bool
    """Whether the torque jumps where the error is zero."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of the loop of all joints where they are least along the motion: of one eigenvalue of its open loop.

    Phase that all joints lose at once, as a chain's delays take it, brings the loop to its limit at that margin.
    """

    joint: int
    """Number of the joint that takes most part in it, from 0."""
    time: float
    """Instant of the motion [s]."""
    frequency: Array
    """Frequencies, (f,) [Hz]."""
    gain: Complex = field(repr=False)
    """That eigenvalue of the open loop's frequency response, (f,)."""
    angle: Array = field(repr=False)
    """Its phase, unwrapped, (f,) [degrees]."""
    crossover: float | None
    """Frequency at which its size is 1 and the phase margin the least [Hz]; None where its size never is 1."""
    phase: float | None
    """Phase margin there [degrees]: above -180, or as many whole turns below as a resonance begins at."""
    delay: float | None
    """Further delay of all joints at once that the arm bears, of all eigenvalues the least [s]; None for none."""
    oscillation: float | None
    """Frequency at which a phase is -180 degrees [Hz]: at that limit the loop oscillates there, and of an unstable one
    the lowest."""
    factor: float | None
    """Gain margin: times the gain that brings the loop there [1], of all eigenvalues the least above 1."""
    lost: Mapping[str, float]
    """Part of the chain, hold of the control period included -> phase lost to it at the crossover [degrees]."""
    owners: Mapping[str, Owner] = field(default_factory=dict)
    """Owner of each of these."""
    damping: float = 1.0
    """Least damping ratio that arm and law without the chain have near the crossover; 1 where nothing swings [1]."""

    @property
    def costs(self) -> str:
        """Losses of phase at the crossover, the largest first, with the owner of each; empty where nothing is lost."""
        most = sorted(self.lost, key=lambda name: -self.lost[name])
        called = {"velocity": "estimating velocity"}
        words = (
            f"{called.get(name, name.replace('_', ' '))} {self.lost[name]:.0f} deg ({OWNERS[self.owners[name]]})"
            for name in most
        )
        return f"phase lost there to {', '.join(words)}" if most else ""

    @property
    def swell(self) -> float | None:
        """Times a disturbance at the crossover is as large as without the law, 1 / (2 sin(phase/2)) [1].

        That is |1 / (1 + L)| where |L| = 1; None where the loop does not cross, or is unstable.
        """
        return 0.5 / math.sin(math.radians(self.phase / 2.0)) if self.phase is not None and self.phase > 0.0 else None

    @property
    def is_soft(self) -> bool:
        """Whether the phase margin is small because damping is, as of a soft spring, and not because of lags.

        Then it would be little without the chain, too, and all that costs phase would have to grow threefold at least
        to make the loop unstable.
        """
        lost = sum(self.lost.values())
        soft = self.phase is not None and 2.0 * lost <= self.phase and 0.0 < self.phase < ENOUGH - lost
        return soft and 0.0 < self.damping < 1.0

    @property
    def rule(self) -> str:
        """Meaning of the phase margin by the rule of `ENOUGH` to `AMPLE`; empty where the loop does not cross."""
        usual = f"{ENOUGH:.0f} to {AMPLE:.0f} deg are usual (Astrom and Murray)"
        if self.crossover is None or self.phase is None:
            return ""
        if self.swell is None:
            return f"that is unstable, an error grows by itself; {usual}"
        grown = f"what shakes it near {self.crossover:.3g} Hz becomes {self.swell:.2g} times as large"
        if self.is_soft:
            kept = math.exp(-math.tau * self.damping / math.sqrt(1.0 - self.damping * self.damping))
            own = f"that is the law's own damping, a ratio of {self.damping:.2g}, and far from unstable"
            return f"{own}: a swing loses {100.0 * (1.0 - kept):.0f} % each time, {grown}; {usual}"
        if self.phase < ENOUGH:
            return f"that is little: {grown}; {usual}"
        if self.phase <= AMPLE:
            return f"as usual, which is {ENOUGH:.0f} to {AMPLE:.0f} deg (Astrom and Murray)"
        return f"that is ample; {usual}"

    def words(self, joints: Sequence[str]) -> str:
        """Return crossover, phase and delay margin in words; `joints` are the joints' names."""
        if self.crossover is None or self.phase is None:
            return "no loop crosses"
        delay = "no further delay" if self.delay is None else f"a further delay of {1e3 * self.delay:.3g} ms"
        loop = f"loop of {joints[self.joint]}: crossover {self.crossover:.3g} Hz"
        return f"{loop}, phase margin {self.phase:.0f} deg; the arm bears {delay}"

    def to_json(self) -> dict[str, object]:
        """Return the numbers, without the curves."""
        return {
            "joint": self.joint + 1,
            "t": self.time,
            "crossover_hz": self.crossover,
            "phase_margin_deg": self.phase,
            "delay_margin_s": self.delay,
            "oscillation_hz": self.oscillation,
            "gain_margin": self.factor,
            "damping_ratio": self.damping,
            "rule": self.rule,
            "phase_lost_deg": dict(self.lost),
            "phase_lost_to": dict(self.owners),
        }


def slopes_of(experiment: Experiment, loop: Loop, by: tuple[Array, Array] | None = None) -> Slopes:
    """Return a law's derivatives along the desired motion, by central differences at no error.

    The law is called as at the start, with an empty memory. What it adds from its second call to its third, at the same
    error, is what an integral in it adds in a control period.

    Args:
        experiment: With one controller.
        loop: Its objects.
        by: Half the change of each joint's position [rad] and velocity [rad/s], (n,); a law that switches has the slope
            that belongs to this amplitude.
    """
    n, controller = experiment.n, loop.controllers[0]
    belief = own_copy(loop.model.flat, control_period=experiment.run.control_period)
    dq, dqd = (np.full(n, least) for least in STEPS) if by is None else map(np.maximum, by, STEPS)

    def torque(k: int, q: Array, qd: Array, moving: bool = True, ahead: Array | float = 0.0) -> tuple[Array, Array]:
        """Return the torque of the first call [N m], and what the third adds to that of the second [N m/s].

        Args:
            k: Number of the instant.
            q, qd: Where the arm is.
            moving: Whether the target moves.
            ahead: By how much the target is further on [rad].
        """
        call = Call(controller.law, controller.gains, belief, controller.law.new_memory(n))
        ref = Reference(*(signal[k] for signal in loop.reference))
        ref = ref._replace(q=ref.q + ahead) if moving else Reference(ref.q, np.zeros(n), np.zeros(n))
        found = []
        for _ in range(3 if remembers else 1):
            tau, status, _ = call(0.0, np.array(q), np.array(qd), ref)
            found.append(np.array(tau) if status == COMPLETED else np.full(n, np.nan))
        return found[0], (found[2] - found[1]) / experiment.run.control_period if remembers else np.zeros(n)

    instants, remembers = instants_of(experiment), controller.law.memory_type is not None
    stiffness, damping, summed, summed_rate = np.zeros((4, len(instants), n, n))
    pull, rest, jumps = np.zeros((len(instants), n)), np.zeros((len(instants), n)), False
    limit = np.asarray(loop.plant.tau_max)
    for m, k in enumerate(instants):
        q, qd = loop.reference.q[k], loop.reference.qd[k]
        for j in range(n):
            unit = np.eye(n)[j]
            more, less = torque(k, q + dq * unit, qd), torque(k, q - dq * unit, qd)
            stiffness[m, :, j], summed[m, :, j] = (-(x - y) / (2.0 * dq[j]) for x, y in zip(more, less, strict=True))
            ahead = (torque(k, q, qd, ahead=way * dq * unit)[0][j] for way in (1.0, -1.0))
            pull[m, j] = (next(ahead) - next(ahead)) / (2.0 * dq[j])
            more, less = torque(k, q, qd + dqd * unit), torque(k, q, qd - dqd * unit)
            damping[m, :, j], summed_rate[m, :, j] = (
                -(x - y) / (2.0 * dqd[j]) for x, y in zip(more, less, strict=True)
            )
            jump = torque(k, q, qd + TINY * unit)[0] - torque(k, q, qd - TINY * unit)[0]
            jumps = jumps or bool(np.any(np.abs(jump) > JUMP * limit))
        rest[m] = torque(k, q, np.zeros(n), moving=False)[0]
    K, B, P, integral, of_rate, at_rest = map(np.nan_to_num, (stiffness, damping, pull, summed, summed_rate, rest))
    return Slopes(K, B, P, integral, of_rate, at_rest, jumps)


def instants_of(experiment: Experiment) -> list[int]:
    """Return the control instants at which a loop is looked at, from the start of the metrics' window on."""
    first = min(whole_steps(experiment.run.metrics_from, experiment.run.control_period), experiment.n_steps - 1)
    return sorted(set(np.linspace(first, experiment.n_steps - 1, INSTANTS).astype(int).tolist()))


def weight_along(experiment: Experiment, loop: Loop) -> Array:
    """Return gravity's torque on the true arm at the instants that are looked at, (m, n) [N m]."""
    q = loop.reference.q[instants_of(experiment)]
    return np.asarray(true_arm(experiment).bias_forces(q, np.zeros_like(q)))


def backwards(slopes: Slopes) -> int | None:
    """Return the number of a joint that a law pushes away from its target all along; None where there is none.

    Such a law's torque falls when the target is put further on, and rises when the arm is: the first alone a law does
    that gives gravity's torque where the arm should be, the second one that gives it where the arm is, at small gains.
    """
    own = np.diagonal(slopes.stiffness, axis1=1, axis2=2)
    found = np.flatnonzero(np.all((own < 0.0) & (slopes.pull < 0.0), axis=0))
    return int(found[0]) if len(found) else None


def leaves_gravity(slopes: Slopes, weight: Array) -> bool:
    """Whether a law gives no torque against gravity while it has no error."""
    heavy = float(np.max(np.abs(weight)))
    return heavy > 0.0 and float(np.max(np.abs(slopes.at_rest))) < SMALL * heavy


class Terms(NamedTuple):
    """Matrices that make up a loop at an instant, (n, n) each."""

    M: Array
    """Inertia of the links [kg m^2]; of the whole arm where joints are rigid."""
    D: Array
    """Viscous friction [N m s/rad]."""
    G: Array
    """Stiffness of gravity [N m/rad]."""
    K: Array
    """The law's stiffness [N m/rad]."""
    B: Array
    """The law's damping [N m s/rad]."""
    I: Array  # noqa: E741
    """Its integral of position errors [N m/(rad s)]."""
    J: Array
    """Its integral of velocity errors [N m/rad]."""
    drives: Array
    """What the drives multiply the law's torques by [1]."""
    joints: Joints | None
    """Springs between motors and links; None for rigid joints."""
    on_link: bool
    """Whether the sensors are on the links."""


def terms_at(experiment: Experiment, loop: Loop, slopes: Slopes, m: int, k: int) -> Terms:
    """Return the terms at the instant `m` of the slopes, control instant `k`.

    Args:
        experiment, loop, slopes: As of `margins_of`.
        m, k: The instant's number there, and that of its control period.
    """
    arm, n, q = true_arm(experiment), experiment.n, loop.reference.q[k]
    friction, between = experiment.plant.acting, experiment.plant.transmission
    drag = np.zeros(n) if friction is None else as_vector(friction.viscous, n)
    M, joints = _links(experiment, q, k)
    near = q + 1e-5 * np.eye(n)
    weight = arm.bias_forces(np.concatenate([near, 2.0 * q - near]), np.zeros((2 * n, n)))
    G = (weight[:n] - weight[n:]).T / 2e-5
    own = slopes.stiffness[m], slopes.damping[m], slopes.integral[m], slopes.integral_damping[m]
    drives = drives_at(experiment, k)
    return Terms(M, np.diag(drag), G, *own, drives, joints, between is not None and between.sensor == "link")


def drives_at(experiment: Experiment, k: int) -> Array:
    """Return what the drives multiply torques by at control instant `k`, (n, n) [1]; see `mixing`."""
    return mixing(experiment.chain, experiment.n, k * experiment.run.control_period)


def _links(experiment: Experiment, q: Array, k: int) -> tuple[Array, Joints | None]:
    """Return the inertia of the links at `q` (n,) [rad], and the springs that turn them, if any.

    A joint that has locked by control instant `k` is held by its motor, as in the plant: no torque moves it.
    """
    arm, between, lock = true_arm(experiment), experiment.plant.transmission, experiment.plant.lock
    if lock is not None and k < whole_steps(lock.at, experiment.run.control_period):
        lock = None
    M, rotors = arm.mass_matrix(q[None])[0], np.asarray(arm.flat.armature)
    if between is None:
        return M if lock is None else M + np.diag(lock.on(np.zeros_like(rotors))), None
    joints = between.of_joints(rotors)
    return M - np.diag(rotors), joints if lock is None else replace(joints, inertia=lock.on(joints.inertia))


def true_arm(experiment: Experiment) -> RobotModel:
    """Return the model of the arm as it is at the end of a run, payload included."""
    truth = truth_of(experiment)
    return truth.later if isinstance(truth, Phases) else truth


def resonances(experiment: Experiment, loop: Loop) -> Array:
    """Return the frequency at which each joint's motor and link swing against each other, (n,) [Hz].

    Square roots of the eigenvalues of (B^-1 + M^-1) k, each for the joint whose spring has most of its energy, halfway
    through the motion.
    """
    instants = instants_of(experiment)
    middle = instants[len(instants) // 2]
    M, joints = _links(experiment, loop.reference.q[middle], middle)
    if joints is None:
        return np.full(experiment.n, np.nan)
    root = np.sqrt(joints.stiffness)
    values, ways = np.linalg.eigh(root[:, None] * (np.diag(1.0 / joints.inertia) + np.linalg.inv(M)) * root)
    return np.asarray(np.sqrt(values[_paired(np.abs(ways))]) / (2.0 * math.pi))


def _paired(sizes: Array) -> list[int]:
    """Return to each row a column of its own, the largest of all numbers first, (n,)."""
    found, left = np.argmax(sizes, axis=1), np.array(sizes)
    if len(set(found.tolist())) < len(found):
        for _ in found:
            row, column = np.unravel_index(np.argmax(left), left.shape)
            found[row] = column
            left[row], left[:, column] = -1.0, -1.0
    return [int(column) for column in found]


def margins_of(experiment: Experiment, loop: Loop, slopes: Slopes) -> Margins | None:
    """Return the margins of the loop where the phase margin is least along the motion; None where none crosses.

    With P = (M s^2 + D s + G)^-1, or from motor to sensor through the springs of the joints, and what the chain makes
    of the law, C = H_tau A ((K + I/s) H_q + (s B + J) H_qd) with the gains A of the drives, the open loop of all joints
    is C P. Each of its eigenvalues is looked at as a single loop is (generalised Nyquist criterion): what one joint
    does moves the others.

    Args:
        experiment: With one controller.
        loop: Its objects.
        slopes: The law's derivatives K and B, and those of its integral, I and J.
    """
    n, period, chain = experiment.n, experiment.run.control_period, experiment.chain
    frequency = np.geomspace(LOWEST_HZ, 0.5 / period, LINES)
    found = resonances(experiment, loop)
    if np.all(np.isfinite(found)):  # dense where the phase turns within a few lines
        near = [f * np.linspace(0.7, 1.4, LINES) for f in found]
        frequency = np.unique(np.concatenate([frequency, *near]))
        frequency = frequency[frequency <= 0.5 / period]
    seen = response(chain, 2.0 * math.pi * frequency, period)
    late = seen.torque * seen.position
    worst: Margins | None = None
    least = most = math.inf
    swings: float | None = None
    for m, k in enumerate(instants_of(experiment)):
        terms = terms_at(experiment, loop, slopes, m, k)
        loci, ways = _loci(chain, period, frequency, terms)
        for i in range(n):
            one = _margins(i, k * period, frequency, loci[:, i], late, 0.7 * float(np.min(found)))
            least = min(least, one.delay or math.inf)
            if one.factor is not None and one.factor < most:
                most, swings = one.factor, one.oscillation
            if one.phase is not None and (worst is None or worst.phase is None or one.phase < worst.phase):
                worst, kept, kept_ways = one, terms, ways
    if worst is None or worst.crossover is None or worst.phase is None:
        return worst
    V = kept_ways[np.searchsorted(frequency, worst.crossover) - 1]
    joint = int(np.argmax(np.abs(V[:, worst.joint] * np.linalg.pinv(V)[worst.joint])))
    up_to = np.geomspace(LOWEST_HZ, worst.crossover, LINES)
    loci, ways = _loci(chain, period, up_to, kept)
    own = int(np.argmin(np.abs(loci[-1] - np.exp(1j * math.radians(worst.phase - 180.0)))))
    variants = {name: (lesser, kept) for name, lesser in _lesser(chain).items()}
    if np.any(kept.I) or np.any(kept.J):
        variants["integral"] = chain, kept._replace(I=np.zeros((n, n)), J=np.zeros((n, n)))
    lost = dict[str, float]()
    for name, (lesser, terms) in variants.items():
        others, turned = _loci(lesser, period, up_to, terms)
        same = int(np.argmax(np.abs(turned[-1].conj().T @ ways[-1, :, own])))
        lost[name] = float(np.degrees(np.unwrap(np.angle(others[:, same] / loci[:, own]))[-1]))
    lost["hold"] = 180.0 * worst.crossover * period
    lost = {name: x for name, x in lost.items() if abs(x) >= 0.05}
    owners = {name: owner_of(experiment, name) for name in lost}
    damping = _damping(kept, 2.0 * math.pi * worst.crossover)
    told = replace(worst, joint=joint, delay=None, lost=lost, owners=owners, damping=damping)
    if worst.phase <= 0.0:
        return told
    return replace(told, delay=least, factor=most if math.isfinite(most) else None, oscillation=swings)


def _damping(terms: Terms, omega: float) -> float:
    """Return the least damping ratio of M s^2 + (D + A B) s + G + A K in the modes near a frequency; 1 for none.

    Args:
        terms: What the loop is made of; joints that give are as good as rigid.
        omega: The frequency [rad/s].
    """
    n = len(terms.M)
    M = terms.M if terms.joints is None else terms.M + np.diag(terms.joints.inertia)
    rates = np.linalg.solve(M, -np.hstack([terms.G + terms.drives @ terms.K, terms.D + terms.drives @ terms.B]))
    poles = np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), rates]))
    swinging = poles[poles.imag > 0.0]
    if not len(swinging):
        return 1.0
    off = np.abs(np.log(np.abs(swinging) / omega))
    near = swinging[off <= max(math.log(NEAR), float(np.min(off)))]
    return float(np.min(-near.real / np.abs(near)))


def _lesser(chain: Chain) -> dict[str, Chain]:
    """Return the chain without each of its parts that cost phase."""
    bare: dict[str, dict[str, object]] = {
        key: {key: 0.0}
        for key in ("measurement_delay", "command_delay", "torque_delay", "actuator_lag", "jitter", "missed_deadlines")
        if getattr(chain, key) > 0.0
    }
    bare |= {key: {key: None} for key in ("command_filter", "current_loop") if getattr(chain, key) is not None}
    if chain.velocity != "exact":
        bare["velocity"] = {
            "velocity": "exact",
            "velocity_filter": None,
            "velocity_noise": 0.0,
            "kalman_acceleration": None,
        }
    return {name: replace(chain, **keys) for name, keys in bare.items()}  # type: ignore[arg-type]


def _loci(chain: Chain, period: float, frequency: Array, terms: Terms) -> tuple[Complex, Complex]:
    """Return eigenvalues of the open loop and their vectors, each followed along the frequencies, (f, n), (f, n, n).

    Args:
        chain: Sensors and actuators.
        period: Control period [s].
        frequency: Frequencies, (f,) [Hz].
        terms: What the loop is made of.
    """
    omega = 2.0 * math.pi * frequency
    seen, s = response(chain, omega, period), (1j * omega)[:, None, None]
    M, D, G, joints = terms.M, terms.D, terms.G, terms.joints
    if joints is None:
        P = np.linalg.inv(M * s**2 + D * s + G)
    else:
        n, spring = len(M), np.diag(joints.stiffness) + np.diag(joints.damping) * s
        links, motors = M * s**2 + G + spring, np.diag(joints.inertia) * s**2 + D * s + spring
        P = np.linalg.inv(np.block([[links, -spring], [-spring, motors]]))[:, :, n:]
        P = P[:, :n] if terms.on_link else P[:, n:]
    back = np.exp(-s * period)
    summed = period * back / (1.0 - back)
    C = (seen.torque[:, None, None] * terms.drives) @ (
        (terms.K + terms.I * summed) * seen.position[:, None, None]
        + s * (terms.B + terms.J * summed) * seen.velocity[:, None, None]
    )
    values, ways = np.linalg.eig(C @ P)
    alike = np.abs(np.swapaxes(ways[:-1].conj(), 1, 2) @ ways[1:])
    nearest, each = np.argmax(alike, axis=2), np.arange(len(M))
    is_clear, order = np.all(np.sort(nearest, axis=1) == each, axis=1), np.tile(each, (len(frequency), 1))
    for k, clear in enumerate(is_clear.tolist()):
        order[k + 1] = nearest[k, order[k]] if clear else _paired(alike[k, order[k]])
    return np.take_along_axis(values, order, axis=1), np.take_along_axis(ways, order[:, None], axis=2)


def _margins(joint: int, time: float, frequency: Array, gain: Complex, late: Complex, rigid_to: float) -> Margins:
    """Return the margins of one eigenvalue of the open loop; its number stands for the joint.

    Args:
        joint, time: As of `Margins`.
        frequency: Frequencies, (f,) [Hz].
        gain: The open loop, (f,).
        late: What is in it of the chain's delays and lags, (f,): their phase is counted from zero on, the rest's from
            -270 to 90 degrees.
        rigid_to: Frequency up to which joints are as good as rigid [Hz]; from there on the phase goes on from what it
            was. NaN where they are rigid.
    """
    size, rest = np.abs(gain), np.angle(gain / late)
    rest = np.where(rest > 0.5 * math.pi, rest - 2.0 * math.pi, rest)
    if rigid_to > frequency[0]:
        first = int(np.searchsorted(frequency, rigid_to)) - 1
        rest[first:] = np.unwrap(rest[first:])
    angle = np.unwrap(np.angle(late)) + rest
    crossover = phase = delay = oscillation = factor = None
    shift = 0.0
    for f, margin, turned in _crossings(frequency, size, angle):
        if phase is None or margin < phase:
            crossover, phase, shift = f, margin, turned
        delay = margin / 360.0 / f if delay is None else min(delay, margin / 360.0 / f)
    angle = angle + shift
    delay = delay if phase is not None and phase > 0.0 else None
    for f, times in _turns(frequency, size, angle):
        if phase is None or phase <= 0.0:  # where it oscillates already
            oscillation, factor = f, times
            break
        if times > 1.0 and (factor is None or times < factor):
            oscillation, factor = f, times
    return Margins(joint, time, frequency, gain, np.degrees(angle), crossover, phase, delay, oscillation, factor, {})


def _crossings(frequency: Array, size: Array, angle: Array) -> Iterator[tuple[float, float, float]]:
    """Yield where a locus enters and leaves the unit circle: frequency [Hz], phase margin [degrees], whole turns [rad].

    Beyond the band of large gain at the start another one, of a resonance, encircles -1 only where it goes through
    -180 degrees, or as many whole turns below, within itself: its phase counts from where it begins, with the whole
    turns that are added to it.

    Args:
        frequency, size, angle: Of a locus, (f,) [Hz], [1], [rad].
    """
    turned, large = 0.0, size >= 1.0
    for at in np.flatnonzero(large[:-1] != large[1:]).tolist():
        share = math.log(size[at]) / math.log(size[at] / size[at + 1])
        there = angle[at] + share * (angle[at + 1] - angle[at])
        if large[at + 1]:
            turned = -math.tau * math.floor((there + math.pi) / math.tau)
        f = float(frequency[at] * (frequency[at + 1] / frequency[at]) ** share)
        yield f, 180.0 + math.degrees(there + turned), turned


def _turns(frequency: Array, size: Array, angle: Array) -> Iterator[tuple[float, float]]:
    """Yield where the phase of a locus falls through -180 degrees, or whole turns off: frequency [Hz], 1 over its size.

    Args:
        frequency, size, angle: Of a locus, (f,) [Hz], [1], [rad].
    """
    branch = np.floor((angle + math.pi) / math.tau)
    near = angle[:-1] - angle[1:] < math.pi  # a phase that leaps from 90 to -270 degrees has not fallen
    for at in np.flatnonzero((branch[:-1] > branch[1:]) & near).tolist():
        share = (angle[at] - math.tau * branch[at] + math.pi) / (angle[at] - angle[at + 1])
        f = float(frequency[at] * (frequency[at + 1] / frequency[at]) ** share)
        yield f, 1.0 / float(size[at] * (size[at + 1] / size[at]) ** share)


def torque_noise(experiment: Experiment, slopes: Slopes) -> Array:
    """Return the torque that sensor noise makes through a law's gains, its RMS, (n,) [N m].

    The mean over frequencies up to half the sampling rate of |K + s B H|^2 sigma^2, joint by joint; a tachometer's
    noise meets B alone.

    Args:
        experiment: The experiment.
        slopes: The law's derivatives.
    """
    chain, period = experiment.chain, experiment.run.control_period
    omega: Array = (np.arange(LINES, dtype=np.float64) + 0.5) * math.pi / (LINES * period)
    seen = response(chain, omega, period)
    K = np.max(np.abs(np.diagonal(slopes.stiffness, axis1=1, axis2=2)), axis=0)
    B = np.max(np.abs(np.diagonal(slopes.damping, axis1=1, axis2=2)), axis=0)
    of_position = K[None] * seen.position[:, None]
    of_rate = B[None] * seen.velocity[:, None]
    if chain.velocity in ("differentiated", "kalman"):
        of_position = of_position + 1j * omega[:, None] * of_rate
    power = np.mean(np.abs(of_position) ** 2, axis=0) * chain.position_noise**2
    if chain.velocity == "tachometer":
        power = power + np.mean(np.abs(of_rate) ** 2, axis=0) * chain.velocity_noise**2
    return np.asarray(np.sqrt(power))
