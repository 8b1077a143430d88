"""Which OpenGL draws on this machine, tried in processes of their own: a library that fails may end its process.

``python -m torquebench.video.opengl`` is such a process; its standard input names one of `TRIALS`.
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from torquebench.errors import VideoError

STICK = "stick"
"""The back end of last resort: a stick figure, drawn without OpenGL."""
LIBRARIES = {
    "egl": (("libEGL.so.1",), ("libGL.so.1", "libOpenGL.so.0")),
    "osmesa": (("libOSMesa.so.8", "libOSMesa.so.7", "libOSMesa.so.6"),),
}
"""What each back end loads on Linux: one of each group."""
INSTALL = {
    "egl": "apt-get install --no-install-recommends libegl1 libgl1",
    "osmesa": "apt-get install --no-install-recommends libosmesa6 (Mesa 25.1 dropped it: prefer EGL)",
}
"""How to install a missing back end on Debian and its derivatives."""
OFF = ("off", "disable", "disabled", "false", "0")
"""Values of MUJOCO_GL that ask for no OpenGL at all."""
TIMEOUT = 60.0
"""Longest time a trial may take [s]."""
_NATIVE = {"linux": ("egl", "osmesa"), "darwin": ("cgl",), "win32": ("wgl",)}
_TAIL = 400
"""How much of what a failed process wrote is passed on [characters]."""
_BALL = """<mujoco><worldbody><light pos="0 0 3"/><camera name="c" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
<geom type="sphere" size="0.5" rgba="1 0.5 0 1"/></worldbody></mujoco>"""
_SIDE = 64


@dataclass(frozen=True, slots=True)
class Backend:
    """An OpenGL back end that was tried."""

    name: str
    ok: bool
    """Whether it draws."""
    why: str
    """Why it does not; empty if it does."""
    renderer: str = ""
    """OpenGL's name of what draws."""

    @property
    def install(self) -> str:
        """How to install it; empty if it draws or nothing is known to help."""
        return "" if self.ok else INSTALL.get(self.name, "")


def candidates(gl: str | None) -> tuple[str, ...]:
    """Return the back ends worth trying, the user's choice first.

    Args:
        gl: The user's MUJOCO_GL; None or empty if not set.
    """
    native = _NATIVE.get(sys.platform, ())
    word = (gl or "").strip().lower()
    if word in OFF:
        return ()
    return (word, *(name for name in native if name != word)) if word else native


def probe(name: str) -> Backend:
    """Try one back end."""
    try:
        reply = run_module("torquebench.video.opengl", "picture", name, TIMEOUT)
        return Backend(name, bool(reply["ok"]), str(reply["why"]), str(reply["renderer"]))
    except (VideoError, KeyError) as error:
        return Backend(name, False, f"its trial {error}")


def probe_window() -> str:
    """Try to open a hidden window; return why none opens, or an empty text if one does."""
    try:
        reply = run_module("torquebench.video.opengl", "window", "off", TIMEOUT)
        return str(reply.get("why", "its trial gave no answer"))
    except VideoError as error:
        return f"its trial {error}"


def drawing_backends(gl: str | None) -> Iterator[tuple[Backend, tuple[Backend, ...]]]:
    """Yield the back ends that draw, best first and the stick figure last, each with those before it that do not.

    Args:
        gl: The user's MUJOCO_GL; None or empty if not set.
    """
    failed: tuple[Backend, ...] = ()
    for name in candidates(gl):
        backend = probe(name)
        if backend.ok:
            yield backend, failed
        else:
            failed = (*failed, backend)
    yield Backend(STICK, True, "", "Pillow"), failed


def reason(chosen: Backend, failed: tuple[Backend, ...], gl: str | None) -> str:
    """Explain in words why a back end was chosen.

    Args:
        chosen: The back end.
        failed: Those tried before it.
        gl: The user's MUJOCO_GL; None or empty if not set.
    """
    wanted = (gl or "").strip().lower()
    if wanted in OFF:
        return f"MUJOCO_GL={wanted} asks for no OpenGL"
    before = "; ".join(f"{backend.name}: {backend.why}" for backend in failed)
    if chosen.name == wanted:
        return f"MUJOCO_GL={wanted}"
    if chosen.name == STICK:
        return f"no OpenGL draws ({before or 'none is known for this system'})"
    return "the first that draws" + (f" ({before})" if before else "")


def advice(failed: tuple[Backend, ...]) -> str:
    """Say how to install one of the failed back ends; empty if nothing is known to help."""
    return ", or ".join(backend.install for backend in failed if backend.install)


# --- processes of their own


def environment(gl: str) -> dict[str, str]:
    """Return this process's environment with another OpenGL for MuJoCo.

    Args:
        gl: Value of MUJOCO_GL; ``off`` for none.
    """
    rest = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    return rest | {"MUJOCO_GL": gl}


