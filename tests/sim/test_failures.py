"""Runs that fail: the outcome, the exact step, what is kept, and a plant that works again afterwards."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.arms import chain, still
from tests.sim.loops import PLANTS, go, idle, law_of, plant_of, spring
from torquebench import Controller, Puma560, find_law, references, simulate
from torquebench.errors import SimulationError
from torquebench.sim.closed_loop import MAX_POSITION, MAX_VELOCITY
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.trajectory import SIGNALS, Outcome

BAD, ERROR, DIVERGED = Outcome.BAD_TORQUE, Outcome.CONTROLLER_ERROR, Outcome.DIVERGED
AT = 7
"""Step at which the laws below fail."""


def fill(tau: Any, value: float, joint: int) -> None:
    """Set one joint's torque."""
    tau[joint] = value


def raises(error: Exception) -> None:
    """Raise."""
    raise error


FAULTS: dict[str, tuple[Callable[[Any, float], Any], Outcome, str]] = {
    "nan": (lambda tau, one: fill(tau, math.nan, 1), BAD, "joint 2: tau = nan"),
    "inf": (lambda tau, one: fill(tau, math.inf, 0), BAD, "joint 1: tau = inf"),
    "minus inf": (lambda tau, one: fill(tau, -math.inf, 1), BAD, "joint 2: tau = -inf"),
    "nan returned": (lambda tau, one: [0.0, math.nan], BAD, "joint 2: tau = nan"),
    "numpy invalid": (lambda tau, one: fill(tau, np.sqrt(np.float64(-one)), 0), BAD, "joint 1: tau = nan"),
    "numpy overflow": (lambda tau, one: fill(tau, np.float64(one) / 0.0, 0), BAD, "joint 1: tau = inf"),
    "division by zero": (lambda tau, one: one / 0.0, BAD, "ZeroDivisionError: float division by zero"),
    "overflow": (lambda tau, one: math.exp(1e4 * one), BAD, "OverflowError: math range error"),
    "floating point": (lambda tau, one: raises(FloatingPointError("strict")), BAD, "FloatingPointError: strict"),
    "wrong shape": (lambda tau, one: np.zeros(3), ERROR, r"the law.s torque has shape \(3,\), wanted \(2,\)"),
    "scalar": (lambda tau, one: 1.0, ERROR, r"the law.s torque has shape \(\), wanted \(2,\)"),
    "column": (lambda tau, one: np.zeros((2, 1)), ERROR, r"the law.s torque has shape \(2, 1\)"),
    "text": (lambda tau, one: "torque", ERROR, "the law returned <U6 values"),
    "own error": (lambda tau, one: raises(RuntimeError("no solution")), ERROR, "RuntimeError: no solution"),
    "own value error": (lambda tau, one: raises(ValueError("bad horizon")), ERROR, "ValueError: bad horizon"),
    "index": (lambda tau, one: tau[5], ERROR, "IndexError: index 5 is out of bounds"),
    "assertion": (lambda tau, one: raises(AssertionError()), ERROR, "AssertionError"),
}
DOMAIN = (lambda tau, one: math.sqrt(-one), BAD, "ValueError: math domain error")
"""Python 3.14 says in other words what was wrong; there this outcome is not recognised yet."""
try:
    math.sqrt(-1.0)
except ValueError as known:
    if str(known) == "math domain error":
        FAULTS["domain"] = DOMAIN


