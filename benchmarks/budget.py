"""The times a user waits for, as CPU time over that of a fixed piece of work; fails where one has grown too much.

``python benchmarks/budget.py`` compares them with ``benchmarks/budget.json`` and exits 1 with the names of the parts
that take more than `TOO_MUCH` times what they took; ``--write`` writes that file. Seconds are never compared: each part
runs between two runs of one yardstick, and what counts is its CPU time over theirs. A first run that seems too slow of
a part that compiles does not count. Parts that seem too slow are run again in further rounds, `TRIES` in all, and fail
only if most of their ratios are too high: a neighbour that is loud for a minute spoils one round, not all tries of a
part.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BUDGET = ROOT / "benchmarks" / "budget.json"
TOO_MUCH = 1.3
"""Ratio over the recorded one at which a part fails. Noise eats into a true factor of 1.5, so less than that."""
TRIES = 7
"""Runs of a part at most; an odd number, for the median."""
RECORDED = 5
"""Runs of each part for ``--write``."""
YARDSTICK = """
import json, re, zlib
import numpy as np
source = "def f(x, y=1):\\n    return [x * k + y for k in range(9) if k % 2]\\n" * 40
for turn in range(6):
    exec(compile(source, "yardstick", "exec"), {})
    table = {str(k): [k, float(k), {"k": k}] for k in range(6_000)}
    text = json.dumps(table)
    json.loads(text), re.sub(r"[0-9]+", "n", text), zlib.compress(text.encode(), 1)
    a = np.linspace(-1.0, 1.0, 400_000)
    np.sort(np.sin(40.0 * a) + a), np.fft.rfft(a), np.cumsum(a * a)
"""
"""Some of all that the parts do: start Python, load numpy, compile, make objects, handle text, walk through memory."""


@dataclass(frozen=True, slots=True)
class Part:
    """Something a user waits for."""

    words: tuple[str, ...]
    """Arguments of Python; ``{out}`` is a path where nothing is yet, ``{NAME}`` what the part NAME has left."""
    environment: tuple[tuple[str, str], ...] = ()
    statuses: tuple[int, ...] = (0,)
    """Exit statuses that are no failure."""
    compiles: bool = False
    """Whether its first run on a machine compiles."""


def command(*words: str, **more: Any) -> Part:
    """Return the part that is a command of torquebench."""
    return Part(("-m", "torquebench", *words), **more)


LINE = "torquebench run paper/fig9-ch"
FIG9 = "fig9-chattering"
PARTS = {
    "import torquebench": Part(("-c", "import torquebench")),
    "--help": command("--help"),
    "tab completion": Part(
        ("-m", "torquebench"),
        (("_TORQUEBENCH_COMPLETE", "bash_complete"), ("COMP_LINE", LINE), ("COMP_POINT", str(len(LINE)))),
    ),
    "load a config": Part(("-c", f"import torquebench; torquebench.load_experiment({FIG9!r})")),
    "run": command("run", FIG9, "--out", "{out}"),
    "page of a run": command("report", "{run}"),
    "one figure": command("figures", "{run}", "--only", "torque"),
    "check": command("check", "{law}", compiles=True),
    "sweep": command(
        "sweep", "sweep", "--set", "sweep.draws=1", "--set", "run.duration=1.5", "-o", "{out}", compiles=True
    ),
    "page of a sweep": command("report", "{sweep}"),
    # so few draws decide no claim: status 1
    "audit": command(
        "audit",
        "audits/tayebi-haghighi-2018",
        "--no-figures",
        "--set",
        "audit.draws=1",
        "--set",
        "run.duration=1.5",
        "-o",
        "{out}",
        statuses=(0, 1),
        compiles=True,
    ),
}
"""In the order in which they run: each may read what one before has left."""
COMPILED = f"import torquebench; torquebench.run_experiment({FIG9!r}, path='native')"
"""Run beforehand: so ``run`` finds its kernels, whatever ran on this machine before."""


class Bench:
    """A folder for what the parts leave, and the parts' ratios."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.left = {"law": folder / "law.py"}
        text = (ROOT / "docs" / "writing-a-law.md").read_text(encoding="utf-8")
        self.left["law"].write_text(re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)[0])
        self.count = 0
        self.yardstick = 0.0

    def cpu_of(self, name: str, part: Part) -> float:
        """Run a part and return its CPU time with that of all it started [s].

        Raises:
            RuntimeError: it fails.
        """
        self.count += 1
        out = self.folder / str(self.count)
        words = list(part.words)
        for key, place in {**self.left, "out": out}.items():
            words = [word.replace(f"{{{key}}}", str(place)) for word in words]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, *words],
            cwd=self.folder,
            env=environment() | dict(part.environment),
            capture_output=True,
            text=True,
            check=False,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode not in part.statuses:
            raise RuntimeError(f"{name}: exit status {done.returncode}\n{done.stderr[-2000:]}")
        self.left.setdefault(name, out)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def ratio(self, name: str) -> float:
        """Run a part between two runs of the yardstick and return its CPU time over their mean."""
        measure = Part(("-c", YARDSTICK))
        before = self.yardstick or self.cpu_of("yardstick", measure)
        own = self.cpu_of(name, PARTS[name])
        self.yardstick = self.cpu_of("yardstick", measure)
        return own / (0.5 * (before + self.yardstick))


