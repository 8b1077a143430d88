"""Closed loops on both paths: the same bytes, and compiled once whatever the gains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import event

from torquebench.check.cases import ARMS, arm, combinations, gains_of, label
from torquebench.check.report import NOTE, Report
from torquebench.laws import Law
from torquebench.references import Sine
from torquebench.sim.native import obstacle
from torquebench.sim.plants import Plant
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Outcome, Trajectory

PLANTS = ("analytic", "mujoco")
SCALES = (1.0, 0.1, 10.0)
"""Sizes of gains; the first counts as ordinary."""
DURATION = 0.2
"""Length of each closed loop [s]; 200 control instants."""
ORDINARY = 100.0
"""A failure at positions and speeds below this [rad, rad/s] is the law's, not that of gains that do not fit the arm."""


@cache
def plant_of(name: str, engine: str) -> Plant:
    """Return an arm as a plant."""
    return MujocoPlant(name) if engine == "mujoco" else AnalyticPlant(arm(name))


def loops(law: Law) -> Iterator[tuple[str, str, Mapping[str, str | bool], float]]:
    """Arm, engine, options and size of gains of each closed loop."""
    for k, options in enumerate(combinations(law)):
        for j, (name, engine) in enumerate((a, e) for a in ARMS for e in PLANTS):
            for scale in SCALES if k == 0 else (SCALES[(j + k) % len(SCALES)],):
                yield name, engine, options, scale


def check_loops(law: Law, report: Report) -> None:
    """Check closed loops on the readable path and, for a law that can be compiled, that the native path equals them."""
    failed, differs, count = "", "", 0
    reasons: dict[str, str] = {}
    for name, engine, options, scale in loops(law):
        at = f"{engine} {name}{label(options)}, gains around {scale:g}"
        run = _run(law, name, engine, options, scale, "python")
        if not failed and _is_fault(run):
            failed = f"{at}: t = {run.t[-1]:g} s: {run.detail}"
        count += 1
        reasons[engine] = obstacle(plant_of(name, engine), law)
        if not reasons[engine]:
            other = _run(law, name, engine, options, scale, "native")
            differs = differs or ("" if other.digest() == run.digest() else f"{at}: {_difference(run, other)}")
    place = f" ({Path(report.file).name}, line {report.line})"
    report.add(
        "loop",
        failed and (failed if ", line " in failed else failed + place),
        f"{count} closed loops of {DURATION:g} s on {' and '.join(PLANTS)} plants",
    )
    if any(reasons.values()) and not differs:
        why = "outside the dialect" if report.complaints else next(filter(None, reasons.values()))
        report.add("paths", f"readable path only: {why}", "", NOTE)
        return
    report.add("paths", differs and differs + place, f"interpreted and compiled, {count} loops, 0 differing bytes")
    with event.install_recorder("numba:run_pass") as compiling:
        _run(law, "puma560", "analytic", combinations(law)[-1], 3.0, "native")
    again = f"new gains compiled it again{place}" if compiling.buffer else ""
    report.add("compiled once", again, "whatever the gains, options, arm and plant")


def _run(law: Law, name: str, engine: str, options: Mapping[str, str | bool], scale: float, path: Any) -> Trajectory:
    n = arm(name).n
    gains = law.pack_gains(n, gains_of(law, n, options, 3, scale), options)
    target = Sine(tuple(np.linspace(0.5, 1.0, n)), tuple(np.linspace(0.5, 1.5, n)))
    return simulate(
        plant_of(name, engine),
        Controller(law.name, law, gains),
        arm(name),
        target,
        duration=DURATION,
        path=path,
        throw=False,
    )


def _is_fault(run: Trajectory) -> bool:
    if run.outcome is Outcome.BAD_TORQUE:
        return bool(max(np.max(np.abs(run.q[-1])), np.max(np.abs(run.qd[-1]))) < ORDINARY)
    return run.outcome is Outcome.CONTROLLER_ERROR


def _difference(a: Trajectory, b: Trajectory) -> str:
    """Return where two runs begin to differ."""
    if a.outcome is not b.outcome or a.failed_at != b.failed_at:
        return f"interpreted {a.outcome.name} after {len(a.t)} steps, compiled {b.outcome.name} after {len(b.t)}"
    for k in range(len(a.t)):
        for signal, x in a.arrays().items():
            if x[k].tobytes() != b.arrays()[signal][k].tobytes():
                return f"the paths differ from step {k} on, first in {signal}"
    return "the paths differ"
