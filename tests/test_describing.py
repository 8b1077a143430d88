"""Limit cycles predicted by describing functions: against integrals, phase conditions by hand, and simulated loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, optimize

from tests.arms import PENDULUM_INERTIA, pendulum, still
from tests.sampled import simulate_sampled
from torquebench import AnalyticPlant
from torquebench.chain import Chain
from torquebench.describing import Arm, critical, relay_cycle, saturating, square_wave, swings
from torquebench.laws import find_law
from torquebench.metrics.chattering import chattering_index
from torquebench.references import Quintic
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import Trajectory

T, LAM = 0.001, 10.0
DELAYS = (0.005, 0.01, 0.02)


@pytest.mark.parametrize("amplitude", [0.3, 1.0, 1.7, 20.0])
def test_the_describing_function_of_a_saturation_is_its_fourier_integral(amplitude: float) -> None:
    """(2/(pi A)) times the integral of sat(A sin x) sin x over half a period; quad's own accuracy."""
    part, _ = integrate.quad(lambda x: min(1.0, amplitude * math.sin(x)) * math.sin(x), 0.0, 0.5 * math.pi, limit=200)
    assert saturating(np.array([amplitude]))[0] == pytest.approx(4.0 * part / (math.pi * amplitude), rel=1e-6)


@pytest.mark.parametrize("delay", DELAYS)
def test_a_relay_behind_a_delay_swings_where_the_phase_is_used_up(delay: float) -> None:
    """atan(omega/lambda) = omega (delay + T/2), A = 4 K |j omega + lambda| / (pi M omega^2) times the hold's gain.

    Frequencies are interpolated linearly on a grid of 400: 0.1 %.
    """
    omega = optimize.brentq(lambda w: math.atan(w / LAM) - w * (delay + 0.5 * T), 1.0, math.pi / T)
    hold = math.sin(0.5 * omega * T) / (0.5 * omega * T)
    found = relay_cycle(Chain(measurement_delay=delay), T, LAM, gain=20.0)
    assert found is not None
    assert found.frequency == pytest.approx(omega / (2.0 * math.pi), rel=1e-3)
    assert found.amplitude == pytest.approx(80.0 * hold * math.hypot(omega, LAM) / (math.pi * omega**2), rel=1e-3)


@pytest.mark.parametrize("mean", [0.0, -0.3, 0.9, 1.0])
@pytest.mark.parametrize("corner", [1.0, 8.0, 25.0])
def test_a_square_wave_has_above_a_corner_what_its_spectrum_says(mean: float, corner: float) -> None:
    """By an FFT of 1000 periods of 10,000 samples each; up to harmonic 200 it has all but 0.2 % of its power."""
    wave = np.where(np.arange(10000) < 5000 * (1.0 + mean), 1.0, -1.0)
    lines = np.abs(np.fft.rfft(wave)) / 10000.0  # at multiples of 10 Hz
    lines[0] = 0.0
    heard = math.sqrt(2.0 * np.sum(lines[10.0 * np.arange(5001) >= corner] ** 2))
    assert square_wave(np.array(mean), 10.0, corner) == pytest.approx(heard, abs=5e-3)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_relay_that_carries_a_load_switches_unevenly(share: float) -> None:
    """Where gravity asks for a share of K the torque's RMS above 8 Hz is that of a square wave with this mean, to 5 %.

    Where it asks for more than K the joint falls and nothing switches.
    """
    chain, arm = Chain(measurement_delay=0.01), pendulum()
    load = float(arm.gravity([0.3])[0])
    own = find_law("smc")
    for part in (share, 1.1):
        gains = {"lam": LAM, "k": load / part / float(arm.flat.tau_max[0])}
        law = Controller("c", own, own.pack_gains(1, gains, {"equivalent_control": False}))
        run = simulate_sampled(AnalyticPlant(arm), law, arm, still(np.array([0.3])), duration=4.0, chain=chain)
        found = chattering_index(run.tau[-2000:], T, np.array([100.0]), 8.0)[0]
        cycle = relay_cycle(chain, T, LAM, 1.0)
        assert cycle is not None
        wanted = load / part * square_wave(np.array(part), cycle.frequency, 8.0) if part < 1.0 else 0.0
        assert found == pytest.approx(wanted, rel=0.05, abs=1e-2)


