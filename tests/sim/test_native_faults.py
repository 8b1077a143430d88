"""Faults at random instants: every one is reported at its instant with the right outcome, on either path alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.sampled import simulate_sampled
from tests.sim import faulty_laws
from tests.sim.protocol import CONDITIONS, HOME, PLANTS, REFERENCES, belief_of, differing_bytes, plant_of, signals
from torquebench.chain import Drawn
from torquebench.kernel import Array
from torquebench.sim.plants import INTEGRATORS, Plant
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import SIGNALS, Outcome, Trajectory

N_STEPS = 24
BAD, ERROR, DIVERGED = Outcome.BAD_TORQUE, Outcome.CONTROLLER_ERROR, Outcome.DIVERGED
HUGE = (1e10, -1e12, 1e20, -1e100, 1e300, -1.7e308)
"""1e10 N m on 10 kg m^2 for a millisecond is 1e6 rad/s, a hundred times the bound; the last overflows in the step."""


def raises(*arguments: Any) -> None:
    """Raise."""
    raise RuntimeError("no solution")


def wrong_shape(*arguments: Any) -> Any:
    """Return one torque too many."""
    return np.zeros(len(arguments[-1]) + 1)


KINDS: dict[str, tuple[Any, Outcome]] = {
    "nan": (faulty_laws.NOT_A_NUMBER, BAD),
    "infinity": (faulty_laws.INFINITE, BAD),
    "division by zero": (faulty_laws.DIVISION, BAD),
    "domain": (faulty_laws.DOMAIN, BAD),
    "overflow": (faulty_laws.OVERFLOW, BAD),
    "forgotten joint": (faulty_laws.FORGOTTEN, BAD),
    "huge torque": (faulty_laws.HUGE, DIVERGED),
    "huge disturbance": (faulty_laws.SOUND, DIVERGED),
    "raising law": (raises, ERROR),
    "wrong shape": (wrong_shape, ERROR),
    "bad state": (faulty_laws.SOUND, DIVERGED),
}
CHAINED = [
    name
    for name, condition in CONDITIONS.items()
    if not (condition.payload or condition.friction or condition.chain.torque_speed)
]
"""Conditions that are the loop's alone and let a huge torque act; a payload has tests of its own for this."""
READABLE = ("raising law", "wrong shape", "bad state")
"""What only the readable path can meet: compiled laws raise nothing else, and compiled plants are our own."""


class Fault(NamedTuple):
    """A fault and where it strikes."""

    kind: str
    plant: str
    integrator: str
    condition: str
    substeps: int
    at: int
    joint: int
    size: float

    def run(self, path: Any, strikes: bool = True) -> Trajectory:
        """Run N_STEPS instants; with `strikes` false, the same without the fault."""
        plant: Plant = unlimited(self.plant, self.integrator)
        (chain, noisy, *_), n, period = CONDITIONS[self.condition], plant.n, self.substeps * plant.timestep
        noise, base = signals(n, N_STEPS) if noisy else (None, None)
        fault, time = KINDS[self.kind][0], self.at * period if strikes else 1e9
        if self.kind == "huge disturbance":
            base = np.zeros((N_STEPS, n)) if base is None else base.copy()
            base[self.at, self.joint] = self.size if strikes else 0.0
        if self.kind in ("raising law", "wrong shape"):
            controller = from_time(fault, n, time)
        else:
            controller = faulty_laws.controller(fault, n, time, self.joint, self.size)
        if self.kind == "bad state":
            plant = Spoilt(plant, self.at if strikes else N_STEPS, self.joint, math.copysign(math.inf, self.size))
        return simulate_sampled(
            plant,
            controller,
            belief_of(self.plant),
            REFERENCES["sine"](n),
            duration=N_STEPS * period,
            control_period=period,
            chain=chain,
            drawn=Drawn(noise),
            disturbance=base,
            initial_q=np.array(HOME[:n]),
            path=path,
            throw=False,
        )


class Spoilt:
    """A plant whose state is NaN or infinite after one of its steps, counted in control periods."""

    def __init__(self, inner: Plant, at: int, joint: int, value: float) -> None:
        self.inner, self.at, self.joint, self.value = inner, at, joint, value
        self.n, self.timestep, self.tau_max, self.replica = inner.n, inner.timestep, inner.tau_max, inner.replica
        self.asked = 0

    def reset(self, q: Array, qd: Array) -> None:
        """Start anew."""
        self.inner.reset(q, qd)
        self.asked = 0

    def step(self, tau: Array, substeps: int) -> None:
        """Step the plant inside."""
        self.inner.step(tau, substeps)

    def state(self) -> tuple[Array, Array]:
        """Return the state; asked at the start, and after each step."""
        q, qd = self.inner.state()
        if self.asked == self.at + 1:
            qd[self.joint] = self.value if self.value > 0 else math.nan
        self.asked += 1
        return q, qd


def from_time(fault: Callable[..., Any], n: int, time: float) -> Controller:
    """Return a controller that is sound before `time` and has a fault from then on."""

    def law(gains: Any, model: Any, t: float, *rest: Any) -> Any:
        return fault(*rest) if t >= time else faulty_laws.faulty(gains, model, t, *rest)

    return faulty_laws.controller(faulty_laws.SOUND, n, time, function=law)


