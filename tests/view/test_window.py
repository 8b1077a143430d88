"""The window's clock and keys, and that none opens without a display; the window itself needs one."""

import numpy as np
import pytest

from torquebench.errors import VideoError
from torquebench.experiment.schema import Video
from torquebench.video.job import Footage, Job, Shot
from torquebench.video.process import answers
from torquebench.view.window import ENTER, LEFT, RIGHT, SPACE, Replay


@pytest.fixture
def replay(tmp_path, result):
    """A replay of two stored controllers at half speed."""
    paths = [tmp_path / f"{name}.npz" for name in ("conventional", "pd")]
    for path in paths:
        path.write_bytes(result.runs[path.stem].to_bytes())
    shots = tuple(Shot(path.stem, "", str(path)) for path in paths)
    return Replay(Job(Footage("title", "puma560", 0.001, 1.004, shots), Video(speed=0.5)))


def test_time_goes_by_at_the_chosen_speed(replay):
    """0.8 s at half speed are sample 400; a pause holds it, arrows move it by 10 ms, after the end it starts anew."""
    assert replay.advance(0.8, replay.run) == 400
    replay.key(SPACE)
    assert replay.advance(5.0, replay.run) == 400
    replay.key(RIGHT)
    assert replay.advance(5.0, replay.run) == 410
    replay.key(LEFT)
    replay.key(LEFT)
    assert replay.advance(5.0, replay.run) == 390
    replay.key(SPACE)
    assert replay.advance(1.3, replay.run) == 1003  # past the end: stands still
    assert replay.advance(1.0, replay.run) == 1003
    assert replay.advance(0.002, replay.run) == 1


def test_enter_shows_the_next_controller(replay, result):
    """Enter shows the second one, and then the first again."""
    replay.key(ENTER)
    assert np.array_equal(replay.run.q, result.runs["pd"].q)
    replay.key(ENTER)
    assert np.array_equal(replay.run.q, result.runs["conventional"].q)


def test_a_window_without_a_display_is_found_out(replay, monkeypatch):
    """Neither DISPLAY nor WAYLAND_DISPLAY, or one that nothing answers to: no window, a reason, and nothing dies."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(VideoError, match="neither DISPLAY nor WAYLAND_DISPLAY is set"):
        next(answers("torquebench.view.window", replay.job, "glfw", 60.0))
    monkeypatch.setenv("DISPLAY", ":9437")
    with pytest.raises(VideoError, match=r"^[^\n]+$"):
        next(answers("torquebench.view.window", replay.job, "glfw", 60.0))
