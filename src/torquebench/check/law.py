"""The contract test of one law."""

from __future__ import annotations

from torquebench.check.contract import check_allocation, check_answers, takes_its_arguments
from torquebench.check.cost import measure
from torquebench.check.driving import silence
from torquebench.check.effects import check_effects
from torquebench.check.paths import check_loops
from torquebench.check.report import NOTE, Check, Report, report_of
from torquebench.laws import Law, find_law
from torquebench.laws.dialect import complaints

PERIOD = 1000.0
"""Control period to which costs are related [us]."""


def check_law(law: Law | str) -> Report:
    """Try a law on two arms, with its options and positive gains, on both paths, and return what was found.

    Args:
        law: A registered law, or its name.

    Raises:
        ControllerError: no law has this name.
    """
    law = find_law(law) if isinstance(law, str) else law
    report = report_of(law)
    report.complaints = complaints(law)
    wrong = takes_its_arguments(law)
    report.add("arguments", wrong and f"{wrong} (line {report.line})", "takes the arguments of a law")
    if wrong:
        return report
    with silence() as printed:
        check_answers(law, report)
        if report.held:
            check_effects(law, report)
        else:
            report.add("effects", "gains and joints not tried: they show only in torques that are right", "", NOTE)
        check_allocation(law, report)
        count = len(report.complaints)
        outside = f"outside it in {count} place{'s' if count > 1 else ''}, listed below" if count else ""
        report.add("dialect", outside, "kept", NOTE)
        check_loops(law, report)
        report.cost = measure(law)
    text = printed.getvalue()
    report.add("quiet", text and f"prints: {text.splitlines()[0][:60]!r}", "prints nothing", NOTE)
    both = f", compiled {_cost(report.cost.native)}" if report.cost.native is not None else ""
    report.checks.append(Check("cost", NOTE, f"a call on six joints: interpreted {_cost(report.cost.python)}{both}"))
    return report


def _cost(microseconds: float) -> str:
    return f"{microseconds:.3g} us, {100.0 * microseconds / PERIOD:.2g} % of 1 ms"
