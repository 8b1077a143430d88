"""The frequency response of a chain against its own kernels, driven by a sine."""

from __future__ import annotations

import numpy as np
import pytest

from torquebench.chain import Chain, CrossTalk, CurrentLoop, Derating, Drawn, response
from torquebench.chain.drives import command, drive, receive
from torquebench.chain.response import mixing
from torquebench.chain.sensors import measure
from torquebench.kernel import Array
from torquebench.kernel.twin import on_numbers

T, SUBSTEPS, PERIOD, PERIODS = 0.004, 8, 40, 30
"""Control period [s], physics steps in one, periods of the sine in control periods and in number."""
OMEGA = 2.0 * np.pi / (PERIOD * T)
H = T / SUBSTEPS
N = PERIOD * PERIODS


def gain(signal: Array, t: Array) -> complex:
    """Return the complex amplitude of a signal over the last third of the run, that of exp(j omega t)."""
    last = slice(2 * len(t) // 3, None)
    x, y = np.cos(OMEGA * t[last]), np.sin(OMEGA * t[last])
    basis = np.stack([x, y], axis=1)
    a, b = np.linalg.lstsq(basis, signal[last], rcond=None)[0]
    return complex(a, -b)


@pytest.mark.parametrize(
    "chain",
    [
        Chain(),
        Chain(measurement_delay=0.012),
        Chain(velocity="differentiated"),
        Chain(velocity="differentiated", velocity_filter=60.0, measurement_delay=0.004),
        Chain(velocity="tachometer", velocity_filter=60.0),
        Chain(velocity="kalman", encoder_noise=1e-3, kalman_acceleration=80.0),
    ],
)
def test_what_the_law_sees(chain: Chain) -> None:
    """A sine of the state comes out of the sensors' kernel with the stated gain and phase, after its start."""
    t = np.arange(N) * T
    q, qd = np.cos(OMEGA * t), -OMEGA * np.sin(OMEGA * t)
    sensors = chain.sensors(1, T, Drawn())
    seen_q, seen_qd, seen = np.zeros(1), np.zeros(1), np.zeros((N, 2))
    kernel = on_numbers(measure)
    for k in range(N):
        kernel(sensors, k, T, q[k : k + 1], qd[k : k + 1], seen_q, seen_qd)
        seen[k] = seen_q[0], seen_qd[0]
    wait = chain.measurement_steps(T)
    found = response(chain, np.array([OMEGA]), T)
    shown = np.vstack([np.tile(seen[0], (wait, 1)), seen])[:N]
    assert gain(shown[:, 0], t) == pytest.approx(found.position[0], rel=1e-9)
    assert gain(shown[:, 1], t) / (1j * OMEGA) == pytest.approx(found.velocity[0], rel=1e-6)


@pytest.mark.parametrize(
    ("chain", "tolerance"),
    [
        (Chain(command_filter=60.0), 1e-6),
        (Chain(command_delay=0.008), 1e-6),
        (Chain(torque_delay=3 * H), 1e-6),
        (Chain(actuator_lag=0.01), 1e-6),
        (Chain(current_loop=CurrentLoop(150.0, 0.5), torque_delay=H), 1e-5),
        (Chain(jitter=T), 0.03),
        (Chain(missed_deadlines=0.3), 0.03),
    ],
)
def test_what_reaches_the_joint(chain: Chain, tolerance: float) -> None:
    """A sine of the law's torque comes out of the drives' kernels likewise; where commands are drawn, on average.

    The tolerance is that of Simpson's rule over a physics step, or of the mean over 1200 draws.
    """
    drives = chain.drives(1, N, H, T, chain.draw(1, N, seed=1, draw=0))
    tau_max, before, output, torque = np.array([10.0]), np.zeros(1), np.zeros(1), np.zeros((3, 1))
    asked, given, qd, out = np.cos(OMEGA * np.arange(N) * T), np.zeros(1), np.zeros(1), np.zeros((N * SUBSTEPS, 3))
    commands, receives, acts = on_numbers(command), on_numbers(receive), on_numbers(drive)
    for k in range(N):
        commands(drives, k, asked[k : k + 1], before, tau_max, given)
        before[:] = given
        receives(drives, k, given)
        for s in range(SUBSTEPS):
            if s == (drives.late[k] if len(drives.late) and k else 0):
                drives.held[:] = drives.target
            acts(drives, k * SUBSTEPS + s, qd, tau_max, output, torque)
            out[k * SUBSTEPS + s] = torque[:, 0]
            if len(drives.late) and s + 1 == SUBSTEPS == drives.late[k]:
                drives.held[:] = drives.target
    start = np.arange(N * SUBSTEPS)[:, None] * H + np.array([0.0, 0.5, 1.0]) * H
    kept = slice(PERIOD * SUBSTEPS * PERIODS // 3, None)
    fourier = np.exp(-1j * OMEGA * start[kept]) * out[kept]
    mean = 2.0 * np.mean(fourier @ np.array([1.0, 4.0, 1.0]) / 6.0)
    assert mean == pytest.approx(response(chain, np.array([OMEGA]), T).torque[0], rel=tolerance)


def test_torques_leak_to_both_neighbours() -> None:
    """By the definition of cross-talk: joint i gets g_i u_i + following g_(i+1) u_(i+1) + preceding g_(i-1) u_(i-1)."""
    chain = Chain(torque_gain=(2.0, 3.0, 5.0), cross_talk=CrossTalk(following=0.1, preceding=0.01))
    wanted = [[2.0, 0.3, 0.0], [0.02, 3.0, 0.5], [0.0, 0.03, 5.0]]
    assert mixing(chain, 3, 0.0) == pytest.approx(np.array(wanted), rel=1e-15)


@pytest.mark.parametrize(
    ("over", "time", "gone"), [(0.2, 0.09, 0.0), (0.2, 0.15, 0.25), (0.2, 0.5, 1.0), (0.0, 0.1, 1.0)]
)
def test_weak_motors_give_a_share(over: float, time: float, gone: float) -> None:
    """From 0.1 s on the second joint's gain of 3 falls in a straight line to 40 % of it; leaks are of what is left."""
    talk = CrossTalk(following=0.1)
    chain = Chain(torque_gain=(2.0, 3.0), derating=Derating(0.1, gain=(1.0, 0.4), over=over), cross_talk=talk)
    left = 3.0 * (1.0 - 0.6 * gone)
    assert mixing(chain, 2, time) == pytest.approx(np.array([[2.0, 0.1 * left], [0.0, left]]), rel=1e-15)
