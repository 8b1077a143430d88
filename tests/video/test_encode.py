"""Films hold the frames that were written, as many and as long."""

import subprocess

import numpy as np
import pytest
from PIL import Image

from tests.video.films import frames_of
from torquebench.errors import VideoError
from torquebench.video.encode import ffmpeg_program, film_writer
from torquebench.video.sound import write_sound


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


def test_sound_is_part_of_the_film_and_repeatable(tmp_path):
    """A film with sound decodes to the same frames and to the tone that was given; twice the same bytes."""
    tone = 0.3 * np.sin(2 * np.pi * 200.0 * np.arange(1000) * 0.001)
    write_sound(tmp_path / "a.wav", [tone, 0.1 * tone], 0.001, 1.0, 1.0)
    for name in ("a.mp4", "b.mp4"):
        with film_writer(tmp_path / name, (64, 48), tmp_path / "a.wav") as write:
            for i in range(25):
                write(Image.fromarray(picture(i)))
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    assert len(frames_of(tmp_path / "a.mp4", 64, 48)[0]) == 25
    command = [ffmpeg_program(), "-i", str(tmp_path / "a.mp4"), "-f", "s16le", "-"]
    both = np.frombuffer(subprocess.run(command, capture_output=True, check=True).stdout, "<i2").reshape(-1, 2)
    left, right = both[4800:43200].T.astype(float)
    assert left.std() / right.std() == pytest.approx(10.0, rel=0.1)  # AAC keeps levels to some percent
    assert np.argmax(np.abs(np.fft.rfft(left))) / 0.8 == pytest.approx(200.0, abs=2.0)


def test_a_webp_loops_and_lasts_as_long(tmp_path):
    """Every frame is there for 40 ms, the first one's picture is its own, and it begins again."""
    path = tmp_path / "a.webp"
    with film_writer(path, (64, 48)) as write:
        for i in range(10):
            write(Image.fromarray(picture(i)))
    content = path.read_bytes()
    durations = [int.from_bytes(content[at + 20 : at + 23], "little") for at in chunks(content, b"ANMF")]
    assert sum(durations) == 400
    (head,) = chunks(content, b"ANIM")
    assert int.from_bytes(content[head + 12 : head + 14], "little") == 0  # times to show it: without end
    with Image.open(path) as found:
        assert np.abs(np.asarray(found.convert("RGB")).astype(int) - picture(0)).mean() < 4


def chunks(content, name):
    """Where the chunks of a name begin in a WebP file."""
    at, found = 12, []
    while at < len(content):
        if content[at : at + 4] == name:
            found.append(at)
        size = int.from_bytes(content[at + 4 : at + 8], "little")
        at += 8 + size + size % 2
    return found


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
