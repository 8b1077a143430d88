"""The contract test of a law: what the loop relies on, tried out on two arms and on both paths.

Every ``check_...`` function adds what it found to a `Report`; `check_law` at the end says in which order.
"""

from __future__ import annotations

import inspect
import itertools
import math
import re
import statistics
import timeit
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba.core import event

from torquebench.chain import IDEAL, NOTHING
from torquebench.check_cases import (
    ARMS,
    Case,
    Driver,
    Motion,
    Options,
    arm,
    case,
    cases,
    combinations,
    drive,
    gains_of,
    motions,
    silence,
)
from torquebench.dialect import ARGUMENTS, FORM, INPUTS, STATE, Complaint, complaints, line_of
from torquebench.kernel import Array
from torquebench.laws import Law, find_law
from torquebench.references import Reference, Sine
from torquebench.robot.flat_model import own_copy
from torquebench.sim.closed_loop import COMPLETED, RAISED, copy_row
from torquebench.sim.interpreted import Call
from torquebench.sim.job import set_up
from torquebench.sim.native import RUN_SIGNATURE, NativeFunction, bind_law, job_at, law_obstacle, law_of
from torquebench.sim.plants import Plant
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Outcome, Trajectory

PASS, FAIL, NOTE = "pass", "FAIL", "note"
"""Verdicts: held; did not hold; nothing to hold, but worth knowing."""
DRAWS = (1, 2, 3, 4)
"""Draws of the other gains among which one must have an effect: bounds that cross may hide it in one of them."""
FACTORS = (1.5, 0.5, 10.0, 0.1)
"""By which a gain is multiplied to see whether it has an effect."""
PLANTS = (("puma560", "mujoco"), ("two-link", "analytic"), ("two-link", "mujoco"))
"""Arms with engines; not the PUMA as an analytic plant, which takes 15 s to compile or 1 s a loop interpreted: to a
law it is the arm that it meets in MuJoCo."""
SCALES = (1.0, 0.1, 10.0)
"""Sizes of gains in closed loops; the first counts as ordinary."""
DURATION = 0.2
"""Length of each closed loop [s]; 200 control instants."""
ORDINARY = 100.0
"""A failure at positions and speeds below this [rad, rad/s] is the law's, not that of gains that do not fit the arm."""
ROUNDS, CALLS = 9, 200
"""Rounds of timing, of whose times the median is taken, and calls in each."""
SPREAD = 1.5
"""Slowest of the middle rounds over the fastest; where it is more, other work shares the machine."""
PERIOD = 1000.0
"""Control period to which costs are related [us]."""


class Check(NamedTuple):
    """One thing that was tried."""

    name: str
    verdict: str
    """PASS, FAIL or NOTE."""
    detail: str
    """The cases tried, or the fault and its place."""


class Cost(NamedTuple):
    """Time that one call of the law takes, medians [us]."""

    python: float
    native: float | None
    """None for a law that is not compiled."""
    steady: bool = True
    """Whether the rounds of timing agree; where they do not, other work shares the machine."""


