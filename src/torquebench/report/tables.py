"""The tables of a run, as text: headline metrics, every metric by joint, certificates, gains with their units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from torquebench.certificates import Certificate
from torquebench.experiment.reference import joint_units
from torquebench.experiment.run import ExperimentResult
from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.metrics import Metric, MetricInfo

ERRORS: dict[str, tuple[str, Callable[[Array], np.floating[Any]]]] = {
    "rmse": ("RMSE", lambda errors: np.sqrt(np.mean(np.square(errors)))),
    "max_error": ("max", np.max),
    "steady_state_error": ("steady", np.max),
}
"""Headline metrics in rad, or in m of joints that slide: title, and how the joints of one kind make one number."""
COLUMNS = {
    "hf": ("HF [%]", 1.0),
    "total_variation": ("TV [1/s]", 1.0),
    "effort": ("effort", 1.0),
    "saturation_fraction": ("saturated [%]", 100.0),
}
"""The other headline metrics: title with unit, and by how much the SI value is multiplied."""
STEP_COLUMNS = {"rise_time": ("rise [s]", 1.0), "overshoot": ("over [%]", 1.0), "settling_time": ("settle [s]", 1.0)}
"""Those that only a step has."""


def headlines(slides: Sequence[bool], steps: bool = False) -> dict[str, tuple[str, float]]:
    """Return title with unit and scale of each headline metric whose joints make one number together.

    Args:
        slides: Of each joint, whether it slides; where only some do, an error is in thousandths of rad and m alike.
        steps: Whether to have those that only a step has.
    """
    errors = {key: (f"{title} [{joint_units('mrad', slides)}]", 1e3) for key, (title, _) in ERRORS.items()}
    return errors | COLUMNS | (STEP_COLUMNS if steps else {})


def outcome_text(result: ExperimentResult, name: str) -> str:
    """Return how a run ended, with the time of a failure.

    Args:
        result: The experiment's runs.
        name: The controller.
    """
    return result.runs[name].ending or "completed"


def headline_table(result: ExperimentResult) -> tuple[list[str], list[list[str]]]:
    """Return the header and a row for each controller: name, law, outcome, headline metrics.

    Errors have a column in mrad for the joints that turn, and one in mm for those that slide.
    """
    step = result.experiment.reference.kind in ("step", "quintic")
    columns = COLUMNS | (STEP_COLUMNS if step else {})
    units = {"mm" if slides else "mrad": slides for slides in sorted(set(result.slides))}
    rows = []
    for keys in result.experiment.controllers:
        cells = [keys.name, keys.law, outcome_text(result, keys.name)]
        metrics = result.metrics.get(keys.name)
        for key, (_, reduce) in ERRORS.items():
            for slides in units.values():
                value = None if metrics is None else _of_kind(getattr(metrics, key), result.slides, slides, reduce)
                cells.append(number(value, 1e3))
        for key, (_, scale) in columns.items():
            cells.append("-" if metrics is None else number(getattr(metrics, key).value, scale))
        rows.append(cells)
    errors = [f"{title} [{unit}]" for title, _ in ERRORS.values() for unit in units]
    return ["controller", "law", "outcome", *errors, *(title for title, _ in columns.values())], rows


def _of_kind(
    metric: Metric, kinds: Sequence[bool], slides: bool, reduce: Callable[[Array], np.floating[Any]]
) -> float | None:
    """Return one number for the joints that slide, or for those that turn; None where one of them has none."""
    if all(kind == slides for kind in kinds):
        return metric.value
    own = [value for value, kind in zip(metric.per_joint, kinds, strict=True) if kind == slides]
    known = [value for value in own if value is not None]
    return float(reduce(np.array(known))) if len(known) == len(own) else None


def number(value: float | None, scale: float = 1.0) -> str:
    """Return a figure as text, a dash where there is none.

    Args:
        value: The figure.
        scale: By how much it is multiplied.
    """
    return "-" if value is None else f"{value * scale:.4g}"


def by_joint(result: ExperimentResult) -> list[dict[str, Any]]:
    """Return, for each controller with metrics, its name and a line for each metric: headline and every joint."""
    found = []
    for name, metrics in result.metrics.items():
        lines = [
            {"title": info.title, **_value(info, metric, result.slides), "cells": _cells(metric)}
            for info, metric in metrics.items()
        ]
        found.append({"name": name, "lines": lines})
    return found


def _value(info: MetricInfo, metric: Metric, slides: Sequence[bool]) -> dict[str, str]:
    """Return unit and headline; joints that turn and joints that slide have no headline in common."""
    if not info.unit.startswith("rad") or not any(slides):
        return {"unit": info.unit, "value": number(metric.value)}
    unit = info.unit.replace("rad", "m")
    return (
        {"unit": unit, "value": number(metric.value)}
        if all(slides)
        else {
            "unit": f"{info.unit}, {unit} of slides",
            "value": "-",
        }
    )


def _cells(metric: Metric) -> list[str]:
    return [number(value) for value in metric.per_joint]


def certificate_rows(result: ExperimentResult, proofs: Mapping[str, Certificate]) -> list[list[str]]:
    """Return a row for each controller with certificates.

    Args:
        result: The experiment's runs.
        proofs: Controller name -> certificates.
    """
    rows = []
    for name, found in proofs.items():
        facts = found.to_json()
        worst = facts["worst_margin"]
        force = "N" if result.slides[worst["joint"] - 1] else "N m"
        where = f"{result.loop.joint_names[worst['joint'] - 1]}, t = {worst['t']:.4g} s"
        rows.append(
            [
                name,
                f"{number(worst['value'])} {force}",
                where,
                number(facts["reaching_time"]),
                number(facts["reaching_bound"]),
                number(facts["share_rising_outside"], 100.0),
            ]
        )
    return rows


def gain_rows(result: ExperimentResult) -> list[list[str]]:
    """Return a row for each choice and gain of each controller: controller, name, value, unit, meaning."""
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
    return rows
