"""Frames to files: H.264 in MP4 through imageio-ffmpeg's program, and PNG; the same frames give the same bytes."""

from __future__ import annotations

import contextlib
import struct
import subprocess
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from torquebench.errors import VideoError
from torquebench.video.settings import FPS
from torquebench.video.text import Pixels

INSTALL = "pip install imageio-ffmpeg"
_TAIL = 600
"""How much of the program's complaint is passed on [characters]."""


class Sink(Protocol):
    """Takes one frame after the other."""

    def write(self, pixels: Pixels) -> None:
        """Take a frame."""
        ...


def ffmpeg_program() -> str:
    """Return the path of the program that makes films.

    Raises:
        VideoError: it is not installed.
    """
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except ImportError as error:
        raise VideoError(f"films need imageio-ffmpeg, which is not installed: {INSTALL}") from error
    except RuntimeError as error:
        raise VideoError(f"imageio-ffmpeg has no program for this machine ({error}); set IMAGEIO_FFMPEG_EXE") from error


class _Pipe:
    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def write(self, pixels: Pixels) -> None:
        """Take a frame."""
        if self._process.stdin is None:
            raise VideoError("the film's encoder takes no input")
        self._process.stdin.write(pixels.tobytes())


@contextlib.contextmanager
def film_writer(path: Path, width: int, height: int) -> Iterator[Sink]:
    """Make a film of the frames written in this context; whole when it ends without an error.

    One thread and no dates: the same frames give the same bytes wherever the same program runs.

    Args:
        path: The film, ``.mp4``.
        width, height: Size of the frames [px].

    Raises:
        VideoError: the program is missing or failed.
    """
    command = [
        ffmpeg_program(),
        "-y",
        "-loglevel",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{width}x{height}",
        "-r",
        str(FPS),
        "-i",
        "-",
        "-an",
        "-c:v",
        "libx264",
        "-preset",
        "veryfast",
        "-crf",
        "20",
        "-pix_fmt",
        "yuv420p",
        "-threads",
        "1",
        "-fflags",
        "+bitexact",
        "-flags:v",
        "+bitexact",
        "-movflags",
        "+faststart",
        str(path),
    ]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said)
        try:
            with contextlib.suppress(BrokenPipeError):  # it has ended: its status and words tell why
                yield _Pipe(process)
        except BaseException:
            process.kill()
            raise
        finally:
            if process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()
            process.wait()
        said.seek(0)
        complaint = " ".join(said.read().decode(errors="replace").split())[-_TAIL:]
    if process.returncode != 0:
        raise VideoError(
            f"the film's encoder failed with status {process.returncode}: {complaint or 'it said nothing'}"
        )


def png_bytes(pixels: Pixels) -> bytes:
    """Return a picture, (height, width, 3), as a PNG file."""
    height, width, _ = pixels.shape
    # each row predicted from the one above it (filter type 2), which suits smooth surfaces
    above = np.vstack([np.zeros((1, width * 3), np.uint8), pixels.reshape(height, width * 3)[:-1]])
    rows = np.hstack([np.full((height, 1), 2, np.uint8), pixels.reshape(height, width * 3) - above])
    parts = [b"\x89PNG\r\n\x1a\n"]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 9)), (b"IEND", b"")):
        parts.append(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))
    return b"".join(parts)