@cache
def unlimited(name: str, integrator: str) -> Plant:
    """Return a plant of the protocol without torque limits, so that a huge torque acts."""
    plant = plant_of(name, integrator).replica()
    plant.tau_max = np.full(plant.n, np.inf)
    return plant


def draw(rng: np.random.Generator, i: int) -> Fault:
    """Return fault i: kinds and plants in turn, everything else at random."""
    kind, plant = list(KINDS)[i % len(KINDS)], PLANTS[i // len(KINDS) % len(PLANTS)]
    integrator, condition = str(rng.choice(INTEGRATORS)), str(rng.choice(CHAINED))
    substeps, at, joint = int(rng.choice([1, 4])), int(rng.integers(N_STEPS)), int(rng.integers(plant_of(plant).n))
    if kind == "huge torque":
        integrator = "rk4"  # under lag Euler's method would meet the torque one step later
    if kind == "bad state":
        # with lag the state is asked for after each physics step
        condition, substeps = "ideal, noisy", 1
    return Fault(kind, plant, integrator, condition, substeps, at, joint, float(rng.choice(HUGE)))


def complaints(fault: Fault, run: Trajectory) -> list[str]:
    """Return what is wrong with how a fault was reported."""
    at, wrong = fault.at, []

    def check(holds: Any, what: str) -> None:
        if not holds:
            wrong.append(f"{fault}: {run.path}: {what}: {run.outcome.name} at {run.failed_at}, {run.detail}")

    outcome = KINDS[fault.kind][1]
    check(not run.completed, "completed")
    check(run.outcome is outcome, f"wanted {outcome.name}")
    check(run.failed_at == at, "wrong instant")
    check(run.detail, "no detail")
    check({len(x) for x in run.arrays().values()} == {at + 1}, "arrays do not end at the fault")
    check(run.t.tolist() == [k * (fault.substeps * 0.001) for k in range(at + 1)], "time")
    if wrong:
        return wrong
    sound = fault.run(run.path, strikes=False)
    check(sound.completed, "does not complete without the fault")
    for name in SIGNALS:
        upto = at if name in ("s", "tau_law", "tau", "tau_applied") else at + 1
        before, wanted = getattr(run, name)[:upto], getattr(sound, name)[:upto]
        check(before.tobytes() == wanted.tobytes(), f"{name} before the fault")
    check(np.all(np.isfinite(run.q)) and np.all(np.isfinite(run.qd)), "state recorded")
    acted = outcome is DIVERGED
    check(np.all(np.isfinite(run.tau[at])) if acted else np.all(np.isnan(run.tau[at])), "torque at the fault")
    check(acted or not np.all(np.isfinite(run.tau_law[at])), "law's torque at the fault")
    return wrong


def test_every_fault_is_reported_at_its_instant(
    size: Any, figure: Any, tell: Callable[[str], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Outcome and instant are exact, all before is as without the fault, and both paths give the same bytes.

    No run completes, nothing after the fault is recorded, and MuJoCo writes no log file.
    """
    monkeypatch.chdir(tmp_path)
    rng, count, wrong, apart = np.random.default_rng(23), size(66, 1000), [], 0
    for i in range(count):
        fault = draw(rng, i)
        runs = [fault.run(path) for path in (("python",) if fault.kind in READABLE else ("python", "native"))]
        found = [text for run in runs for text in complaints(fault, run)]
        if len(runs) == 2:
            apart += differing_bytes(*runs)
            if runs[0].digest() != runs[1].digest():
                found.append(f"{fault}: the paths differ")
        wrong += found
        if i % 100 == 99:
            tell(f"{i + 1} of {count} faults, {len(wrong)} reported wrongly")
    figure(f"faults reported at their instant with their outcome, of {count}", count - len(wrong), f"{count}")
    figure("bytes that differ between the paths in runs that fail", apart, "0")
    assert wrong == []
    assert list(tmp_path.iterdir()) == []


def test_the_faults_are_of_every_kind_everywhere() -> None:
    """Each kind on each plant is among the 66 of the small size, with every condition and integrator."""
    rng = np.random.default_rng(23)
    faults = [draw(rng, i) for i in range(66)]
    assert {(f.kind, f.plant) for f in faults} == {(k, p) for k in KINDS for p in PLANTS}
    assert {f.condition for f in faults} == set(CHAINED)
    assert {f.integrator for f in faults} == set(INTEGRATORS)


@pytest.mark.parametrize("path", ["python", "native"])
@pytest.mark.parametrize("plant", PLANTS)
def test_a_plant_works_again_after_each_fault(plant: str, path: Any) -> None:
    """A plant that has held NaN gives the same bytes afterwards as before."""
    fault = Fault("huge disturbance", plant, "rk4", "slow, noisy", 4, 5, 1, 1.7e308)
    before = fault.run(path, strikes=False).digest()
    for kind in ("huge disturbance", "nan", "division by zero"):
        assert not fault._replace(kind=kind).run(path).completed
        assert fault.run(path, strikes=False).digest() == before
