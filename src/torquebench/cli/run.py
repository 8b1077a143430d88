"""``torquebench run``: one experiment from its YAML file to numbers, a page and a manifest."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from torquebench.cli.app import command
from torquebench.cli.parameters import (
    Config,
    File,
    Number,
    allow_outside,
    argument,
    model,
    option,
    out_folder,
    plugins,
    refuse,
    settings,
    with_arm,
)
from torquebench.cli.terminal import bad, complain, following, good, progress_bar, say, table, tell, voice, warn
from torquebench.cli.why import hint
from torquebench.errors import Problem

if TYPE_CHECKING:
    from torquebench.experiment.run import ExperimentResult
    from torquebench.experiment.schema import Experiment


@command(example="torquebench run fig9-chattering --set run.duration=2")
@argument("config", type=Config(), required=False, help="experiment: a YAML file, or the name of a shipped one")
@option("--from-sweep", type=File(folders=True), metavar="DIR", help="run one row of a sweep again instead")
@option("--index", type=Number(int, 0), metavar="K", help="number of that row, from 0")
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@settings(help="change one key, for example run.duration=2 or controllers.band.gains.phi=0.1")
@model
@allow_outside
@plugins
@option("--no-figures", is_flag=True, help="draw nothing that the config asks for: no figures, no film")
@option("--show-config", is_flag=True, help="print the whole experiment, as experiment.yaml would hold it; run nothing")
@click.pass_obj
def run(
    gl: str | None,
    /,
    config: Path | None,
    from_sweep: Path | None,
    index: int | None,
    out: Path | None,
    overrides: Sequence[str],
    model: Path | None,
    allow_outside: bool,
    plugin: Sequence[Path],
    no_figures: bool,
    show_config: bool,
) -> int:
    """Run one experiment: every controller in it, side by side."""
    overrides = with_arm(overrides, model)
    _check_options(config, from_sweep, index, overrides)
    from torquebench.experiment import load_experiment
    from torquebench.experiment.build import build
    from torquebench.experiment.describe import chosen_text, fuzzy_facts, fuzzy_remarks
    from torquebench.experiment.dump import dump_tree, plain
    from torquebench.experiment.folder import write_experiment, write_trajectory
    from torquebench.experiment.run import foreseen, run_experiment
    from torquebench.experiment.store import RunDirectory, claim_folder
    from torquebench.laws.plugin import load_plugin
    from torquebench.metrics.shaking import shaking
    from torquebench.report.render import PAGE
    from torquebench.report.run import write_run
    from torquebench.robot.library import ArmFile

    for file in plugin:
        load_plugin(file)
    if config is not None:
        experiment = load_experiment(config, overrides, allow_outside)
    elif from_sweep is not None and index is not None:
        experiment = _row_of_sweep(from_sweep, index, plugin)
    if show_config:
        shown, arm = plain(experiment), experiment.plant.model
        if isinstance(arm, ArmFile) and arm.origin is not None:  # a run's folder has the arm beside it, this has not
            shown["plant"]["model"] = os.path.relpath(arm.origin)
        tell(experiment=shown)
        say(dump_tree(shown).rstrip("\n"), fold=False)
        return 0
    for line in chosen_text(experiment):
        say(line)
    loop = build(experiment)
    for flag in foreseen(experiment, loop):
        warn(f"torquebench: {flag}")
    directory = RunDirectory(claim_folder(out, experiment.name))
    write_experiment(directory, experiment)
    steps = experiment.n_steps * len(experiment.controllers)
    with progress_bar(steps, "step", "starting") as bar:
        result = run_experiment(
            experiment,
            loop,
            progress=following(bar, 50),
            finished=lambda name, trajectory: write_trajectory(directory, name, trajectory),
        )
    with progress_bar(0, "figure", "writing") as bar:
        write_run(directory, result, plugin, not no_figures, following(bar), os.cpu_count() or 1)
    certificates, fuzzy = result.certified, fuzzy_facts(experiment)
    tell(directory=directory.folder, **result.to_json(), certificates=certificates, fuzzy=fuzzy)
    say(outcome(result))
    say("\n".join(["", *fuzzy_remarks(experiment)]))
    say()
    say(f"results: {directory.folder}, page: {directory.folder / PAGE}")
    if not no_figures and experiment.video is not None:
        from torquebench.cli.video import film_of_run

        film_of_run(result, directory.folder, gl)
    if shaky := [name for name, metrics in result.metrics.items() if shaking(metrics, result.joints.tau_max)]:
        say(hint(directory.folder, shaky, len(result.runs)))
    for remark in (*result.out_of_range, *result.explained):
        warn(f"torquebench: {remark}")
    return _print_failures(result)


def _check_options(config: Path | None, from_sweep: Path | None, index: int | None, overrides: Sequence[str]) -> None:
    """Refuse arguments that do not go together."""
    if from_sweep is None:
        if config is None:
            refuse([Problem("CONFIG", text="missing", wanted="an experiment's file, or --from-sweep")])
        if index is not None:
            refuse([("--index", "has no effect without --from-sweep")])
    else:
        given = ["CONFIG"] * (config is not None) + ["--set"] * bool(overrides)
        problems = [Problem(name, text="has no effect with --from-sweep: a row is run as it was") for name in given]
        missing = Problem("--index", text="missing", wanted="the number of a row, from 0")
        refuse(problems + [missing] * (index is None))


def _row_of_sweep(folder: Path, index: int, plugin: Sequence[Path]) -> Experiment:
    """Return the experiment that a sweep's row is."""
    from torquebench.sweep.folder import open_sweep

    plan = open_sweep(folder, tuple(plugin), "--from-sweep").plan
    if index >= plan.rows:
        refuse([Problem("--index", got=str(index), wanted=f"0 to {plan.rows - 1}")])
    row = plan.row(index)
    numbers = [plan.drawn(random, row.draw) for random in plan.continuous]
    keys = [f"{key}={value.word}" for key, value in plan.assigned(row.case, plan.combination(row.draw), numbers)]
    name = plan.controllers[row.controller]
    say(f"row {index} of {folder}: {', '.join(keys) or 'no key varied'}; draw {row.draw}, controller {name}")
    return plan.experiment_of(row)


