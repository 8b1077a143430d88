"""Each part of a chain by itself, in whole closed loops on both plants and paths, against a loop written out here."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from tests.arms import pack
from tests.sampled import simulate_sampled
from torquebench.chain import Chain, CurrentLoop, Derating, Drawn, Ripple, ThermalLimit, TorqueSpeed
from torquebench.chain.sensors import kalman_gains
from torquebench.kernel import Array
from torquebench.keys import declared_keys
from torquebench.references import Sine
from torquebench.robot import load_model
from torquebench.robot.library import ArmFile
from torquebench.shipped import data_root
from torquebench.sim.plants import Plant
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant

MASS, LIMIT, LAM, RATE = 2.0, 30.0, 8.0, 6.0
SLIDE = ArmFile(
    "slide",
    """<mujoco><option timestep="0.001"/><worldbody><body><inertial mass="2" pos="0 0 0" diaginertia="1 1 1"/>
<joint name="x" type="slide" axis="1 0 0"/></body></worldbody><actuator><motor joint="x" ctrlrange="-30 30"/></actuator>
</mujoco>""",
)
"""A mass on a slide across gravity, m x'' = torque, so that a loop around it can be written out in numbers."""
H, N, START = 0.001, 150, -0.4
T = 0.005
MOTION = Sine(0.3, 1.0)

PARTS: dict[str, Chain] = {
    "encoder_noise": Chain(encoder_noise=3e-3),
    "encoder_offset": Chain(encoder_offset=0.01),
    "encoder_ripple": Chain(encoder_ripple=Ripple(5e-3, 40.0, 0.3)),
    "quantisation": Chain(quantisation=8e-3),
    "velocity": Chain(velocity="differentiated"),
    "velocity_filter": Chain(velocity="differentiated", velocity_filter=80.0),
    "velocity_noise": Chain(velocity="tachometer", velocity_noise=0.02, velocity_filter=300.0),
    "kalman_acceleration": Chain(velocity="kalman", kalman_acceleration=30.0, encoder_noise=1e-3),
    "measurement_delay": Chain(measurement_delay=3 * T),
    "command_filter": Chain(command_filter=40.0),
    "torque_rate": Chain(torque_rate=60.0),
    "missed_deadlines": Chain(missed_deadlines=0.3),
    "jitter": Chain(jitter=T),
    "command_delay": Chain(command_delay=3 * T),
    "torque_quantum": Chain(torque_quantum=1.5),
    "torque_gain": Chain(torque_gain=0.8),
    "torque_offset": Chain(torque_offset=0.7),
    "actuator_lag": Chain(actuator_lag=0.012),
    "current_loop": Chain(current_loop=CurrentLoop(150.0, 0.5)),
    "torque_speed": Chain(torque_speed=TorqueSpeed(0.3, 1.8)),
    "thermal_limit": Chain(thermal_limit=ThermalLimit(5.0, 0.5)),
    "derating": Chain(derating=Derating(0.1, limit=0.1, gain=0.6, over=0.2)),
    "torque_delay": Chain(torque_delay=7 * H),  # not a whole number of control periods
}
"""Key -> a chain with that part alone, or with those that it cannot be without."""


def rounded(x: float, step: float) -> float:
    """Return the multiple of `step` nearest to x; x itself for a step of zero."""
    return step * math.floor(x / step + 0.5) if step else x


def clipped(x: float, most: float) -> float:
    """Return x between -most and most."""
    return max(-most, min(most, x))


def then(history: Sequence[Any], steps: float) -> Any:
    """Return what was appended so many steps ago; the first until then."""
    return history[max(len(history) - 1 - round(steps), 0)]


def limited(chain: Chain, t: float, u: float, speed: float, heat: float) -> float:
    """Return what a motor gives of u [N] at a time and speed [m/s], at this share of its lasting temperature."""
    most, weak = LIMIT, chain.derating
    if chain.torque_speed is None and chain.thermal_limit is None and weak is None:
        return u  # a command is limited already; an offset comes on top
    if weak is not None:
        gone = float(np.clip((t - weak.at) / weak.over, 0.0, 1.0))
        most *= 1.0 - gone * (1.0 - weak.limit)
        u *= 1.0 - gone * (1.0 - weak.gain)
    if chain.torque_speed is not None and u * speed > 0.0:
        low, high = chain.torque_speed.corner, chain.torque_speed.no_load
        most *= float(np.clip((high - abs(speed)) / (high - low), 0.0, 1.0))
    if chain.thermal_limit is not None and heat >= 1.0:
        most = min(most, chain.thermal_limit.torque)
    return clipped(u, most)


def mover(chain: Chain, h: float) -> Array:
    """Return the matrix that moves x, v, u, u' and the held command on by h [s]: exact, whatever the current loop."""
    A = np.zeros((5, 5))
    A[0, 1] = 1.0
    if chain.current_loop is not None:
        w, zeta = chain.current_loop.frequency, chain.current_loop.damping
        A[1, 2], A[2, 3], A[3, 2:] = 1.0 / MASS, 1.0, [-w * w, -2.0 * zeta * w, w * w]
    elif chain.actuator_lag:
        A[1, 2], A[2, 2], A[2, 4] = 1.0 / MASS, -1.0 / chain.actuator_lag, 1.0 / chain.actuator_lag
    else:
        A[1, 4] = 1.0 / MASS
    moved: Array = expm(h * A)
    return moved


