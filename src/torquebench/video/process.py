"""Work in a process of its own: a drawing library that fails may end the whole process, or never return."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import tempfile
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from torquebench.errors import TorquebenchError, VideoError

_TAIL = 400
"""Length of a failed process's output that is passed on [characters]."""


class CrashedError(VideoError):
    """A process ended before its work was done, or had to be ended."""


def answers(module: str, job: Any, gl: str, silence: float) -> Iterator[Any]:
    """Yield what the function ``main(job)`` of a module yields, called in a process of its own.

    Args:
        module: Dotted name.
        job: Plain values.
        gl: MUJOCO_GL of the process, which must be set before MuJoCo is imported; ``off`` for none.
        silence: Longest time without an answer before the process is ended [s].

    Raises:
        CrashedError: the process ended too early, or was silent for too long.
        VideoError: `main` raised an error of this package.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
        said = Path(folder, "said")
        process = context.Process(target=_work, args=(there, module, job, gl, str(said)), daemon=True)
        process.start()
        there.close()  # the process has the only other one, so that its end is noticed
        try:
            while here.poll(silence):
                answer = here.recv()
                if answer is None:
                    return
                if isinstance(answer, VideoError):
                    raise answer
                yield answer
            raise CrashedError(f"was silent for {silence:g} s and was ended")
        except EOFError as error:
            process.join()
            words = " ".join(said.read_text(errors="replace").split())[-_TAIL:] if said.exists() else ""
            raise CrashedError(f"ended with status {process.exitcode}: {words or 'it said nothing'}") from error
        finally:
            process.kill()
            process.join()
            here.close()


def _work(there: Connection, module: str, job: Any, gl: str, said: str) -> None:
    """Send the answers of a module's ``main``, then None, or the error that it raised; libraries write to `said`."""
    os.environ.pop("PYOPENGL_PLATFORM", None)
    os.environ["MUJOCO_GL"] = gl
    with open(said, "wb") as file:
        for descriptor in (1, 2):
            os.dup2(file.fileno(), descriptor)
    try:
        for answer in importlib.import_module(module).main(job):
            there.send(answer)
        there.send(None)
    except TorquebenchError as error:
        there.send(VideoError(str(error)))
