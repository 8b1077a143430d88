"""The cache of compiled kernels on disk, which loads only intact files of this user.

numba keeps what it compiles in two kinds of file, an index (``.nbi``) and machine code (``.nbc``), both pickles. Here
each of them begins with a checksum. A file that is cut short, altered, misplaced or unreadable is deleted and compiled
anew; one that another user owns or may write to is not loaded, because loading a pickle runs what is in it.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.registry import cpu_target
from numba.core.serialize import loads

_log = logging.getLogger(__name__)
_said: set[str] = set()
CHECKSUM = 32
"""Length of the checksum at the head of a file [bytes]."""


@contextmanager
def without_collection() -> Iterator[None]:
    """Suspend garbage collection: a compiler makes millions of objects that live on, and searching them is wasted."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


class _Locator(UserProvidedCacheLocator):  # type: ignore[misc]
    """The folder of a function's file within `cache_folder`."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(cache_folder() / self.get_suitable_cache_subpath(file))

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        os.makedirs(self._cache_path, mode=0o700, exist_ok=True)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator:
        """Return the locator, without numba's test for each function that the folder is writable."""
        return cls(function, file)


class _Place(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Index and machine code of one function, each file with a checksum of its name and content."""

    def load(self, key: Any) -> Any:
        """Return what was saved under a key, or None."""
        name = self._load_index().get(key)
        entry = None if name is None else self._read(self._data_path(name))
        # two processes that compile different signatures at once may have given the same name to both
        return entry[1] if entry is not None and entry[0] == key else None

    def save(self, key: Any, data: Any) -> None:
        """Save data under a key."""
        super().save(key, (key, data))

    def _load_index(self) -> Any:
        entry = self._read(self._index_path)
        if entry is None or entry[:2] != (numba.__version__, self._source_stamp):
            return {}
        return entry[2]

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, (numba.__version__, self._source_stamp, overloads))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, entry: Any) -> None:
        content = self._dump(entry)
        number, temporary = tempfile.mkstemp(dir=os.path.dirname(path))  # for this user alone, whatever the umask
        try:
            with open(number, "wb") as file:
                file.write(_checksum(path, content) + content)
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise

    def _read(self, path: str) -> Any:
        """Return what a file holds; None if it is not there. A file that must not be loaded is deleted."""
        try:
            with open(path, "rb") as file:
                fault = _exposed(os.fstat(file.fileno()))
                content = file.read()
        except FileNotFoundError:
            return None
        except OSError as error:
            fault, content = str(error), b""
        if not fault and content[:CHECKSUM] != _checksum(path, content[CHECKSUM:]):
            fault = "damaged"
        if not fault:
            return loads(content[CHECKSUM:])
        with suppress(OSError):
            os.unlink(path)
        _say("damaged", f"kernel cache {os.path.dirname(path)}: {os.path.basename(path)} is {fault}; compiling anew")
        return None


class KernelCache(FunctionCache):  # type: ignore[misc]
    """numba's cache of one function, in `cache_folder`, every file of it checked before it is loaded.

    Args:
        function: The function as Python source.
    """

    _impl_class = _Place

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function for a signature; None if it is not there, or not usable.

        Unlike numba's own, this does not register all that a compiler knows beforehand, which takes longer than most
        runs: machine code needs none of it, and a compiler registers it by itself.
        """
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001  a pickle may raise anything; the kernel is compiled anew
            _say("damaged", f"kernel cache {cache_folder()}: {type(error).__name__}: {error}; compiling anew")
            return None

    def holds(self, sig: Any) -> bool:
        """Whether the compiled function for a signature is on disk, without loading it."""
        key = self._index_key(sig, cpu_target.target_context.codegen())
        name = self._cache_file._load_index().get(key)
        return name is not None and os.path.isfile(self._cache_file._data_path(name))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled function for a signature, as far as the disk allows."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say("unwritable", f"kernel cache {cache_folder()}: {error}; kernels are not kept for the next start")


def _checksum(path: str, content: bytes) -> bytes:
    folder, name = os.path.split(path)
    subfolder, own = os.path.split(folder)[1], os.path.basename(os.path.dirname(folder))
    return hashlib.sha256(f"{own}/{subfolder}/{name}\0".encode() + content).digest()


def _exposed(status: os.stat_result) -> str:
    """Return why a file or folder must not be trusted; an empty text if only this user can write to it."""
    if not hasattr(os, "geteuid"):
        return ""
    if status.st_uid != os.geteuid():
        return f"owned by another user ({status.st_uid})"
    return "writable by other users" if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


def _say(kind: str, message: str) -> None:
    """Log a warning, at most one of each kind in a process."""
    if kind not in _said:
        _said.add(kind)
        _log.warning("%s", message)


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Return the folder for compiled kernels, one for each state of this package's source.

    numba looks only at a function's own file when it decides whether a cached kernel is stale; a kernel that calls
    another file's would go on using the old code. So the folder's name is a digest of every file that holds kernels.
    It lies under ``NUMBA_CACHE_DIR`` if that is set and usable, else in this package, else in the user's cache, else in
    a temporary folder. A folder that other users own or can write to is not usable.
    """
    package = Path(__file__).resolve().parents[1]
    name = f"kernels-{_source_digest(package)}"
    in_package = package / "__pycache__"
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "torquebench"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    faults = []
    bases = [Path(chosen)] if chosen else []
    bases += [in_package, user] if os.access(package, os.W_OK) else [user]
    for base in bases:
        folder = base / name
        if fault := _unusable(folder):
            faults.append(f"{folder} is {fault}")
            continue
        if base == in_package:
            for stale in base.glob("kernels-*"):
                if stale != folder:
                    shutil.rmtree(stale, ignore_errors=True)
        break
    else:
        folder = Path(tempfile.mkdtemp(prefix="torquebench-"))
        faults.append("compiling everything anew in each process")
    if faults:
        _log.warning("kernel cache: %s; using %s", "; ".join(faults), folder)
    return folder


def interpreted_steps(name: str, more: int = 0) -> int:
    """Return how many steps of something have been interpreted so far by all processes that use `cache_folder`.

    Each addition is a line of a file, which the system appends whole, whoever else writes. A file that cannot be read
    or written counts as none: then each process decides by itself what is worth compiling.

    Args:
        name: Name of the file.
        more: Steps to add.
    """
    file = cache_folder() / "interpreted" / name
    with suppress(OSError, ValueError):
        if more:
            file.parent.mkdir(mode=0o700, exist_ok=True)
            with open(file, "a", encoding="ascii") as lines:
                lines.write(f"{more}\n")
        return sum(map(int, file.read_text(encoding="ascii").split()))
    return 0


def kernel_sources(package: Path) -> list[Path]:
    """Return the files of this package on which compiled code may depend."""
    folders = (package / part for part in ("kernel", "chain", "fuzzy", "robot", "laws", "sim"))
    top = [file for file in package.glob("*.py") if b"@kernel" in file.read_bytes()]
    return sorted([*top, *(file for folder in folders for file in folder.rglob("*.py"))])


def _source_digest(package: Path) -> str:
    digest = hashlib.sha256()
    for source in kernel_sources(package):
        digest.update(str(source.relative_to(package)).encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


def _unusable(folder: Path) -> str:
    """Make a folder, and return why it cannot be used; an empty text if it can."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        exposed = _exposed(folder.stat())
        if not exposed:
            with tempfile.TemporaryFile(dir=folder):
                pass
        return exposed
    except OSError as error:
        return f"not writable ({error.strerror})"