def run_module(
    module: str,
    text: str,
    gl: str,
    silence: float,
    on_message: Callable[[Mapping[str, Any]], None] | None = None,
) -> dict[str, Any]:
    """Run ``python -m module`` and return the last of the JSON objects that it writes, one per line.

    A drawing library that fails may end the whole process or never return, hence a process that can be killed.

    Args:
        module: Dotted name.
        text: Its standard input.
        gl: Its MUJOCO_GL.
        silence: Longest time without a line before it is killed [s].
        on_message: Called with each object.

    Raises:
        VideoError: it failed, wrote no object, or was silent for too long.
    """
    command = [sys.executable, "-P", "-m", module]
    message: dict[str, Any] = {}
    timed_out = threading.Event()
    with tempfile.TemporaryFile() as stdin, tempfile.TemporaryFile() as stderr:
        stdin.write(text.encode())
        stdin.seek(0)
        with subprocess.Popen(
            command, stdin=stdin, stdout=subprocess.PIPE, stderr=stderr, env=environment(gl), text=True
        ) as process:

            def kill() -> None:
                timed_out.set()
                process.kill()

            timer = threading.Timer(silence, kill)
            timer.start()
            try:
                for line in process.stdout or ():
                    timer.cancel()
                    timer = threading.Timer(silence, kill)
                    timer.start()
                    message = _parse(line) or message
                    if on_message is not None:
                        on_message(message)
                process.wait()
            finally:
                timer.cancel()
                process.kill()
        stderr.seek(0)
        words = " ".join(stderr.read().decode(errors="replace").split())[-_TAIL:]
    if timed_out.is_set():
        raise VideoError(f"was silent for {silence:g} s and was ended")
    if process.returncode != 0 or not message:
        raise VideoError(f"ended with status {process.returncode}: {words or 'it said nothing'}")
    return message


def send(message: Mapping[str, Any]) -> None:
    """Send an object to the process that runs this one through `run_module`."""
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()


def _parse(line: str) -> dict[str, Any]:
    """Return the object on a line, or an empty one: libraries write to standard output too."""
    try:
        message = json.loads(line)
    except ValueError:
        return {}
    return message if isinstance(message, dict) else {}


# --- what the processes of trials do


def try_picture() -> dict[str, Any]:
    """Draw with MUJOCO_GL; return whether that works, what drew, and why not."""
    try:
        return {"ok": True, "renderer": _draw_ball(), "why": ""}
    except Exception as error:  # noqa: BLE001  libraries fail in every way there is
        absent = _missing_library(os.environ.get("MUJOCO_GL", ""))
        why = f"cannot load {absent}" if absent else f"{type(error).__name__}: {_line(error)}"
        return {"ok": False, "renderer": "", "why": why}


def try_window() -> dict[str, Any]:
    """Open a hidden window; return why it does not open, or an empty text."""
    if sys.platform == "darwin":
        return {"why": "on macOS MuJoCo's viewer needs mjpython"}
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return {"why": "neither DISPLAY nor WAYLAND_DISPLAY is set"}
    try:
        with warnings.catch_warnings(record=True) as reports:  # how glfw reports errors
            warnings.simplefilter("always")
            import glfw

            if glfw.init():
                glfw.window_hint(glfw.VISIBLE, False)
                if glfw.create_window(64, 64, "torquebench", None, None):
                    glfw.terminate()
                    return {"why": ""}
        return {"why": f"GLFW opens no window: {'; '.join(_line(report.message) for report in reports)}"}
    except Exception as error:  # noqa: BLE001  libraries fail in every way there is
        return {"why": f"{type(error).__name__}: {_line(error)}"}


def _line(error: Warning | Exception | str) -> str:
    return " ".join(str(error).split())[:200]


def _missing_library(name: str) -> str:
    """Return which of a back end's libraries cannot be loaded; empty if all can."""
    for group in LIBRARIES.get(name, ()):
        for library in group:
            try:
                ctypes.CDLL(library)
            except OSError:
                continue
            break
        else:
            return " or ".join(group)
    return ""


def _draw_ball() -> str:
    """Draw a ball and return OpenGL's name of what drew it.

    Raises:
        RuntimeError: the picture is empty.
    """
    import mujoco

    m = mujoco.MjModel.from_xml_string(_BALL)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    with mujoco.Renderer(m, _SIDE, _SIDE) as renderer:
        renderer.update_scene(d, "c")
        pixels = renderer.render()
        middle, corner = pixels[_SIDE // 2, _SIDE // 2], pixels[0, 0]
        if int(middle.max()) < 32 or (middle == corner).all():
            raise RuntimeError("draws nothing: the picture of a ball is empty")
        try:
            from OpenGL import GL

            return str(GL.glGetString(GL.GL_RENDERER).decode(errors="replace"))
        except Exception:  # noqa: BLE001  only a name
            return ""


TRIALS = {"picture": try_picture, "window": try_window}

if __name__ == "__main__":
    send(TRIALS[sys.stdin.read()]())
