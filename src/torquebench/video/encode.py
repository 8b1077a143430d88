"""Writing a film, MP4 or animated WebP, with the ffmpeg of imageio-ffmpeg; the same frames give the same bytes."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, cast

from PIL.Image import Image

from torquebench.errors import VideoError
from torquebench.video.job import FPS

INSTALL = "pip install imageio-ffmpeg"
READ = "-y -loglevel error -f rawvideo -pix_fmt rgb24".split()
WRITE = {
    ".mp4": "-c:v libx264 -preset veryfast -crf 20 -pix_fmt yuv420p -c:a aac -b:a 160k -movflags +faststart".split(),
    ".webp": "-c:v libwebp_anim -quality 60 -compression_level 4 -loop 0 -pix_fmt yuv420p".split(),
}
"""How each kind of film is written: H.264 and AAC; pictures that begin again when they have ended."""
REPEATABLE = "-threads 1 -fflags +bitexact -flags:v +bitexact -flags:a +bitexact".split()
"""No threads that race, no dates, no versions."""
_TAIL = 600
"""Length of ffmpeg's complaint that is passed on [characters]."""


def ffmpeg_program() -> str:
    """Return the path of ffmpeg.

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


@contextmanager
def film_writer(path: Path, size: tuple[int, int], sound: Path | None = None) -> Iterator[Callable[[Image], object]]:
    """Yield a function that adds a frame to a film, which is complete when this context ends without an error.

    ``imageio_ffmpeg.write_frames`` would hide ffmpeg's exit status, and with it a film that was not finished.

    Args:
        path: The film, ``.mp4`` or ``.webp``.
        size: Width and height of the frames [px], even.
        sound: Its sound, ``.wav``.

    Raises:
        VideoError: ffmpeg is missing or failed.
    """
    frames = ["-s", f"{size[0]}x{size[1]}", "-r", str(FPS), "-i", "-"]
    also = ["-i", str(sound)] if sound is not None else []
    command = [ffmpeg_program(), *READ, *frames, *also, *WRITE[path.suffix], *REPEATABLE, str(path)]
    with tempfile.TemporaryFile() as stderr:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr)
        stdin = cast(IO[bytes], process.stdin)
        with suppress(BrokenPipeError), process:  # ffmpeg has ended: its status and words tell why
            try:
                with suppress(BrokenPipeError):
                    yield lambda frame: stdin.write(frame.tobytes())
            except BaseException:
                process.kill()
                raise
        stderr.seek(0)
        words = " ".join(stderr.read().decode(errors="replace").split())[-_TAIL:]
    if process.returncode != 0:
        raise VideoError(f"the film's encoder failed with status {process.returncode}: {words or 'it said nothing'}")