@dataclass
class Report:
    """The result of a contract test: its checks in the order in which they were made."""

    law: str
    file: str
    line: int
    """Place of the law's source."""
    checks: list[Check] = field(default_factory=list)
    complaints: tuple[Complaint, ...] = ()
    """Obstacles to compiling the law."""
    cost: Cost | None = None

    @property
    def held(self) -> bool:
        """Whether every check held."""
        return all(check.verdict != FAIL for check in self.checks)

    def add(
        self, name: str, wrong: str, right: str, verdict: str = FAIL, *, topic: str = "", lines: Sequence[int] = ()
    ) -> None:
        """Add a check; one that failed without naming a line is given those on which the reason may lie.

        Args:
            name: Its name.
            wrong: What was wrong; empty when it held.
            right: What was tried.
            verdict: FAIL or NOTE, for when something was wrong.
            topic: Of the complaints whose lines are named, or else those of all complaints; empty for the law's line.
            lines: Known better.
        """
        if wrong and verdict == FAIL and not re.search(r"\bline \d", wrong):
            known = {c.line for c in self.complaints if c.topic == topic} or {c.line for c in self.complaints}
            chosen = lines or (sorted(known)[:5] if topic else []) or [self.line]
            wrong += f" ({Path(self.file).name}, line{'s' if len(chosen) > 1 else ''} {', '.join(map(str, chosen))})"
        self.checks.append(Check(name, verdict if wrong else PASS, wrong or right))

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain data."""
        return {
            "law": self.law,
            "file": self.file,
            "line": self.line,
            "held": self.held,
            "checks": [check._asdict() for check in self.checks],
            "complaints": [{"line": c.line, "what": c.what, "cure": c.cure} for c in self.complaints],
            "cost_us": None if self.cost is None else self.cost._asdict(),
        }

    def __str__(self) -> str:
        width = max((len(check.name) for check in self.checks), default=0)
        rows = [f"{check.verdict}  {check.name:<{width}}  {check.detail}" for check in self.checks]
        places = [f"{Path(self.file).name}:{c.line}: {c.what}: {c.cure}" for c in self.complaints]
        return "\n".join([f"law '{self.law}' ({self.file}, line {self.line})", *rows, *places])


def check_law(law: Law | str, progress: Callable[[str], None] = lambda what: None) -> Report:
    """Try a law on two arms, with its options and positive gains, on both paths, and return what was found.

    Args:
        law: A registered law, or its name.
        progress: Told what is being tried.

    Raises:
        ControllerError: no law has this name.
    """
    law = find_law(law) if isinstance(law, str) else law
    code = getattr(getattr(law.function, "py_func", law.function), "__code__", None)
    report = Report(law.name, getattr(code, "co_filename", "no file"), getattr(code, "co_firstlineno", 0))
    report.complaints = complaints(law)
    check_arguments(law, report)
    if not report.held:
        return report
    with silence() as printed:
        progress("torque and memory")
        check_answers(law, report)
        if report.held:
            progress("gains and joints")
            check_gains(law, report)
            check_joints(law, report)
        else:
            report.add("effects", "gains and joints not tried: they show only in torques that are right", "", NOTE)
        check_dialect(report)
        check_loops(law, report, progress)
        progress("cost of a call")
        costs = check_cost(law, report)
    text = printed.getvalue()
    report.add("quiet", f"prints: {text.splitlines()[0][:60]!r}" if text else "", "prints nothing", NOTE)
    report.add("cost", costs, "", NOTE)
    return report


def check_arguments(law: Law, report: Report) -> None:
    """A law can be called with the arguments of a law."""
    wrong = ""
    try:
        inspect.signature(law.function).bind(*ARGUMENTS)
    except (TypeError, ValueError) as error:
        wrong = f"{error}; wanted ({', '.join(ARGUMENTS)})"
    report.add("arguments", wrong, "takes the arguments of a law")


def check_answers(law: Law, report: Report) -> None:
    """A law gives a finite torque for each joint, the same one every time; changes no input; hides no state."""
    wrong: dict[str, str] = {}
    """Name of a check -> the first thing that was wrong."""
    changed: list[str] = []
    calls = 0
    for draw in (1, 2):
        for tried in cases(law, draw):
            stretches = motions(arm(tried.arm).n, draw)
            for motion in stretches:
                answer = drive(law, tried, motion)
                calls += len(motion.t)
                changed += answer.changed
                wrong = {name: f"{tried}, {text}" for name, text in answer.wrong.items()} | wrong
                if "repeatable" not in wrong and answer.bytes() != drive(law, tried, motion).bytes():
                    wrong["repeatable"] = f"{tried}: called again with the same arguments it gives another torque"
            if "state" not in wrong and _remembers(law, tried, stretches[2], stretches[3]):
                disturb = "two of them called in turns disturb each other: it remembers more than its memory holds"
                wrong["state"] = f"{tried}: {disturb}"
    if changed:
        wrong["inputs"] = f"writes to {', '.join(dict.fromkeys(changed))}"
    number = f"{calls} calls on {' and '.join(ARMS)}"
    for name, topic, right in (
        ("torque", FORM, f"a number for each joint, {number}"),
        ("finite", FORM, f"every torque and all of memory, {number}"),
        ("repeatable", STATE, "same arguments, same bytes"),
        ("inputs", INPUTS, "gains, q, qd, ref and model are as they were"),
        ("state", STATE, "memory, zero at the start, is all that survives"),
    ):
        if name in wrong or "torque" not in wrong:
            report.add(name, wrong.get(name, ""), right, topic=topic)
        else:  # what was never computed cannot have passed
            report.add(name, "not fully tried, for want of a torque", right, NOTE)


def _remembers(law: Law, tried: Case, here: Motion, there: Motion) -> bool:
    """Whether a law remembers more than its memory holds.

    Two of them are called in turns, and their memory is put into other arrays at every instant; neither may notice.
    """
    other = case(law, tried.arm, tried.options, 11)
    alone = drive(law, tried, here), drive(law, other, there)
    drivers = Driver(law, tried), Driver(law, other)
    for k in range(len(here.t)):
        for driver, motion in zip(drivers, (here, there), strict=True):
            driver.move_memory()
            driver.call(motion, k)
    return any(a.bytes() != b.answer.bytes() for a, b in zip(alone, drivers, strict=True))


def check_gains(law: Law, report: Report) -> None:
    """Each gain changes the torque on every joint under some choice of options, and so does each option."""
    silent = {name: where for name in law.gains if (where := _silent_gain(law, name))}
    wrong = [f"'{name}' {where}" for name, where in silent.items()]
    wrong += [f"option '{name}' makes no difference" for name in law.options if not _option_matters(law, name)]
    lines = sorted({line_of(law.gains_type, name, law.function) for name in silent})
    count = f"each of {len(law.gains)} gains and {len(law.options)} options changes the torque"
    report.add("gains", "; ".join(wrong), count, lines=lines)


def _silent_gain(law: Law, gain: str) -> str:
    """Return where a gain has no effect under any choice of options; an empty text when it has one everywhere."""
    for name in ARMS:
        n = arm(name).n
        choices = [options for options in combinations(law) if law.gain_problem(gain, True, options) is None]
        used = [case(law, name, options, draw) for draw in DRAWS for options in choices]
        silent = [str(j + 1) for j in range(n) if not any(_gain_matters(law, gain, j, tried) for tried in used)]
        if silent:
            return "has no effect" + (f" on {name}'s joint {', '.join(silent)}" if len(silent) < n else "")
    return ""


def _gain_matters(law: Law, gain: str, joint: int, tried: Case) -> bool:
    def scaled(factor: float) -> Case:
        changed = tried.gains[gain].copy()
        changed[joint] *= factor
        return replace(tried, gains={**tried.gains, gain: changed})

    others = [scaled(factor) for factor in FACTORS]
    return any(_differ(law, tried, others, motion) for motion in motions(arm(tried.arm).n)[::-1])


def _option_matters(law: Law, name: str) -> bool:
    """Whether some value of an option gives another torque than its first."""
    first, *others = law.options[name].values
    choices = [options for options in combinations(law) if options[name] == first]
    return not others or any(
        _differ(
            law, case(law, "two-link", options), [case(law, "two-link", options | {name: x}) for x in others], motion
        )
        for options, motion in itertools.product(choices, motions(2))
    )


def _differ(law: Law, tried: Case, others: Iterable[Case], motion: Motion) -> bool:
    """Whether a law gives another torque in some other case than in the one that is tried."""
    own = drive(law, tried, motion, watched=False).tau.tobytes()
    return any(drive(law, other, motion, watched=False).tau.tobytes() != own for other in others)


def check_joints(law: Law, report: Report) -> None:
    """Each joint's torque depends on what that joint does."""
    idle = next((text for tried in cases(law) if (text := _idle_joint(law, tried))), "")
    report.add("joints", idle, "each joint's torque follows that joint's own motion")


