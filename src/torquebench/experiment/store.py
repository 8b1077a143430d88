"""The run directory: every file written atomically, the manifest last, checksums for all."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import torquebench
from torquebench.errors import ConfigError, Problem, ResultError

PACKAGES = ("mujoco", "numpy", "numba", "matplotlib", "pyyaml", "pydantic")
MANIFEST = "manifest.json"


def atomic_write(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all, also after a power cut."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def choose_folder(out: Path | None, name: str) -> Path:
    """Return the folder a run will write to; nothing is created yet.

    Args:
        out: The user's choice, or None for ``runs/NAME-UTC``.
        name: Name of the experiment.

    Raises:
        ConfigError: the folder exists and is not empty, or is not a folder.
    """
    if out is None:
        stamp = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%SZ")
        out = Path("runs") / f"{name}-{stamp}"
        attempt = 1
        while out.exists():
            attempt += 1
            out = Path("runs") / f"{name}-{stamp}-{attempt}"
        return out
    if out.exists() and not out.is_dir():
        raise ConfigError([Problem("--out", "", f"{out} is a file, wanted a folder that is empty or does not exist")])
    if out.is_dir() and any(out.iterdir()):
        raise ConfigError(
            [Problem("--out", "", f"{out} is not empty, wanted a folder that is empty or does not exist")]
        )
    return out


class RunDirectory:
    """A run directory being written; without a manifest it counts as unfinished.

    Args:
        folder: Where; created with its parents.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._checksums: dict[str, str] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def write(self, name: str, content: bytes) -> None:
        """Write one file, `name` relative to the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, content)
        self._checksums[name] = hashlib.sha256(content).hexdigest()

    def finish(self, facts: dict[str, Any]) -> None:
        """Write the manifest: `facts`, versions, machine, and the checksum of every file written."""
        manifest = facts | {"software": versions(), "machine": machine(), "files": self._checksums}
        atomic_write(self.folder / MANIFEST, json_bytes(manifest))


def json_bytes(value: Any) -> bytes:
    """Return `value` as readable JSON; NaN and infinity are refused."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def versions() -> dict[str, str]:
    """Versions of this package, of Python and of the packages that results depend on."""
    found = {"torquebench": torquebench.__version__, "python": platform.python_version()}
    return found | {name: metadata.version(name) for name in PACKAGES}


def machine() -> dict[str, str]:
    """What else can move the last bits: system, processor, C library."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "processor": platform.machine(),
        "libc": " ".join(platform.libc_ver()),
        "byteorder": sys.byteorder,
    }


def check_run(folder: Path) -> dict[str, Any]:
    """Return a run directory's manifest after checking every file against it.

    Raises:
        ResultError: no manifest (the run did not finish), or a file is missing or changed.
    """
    try:
        manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        files: dict[str, str] = manifest["files"]
    except (OSError, ValueError, KeyError) as error:
        raise ResultError(f"{folder}: not a finished run directory ({error})") from error
    for name, checksum in files.items():
        path = folder / name
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != checksum:
            raise ResultError(f"{path}: missing or changed since the manifest was written")
    return manifest
