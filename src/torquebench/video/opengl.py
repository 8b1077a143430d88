"""Finds an OpenGL that draws on this machine: each is tried in a process of its own, which draws a ball."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from torquebench.video.process import CrashedError, answers

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
_BALL = """<mujoco><worldbody><light pos="0 0 3"/><camera name="c" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
<geom type="sphere" size="0.5" rgba="1 0.5 0 1"/></worldbody></mujoco>"""
_SIDE = 64


@dataclass(frozen=True, slots=True)
class Backend:
    """An OpenGL back end that was tried."""

    name: str
    why: str = ""
    """Why it does not draw; empty if it does."""
    renderer: str = ""
    """OpenGL's name of what draws."""

    @property
    def ok(self) -> bool:
        """Whether the back end draws."""
        return not self.why

    @property
    def install(self) -> str:
        """Instructions for installing it; empty if it draws or nothing is known to help."""
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


_DRAW: dict[str, Backend] = {}
"""Those that drew a ball for this process; they are not tried again."""


def probe(name: str) -> Backend:
    """Try one back end, once a process if it draws."""
    if name in _DRAW:
        return _DRAW[name]
    try:
        renderer, why = next(answers("torquebench.video.opengl", None, name, TIMEOUT))
        found = Backend(name, why, renderer)
        if found.ok:
            _DRAW[name] = found
        return found
    except CrashedError as error:
        return Backend(name, f"its trial {error}")


def reason(chosen: str, failed: Sequence[Backend], gl: str | None) -> str:
    """Explain in words why a back end was chosen.

    Args:
        chosen: Its name.
        failed: Those tried before it.
        gl: The user's MUJOCO_GL; None or empty if not set.
    """
    wanted = (gl or "").strip().lower()
    if wanted in OFF:
        return f"MUJOCO_GL={wanted} asks for no OpenGL"
    if chosen == wanted:
        return f"MUJOCO_GL={wanted}"
    before = "; ".join(f"{backend.name}: {backend.why}" for backend in failed)
    if chosen == STICK:
        return f"no OpenGL draws ({before or 'none is known for this system'})"
    return "the first that draws" + (f" ({before})" if before else "")


def advice(failed: Sequence[Backend]) -> str:
    """Say how to install one of the failed back ends; empty if nothing is known to help."""
    return ", or ".join(backend.install for backend in failed if backend.install)


def main(_: None) -> Iterator[tuple[str, str]]:
    """Draw with MUJOCO_GL; yield OpenGL's name of what drew, or why nothing did."""
    try:
        yield _draw_ball(), ""
    except Exception as error:  # noqa: BLE001  libraries fail in every way there is
        absent = _missing_library(os.environ["MUJOCO_GL"])
        words = " ".join(str(error).split())[:200]
        yield "", f"cannot load {absent}" if absent else f"{type(error).__name__}: {words}"


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
