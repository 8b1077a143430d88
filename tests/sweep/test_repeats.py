"""Loops that repeat each other are run once, and every row has the bytes that it has when all are run."""

from __future__ import annotations

from typing import Any

import pytest

from tests.sweep.examples import plan_of
from torquebench.sim import session
from torquebench.sim.session import Session
from torquebench.sweep.executors import Threads
from torquebench.sweep.repeats import Known
from torquebench.sweep.table import Table
from torquebench.sweep.worker import Task, Worker

TEXT = """\
name: repeats
plant: {engine: mujoco, model: puma560, timestep: 0.005}
model: {structure: corrected, constants: printed, mismatch: {relative: 0.1}}
controllers:
  - {name: blind, law: smc, equivalent_control: false, switching: sign, gains: {lam: 10, k: 0.6}}
  - {name: knowing, law: smc, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: pd, law: pd, gains: {lam: 10, kv: 20}}
reference: {kind: sine, amplitude: 0.5, frequency_hz: 1.0}
chain: CHAIN
run: {duration: 0.6, control_period: 0.005, metrics_from: 0, seed: 3}
sweep:
  draws: 3
  certificates: true
  grid:
    model.mismatch.relative: [0.1, 0.2]
"""


def rows(text: str, known: Known | None, monkeypatch: pytest.MonkeyPatch) -> tuple[Table, list[str]]:
    """Return the rows of a sweep, and the controllers of the loops that were run for them."""
    run, ran = Session.run, list[str]()

    def counted(self: Any, plant: Any, trial: Any, *more: Any) -> Any:
        ran.append(trial.controller.name)
        return run(self, plant, trial, *more)

    monkeypatch.setattr(Session, "run", counted)
    plan = plan_of(text)
    table = Worker(plan).columns(Task(plan.source, plan.pairs, None), 0, known=known)
    monkeypatch.setattr(Session, "run", run)
    return table, ran


def same(a: Table, b: Table) -> bool:
    """Whether two tables have the same bytes."""
    return a.keys() == b.keys() and all(a[name].tobytes() == b[name].tobytes() for name in a)


@pytest.mark.parametrize(("chain", "draws"), [("ideal", 1), ("fast", 3)])
def test_a_law_without_a_model_is_run_once_for_all_models(
    chain: str, draws: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under two wrong models in three draws each: once with exact sensors, once for each draw of their noise."""
    text = TEXT.replace("CHAIN", chain)
    whole, every = rows(text, None, monkeypatch)
    known = Known()
    found, ran = rows(text, known, monkeypatch)
    assert same(found, whole)
    assert len(every) == 18
    assert sorted(ran) == ["blind"] * draws + ["knowing"] * 6 + ["pd"] * draws
    again, none = rows(text, known, monkeypatch)
    assert same(again, whole)
    assert none == []


@pytest.mark.parametrize(
    "change",
    [
        ("k: 0.6", "k: 0.61"),
        ("switching: sign, gains: {lam: 10, k: 0.6}", "switching: saturation, gains: {lam: 10, k: 0.6, phi: 0.3}"),
        ("amplitude: 0.5", "amplitude: 0.51"),
        ("chain: ideal", "chain: {actuator_lag: 0.002}"),
        ("model: puma560,", "model: puma560, integrator: euler,"),
        ("model: puma560,", "model: puma560, payload: {mass: 1},"),
        ("model: puma560,", "model: puma560, friction: {viscous: 1},"),
        ("metrics_from: 0", "metrics_from: 0.1"),
        ("duration: 0.6", "duration: 0.6, initial_q: 0.1"),
        ("run:", "disturbances: [{kind: bias, channel: torque, value: 1}]\nrun:"),
        ("certificates: true", "certificates: false"),
    ],
    ids=lambda pair: pair[1].strip()[:30],
)
def test_nothing_else_is_taken_over(change: tuple[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    """After a sweep, one that differs in anything but the model has its own rows, as when run by itself."""
    text = TEXT.replace("CHAIN", "ideal")
    assert change[0] in text
    known = Known()
    rows(text, known, monkeypatch)
    changed = text.replace(*change)
    assert same(rows(changed, known, monkeypatch)[0], rows(changed, None, monkeypatch)[0])


def test_sweeps_that_belong_together_compile_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many small sweeps are interpreted each by itself, and compiled where all of them together are worth it."""
    asked = list[float]()

    def reason(plant: Any, law: Any, steps: float) -> str:
        asked.append(steps)
        return "not here"

    monkeypatch.setattr(session, "reason_to_interpret", reason)
    plan = plan_of(TEXT.replace("CHAIN", "ideal"))
    for known in (Known(), Known(steps=10**9)):
        list(Threads(1, known).run(Task(plan.source, plan.pairs, None), [0]))
        assert (max(asked) >= 10**9) == bool(known.steps)
