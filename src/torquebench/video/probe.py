"""The process that tries one OpenGL (``python -m torquebench.video.probe``): it draws a ball and looks at it."""

from __future__ import annotations

import ctypes
import json
import os
import sys
from typing import Any

LIBRARIES = {
    "egl": (("libEGL.so.1",), ("libGL.so.1", "libOpenGL.so.0")),
    "osmesa": (("libOSMesa.so.8", "libOSMesa.so.7", "libOSMesa.so.6"),),
}
"""What each back end loads on Linux: of each group, one."""
_BALL = """<mujoco><worldbody><light pos="0 0 3"/><camera name="c" pos="0 -2 0" xyaxes="1 0 0 0 0 1"/>
<geom type="sphere" size="0.5" rgba="1 0.5 0 1"/></worldbody></mujoco>"""
_SIDE = 64


def missing(name: str) -> str:
    """Return which of a back end's libraries cannot be loaded, or an empty text."""
    for group in LIBRARIES.get(name, ()):
        if not any(map(_loads, group)):
            return " or ".join(group)
    return ""


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def draw() -> str:
    """Draw a ball on MUJOCO_GL and return the name of what drew it.

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
        return _renderer()


def _renderer() -> str:
    try:
        from OpenGL import GL

        return str(GL.glGetString(GL.GL_RENDERER).decode(errors="replace"))
    except Exception:  # noqa: BLE001  only a name: any reason not to have it is as good
        return ""


def probe() -> dict[str, Any]:
    """Return whether MUJOCO_GL draws, by what, and why not."""
    name = os.environ.get("MUJOCO_GL", "")
    try:
        return {"ok": True, "renderer": draw(), "why": ""}
    except Exception as error:  # noqa: BLE001  libraries fail in every way there is
        absent = missing(name)
        why = f"cannot load {absent}" if absent else f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        return {"ok": False, "renderer": "", "why": why}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(probe()) + "\n")
    sys.stdout.flush()
