"""``torquebench run``: one experiment from its YAML file to numbers, figures and a manifest."""

from __future__ import annotations

import argparse

from torquebench.cli.colour import bad, good
from torquebench.cli.terminal import complain, following, progress_bar, say, table, tell, warn
from torquebench.errors import ConfigError, Problem
from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.certify import flags
from torquebench.experiment.describe import fuzzy_facts, fuzzy_remarks
from torquebench.experiment.folder import write_experiment, write_trajectory
from torquebench.experiment.run import ExperimentResult, run_experiment
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import RunDirectory, claim_folder
from torquebench.laws.plugin import load_plugin
from torquebench.report.run import certificate_lines, write_run
from torquebench.report.tables import headline_table, outcome_text


def run(options: argparse.Namespace) -> int:
    """Run an experiment and return the exit status.

    Args:
        options: Arguments of the command; see ``torquebench run --help``.

    Raises:
        ConfigError: bad input; nothing has been written.
    """
    for plugin in options.plugin:
        load_plugin(plugin)
    experiment = chosen(options)
    loop = build(experiment)
    for flag in flags(experiment, loop):
        warn(f"torquebench: {flag}")
    directory = RunDirectory(claim_folder(options.out, experiment.name))
    write_experiment(directory, experiment)
    steps = experiment.n_steps * len(experiment.controllers)
    with progress_bar(steps, "step", "starting (compiles on first use)") as bar:
        result = run_experiment(
            experiment,
            loop,
            progress=following(bar, 50),
            finished=lambda name, trajectory: write_trajectory(directory, name, trajectory),
        )
    with progress_bar(0, "figure", "writing") as bar:
        write_run(directory, result, options.plugin, not options.no_figures, following(bar))
    tell(
        directory=directory.folder,
        **result.to_json(),
        certificates=result.certified,
        fuzzy=fuzzy_facts(experiment),
    )
    say(summary(result))
    say()
    for line in certificate_lines(result):
        say(line)
    for remark in fuzzy_remarks(experiment):
        say(remark)
    say()
    say(f"results: {directory.folder}")
    if not options.no_figures and experiment.video is not None:
        from torquebench.cli.video import film_of_run

        film_of_run(result, directory.folder, options.gl)
    return told_ending(result)


def told_ending(result: ExperimentResult) -> int:
    """Say which runs were interpreted, and which ended otherwise than expected; return the exit status."""
    for reason in dict.fromkeys(run.path_reason for run in result.runs.values() if run.path_reason):
        warn(f"torquebench: interpreted, which is slower: {reason}")
    for name in result.unexpected:
        trajectory = result.runs[name]
        detail = f" ({trajectory.detail})" if trajectory.detail else ""
        wanted = next(keys.expect for keys in result.experiment.controllers if keys.name == name)
        complain(
            f"torquebench: controller '{name}': {outcome_text(result, name)}{detail}; the config expects: {wanted}"
        )
    return 1 if result.unexpected else 0


def chosen(options: argparse.Namespace) -> Experiment:
    """Return the experiment of a file, or that of a sweep's row.

    Args:
        options: Arguments of the command; see ``torquebench run --help``.

    Raises:
        ConfigError: it has mistakes, or the arguments do not go together.
    """
    if options.from_sweep is None:
        if options.config is None:
            raise ConfigError([Problem("CONFIG", "", "missing: wanted an experiment's file, or --from-sweep")])
        if options.index is not None:
            raise ConfigError([Problem("--index", "", "has no effect without --from-sweep")])
        return load_experiment(options.config, options.overrides)
    extra = [("CONFIG", options.config is not None), ("--set", bool(options.overrides))]
    problems = [
        Problem(name, "", "has no effect with --from-sweep: a row is run as it was")
        for name, is_there in extra
        if is_there
    ]
    if options.index is None:
        problems.append(Problem("--index", "", "missing: wanted the number of a row, from 0"))
    if problems:
        raise ConfigError(problems)
    from torquebench.sweep.folder import open_sweep

    plan = open_sweep(options.from_sweep, tuple(options.plugin), "--from-sweep").plan
    if not 0 <= options.index < plan.rows:
        raise ConfigError([Problem("--index", "", f"got {options.index}, wanted 0 to {plan.rows - 1}")])
    return plan.experiment_of(plan.row(options.index))


def summary(result: ExperimentResult) -> str:
    """Return the table of headline metrics, one row a controller."""
    header, rows = headline_table(result)
    rows = [[*row[:2], (bad if row[0] in result.unexpected else good)(row[2]), *row[3:]] for row in rows]
    return f"{result.experiment.name}\n{result.conditions}\n\n{table(header, rows)}"
