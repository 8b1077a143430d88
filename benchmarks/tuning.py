"""Tuning: closed loops of 4 s per second of `tune`, of a loop through `simulate`, and of plain numpy."""

from __future__ import annotations

import numpy as np

from benchmarks.timing import Case
from torquebench import Array, simulate
from torquebench.experiment.build import build
from torquebench.experiment.tune_section import take_tune
from torquebench.keys import altered
from torquebench.sweep.tune import threads, tune_laws
from torquebench.sweeps import document_from

STUDY = "studies/tuning"
EVALUATIONS, SERIAL = 16, 10
"""Sets of gains of each law that are tried, and how often the serial loop runs each law under each condition."""
UNIT = "loops/s"


def tunings(most_threads: int) -> list[Case]:
    """Return tuning on one thread and on the most, and what it is compared with.

    Both others are spared what tuning does besides: samplers, most metrics, disturbances, and the plain one the chain.

    Args:
        most_threads: Threads of the largest case.
    """
    study = take_tune(document_from(STUDY))
    asked = altered(study.asked, evaluations=EVALUATIONS, seeds=1)
    loops = [(condition.experiment, build(condition.experiment)) for condition in study.training]
    laws = len(study.base.controllers)

    def tune(count: int) -> None:
        with threads(count) as pool:
            tune_laws(study.base, study.training, asked, pool)

    def serial() -> None:
        for experiment, loop in loops:
            for controller in loop.controllers * SERIAL:
                run = simulate(
                    loop.plant,
                    controller,
                    loop.model,
                    loop.reference,
                    duration=experiment.run.duration,
                    chain=experiment.chain,
                )
                float(np.sqrt(np.mean((run.q_ref - run.q) ** 2)))

    amount, note = laws * EVALUATIONS * asked.draws * len(loops), f"`{STUDY}`, {EVALUATIONS} sets of gains of each law"
    return [
        *(
            Case("tuning", lambda count=count: tune(count), amount, threads=count, note=note, unit=UNIT, most=3)
            for count in sorted({1, most_threads})
        ),
        Case(
            "tuning-simulate",
            serial,
            laws * len(loops) * SERIAL,
            "tuning",
            note="the same loops through `simulate`, one after the other, and their error",
            unit=UNIT,
            most=3,
        ),
        Case(
            "tuning-naive-numpy",
            lambda: naive() and None,
            1,
            "tuning",
            note="computed torque on the arm in a Python loop",
            unit=UNIT,
            most=3,
        ),
    ]


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
