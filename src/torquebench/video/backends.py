"""Which OpenGL can draw on this machine: tried in order, each in a process of its own, with what to install."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

from torquebench.errors import VideoError
from torquebench.video.child import run_module

STICK = "stick"
"""The drawing of last resort: lines by matplotlib, without OpenGL."""
INSTALL = {
    "egl": "apt-get install --no-install-recommends libegl1 libgl1",
    "osmesa": "apt-get install --no-install-recommends libosmesa6 (Mesa 25.1 dropped it: prefer EGL)",
}
"""What to install where a back end is missing, on Debian and its like."""
OFF = ("off", "disable", "disabled", "false", "0")
"""Values of MUJOCO_GL that ask for no OpenGL at all."""
PATIENCE = 60.0
"""Longest time a probe may take [s]."""
_OWN = {"linux": ("egl", "osmesa"), "darwin": ("cgl",), "win32": ("wgl",)}


@dataclass(frozen=True, slots=True)
class Backend:
    """What one probe found."""

    name: str
    ok: bool
    """Whether it draws."""
    why: str
    """Why it does not; empty if it does."""
    renderer: str = ""
    """Name of what draws, as OpenGL has it."""

    @property
    def install(self) -> str:
        """What to install for it; empty when it draws or nothing is known to help."""
        return "" if self.ok else INSTALL.get(self.name, "")


def candidates(wish: str | None) -> tuple[str, ...]:
    """Return the back ends worth trying, the user's MUJOCO_GL first.

    Args:
        wish: Value of MUJOCO_GL; None or empty if not set.
    """
    own = _OWN.get(sys.platform, ())
    word = (wish or "").strip().lower()
    if word in OFF:
        return ()
    return (word, *(name for name in own if name != word)) if word else own


def probe(name: str) -> Backend:
    """Try one back end."""
    try:
        found = run_module("torquebench.video.probe", "", name, PATIENCE)
        return Backend(name, bool(found["ok"]), str(found["why"]), str(found["renderer"]))
    except (VideoError, KeyError) as error:
        return Backend(name, False, f"its trial {error}")


def usable(wish: str | None) -> Iterator[tuple[Backend, tuple[Backend, ...]]]:
    """Return the back ends that draw, best first, each with those before it that do not; the stick figure is last.

    Args:
        wish: Value of MUJOCO_GL; None or empty if not set.
    """
    failed: tuple[Backend, ...] = ()
    for name in candidates(wish):
        found = probe(name)
        if found.ok:
            yield found, failed
        else:
            failed = (*failed, found)
    yield Backend(STICK, True, "", "matplotlib"), failed


def reason(chosen: Backend, failed: tuple[Backend, ...], wish: str | None) -> str:
    """Return why a back end was chosen, in words.

    Args:
        chosen: The back end.
        failed: Those tried before it.
        wish: Value of MUJOCO_GL; None or empty if not set.
    """
    asked = (wish or "").strip().lower()
    if asked in OFF:
        return f"MUJOCO_GL={asked} asks for no OpenGL"
    before = "; ".join(f"{backend.name}: {backend.why}" for backend in failed)
    if chosen.name == asked:
        return f"MUJOCO_GL={asked}"
    if chosen.name == STICK:
        return f"no OpenGL draws ({before or 'none is known for this system'})"
    return "the first that draws" + (f" ({before})" if before else "")


def advice(failed: tuple[Backend, ...]) -> str:
    """Return what to install so that one of the failed back ends draws; empty when nothing is known to help."""
    return ", or ".join(backend.install for backend in failed if backend.install)
