"""The answer of a run in a few sentences: who follows best, who chatters, at what cost, who failed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

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
"""Largest distance from 1 of a ratio of efforts that is not worth a word [1]."""
FEW = 4
"""Names that a sentence lists; of more it says how many they are."""


def answer(result: ExperimentResult) -> Markup:
    """Return the answer as HTML, names in bold.

    Args:
        result: The run; controllers without metrics failed.
    """
    if told := impossible(result):
        return Markup(" ").join([told, *_failures(result)])
    chattering = [*_chattering(result), *_chattering_too(result)]
    return Markup(" ").join([*_following(result), *chattering, *_costs(result), *_failures(result)])


def impossible(result: ExperimentResult) -> Markup:
    """Return that the arm cannot do the motion, and for which joint; nothing where it can.

    It cannot where the run remarks that the reference needs more torque than the arm has, and the law that follows
    best has a joint at its limit for `SATURATED` of the time or longer.
    """
    errors = values_of(result, "rmse")
    remark = next((flag for flag in result.flags if flag.startswith(TOO_MUCH)), "")
    if not errors or not remark:
        return Markup("")
    shares = result.metrics[next(iter(errors))]["saturation_fraction"].per_joint
    if max(share or 0.0 for share in shares) < SATURATED:
        return Markup("")
    none = "; no law is better here" if len(errors) > 1 else ""
    return Markup("<b>The motion cannot be done</b>: {}{}.").format(remark, none)


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


def _some(names: Sequence[str], of: Collection[str]) -> Markup:
    """Return names, or how many they are of all where they are more than `FEW`."""
    return _bold(names) if len(names) <= FEW else Markup("{} of {}").format(len(names), len(of))


def _verb(word: str, names: Sequence[str]) -> str:
    return f"{word}s" if len(names) == 1 else word


def _ends(shown: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Return the names whose number reads as the first one's, and those whose number reads as the last one's."""
    numbers = [*shown.values()]
    first, last = ([name for name in shown if shown[name] == number] for number in (numbers[0], numbers[-1]))
    return first, last


def _all(shown: Mapping[str, str], result: ExperimentResult) -> str:
    return "All" if len(shown) == len(result.runs) else "All that completed"


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
    unit, shown = joint_units(info.shown_unit, result.slides), {x: number(y, info.scale) for x, y in errors.items()}
    best, worst = _ends(shown)
    if len(shown) == 1:
        return [Markup("{} follows: RMS error {} {}.").format(_bold(best), shown[best[0]], unit)]
    if best == worst:
        return [Markup("{} follow alike: RMS error {} {}.").format(_all(shown, result), shown[best[0]], unit)]
    return [
        Markup("{} {} best: RMS error {} {}; {} worst, {} {}.").format(
            _some(best, shown), _verb("follow", best), shown[best[0]], unit, _some(worst, shown), shown[worst[0]], unit
        )
    ]


def _chattering(result: ExperimentResult) -> list[Markup]:
    values = values_of(result, "chattering")
    if not values:
        return []
    names, limit = list(values), "of the torque limit"
    quiet = [name for name in names if is_still(values[name])]
    shown = {name: number(value) for name, value in values.items()}
    least, most = _ends(shown)
    loud = Markup("{} {}{} ({} % {})").format(
        _some(most, shown), _verb("chatter", most), " most" if len(names) > 1 else "", shown[names[-1]], limit
    )
    alone = _one_joint(result, quiet)
    if len(quiet) == len(names):
        who = "None chatters" if len(names) > 1 else "It does not chatter"
        return [Markup("{}: at most {} % {}.").format(who, shown[names[-1]], limit), *alone]
    if quiet:
        verb = "does not chatter" if len(quiet) == 1 else "do not chatter"
        return [Markup("{} {} (below {:g} %), {}.").format(_some(quiet, shown), verb, STILL, loud), *alone]
    if len(names) == 1:
        return [loud + "."]
    if least == most:
        return [Markup("{} chatter alike: {} % {}.").format(_all(shown, result), shown[names[0]], limit)]
    who, verb = _some(least, shown), _verb("chatter", least)
    return [Markup("{} {} least ({} %), {}.").format(who, verb, shown[names[0]], loud)]


def _one_joint(result: ExperimentResult, quiet: Sequence[str]) -> list[Markup]:
    """Return a sentence for each controller that is quiet in the mean of its joints and not in one of them."""
    lines = []
    for name in quiet:
        shares = [share or 0.0 for share in result.metrics[name]["chattering"].per_joint]
        if not is_still(most := max(shares)):
            joint = result.joints.names[shares.index(most)]
            lines.append(Markup("{} has {} % in {} alone.").format(_bold([name]), number(most), joint))
    return lines


def _chattering_too(result: ExperimentResult) -> list[Markup]:
    """Return who else chatters, where those that do not are only counted, and at most three are left."""
    values = values_of(result, "chattering")
    loud = [name for name in values if not is_still(values[name])]
    others = [name for name in loud if number(values[name]) != number(values[loud[-1]])]
    if len(values) - len(loud) <= FEW or not 1 <= len(others) <= 3:
        return []
    return [Markup("{} {} too.").format(_bold(others), _verb("chatter", others))]


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