def faulty(fault: Callable[[Any, float], Any]) -> Callable[..., Any]:
    """Return a law that works as `spring` for seven steps and then has the fault."""

    def law(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> Any:
        spring(gains, model, t, q, qd, ref, memory, tau)
        return fault(tau, 1.0) if t == AT * 0.001 else None

    return law


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_law_ends_the_run_at_its_step(fault: str, name: str) -> None:
    """The outcome, the step and the detail are exact; all before is as in the healthy run; nothing is padded."""
    function, outcome, detail = FAULTS[fault]
    told: list[int] = []
    run = go(plant_of(name), faulty(function), progress=told.append)
    assert (run.outcome, run.failed_at) == (outcome, AT)
    assert not run.completed
    assert re.match(detail, run.detail)
    assert told == list(range(AT))
    assert {len(x) for x in run.arrays().values()} == {AT + 1}
    assert run.t[-1] == AT * 0.001
    healthy = go(plant_of(name), spring)
    for signal in SIGNALS:
        assert getattr(run, signal)[:AT].tobytes() == getattr(healthy, signal)[:AT].tobytes()
    for signal in ("q", "qd", "q_meas", "qd_meas", "q_ref", "qd_ref", "qdd_ref"):
        assert getattr(run, signal)[AT].tobytes() == getattr(healthy, signal)[AT].tobytes()
    # no torque was produced, so none is claimed
    assert np.any(~np.isfinite(run.tau_law[AT]))
    assert np.all(np.isnan(run.tau[AT]))
    assert np.all(np.isnan(run.tau_applied[AT]))


def test_the_error_says_who_what_and_when_and_carries_the_run() -> None:
    """Raised by default; the trajectory it carries is the one that is returned when nothing is raised."""
    law = faulty(FAULTS["nan"][0])
    with pytest.raises(SimulationError) as caught:
        go(plant_of("analytic"), law, throw=True)
    text = str(caught.value)
    for part in ("controller 'mine'", "non-finite torque", "t = 0.007 s (step 7)", "joint 2: tau = nan"):
        assert part in text
    kept = caught.value.trajectory
    assert kept.digest() == go(plant_of("analytic"), law).digest()  # type: ignore[attr-defined]


@pytest.mark.parametrize("stop", [KeyboardInterrupt])
def test_a_user_who_stops_the_program_is_not_a_faulty_law(stop: type[BaseException]) -> None:
    """Ctrl-C inside a law ends the program, not only the run."""

    def law(*arguments: Any) -> None:
        raise stop

    with pytest.raises(stop):
        go(plant_of("analytic"), law)


# 1e6 N m on 0.1 kg m^2 for 1 ms is 1e4 rad/s: the first is just beyond the bound, the last overflows inside a step
@pytest.mark.parametrize("torque", [1e8, -1e8, 1e20, 1e100, 1e300, -1.7e308])
@pytest.mark.parametrize("name", PLANTS)
def test_a_huge_disturbance_diverges_at_its_step(
    name: str, torque: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run ends at the step that left the bounds, with the torques that did it; MuJoCo writes no log file."""
    monkeypatch.chdir(tmp_path)
    d = np.zeros((50, 2))
    d[AT, 1] = torque
    plant = plant_of(name)
    run = go(plant, spring, disturbance=d)
    assert (run.outcome, run.failed_at) == (DIVERGED, AT)
    assert {len(x) for x in run.arrays().values()} == {AT + 1}
    assert run.tau_applied[AT].tolist() == (run.tau[AT] + d[AT]).tolist()
    for signal in set(SIGNALS) - {"s"}:
        assert np.all(np.isfinite(getattr(run, signal)))
    assert run.detail.endswith("after the step")
    assert run.q.tobytes() == go(plant_of(name), spring).q[: AT + 1].tobytes()
    # and the same plant works again, byte for byte
    assert go(plant, spring).digest() == go(plant_of(name), spring).digest()
    assert list(tmp_path.iterdir()) == []


def test_bounds_are_where_they_are_said_to_be() -> None:
    """The last step inside the bounds completes; the first one outside diverges, by position and by speed."""

    class Coast:
        """A plant that jumps to a given state when stepped."""

        n, timestep, tau_max = 2, 0.001, np.array([80.0, 25.0])

        def __init__(self, q: float, qd: float) -> None:
            self.q, self.qd, self.ahead = np.zeros(2), np.zeros(2), (q, qd)

        def reset(self, q: Any, qd: Any) -> None:
            self.q, self.qd = q, qd

        def state(self) -> Any:
            return self.q, self.qd

        def step(self, tau: Any, substeps: int) -> None:
            self.q, self.qd = np.array([0.0, self.ahead[0]]), np.array([0.0, self.ahead[1]])

    for q, qd in ((MAX_POSITION, 0.0), (-MAX_POSITION, MAX_VELOCITY), (0.0, -MAX_VELOCITY)):
        assert go(Coast(q, qd), idle, 0.002).completed
    beyond = 1.0 + 1e-15
    cases = [(MAX_POSITION * beyond, 0.0), (0.0, -MAX_VELOCITY * beyond), (math.nan, 0.0), (0.0, math.inf)]
    for q, qd in cases:
        run = go(Coast(q, qd), idle, 0.002)
        assert (run.outcome, run.failed_at) == (DIVERGED, 0)
        assert run.detail.startswith("joint 2: q = ")


TINY = """
<mujoco>
  <option gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <body><inertial mass="1e-9" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/><joint name="arm" axis="0 0 1"/></body>
  </worldbody>
  <actuator><motor joint="arm" ctrllimited="true" ctrlrange="-40 40"/></actuator>
</mujoco>
"""


@pytest.mark.parametrize("name", PLANTS)
def test_a_torque_on_next_to_no_inertia_diverges(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """40 N m on 1e-9 kg m^2 is 4e7 rad/s after a millisecond: beyond the bound at the very first step."""
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    file = tmp_path / "tiny.xml"
    file.write_text(TINY)
    one = np.array([1.0])
    belief = chain(0 * one, 1e-9 * one, 0 * one, 1e-9 * one, 0 * one, 40 * one, one, gravity=0.0)
    plant = MujocoPlant(file) if name == "mujoco" else AnalyticPlant(belief)

    def push(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        tau[0] = 1e3

    run = go(plant, law_of(push), model=belief, reference=still(np.zeros(1)))
    assert (run.outcome, run.failed_at, len(run.t)) == (DIVERGED, 0, 1)
    assert run.tau_law[0, 0] == 1e3
    assert run.tau[0, 0] == run.tau_applied[0, 0] == 40.0
    assert list((tmp_path / "cwd").iterdir()) == []


def test_a_law_that_rewrites_its_arguments_changes_neither_the_plant_nor_the_next_run() -> None:
    """Model, gains, state and reference are the law's own copies: writing to them cannot make it look better."""
    arm = Puma560()
    law = find_law("computed-torque")
    gains = law.pack_gains(6, {"lam": 10, "kv": 20, "ki": 0}, {})

    def vandal(g: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        for array in (model.mass, model.inertia, model.armature, model.com, model.tau_max, g.lam, q, qd, ref.q):
            if array.flags.writeable:
                array[...] = 7.0
        tau[:] = 0.0

    motion = references.sine(np.full(6, 0.5), np.full(6, 0.5))
    honest = Controller("honest", law, gains)
    plant = AnalyticPlant(arm)
    before = simulate(plant, honest, arm, motion, duration=0.05).digest()
    simulate(plant, Controller("vandal", dataclasses.replace(law, function=vandal), gains), arm, motion, duration=0.05)
    assert simulate(plant, honest, arm, motion, duration=0.05).digest() == before
    assert np.array_equal(gains.lam, np.full(6, 10.0))


def test_what_a_raising_law_did_not_produce_is_nan() -> None:
    """At the failing instant torque and sliding variable are NaN, not those of the instant before."""
    law = find_law("smc")

    def raising(g: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        if t > 0.0095:
            raise RuntimeError("boom")
        law.function(g, model, t, q, qd, ref, memory, tau)

    controller = Controller(
        "x", dataclasses.replace(law, function=raising), law.pack_gains(6, {"lam": 10, "k": 0.3}, {})
    )
    motion = references.sine(np.full(6, 0.5), np.full(6, 0.5))
    run = simulate(AnalyticPlant(Puma560()), controller, Puma560(), motion, duration=0.05, throw=False)
    assert run.failed_at == 10
    assert np.all(np.isfinite(run.s[:10]))
    assert np.all(np.isnan(run.s[10]))
    assert np.all(np.isnan(run.tau_law[10]))


def test_a_law_that_ends_the_program_fails_its_run_instead() -> None:
    """`sys.exit(0)` in a law must not end the command with status 0 and nothing done."""

    def leaving(*arguments: Any) -> None:
        raise SystemExit(0)

    run = go(plant_of("analytic"), leaving)
    assert run.outcome is Outcome.CONTROLLER_ERROR
    assert "SystemExit" in run.detail


@pytest.mark.parametrize(
    "spoil",
    [
        lambda memory, tau: memory.s.resize(3, refcheck=False),
        lambda memory, tau: tau.resize(3, refcheck=False),
        lambda memory, tau: tau.setflags(write=False),
        lambda memory, tau: 1j * np.ones(6),
        lambda memory, tau: np.full(6, "1"),
        lambda memory, tau: np.full(6, "2020-01-01", dtype="datetime64[D]"),
        lambda memory, tau: np.ma.masked_array(np.ones(6), mask=True),
        lambda memory, tau: [None] * 6,
    ],
    ids=["memory resized", "torque resized", "read-only", "complex", "text", "dates", "masked", "nothing"],
)
def test_a_law_that_spoils_its_arrays_fails_its_run(spoil: Callable[[Any, Any], Any]) -> None:
    """Whatever a law does to what it was given, the run ends with an outcome and the next one is unharmed."""
    law = find_law("smc")

    def spoiling(g: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> Any:
        return spoil(memory, tau)

    gains = law.pack_gains(6, {"lam": 10, "k": 0.3}, {})
    motion = references.sine(0.5, 0.5)
    controller = Controller("x", dataclasses.replace(law, function=spoiling), gains)
    run = simulate(AnalyticPlant(Puma560()), controller, Puma560(), motion, duration=0.05, throw=False)
    assert run.failed_at == 0
    assert run.outcome in (Outcome.CONTROLLER_ERROR, Outcome.BAD_TORQUE)
    honest = Controller("x", law, gains)
    assert simulate(AnalyticPlant(Puma560()), honest, Puma560(), motion, duration=0.05).completed


def test_an_error_in_a_law_names_its_line() -> None:
    """The detail has the file and the line where the law raised, not a line of the loop."""

    def wrong(*arguments: Any) -> None:
        [0.0][7]

    detail = go(plant_of("analytic"), wrong).detail
    assert re.search(r"IndexError: .*\(test_failures\.py, line \d+\)", detail), detail


class Sly(Exception):
    """An exception whose own text ends the program."""

    def __str__(self) -> str:
        """Never give a text."""
        raise SystemExit(0)


@pytest.mark.parametrize(
    ("error", "outcome", "text"),
    [
        (Sly(), ERROR, r"Sly: \(no text\)"),
        (GeneratorExit(), ERROR, "GeneratorExit"),
        (ValueError("expected a positive gain"), ERROR, "expected a positive gain"),
        (ValueError("one\ntwo\x1b[31m"), ERROR, r"one two \[31m"),
    ],
)
def test_whatever_a_law_raises_is_one_printable_line(error: BaseException, outcome: Outcome, text: str) -> None:
    """Odd exceptions end the run, not the program, and cannot write to the terminal but in plain text."""

    def law(*arguments: Any) -> None:
        raise error

    run = go(plant_of("analytic"), law)
    assert run.outcome is outcome
    assert re.search(text, run.detail)
    assert run.detail.isprintable()
