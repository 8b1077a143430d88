"""Torque noise: its spectrum, its size, and that every draw can be had again alone."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from torquebench.disturbances import BandLimitedNoise, Bias, Sinusoid, Stream, band_limited_noise, generator
from torquebench.kernel import Array
from torquebench.timing import Timing

SIGMA = np.array([5.06, 16.59, 3.30, 0.54, 0.62, 0.81])
"""The protocol's standard deviations [N m]."""
HOLD, T = 10, 0.001
"""Control periods that a value lasts, and the control period [s]."""
SAMPLES = 1_000_000


@pytest.fixture(scope="module")
def noise() -> Array:
    """A million control instants of two joints, sigma 1 and 5 N m."""
    return band_limited_noise(np.array([1.0, 5.0]), HOLD, SAMPLES, generator(7, 0, Stream.TORQUE_NOISE))


@pytest.fixture(scope="module")
def spectrum(noise: Array) -> tuple[Array, Array]:
    """Frequencies [Hz] and power in dB relative to that at zero frequency, by Welch's method.

    Two thousand one-second segments: each 1 Hz bin is good to 1/sqrt(2000), 0.1 dB.
    """
    segments = (noise / [1.0, 5.0]).T.reshape(-1, 1000)
    window = np.hanning(1000)
    power = np.mean(np.abs(np.fft.rfft(segments * window, axis=1)) ** 2, axis=0)
    # power per hertz of independent values at zero frequency: variance times hold, the window's energy apart
    return np.fft.rfftfreq(1000, T), 10.0 * np.log10(power / (HOLD * np.sum(window * window)))


def sinc2_db(f: Array) -> Array:
    """Return sinc^2(f hold) in dB."""
    return 20.0 * np.log10(np.abs(np.sinc(f * HOLD * T)))


def test_spectrum_is_that_of_a_hold(spectrum: tuple[Array, Array]) -> None:
    """Within 1 dB of sinc^2(f hold) from 1 to 80 Hz, in level as well as in shape: -1 dB at 26 Hz, -3 dB at 44 Hz.

    What is left is the estimate's own 0.1 dB (four times that at worst of 80 bins), 0.1 dB of sampling at 1 ms, and
    0.02 dB of clipping.
    """
    f, level = spectrum
    band = (f >= 1) & (f <= 80)
    assert level[band] == pytest.approx(sinc2_db(f[band]), abs=1.0)
    for at, db in ((26, -1.0), (44, -3.0)):
        # five bins, 0.05 dB; the shape is straight to 0.05 dB over 4 Hz, and the round numbers are good to 0.1 dB
        assert np.mean(level[at - 2 : at + 3]) == pytest.approx(db, abs=0.25)


def test_nulls_and_first_side_lobe(spectrum: tuple[Array, Array]) -> None:
    """Nothing at multiples of 1/hold = 100 Hz; between the first two the level peaks near 143 Hz at -13 dB."""
    f, level = spectrum
    for null in (100, 200, 300):
        assert level[null] < -35.0
    lobe = slice(110, 190)
    # a maximum over noisy bins is biased up by 0.2 dB, sampling at 1 ms adds 0.3 dB to sinc^2's -13.26 dB
    assert np.max(level[lobe]) == pytest.approx(-13.0, abs=0.7)
    assert 130 < f[lobe][np.argmax(level[lobe])] < 156


def test_standard_deviation(noise: Array) -> None:
    """Within 1 % of sigma over a million samples (clipping at 3 sigma takes 0.25 %); no mean."""
    deviation = np.std(noise / [1.0, 5.0], axis=0)
    assert deviation == pytest.approx([1.0, 1.0], rel=0.01)
    # 100 000 independent values: 4/sqrt(1e5)
    assert np.mean(noise / [1.0, 5.0], axis=0) == pytest.approx([0.0, 0.0], abs=4.0 / math.sqrt(SAMPLES / HOLD))


