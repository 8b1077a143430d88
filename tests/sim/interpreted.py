"""Prints the digests of closed loops on the readable path, one a line as they are ready.

``python -m tests.sim.interpreted STEPS FIRST STRIDE [large]`` with NUMBA_DISABLE_JIT=1: every STRIDE-th case from
FIRST. The first line says whether anything is compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.sim.protocol import CONDITIONS, PLANTS, REFERENCES, Case, plain_form, variants

ROOT = Path(__file__).resolve().parents[2]
SMALL = ("mujoco puma560", "analytic corrected", "analytic two-link")
"""Plants of the small size: interpreted, the analytic PUMA takes 1.6 ms a step, its closed form 0.5 ms."""


def cases(large: bool) -> list[Case]:
    """Return every law with every option on every plant and reference; the chain goes round, and Euler has its turn.

    The small size has fewer plants. Each law as it is by default meets all references, one on each plant and the last
    on the first plant again; every other form meets MuJoCo and one of the analytic plants, with one reference each.
    """
    conditions = list(CONDITIONS)
    found: list[Case] = []
    for p, plant in enumerate(PLANTS if large else SMALL):
        for v, variant in enumerate(variants()):
            for r, reference in enumerate(REFERENCES):
                i = (p * len(variants()) + v) * len(REFERENCES) + r
                integrator = "euler" if i % 3 == 1 else "rk4"
                turn, plain = (v + r) % len(REFERENCES), variant.options == plain_form(variant.law)
                here = plain or p in (0, 1 + v % (len(SMALL) - 1))
                if large or (turn == p and here) or (plain and p == 0 and turn == len(SMALL)):
                    found.append(Case(plant, variant, reference, integrator, conditions[i % len(conditions)], 1))
    return found


def interpreted_digests(n_steps: int, large: bool, processes: int) -> Iterator[tuple[int, str]]:
    """Yield the index and digest of each case as computed without any compiled code, in `processes` processes."""
    size = ["large"] if large else []
    running = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-m", "tests.sim.interpreted", str(n_steps), str(i), str(processes), *size],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        )
        for i in range(processes)
    ]
    try:
        for process in running:
            assert process.stdout is not None
            assert process.stdout.readline() == "interpreted\n"
            for line in process.stdout:
                index, digest = line.split()
                yield int(index), digest
            assert process.wait() == 0
    finally:
        for process in running:
            process.kill()
            process.communicate()


def main() -> None:
    """Print the digests."""
    from numba.core import config

    from torquebench.robot.dynamics import forward_dynamics
    from torquebench.sim.closed_loop import measure

    plain = all(type(kernel) is type(main) for kernel in (forward_dynamics, measure))
    sys.stdout.write("interpreted\n" if plain and config.DISABLE_JIT else "compiled\n")
    n_steps, first, stride = map(int, sys.argv[1:4])
    chosen = cases("large" in sys.argv[4:])
    for i in range(first, len(chosen), stride):
        run = chosen[i].run(n_steps, "auto")
        assert run.path == "python"
        sys.stdout.write(f"{i} {run.digest()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
