"""Running a module of this package in a process of its own, with its own MUJOCO_GL, and reading what it tells."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from typing import Any

from torquebench.errors import VideoError

_TAIL = 400
"""How much of what a failed process said is passed on [characters]."""


def environment(gl: str) -> dict[str, str]:
    """Return this process's environment with another OpenGL for MuJoCo.

    Args:
        gl: Value of MUJOCO_GL; ``off`` for none.
    """
    kept = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    return kept | {"MUJOCO_GL": gl}


def run_module(
    module: str, argument: str, gl: str, silence: float, heard: Callable[[Mapping[str, Any]], None] | None = None
) -> dict[str, Any]:
    """Run ``python -m module`` and return the last of the JSON objects it writes, one a line.

    A drawing library that fails may end the whole process, or never return: hence a process that can be given up.

    Args:
        module: Dotted name.
        argument: What it reads from its standard input.
        gl: Value of MUJOCO_GL in it.
        silence: Longest time without a line before it is ended [s].
        heard: Called with each object.

    Raises:
        VideoError: it ended otherwise than well, told nothing, or was silent for too long.
    """
    command = [sys.executable, "-P", "-m", module]
    told: dict[str, Any] = {}
    gave_up = threading.Event()
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as said:
        given.write(argument.encode())
        given.seek(0)
        process = subprocess.Popen(
            command, stdin=given, stdout=subprocess.PIPE, stderr=said, env=environment(gl), text=True
        )

        def give_up() -> None:
            gave_up.set()
            process.kill()

        watch = threading.Timer(silence, give_up)
        watch.start()
        try:
            for line in process.stdout or ():
                watch.cancel()
                watch = threading.Timer(silence, give_up)
                watch.start()
                told = _parsed(line) or told
                if heard is not None:
                    heard(told)
            process.wait()
        finally:
            watch.cancel()
            process.kill()
            process.wait()
            if process.stdout is not None:
                process.stdout.close()
        said.seek(0)
        words = " ".join(said.read().decode(errors="replace").split())[-_TAIL:]
    if gave_up.is_set():
        raise VideoError(f"was silent for {silence:g} s and was ended")
    if process.returncode != 0 or not told:
        raise VideoError(f"ended with status {process.returncode}: {words or 'it said nothing'}")
    return told


def _parsed(line: str) -> dict[str, Any]:
    """Return the object on a line, or nothing: libraries write to standard output too."""
    try:
        found = json.loads(line)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
