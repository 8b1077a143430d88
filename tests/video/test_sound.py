"""What is heard is the torque above the corner, in the right ear, as loud and as high as it must be."""

import wave
from typing import NamedTuple

import numpy as np
import pytest

from torquebench.video.sound import LOUD, QUIET, RATE, heard, write_sound

TAU_MAX = np.array([10.0, 20.0])
T = np.arange(1000) * 0.001


class Torque(NamedTuple):
    """What of a trajectory is heard."""

    tau: np.ndarray


def tones(*parts):
    """A torque over its limit: sines of amplitude and frequency [Hz], (1000,)."""
    return sum(amplitude * np.sin(2 * np.pi * hz * T + 0.3) for amplitude, hz in parts)


def sound(path, *ears, speed=1.0, seconds=1.0):
    """What a file of sound holds, (N, 2), one for what it can hold."""
    write_sound(path, ears, 0.001, speed, seconds)
    with wave.open(str(path), "rb") as file:
        assert (file.getframerate(), file.getnchannels()) == (RATE, 2)
        return np.frombuffer(file.readframes(file.getnframes()), "<i2").reshape(-1, 2) / 32767.0


def test_only_what_is_above_the_corner_is_heard():
    """Of 2 Hz and 100 Hz the 100 Hz are left, of the joint that has more of them.

    They are as large as they were to a tenth: what is heard is cut from a second, whose ends do not fit.
    """
    torque = np.stack([tones((0.8, 2.0), (0.05, 100.0)), tones((0.1, 2.0), (0.2, 100.0))], axis=1) * TAU_MAX
    above = heard(Torque(torque), TAU_MAX, 0.001, 8.0)
    assert np.abs(above - tones((0.2, 100.0)))[50:-50].max() < 0.02


def test_joints_that_switch_against_each_other_are_heard():
    """Two joints with opposite signs do not cancel: what is heard has their amplitude."""
    sign = np.where(np.arange(1000) % 2 == 0, 0.3, -0.3)
    above = heard(Torque(np.stack([sign, -sign], axis=1) * TAU_MAX), TAU_MAX, 0.001, 8.0)
    assert np.sqrt(np.mean(above**2)) == pytest.approx(0.3, rel=0.02)


def test_loudness_of_the_ears_has_the_ratio_of_the_torques(tmp_path):
    """Ten times the torque is ten times the sound, left and right as asked; the louder one has a fixed level."""
    left, right = sound(tmp_path / "a.wav", tones((0.3, 100.0)), tones((0.03, 50.0))).T
    assert left.std() / right.std() == pytest.approx(10.0, rel=0.01)
    assert np.abs(left).max() == pytest.approx(LOUD, rel=0.01)


def test_what_hardly_chatters_is_not_amplified(tmp_path):
    """A ten-thousandth of the limit stays a hundred times more quiet than a hundredth."""
    quiet = sound(tmp_path / "a.wav", tones((1e-4, 100.0)), np.zeros(1000))
    assert np.abs(quiet).max() == pytest.approx(LOUD * 1e-4 / QUIET, rel=0.02)


@pytest.mark.parametrize("speed", [1.0, 0.5])
def test_the_pitch_is_that_of_the_film(tmp_path, speed):
    """100 Hz are heard as 100 Hz times the speed, for as long as the run lasts; then there is silence."""
    left = sound(tmp_path / "a.wav", tones((0.3, 100.0)), np.zeros(1000), speed=speed, seconds=3.0)[:, 0]
    assert len(left) == 3 * RATE
    last = round(RATE / speed)
    spectrum = np.abs(np.fft.rfft(left[:last]))
    assert np.argmax(spectrum) / (last / RATE) == pytest.approx(100.0 * speed, abs=1.0)
    assert not left[last:].any()