def _idle_joint(law: Law, tried: Case) -> str:
    n = arm(tried.arm).n
    stretches = list(zip(motions(n)[2:], motions(n, seed=1)[2:], strict=True))
    for j in range(n):
        column = np.arange(n) == j
        moved = [Motion(a.t, *(np.where(column, *xs) for xs in zip(b[1:], a[1:], strict=True))) for a, b in stretches]
        both = [(a, b) for (a, _), b in zip(stretches, moved, strict=True)]
        torques = ([drive(law, tried, x, watched=False).tau[:, j].tobytes() for x in pair] for pair in both)
        if all(own == other for own, other in torques):
            return f"{tried}: joint {j + 1}'s torque does not depend on that joint's state or reference"
    return ""


def check_dialect(report: Report) -> None:
    """A law fills the array it is given, and keeps the dialect, so that it can be compiled."""
    returns = any(complaint.what == "a value is returned" for complaint in report.complaints)
    text = "returns an array, which is allocated at every call: fill tau[i] instead" if returns else ""
    report.add("allocation", text, "fills tau in place", NOTE)
    count = len(report.complaints)
    outside = f"outside it in {count} place{'s' if count > 1 else ''}, listed by line" if count else ""
    report.add("dialect", outside, "kept", NOTE)


def check_loops(law: Law, report: Report, progress: Callable[[str], None] = lambda what: None) -> None:
    """Closed loops run; compiled the law gives the same bytes as interpreted; and new gains do not compile it again.

    A loop is run interpreted, and the compiled law is then called at each of its instants, with a memory of its own.
    That decides for the compiled loop too: it and the plants are the same machine code for every law, which they call
    by its address, and go where its torque sends them. So neither need be compiled to try a law.
    """
    progress("compiling the law")
    failed, differs, loops, why = "", "", list(_loops(law)), law_obstacle(law)
    for k, (name, engine, options, scale) in enumerate(loops):
        progress(f"closed loop {k + 1} of {len(loops)}")
        at = f"{engine} {Case(name, options, {})}, gains around {scale:g}"
        run = _run(law, name, engine, options, scale)
        if not failed and _is_fault(run):
            failed = f"{at}: t = {run.t[-1]:g} s: {run.detail}"
        if not why and not differs:
            found = difference(law, name, options, scale, run)
            differs = found and f"{at}: {found}"
    report.add("loop", failed, f"{len(loops)} closed loops of {DURATION:g} s on analytic and mujoco plants")
    if why and not differs:
        report.add("paths", f"readable path only: {'outside the dialect' if report.complaints else why}", "", NOTE)
        return
    report.add("paths", differs, f"interpreted and compiled, {len(loops)} loops, 0 differing bytes")
    options = combinations(law)[-1]
    run = _run(law, "two-link", "mujoco", options, 3.0)
    with event.install_recorder("numba:run_pass") as compiling:
        difference(law, "two-link", options, 3.0, run)
    again = "new gains compiled it again" if compiling.buffer else ""
    report.add("compiled once", again, "whatever the gains, options, arm and plant")


