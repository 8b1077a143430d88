"""The page of one run: the answer, controllers beside each other, signals and arm over time, what was run."""

from __future__ import annotations

import base64
import inspect
import json
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from torquebench.experiment.dump import dump_experiment
from torquebench.experiment.reference import joint_units
from torquebench.experiment.run import ExperimentResult
from torquebench.kernel import is_foreign
from torquebench.laws import find_law
from torquebench.metrics import METRICS, MetricInfo
from torquebench.metrics.chattering import STILL
from torquebench.metrics.shaking import shaking
from torquebench.report.answer import answer, impossible
from torquebench.report.looks import looks
from torquebench.report.render import THREE, UPLOT, render
from torquebench.report.replay import replay_data
from torquebench.report.scatter import Point, scatter
from torquebench.report.tables import (
    by_joint,
    gain_table,
    heading,
    headline_columns,
    number,
    outcome_text,
    uncovered,
    without_common_words,
)
from torquebench.robot.flat_model import force_unit
from torquebench.robot.library import ArmFile, scene_path

SIGNALS = ("error", "torque", "position", "sliding", "deflection")
"""Signals that a page may show; of the last two those that some run has."""

MORE = ("hf", "total_variation")
"""Metrics whose columns are shown when they are asked for: few ask, and they make the table wider than a screen."""
TOLD = ("chattering", "chattering_peak", "limit_cycle", "effort", *MORE)
"""Metrics that a line under the table explains; of the others the title of the column tells enough."""


class Title(NamedTuple):
    """The title of a metric's column, and what it means."""

    text: str
    name: str
    """The metric's name, in full."""
    meaning: str
    more: bool
    """Whether it is one of `MORE`."""
    told: bool
    """Whether it is one of `TOLD`."""

    @classmethod
    def of(cls, info: MetricInfo, slides: bool, corner: float) -> Title:
        """Return the title of a metric of the joints that slide, or that turn; `corner` is f_c [Hz]."""
        meaning = info.meaning.removesuffix(", see below").replace("f_c", f"{corner:g} Hz")
        return cls(heading(info, (slides,)), info.title, meaning, info.key in MORE, info.key in TOLD)


class Cell(NamedTuple):
    """A number of a table, with what it is sorted by and told under the pointer."""

    text: str
    value: float | None
    kind: str = ""


def run_page(result: ExperimentResult, film: bytes | None = None, figures: Sequence[str] = ()) -> bytes:
    """Return the page of one run; the same arguments give the same bytes.

    Args:
        result: The run.
        film: An MP4, or None.
        figures: Names of figures' files in the run's folder, which the page links.
    """
    experiment = result.experiment
    first, _, second = result.conditions.partition("\n")
    colours = {name: look.colour for name, look in looks(experiment.laws).items()}
    rows = controller_rows(result)
    data, order = replay_data(result, colours), [row["name"] for row in rows]
    data["controllers"].sort(key=lambda shown: order.index(shown["name"]))
    shaky = {name for name, metrics in result.metrics.items() if shaking(metrics, result.joints.tau_max)}
    all_shake, cannot = shaky.issuperset(name for name, run in result.runs.items() if run.completed), impossible(result)
    return render(
        "run",
        scripts=[UPLOT, THREE, "page", "run"],
        data=data,
        every=data["every"],
        of_tool=data["path_from"] is not None,
        signals=[key for key in SIGNALS if key == "position" or any(shown[key] for shown in data["controllers"])],
        title=experiment.name,
        lead=experiment.description or first,
        answer=answer(result),
        ranked=not cannot,
        none_well=all_shake or bool(cannot),
        result=result,
        titles=[Title.of(info, slides, experiment.chattering_from_hz) for info, slides, _ in page_columns(result)],
        rows=rows,
        same=all(row["name"] == row["law"] for row in rows),
        failed=any(not run.completed for run in result.runs.values()) or bool(result.unexpected),
        colours=colours,
        scatter=scatter_of(result, colours),
        heat=heat_rows(result),
        joints=result.joints.names,
        short=without_common_words(result.joints.names),
        unit=joint_units(METRICS["rmse"].shown_unit, result.slides),
        by_joint=by_joint(result),
        certificates=sorted(certificate_words(result), key=lambda found: order.index(found[0])),
        uncertified=[name for name in order if name in result.metrics and name not in result.certified],
        flags=[*result.flags, *changed_arm(result)],
        uncovered=uncovered(result),
        drawn_as=drawn_as(experiment.plant.model),
        conditions=[first, second],
        gains=gain_table(result),
        config=dump_experiment(experiment),
        facts=json.dumps(result.facts, indent=2),
        video=None if film is None else base64.b64encode(film).decode(),
        telling=(data["joint"], data["joint_why"]),
        drawn={
            name: [path for path in figures if PurePosixPath(path).stem == name]
            for name in dict.fromkeys(PurePosixPath(path).stem for path in figures)
        },
        commands={
            "run it again": "torquebench run RUN/experiment.yaml" + plugin_flags(experiment.laws.values()),
            "this page, playing": "torquebench view RUN",
            "a film of it": "torquebench video RUN",
            "figures for print": "torquebench figures RUN",
        }
        | ({"why it shakes": "torquebench why RUN"} if shaky else {}),
    )


