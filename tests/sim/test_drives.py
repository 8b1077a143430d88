"""What drives make of a law's torque: each part against its closed form, then all of them in whole runs."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arms import pack, slider, still
from tests.sim.loops import PLANTS, arm, go, law_of, plant_of
from torquebench.chain import Chain, CrossTalk, CurrentLoop, Derating, Drawn, ThermalLimit, TorqueSpeed, mixing
from torquebench.kernel import Array
from torquebench.references import Reference
from torquebench.sim.closed_loop import actuate, give
from torquebench.sim.job import set_up
from torquebench.sim.plants.analytic import AnalyticPlant

N_STEPS, T, H = 40, 0.004, 0.001
SUBSTEPS = round(T / H)
LIMITS = np.array([80.0, 25.0])


def given(
    chain: Chain, asked: Array, late: Array | None = None, qd: Any = (0.0, 0.0), substeps: int = SUBSTEPS
) -> tuple[Array, Array, Array]:
    """Return the commands (N, 2), the torques at start, middle and end of each physics step, and the means on record.

    Args:
        chain: The chain, on the two-joint arm with a period of 4 ms.
        asked: The law's torque, (N, 2).
        late: Time by which each command is late, (N,) [s].
        qd: Velocity of the joints, which stay where they are.
        substeps: Physics steps in a period.
    """
    n_steps = len(asked)
    job = set_up(
        law_of(lambda *arguments: None).law,
        (),
        arm().flat,
        plant_of("analytic", T / substeps),
        Reference(*np.zeros((3, n_steps, 2))),
        chain,
        control_period=T,
        substeps=substeps,
        drawn=Drawn(late=late),
        disturbance=None,
        native=None,
    ).job
    assert job.drives.active
    job.qd[:] = qd
    torques = np.zeros((n_steps, substeps, 3, 2))
    for k in range(n_steps):
        job.record_tau_law[k] = asked[k]
        actuate(job, k)
        for s in range(substeps):
            give(job, k, s)
            torques[k, s] = job.torque
    return job.record_tau.copy(), torques.reshape(-1, 3, 2), job.record_tau_applied.copy()


def some(scale: float = 60.0, n_steps: int = N_STEPS) -> Array:
    """Return torques that a law may ask for, beyond the limits now and then."""
    asked: Array = scale * np.random.default_rng(6).normal(size=(n_steps, 2))
    return asked


def held(commands: Array) -> Array:
    """Return commands as torques that are held over each control period, as `given` returns them."""
    return np.repeat(np.repeat(commands, SUBSTEPS, axis=0)[:, None], 3, axis=1)


def test_the_rate_of_the_command_is_limited() -> None:
    """tau_k = tau_(k-1) + clip(clip(asked) - tau_(k-1), rate T); the first is free; a step of 50 takes 50/rate."""
    rate = np.array([1000.0, 500.0])
    chain = Chain(torque_rate=(1000.0, 500.0), torque_quantum=1e-12)  # the quantum makes the drives active
    commands, _, _ = given(chain, some())
    wanted = np.clip(some(), -LIMITS, LIMITS)
    for k in range(1, N_STEPS):
        wanted[k] = wanted[k - 1] + np.clip(wanted[k] - wanted[k - 1], -rate * T, rate * T)
    assert commands.tobytes() == wanted.tobytes()
    step = np.vstack([np.zeros((1, 2)), np.full((N_STEPS - 1, 2), 20.0)])
    commands, _, _ = given(chain, step)
    assert np.count_nonzero(commands[:, 0] < 20.0) == round(20.0 / 1000.0 / T)
    assert np.count_nonzero(commands[:, 1] < 20.0) == round(20.0 / 500.0 / T)


def test_the_rate_alone_goes_the_short_way() -> None:
    """Without other parts the command is all that changes: no drives, and the joints get the command itself."""

    def push(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[:] = [5.0, 1.0] if t < 0.02 else [-5.0, -1.0]

    run = go(plant_of("analytic"), push, 0.06, chain=Chain(torque_rate=100.0))
    assert np.max(np.abs(np.diff(run.tau, axis=0))) == pytest.approx(0.1, rel=1e-12)
    assert run.tau_applied.tobytes() == run.tau.tobytes()
    assert run.tau_law.min() == -5.0
    assert run.tau[-1, 0] == pytest.approx(5.0 - 0.1 * 40, abs=1e-12)


@pytest.mark.parametrize("periods", [1, 3])
def test_a_command_delay(periods: int) -> None:
    """What acts in period k is the command of period k - d, and that of period 0 until then."""
    commands, torques, means = given(Chain(command_delay=periods * T), some())
    then = commands[np.maximum(np.arange(N_STEPS) - periods, 0)]
    assert torques.tobytes() == held(then).tobytes()
    assert means == pytest.approx(then, rel=1e-14)


def test_rounded_and_shifted_commands() -> None:
    """To the nearest whole multiple of the step, then the offset is added; the command on record is as it was sent."""
    commands, torques, _ = given(Chain(torque_quantum=0.25, torque_offset=(0.7, -0.3)), some())
    assert commands.tobytes() == np.clip(some(), -LIMITS, LIMITS).tobytes()
    assert torques == pytest.approx(held(0.25 * np.floor(commands / 0.25 + 0.5) + [0.7, -0.3]), abs=1e-13)


def test_gains_and_cross_talk_are_a_matrix() -> None:
    """The joints get C (g tau + offset), with 1 on the diagonal of C; 1e-13 N m of rounding."""
    talk = CrossTalk(following=(0.1, 9.0), preceding=(9.0, -0.2))  # the 9.0 stand for joints that there are not
    chain = Chain(torque_gain=(0.8, 1.2), torque_offset=(0.7, 0.0), cross_talk=talk)
    commands, torques, means = given(chain, some())
    wanted = (commands * [0.8, 1.2] + [0.7, 0.0]) @ np.array([[1.0, 0.1], [-0.2, 1.0]]).T
    assert mixing(chain, 2, 0.0) == pytest.approx(np.array([[0.8, 0.12], [-0.16, 1.2]]), rel=1e-15)
    assert torques == pytest.approx(held(wanted), abs=1e-13)
    assert means == pytest.approx(wanted, abs=1e-13)


def test_weakening_motors() -> None:
    """From 40 ms on, within 80 ms, limits of 80 and 25 N m fall to 20 and 25, and the second joint's torque to 40 %."""
    weak = Derating(0.04, limit=(0.25, 1.0), gain=(1.0, 0.4), over=0.08)
    _, torques, _ = given(Chain(derating=weak), np.full((N_STEPS, 2), (70.0, -20.0)))
    gone = np.clip((H * np.arange(len(torques)) - 0.04) / 0.08, 0.0, 1.0)
    wanted = np.stack([np.minimum(70.0, 80.0 * (1.0 - 0.75 * gone)), -20.0 * (1.0 - 0.6 * gone)], axis=1)
    assert torques == pytest.approx(np.repeat(wanted[:, None], 3, axis=1), abs=1e-12)
    _, at_once, _ = given(Chain(derating=Derating(0.04, gain=0.5)), np.full((N_STEPS, 2), (70.0, -20.0)))
    assert at_once[39:41, 0, 0].tolist() == [70.0, 35.0]
    for time, left in ((0.0, 1.0), (0.06, 0.85), (0.5, 0.4)):
        assert mixing(Chain(derating=weak), 2, time) == pytest.approx(np.diag([1.0, left]))