@cache
def plant_of(name: str, engine: str) -> Plant:
    """Return an arm as a plant."""
    return MujocoPlant(name) if engine == "mujoco" else AnalyticPlant(arm(name))


def _loops(law: Law) -> Iterator[tuple[str, str, Options, float]]:
    """Yield arm, engine, options and size of gains of each closed loop."""
    for k, options in enumerate(combinations(law)):
        for j, (name, engine) in enumerate(PLANTS):
            for scale in SCALES if k == 0 else (SCALES[(j + k) % len(SCALES)],):
                yield name, engine, options, scale


def _controller(law: Law, name: str, options: Options, scale: float) -> Controller:
    n = arm(name).n
    return Controller(law.name, law, law.pack_gains(n, gains_of(law, n, options, 3, scale), options))


def _run(law: Law, name: str, engine: str, options: Options, scale: float) -> Trajectory:
    """Run a closed loop, interpreted; arguments as `_loops` yields them."""
    n = arm(name).n
    target = Sine(tuple(np.linspace(0.5, 1.0, n)), tuple(np.linspace(0.5, 1.5, n)))
    own = _controller(law, name, options, scale)
    return simulate(plant_of(name, engine), own, arm(name), target, duration=DURATION, path="python", throw=False)


def _is_fault(run: Trajectory) -> bool:
    if run.outcome is Outcome.BAD_TORQUE:
        return bool(max(np.max(np.abs(run.q[-1])), np.max(np.abs(run.qd[-1]))) < ORDINARY)
    return run.outcome is Outcome.CONTROLLER_ERROR


def difference(law: Law, name: str, options: Options, scale: float, run: Trajectory) -> str:
    """Return where a compiled law begins to differ from a run of it that was interpreted; empty where it does not.

    Args:
        law: The law.
        name, options, scale: Of the run; see `_loops`.
        run: The run.
    """
    calls = LawCalls(
        law,
        _controller(law, name, options, scale).gains,
        name,
        Reference(run.q_ref, run.qd_ref, run.qdd_ref),
        run.q,
        run.qd,
    )
    raised, last = calls.compiled() == RAISED, len(run.t) - 1
    job, end = calls.setup.job, int(calls.setup.job.at[0])
    if raised and end < last:
        return f"the paths differ from step {end} on: compiled, the law raises"
    if raised:  # its torque counts as none, and what it left in its memory as what it leaves interpreted
        job.record_tau_law[end] = np.nan
    channels = {**run.extra, "s": run.s}
    found = []
    for signal, own, theirs in (
        ("tau_law", job.record_tau_law, run.tau_law),
        *((f"memory.{key}", job.record_memory[c], channels[key]) for c, key in enumerate(calls.fields)),
    ):
        rows = slice(0, end if raised and signal != "tau_law" else last + 1)
        other = np.any(own[rows].view(np.int64) != np.ascontiguousarray(theirs[rows]).view(np.int64), axis=1)
        found += [(int(np.argmax(other)), signal)] if other.any() else []
    return "the paths differ from step {} on, first in {}".format(*min(found)) if found else ""


