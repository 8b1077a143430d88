"""Chattering above a corner that follows the motion: its peak, and whether it is a limit cycle; known signals, arms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from torquebench import Key, Reference, Vector, controller, reference
from torquebench.errors import ConfigError
from torquebench.experiment import Experiment, load_experiment
from torquebench.experiment.run import run_experiment
from torquebench.kernel import Array, clip, sign
from torquebench.laws.parts import Slope, Switching, UseModel, equivalent_control
from torquebench.metrics import Metrics, from_joints, per_joint
from torquebench.metrics.chattering import chattering_index, is_of_motion
from torquebench.metrics.shaking import shaking
from torquebench.references.reference import highest_frequency
from torquebench.registry import restored
from torquebench.robot.flat_model import Model
from torquebench.sim.trajectory import Trajectory

T = 0.001
FIG9 = Path("configs/paper/fig9-chattering.yaml")
SLOW = {"velocity": "differentiated", "velocity_filter": 200, "actuator_lag": 0.008}
"""The chain `slow` with exact encoders."""
FAST = {"velocity": "differentiated", "velocity_filter": 500, "actuator_lag": 0.002}
SET_M = {"lam": 20, "k": 0.3, "phi": 1.0, "kv": 60, "kf": 0.3, "gd": 4, "ki": 15000}


def times(duration: float = 3.0, period: float = T) -> Array:
    """Control instants k T, (N,) [s]."""
    return period * np.arange(round(duration / period))


def of_torque(*signals: Array, period: float = T, from_hz: float = 8.0, motion_hz: tuple[float, ...] = ()) -> Metrics:
    """Metrics of a run with these torques, a joint each, and limits of 100 N m: figures are in N m."""
    tau = np.stack(signals, axis=1)
    zero = np.zeros_like(tau)
    t = times(len(tau) * period, period)
    run = Trajectory(t, zero, zero, zero, zero, zero, zero, zero, zero, tau, tau, tau)
    joints = per_joint(
        run,
        tau_max=np.full(len(signals), 100.0),
        metrics_from=0.0,
        control_period=period,
        step_like=False,
        chattering_from_hz=from_hz,
        motion_hz=motion_hz,
    )
    return from_joints(joints)


def sine(frequency: float, rms: float = 1.0, t: Array | None = None) -> Array:
    """A sine of a frequency [Hz] and an RMS."""
    return math.sqrt(2.0) * rms * np.sin(2 * math.pi * frequency * (times() if t is None else t) + 0.3)


def noise(seed: int, n: int = 3000) -> Array:
    """White noise of RMS 1."""
    return np.random.default_rng(seed).normal(size=n)


def encoder_noise(seed: int, filtered: float) -> Array:
    """What a rate gain makes of noise of an encoder: differentiated, and filtered at so many rad/s."""
    y, v, a = 1e-3 * noise(seed), np.zeros(3000), 1.0 - math.exp(-filtered * T)
    for k in range(1, 3000):
        v[k] = v[k - 1] + a * ((y[k] - y[k - 1]) / T - v[k - 1])
    return v + 10.0 * y


def test_chattering_counts_from_the_corner_on() -> None:
    """A sine of 12 Hz counts from 8 Hz on and not from 16 Hz on; HF does not see it; components add as squares."""
    torque = 5.0 + 3.0 * sine(12.0) + 4.0 * sine(40.0)
    got = of_torque(torque)
    assert got.chattering.value == pytest.approx(5.0, rel=1e-12)
    assert got.hf.value == pytest.approx(4.0, rel=1e-12)
    assert of_torque(torque, from_hz=16.0).chattering.value == pytest.approx(4.0, rel=1e-12)
    assert of_torque(torque, from_hz=30.0).chattering.value == got.hf.value


def test_chattering_is_undefined_for_slow_control_and_short_windows() -> None:
    """Up to a period of 0.3 / f_c, and from a window of 2 / f_c on; peak and limit cycle are then undefined too."""
    limit = np.array([100.0])
    assert np.isfinite(chattering_index(np.zeros((300, 1)), 0.0375, limit, 8.0)).all()
    assert np.isnan(chattering_index(np.zeros((300, 1)), 0.0376, limit, 8.0)).all()
    assert np.isfinite(chattering_index(np.zeros((250, 1)), T, limit, 8.0)).all()
    assert np.isnan(chattering_index(np.zeros((249, 1)), T, limit, 8.0)).all()
    slow = of_torque(noise(0), period=0.05)
    assert (slow.chattering.value, slow.chattering_peak.value, slow.limit_cycle.value) == (None, None, None)


def test_the_peak_is_that_of_the_joint_that_chatters_most() -> None:
    """Each joint has its own; one below 0.1 % has none, and is no limit cycle either."""
    got = of_torque(2.0 * sine(20.0), 5.0 * sine(15.0) + sine(90.0), 0.09 * sine(50.0))
    assert got.chattering_peak.per_joint == pytest.approx((20.0, 15.0, None))
    assert got.chattering_peak.value == pytest.approx(15.0)
    assert got.limit_cycle.per_joint[2] == 0.0
    silent = of_torque(0.05 * sine(20.0))
    assert (silent.chattering_peak.value, silent.limit_cycle.value) == (None, 0.0)
    assert of_torque(0.11 * sine(20.0)).limit_cycle.value == pytest.approx(0.11, rel=1e-9)


DRIFT = 2 * math.pi * 20.0 * times() + 2.0 / 0.5 * np.sin(2 * math.pi * 0.5 * times())


@pytest.mark.parametrize(
    ("torque", "least"),
    [
        (10.0 * sine(14.7), 0.999),
        (10.0 * sine(14.7) + 5.0 * noise(1), 0.85),
        (10.0 * sine(100.0) + 5.0 * noise(2), 0.85),
        (10.0 * np.sign(sine(21.0)), 0.98),  # harmonics up to the eleventh are within an eighth of 21 Hz
        (10.0 * np.where(np.arange(3000) % 2 == 0, 1.0, -1.0), 0.999),  # sgn(s) that switches at every instant
        (10.0 * np.where(np.arange(3000) % 4 < 2, 1.0, -1.0), 0.999),
        (10.0 * np.sin(DRIFT), 0.7),  # 18 to 22 Hz
        (10.0 * np.exp((times() - 3.0) / 0.5) * sine(15.0), 0.95),  # still growing
    ],
)
def test_a_limit_cycle_is_found_with_its_size(torque: Array, least: float) -> None:
    """Most of the chattering is its own, and no more than all of it."""
    got = of_torque(torque)
    assert got.limit_cycle.value is not None
    assert least * got.chattering.value <= got.limit_cycle.value <= got.chattering.value


@pytest.mark.parametrize(
    "torque",
    [
        *(10.0 * noise(seed) for seed in range(5)),
        *(encoder_noise(seed, filtered) for seed in range(5) for filtered in (200.0, 500.0, 1e9)),
        10.0 * np.sign(noise(7)),  # switching that noise has broken up
        10.0 * np.sin(2 * math.pi * (10.0 * times() + 5.0 * times() ** 2)),  # sweeps from 10 to 40 Hz
        5.0 * np.exp(-times() / 0.5) * sine(15.0),  # rings down
        20.0 * sine(1.0) + 5.0 * (times() > 1.3),  # a motion and a jump
    ],
)
def test_what_is_no_limit_cycle(torque: Array) -> None:
    """It chatters, some of it strongly, but not with a line that lasts."""
    got = of_torque(torque)
    assert got.chattering.value > 0.1
    assert got.limit_cycle.value == 0.0


@pytest.mark.parametrize(("period", "duration"), [(0.001, 0.5), (0.001, 1.0), (0.005, 2.0), (0.01, 1.5), (0.02, 4.0)])
def test_noise_is_never_taken_for_a_limit_cycle(period: float, duration: float) -> None:
    """Of 300 joints with noise none has one, in windows of 50 lines above f_c and more; with fewer it is unknown."""
    rng = np.random.default_rng(3)
    got = of_torque(*rng.normal(size=(300, round(duration / period))), period=period)
    assert set(got.limit_cycle.per_joint) <= {0.0, None}
    assert got.limit_cycle.per_joint.count(None) < 30
    few = of_torque(*rng.normal(size=(3, 50)), period=0.01)
    assert few.limit_cycle.per_joint == (None, None, None)
    assert few.chattering.value is not None


def test_harmonics_of_the_motion_are_no_limit_cycle() -> None:
    """A torque that bends with a motion of 1.5 Hz has lines that fall off; what swings by itself stands above them."""
    turning = sum((sine(1.5 * h, 200.0 / h**3, times(6.0)) for h in range(1, 41, 2)), np.zeros(6000))
    own = of_torque(turning, turning + sine(37.5, 3.0, times(6.0)), from_hz=12.0, motion_hz=(1.5,)).limit_cycle
    assert own.per_joint[0] == 0.0
    assert own.per_joint[1] == pytest.approx(3.0, rel=0.2)
    assert (of_torque(turning, from_hz=12.0).limit_cycle.value or 0.0) > 0.1


def test_of_less_than_eight_periods_it_is_unknown_whether_they_are_a_limit_cycle() -> None:
    """At 13 Hz: a window of 0.55 s holds 7, one of 0.65 s 8 of them."""
    assert of_torque(sine(13.0, t=times(0.55))).limit_cycle.value is None
    assert of_torque(sine(13.0, t=times(0.65))).limit_cycle.value == pytest.approx(1.0, rel=0.05)


def fig9(**changes: Any) -> Experiment:
    """Return Fig 9's experiment with changes."""
    return load_experiment(FIG9).with_(changes)


