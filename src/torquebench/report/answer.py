"""The answer of a run in a few sentences: who follows best, who chatters, at what cost, who failed."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from torquebench.experiment.certify import TOO_MUCH
from torquebench.experiment.reference import joint_units
from torquebench.experiment.run import ExperimentResult
from torquebench.metrics import METRICS
from torquebench.metrics.chattering import STILL
from torquebench.metrics.shaking import is_still
from torquebench.metrics.torque import SATURATED
from torquebench.report.tables import number

ALIKE = 0.05
"""How far from 1 a ratio of efforts is worth no word [1]."""


def answer(result: ExperimentResult) -> Markup:
    """Return the answer as HTML, names in bold.

    Args:
        result: The run; controllers without metrics failed.
    """
    if told := impossible(result):
        return Markup(" ").join([told, *_failures(result)])
    sentences = [
        *_following(result),
        *_chattering(result),
        *_chattering_too(result),
        *_costs(result),
        *_failures(result),
    ]
    return Markup(" ").join(sentences)


def impossible(result: ExperimentResult) -> Markup:
    """Return that the arm cannot do the motion; nothing where it can.

    It cannot where the run remarks that the reference needs more torque than the arm has, and the law that follows
    best has a joint at its limit for `SATURATED` of the time or longer.
    """
    errors = values_of(result, "rmse")
    if not errors or not any(flag.startswith(TOO_MUCH) for flag in result.flags):
        return Markup("")
    shares = [share or 0.0 for share in result.metrics[next(iter(errors))]["saturation_fraction"].per_joint]
    n, most = sum(share >= SATURATED for share in shares), 100.0 * max(shares)
    if not n:
        return Markup("")
    at = f"{n} joints are at their torque limit, up to" if n > 1 else "one joint is at its torque limit"
    best = "even with the law that errs least" if len(errors) > 1 else ""
    return Markup("<b>The motion cannot be done</b>: {} {:.3g} % of the time{}.").format(
        at, most, f" {best}; no law is better here" if best else ""
    )


def values_of(result: ExperimentResult, key: str) -> dict[str, float]:
    """Return the stored headline of a metric for each controller that has one, the best first.

    Args:
        result: The run.
        key: The metric.
    """
    found = {name: metrics[key].value for name, metrics in result.metrics.items()}
    known = {name: value for name, value in found.items() if value is not None}
    return dict(sorted(known.items(), key=lambda item: item[1]))


def _bold(names: Sequence[str]) -> Markup:
    parts = [Markup("<b>{}</b>").format(name) for name in names]
    return Markup(" and ").join([Markup(", ").join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def times(a: float, b: float) -> str:
    """Return `a` over `b` in words: so many times, or a share of it in %."""
    ratio = a / b if b > 0.0 else float("inf")
    if ratio == float("inf"):
        return "many times"
    if ratio < 0.995:
        return f"{100.0 * ratio:.2g} % of"
    if ratio < 1.095:
        return f"{ratio:.2f} times"
    return f"{ratio:.2g} times" if ratio < 9.95 else f"{float(f'{ratio:.3g}'):,.0f} times"


def _alike(a: float, b: float) -> bool:
    """Whether `a` over `b` is within `ALIKE` of 1."""
    return abs(a - b) <= ALIKE * b


def _following(result: ExperimentResult) -> list[Markup]:
    errors, info = values_of(result, "rmse"), METRICS["rmse"]
    if not errors:
        return []
    unit, names = joint_units(info.shown_unit, result.slides), list(errors)
    best, worst = names[0], names[-1]
    text = Markup("{} {}: RMS error {} {}").format(
        _bold([best]), "follows best" if len(names) > 1 else "follows", number(errors[best], info.scale), unit
    )
    if len(names) > 1:
        text += Markup("; {} worst, {} {}.").format(_bold([worst]), number(errors[worst], info.scale), unit)
        return [text]
    return [text + "."]


def _chattering(result: ExperimentResult) -> list[Markup]:
    values = values_of(result, "chattering")
    if not values:
        return []
    names, limit = list(values), "of the torque limit"
    quiet = [name for name in names if is_still(values[name])]
    loud = Markup("{} {} ({} % {})").format(
        _bold(names[-1:]), "chatters most" if len(names) > 1 else "chatters", number(values[names[-1]]), limit
    )
    if len(quiet) == len(names):
        who = "None chatters" if len(names) > 1 else "It does not chatter"
        return [Markup("{}: at most {} % {}.").format(who, number(values[names[-1]]), limit)]
    if quiet:
        who = _bold(quiet) if len(quiet) <= 4 else Markup("{} of {}").format(len(quiet), len(names))
        verb = "does not chatter" if len(quiet) == 1 else "do not chatter"
        return [Markup("{} {} (below {:g} %), {}.").format(who, verb, STILL, loud)]
    if len(names) == 1:
        return [loud + "."]
    return [Markup("{} chatters least ({} %), {}.").format(_bold(names[:1]), number(values[names[0]]), loud)]


def _chattering_too(result: ExperimentResult) -> list[Markup]:
    """Return who else chatters, where more than four that do not are only counted, and at most three are left."""
    values = values_of(result, "chattering")
    loud = [name for name in values if not is_still(values[name])]
    others = [name for name in loud if number(values[name]) != number(values[loud[-1]])]
    if len(values) - len(loud) <= 4 or not 1 <= len(others) <= 3:
        return []
    return [Markup("{} {} too.").format(_bold(others), "chatters" if len(others) == 1 else "chatter")]


def _costs(result: ExperimentResult) -> list[Markup]:
    """Return what the best in error pays in chattering and torque, and what the calmest pays in error."""
    errors, chattering, effort = (values_of(result, key) for key in ("rmse", "chattering", "effort"))
    if len(errors) < 2 or set(errors) != set(chattering) or set(errors) != set(effort):
        return []
    best, calm, weak = (next(iter(values)) for values in (errors, chattering, effort))
    if is_still(chattering[best]) or best == calm:
        other = list(effort)[-1] if best != list(effort)[-1] else weak
        if _alike(effort[best], effort[other]):
            return []
        return [
            Markup("{} takes {} the torque effort of {}.").format(
                _bold([best]), times(effort[best], effort[other]), _bold([other])
            )
        ]
    paid = f"{times(chattering[best], chattering[calm])} the chattering"
    if not _alike(effort[best], effort[calm]):
        paid += f" and {times(effort[best], effort[calm])} the torque effort"
    return [
        Markup("Following best costs {} of {}, which has {} the error.").format(
            paid,
            _bold([calm]),
            times(errors[calm], errors[best]),
        )
    ]


def _failures(result: ExperimentResult) -> list[Markup]:
    return [
        Markup('<span class="fails">{} failed: {}{}.</span>').format(
            _bold([name]), run.ending, "" if name in result.unexpected else ", as expected"
        )
        for name, run in result.runs.items()
        if not run.completed
    ]
