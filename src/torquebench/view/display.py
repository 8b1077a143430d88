"""The process that tries whether a window opens (``python -m torquebench.view.display``): it opens a hidden one."""

from __future__ import annotations

import json
import os
import sys
import warnings
from typing import Any


def probe() -> dict[str, Any]:
    """Return whether a window opens, and why not."""
    if sys.platform == "darwin":
        return {"ok": False, "why": "on macOS MuJoCo's viewer needs mjpython"}
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return {"ok": False, "why": "neither DISPLAY nor WAYLAND_DISPLAY is set"}
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            import glfw

            if not glfw.init():
                return {"ok": False, "why": f"GLFW does not start: {_words(said)}"}
            glfw.window_hint(glfw.VISIBLE, False)
            window = glfw.create_window(64, 64, "torquebench", None, None)
            if not window:
                return {"ok": False, "why": f"GLFW opens no window: {_words(said)}"}
            glfw.terminate()
    except Exception as error:  # noqa: BLE001  libraries fail in every way there is
        return {"ok": False, "why": f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"}
    return {"ok": True, "why": ""}


def _words(said: list[warnings.WarningMessage]) -> str:
    """Return the last warning in one line."""
    return " ".join(str(said[-1].message).split())[:200] if said else "it does not say why"


if __name__ == "__main__":
    sys.stdout.write(json.dumps(probe()) + "\n")
    sys.stdout.flush()
