"""Stored data that was damaged or altered: runs, sweeps, compiled kernels."""

from __future__ import annotations

import hashlib
import io
import json
import os
import random
import shutil
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from trust.rows import row
from trust.workshop import Workshop, differing, sweep_words, tree

from torquebench.experiment.store import write_manifest

MANIFESTS = (
    "[]",
    "null",
    "1",
    '"x"',
    '{"files": []}',
    '{"files": null}',
    '{"files": {"metrics.json": 5}}',
    '{"files": {}}',
)
MANIFESTS += ("NaN", "[" * 100_000, '{"a":' * 3000 + "1" + "}" * 3000, '{"files": {}, "x": ' + "9" * 10_000 + "}")
MANIFESTS += tuple(
    json.dumps({"files": {name: "0" * 64}}) for name in ("../../../etc/passwd", "/etc/passwd", "a\0b", "\x1b")
)
REFUSED = (2, 3)


@row(
    "damaged-files", "An altered file of a stored run is refused by name, or changes nothing shown.", ci=20, release=500
)
def attack_stored_data(shop: Workshop, tries: int) -> Iterator[str]:
    """Files cut, emptied, removed, exchanged, bits flipped; manifests, arrays and archives made up, with checksums."""
    page = shop.absent("page.html")
    whole = shop.command("report", shop.run, "--out", page)
    wanted = page.read_bytes()
    yield from [f"the untouched run: {fault}"] if (fault := whole.fault(0)) else []
    files = [path.relative_to(shop.run) for path in sorted(shop.run.rglob("*")) if path.is_file()]
    for number in range(tries):
        folder, page = shop.copy(shop.run), shop.absent("page.html")
        kind = shop.random.choice([_damage, _damage, _manifest, _array, _array, _archive, _metrics])
        what = kind(shop.random, folder, files)
        done = shop.command("report", folder, "--out", page, limit=40.0)
        same = done.status == 0 and page.read_bytes() == wanted
        found = done.fault(0, *REFUSED) or ("" if same or done.status else "another page, without a word")
        if Path("pwned").exists():
            found = "code was run"
        yield f"try {number}: {what}: {found}" if found else ""


def _damage(draw: random.Random, folder: Path, files: list[Path]) -> str:
    file, how = draw.choice(files), draw.choice(["cut", "flip", "empty", "remove", "double", "link", "pipe", "swap"])
    path = folder / file
    content = bytearray(path.read_bytes())
    path.unlink()
    if how == "cut":
        path.write_bytes(content[: draw.randrange(len(content))])
    elif how == "flip":
        content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        path.write_bytes(content)
    elif how == "empty":
        path.touch()
    elif how == "double":
        path.write_bytes(content + content)
    elif how == "link":
        path.symlink_to("/etc/passwd")
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "swap":
        path.write_bytes((folder / draw.choice([other for other in files if other != file])).read_bytes())
    return f"{file}, {how}"


def _manifest(draw: random.Random, folder: Path, files: list[Path]) -> str:
    text = draw.choice(MANIFESTS)
    (folder / "manifest.json").write_text(text)
    return f"manifest {text[:40]}"


class _Evil:
    def __reduce__(self) -> Any:
        return os.system, ("touch pwned",)


def _array(draw: random.Random, folder: Path, files: list[Path]) -> str:
    """Exchange one array of a trajectory by one of another type, shape or content; its checksum is made right."""
    path = draw.choice(sorted(folder.glob("*/trajectory.npz")))
    with np.load(path) as stored:
        arrays: dict[str, Any] = dict(stored)
    name = draw.choice([key for key, value in arrays.items() if value.ndim])
    x = arrays[name]
    ways: dict[str, Callable[[], Any]] = {
        "an object": lambda: np.array([_Evil()], dtype=object),
        "no such array": lambda: None,
        "a row less": lambda: x[:-1],
        "a joint": lambda: x[..., :1] if x.ndim > 1 else x[:1],
        "an axis more": lambda: x[None],
        "integers": lambda: x.astype(int),
        "complex": lambda: x.astype(complex),
        "text": lambda: x.astype(str),
        "another byte order": lambda: x.astype(">f8"),
        "half precision": lambda: x.astype("f2"),
        "not finite": lambda: np.full_like(x, np.nan),
        "huge": lambda: np.full_like(x, 1e308),
        "backwards": lambda: x[::-1].copy(),
    }
    way = draw.choice(list(ways))
    arrays[name] = ways[way]()
    content = io.BytesIO()
    np.savez(content, **{key: value for key, value in arrays.items() if value is not None})
    _sealed(folder, path, content.getvalue())
    return f"{name} of {path.parent.name}: {way}"


