"""Digests of every shipped experiment's results, to show that a change of the code changes no number.

``python tests/freeze.py`` compares the results of this checkout with ``tests/frozen.json``, and exits 1 where they
differ; ``--write`` writes that file; names of configs limit the comparison to these. Of the package it only uses the
command line, the files that it leaves, and the digest of last bits, so that it outlives changes inside. The digests
hold for one kind of processor and C library: `arithmetic` in the file tells which.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
FROZEN = ROOT / "tests" / "frozen.json"
SWEEPS = {
    "sweep.yaml": ["sweep.draws=2"],
    "studies/noise-definition.yaml": ["sweep.draws=2", "run.duration=2"],
    "studies/tolerance.yaml": ["sweep.draws=2", "run.duration=2"],
}
"""Config -> what is changed in it, to keep it small."""


def arithmetic() -> str:
    """Return a digest of last bits on this processor, of Python's numbers and numpy's: results of others may differ."""
    code = "from torquebench.kernel import arithmetic; print(arithmetic.interpreted(), arithmetic.arrays())"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    told = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return told.stdout.strip()


def digest_of_arrays(path: Path) -> str:
    """Return a digest of the names, types, shapes and bytes of an NPZ file's arrays, in the order of their names."""
    digest = hashlib.sha256()
    with np.load(path, allow_pickle=False) as arrays:
        for name in sorted(arrays.files):
            array = arrays[name]
            digest.update(f"{name} {array.dtype.str} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def digest_of_bytes(path: Path) -> str:
    """Return a digest of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def command(*words: str) -> None:
    """Run a command of this checkout's package; one that ends in anything but 0 or 1 is an error of this script."""
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    run = [sys.executable, "-m", "torquebench", *words]
    ended = subprocess.run(run, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if ended.returncode not in (0, 1):
        raise SystemExit(f"torquebench {' '.join(words)} ended with {ended.returncode}:\n{ended.stderr}")


def digests_of(name: str) -> dict[str, str]:
    """Return the digests of what one shipped config leaves, by the file's name."""
    config = str(next(path for path in (ROOT / "configs" / name, ROOT / "benchmarks" / name) if path.is_file()))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        if name in SWEEPS:
            settings = [word for change in SWEEPS[name] for word in ("--set", change)]
            command("sweep", config, *settings, "--workers", "1", "--executor", "threads", "--out", str(out))
            return {"results.npz": digest_of_arrays(out / "results.npz")}
        command("run", config, "--no-figures", "--out", str(out))
        found = {str(path.relative_to(out)): digest_of_arrays(path) for path in sorted(out.glob("*/trajectory.npz"))}
        return found | {"metrics.json": digest_of_bytes(out / "metrics.json")}


def names() -> Iterator[str]:
    """Yield the configs that are frozen: experiments without a sweep, and the sweeps of `SWEEPS`."""
    folders = ROOT / "configs", ROOT / "benchmarks"
    for path in (path for folder in folders for path in sorted(folder.rglob("*.yaml"))):
        name = str(path.relative_to(ROOT / path.relative_to(ROOT).parts[0]))
        if name in SWEEPS or not re.search(r"^(sweep|audit|falsify|tune|arena):", path.read_text(), re.MULTILINE):
            yield name


def main() -> int:
    """Compare or write the digests, and return the exit status."""
    parser = argparse.ArgumentParser(description="Compare results with tests/frozen.json.")
    parser.add_argument("configs", nargs="*", help="configs to run, below configs/ (default: all)")
    parser.add_argument("--write", action="store_true", help="write the file instead of comparing")
    parser.add_argument("--jobs", type=int, default=1, help="configs that run at once (default: 1)")
    options = parser.parse_args()
    known = list(names())
    if unknown := set(options.configs) - set(known):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; wanted some of {', '.join(known)}")
    chosen = options.configs or known
    with ThreadPoolExecutor(options.jobs) as pool:
        results: dict[str, Any] = dict(zip(chosen, pool.map(digests_of, chosen), strict=True))
    found = {"arithmetic": arithmetic(), "schema.json": digest_of_bytes(ROOT / "configs" / "schema.json")} | results
    if options.write:
        before = json.loads(FROZEN.read_text()) if options.configs else {}
        FROZEN.write_text(json.dumps(before | found, indent=1) + "\n")
        return 0
    frozen = json.loads(FROZEN.read_text())
    if found["arithmetic"] != frozen["arithmetic"]:
        sys.stderr.write("another processor or C library: the digests of trajectories say nothing here\n")
    differing = [
        f"{name}: {part or 'differs'}"
        for name in found
        if name in frozen and found[name] != frozen[name]
        for part in ([p for p in found[name] if found[name][p] != frozen[name].get(p)] if name in results else [""])
    ] + [f"{name}: not frozen" for name in found if name not in frozen]
    sys.stdout.write(
        "".join(f"DIFFERS {line}\n" for line in differing) + f"{len(found)} compared, {len(differing)} differ\n"
    )
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
