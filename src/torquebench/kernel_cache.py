"""Where compiled kernels are kept on disk: one folder for each state of the package's source."""

from __future__ import annotations

import gc
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba.core import config

_lock = threading.RLock()


@contextmanager
def own_cache() -> Iterator[None]:
    """Have what is compiled, or marked for compiling, in this context kept in `cache_folder`."""
    settings: Any = config
    with _lock:  # the setting is the whole process's, and another thread may be at the same
        before, settings.CACHE_DIR = settings.CACHE_DIR, str(cache_folder())
        collecting = gc.isenabled()
        gc.disable()  # a compiler makes millions of objects that live on: looking for garbage takes a tenth of its time
        try:
            yield
        finally:
            settings.CACHE_DIR = before
            if collecting:
                gc.enable()


@lru_cache(maxsize=1)
def cache_folder() -> Path:
    """Return the folder for compiled kernels, one for each state of this package's source.

    numba looks only at a function's own file when it decides whether a cached kernel is stale; a kernel that calls
    another file's would go on using the old code. So the folder's name is a digest of every file that holds kernels.
    It lies under ``NUMBA_CACHE_DIR`` if that is set, else in this package, else in the user's cache.
    """
    package = Path(__file__).resolve().parent
    kernels = (*package.glob("*.py"), *package.glob("metrics/*.py"))
    top = [f for f in kernels if f.name.startswith(("kernel", "packing")) or b"@kernel" in f.read_bytes()]
    sources = [*top, *(f for part in ("fuzzy", "robot", "laws", "sim") for f in (package / part).rglob("*.py"))]
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(str(source.relative_to(package)).encode() + b"\0" + source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    own = package / "__pycache__"
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "torquebench"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    for base in [Path(chosen)] if chosen else [own, user]:
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        if base == own:
            for stale in base.glob("kernels-*"):
                if stale != folder:
                    shutil.rmtree(stale, ignore_errors=True)
        return folder
    return Path(tempfile.mkdtemp(prefix="torquebench-"))
