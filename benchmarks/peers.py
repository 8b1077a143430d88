"""The same closed loop written in other ways: numpy and scikit-fuzzy, Pinocchio, the Robotics Toolbox."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.loops import HEADLINE, PERIOD, trial_of
from benchmarks.timing import Case
from torquebench import Array, MujocoPlant, Puma560, Reference
from torquebench.robot.library import mjcf_path

NAIVE_STEPS = 2
"""Steps of the naive loop in one call: each takes a large part of a second."""
STEPS = 1000
PIN_TOLERANCE = 1e-9
"""Relative difference of inverse dynamics within which Pinocchio's arm counts as the same."""


class NaiveLoop:
    """The proposed law as one would write it first: numpy vectors, ``skfuzzy.control`` for each joint, a Python loop.

    It goes on from call to call, so that its inputs are new ones: scikit-fuzzy keeps the results of inputs it has
    seen, and a repeated trajectory would be looked up instead of computed.

    Args:
        with_fuzzy: Whether the fuzzy part is there.
    """

    def __init__(self, with_fuzzy: bool) -> None:
        trial = trial_of(10.0)
        gains = trial.controller.gains
        self._plant = MujocoPlant("puma560", PERIOD, "euler")
        self._model = trial.model
        self._reference = reference_of(10.0)
        self._lam, self._gd, self._phi, self._kv = gains.lam, gains.gd, gains.phi, gains.kv
        self._K, self._KF = gains.k * self._plant.tau_max, gains.kf * self._plant.tau_max
        self._scale = trial.model.flat.inertia_scale
        self._KI = gains.ki * self._scale
        self._fuzzy = [fuzzy_controller() for _ in range(6)] if with_fuzzy else []
        self._T, self._last = PERIOD, len(self._reference.q)
        self._start()

    def _start(self) -> None:
        self._k, self._integral = 0, np.zeros(6)
        self._plant.reset(np.zeros(6), np.zeros(6))

    def steps(self, count: int) -> None:
        """Run some control instants, from where the last call stopped."""
        for _ in range(count):
            if self._k == self._last:
                self._start()
            q, qd = self._plant.state()
            self._plant.step(np.clip(self._torque(q, qd), -self._plant.tau_max, self._plant.tau_max), 1)
            self._k += 1

    def _torque(self, q: Array, qd: Array) -> Array:
        q_ref, qd_ref, qdd_ref = (signal[self._k] for signal in self._reference)
        e, de = q_ref - q, qd_ref - qd
        s = de + self._lam * e
        tau: Array = self._model.inverse_dynamics(q, qd, qdd_ref + self._lam * de)
        tau = tau + self._K * np.clip(s / self._phi, -1, 1) + self._kv * self._scale * s + self._KI * self._integral
        if self._fuzzy:
            x, y = np.clip(self._lam * e / self._gd, -1, 1), np.clip(de / self._gd, -1, 1)
            tau = tau + self._KF * np.array([f(x[i], y[i]) for i, f in enumerate(self._fuzzy)])
        self._integral += self._T * e
        return tau


def reference_of(duration: float) -> Reference:
    """Return the benchmark's desired motion at each control instant, (N, 6)."""
    reference: Any = trial_of(duration).reference
    sampled: Reference = reference(PERIOD * np.arange(round(duration / PERIOD)))
    return sampled


