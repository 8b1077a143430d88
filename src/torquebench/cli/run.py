"""``torquebench run``: one experiment from its YAML file to numbers, figures and a manifest."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torquebench.cli.conditions import chain_text, conditions_text, noise_text
from torquebench.cli.fuzzy import remarks, run_figures, used
from torquebench.cli.terminal import complain, progress_bar, say, table
from torquebench.disturbances import Stream
from torquebench.experiment import config_hash, dump_experiment, load_experiment
from torquebench.experiment.build import build, plant_factors
from torquebench.experiment.run import ExperimentResult, band_of, run_experiment
from torquebench.experiment.schema import whole_steps
from torquebench.experiment.store import RunDirectory, checksums, claim_folder, json_bytes
from torquebench.experiment.values import as_vector
from torquebench.laws.plugin import load_plugin
from torquebench.robot.bodies import FACTORS, links_in
from torquebench.robot.library import model_folder
from torquebench.robot.model import SLIDE
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.sim.trajectory import Trajectory


def run(config: Path, out: Path | None, overrides: Sequence[str], plugins: Sequence[Path], with_figures: bool) -> int:
    """Run an experiment and return the exit status.

    Args:
        config: The experiment's YAML file.
        out: Folder for the results; None for ``runs/NAME-UTC``.
        overrides: ``key=value`` changes of single keys.
        plugins: Files that register further laws.
        with_figures: Whether to draw figures.

    Raises:
        ConfigError: bad input; nothing has been written.
    """
    for plugin in plugins:
        load_plugin(plugin)
    experiment = load_experiment(config, overrides)
    loop = build(experiment)
    directory = RunDirectory(claim_folder(out, experiment.name))
    directory.write("experiment.yaml", dump_experiment(experiment).encode())
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

        result = run_experiment(experiment, loop, progress=report, finished=keep)
    write_results(result, directory, plugins, with_figures)
    say(summary(result))
    for remark in remarks(experiment):
        say(remark)
    say()
    say(f"results: {directory.folder}")
    for reason in dict.fromkeys(run.path_reason for run in result.runs.values() if run.path_reason):
        complain(f"torquebench: interpreted, which is slower: {reason}")
    for name in result.unexpected:
        trajectory = result.runs[name]
        detail = f" ({trajectory.detail})" if trajectory.detail else ""
        wanted = next(keys.expect for keys in experiment.controllers if keys.name == name)
        complain(
            f"torquebench: controller '{name}': {outcome_text(result, name)}{detail}; the config expects: {wanted}"
        )
    return 1 if result.unexpected else 0


def write_results(
    result: ExperimentResult, directory: RunDirectory, plugins: Sequence[Path], with_figures: bool
) -> None:
    """Write metrics, figures and, last, the manifest of a run whose trajectories are written.

    Args:
        result: The run.
        directory: Where.
        plugins: Files of laws that were loaded, for the manifest.
        with_figures: Whether to draw figures.
    """
    experiment = result.experiment
    metrics = {name: result.metrics[name].to_json() if name in result.metrics else None for name in result.runs}
    conditions = {
        "window_from": experiment.run.metrics_from, "noise": noise_text(experiment), "chain": chain_text(experiment),
    }  # fmt: skip
    directory.write("metrics.json", json_bytes({"conditions": conditions, "controllers": metrics}))
    if with_figures:
        write_figures(result, directory)
    directory.finish(
        {
            "name": experiment.name,
            "config_sha256": config_hash(experiment),
            "seeds": {
                "seed": experiment.run.seed,
                "draw": experiment.run.draw,
                "streams": {stream.name.lower(): int(stream) for stream in Stream},
                "mismatch_redraws": result.loop.redraws,
            },
            "scenario": scenario_facts(result),
            "model_files": checksums(sorted(p for p in model_folder(experiment.plant.model).iterdir() if p.is_file())),
            "plugins": checksums(plugins),
            "fuzzy": {
                name: {"method": prepared.method, "error_bound": prepared.bound}
                for name, prepared in used(experiment).items()
            },
            "outcomes": {
                name: {
                    "path": trajectory.path,
                    "path_reason": trajectory.path_reason,
                    "outcome": trajectory.outcome.name,
                    "failed_at": trajectory.failed_at,
                    "detail": trajectory.detail,
                    "digest": trajectory.digest(),
                }
                for name, trajectory in result.runs.items()
            },
        }
    )


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


def write_figures(result: ExperimentResult, directory: RunDirectory) -> None:
    """Draw every figure and write it as SVG and PNG."""
    from torquebench.analysis.figures import figure_bytes, make_figures

    experiment = result.experiment
    found = {keys.name: band_of(keys.law, keys.gains) for keys in experiment.controllers}
    bands = {name: as_vector(band, experiment.n) for name, band in found.items() if band is not None}
    figures = make_figures(
        result.runs, title=experiment.name, subtitle=conditions_text(experiment), joint_names=result.loop.joint_names,
        tau_max=result.loop.plant.tau_max, metrics_from=experiment.run.metrics_from,
        control_period=experiment.run.control_period, metrics=result.metrics,
        bands=bands, slides=[kind == SLIDE for kind in result.loop.model.flat.kind],
    )  # fmt: skip
    figures |= run_figures(result, conditions_text(experiment))
    with progress_bar(2 * len(figures), "figure", "drawing") as bar:
        for name, figure in figures.items():
            for fmt in ("svg", "png"):
                bar.set_description_str(f"figures/{name}.{fmt}", refresh=False)
                directory.write(f"figures/{name}.{fmt}", figure_bytes(figure, fmt))
                bar.update(1)


def outcome_text(result: ExperimentResult, name: str) -> str:
    """Return how a run ended, with the time of a failure."""
    trajectory = result.runs[name]
    if trajectory.completed:
        return "completed"
    return f"{trajectory.outcome.name.lower().replace('_', ' ')} at {trajectory.t[-1]:g} s"


def summary(result: ExperimentResult) -> str:
    """Return the table of headline metrics, one row a controller."""
    columns = {
        "rmse": ("RMSE [mrad]", 1e3), "max_error": ("max [mrad]", 1e3), "steady_state_error": ("steady [mrad]", 1e3),
        "hf": ("HF [%]", 1.0), "total_variation": ("TV [1/s]", 1.0), "effort": ("effort", 1.0),
        "saturation_fraction": ("saturated [%]", 100.0),
    }  # fmt: skip
    if result.experiment.reference.kind in ("step", "quintic"):
        columns["rise_time"], columns["overshoot"] = ("rise [s]", 1.0), ("over [%]", 1.0)
        columns["settling_time"] = ("settle [s]", 1.0)
    rows = []
    for keys in result.experiment.controllers:
        cells = [keys.name, keys.law, outcome_text(result, keys.name)]
        metrics = result.metrics.get(keys.name)
        for key, (_, scale) in columns.items():
            value = None if metrics is None else getattr(metrics, key).value
            cells.append("-" if value is None else f"{value * scale:.4g}")
        rows.append(cells)
    header = ["controller", "law", "outcome", *(title for title, _ in columns.values())]
    return f"{result.experiment.name}\n{conditions_text(result.experiment)}\n\n{table(header, rows)}"
