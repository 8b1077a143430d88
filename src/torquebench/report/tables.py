"""Tables of a run as text: headline metrics, every metric by joint, certificates, gains with their units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from torquebench.experiment.certify import takes_its_own
from torquebench.experiment.reference import joint_units
from torquebench.experiment.run import ExperimentResult
from torquebench.laws import find_law
from torquebench.metrics import Metric, MetricInfo, applicable
from torquebench.references.reference import depends_on_arm
from torquebench.robot.flat_model import force_unit

Cells: TypeAlias = tuple[list[str], list[list[str]]]
"""Header and rows of a table."""


def columns(steps: bool, tool: bool = False) -> list[MetricInfo]:
    """Return the metrics with a column in tables of headlines; those of the step response come last.

    Args:
        steps: Whether to include those.
        tool: Whether to include those of the tool.
    """
    shown = [info for info in applicable(tool) if info.column]
    return [info for info in shown if not info.steps_only] + [info for info in shown if steps and info.steps_only]


def heading(info: MetricInfo, slides: Sequence[bool]) -> str:
    """Return the title of a metric's column, with its unit.

    Args:
        info: The metric.
        slides: Of each joint, whether it slides; where only some do, an error is in thousandths of rad and m alike.
    """
    unit = joint_units(info.shown_unit, slides) if info.is_angle else info.shown_unit
    return info.column if unit == "1" else f"{info.column} [{unit}]"


def headlines(slides: Sequence[bool], steps: bool = False, tool: bool = False) -> dict[str, tuple[str, float]]:
    """Return title with unit, and scale, of each metric with a column, all joints making one number.

    Args:
        slides: Of each joint, whether it slides.
        steps: Whether to include those of the step response.
        tool: Whether to include those of the tool.
    """
    return {info.key: (heading(info, slides), info.scale) for info in columns(steps, tool)}


def outcome_text(result: ExperimentResult, name: str) -> str:
    """Return how a run ended, with the time of a failure.

    Args:
        result: The experiment's runs.
        name: The controller.
    """
    return result.runs[name].ending or "completed"


def headline_columns(result: ExperimentResult) -> list[tuple[MetricInfo, bool, dict[str, float | None]]]:
    """Return the columns of a table of headlines: metric, whether of joints that slide, each controller's value.

    Errors have a column in mrad for the joints that turn, and one in mm for those that slide.
    """
    both, reference = sorted(set(result.slides)), result.experiment.reference
    return [
        (
            info,
            slides,
            {
                keys.name: joined(info, result.metrics[keys.name][info.key], result.slides, slides)
                if keys.name in result.metrics
                else None
                for keys in result.experiment.controllers
            },
        )
        for info in columns(reference.is_step_like, depends_on_arm(reference))
        for slides in (both if info.is_angle else both[:1])
    ]


def headline_table(result: ExperimentResult) -> Cells:
    """Return a row for each controller: name, law, outcome, headline metrics."""
    shown = headline_columns(result)
    rows = [
        [
            keys.name,
            keys.law,
            outcome_text(result, keys.name),
            *(number(values[keys.name], info.scale) for info, _, values in shown),
        ]
        for keys in result.experiment.controllers
    ]
    return ["controller", "law", "outcome", *(heading(info, (slides,)) for info, slides, _ in shown)], rows


def joined(info: MetricInfo, metric: Metric, kinds: Sequence[bool], slides: bool) -> float | None:
    """Return the headline of the joints that slide, or of those that turn; None where one of them has no value.

    Args:
        info: The metric; one that is no angle has one headline of all joints.
        metric: Its values.
        kinds: Of each joint, whether it slides.
        slides: Which joints.
    """
    if not info.is_angle or all(kind == slides for kind in kinds):
        return metric.value
    own = [value for value, kind in zip(metric.per_joint, kinds, strict=True) if kind == slides]
    known = [value for value in own if value is not None]
    return info.over(np.array(known)) if len(known) == len(own) else None


def number(value: float | None, scale: float = 1.0) -> str:
    """Format a number; a dash for none.

    Args:
        value: The number.
        scale: By how much it is multiplied.
    """
    return "-" if value is None else f"{value * scale:.4g}"


def by_joint(result: ExperimentResult) -> dict[str, Cells]:
    """Return a table for each controller with metrics: a row for each metric with its headline and every joint."""
    header = ["metric", "unit", "headline", *result.joints.names]
    return {
        name: (header, [joint_row(info, metric, result.slides) for info, metric in metrics.items()])
        for name, metrics in result.metrics.items()
    }


def joint_row(info: MetricInfo, metric: Metric, slides: Sequence[bool]) -> list[str]:
    """Return title, unit, headline and every joint of a metric.

    Joints that turn and joints that slide have no headline in common.

    Args:
        info: The metric.
        metric: Its values.
        slides: Of each joint, whether it slides.
    """
    unit = joint_units(info.unit, slides) if info.is_angle else info.unit
    value = None if info.is_angle and len(set(slides)) > 1 else metric.value
    each = [number(one) for one in metric.per_joint] or [""] * len(slides)
    return [info.title, unit, number(value), *each]


def certificate_table(result: ExperimentResult) -> Cells:
    """Return a row for each controller with certificates: worst margin of K, reaching time, where V grew."""
    rows = []
    for name, facts in result.certified.items():
        worst = facts["worst_margin"]
        joint, force = result.joints.names[worst["joint"] - 1], force_unit(result.slides[worst["joint"] - 1])
        vacuous, set_point = facts.get("vacuous", not facts["share_outside"]), facts.get("set_point")
        rows.append(
            [
                name,
                f"{number(worst['value'])} {force}",
                f"{joint}, t = {worst['t']:.4g} s",
                "vacuous" if vacuous else number(facts["reaching_time"]),
                facts.get("no_bound") or number(facts["reaching_bound"]),
                number(facts["share_outside"], 100.0),
                "vacuous" if vacuous else number(facts["share_rising_outside"], 100.0),
                set_point["says"] if set_point else "-",
            ]
        )
    header = ["certificate of", "least K - (123)", "where", "reaching time [s]", "bound [s]", "outside the layer [%]"]
    return [*header, "V grew there [%]", "V of (142)"], rows


def uncovered(result: ExperimentResult) -> list[str]:
    """Return a line for each controller without a certificate as its law takes from the model what no option says.

    And one for each joint of which a certificate shows nothing, its layer being too wide.
    """
    lines = [
        f"no certificate of '{keys.name}': what K must exceed depends on what {keys.law} takes from the model by itself"
        for keys in result.experiment.controllers
        if keys.name not in result.certified and takes_its_own(keys)
    ]
    for name, facts in result.certified.items():
        for one in facts.get("too_wide", ()):
            joint = one["joint"] - 1
            speed, angle = ("m/s", "m") if result.slides[joint] else ("rad/s", "rad")
            wide = f"{number(one['layer'])} {speed}"
            wide += "" if one["phi"] is None else f", {one['layer'] / one['phi']:.3g} phi,"
            lines.append(
                f"certificate of '{name}' shows nothing of {result.joints.names[joint]}: K moves s by {wide} "
                f"before the loop answers, an error of {number(one['error'])} {angle} that counts as inside the layer"
            )
    return lines


def without_common_words(names: Sequence[str]) -> list[str]:
    """Return names of joints without the words that all begin or end with: ``r_elbow_joint`` beside others is elbow.

    Words end at ``_``, ``:``, ``/``, ``.`` or ``-``; something that begins with a letter stays of each name.
    """
    shorter = [re.findall(r"[^_:/.-]+|[_:/.-]+", name) for name in names]  # words, and what parts them, by turns
    for end, rest in ((slice(2), slice(2, None)), (slice(-2, None), slice(-2))):
        while len(names) > 1 == len({tuple(words[end]) for words in shorter}) and all(
            len(words) > 2 and words[rest][0][0].isalpha() for words in shorter
        ):
            shorter = [words[rest] for words in shorter]
    return ["".join(words) for words in shorter]


def gain_table(result: ExperimentResult) -> Cells:
    """Return a row for each option and gain of each controller: controller, name, value, unit, meaning."""
    rows = []
    for keys in result.experiment.controllers:
        law = find_law(keys.law)
        rows += [
            [keys.name, name, str(keys.options.get(name, option.values[0])).lower(), "", option.meaning]
            for name, option in law.options.items()
        ]
        for name, value in keys.gains.items():
            gain = law.gains[name]
            text = " ".join(f"{x:g}" for x in value) if isinstance(value, tuple) else f"{value:g}"
            rows.append([keys.name, name, text, gain.unit, gain.meaning])
        if keys.fuzzy is not None:
            rows.append([keys.name, "fuzzy", keys.fuzzy, "", "fuzzy system"])
    return ["controller", "gain or choice", "value", "unit", "meaning"], rows