def test_a_lag_is_the_inductance_of_mujoco_s_dcmotor(figure: Any) -> None:
    """A blocked ``dcmotor`` of L/R = 8 ms with R/K volts per N m, as the lag: 1e-12 N m over 160 ms.

    Both are exact between commands, which are random; MuJoCo's force is that at the end of its step.
    """
    asked = np.clip(some(20.0), -LIMITS, LIMITS)
    _, torques, _ = given(Chain(actuator_lag=0.008, torque_offset=1e-300), asked)
    m = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep="0.001" gravity="0 0 0" integrator="Euler"/><worldbody><body>
        <inertial mass="1" pos="0 0 0" diaginertia="1e15 1e15 1e15"/><joint name="a" axis="0 0 1"/></body></worldbody>
        <actuator><dcmotor joint="a" input="voltage" motorconst="0.5 0.5" resistance="2" inductance="0.016"/></actuator>
        </mujoco>"""
    )
    d, theirs = mujoco.MjData(m), []
    for volts in np.repeat(asked[:, 0], SUBSTEPS) * 2.0 / 0.5:
        d.ctrl[0] = volts
        mujoco.mj_step(m, d)
        theirs.append(d.actuator_force[0])
    gap = float(np.max(np.abs(torques[:, 2, 0] - theirs)))
    figure("lag of a drive against MuJoCo's dcmotor [N m]", gap, "<= 1e-12")
    assert gap <= 1e-12


@pytest.mark.parametrize(("damping", "frequency"), [(0.3, 600.0), (1.0, 400.0), (2.0, 900.0)])
def test_the_current_loop_is_exact(damping: float, frequency: float) -> None:
    """From rest at zero u'' = w^2 (tau - u) - 2 z w u', against an integrator of another kind at 1e-12.

    The mean on record is Simpson's over each step, whose error is w^4 h^4/2880 of the torque's change: 2e-4 here.
    """
    asked = np.clip(some(20.0), -LIMITS, LIMITS)
    _, torques, means = given(Chain(current_loop=CurrentLoop(frequency, damping)), asked)
    u = np.zeros(4)
    for k in range(N_STEPS):
        tau = asked[k]

        def rate(t: float, x: Array, tau: Array = tau) -> Array:
            return np.concatenate([x[2:], frequency**2 * (tau - x[:2]) - 2.0 * damping * frequency * x[2:]])

        at = np.linspace(0.0, T, 2 * SUBSTEPS + 1)
        done = solve_ivp(rate, (0.0, T), u, "DOP853", at, rtol=1e-12, atol=1e-12)
        for s in range(SUBSTEPS):
            wanted = done.y[:2, 2 * s : 2 * s + 3].T
            assert torques[SUBSTEPS * k + s] == pytest.approx(wanted, abs=1e-8)
        weights = np.array([1.0, *[4.0, 2.0] * (SUBSTEPS - 1), 4.0, 1.0]) / (6.0 * SUBSTEPS)
        assert means[k] == pytest.approx(done.y[:2] @ weights, abs=1e-8)
        u = done.y[:, -1]
    assert np.max(np.abs(torques[:, 0] - np.repeat(asked, SUBSTEPS, axis=0))) > 10.0


@pytest.mark.parametrize(
    ("tau", "qd", "wanted"),
    [
        (70.0, 0.0, 70.0),
        (70.0, 2.0, 70.0),
        (70.0, 3.0, 40.0),  # half way from the corner to the speed without load: half of 80
        (70.0, -3.0, 70.0),  # braking: the full torque
        (-70.0, -3.0, -40.0),
        (-70.0, 3.0, -70.0),
        (30.0, 3.0, 30.0),
        (70.0, 4.0, 0.0),
        (70.0, 5.0, 0.0),
        (-70.0, 5.0, -70.0),
    ],
)
def test_four_quadrants(tau: float, qd: float, wanted: float) -> None:
    """Driving, the limit of 80 N m falls from 2 rad/s to nothing at 4 rad/s; braking it does not."""
    chain = Chain(torque_speed=TorqueSpeed(corner=2.0, no_load=4.0))
    _, torques, means = given(chain, np.full((2, 2), (tau, 0.0)), qd=(qd, 0.0))
    assert torques[..., 0] == pytest.approx(wanted, abs=1e-12)
    assert means[:, 0] == pytest.approx(wanted, abs=1e-12)


def test_a_hot_motor_gives_its_continuous_torque() -> None:
    """A torque of twice the continuous one is cut after -time ln(1 - 1/4); from then on the mean square is that of it.

    To one physics step of 1 ms; the other joint, below its continuous torque, is never cut.
    """
    limit = ThermalLimit(torque=(10.0, 15.0), time=0.3)
    _, torques, _ = given(Chain(thermal_limit=limit), np.full((250, 2), (20.0, 14.0)))
    cut = int(np.argmax(torques[:, 0, 0] < 20.0))
    assert cut * H == pytest.approx(-0.3 * math.log(1.0 - 0.25), abs=1.5 * H)
    assert np.mean(torques[cut:, 0, 0] ** 2) == pytest.approx(100.0, rel=0.01)
    assert np.all(torques[:, :, 1] == 14.0)


def test_a_sine_behind_a_rate_limit_and_in_a_hot_motor() -> None:
    """Far too fast for the rate it becomes a triangle of rate pi/(2 omega); heat of A^2/2 cuts it at the stated time.

    The triangle's corner lies between two commands: one of them, rate T. The heat swings by less than torque^2/(omega
    time) about its mean, so that the peak which is cut first is within half a period of the sine.
    """
    omega, t = 2.0 * math.pi * 5.0, T * np.arange(500)
    asked = np.stack([20.0 * np.sin(omega * t)] * 2, axis=1)
    commands, _, _ = given(Chain(torque_rate=100.0, torque_quantum=1e-12), asked)
    assert np.max(commands[-100:]) == pytest.approx(100.0 * math.pi / (2.0 * omega), abs=100.0 * T)
    _, torques, _ = given(Chain(thermal_limit=ThermalLimit(11.0, 2.0)), asked)
    cut = int(np.argmax(np.abs(torques[:, 0, 0] - np.repeat(asked[:, 0], SUBSTEPS)) > 1e-9))
    assert cut * H == pytest.approx(-2.0 * math.log(1.0 - 2.0 * (11.0 / 20.0) ** 2), abs=0.1)


@pytest.mark.parametrize("steps", [1, 7])
def test_a_torque_delay(steps: int) -> None:
    """What acts in a physics step is what the motor gave so many steps before; until then its torque at t = 0."""
    prompt = given(Chain(current_loop=CurrentLoop(700.0)), some())[1]
    late = given(Chain(current_loop=CurrentLoop(700.0), torque_delay=steps * H), some())[1]
    assert late[steps:].tobytes() == prompt[:-steps].tobytes()
    assert np.all(late[:steps] == prompt[0, 0])


def test_late_and_missed_commands() -> None:
    """A command comes into force so many physics steps late; a missed one never does; the one before is held.

    At t = 0 nothing can be held, so the first is never late. One that is late by a whole period is there in the next.
    """
    times = np.array([0.003, 0.0, 0.0014, np.inf, 0.004, 0.0026])
    commands, torques, means = given(Chain(jitter=0.004), some(10.0, 6), late=times)
    acting = [*4 * [0], *4 * [1], 1, 2, 2, 2, *8 * [2], 4, 4, 4, 5]  # 3 is missed, 4 late by a whole period
    wanted = [commands[k] for k in acting]
    assert torques[:, 0].tobytes() == np.array(wanted).tobytes()
    assert means == pytest.approx(np.array(wanted).reshape(6, SUBSTEPS, 2).mean(axis=1), rel=1e-14)


@pytest.mark.parametrize("substeps", [1, 4])
def test_commands_are_late_by_half_the_jitter_on_average(substeps: int) -> None:
    """Of a ramp the mean torque lacks half the jitter's rise, whatever the physics step; five deviations of 5000 draws.

    A missed command is as if it had not been: with a share p of them the mean lateness is p/(1 - p) periods.
    """
    asked = np.stack([1e-3 * np.arange(5000.0)] * 2, axis=1)
    for chain, late, deviation in ((Chain(jitter=T), 0.5, 0.5), (Chain(missed_deadlines=0.3), 3.0 / 7.0, 0.8)):
        drawn = chain.draw(2, 5000, 5, 0)
        _, _, means = given(chain, asked, drawn.late, substeps=substeps)
        lacks = (asked - means)[1:, 0] / 1e-3
        assert np.mean(lacks) == pytest.approx(late, abs=5.0 * deviation / math.sqrt(5000.0))


def test_draws_of_deadlines() -> None:
    """Times are even from 0 to the jitter, and the share of missed ones is as asked, each within five deviations.

    They have a stream of their own: the encoders' noise of the same run is the same with and without.
    """
    n = 20000
    drawn = Chain(jitter=0.002, missed_deadlines=0.05, encoder_noise=0.1).draw(2, n, 3, 4)
    assert drawn.late is not None
    assert drawn.position is not None
    missed = np.isinf(drawn.late)
    assert np.mean(missed) == pytest.approx(0.05, abs=5.0 * math.sqrt(0.05 * 0.95 / n))
    times = np.sort(drawn.late[~missed])
    assert (times[0], times[-1]) == pytest.approx((0.0, 0.002), abs=2e-6)
    assert np.max(np.abs(times / 0.002 - (np.arange(len(times)) + 0.5) / len(times))) < 2.0 / math.sqrt(len(times))
    alone = Chain(encoder_noise=0.1).draw(2, n, 3, 4)
    assert alone.late is None
    assert drawn.position.tobytes() == alone.position.tobytes()  # type: ignore[union-attr]


EVERYTHING = Chain(
    torque_rate=2000.0,
    command_delay=T,
    torque_quantum=0.02,
    torque_offset=0.3,
    current_loop=CurrentLoop(800.0, 0.6),
    torque_speed=TorqueSpeed(1.0, 9.0),
    thermal_limit=ThermalLimit(12.0, 0.05),
    torque_gain=1.1,
    derating=Derating(0.1, limit=0.6, gain=0.9, over=0.05),
    cross_talk=CrossTalk(0.1, -0.05),
    torque_delay=2 * H,
    jitter=0.003,
    missed_deadlines=0.1,
    measurement_delay=T,
)


def test_the_mean_torque_is_what_moves_a_mass() -> None:
    """On a slide of 2 kg the velocity after each period is the sum of recorded means times T/m, whatever the drive."""

    def push(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0] = 100.0 * math.cos(40.0 * t)

    late = 0.003 * np.random.default_rng(2).random(50)
    late[::7] = np.inf
    plant, reference = AnalyticPlant(slider(2.0)), still(np.zeros(1))
    run = go(
        plant,
        push,
        0.2,
        model=slider(),
        reference=reference,
        chain=EVERYTHING,
        control_period=T,
        drawn=Drawn(late=late),
    )
    wanted = np.concatenate([[0.0], np.cumsum(run.tau_applied[:-1, 0]) * T / 2.0])
    assert run.qd[:, 0] == pytest.approx(wanted, abs=1e-12)
    assert np.max(np.abs(wanted)) > 0.1
    assert np.max(np.abs(run.tau_applied - run.tau)) > 1.0


@pytest.mark.parametrize("control_period", [0.001, T])
def test_plants_agree_and_paths_are_equal(control_period: float) -> None:
    """All parts at once: MuJoCo and the analytic arm stay within 1e-9 rad over 0.5 s, both paths in every byte.

    The drives cut by the speed and the temperature, so that a difference of one rounding may move a cut by a step of
    time only where it hits a limit exactly.
    """
    n_steps = round(0.5 / control_period)
    late = control_period * np.random.default_rng(5).random(n_steps)
    late[::11] = np.inf
    runs = {}
    chain = Chain(
        **{
            **{name: getattr(EVERYTHING, name) for name in EVERYTHING.__dataclass_fields__ if name != "name"},
            "command_delay": control_period,
            "measurement_delay": control_period,
            "jitter": control_period,
        }
    )
    for plant in PLANTS:
        for path in ("python", "native"):
            runs[plant, path] = go(
                plant_of(plant),
                pack("pd", 2, lam=4, kv=6),
                0.5,
                chain=chain,
                path=path,
                control_period=control_period,
                drawn=Drawn(late=late),
            )
            assert runs[plant, path].path == path
    for plant in PLANTS:
        assert runs[plant, "python"].digest() == runs[plant, "native"].digest()
    a, b = (runs[plant, "native"] for plant in PLANTS)
    assert np.max(np.abs(a.q - b.q)) < 1e-9
    assert np.ptp(a.q) > 0.1
    assert np.max(np.abs(a.tau_applied - a.tau)) > 0.5


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"torque_rate": 0.0}, "torque_rate is 0.0, wanted more than 0"),
        ({"jitter": -1.0}, "jitter is -1.0, wanted at least 0"),
        ({"missed_deadlines": 1.5}, "missed_deadlines is 1.5, wanted at most 1"),
        ({"torque_quantum": math.nan}, "torque_quantum is nan, wanted a finite number"),
    ],
)
def test_meaningless_sizes_are_refused(keys: dict[str, float], text: str) -> None:
    """The key, its value and what was wanted are named."""
    with pytest.raises(ValueError, match=text):
        Chain(**keys)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"frequency is 0\.0, wanted more than 0"):
        CurrentLoop(0.0)
