"""The run directory: every file written atomically, the manifest last, checksums for all."""

from __future__ import annotations

import contextlib
import datetime
import functools
import hashlib
import json
import logging
import os
import platform
import shlex
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

import torquebench
from torquebench.begun import BEGUN
from torquebench.errors import ConfigError, Problem, ResultError, did_you_mean_path
from torquebench.kernel import arithmetic
from torquebench.robot.library import PRESETS, ArmFile, ArmSource, model_folder

PACKAGES = ("mujoco", "numpy", "numba", "matplotlib", "pyyaml", "pydantic")
MANIFEST = "manifest.json"
OWN_DIGEST = "manifest_sha256"
"""Key of a manifest: the digest of all others."""
EXPERIMENT = "experiment.yaml"
"""The experiment of a run, resolved; written before anything is simulated."""
CLAIM = "unfinished"
"""Empty file that marks a run directory until its manifest is written."""
_log = logging.getLogger(__name__)


def atomic_write(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all, also after a power cut."""
    with replaced(path) as file:
        file.write(content)


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[BinaryIO]:
    """Open a file that takes its name only when all of it is on the disk."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.filename is None:  # a full disk does not say which file it had no room for
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Have the names in a folder reach the disk."""
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def runs_folder() -> Path:
    """Return where results go that no folder was chosen for: ``runs``, or what TORQUEBENCH_RUNS names."""
    return Path(os.environ.get("TORQUEBENCH_RUNS") or "runs")


def claim_folder(out: Path | None, name: str) -> Path:
    """Create the folder a run will write to and return it; no other run can have claimed it.

    Args:
        out: The user's choice, new or empty, or None for ``runs/NAME-UTC``.
        name: Name of the experiment.

    Raises:
        ConfigError: the chosen folder is not empty or cannot be made.
    """
    if out is not None:
        fresh = False
        try:
            fresh = not out.exists()
            out.mkdir(parents=True, exist_ok=True)
            if any(out.iterdir()):
                raise ConfigError([Problem("--out", "", f"{out} is not empty, wanted a new or empty folder")])
            # of two runs that found the folder empty, one is told here
            os.close(os.open(out / CLAIM, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
        except FileExistsError as error:
            what = "is a file" if not out.is_dir() else "was just taken by another run"
            raise ConfigError([Problem("--out", "", f"{out} {what}, wanted a new or empty folder")]) from error
        except (OSError, ValueError) as error:
            if fresh:
                with contextlib.suppress(OSError, ValueError):
                    out.rmdir()
            raise ConfigError([Problem("--out", "", f"cannot make {out}: {error}")]) from error
        BEGUN.append(out)
        return out
    stamp = datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%SZ")
    attempt = 1
    while True:
        folder = runs_folder() / (f"{name}-{stamp}" + (f"-{attempt}" if attempt > 1 else ""))
        if not folder.exists():
            try:
                return claim_folder(folder, name)
            except ConfigError:
                if not folder.exists():
                    raise
        attempt += 1


def release_folder(folder: Path) -> None:
    """Note that a folder which `claim_folder` returned is complete."""
    (folder / CLAIM).unlink(missing_ok=True)
    BEGUN[:] = [other for other in BEGUN if other != folder]


class RunDirectory:
    """A run directory being written; while it holds ``unfinished`` and no manifest, the run has not ended.

    Args:
        folder: Where; see `claim_folder`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._checksums: dict[str, str] = {}

    def write(self, name: str, content: bytes) -> None:
        """Write one file, `name` relative to the folder.

        Raises:
            ResultError: the name leads out of the folder, as one that was read from a file may.
        """
        path = self.folder / name
        if ".." in path.parts or not path.is_relative_to(self.folder):
            raise ResultError(f"'{name}' leads out of the folder: not written")
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, content)
        self._checksums[name] = hashlib.sha256(content).hexdigest()

    def finish(self, facts: dict[str, Any]) -> None:
        """Write the manifest: `facts`, versions, machine, and the checksum of every file written."""
        write_manifest(self.folder, facts | {"software": versions(), "machine": machine(), "files": self._checksums})
        release_folder(self.folder)