def _archive(draw: random.Random, folder: Path, files: list[Path]) -> str:
    """Put an archive that is none, or a hostile one, in a trajectory's place; its checksum is made right."""
    path = draw.choice(sorted(folder.glob("*/trajectory.npz")))
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%s,), }" % draw.choice(
        [b"1000000000000", b"-1", b"1j"]
    )
    code = b"{'descr': __import__('os').system('touch pwned'), 'fortran_order': False, 'shape': (1,), }"
    members = {
        "no archive": None,
        "nothing in it": {},
        "a shape that lies": {"q.npy": _npy(header)},
        "code in a header": {"q.npy": _npy(code)},
        "a deep header": {"q.npy": _npy(b"(" * 9000)},
        "a bomb": {"q.npy": _npy(header) + b"\0" * 50_000_000},
        "a way out": {"../../evil.npy": b"x"},
        "no array": {"q.npy": b"hello"},
    }
    way = draw.choice(list(members))
    content = io.BytesIO(b"no archive")
    if (inside := members[way]) is not None:
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in inside.items():
                archive.writestr(name, data)
    _sealed(folder, path, content.getvalue())
    return f"{path.parent.name}: {way}"


def _metrics(draw: random.Random, folder: Path, files: list[Path]) -> str:
    """Alter what a run says of itself; the checksum is made right."""
    name = draw.choice(["metrics.json", "experiment.yaml", "certificates.json"])
    path = folder / name
    text = path.read_text()
    ways = ["[]", "{}", "{", "", "NaN", text + text]
    if name == "experiment.yaml":  # other metrics with their checksum are what is stored, and shown as such
        ways += [text.replace("10", "11", 1), text.replace("0.", "1.", 1)]
    new = draw.choice(ways)
    _sealed(folder, path, new.encode())
    if new == text:
        return f"{name} as it was"
    return f"{name}: {new[:30]!r}"


def _npy(header: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header


def _sealed(folder: Path, path: Path, content: bytes) -> None:
    """Write a file of a run, its checksum in the manifest, and the manifest's of itself."""
    path.write_bytes(content)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["files"][str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    write_manifest(folder, manifest)


@row("damaged-sweeps", "A damaged sweep is refused, or resumed to the same bytes.", ci=4, release=200)
def attack_stored_sweeps(shop: Workshop, tries: int) -> Iterator[str]:
    """Shards, plans and configs of an unfinished sweep cut, removed, exchanged, with bits flipped; then --resume."""
    whole, _ = shop.sweep
    wanted = tree(whole)
    files = [
        path.relative_to(whole) for path in sorted(whole.rglob("*")) if path.is_file() and path.name != "manifest.json"
    ]
    for number in range(tries):
        folder = shop.copy(whole)
        (folder / "manifest.json").unlink()
        what = _damage(shop.random, folder, files)
        done = shop.command("sweep", "--resume", folder, "--quiet", "--executor", "threads", limit=90.0)
        found = done.fault(0, *REFUSED)
        if not found and done.status == 0 and (apart := differing(wanted, tree(folder))):
            found = f"resumed to other bytes: {', '.join(apart[:3])}"
        yield f"try {number}: {what}: {found}" if found else ""


@row("kernel-caches", "Damaged compiled kernels are compiled anew, and give the same bytes.", ci=1, release=50)
def attack_caches(shop: Workshop, tries: int) -> Iterator[str]:
    """Files of the cache cut, emptied, exchanged, with bits flipped, made writable by others; then a compiled sweep."""
    base = shop.folder / "cache"
    base.mkdir(mode=0o700)
    environment = {"NUMBA_CACHE_DIR": str(base)}
    first = shop.absent("cached")
    shop.command(*sweep_words(shop.sweep_config, first), limit=600.0, environment=environment)
    wanted, kept = tree(first), shop.folder / "cache-kept"
    shutil.copytree(base, kept)
    for number in range(tries):
        shutil.rmtree(base)
        shutil.copytree(kept, base)
        files = sorted(path for path in base.rglob("*.nb?") if path.is_file())
        names = []
        for path in shop.random.sample(files, min(len(files), 2)):
            how = shop.random.choice(["cut", "flip", "empty", "swap", "writable"])
            content = bytearray(path.read_bytes())
            if how == "flip":
                content[shop.random.randrange(len(content))] ^= 1 << shop.random.randrange(8)
            elif how == "cut":
                content = content[: len(content) // 2]
            elif how == "empty":
                content = bytearray()
            elif how == "swap":
                content = bytearray(shop.random.choice(files).read_bytes())
            path.write_bytes(content)
            if how == "writable":
                path.chmod(0o666)
            names.append(f"{path.name}, {how}")
        out = shop.absent("cached")
        done = shop.command(*sweep_words(shop.sweep_config, out), limit=600.0, environment=environment)
        found = done.fault(0) or ", ".join(differing(wanted, tree(out))[:3])
        yield f"try {number}: {'; '.join(names)}: {found}" if found else ""