def test_values_are_gaussian_before_clipping(noise: Array) -> None:
    """Fractions beyond 1 and 2 sigma are 31.7 and 4.55 per cent; 0.27 per cent sit exactly at 3 sigma, none beyond."""
    x = np.abs(noise[::HOLD] / [1.0, 5.0])
    for z in (1.0, 2.0):
        p = math.erfc(z / math.sqrt(2.0))
        assert np.mean(x > z) == pytest.approx(p, abs=4.0 * math.sqrt(p * (1.0 - p) / x.size))
    clipped, p = np.mean(x == 3.0), math.erfc(3.0 / math.sqrt(2.0))
    assert clipped == pytest.approx(p, abs=4.0 * math.sqrt(p / x.size))
    assert np.max(x) == 3.0
    assert np.min(noise[:, 1]) == -15.0


@pytest.mark.parametrize(("hold", "n_steps"), [(1, 50), (7, 50), (10, 50), (10, 5), (50, 50), (64, 200)])
def test_values_are_held(hold: int, n_steps: int) -> None:
    """The torque changes at multiples of the hold, there and nowhere else, and the last hold may be cut."""
    d = band_limited_noise(SIGMA, hold, n_steps, generator(1, 0, Stream.TORQUE_NOISE))
    assert d.shape == (n_steps, 6)
    changes = np.any(np.diff(d, axis=0) != 0.0, axis=1)
    assert np.array_equal(np.flatnonzero(changes) + 1, np.arange(hold, n_steps, hold))


def test_sigma_scales_each_joint_and_clipping_follows() -> None:
    """A joint's torque is sigma times a number that does not depend on sigma; a zero sigma gives none."""
    unit = band_limited_noise(np.ones(6), HOLD, 500, generator(3, 1, Stream.TORQUE_NOISE))
    assert np.array_equal(band_limited_noise(SIGMA, HOLD, 500, generator(3, 1, Stream.TORQUE_NOISE)), unit * SIGMA)
    assert not np.any(band_limited_noise(np.zeros(6), HOLD, 500, generator(3, 1, Stream.TORQUE_NOISE)))
    tight = band_limited_noise(np.ones(6), HOLD, 500, generator(3, 1, Stream.TORQUE_NOISE), clip_sigma=0.5)
    assert np.array_equal(tight, np.clip(unit, -0.5, 0.5))


def test_longer_runs_begin_like_shorter_ones() -> None:
    """The first seconds of a draw do not depend on how long the run is."""
    short = band_limited_noise(SIGMA, HOLD, 333, generator(5, 2, Stream.TORQUE_NOISE))
    assert np.array_equal(short, band_limited_noise(SIGMA, HOLD, 4000, generator(5, 2, Stream.TORQUE_NOISE))[:333])


def draw(seed: int = 7, run: int = 0, stream: Stream = Stream.TORQUE_NOISE, index: int = 0) -> Array:
    """Return twenty thousand independent values of six joints."""
    return band_limited_noise(np.ones(6), 1, 20_000, generator(seed, run, stream, index))


def test_the_same_key_gives_the_same_bytes() -> None:
    """A draw is a pure function of its key: alone, after others, or twice."""
    alone = draw(run=4).tobytes()
    for k in range(4):
        draw(run=k)
    assert draw(run=4).tobytes() == alone


def test_every_part_of_the_key_matters_and_nothing_is_correlated() -> None:
    """Joints, draws, streams, indices and seeds are independent: |r| < 4/sqrt(N) between any two columns."""
    keys = [
        (7, 0, Stream.TORQUE_NOISE, 0),
        (7, 1, Stream.TORQUE_NOISE, 0),
        (7, 2, Stream.TORQUE_NOISE, 0),
        (7, 0, Stream.MISMATCH, 0),
        (7, 0, Stream.TORQUE_NOISE, 1),
        (8, 0, Stream.TORQUE_NOISE, 0),
        (7, 1, Stream.MISMATCH, 0),
        (7, 0, Stream.MISMATCH, 1),
    ]
    columns = np.concatenate([draw(*key) for key in keys], axis=1)
    r = np.corrcoef(columns, rowvar=False) - np.eye(columns.shape[1])
    # 1128 pairs: 4 sigma is exceeded by chance in 7 % of seeds; these are fixed
    assert np.max(np.abs(r)) < 4.0 / math.sqrt(len(columns))


