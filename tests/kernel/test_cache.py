"""Compiled kernels on disk: never stale, and whatever happens to the files, they are compiled anew and it is said."""

import itertools
import logging
import os
import pickle
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.source_tree import FILES, SOURCE
from torquebench.kernel import cache as kernel_cache
from torquebench.kernel import clip, sat
from torquebench.kernel.cache import KernelCache, kernel_sources
from torquebench.robot.library import data_root

KERNELS = "from torquebench.kernel import clip, sat; print(sat(2.0), clip(-7.0, 3.0))"

GRAVITY = """
import numpy as np
from torquebench import Puma560
from torquebench.robot.dynamics import fill_gravity
tau = np.zeros(6)
fill_gravity(Puma560("corrected").flat.constants, np.array([0, 0.5, 0.5, 0, 0, 0]), tau)
print(tau[2])
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the package's source, and a way to run code on it; returns printed text."""
    source = tmp_path / "src"
    shutil.copytree(data_root() / "src", source, ignore=shutil.ignore_patterns("__pycache__"))

    def run(code, **environment):
        known = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
        known |= {"PYTHONPATH": str(source), "TORQUEBENCH_DATA": str(data_root()), **environment}
        done = subprocess.run([sys.executable, "-c", code], env=known, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    return source / "torquebench", run


def test_an_edited_callee_is_not_hidden_by_the_cache(copy):
    """G3 changes sign with its formula, although only a file that the cached caller imports was edited."""
    package, run = copy
    before = float(run(GRAVITY))
    element = package / "robot" / "puma560" / "gravity.py"
    text = element.read_text()
    after = "\n\n\n@kernel(inline=True)\ndef gravity5"
    edited = text.replace("    return k[G2] * t.s23 + k[G4]", "    return -k[G2] * t.s23 - k[G4]").replace(
        "t.c23 + k[G5] * t.s23" + after, "t.c23 - k[G5] * t.s23" + after
    )
    assert edited != text
    element.write_text(edited)
    assert float(run(GRAVITY)) == pytest.approx(-before, rel=1e-12)
    assert len(list((package / "__pycache__").glob("kernels-*"))) == 1  # the stale one is gone


def test_the_state_of_the_source_covers_every_kernel():
    """Every file of the package that marks or compiles kernels is in the digest that names the folder."""
    covered = set(kernel_sources(SOURCE))
    marks = ("\n@kernel", "register_jitable(", "NativeFunction(")
    missing = [
        name for name, path in FILES.items() if path not in covered and any(m in path.read_text() for m in marks)
    ]
    assert missing == ["check.py"]  # which calls kernels, and nothing calls


def test_the_cache_is_used_and_can_be_moved(copy, tmp_path):
    """Compiled kernels land in NUMBA_CACHE_DIR when it is set; a second process adds none."""
    _, run = copy
    folder = tmp_path / "cache"
    run(GRAVITY, NUMBA_CACHE_DIR=str(folder))
    first = sorted(str(p) for p in folder.rglob("*.nbc"))
    run(GRAVITY, NUMBA_CACHE_DIR=str(folder))
    assert first
    assert sorted(str(p) for p in folder.rglob("*.nbc")) == first


def run(code: str, folder: Path | str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python code with compiled kernels in a folder."""
    source = Path(kernel_cache.__file__).resolve().parents[2]
    env = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(source), **environment}
    return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def intact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the kernels of `KERNELS`; not to be written to."""
    folder = tmp_path_factory.mktemp("intact")
    done = run(KERNELS, folder)
    assert (done.stdout, done.stderr) == ("1.0 -3.0\n", "")
    return folder


def test_cached_kernels_come_without_the_compiler(intact: Path) -> None:
    """A process that only loads kernels does not import what numba compiles arrays with, a fifth of a short run."""
    done = run(f"{KERNELS}\nimport sys\nprint('numba.np.arraymath' in sys.modules)", intact)
    assert (done.stdout, done.stderr) == ("1.0 -3.0\nFalse\n", "")


class Evil:
    """What runs code when it is unpickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, ("unpickled",)


def flipped(content: bytes, at: int) -> bytes:
    """Return `content` with one bit of one byte changed."""
    changed = bytearray(content)
    changed[at] ^= 64
    return bytes(changed)


DAMAGE = {
    "cut": lambda content: content[: len(content) // 2],
    "emptied": lambda content: b"",
    "flip at the start": lambda content: flipped(content, 0),
    "flip inside": lambda content: flipped(content, len(content) // 2),
    "flip at the end": lambda content: flipped(content, -1),
    "longer": lambda content: content + b"\0",
    "text": lambda content: b"not a kernel",
    "foreign pickle": lambda content: pickle.dumps(Evil()),
}


@pytest.mark.parametrize("how", ["flip inside", "foreign pickle"])
def test_a_damaged_file_is_compiled_anew_once_and_it_is_said(
    how: str, intact: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is in the files of either kind: the same numbers, one line said, nothing unpickled; then silence."""
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    monkeypatch.chdir(tmp_path)
    (index,), (code,) = folder.rglob("*.sat-*.nbi"), folder.rglob("*.clip-*.nbc")
    for file in (index, code):
        file.write_bytes(DAMAGE[how](file.read_bytes()))
    healed = run(KERNELS, folder)
    assert (healed.returncode, healed.stdout) == (0, "1.0 -3.0\n")
    assert healed.stderr.count("\n") == 1
    assert "is damaged; compiling anew" in healed.stderr
    assert str(folder) in healed.stderr
    after = run(KERNELS, folder)
    assert (after.returncode, after.stdout, after.stderr) == (0, "1.0 -3.0\n", "")
    assert not Path("unpickled").exists()


def test_a_file_in_the_place_of_another_is_not_loaded(intact: Path, tmp_path: Path) -> None:
    """Two kernels whose files have changed places: both are compiled anew, neither runs the other's code."""
    folder = tmp_path / "cache"
    shutil.copytree(intact, folder)
    for kind in ("nbi", "nbc"):
        one, other = folder.rglob(f"*.{kind}")
        content = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(content)
    done = run(KERNELS, folder)
    assert done.stdout == "1.0 -3.0\n"
    assert "is damaged" in done.stderr


@pytest.fixture
def caches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which this process keeps kernels meanwhile."""
    monkeypatch.setattr(kernel_cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(kernel_cache, "_said", set())
    return tmp_path


@pytest.mark.parametrize("how", DAMAGE)
def test_whatever_damage_is_found(how: str, caches: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the index and in the machine code alike: nothing is loaded or unpickled, and the damaged file is gone."""
    monkeypatch.chdir(caches)
    KernelCache(sat.py_func)._impl.locator.ensure_cache_path()
    files = KernelCache(sat.py_func)._cache_file
    for kind in ("nbi", "nbc"):
        files.save("key", bytes(range(256)))
        assert files.load("key") == bytes(range(256))
        (path,) = caches.rglob(f"*.{kind}")
        path.write_bytes(DAMAGE[how](path.read_bytes()))
        assert files.load("key") is None
        assert not path.exists()
    assert not Path("unpickled").exists()


def test_no_flipped_bit_gets_through(caches: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A bit flipped anywhere in a file, and a cut anywhere, are found; the file is gone then, and it is said once."""
    cache = KernelCache(sat.py_func)
    cache._impl.locator.ensure_cache_path()
    files = cache._cache_file
    files.save("key", bytes(range(256)))
    assert files.load("key") == bytes(range(256))
    paths = [Path(files._index_path), *caches.rglob("*.nbc")]
    kept = {path: path.read_bytes() for path in paths}
    for path, content in kept.items():
        for place in range(8 * len(content)):
            flipped = bytearray(content)
            flipped[place // 8] ^= 1 << place % 8
            path.write_bytes(flipped if place % 16 else content[: place // 8])
            assert files.load("key") is None
            assert not path.exists()
        path.write_bytes(content)
        path.chmod(0o600)
        assert files.load("key") == bytes(range(256))
    assert len(caplog.records) == 1
    assert caplog.records[0].levelno == logging.WARNING


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_can_write_is_not_loaded(mode: int, caches: Path, caplog: pytest.LogCaptureFixture) -> None:
    """These files are pickles: who can write one runs code as the user who loads it."""
    cache = KernelCache(clip.py_func)
    cache._impl.locator.ensure_cache_path()
    cache._cache_file.save("key", 1)
    (path,) = caches.rglob("*.nbc")
    assert path.stat().st_mode & 0o077 == 0
    path.chmod(mode)
    assert cache._cache_file.load("key") is None
    assert "writable by other users" in caplog.text


def test_another_signature_under_the_same_name_is_not_loaded(caches: Path) -> None:
    """Two processes that compile different signatures at once may give both the same file: only its own is loaded."""
    first, second = (KernelCache(sat.py_func)._cache_file for _ in range(2))
    KernelCache(sat.py_func)._impl.locator.ensure_cache_path()
    first.save("one", 1)
    first._save_index({"one": "sat.1.nbc", "two": "sat.1.nbc"})
    first._save_data("sat.1.nbc", ("two", 2))
    assert second.load("one") is None
    assert second.load("two") == 2


def test_writers_at_the_same_time_leave_nothing_broken(caches: Path) -> None:
    """Many threads save and load the same entries: what is loaded is what was saved under its key, or nothing."""
    KernelCache(sat.py_func)._impl.locator.ensure_cache_path()
    start = threading.Barrier(8)

    def work(number: int) -> None:
        start.wait()
        files = KernelCache(sat.py_func)._cache_file
        for k in range(30):
            files.save(f"{number % 3}", (number % 3,) * 1000)
            assert files.load(f"{k % 3}") in (None, (k % 3,) * 1000)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
    assert not [path for path in caches.rglob("*") if path.is_file() and path.suffix not in (".nbi", ".nbc")]


def test_processes_that_compile_at_once_leave_an_intact_cache(tmp_path: Path) -> None:
    """Three first starts at the same time: all have the right numbers, and the next start compiles nothing."""
    with ThreadPoolExecutor(3) as pool:
        done = list(pool.map(lambda _: run(KERNELS, tmp_path / "cache"), range(3)))
    assert [(x.stdout, x.stderr) for x in done] == [("1.0 -3.0\n", "")] * 3
    content = {path: path.read_bytes() for path in (tmp_path / "cache").rglob("*.nb?")}
    assert len(content) == 4
    assert run(KERNELS, tmp_path / "cache").stderr == ""
    assert {path: path.read_bytes() for path in (tmp_path / "cache").rglob("*.nb?")} == content


def where(base: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder that a process would choose whose NUMBA_CACHE_DIR is `base`."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(base))
    return kernel_cache.cache_folder.__wrapped__()


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
def test_a_folder_that_others_can_write_is_passed_over(
    mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It is said which folder, why, and what is used in its place; a folder of one's own is made private."""
    folder = where(tmp_path, monkeypatch)
    assert folder.parent == tmp_path
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(mode)
    other = where(tmp_path, monkeypatch)
    assert tmp_path not in other.parents
    assert f"{folder} is writable by other users; using {other}" in caplog.text


@pytest.mark.parametrize("unusable", ["file", "/proc/nothing"])
def test_a_folder_that_cannot_be_used_is_named_at_once(
    unusable: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """NUMBA_CACHE_DIR where nothing can be written: why, and what is used instead, before anything is compiled."""
    (tmp_path / "file").write_text("")
    base = tmp_path / unusable
    used = where(base, monkeypatch)
    assert f"kernel cache: {base}" in caplog.text
    assert "is not writable" in caplog.text
    assert caplog.text.strip().endswith(f"using {used}")


def test_a_full_disk_is_said_and_the_numbers_come(caches: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Where a compiled kernel cannot be saved, the run goes on, and one line says so."""
    cache = KernelCache(sat.py_func)
    (caches / Path(cache.cache_path).name).write_text("a file in the way")
    library = sat.overloads[next(iter(sat.overloads))] if sat.overloads else None
    if library is None:
        sat(2.0)
        library = sat.overloads[next(iter(sat.overloads))]
    for _ in itertools.repeat(None, 2):
        cache.save_overload(library.signature, library)
    assert len(caplog.records) == 1
    assert "kernels are not kept for the next start" in caplog.text
