"""Closed loops of 4 s per second: `torquebench tune`, a loop through `simulate`, and plain numpy; ratios in one run.

    python -m benchmarks.tuning

Both loops are spared what tuning does besides: samplers, most metrics, disturbances, and the plain one the chain too.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import torquebench
from benchmarks.timing import Case, measure
from torquebench import Array
from torquebench.experiment.build import build
from torquebench.experiment.tune_section import take_tune
from torquebench.sweeps import document_from

STUDY = "studies/tuning"
EVALUATIONS, DRAWS = 32, 2
"""Sets of gains of each law and seed, and draws in which they are judged; files and figures are in the time too."""


def tune() -> None:
    """Tune the five laws of the study on all cores."""
    changes = [f"tune.evaluations={EVALUATIONS}", f"tune.test.draws={DRAWS}"]
    with TemporaryDirectory() as folder:
        torquebench.tune(STUDY, changes=changes, folder=Path(folder, "out"))


def serial() -> None:
    """Run each law of the study under each training condition, one after the other, and take the error."""
    for condition in take_tune(document_from(STUDY)).training:
        experiment = condition.experiment
        loop = build(experiment)
        for controller in loop.controllers:
            run = torquebench.simulate(
                loop.plant,
                controller,
                loop.model,
                loop.reference,
                duration=experiment.run.duration,
                chain=experiment.chain,
            )
            float(np.sqrt(np.mean((run.q_ref - run.q) ** 2)))


def inertia(q: Array) -> Array:
    """Return the inertia matrix [kg m^2]."""
    coupled = 0.4 * np.cos(q[1])
    lower = 0.0535 + 0.16
    return np.array([[0.667 + 1.0 + lower + 2 * coupled + 0.1, lower + coupled], [lower + coupled, lower + 0.05]])


def bias(q: Array, qd: Array) -> Array:
    """Return Coriolis, centrifugal and gravity torques [N m]."""
    h, far = 0.4 * np.sin(q[1]), 0.4 * np.cos(q[0] + q[1])
    turn = np.array([-h * qd[1] * (2 * qd[0] + qd[1]), h * qd[0] ** 2])
    return turn - 9.81 * np.array([2.0 * np.cos(q[0]) + far, far])


def naive(duration: float = 4.0) -> float:
    """Run computed torque on the arm by RK4 with steps of 1 ms in plain numpy, and return the error [rad]."""
    a, w, T = np.array([1.0, -0.8]), 2 * np.pi * np.array([0.5, 0.7]), 0.001
    limit, x, squares = np.array([80.0, 25.0]), np.zeros(4), 0.0
    for k in range(round(duration / T)):
        phase = w * k * T
        e, de = a * np.sin(phase) - x[:2], a * w * np.cos(phase) - x[2:]
        wanted = -a * w**2 * np.sin(phase) + 20 * de + 100 * e
        tau = np.clip(inertia(x[:2]) @ wanted + bias(x[:2], x[2:]), -limit, limit)
        slope, total = np.zeros(4), np.zeros(4)
        for part, weight in ((0.0, 1), (0.5, 2), (0.5, 2), (1.0, 1)):
            y = x + part * T * slope
            slope = np.concatenate([y[2:], np.linalg.solve(inertia(y[:2]), tau - bias(y[:2], y[2:]))])
            total = total + weight * slope
        x = x + T / 6 * total
        squares += float(e @ e)
    return float(np.sqrt(squares * T / duration / 2))


if __name__ == "__main__":
    study = take_tune(document_from(STUDY))
    laws, conditions, asked = len(study.training[0].experiment.controllers), len(study.training), study.asked
    own = 1 + asked.seeds * (EVALUATIONS - 1)  # the law's own gains are run once for all seeds
    loops = laws * (own * asked.draws * conditions + 2 * DRAWS * len(study.judged))
    cases = [
        Case("tune", tune, loops, "naive"),
        Case("simulate", serial, laws * conditions, "naive"),
        Case("naive", lambda: naive() and None, 1, "naive"),
    ]
    for row in measure(cases, 1):
        print(f"{row.name}: {row.value:.3g} closed loops per second, {row.ratio:.3g} times the naive loop's")