def add_to_run(folder: Path, files: Mapping[str, bytes | None], facts: Mapping[str, Any] | None = None) -> None:
    """Write more files, or some anew, into a finished run directory; the manifest holds at every instant.

    Args:
        folder: The run directory.
        files: Name of each, relative to it, and what to write; None removes the file.
        facts: What the manifest is to say besides.

    Raises:
        ResultError: it is not a finished run directory, or another file of it is missing or changed.
    """
    manifest, told = check_run(folder, leave_out=tuple(files)), dict(facts or {})
    for name in files:
        manifest["files"].pop(name, None)
    write_manifest(folder, {key: value for key, value in manifest.items() if key not in told})
    for name, content in files.items():
        if content is None:
            (folder / name).unlink(missing_ok=True)
        else:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            atomic_write(folder / name, content)
            manifest["files"][name] = hashlib.sha256(content).hexdigest()
    write_manifest(folder, manifest | told)


def model_checksums(arm: ArmSource) -> dict[str, str]:
    """Return the SHA-256 of each file of an arm, by its name; presets are no part of it.

    Raises:
        ModelError: there is no such arm.
    """
    if isinstance(arm, ArmFile):
        return {str(arm): arm.digest}
    files = (path for path in model_folder(str(arm)).iterdir() if path.is_file() and path.name != PRESETS)
    return checksums(sorted(files))


def json_bytes(value: Any) -> bytes:
    """Return `value` as readable JSON; NaN and infinity are refused."""
    return (json.dumps(value, indent=2, allow_nan=False) + "\n").encode()


def versions() -> dict[str, str]:
    """Versions of this package, of Python and of the packages that results depend on."""
    found = {"torquebench": torquebench.__version__, "python": platform.python_version()}
    return found | {name: _installed(name) for name in PACKAGES}


_installed = functools.cache(metadata.version)
"""Version of a package; looking it up parses a page of text, and a sweep of many conditions asks each time."""


DIGESTS = ("arithmetic", "arrays")
"""Facts of a machine that are digests of last bits: of Python's numbers and of numpy's."""


def machine() -> dict[str, str]:
    """Return what else can move the last bits: system, processor, C library; and digests of the bits that they give."""
    return {
        "system": f"{platform.system()} {platform.release()}",
        "processor": ", ".join(filter(None, (platform.machine(), _processor()))),
        "libc": " ".join(platform.libc_ver()),
        "byteorder": sys.byteorder,
        "arithmetic": arithmetic.interpreted(),
        "arrays": arithmetic.arrays(),
    }


