"""``torquebench doctor``: what this machine has, what draws here, and what to install."""

from __future__ import annotations

import os
import platform
from typing import Any

import click

import torquebench
from torquebench.cli.app import command
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.errors import TorquebenchError

MORE_PACKAGES = ("scipy", "scikit-fuzzy", "jinja2", "click", "rich", "pandas", "pillow", "imageio-ffmpeg")


@command(example="torquebench doctor")
@click.pass_obj
def doctor(gl: str | None) -> int:
    """Show what this machine has, and what to install.

    These are versions, what can draw films, threads and caches. Everything that depends on the machine is tried. The
    exit status is 0 whatever is found.
    """
    found = findings(gl)
    tell(**found)
    say(table(["package", "version"], list(found["software"].items()), left=2))
    say()
    for name, value in (found["machine"] | {"kernel cache": found["kernel_cache"], "ffmpeg": found["ffmpeg"]}).items():
        say(f"{name}: {value}")
    say(f"threads: {found['threads']['usable']} usable of {found['threads']['cores']}")
    say()
    rows = [
        [x["name"], good("draws") if x["ok"] else bad("no"), x["renderer"] or x["why"]]
        for x in found["drawing"]["tried"]
    ]
    say(table(["OpenGL", "", "by, or why not"], rows or [["-", "no", "MUJOCO_GL asks for none"]], left=3, prose=True))
    say(f"films are drawn by: {found['drawing']['used']}")
    for x in found["drawing"]["tried"]:
        if x["install"]:
            say(f"for {x['name']}: {x['install']}")
    for line in found["install"]:
        say(line)
    if found["machine"]["arithmetic"] != found["machine"]["arithmetic_compiled"]:
        say("compiled code has other last bits than Python's numbers here: the two paths leave other bytes")
    return 0


def findings(gl: str | None) -> dict[str, Any]:
    """Return what was found, as values that JSON can hold.

    Args:
        gl: The user's MUJOCO_GL.
    """
    from torquebench.experiment.store import PACKAGES, machine
    from torquebench.kernel import arithmetic
    from torquebench.kernel.cache import cache_folder
    from torquebench.video.encode import ffmpeg_program
    from torquebench.video.opengl import STICK, advice, candidates, probe

    tried, names = [], candidates(gl)
    with progress_bar(len(names), "back end", "trying what draws") as bar:
        for name in names:
            tried.append(probe(name))
            bar.update(1)
    used = next((backend.name for backend in tried if backend.ok), STICK)
    install = []
    try:
        ffmpeg = ffmpeg_program()
    except TorquebenchError as error:
        ffmpeg = f"none: {error}"
        install.append(f"for films: {error}")
    if used == STICK and (missing := advice(tuple(tried))):
        install.append(f"films show a stick figure; for the whole arm: {missing}")
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "software": {"torquebench": torquebench.__version__, "python": platform.python_version()}
        | {name: _version(name) for name in (*PACKAGES, *MORE_PACKAGES)},
        "machine": machine() | {"arithmetic_compiled": arithmetic.compiled()},
        "threads": {"cores": os.cpu_count(), "usable": usable},
        "kernel_cache": str(cache_folder()),
        "ffmpeg": ffmpeg,
        "mujoco_gl": gl,
        "drawing": {
            "used": used,
            "tried": [
                {"name": x.name, "ok": x.ok, "renderer": x.renderer, "why": x.why, "install": x.install} for x in tried
            ],
        },
        "install": install,
    }


def _version(name: str) -> str:
    from importlib import metadata  # a third of what `--help` takes, which reads this file too

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"
