"""One experiment in three engines: where its trajectories part, by which term, and what stays."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from trust.rows import Unavailable, row
from trust.workshop import Workshop

import torquebench as tb
from torquebench.metrics import from_joints, per_joint
from torquebench.robot.library import file_of_arm

STEP = 0.001
DURATION, BEGIN = 0.4, 0.1
"""Length of a run, and where its metrics begin [s]."""
SMOOTH = 1e-11
"""What the samples of a smooth loop may differ by [rad]: found are 1e-16; terms that cancel may lose digits."""
PARTED = 1e-9
"""From here on two trajectories count as parted [rad]."""
STAYS = {"rmse": 0.05, "chattering": 0.05}
"""Metric -> by what part of it two engines may differ in a loop that chatters, whose samples may part."""
LAWS: dict[str, tuple[str, dict[str, Any], dict[str, Any], tb.Chain]] = {
    "smooth": ("computed-torque", {"lam": 10, "kv": 20, "ki": 0}, {}, tb.CHAINS["ideal"]),
    "chattering": ("smc", {"lam": 10, "k": 0.3}, {"switching": "sign"}, tb.CHAINS["ideal"]),
    "chattering, noisy": ("smc", {"lam": 10, "k": 0.3}, {"switching": "sign"}, tb.CHAINS["fast"]),
}


class AbaPlant:
    """An arm integrated by Runge-Kutta of order 4 on Pinocchio's articulated-body algorithm; follows `Plant`.

    Args:
        name: Name of an arm of the library.
    """

    def __init__(self, name: str) -> None:
        import pinocchio

        self._aba, self._model = pinocchio.aba, pinocchio.buildModelFromMJCF(str(file_of_arm(name).origin))
        self._data = self._model.createData()
        self.pinocchio, self.timestep = pinocchio, STEP
        self.tau_max = tb.load_model(name).flat.tau_max.copy()
        self.n = len(self.tau_max)

    def reset(self, q: Any, qd: Any) -> None:
        """Put it somewhere."""
        self._x = np.array([q, qd], dtype=float)

    def state(self) -> tuple[Any, Any]:
        """Return position and velocity."""
        return self._x[0].copy(), self._x[1].copy()

    def step(self, tau: Any, substeps: int) -> None:
        """Integrate under a torque that is held, or given at the start, in the middle and at the end of a step."""
        begin, middle, end = np.array(np.broadcast_to(tau, (3, self.n)))
        for _ in range(substeps):
            a = self._rates(self._x, begin)
            b = self._rates(self._x + 0.5 * STEP * a, middle)
            c = self._rates(self._x + 0.5 * STEP * b, middle)
            d = self._rates(self._x + STEP * c, end)
            self._x = self._x + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)

    def _rates(self, x: Any, tau: Any) -> Any:
        return np.array([x[1], self._aba(self._model, self._data, x[0], x[1], tau)])

    def terms(self, q: Any, qd: Any) -> dict[str, Any]:
        """Return mass matrix, velocity-dependent torque and gravity at a state."""
        p = self.pinocchio
        gravity = p.computeGeneralizedGravity(self._model, self._data, q).copy()
        bias = p.nonLinearEffects(self._model, self._data, q, qd).copy()
        mass = p.crba(self._model, self._data, q).copy()
        mass = np.triu(mass) + np.triu(mass, 1).T
        return {"mass matrix": mass, "velocity terms": bias - gravity, "gravity": gravity}


@row(
    "trajectories",
    "MuJoCo, ours and Pinocchio give one smooth motion, to 1e-11 rad; of a chattering one the same outcome, and "
    "error and chattering to 5 %.",
    ci=3,
    release=60,
)
def attack_motions(shop: Workshop, tries: int) -> Iterator[str]:
    """The PUMA under computed torque, and under switching control, on random sines, by Runge-Kutta with one step."""
    for number in range(tries):
        kind = list(LAWS)[number % len(LAWS)]
        try:
            parted = court(kind, shop.random.uniform(0.2, 0.8), shop.random.uniform(0.5, 1.5))
        except ImportError:
            raise Unavailable("Pinocchio is not installed (pip install pin)") from None
        wrong = [f"{engine}: {', '.join(found)}" for engine, (found, _) in parted.items() if found]
        yield f"{kind}: {'; '.join(wrong)}" if wrong else ""


def court(kind: str, amplitude: float, frequency: float) -> dict[str, tuple[list[str], dict[str, float]]]:
    """Run one experiment in three engines.

    Args:
        kind: One of `LAWS`.
        amplitude: Of each joint's sine [rad].
        frequency: Its frequency [Hz].

    Returns:
        Engine -> what is wrong with it beside MuJoCo, in words, and figures: instant of parting [s], last gap [rad],
        ratios of metrics to MuJoCo's, and the largest relative gap of each term of the dynamics on the way.
    """
    model, pin = tb.load_model("puma560"), AbaPlant("puma560")
    law, gains, options, chain = LAWS[kind]
    plants = {"MuJoCo": tb.MujocoPlant("puma560"), "ours": tb.AnalyticPlant(model), "Pinocchio": pin}
    runs = {}
    for engine, plant in plants.items():
        controller = tb.Controller.of(law, model.n, gains, options)
        sine = tb.Sine(amplitude, frequency)
        runs[engine] = tb.simulate(plant, controller, model, sine, duration=DURATION, chain=chain, seed=3, throw=False)
    first = runs.pop("MuJoCo")
    figures = {engine: _metrics(run, model) for engine, run in runs.items()}
    base, found = _metrics(first, model), dict[str, tuple[list[str], dict[str, float]]]()
    for engine, run in runs.items():
        n = min(len(run.t), len(first.t))
        gaps = np.abs(run.q[:n] - first.q[:n]).max(axis=1)
        apart = np.flatnonzero(gaps > PARTED)
        told = {"parted at [s]": float(first.t[apart[0]]) if len(apart) else np.inf, "last gap [rad]": float(gaps[-1])}
        told |= {key: figures[engine][key] / base[key] - 1.0 for key in STAYS}
        told |= {term: gap for term, gap in _terms(pin, model, first).items() if engine == "Pinocchio"}
        wrong = [] if run.outcome == first.outcome else [f"{run.outcome} in place of {first.outcome}"]
        if kind == "smooth":
            wrong += [f"{gaps.max():.1g} rad away"] if gaps.max() > SMOOTH else []
        else:
            wrong += [f"{key} differs by {told[key]:.1%}" for key, most in STAYS.items() if abs(told[key]) > most]
        found[engine] = wrong, told
    return found


def _metrics(run: Any, model: Any) -> dict[str, float]:
    conditions: dict[str, Any] = {"metrics_from": BEGIN, "control_period": STEP, "step_like": False}
    values = from_joints(per_joint(run, tau_max=model.flat.tau_max, **conditions))
    return {key: float(values[key].value or 0.0) for key in STAYS}


def _terms(pin: AbaPlant, model: Any, run: Any) -> dict[str, float]:
    """Return the largest relative gap between Pinocchio's terms and ours at every tenth state of a run."""
    gaps = dict[str, float]()
    for q, qd in zip(run.q[::10], run.qd[::10], strict=True):
        zero = np.zeros_like(q)
        gravity = model.inverse_dynamics(q, zero, zero)
        ours = {
            "mass matrix": model.mass_matrix(q),
            "velocity terms": model.inverse_dynamics(q, qd, zero) - gravity,
            "gravity": gravity,
        }
        for term, theirs in pin.terms(q, qd).items():
            gap = float(np.max(np.abs(theirs - ours[term])) / max(np.max(np.abs(theirs)), 1e-3))
            gaps[term] = max(gaps.get(term, 0.0), gap)
    return gaps