def page_columns(result: ExperimentResult) -> list[tuple[MetricInfo, bool, dict[str, float | None]]]:
    """Return the columns of the table of controllers: error and chattering first, which a phone has room for."""
    return sorted(headline_columns(result), key=lambda column: column[0].key not in ("rmse", "chattering"))


def controller_rows(result: ExperimentResult) -> list[dict[str, Any]]:
    """Return a row for each controller with its headline metrics, by error; failed ones come last.

    The best of each column is marked, unless the arm cannot do the motion.
    """
    names = [keys.name for keys in result.experiment.controllers]
    columns, none_best = [], bool(impossible(result))
    for info, _, values in page_columns(result):
        known = [values[name] for name in names]
        cells = number_cells([None if x is None else x * info.scale for x in known])
        some = [x for x in known if x is not None]
        best = {
            cell.text
            for cell, x in zip(cells, known, strict=True)
            if some and x == (min if info.better == "lower" else max)(some)
        }
        ranked = (
            info.unit != "Hz"
            and not none_best
            and len({cell.text for cell, x in zip(cells, known, strict=True) if x is not None}) > 1
        )
        columns.append([cell._replace(kind="best" if ranked and cell.text in best else "") for cell in cells])
    rows = [
        {
            "name": keys.name,
            "law": keys.law,
            "outcome": outcome_text(result, keys.name),
            "bad": keys.name in result.unexpected,
            "cells": [column[i] for column in columns],
        }
        for i, keys in enumerate(result.experiment.controllers)
    ]
    return sorted(rows, key=lambda row: math.inf if row["cells"][0].value is None else row["cells"][0].value)


def number_cells(values: Sequence[float | None]) -> list[Cell]:
    """Return numbers of a column, as shown in its unit, with four digits; None gives a dash."""
    return [Cell(number(x), x) for x in values]


def scatter_of(result: ExperimentResult, colours: Mapping[str, str]) -> str:
    """Return error against chattering of the controllers that have both.

    Args:
        result: The run.
        colours: Colour of each controller.
    """
    error, chattering = METRICS["rmse"], METRICS["chattering"]
    points = [
        Point(name, x * chattering.scale, y * error.scale, colours[name])
        for name, metrics in result.metrics.items()
        for x, y in [(metrics["chattering"].value, metrics["rmse"].value)]
        if x is not None and y is not None
    ]
    unit = joint_units(error.shown_unit, result.slides)
    return scatter(points, "chattering [% of the torque limit]", f"RMS error [{unit}]", (STILL, "does not chatter"))


