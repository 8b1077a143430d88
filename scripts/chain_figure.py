"""Draw docs/images/chain-parts.png: what each part of a chain makes of a sine, by the loop's own kernels."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from torquebench.chain import Chain, CrossTalk, CurrentLoop, Derating, Ripple, ThermalLimit, TorqueSpeed
from torquebench.chain.drives import command, drive, receive
from torquebench.chain.sensors import measure
from torquebench.kernel import Array
from torquebench.kernel.twin import on_numbers

ROOT = Path(__file__).resolve().parents[1]
T, H, FREQUENCY, PERIODS = 0.005, 0.001, 5.0, 8
OMEGA = 2.0 * math.pi * FREQUENCY
N, SUBSTEPS = round(PERIODS / FREQUENCY / T), round(T / H)
ANGLE, TORQUE = 0.1, 10.0
"""Amplitudes of the sines [rad], [N m]."""
SHOWN = 2.0 / FREQUENCY
"""Length of what is drawn, the end of the run [s]."""
INK, BEFORE = "#d55e00", "0.72"

SENSORS = {
    "encoder_noise": ("5 mrad", Chain(encoder_noise=0.005)),
    "encoder_offset": ("20 mrad", Chain(encoder_offset=0.02)),
    "encoder_ripple": ("10 mrad, 60 cycles", Chain(encoder_ripple=Ripple(0.01, 60.0))),
    "quantisation": ("30 mrad", Chain(quantisation=0.03)),
    "measurement_delay": ("15 ms", Chain(measurement_delay=3 * T)),
    "velocity: differentiated": ("encoder steps of 5 mrad", Chain(velocity="differentiated", quantisation=0.005)),
    "velocity_filter": (
        "50 rad/s, steps of 5 mrad",
        Chain(velocity="differentiated", velocity_filter=50, quantisation=0.005),
    ),
    "velocity: tachometer": ("noise 0.3 rad/s", Chain(velocity="tachometer", velocity_noise=0.3)),
    "velocity: kalman": (
        "30 rad/s^2 expected",
        Chain(velocity="kalman", kalman_acceleration=30, quantisation=0.005),
    ),
}
DRIVES = {
    "the hold alone": ("5 ms", Chain(torque_quantum=1e-12)),
    "command_filter": ("60 rad/s", Chain(command_filter=60.0, torque_quantum=1e-12)),
    "torque_rate": ("150 N m/s", Chain(torque_rate=150.0, torque_quantum=1e-12)),
    "missed_deadlines": ("40 %", Chain(missed_deadlines=0.4)),
    "jitter": ("5 ms", Chain(jitter=T)),
    "command_delay": ("15 ms", Chain(command_delay=3 * T)),
    "torque_quantum": ("3 N m", Chain(torque_quantum=3.0)),
    "torque_gain": ("0.7", Chain(torque_gain=0.7)),
    "torque_offset": ("3 N m", Chain(torque_offset=3.0)),
    "actuator_lag": ("15 ms", Chain(actuator_lag=0.015)),
    "current_loop": ("80 rad/s, damping 0.3", Chain(current_loop=CurrentLoop(80.0, 0.3))),
    "torque_speed": ("0.5 to 3 rad/s", Chain(torque_speed=TorqueSpeed(0.5, 3.0))),
    "thermal_limit": ("5 N m, 0.5 s", Chain(thermal_limit=ThermalLimit(5.0, 0.5))),
    "derating": (
        "at 100 ms to gain 0.8, limit 50 %",
        Chain(derating=Derating(N * T - SHOWN + 0.1, limit=0.5, gain=0.8, over=0.1)),
    ),
    "cross_talk": ("half of a cosine", Chain(cross_talk=CrossTalk(following=0.5))),
    "torque_delay": ("7 ms", Chain(torque_delay=7 * H)),
}


def sensed(chain: Chain) -> tuple[Array, Array, Array]:
    """Return time, what is measured, (N,), and the sine of the state: the position's, or the velocity's in rad/s."""
    t = T * np.arange(N)
    q, qd = ANGLE * np.sin(OMEGA * t), ANGLE * OMEGA * np.cos(OMEGA * t)
    sensors, kernel = chain.sensors(1, T, chain.draw(1, N, seed=1, draw=0)), on_numbers(measure)
    position, velocity, seen = np.zeros(1), np.zeros(1), np.zeros((N, 2))
    for k in range(N):
        kernel(sensors, k, T, q[k : k + 1], qd[k : k + 1], position, velocity)
        seen[k] = position[0], velocity[0]
    late = np.maximum(np.arange(N) - chain.measurement_steps(T), 0)
    return (t, seen[late, 0], q) if chain.velocity == "exact" else (t, seen[:, 1], qd)


def driven(chain: Chain) -> tuple[Array, Array, Array]:
    """Return time, the motor's torque and the law's, (N SUBSTEPS,), on a joint that moves by the sine above.

    The joint beside it is asked for the cosine.
    """
    drives = chain.drives(2, N, H, T, chain.draw(2, N, seed=1, draw=0))
    t, most = H * np.arange(N * SUBSTEPS), np.full(2, TORQUE)
    before, output, torque, given, out = np.zeros(2), np.zeros(2), np.zeros((3, 2)), np.zeros(2), np.zeros(len(t))
    commands, receives, acts = on_numbers(command), on_numbers(receive), on_numbers(drive)
    for i, time in enumerate(t):
        k, s = divmod(i, SUBSTEPS)
        if s == 0:
            asked = TORQUE * np.array([math.sin(OMEGA * time), math.cos(OMEGA * time)])
            commands(drives, k, asked, before, most, given)
            before[:] = given
            receives(drives, k, given)
        if s == (drives.late[k] if len(drives.late) and k else 0):
            drives.held[:] = drives.target
        acts(drives, i, np.array([ANGLE * OMEGA * math.cos(OMEGA * time), 0.0]), most, output, torque)
        out[i] = torque[0, 0]
        if len(drives.late) and s + 1 == SUBSTEPS == drives.late[k]:
            drives.held[:] = drives.target
    return t, out, TORQUE * np.sin(OMEGA * t)


def in_words(t: Array, out: Array, sine: Array) -> str:
    """Return gain and phase of the first harmonic over all but the first quarter of the periods."""
    kept = slice(len(t) // 4, None)
    gain = np.sum(out[kept] * np.exp(-1j * OMEGA * t[kept])) / np.sum(sine[kept] * np.exp(-1j * OMEGA * t[kept]))
    phase = math.degrees(np.angle(gain))
    return f"gain {abs(gain):.2f}, {phase:+.0f} deg".replace("+0 deg", "0 deg").replace("-0 deg", "0 deg")


def main() -> None:
    """Draw the figure."""
    panels = []
    for key, (words, chain) in (SENSORS | DRIVES).items():
        label = "torque [N m]" if key in DRIVES else "q [mrad]" if chain.velocity == "exact" else "qd [rad/s]"
        panels.append((key, words, label, *(driven if key in DRIVES else sensed)(chain)))
    plt.rcParams.update({"font.size": 8, "axes.titlesize": 8.5, "axes.spines.top": False, "axes.spines.right": False})
    fig, axes = plt.subplots(9, 3, figsize=(9.0, 16.7), sharex=True, layout="constrained")
    for ax, (key, words, label, t, out, sine) in zip(axes.flat, panels, strict=False):
        late, scale = t >= t[-1] - SHOWN, 1e3 if "mrad" in label else 1.0
        ms = 1e3 * (t[late] - t[late][0])
        ax.plot(ms, scale * sine[late], color=BEFORE, linewidth=2.5)
        ax.step(ms, scale * out[late], where="post", color=INK, linewidth=1.1)
        ax.set_title(f"{key}\n", loc="left", fontweight="bold")
        ax.text(0.0, 1.04, words, transform=ax.transAxes, color="0.35", fontsize=7.5)
        said = in_words(t, out, sine) if key != "derating" else ""  # it is not the same all the time
        ax.text(1.0, 1.04, said, transform=ax.transAxes, ha="right", fontsize=7.5)
        ax.set_ylabel(label)
    for ax in axes.flat[len(panels) :]:
        ax.remove()
    for ax in axes.flat[len(panels) - 3 : len(panels)]:
        ax.set_xlabel("time [ms]")
        ax.tick_params(labelbottom=True)
    fig.savefig(ROOT / "docs" / "images" / "chain-parts.png", dpi=110)


if __name__ == "__main__":
    main()