@pytest.mark.parametrize(
    ("motion", "corner"),
    [
        ({"kind": "sine", "amplitude": 1.0, "frequency_hz": [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]}, 8.0),
        ({"kind": "sine", "amplitude": 1.0, "frequency_hz": 0.1}, 8.0),
        ({"kind": "sine", "amplitude": 1.0, "frequency_hz": [0.5, 2.0, 0.7, 0.8, 0.9, 1.0]}, 16.0),
        ({"kind": "step", "target": 1.0, "at": 0.2}, 8.0),
        ({"kind": "ramp", "target": 1.0, "rise_time": 0.5}, 8.0),
        ({"kind": "quintic", "target": 1.0, "rise_time": 0.5}, 16.0),
    ],
)
def test_the_corner_follows_the_reference(motion: dict[str, Any], corner: float) -> None:
    """Eight times its highest frequency and at least 8 Hz, whatever the motion was before; a key overrides it."""
    assert fig9(reference=motion).chattering_from_hz == corner
    assert "chattering_from_hz" not in fig9(reference=motion).to_dict()["run"]
    given = fig9(reference=motion, **{"run.chattering_from_hz": 12.5})
    assert given.chattering_from_hz == 12.5
    assert given.to_dict()["run"]["chattering_from_hz"] == 12.5


