"""The page of one run: film, result, certificates, what was asked, software and machine."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence

from torquebench.experiment.dump import dump_experiment, plain
from torquebench.experiment.run import ExperimentResult
from torquebench.report.render import Picture, render
from torquebench.report.tables import by_joint, certificate_table, gain_table, headline_table
from torquebench.sweep.plan import flattened


def run_page(result: ExperimentResult, film: bytes | None = None) -> bytes:
    """Return the page of one run; the same arguments give the same bytes.

    Args:
        result: The run.
        film: An MP4, or None.
    """
    experiment = result.experiment
    what_for = {"what for": experiment.description} if experiment.description else {}
    first, _, second = result.conditions.partition("\n")
    return render(
        "run",
        title=experiment.name,
        lead=experiment.description or first,
        result=result,
        headlines=headline_table(result),
        bad=[place for place, keys in enumerate(experiment.controllers) if keys.name in result.unexpected],
        by_joint=by_joint(result),
        certificates=certificate_table(result),
        flags=[*result.flags, *changed_arm(result)],
        asked={"experiment": experiment.name} | what_for | {"what was run": first, "under which conditions": second},
        gains=gain_table(result),
        config=dump_experiment(experiment),
        facts=json.dumps(result.facts, indent=2),
        video=None if film is None else base64.b64encode(film).decode(),
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
    tables = {name: headline_table(result) for name, result in results.items()}
    titles = list(dict.fromkeys(title for header, _ in tables.values() for title in header[3:]))
    rows: list[list[str]] = []
    bad = []
    for name, (header, own) in tables.items():
        for row in own:
            if row[0] in results[name].unexpected:
                bad.append(len(rows))
            cells = dict(zip(header, row, strict=True))
            rows.append([name, row[0], row[2], *(cells.get(title, "-") for title in titles)])
    keys = {
        name: {key: json.dumps(value) for key, value in flattened(plain(result.experiment))}
        for name, result in results.items()
    }
    return render(
        "comparison",
        figures=figures,
        title=" against ".join(results),
        lead="Runs of different experiments are comparable where their keys are the same.",
        headlines=(["run", "controller", "outcome", *titles], rows),
        bad=bad,
        changed=[f"{name}: {line}" for name, result in results.items() for line in changed_arm(result)],
        differences=(["key", *results], differences(keys)),
    )


def differences(configs: Mapping[str, Mapping[str, str]]) -> list[list[str]]:
    """Return a row for each key whose value is not the same in all configs: the key, and each config's value.

    Args:
        configs: Name of a run -> its keys and values.
    """
    keys = dict.fromkeys(key for config in configs.values() for key in config)
    rows = [[key, *(config.get(key, "-") for config in configs.values())] for key in keys]
    return [row for row in rows if len(set(row[1:])) > 1]