@functools.cache
def _processor() -> str:
    """Name of the processor's kind; empty where the system does not tell it."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return platform.processor()


def other_machines(machines: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """Return a line for each result that was made where numbers have other last bits than where the first was made.

    Args:
        machines: Name of a result -> the machine in its manifest; older ones do not tell, and are not told of.
    """
    first, *others = [name for name, made_on in machines.items() if "arithmetic" in made_on] or [""]
    kinds = {name: f"{made_on.get('processor')}, {made_on.get('libc')}" for name, made_on in machines.items()}
    return tuple(
        f"{name} was made on another processor or C library than {first} ({kinds[name]}; {kinds[first]}): last bits "
        "differ by themselves, and so do the samples of a loop that chatters"
        for name in others
        if any(machines[name].get(key, known) != known for key in DIGESTS if (known := machines[first].get(key)))
    )


def checksums(paths: Iterable[Path]) -> dict[str, str]:
    """Return the SHA-256 of each file by its name."""
    return {path.name: file_digest(path) for path in paths}


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, read piece by piece."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def refuse_without_manifest(folder: Path) -> None:
    """Refuse a folder in which no command has finished.

    Raises:
        ResultError: it is missing, a file, unfinished, or no results were ever written to it; says what to do.
    """
    if (folder / MANIFEST).exists():
        return
    if not folder.exists():
        raise ResultError(f"{folder}: there is no such folder{did_you_mean_path(folder)}")
    if not folder.is_dir():
        raise ResultError(f"{folder}: is a file, wanted the folder that `torquebench run` left")
    if (folder / EXPERIMENT).is_file():
        again = shlex.join(["torquebench", "run", str(folder / EXPERIMENT), "--out", "NEW"])
        raise ResultError(
            f"{folder}: the run has not finished (no {MANIFEST}): wait if it is running, else run it again: {again}"
        )
    if (folder / CLAIM).is_file():
        raise ResultError(f"{folder}: what writes here has not finished (no {MANIFEST}): wait, or start it again")
    runs = sorted(path.parent for path in folder.glob(f"*/{MANIFEST}"))
    example = f", such as {runs[-1]}" if runs else ""
    raise ResultError(f"{folder}: is not a run (no {MANIFEST}), wanted a folder that `torquebench run` left{example}")


def refuse_without_experiment(folder: Path) -> None:
    """Refuse a folder with results that are not those of one experiment.

    Raises:
        ResultError: it is such a folder.
    """
    if not (folder / EXPERIMENT).is_file():
        raise ResultError(f"{folder}: holds results of another command, wanted a folder that `torquebench run` left")


def check_run(folder: Path, leave_out: Collection[str] = ()) -> dict[str, Any]:
    """Return a run directory's manifest after checking every file against it.

    Args:
        folder: The run directory.
        leave_out: Files that need not be what the manifest says.

    Raises:
        ResultError: there is no such folder, its run has not finished, it is no run's folder, or a file is missing or
            changed.
    """
    refuse_without_manifest(folder)
    manifest, files = read_manifest(folder / MANIFEST)
    for name, checksum in files.items():
        path = folder / name
        if name not in leave_out and (not path.is_file() or file_digest(path) != checksum):
            raise ResultError(f"{path}: missing or changed since the manifest was written")
    return manifest


def read_stored(path: Path) -> bytes:
    """Return the content of a stored file.

    Raises:
        OSError: it is missing, unreadable, or a pipe or device, which might never end.
    """
    if path.exists() and not path.is_file():
        raise OSError("it is not a regular file")
    return path.read_bytes()


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write a folder's manifest, with the digest by which a change of it is found."""
    atomic_write(folder / MANIFEST, json_bytes(dict(manifest) | {OWN_DIGEST: own_digest(manifest)}))


def own_digest(manifest: Mapping[str, Any], at: str = OWN_DIGEST) -> str:
    """Return the SHA-256 of a manifest, or of another mapping, but for the key `at`, with sorted keys and no spaces."""
    rest = {key: value for key, value in manifest.items() if key != at}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def read_manifest(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Return a manifest, and the checksums in it of the folder's files.

    One without a digest of itself, which an older version wrote, is read with a warning.

    Raises:
        ResultError: it cannot be read, or was changed.
    """
    try:
        manifest = json.loads(read_stored(path).decode())
        files = manifest.get("files") if isinstance(manifest, dict) else None
        if not isinstance(files, dict) or not all(isinstance(checksum, str) for checksum in files.values()):
            raise ValueError("wanted a mapping with the checksums of files")
        changed = OWN_DIGEST in manifest and manifest[OWN_DIGEST] != own_digest(manifest)
    except (OSError, ValueError, RecursionError) as error:
        why = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise ResultError(f"{path}: cannot be read ({why}), so that nothing can be verified") from error
    if changed:
        raise ResultError(f"{path}: changed since it was written ({OWN_DIGEST}), so that nothing can be verified")
    if OWN_DIGEST not in manifest:
        _tell_older(path)
    return manifest, files


@functools.cache
def _tell_older(path: Path) -> None:
    """Warn, once, of a manifest that cannot be verified."""
    _log.warning("%s: an older version wrote it, without %s, so that a change of it is not found", path, OWN_DIGEST)