@pytest.mark.parametrize(
    ("value", "wanted"),
    [(301, "at most 300 Hz, 0.3 / run.control_period"), (0.5, "at least 0.666667 Hz"), (0, "more than 0")],
)
def test_a_corner_that_leaves_nothing_to_measure_is_refused(value: float, wanted: str) -> None:
    """Above 0.3 / T, or with less than two periods in the window."""
    with pytest.raises(ConfigError) as caught:
        fig9(**{"run.chattering_from_hz": value})
    assert "run.chattering_from_hz" in str(caught.value)
    assert wanted in str(caught.value)


def test_a_kind_of_ones_own_says_its_highest_frequency_or_it_is_found() -> None:
    """From the sampled velocity: 3 Hz to a line's width; what the kind says has precedence, and its errors are told."""
    with restored():

        @reference("swing")
        @dataclass(frozen=True)
        class Swing:
            """A motion of 3 Hz."""

            amplitude: Annotated[Vector, Key("Amplitude", "rad")] = 0.1

            def sample(self, t: Array, n: int) -> Reference:
                w = 6 * math.pi
                wave = self.amplitude * np.stack([1 - np.cos(w * t), w * np.sin(w * t), w * w * np.cos(w * t)])
                return Reference(*(np.repeat(x[:, None], n, axis=1) for x in wave))

        assert fig9(reference={"kind": "swing"}).chattering_from_hz == pytest.approx(24.0, abs=8 * 2 * 0.25)
        Swing.highest_hz = lambda self: 4.0
        assert fig9(reference={"kind": "swing"}).chattering_from_hz == 32.0
        Swing.highest_hz = lambda self: self.nothing
        with pytest.raises(ConfigError, match="its kind failed: AttributeError"):
            run_experiment(fig9(reference={"kind": "swing"}))
    assert highest_frequency(np.zeros((100, 2)), T) == 0.0


