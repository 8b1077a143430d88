"""``torquebench run``: one experiment from its YAML file to numbers, figures and a manifest."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from torquebench.certificates import Certificate
from torquebench.cli.certificates import certificate_lines, certificate_pages
from torquebench.cli.colour import bad, good
from torquebench.cli.conditions import chain_text, conditions_text, noise_text
from torquebench.cli.fuzzy import remarks, run_figures
from torquebench.cli.run_facts import fuzzy_facts, outcome_facts, run_facts
from torquebench.cli.showing import Showing
from torquebench.cli.terminal import complain, progress_bar, say, table, tell, warn
from torquebench.disturbances import Stream
from torquebench.errors import ConfigError, Problem
from torquebench.experiment import config_hash, dump_experiment, load_experiment
from torquebench.experiment.build import Loop, build, plant_factors
from torquebench.experiment.certify import certificates, flags
from torquebench.experiment.run import ExperimentResult, band_of, run_experiment
from torquebench.experiment.schema import Experiment
from torquebench.experiment.store import (
    EXPERIMENT,
    RunDirectory,
    checksums,
    claim_folder,
    json_bytes,
    machine,
    model_checksums,
    versions,
)
from torquebench.laws.plugin import load_plugin
from torquebench.registry import as_vector
from torquebench.report.render import PAGE
from torquebench.report.run_page import run_page
from torquebench.report.tables import headline_table, outcome_text
from torquebench.robot.bodies import FACTORS, links_in
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.sim.trajectory import Trajectory
from torquebench.timing import whole_steps

if TYPE_CHECKING:
    from torquebench.cli.view import Audience


def run(options: argparse.Namespace, live: Showing | None = None) -> int:
    """Run an experiment and return the exit status.

    Args:
        options: Arguments of the command; see ``torquebench run --help``.
        live: How the run is shown while it is simulated; None not to show it.

    Raises:
        ConfigError: bad input; nothing has been written.
    """
    plugins = options.plugin
    for plugin in plugins:
        load_plugin(plugin)
    experiment = chosen(options)
    loop = build(experiment)
    for flag in flags(experiment, loop):
        warn(f"torquebench: {flag}")
    directory = RunDirectory(claim_folder(options.out, experiment.name))
    directory.write(EXPERIMENT, dump_experiment(experiment).encode())
    with shown(experiment, loop, directory.folder, live) as audience:
        result = simulated(experiment, loop, directory, audience)
        proofs = write_results(result, directory, plugins, not options.no_figures)
        proved = {name: found.to_json() for name, found in proofs.items()}
        tell(directory=directory.folder, **run_facts(result), certificates=proved, fuzzy=fuzzy_facts(experiment))
        say(summary(result))
        for line in certificate_lines(result, proofs):
            say(line)
        for remark in remarks(experiment):
            say(remark)
        say()
        say(f"results: {directory.folder}")
        if not options.no_figures and experiment.video is not None:
            from torquebench.cli.video import film_of_run

            film_of_run(result, directory.folder, options.gl)
    for reason in dict.fromkeys(run.path_reason for run in result.runs.values() if run.path_reason):
        warn(f"torquebench: interpreted, which is slower: {reason}")
    for name in result.unexpected:
        trajectory = result.runs[name]
        detail = f" ({trajectory.detail})" if trajectory.detail else ""
        wanted = next(keys.expect for keys in experiment.controllers if keys.name == name)
        complain(
            f"torquebench: controller '{name}': {outcome_text(result, name)}{detail}; the config expects: {wanted}"
        )
    return 1 if result.unexpected else 0


@contextmanager
def shown(experiment: Experiment, loop: Loop, folder: Path, live: Showing | None) -> Iterator[Audience | None]:
    """Show a run while it is simulated, if anyone asked for it. Arguments as of `watching`."""
    if live is None:
        yield None
        return
    from torquebench.cli.view import watching

    with watching(experiment, loop, folder, live) as audience:
        yield audience


def simulated(
    experiment: Experiment, loop: Loop, directory: RunDirectory, audience: Audience | None
) -> ExperimentResult:
    """Run every controller with a progress bar, and write its trajectory as soon as there is one.

    Args:
        experiment: What is run.
        loop: Its objects.
        directory: Where.
        audience: Who is told how it goes.
    """
    begin = "starting (compiles on first use)"
    with progress_bar(experiment.n_steps * len(experiment.controllers), "step", begin) as bar:
        done = dict.fromkeys((keys.name for keys in experiment.controllers), 0)

        def report(name: str, k: int) -> None:
            if k + 1 - done[name] >= 50 or k + 1 == experiment.n_steps:
                bar.set_description_str(name, refresh=False)
                bar.update(k + 1 - done[name])
                done[name] = k + 1

        def keep(name: str, trajectory: Trajectory) -> None:
            directory.write(f"{name}/trajectory.npz", trajectory.to_bytes())
            if audience is not None:
                audience.finished(name, trajectory)

        return run_experiment(
            experiment, loop, progress=report, finished=keep, watch=None if audience is None else audience.watch
        )


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
    from torquebench.sweep.store import opened

    plan = opened(options.from_sweep, tuple(options.plugin), "--from-sweep").plan
    if not 0 <= options.index < plan.rows:
        raise ConfigError([Problem("--index", "", f"got {options.index}, wanted 0 to {plan.rows - 1}")])
    return plan.experiment_of(plan.row(options.index))


def write_results(
    result: ExperimentResult, directory: RunDirectory, plugins: Sequence[Path], with_figures: bool
) -> dict[str, Certificate]:
    """Write metrics, certificates, figures and, last, the manifest of a run whose trajectories are written.

    Args:
        result: The run.
        directory: Where.
        plugins: Files of laws that were loaded, for the manifest.
        with_figures: Whether to draw figures.

    Returns:
        The certificates by controller.
    """
    experiment = result.experiment
    metrics = {name: result.metrics[name].to_json() if name in result.metrics else None for name in result.runs}
    conditions = {
        "window_from": experiment.run.metrics_from,
        "noise": noise_text(experiment),
        "chain": chain_text(experiment),
    }
    directory.write("metrics.json", json_bytes({"conditions": conditions, "controllers": metrics}))
    proofs = certificates(experiment, result.loop, result.runs)
    directory.write("certificates.json", json_bytes({name: found.to_json() for name, found in proofs.items()}))
    svgs = write_figures(result, directory, proofs) if with_figures else {}
    facts = {
        "config_sha256": config_hash(experiment),
        "seeds": {
            "seed": experiment.run.seed,
            "draw": experiment.run.draw,
            "streams": {stream.name.lower(): int(stream) for stream in Stream},
            "mismatch_redraws": result.loop.redraws,
        },
    }
    page = run_page(
        result, proofs, svgs, conditions_text(experiment), facts | {"software": versions(), "machine": machine()}
    )
    directory.write(PAGE, page)
    directory.finish(
        facts
        | {
            "name": experiment.name,
            "scenario": scenario_facts(result),
            "model_files": model_checksums(experiment.plant.model),
            "plugins": checksums(plugins),
            "fuzzy": fuzzy_facts(experiment),
            "outcomes": {name: outcome_facts(trajectory) for name, trajectory in result.runs.items()},
        }
    )
    return proofs


def scenario_facts(result: ExperimentResult) -> dict[str, Any]:
    """Return what was drawn for model and plant, and when the payload was taken up, for the manifest."""
    experiment, flat, facts = result.experiment, result.loop.model.flat, dict[str, Any]()
    if experiment.model.mismatch is not None:
        if len(flat.constants):
            facts["model_constants"] = dict(zip(CONSTANTS, flat.constants.tolist(), strict=True))
        else:
            facts["model_links"] = {name: value.tolist() for name, value in links_in(flat)._asdict().items()}
    factors = plant_factors(experiment)
    if factors is not None:
        facts["plant_factors"] = {name: factors[:, i].tolist() for i, name in enumerate(FACTORS)}
    if experiment.plant.payload is not None:
        facts["payload_step"] = whole_steps(experiment.plant.payload.at, experiment.run.control_period)
    return facts


def write_figures(
    result: ExperimentResult, directory: RunDirectory, proofs: Mapping[str, Certificate]
) -> dict[str, bytes]:
    """Draw every figure, write it as SVG and PNG, and return the SVGs by name."""
    svgs = {}
    for name, files in draw_figures(result, proofs):
        for fmt, content in files.items():
            directory.write(f"figures/{name}.{fmt}", content)
        svgs[name] = files["svg"]
    return svgs


def draw_figures(
    result: ExperimentResult, proofs: Mapping[str, Certificate]
) -> Iterator[tuple[str, dict[Literal["svg", "png"], bytes]]]:
    """Draw every figure of a run; yield its name and its bytes by format.

    Args:
        result: The run.
        proofs: Controller name -> certificates.
    """
    from torquebench.analysis.figures import figure_bytes, make_figures

    experiment = result.experiment
    found = {keys.name: band_of(keys.law, keys.gains) for keys in experiment.controllers}
    bands = {name: as_vector(band, experiment.n) for name, band in found.items() if band is not None}
    figures = make_figures(
        result.runs,
        title=experiment.name,
        subtitle=conditions_text(experiment),
        joint_names=result.loop.joint_names,
        tau_max=result.loop.plant.tau_max,
        metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period,
        metrics=result.metrics,
        bands=bands,
        slides=result.slides,
    )
    figures |= certificate_pages(result, proofs, conditions_text(experiment))
    figures |= run_figures(result, conditions_text(experiment))
    formats: tuple[Literal["svg", "png"], ...] = ("svg", "png")
    with progress_bar(2 * len(figures), "figure", "drawing") as bar:
        for name, figure in figures.items():
            files = {}
            for fmt in formats:
                bar.set_description_str(f"figures/{name}.{fmt}", refresh=False)
                files[fmt] = figure_bytes(figure, fmt)
                bar.update(1)
            yield name, files


def summary(result: ExperimentResult) -> str:
    """Return the table of headline metrics, one row a controller."""
    header, rows = headline_table(result)
    rows = [[*row[:2], (bad if row[0] in result.unexpected else good)(row[2]), *row[3:]] for row in rows]
    return f"{result.experiment.name}\n{conditions_text(result.experiment)}\n\n{table(header, rows)}"