class LawCalls:
    """A law to be called at given states, one after the other, with a memory of its own.

    Args:
        law, gains: The law and its gains.
        name: The arm that it believes in, one of ARMS.
        desired: Desired motion at each instant, (N, n).
        q, qd: Position and velocity there, (N, n).
    """

    def __init__(self, law: Law, gains: Any, name: str, desired: Reference, q: Array, qd: Array) -> None:
        belief = own_copy(arm(name).flat, control_period=0.001)
        self.setup = set_up(
            law,
            gains,
            belief,
            plant_of(name, "analytic"),
            desired,
            IDEAL,
            control_period=0.001,
            substeps=1,
            drawn=NOTHING,
            disturbance=None,
            native=None,
        )
        self.setup.job.record_q[:], self.setup.job.record_qd[:] = q, qd
        self.fields = () if law.memory_type is None else law.memory_type._fields
        """Names of the channels of the memory."""
        self._tables: Any = None

    def compiled(self) -> int:
        """Call the compiled law at every instant, and return how that ended; the job has what came of it."""
        job = self.setup.job
        self._tables = self._tables or bind_law(self.setup)
        return int(CALLS_OF_LAW.call(job.address, 0, len(job.q_ref)))


def check_cost(law: Law, report: Report) -> str:
    """Measure and say what a call costs on each path, on six joints, at a state that stays."""
    options, n = combinations(law)[0], arm(ARMS[0]).n
    t: Array = 0.001 * np.arange(CALLS, dtype=np.float64)
    desired = Reference(*(np.repeat(x, n, axis=1) for x in Sine(1.0, 0.5)(t)))
    q, qd, still = desired.q[0] - 0.01, np.zeros(n), np.zeros((CALLS, n))
    calls = LawCalls(law, law.pack_gains(n, gains_of(law, n, options, 1), options), ARMS[0], desired, still + q, still)
    call = Call(law, calls.setup.gains, calls.setup.belief, calls.setup.memory)
    refs = [Reference(*(x[k] for x in desired)) for k in range(CALLS)]

    def interpreted() -> None:
        for time, ref in zip(t.tolist(), refs, strict=True):
            call(time, q, qd, ref)

    def microseconds(calls: Callable[[], object]) -> tuple[float, bool]:
        rounds = sorted(timeit.repeat(calls, number=1, repeat=ROUNDS))
        middle = rounds[: ROUNDS - ROUNDS // 4]
        return 1e6 * statistics.median(rounds) / CALLS, middle[-1] <= SPREAD * middle[0]

    native, even = (None, True) if law_obstacle(law) else microseconds(calls.compiled)
    python, steady = microseconds(interpreted)
    report.cost = Cost(python, native, steady and even)
    return cost_text(report.cost)


def cost_text(cost: Cost) -> str:
    """Return the cost of a call in plain digits, and a remark on a busy machine where the rounds of timing differ."""
    pairs = [("interpreted", cost.python), ("compiled", cost.native)]
    times = [(name, plain(x), plain(100.0 * x / PERIOD)) for name, x in pairs if x is not None]
    unit = " % of 1 ms"
    costs = [f"{name} {time} us ({share}{unit if k == 0 else ' %'})" for k, (name, time, share) in enumerate(times)]
    return f"a call on six joints: {', '.join(costs)}{'' if cost.steady else '; busy machine'}"


def plain(x: float) -> str:
    """Return a number with two digits after a leading zero, or as a whole number from 10 on; never an exponent."""
    return f"{x:,.0f}" if x >= 10.0 else f"{x:.{max(0, 1 - math.floor(math.log10(x)))}f}" if x > 0.0 else "0"


def _call_at_each(address: int, first: int, last: int) -> int:
    job = job_at(address)
    for k in range(first, last):
        job.at[0] = k
        copy_row(job.record_q[k], job.measured_q)
        copy_row(job.record_qd[k], job.measured_qd)
        tau = job.record_tau_law[k]
        for i in range(len(tau)):
            tau[i] = math.nan  # so that a joint the law forgets is noticed
        if law_of(job, k) != COMPLETED:
            return RAISED
        for c in range(len(job.memory)):
            copy_row(job.memory[c], job.record_memory[c, k])
    return COMPLETED


CALLS_OF_LAW = NativeFunction(RUN_SIGNATURE, _call_at_each)
"""(job, first, last) -> status: calls a job's law at the states of its record, and nothing else."""