def test_the_page_and_files_of_a_run_tell_the_corner() -> None:
    """metrics.json says from where chattering counts, the table has it before HF."""
    from torquebench.report.tables import headline_table

    result = run_experiment(fig9(**{"run.duration": 2.0}))
    header, _ = headline_table(result)
    assert header[6:10] == ["chattering [%]", "peak [Hz]", "cycle [%]", "HF [%]"]


def laws(**more: Any) -> list[dict[str, Any]]:
    """Return the controllers of the referee's table, and any others."""
    literature = {"lam": 10, "k": 0.3, "phi": 0.3}
    return [
        {"name": "conventional", "law": "smc", "gains": {"lam": 10, "k": 0.3}},
        {"name": "band", "law": "smc", "switching": "saturation", "gains": literature},
        {"name": "linear-band", "law": "linear-band-smc", "gains": literature | {"kv": 20}},
        {"name": "set-m", "law": "fuzzy-linear-band-smc", "equivalent_control": False, "gains": SET_M},
        {"name": "set-m-model", "law": "fuzzy-linear-band-smc", "gains": SET_M},
        *more.values(),
    ]


# An independent program's figures for the sine on `slow` with exact encoders: RMS above 8 Hz [%], peak [Hz], HF [%].
SLOW_CHAIN = {
    0.0: {"conventional": (31.1, 21.0, 13.1)},
    0.003: {"linear-band": (15.0, 15.7, 0.88), "set-m-model": (62.8, 14.0, 3.3)},
    0.004: {
        "band": (12.2, 14.7, 0.54),
        "linear-band": (16.9, 14.7, 1.9),
        "set-m": (64.8, 13.0, 3.3),
        "set-m-model": (75.4, 14.0, 7.8),
    },
}


@pytest.mark.parametrize("delay", sorted(SLOW_CHAIN))
def test_the_slow_chain_hammers_below_30_hz(delay: float) -> None:
    """Within 1 % of an independent program's figures, nearly all of it a limit cycle; HF sees little of it."""
    chain = SLOW | ({"measurement_delay": delay} if delay else {})
    metrics = run_experiment(fig9(controllers=laws(), chain=chain)).metrics
    for name, (index, peak, hf) in SLOW_CHAIN[delay].items():
        own = metrics[name]
        assert own.chattering.value == pytest.approx(index, rel=0.01)
        assert own.chattering_peak.value == pytest.approx(peak, abs=0.7)
        assert own.hf.value == pytest.approx(hf, rel=0.05)
        assert own.limit_cycle.value > 0.95 * own.chattering.value
    if delay == 0.0:
        for name in ("band", "linear-band", "set-m", "set-m-model"):
            assert metrics[name].chattering.value < 0.02
            assert metrics[name].limit_cycle.value == 0.0


class LimitedMemory(NamedTuple):
    """The sliding variable, the velocity seen last, the torque of the last instant."""

    s: Array
    velocity: Array
    last: Array


class LimitedGains(NamedTuple):
    """Gains of conventional control."""

    lam: Slope
    k: Switching
    equivalent_control: UseModel


def limited_smc(
    gains: LimitedGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: LimitedMemory, tau: Array
) -> None:
    """Conventional sliding mode whose torque changes by at most tau_max in 20 ms."""
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        memory.s[i] = s
        change = tau[i] + gains.k[i] * model.tau_max[i] * sign(s) - memory.last[i]
        tau[i] = memory.last[i] + clip(change, model.tau_max[i] * model.control_period / 0.02)
        memory.last[i] = tau[i]