def heat_rows(result: ExperimentResult) -> list[dict[str, Any]]:
    """Return a row for each controller with metrics: each joint's RMS error and its heat, 0 to 1.

    Heat is the logarithm of the error over the least one of any controller in that joint, over the largest such; beside
    an error of 0 any other is hottest.
    """
    info, table = METRICS["rmse"], {name: metrics["rmse"].per_joint for name, metrics in result.metrics.items()}
    if not table:
        return []
    columns = list(zip(*table.values(), strict=True))
    least = [min((x for x in column if x is not None), default=0.0) for column in columns]
    ratios = {
        name: [(math.log(x / low) if low else math.inf) if x else 0.0 for x, low in zip(row, least, strict=True)]
        for name, row in table.items()
    }
    largest = max((x for row in ratios.values() for x in row if x < math.inf), default=0.0) or 1.0
    order = sorted(table, key=lambda name: result.metrics[name]["rmse"].value or 0.0)
    return [
        {
            "name": name,
            "cells": [
                (
                    _short(x, info.scale),
                    x,
                    round(min(ratio / largest, 1.0), 3),
                    f"{math.exp(ratio):.3g} times the least" if ratio < math.inf else "the least is 0",
                )
                for x, ratio in zip(table[name], ratios[name], strict=True)
            ],
        }
        for name in order
    ]


def _short(value: float | None, scale: float) -> str:
    return "-" if value is None else f"{value * scale:.3g}"


def certificate_words(result: ExperimentResult) -> list[tuple[str, list[tuple[bool, str]]]]:
    """Return for each controller with certificates what they say of K, s and V: whether that is good, and in words."""
    found = []
    for name, facts in result.certified.items():
        worst, outside = facts["worst_margin"], facts["share_outside"]
        joint, force = result.joints.names[worst["joint"] - 1], force_unit(result.slides[worst["joint"] - 1])
        enough, where = worst["value"] >= 0.0, f"{joint}, t = {worst['t']:.4g} s"
        gain = f"{'large enough, by' if enough else 'too small, by'} {number(abs(worst['value']))} {force} ({where})"
        set_point = facts.get("set_point")
        after = f"; V of (142): {set_point['says']}" if set_point else ""
        if len(facts.get("too_wide", ())) == len(result.joints.names):
            found.append((name, [(enough, gain), (False, "so wide that it covers nothing"), (False, "nothing shown")]))
            continue
        if not outside:
            found.append((name, [(enough, gain), (True, "never outside"), (True, f"nothing to certify{after}")]))
            continue
        time, bound, rising = facts["reaching_time"], facts["reaching_bound"], facts["share_rising_outside"]
        bounded = facts.get("no_bound") or ("none" if bound is None else f"{number(bound)} s")
        reached = "not reached" if time is None else f"reached after {number(time)} s"
        layer = f"{reached} (bound: {bounded}); outside {number(outside, 100.0)} % of the time"
        falls = (
            f"grew in {number(rising, 100.0)} % of the instants outside" if rising else "fell at every instant outside"
        )
        found.append((name, [(enough, gain), (time is not None, layer), (not rising, falls + after)]))
    return found


def drawn_as(model: str | ArmFile) -> str:
    """Return that an arm is not drawn with its own looks, and how it would be; nothing where it is."""
    if not isinstance(model, ArmFile) or scene_path(model) is not None:
        return ""
    return "links are drawn as capsules: torquebench import keeps an arm's meshes for pictures"


def plugin_flags(laws: Iterable[str]) -> str:
    """Return the options that load the files of users' laws."""
    users = [find_law(name).function for name in laws if is_foreign(find_law(name).function)]
    files = dict.fromkeys(inspect.getsourcefile(inspect.unwrap(function)) for function in users)
    return "".join(f" --plugin {shlex.quote(file)}" for file in files if file)


def changed_arm(result: ExperimentResult) -> list[str]:
    """Return a line where the files of the arm are no longer those of the run."""
    model = result.experiment.plant.model
    if not result.arm_changed:
        return []
    return [f"the files of the arm '{model}' have changed since the run: all figures are those of the arm as it was"]