def by_hand(chain: Chain, drawn: Drawn, control_period: float, n: int = N, h: float = H) -> Array:
    """Return position and velocity at each control instant, (n, 2): the whole loop in plain numbers.

    Args:
        chain: The chain.
        drawn: What is drawn for the run.
        control_period: Control period [s].
        n: Number of control instants.
        h: Physics step [s].
    """
    scale, desired = float(load_model(SLIDE).flat.inertia_scale[0]), MOTION(control_period * np.arange(n))
    substeps, move = round(control_period / h), mover(chain, h)
    alpha, beta = kalman_gains(30.0, 1e-3, control_period)
    share = 1.0 - math.exp(-(chain.velocity_filter or math.inf) * control_period)
    state, out = np.array([START, 0.0, 0.0, 0.0]), []
    seen: list[tuple[float, float]] = []
    sent, given, due = [], [], dict[int, float]()  # due: number of a physics step -> what comes into force there
    v = before = estimate = goal = heat = 0.0
    for k in range(n):
        x, speed = state[:2]
        out.append((x, speed))
        y = x + chain.encoder_offset + (0.0 if drawn.position is None else drawn.position[k, 0])
        if chain.encoder_ripple is not None:
            y += chain.encoder_ripple.amplitude * math.sin(chain.encoder_ripple.cycles * x + chain.encoder_ripple.phase)
        y = rounded(y, chain.quantisation)
        if chain.velocity == "exact":
            v = speed
        elif chain.velocity == "tachometer":
            reading = speed + drawn.velocity[k, 0]
            v = v + share * (reading - v) if k else reading
        elif chain.velocity == "differentiated":
            v = v + share * ((y - before) / control_period - v) if k else 0.0
        else:
            ahead = estimate + control_period * v if k else y
            estimate, v = ahead + alpha * (y - ahead), v + beta * (y - ahead) / control_period
        before = y
        seen.append((y, v))
        q, qd = then(seen, chain.measurement_delay / control_period)
        asked = RATE * scale * (desired.qd[k, 0] - qd + LAM * (desired.q[k, 0] - q))
        tau = clipped(asked, LIMIT)
        if chain.command_filter is not None and k:
            tau = sent[-1] + (tau - sent[-1]) * control_period / (control_period + 1.0 / chain.command_filter)
        if chain.torque_rate is not None and k:
            tau = sent[-1] + clipped(tau - sent[-1], chain.torque_rate * control_period)
        sent.append(tau)
        arrived = rounded(then(sent, chain.command_delay / control_period), chain.torque_quantum)
        arrived = chain.torque_gain * arrived + chain.torque_offset
        late = 0.0 if drawn.late is None or k == 0 else drawn.late[k]
        if not math.isinf(late):
            due[k * substeps + round(late / h)] = arrived
        for s in range(substeps):
            goal = due.pop(k * substeps + s, goal)
            u = limited(chain, k * control_period + s * h, goal, state[1], heat)
            if chain.thermal_limit is not None:
                warm = (u / chain.thermal_limit.torque) ** 2
                heat = warm + (heat - warm) * math.exp(-h / chain.thermal_limit.time)
            given.append(u)
            state = (move @ [*state, then(given, chain.torque_delay / h)])[:4]
    return np.array(out)


@cache
def plants(timestep: float = H) -> tuple[Plant, Plant]:
    """Return the mass on its slide on both plants."""
    return AnalyticPlant(load_model(SLIDE), timestep), MujocoPlant(SLIDE, timestep)


def looped(plant: Plant, chain: Chain, drawn: Drawn, path: Any, control_period: float = T) -> Any:
    """Return the run that `by_hand` writes out."""
    return simulate_sampled(
        plant,
        pack("pd", 1, lam=LAM, kv=RATE),
        load_model(SLIDE),
        MOTION,
        duration=N * control_period,
        control_period=control_period,
        chain=chain,
        drawn=drawn,
        initial_q=np.array([START]),
        path=path,
    )