def environment() -> dict[str, str]:
    """Return the variables of a part: this checkout's package, bytecode kept, one thread in each numerical library."""
    mine = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "TORQUEBENCH"))}
    return mine | {"PYTHONPATH": str(ROOT / "src"), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def verdict(ratios: Sequence[float], limit: float, tries: int = TRIES) -> bool | None:
    """Return whether a part keeps within a limit; None where another run must tell.

    One run well below the limit is enough; otherwise most of all `tries` must agree.

    Args:
        ratios: Those measured so far.
        limit: What the median must not exceed.
        tries: Runs at most.
    """
    above = sum(ratio > limit for ratio in ratios)
    if above > tries // 2:
        return False
    if len(ratios) - above > tries // 2 or (len(ratios) == 1 and ratios[0] < limit / 1.15):
        return True
    return None


def judged(
    measure: Callable[[str], float], limits: Mapping[str, float], compiling: Collection[str] = ()
) -> Iterator[tuple[str, float, bool]]:
    """Yield each part, its median ratio and whether it keeps within its limit, as soon as that is known.

    Args:
        measure: Runs the part of a name once.
        limits: Name -> limit, in the order in which parts run: each may read what one before has left.
        compiling: Those whose first run may compile: it does not count where it is beyond the limit.
    """
    ratios: dict[str, list[float]] = {name: [] for name in limits}
    open_ones, first = list(limits), set(compiling)
    while open_ones:
        for name in list(open_ones):
            found = measure(name)
            if name in first:
                first.discard(name)
                if found > limits[name]:
                    continue
            ratios[name].append(found)
            kept = verdict(ratios[name], limits[name])
            if kept is not None:
                open_ones.remove(name)
                yield name, statistics.median(ratios[name]), kept


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare with the recorded ratios, or write them; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"measure {RECORDED} times and write {BUDGET.name}")
    parser.add_argument("--against", type=Path, default=BUDGET, metavar="FILE", help="recorded ratios to compare with")
    parser.add_argument(
        "--runs", type=int, metavar="N", help="print N ratios of each part as JSON: how noisy it is here"
    )
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="budget-") as folder:
        bench = Bench(Path(folder))
        bench.cpu_of("compiling", Part(("-c", COMPILED)))
        if options.runs or options.write:
            for name, part in PARTS.items():
                if part.compiles:
                    bench.cpu_of(f"compiling: {name}", part)
            turns = [{name: bench.ratio(name) for name in PARTS} for _ in range(options.runs or RECORDED)]
            ratios = {name: [round(turn[name], 3) for turn in turns] for name in PARTS}
            if options.write:
                medians = {name: round(statistics.median(found), 3) for name, found in ratios.items()}
                BUDGET.write_text(json.dumps(medians, indent=2) + "\n", encoding="utf-8")
            print(json.dumps(ratios, indent=1))
            return 0
        recorded = json.loads(options.against.read_text(encoding="utf-8"))
        if recorded.keys() != PARTS.keys():
            print(
                f"{options.against}: has other parts than budget.py, {sorted(recorded.keys() ^ PARTS.keys())}; --write"
            )
            return 2
        slow = []
        print(f"{'part':<20} {'then':>7} {'now':>7} {'now/then':>9}   (CPU time over that of the yardstick)")
        limits = {name: TOO_MUCH * then for name, then in recorded.items()}
        compiling = [name for name, part in PARTS.items() if part.compiles]
        for name, now, kept in judged(bench.ratio, limits, compiling):
            slow += [] if kept else [name]
            then, note = recorded[name], "" if kept else "   TOO SLOW"
            print(f"{name:<20} {then:7.2f} {now:7.2f} {now / then:9.2f}{note}", flush=True)
    if slow:
        print(f"slower than {TOO_MUCH} times what is recorded: {', '.join(slow)}")
        print("make them quick again, or record what they take now: python benchmarks/budget.py --write")
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