def fuzzy_controller() -> Callable[[float, float], float]:
    """Return the 49-rule system as `skfuzzy.control` has it."""
    import skfuzzy
    from skfuzzy import control

    names = ["NB", "NM", "NS", "Z", "PS", "PM", "PB"]
    e = control.Antecedent(np.linspace(-1, 1, 121), "e")
    de = control.Antecedent(np.linspace(-1, 1, 121), "de")
    u = control.Consequent(np.linspace(-4 / 3, 4 / 3, 161), "u")
    for variable in (e, de, u):
        for i, name in enumerate(names):
            centre = (i - 3) / 3
            variable[name] = skfuzzy.trimf(variable.universe, [centre - 1 / 3, centre, centre + 1 / 3])
    rules = [
        control.Rule(e[names[i]] & de[names[j]], u[names[min(max(i + j - 3, 0), 6)]])
        for i in range(7)
        for j in range(7)
    ]
    simulation = control.ControlSystemSimulation(control.ControlSystem(rules))

    def evaluate(x: float, y: float) -> float:
        simulation.input["e"], simulation.input["de"] = x, y
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # scikit-fuzzy uses what numpy is about to drop
            simulation.compute()
        return float(simulation.output["u"])

    return evaluate


def peers() -> tuple[list[Case], list[str]]:
    """Return the peers that are installed, and what was left out and why."""
    naive, numpy_only = NaiveLoop(with_fuzzy=True), NaiveLoop(with_fuzzy=False)
    cases = [
        Case(
            "naive-numpy-skfuzzy",
            lambda: naive.steps(NAIVE_STEPS),
            NAIVE_STEPS,
            HEADLINE,
            note="numpy, scikit-fuzzy and mj_step in a Python loop, new inputs each step",
            most=7,
        ),
        Case(
            "naive-numpy-no-fuzzy",
            lambda: numpy_only.steps(STEPS),
            STEPS,
            HEADLINE,
            note="the same without the fuzzy part",
        ),
    ]
    left_out: list[str] = []
    for name, make in (("pinocchio", pinocchio_loop), ("roboticstoolbox", toolbox_loop)):
        try:
            module = importlib.import_module(name)
        except ImportError:
            left_out.append(f"{name}: not installed")
            continue
        found = make(module)
        if isinstance(found, str):
            left_out.append(f"{name}: {found}")
        else:
            cases.append(found)
    return cases, left_out


def pinocchio_loop(pin: Any) -> Case | str:
    """Return computed torque by ``rnea`` on a plant by ``aba`` and Euler's method, in a Python loop; or why not."""
    model = pin.buildModelFromMJCF(str(mjcf_path("puma560")))
    data = model.createData()
    exact = Puma560()
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 6))
    ours, theirs = exact.inverse_dynamics(q, qd, qdd), pin.rnea(model, data, q, qd, qdd)
    if not np.allclose(ours, theirs, rtol=PIN_TOLERANCE, atol=PIN_TOLERANCE):
        return f"reads another arm from the MJCF (inverse dynamics differ by {np.abs(ours - theirs).max():.2g} N m)"
    reference, T = reference_of(1.0), PERIOD

    def run() -> None:
        q, qd = np.zeros(6), np.zeros(6)
        for k in range(STEPS):
            de = reference.qd[k] - qd
            wanted = reference.qdd[k] + 20.0 * de + 100.0 * (reference.q[k] - q)
            tau = pin.rnea(model, data, q, qd, wanted)
            qd = qd + T * pin.aba(model, data, q, qd, tau)
            q = q + T * qd

    return Case("pinocchio-python", run, STEPS, HEADLINE, note="computed torque by rnea, plant by aba, no fuzzy part")


def toolbox_loop(toolbox: Any) -> Case | str:
    """Return computed torque by ``rne`` on a plant by ``accel`` and Euler's method with the toolbox's own PUMA."""
    arm = toolbox.models.DH.Puma560()
    reference, T, steps = reference_of(1.0), PERIOD, 100

    def run() -> None:
        q, qd = np.zeros(6), np.zeros(6)
        for k in range(steps):
            de = reference.qd[k] - qd
            wanted = reference.qdd[k] + 20.0 * de + 100.0 * (reference.q[k] - q)
            qd = qd + T * arm.accel(q, qd, arm.rne(q, qd, wanted))
            q = q + T * qd

    return Case("robotics-toolbox", run, steps, HEADLINE, note="computed torque by rne, plant by accel, its own PUMA")
