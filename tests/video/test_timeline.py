"""Frames are counted exactly and show the sample nearest to their time; nothing of a signal is lost between them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import VideoError
from torquebench.video.job import FPS
from torquebench.video.layout import spans, timeline


@pytest.mark.parametrize(
    ("duration", "speed", "frames"),
    [
        (4.0, 1.0, 100),
        (4.0, 0.5, 200),
        (4.0, 4.0, 25),
        (0.001, 1.0, 1),
        (1.03, 1.0, 26),
        (4.0, 1000.0, 1),
    ],
)
def test_the_number_of_frames_is_duration_over_speed_times_rate(duration, speed, frames):
    """At 25 frames a second, rounded, and never none."""
    assert FPS == 25
    assert timeline(duration, speed, 0.001).total == frames


def test_a_film_without_end_is_refused():
    """Ten hours at their own speed are refused with the speed that would do; at that speed they are a film."""
    with pytest.raises(VideoError, match="--speed of 9 or more"):
        timeline(36_000.0, 1.0, 0.001)
    assert timeline(36_000.0, 9.0, 0.001).total == 100_000


@given(st.floats(0.05, 20.0), st.floats(0.05, 20.0), st.sampled_from([0.0005, 0.001, 0.002, 0.01, 0.1]))
def test_each_frame_shows_the_nearest_sample(duration, speed, period):
    """Frame i is at i speed/25 s, its sample at most half a period away; the last lies within the run."""
    frames = timeline(duration, speed, period)
    shown = frames.samples() * period
    wanted = np.arange(frames.total) * speed / 25
    assert np.all(np.abs(shown - wanted) <= period / 2 * (1 + 1e-9))
    assert frames.time(frames.total - 1) <= duration + 0.5 * speed / 25
    assert np.array_equal(frames.samples(3)[::3], frames.samples())


def test_every_sample_is_in_the_span_of_one_frame():
    """Spans equal the extremes and the mean of each stretch counted by hand; an impulse shows up in exactly one."""
    y = np.zeros((100, 2))
    y[37, 0], y[38, 1] = 5.0, -3.0
    low, high, mean = spans(y, np.array([0, 25, 50, 75]))
    assert high[:, 0].tolist() == [0, 5, 0, 0]
    assert low[:, 1].tolist() == [0, -3, 0, 0]
    assert mean[:, 0].tolist() == [0, 0.2, 0, 0]
    found = spans(np.arange(10.0)[:, None], np.array([0, 4, 7]))
    assert found[:, :, 0].tolist() == [[0, 4, 7], [3, 6, 9], [1.5, 5, 8]]


def test_slow_motion_repeats_samples_and_a_short_run_ends_in_nothing():
    """Equal indices give that sample; indices beyond the run give NaN, as does a signal that is NaN."""
    y = np.array([[1.0], [2.0], [4.0]])
    found = spans(y, np.array([0, 0, 1, 1, 2, 2, 3, 3]))
    assert all(values[:6, 0].tolist() == [1, 1, 2, 2, 4, 4] for values in found)
    assert np.isnan(found[:, 6:]).all()
    assert np.isnan(spans(np.full((4, 1), np.nan), np.array([0, 2]))).all()


def test_what_is_not_a_number_is_left_out():
    """A stretch with NaN or infinity has the least, greatest and mean of its other samples."""
    y = np.array([[1.0], [np.nan], [3.0], [np.inf], [5.0]])
    assert spans(y, np.array([0, 3]))[:, :, 0].tolist() == [[1, 5], [3, 5], [2, 5]]
