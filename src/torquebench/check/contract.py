"""What the loop relies on, tried on the law as the Python function it is."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torquebench.check.cases import ARMS, Motion, arm, combinations, gains_of, label, motions
from torquebench.check.driving import Answer, drive, driver, record
from torquebench.check.report import FAIL, NOTE, Report
from torquebench.dialect.source import FORM, INPUTS, STATE
from torquebench.laws import Law
from torquebench.laws.dialect import ARGUMENTS
from torquebench.references import Reference


@dataclass(frozen=True)
class Case:
    """An arm, a choice of options, and gains."""

    arm: str
    options: Mapping[str, str | bool]
    draw: int

    def __str__(self) -> str:
        return f"{self.arm}{label(self.options)}"


def cases(law: Law) -> Iterator[Case]:
    """Every arm under every choice of options, with two draws of gains."""
    for name in ARMS:
        for options in combinations(law):
            yield from (Case(name, options, draw) for draw in (1, 2))


def takes_its_arguments(law: Law) -> str:
    """Return why a law cannot be called with the arguments of a law; an empty text when it can."""
    try:
        signature = inspect.signature(law.function)
        signature.bind(*ARGUMENTS)
    except (TypeError, ValueError) as error:
        return f"{error}; wanted ({', '.join(ARGUMENTS)})"
    return ""


def check_answers(law: Law, report: Report) -> None:
    """Check torque, determinism, inputs and state; the law must take its arguments."""
    shape, finite, repeat, state = "", "", "", ""
    changed: list[str] = []
    tried = 0
    for case in cases(law):
        for motion in motions(arm(case.arm).n, case.draw):
            answer = _drive(law, case, motion)
            tried += len(motion.t)
            changed += answer.changed
            shape = shape or (f"{case}, {answer.shape}" if answer.shape else "")
            finite = finite or (f"{case}, {answer.finite}" if answer.finite else "")
            if not repeat and not answer.same(_drive(law, case, motion)):
                repeat = f"{case}: called again with the same arguments it gives another torque"
        state = state or _remembers(law, case)
    where = f" ({Path(report.file).name}, line {report.line})"
    calls = f"{tried} calls on {' and '.join(ARMS)}"
    report.add("torque", shape and _placed(shape, report, where), f"a number for each joint, {calls}")
    nothing = "not fully tried, for want of a torque"

    def said(name: str, problem: str, good: str) -> None:
        # what was never computed cannot have passed
        report.add(name, problem or (nothing if shape else ""), good, FAIL if problem else NOTE)

    said("finite", finite and _placed(finite, report, where), f"every torque and all of memory, {calls}")
    said("repeatable", repeat and repeat + _because(report, STATE, where), "same arguments, same bytes")
    names = ", ".join(dict.fromkeys(changed))
    report.add(
        "inputs",
        names and f"writes to {names}{_because(report, INPUTS, where)}",
        "gains, q, qd, ref and model are as they were",
    )
    said("state", state and state + _because(report, STATE, where), "memory, zero at the start, is all that survives")


def check_allocation(law: Law, report: Report) -> None:
    """Check whether a law returns an array instead of filling the one it is given."""
    case = next(cases(law))
    d, motion = driver(law, arm(case.arm), case.options, _gains(law, case)), next(motions(arm(case.arm).n))
    function: Callable[..., Any] = law.function
    q, qd, ref, tau = (
        motion.q[0].copy(),
        motion.qd[0].copy(),
        Reference(*(x[0].copy() for x in motion[3:])),
        motion.q[1],
    )
    try:
        returned = function(d.gains, d.belief, 0.0, q, qd, ref, d.memory, tau.copy())
    except (Exception, SystemExit, GeneratorExit):  # noqa: BLE001  which the check of torques reports
        return
    text = "" if returned is None else "returns an array, which is allocated at every call: fill tau[i] instead"
    report.add("allocation", text, "fills tau in place", NOTE)


def _gains(law: Law, case: Case) -> dict[str, Any]:
    return gains_of(law, arm(case.arm).n, case.options, case.draw)


def _drive(law: Law, case: Case, motion: Motion) -> Answer:
    return drive(driver(law, arm(case.arm), case.options, _gains(law, case)), motion)


def _remembers(law: Law, case: Case) -> str:
    """Return what shows that a law remembers more than its memory holds.

    Two of them are called in turns, and their memory is put into other arrays at every instant; neither may notice.
    """
    other = Case(case.arm, case.options, case.draw + 10)
    here, there = list(motions(arm(case.arm).n, case.draw))[2:4]
    alone = [_drive(law, case, here), _drive(law, other, there)]
    drivers = [driver(law, arm(case.arm), case.options, _gains(law, each)) for each in (case, other)]
    together = [Answer(np.full_like(a.tau, np.nan), np.zeros_like(a.memory)) for a in alone]
    for k in range(len(here.t)):
        for d, answer, motion in zip(drivers, together, (here, there), strict=True):
            d.move_memory()
            record(answer, d, motion, k)
    if all(a.same(b) for a, b in zip(alone, together, strict=True)):
        return ""
    return f"{case}: two of them called in turns disturb each other: it remembers more than its memory holds"


def _placed(text: str, report: Report, where: str) -> str:
    """Return a message with the place of the law, unless it names a line itself."""
    return text if ", line " in text else text + _because(report, FORM, where)


def _because(report: Report, topic: str, where: str) -> str:
    """Return the lines of the source that may be the reason: those of complaints on the topic, or else on any."""
    lines = sorted({c.line for c in report.complaints if c.topic == topic})
    lines = lines or sorted({c.line for c in report.complaints})
    if not lines:
        return where
    return f" ({Path(report.file).name}, line{'s' if len(lines) > 1 else ''} {', '.join(map(str, lines[:5]))})"
