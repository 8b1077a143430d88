"""Films hold the frames that were written, as many and as long."""

import numpy as np
import pytest
from PIL import Image

from tests.video.films import frames_of
from torquebench.errors import VideoError
from torquebench.video.encode import film_writer


def picture(i, width=64, height=48):
    """A picture with a bright square that moves by two pixels a frame."""
    pixels = np.full((height, width, 3), 60, np.uint8)
    pixels[10:26, 2 * i : 2 * i + 16] = (220, 180, 140)
    return pixels


def film(path, frames):
    """Write a film of moving squares."""
    with film_writer(path, (64, 48)) as write:
        for i in range(frames):
            write(Image.fromarray(picture(i)))
    return path


def test_a_film_has_every_frame_in_order_and_lasts_frames_over_rate(tmp_path):
    """25 frames decode to 25, each its own (mean difference below 3 of 255), and the file states 1.00 s."""
    frames, seconds = frames_of(film(tmp_path / "a.mp4", 25), 64, 48)
    assert len(frames) == 25
    assert seconds == pytest.approx(1.0, abs=1e-9)
    for i, pixels in enumerate(frames):
        own = np.abs(pixels.astype(int) - picture(i)).mean()
        assert own < 3
        assert own < np.abs(pixels.astype(int) - picture((i + 1) % 25)).mean()


def test_the_same_frames_give_the_same_bytes(tmp_path):
    """No dates, no names of programs, no threads that race."""
    a, b = (film(tmp_path / f"{name}.mp4", 12).read_bytes() for name in "ab")
    assert a == b
    assert b"Lavf" not in a


def test_a_failing_program_is_quoted(tmp_path, monkeypatch):
    """A program that ends with an error is an error with its status and words, not a broken pipe."""
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho no such luck >&2\nexit 7\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    with pytest.raises(VideoError, match="status 7: no such luck"):
        film(tmp_path / "a.mp4", 400)


def test_an_error_while_drawing_ends_the_program(tmp_path):
    """What goes wrong between two frames is passed on, and the program does not go on running."""

    def draw():
        with film_writer(tmp_path / "a.mp4", (64, 48)) as write:
            write(Image.fromarray(picture(0)))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        draw()


def test_a_film_that_cannot_be_finished_is_an_error(tmp_path):
    """A file that cannot be written is ffmpeg's failure, however few frames there were."""
    with pytest.raises(VideoError, match="No such file or directory"):
        film(tmp_path / "nowhere" / "a.mp4", 1)