def held(law: str, chain: Chain, gains: dict[str, float], options: dict[str, object]) -> Trajectory:
    """Return 3 s of one joint without gravity that moves 0.3 rad and then holds its position."""
    own = find_law(law)
    controller = Controller("c", own, own.pack_gains(1, gains, options))
    arm = pendulum(gravity=0.0)
    return simulate_sampled(AnalyticPlant(arm), controller, arm, Quintic([0.3], 0.8), duration=3.0, chain=chain)


@pytest.mark.parametrize("delay", DELAYS)
def test_a_simulated_relay_swings_as_predicted(delay: float) -> None:
    """Frequency and amplitude of s on one joint, without a model.

    A switch is seen up to one sample late, twice a period, so that the period may be two samples longer; the third
    harmonic, which is left out, is 1/27 of a double integrator's first, and amplitudes follow the period: 10 %.
    """
    chain = Chain(measurement_delay=delay)
    run = held("smc", chain, {"lam": LAM, "k": 0.3}, {"equivalent_control": False})
    found = relay_cycle(chain, T, LAM, gain=float(abs(run.tau[-1, 0])) / PENDULUM_INERTIA)
    assert found is not None
    s = (run.qd_ref - run.qd + LAM * (run.q_ref - run.q))[-1500:, 0]
    rises = np.flatnonzero((s[:-1] < 0.0) & (s[1:] >= 0.0))
    frequency = (len(rises) - 1) / ((rises[-1] - rises[0]) * T)
    turns = frequency * T * np.arange(rises[-1] - rises[0])
    first = 2.0 * np.abs(np.mean(s[rises[0] : rises[-1]] * np.exp(-2j * math.pi * turns)))
    assert 1.0 / frequency == pytest.approx(1.0 / found.frequency, abs=2.0 * T)
    assert first == pytest.approx(found.amplitude, rel=0.10)


@pytest.mark.parametrize("chain", [Chain(measurement_delay=0.01), Chain(actuator_lag=0.02, command_delay=0.004)])
@pytest.mark.parametrize("model", [True, False])
def test_a_layer_starts_to_swing_at_the_predicted_gain(chain: Chain, model: bool) -> None:
    """At 0.95 of the predicted D/M one simulated joint comes to rest in its layer, at 1.05 it swings for ever."""
    (least,), _ = critical(chain, T, LAM, float(model), np.zeros(1))
    for share, rests in ((0.95, True), (1.05, False)):
        phi = 12.0 / (share * least * PENDULUM_INERTIA)
        gains = {"lam": LAM, "k": 0.3, "phi": phi}
        run = held("smc", chain, gains, {"equivalent_control": model, "switching": "saturation"})
        late = np.abs(run.s[:, 0])
        assert (np.max(late[-500:]) < 0.7 * np.max(late[-1500:-1000])) == rests
        K, width, none, M = np.array([12.0]), np.array([phi]), np.zeros(1), np.array([[[PENDULUM_INERTIA]]])
        assert swings(Arm(M, none, none, 1.0), chain, T, LAM, float(model) * M, K, width, none) == (not rests)


def test_friction_raises_the_gain_at_which_a_layer_swings() -> None:
    """Viscous friction adds damping, and Coulomb friction at most as much as its slope; both only ever help."""
    chain, M = Chain(measurement_delay=0.01), np.array([[[PENDULUM_INERTIA]]])
    (least,), _ = critical(chain, T, LAM, 0.0, np.zeros(1))
    K, none = np.array([12.0]), np.zeros(1)
    phi = K / (1.1 * least * PENDULUM_INERTIA)
    assert swings(Arm(M, none, none, 0.01), chain, T, LAM, 0.0 * M, K, phi, none)
    assert not swings(Arm(M, np.array([20.0]), none, 0.01), chain, T, LAM, 0.0 * M, K, phi, none)
    assert not swings(Arm(M, none, np.array([13.0]), 0.01), chain, T, LAM, 0.0 * M, K, phi, none)