def test_a_limited_rate_of_the_torque_hides_no_chattering() -> None:
    """On `fast` it hammers with 24 % at 24 Hz, of which HF sees 1.8 %."""
    with restored():
        controller("limited-smc", gains=LimitedGains, memory=LimitedMemory)(limited_smc)
        only = [{"name": "limited", "law": "limited-smc", "gains": {"lam": 10, "k": 0.3}}]
        for chain in (FAST, "fast"):
            own = run_experiment(fig9(controllers=only, chain=chain)).metrics["limited"]
            assert own.chattering.value == pytest.approx(24.0, rel=0.2 if chain == "fast" else 0.02)
            assert own.limit_cycle.value > 0.9 * own.chattering.value
            assert own.hf.value < 3.5


def test_the_linear_law_of_equal_slope_tells_noise_from_switching() -> None:
    """A band too wide to leave is tau_eq + (K/phi + Kd) s; on `fast` and `slow` it has the linear band's chattering.

    The same law without a band at all, by a rate gain of K/(phi Mbar) + kV for each joint, agrees to round-off.
    """
    limit, scale = (97.6, 186.4, 89.4, 24.2, 20.1, 21.3), (4.0, 7.0, 1.2, 0.20, 0.18, 0.19)
    kv = [0.3 * most / (0.3 * own) + 20.0 for most, own in zip(limit, scale, strict=True)]
    wide = {"name": "wide", "law": "linear-band-smc", "gains": {"lam": 10, "k": 1000, "phi": 1000, "kv": 20}}
    off = {"compensation": "off", "integral": False, "band": "off"}
    plain = {"name": "plain", "law": "fuzzy-linear-band-smc", **off, "gains": {"lam": 10, "kv": kv}}
    for chain, index in (("fast", 7.24), ("slow", 3.24)):
        metrics = run_experiment(fig9(controllers=laws(wide=wide, plain=plain), chain=chain)).metrics
        own = metrics["wide"].chattering.value
        assert own == pytest.approx(index, rel=0.01)
        assert metrics["plain"].chattering.value == pytest.approx(own, rel=1e-9)
        assert metrics["linear-band"].chattering.value == pytest.approx(own, rel=1e-3)
        assert metrics["linear-band"].limit_cycle.value == 0.0


def test_corners_of_saturation_are_no_shaking() -> None:
    """A slow torque cut off at its limit chatters by its corners and does not shake; what also swings or switches does.

    One swings at 30 Hz beside a torque that is cut off, one by itself and is cut off a fifth of the time, and noise
    throws one from limit to limit, so that it is always at one. Of two joints the one that swings is told.
    """
    cut = np.clip(sine(1.0, 200.0), -100.0, 100.0)
    both = np.clip(sine(1.0, 75.0) + sine(30.0, 8.0), -100.0, 100.0)
    switched = 100.0 * np.sign(np.random.default_rng(1).standard_normal(len(cut)))
    limits = [100.0, 100.0]
    found = of_torque(cut, cut)
    assert found.chattering.value is not None
    assert found.chattering.value > 1.0
    assert shaking(found, limits) is None
    for other in (sine(30.0, 2.0), both, switched):
        seen = shaking(of_torque(cut, other), limits)
        assert seen is not None
        assert seen.joint == 1


@pytest.mark.parametrize(("share", "is_motion"), [(0.45, False), (0.55, True)])
def test_torque_that_a_motion_takes_is_a_quarter_of_the_power(share: float, is_motion: bool) -> None:
    """Half the amplitude is a quarter of the power; what the motion takes at other frequencies does not count."""
    t = np.arange(1500) * 1e-3
    tau, slow = np.sin(2.0 * np.pi * 12.0 * t), 50.0 * np.sin(2.0 * np.pi * 1.0 * t)
    assert is_of_motion(tau, share * tau + slow, 1e-3, 12.0) == is_motion
