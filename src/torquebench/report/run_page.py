"""The page of one run: film, result, certificates, figures, what was asked, software and machine."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence

from torquebench.experiment.dump import dump_experiment, plain
from torquebench.experiment.run import ExperimentResult
from torquebench.report.figures.declare import figure_title
from torquebench.report.render import Picture, render
from torquebench.report.tables import by_joint, certificate_rows, gain_rows, headline_table
from torquebench.sweep.plan import flattened


def run_page(result: ExperimentResult, figures: Mapping[str, bytes], film: bytes | None = None) -> bytes:
    """Return the page of one run; the same arguments give the same bytes.

    Args:
        result: The run.
        figures: File name without its ending -> SVG document, in order.
        film: An MP4, or None.
    """
    experiment = result.experiment
    header, rows = headline_table(result)
    unexpected = result.unexpected
    first, _, second = result.conditions.partition("\n")
    asked = [("experiment", experiment.name)]
    if experiment.description:
        asked.append(("what for", experiment.description))
    asked += [("what was run", first), ("under which conditions", second)]
    return render(
        "run",
        title=experiment.name,
        lead=experiment.description or first,
        columns=header[3:],
        rows=[
            {
                "name": row[0],
                "law": row[1],
                "outcome": row[2],
                "cells": row[3:],
                "expected": row[0] not in unexpected,
                "detail": result.runs[row[0]].detail,
            }
            for row in rows
        ],
        per_joint=by_joint(result),
        joints=result.joints.names,
        certificates=certificate_rows(result),
        flags=[*result.flags, *changed_arm(result)],
        asked=asked,
        gains=gain_rows(result),
        config=dump_experiment(experiment),
        facts=json.dumps(result.facts, indent=2),
        video=None if film is None else base64.b64encode(film).decode(),
        figures=[Picture(figure_title(name), svg) for name, svg in figures.items()],
    )


def changed_arm(result: ExperimentResult) -> list[str]:
    """Return a line where the files of the arm are no longer those of the run."""
    model = result.experiment.plant.model
    if not result.arm_changed:
        return []
    return [f"the files of the arm '{model}' have changed since the run: all figures are those of the arm as it was"]


def comparison_page(results: Mapping[str, ExperimentResult], figures: Sequence[Picture]) -> bytes:
    """Return a page with several runs side by side, and the keys in which their experiments differ.

    Args:
        results: Name of a run, such as its folder's -> the run.
        figures: Figures to show, in order.
    """
    titles: list[str] = []
    tables = {name: headline_table(result) for name, result in results.items()}
    for header, _ in tables.values():
        titles += [title for title in header[3:] if title not in titles]
    rows = []
    for name, (header, own) in tables.items():
        for row in own:
            cells = dict(zip(header[3:], row[3:], strict=True))
            rows.append(
                {
                    "run": name,
                    "name": row[0],
                    "outcome": row[2],
                    "cells": [cells.get(title, "-") for title in titles],
                    "expected": row[0] not in results[name].unexpected,
                }
            )
    return render(
        "comparison",
        figures=list(figures),
        title=" against ".join(results),
        lead="Runs of different experiments are comparable where their keys are the same.",
        columns=titles,
        rows=rows,
        runs=list(results),
        changed=[f"{name}: {line}" for name, result in results.items() for line in changed_arm(result)],
        differences=differences({name: flat(result) for name, result in results.items()}),
    )


def flat(result: ExperimentResult) -> dict[str, str]:
    """Return every key of a run's experiment with its value, as text; controllers by name."""
    return {key: json.dumps(value) for key, value in flattened(plain(result.experiment))}


def differences(configs: Mapping[str, Mapping[str, str]]) -> list[list[str]]:
    """Return a row for each key whose value is not the same in all configs: the key, and each config's value.

    Args:
        configs: Name of a run -> its keys and values.
    """
    keys = dict.fromkeys(key for config in configs.values() for key in config)
    rows = [[key, *(config.get(key, "-") for config in configs.values())] for key in keys]
    return [row for row in rows if len(set(row[1:])) > 1]