def _print_failures(result: ExperimentResult) -> int:
    """Say which runs were interpreted, and which ended otherwise than expected; return the exit status."""
    from torquebench.report.tables import outcome_text
    from torquebench.sim.native import QUICKER

    for path, reason in dict.fromkeys((run.path, run.path_reason) for run in result.runs.values()):
        if reason not in ("", QUICKER):
            warn(f"torquebench: interpreted, which is slower: {reason}")
        elif voice().verbose:
            warn(f"torquebench: {f'interpreted: {reason}' if reason else f'path {path}'}")
    for name in result.unexpected:
        detail = f" ({result.runs[name].detail})" if result.runs[name].detail else ""
        wanted = next(keys.expect for keys in result.experiment.controllers if keys.name == name)
        text = f"{outcome_text(result, name)}{detail}; the config expects: {wanted}"
        complain(f"torquebench: controller '{name}': {text}")
    return 1 if result.unexpected else 0


def outcome(result: ExperimentResult) -> str:
    """Return what came out: the table of headline metrics, the answer in sentences, certificates."""
    from torquebench.report.answer import answer
    from torquebench.report.tables import certificate_table, headline_table, uncovered

    header, rows = headline_table(result)
    ended = [bad(row[2]) if row[0] in result.unexpected else good(row[2]) for row in rows]
    cells = [[*row[:2], text, *row[3:]] for row, text in zip(rows, ended, strict=True)]
    certificates = [table(*certificate_table(result))] if result.certified else []
    parts = [table(header, cells), answer(result).striptags(), *certificates]
    parts += ["\n".join(lines)] if (lines := uncovered(result)) else []
    return "\n\n".join([f"{result.experiment.name}\n{result.conditions}", *parts])