@pytest.mark.parametrize("key", PARTS)
def test_a_loop_with_one_part_is_the_one_written_out(key: str, figure: Any) -> None:
    """Both plants within 1e-12 m of it over 150 periods, both paths equal in every byte; without the part far off.

    A current loop's torque is seen at three points of a physics step: 1e-8, which Simpson's rule leaves of it,
    (h^4/2880) u'''' times h.
    """
    chain = PARTS[key]
    drawn = chain.draw(1, N, seed=3, draw=0)
    wanted, tolerance = by_hand(chain, drawn, T), 1e-8 if key in ("actuator_lag", "current_loop") else 1e-12
    gap = 0.0
    for plant in plants():
        run, twin = (looped(plant, chain, drawn, path) for path in ("native", "python"))
        assert (run.path, twin.path) == ("native", "python")
        assert run.digest() == twin.digest()
        gap = max(gap, float(np.max(np.abs(run.q[:, 0] - wanted[:, 0]))))
    figure(f"{key} in a closed loop against one written out [m]", gap, f"<= {tolerance:g}")
    assert gap <= tolerance
    assert np.max(np.abs(wanted - by_hand(Chain(), Drawn(), T))[:, 0]) > 2e-4


def test_every_key_of_a_chain_is_among_them() -> None:
    """A part that is added to a chain has to be in the loop that is written out here, and in the table of the docs."""
    keys = {key.name for key in declared_keys(Chain)}
    assert PARTS.keys() | {"cross_talk"} == keys  # which one joint has not: test_drives.py
    table = (data_root() / "docs" / "chains.md").read_text(encoding="utf-8").partition("| part, key |")[2]
    rows = table.partition("\n\n")[0].splitlines()
    assert keys <= {name for row in rows for name in re.findall("`([a-z_]+)`", row.split("|")[1])}


@pytest.mark.parametrize(
    ("control_period", "timestep"), [(0.001, 0.001), (0.004, 0.001), (0.006, 0.0005), (0.02, 0.01)]
)
def test_law_and_plant_at_different_rates(control_period: float, timestep: float) -> None:
    """The torque is held over a control period, so that the motion depends on it and not on the physics step.

    A mass under a constant torque is integrated without error by any step: 1e-12 m of rounding.
    """
    wanted = by_hand(Chain(), Drawn(), control_period, h=control_period)
    for plant in plants(timestep):
        run = looped(plant, Chain(), Drawn(), "native", control_period)
        assert run.q[:, 0] == pytest.approx(wanted[:, 0], abs=1e-12)
    assert np.max(np.abs(wanted[:, 0] - START)) > 0.01


@pytest.mark.parametrize("key", ["jitter", "missed_deadlines"])
def test_late_commands_where_a_period_is_one_physics_step(key: str) -> None:
    """A command late by a whole period acts in the next one, if that one's own is late as well; 1e-12 m as above."""
    chain = Chain(jitter=T) if key == "jitter" else Chain(jitter=T, missed_deadlines=0.3)
    drawn = chain.draw(1, N, seed=3, draw=0)
    wanted = by_hand(chain, drawn, T, h=T)
    for plant in plants(T):
        runs = [looped(plant, chain, drawn, path) for path in ("native", "python")]
        assert runs[0].digest() == runs[1].digest()
        assert runs[0].q[:, 0] == pytest.approx(wanted[:, 0], abs=1e-12)


def test_three_delays_are_three_keys() -> None:
    """Without limits 10 ms of a command and of the torque that it becomes are one thing; with limits no two are.

    A torque limit that falls with speed looks at the speed of now or of then, and a measurement is as late as it is
    before its law, which knows where it should be now.
    """
    delays = [{key: 2 * T} for key in ("measurement_delay", "command_delay", "torque_delay")]
    linear = [by_hand(Chain(**keys), Drawn(), T) for keys in delays]
    assert np.max(np.abs(linear[1] - linear[2])) < 1e-12  # a command, or the torque that it becomes
    chains = [Chain(**keys, torque_speed=TorqueSpeed(0.3, 1.8), torque_rate=60.0) for keys in delays]
    parted = [by_hand(chain, Drawn(), T) for chain in chains]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert np.max(np.abs(parted[i] - parted[j])[:, 0]) > 1e-3
    for chain, wanted in zip(chains, parted, strict=True):
        for plant in plants():
            run = looped(plant, chain, Drawn(), "native")
            assert run.q[:, 0] == pytest.approx(wanted[:, 0], abs=1e-12)