def test_successive_values_are_uncorrelated() -> None:
    """Values one, two and ten holds apart are independent, so nothing but the hold shapes the spectrum."""
    x = draw()
    for lag in (1, 2, 10):
        for i, j in itertools.product(range(6), repeat=2):
            r = np.mean(x[:-lag, i] * x[lag:, j])
            assert abs(r) < 4.5 / math.sqrt(len(x))


def test_streams_have_fixed_numbers() -> None:
    """A stream's number is part of every stored result's key: none may be renumbered, only added."""
    assert Stream.MISMATCH == 0
    assert Stream.TORQUE_NOISE == 1
    assert len({int(s) for s in Stream}) == len(Stream)


def test_a_bias_is_the_same_torque_always() -> None:
    """Each row is the vector itself."""
    rng = generator(0, 0, Stream.TORQUE_NOISE)
    assert Bias(tuple(SIGMA)).sample(6, T * np.arange(7), T, rng).tolist() == [SIGMA.tolist()] * 7


def test_a_sinusoid_of_whole_periods_has_its_rms_and_no_other_line() -> None:
    """Over 4 s at 1 ms the RMS is a/sqrt(2), and the spectrum is one line at f of each joint, sine phase.

    1e-12 of the amplitude is the rounding of sin at arguments up to 63 rad, a few 1e-15, over 4000 samples.
    """
    f = np.array([1.0, 2.5, 0.5, 40.0, 125.0, 3.25])
    swing = Sinusoid(tuple(SIGMA), frequency_hz=tuple(f))
    d = swing.sample(6, T * np.arange(4000), T, generator(0, 0, Stream.TORQUE_NOISE))
    assert np.sqrt(np.mean(d * d, axis=0)) == pytest.approx(SIGMA / math.sqrt(2.0), rel=1e-12)
    lines = np.fft.rfft(d, axis=0) / 2000.0
    wanted = np.zeros_like(lines)
    for joint in range(6):
        wanted[round(4.0 * f[joint]), joint] = -1j * SIGMA[joint]
    assert np.max(np.abs(lines - wanted)) < 1e-12 * np.max(SIGMA)


def test_a_sinusoid_has_the_rms_that_was_asked_for() -> None:
    """Given its RMS instead of its amplitude, the RMS over whole periods is that; joints may differ."""
    d = Sinusoid(rms=tuple(SIGMA), frequency_hz=2.0).sample(
        6, T * np.arange(4000), T, generator(0, 0, Stream.TORQUE_NOISE)
    )
    assert np.sqrt(np.mean(d * d, axis=0)) == pytest.approx(SIGMA, rel=1e-12)
    assert np.all(d[round(0.125 / T)] > 0.0)  # a quarter of a period in, at its crest: the phase is that of a sine


@pytest.mark.parametrize(("frequency", "fits"), [(499.0, True), (500.0, False), (700.0, False)])
def test_a_sinusoid_must_be_sampled_twice_a_period(frequency: float, fits: bool) -> None:
    """At 1 ms half of 1/T is 500 Hz: what is sampled there is nothing, and above it another frequency."""
    faults = list(Sinusoid(1.0, frequency_hz=(1.0, frequency)).check(Timing(1.0, 0.001)))
    assert (not faults) == fits


def test_a_hold_between_control_instants_is_refused_from_python_too() -> None:
    """2.5 periods are neither 2 nor 3; a hold longer than the run is one value for all of it."""
    rng = generator(0, 0, Stream.TORQUE_NOISE)
    with pytest.raises(ValueError, match="is not a whole multiple of control_period"):
        BandLimitedNoise(1.0, hold=0.0025).sample(2, T * np.arange(100), T, rng)
    assert len(np.unique(BandLimitedNoise(1.0, hold=7.7).sample(1, T * np.arange(100), T, rng))) == 1


def test_noise_relative_to_a_motion_is_that_share_of_its_torque() -> None:
    """By hand: a tenth of 20, 3 and 0 N m; a joint that needs no torque gets no noise."""
    sized = BandLimitedNoise(relative=0.1).sized(np.array([20.0, 3.0, 0.0]))
    assert (sized.sigma, sized.relative) == ((2.0, 0.3, 0.0), None)
