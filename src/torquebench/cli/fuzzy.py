"""``torquebench fuzzy``: what a fuzzy system is, how it is evaluated, and what is odd about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem, did_you_mean, did_you_mean_path
from torquebench.experiment import load_experiment
from torquebench.experiment.describe import evaluation
from torquebench.experiment.fuzzy_system import systems_of
from torquebench.experiment.store import CLAIM, atomic_write, claim_folder
from torquebench.experiment.yaml_source import YAML
from torquebench.fuzzy import BUILTIN, FuzzySystem, Prepared, builtin_system, prepare
from torquebench.fuzzy.lint import lint
from torquebench.fuzzy.oracle import compare
from torquebench.laws.plugin import load_plugin


def fuzzy(source: str, name: str | None, out: Path | None, plugins: Sequence[Path], oracle: bool = False) -> int:
    """Describe fuzzy systems, write their figures, and return the exit status: 1 where scikit-fuzzy says otherwise.

    Args:
        source: A config file, or the name of a built-in system.
        name: The only system of the file to describe; None for all.
        out: Folder for the figures; None for ``runs/fuzzy-NAME-UTC``.
        plugins: Files that register laws which the config uses.
        oracle: Compare each system with scikit-fuzzy on a grid of inputs.

    Raises:
        ConfigError: bad input; nothing has been written.
    """
    for plugin in plugins:
        load_plugin(plugin)
    label, systems = _systems(source, name)
    prepared = {}
    with progress_bar(len(systems), "system", "preparing (compiles on first use)") as bar:
        for key in systems:
            prepared[key] = prepare(systems[key])
            bar.update(1)
    compared = {}
    with progress_bar(len(prepared) if oracle else 0, "system", "asking scikit-fuzzy") as bar:
        for key in prepared if oracle else ():
            compared[key] = compare(prepared[key])
            bar.update(1)
    folder = claim_folder(out, f"fuzzy-{label}")
    beside = {key: {"oracle": comparison._asdict()} for key, comparison in compared.items()}
    tell(directory=folder, systems={key: facts(system) | beside.get(key, {}) for key, system in prepared.items()})
    say("\n\n".join(description(system) for system in prepared.values()))
    for key, comparison in compared.items():
        say(f"\n{key} beside {comparison}")
    from torquebench.analysis.figures import figure_bytes
    from torquebench.analysis.fuzzy_figures import system_figures

    with progress_bar(6 * len(prepared), "figure", "drawing") as bar:
        for key, system in prepared.items():
            for what, figure in system_figures(system).items():
                for fmt in ("svg", "png"):
                    atomic_write(folder / f"{key}-{what}.{fmt}", figure_bytes(figure, fmt))
                    bar.update(1)
    (folder / CLAIM).unlink()
    header = ["system", "rules", "terms", "error at most", "remarks", "evaluated"]
    say("\n" + table(header, [summary_row(key, system) for key, system in prepared.items()], prose=True))
    say(f"\nfigures: {folder}")
    return 0 if all(comparison.within for comparison in compared.values()) else 1


def _systems(source: str, name: str | None) -> tuple[str, Mapping[str, FuzzySystem]]:
    """Return what to call the result, and the systems to describe by name."""
    if source in BUILTIN and not Path(source).exists():
        if name not in (None, source):
            raise ConfigError([Problem("--name", str(name), f"goes with a config file; {source} is built in")])
        return source, {source: builtin_system(source)}
    if not Path(source).exists():
        near = did_you_mean_path(Path(source), YAML) or did_you_mean(source, BUILTIN)
        raise ConfigError([Problem(source, "", f"is neither a file nor a built-in fuzzy system{near}")])
    experiment = load_experiment(Path(source))
    systems = systems_of(experiment)
    if not systems:
        raise ConfigError([Problem(source, "fuzzy", "there is no fuzzy system in it, and no controller uses one")])
    if name is None:
        return experiment.name, systems
    if name not in systems:
        raise ConfigError([Problem("--name", name, f"no such fuzzy system in {source}{did_you_mean(name, systems)}")])
    return name, {name: systems[name]}


def description(prepared: Prepared) -> str:
    """Return a system's size, how it is evaluated, the bound of the error, and what lint says, in lines."""
    system = prepared.system
    sizes = " x ".join(str(len(variable.terms)) for variable in system.inputs)
    findings = [f"  {finding}" for finding in lint(prepared)] or ["  nothing to remark"]
    return "\n".join(
        [
            f"fuzzy system {system.name}: {len(system.rules)} rules on {sizes} terms",
            f"evaluated: {evaluation(prepared)}",
            "lint:",
            *findings,
        ]
    )


def summary_row(name: str, prepared: Prepared) -> list[str]:
    """Return the cells of a system in the table.

    Args:
        name: What it is called.
        prepared: The system.
    """
    found = facts(prepared)
    terms = " x ".join(str(count) for count in found["terms"])
    bound = f"{prepared.bound:.2g}" if prepared.bound else "0"
    return [name, str(found["rules"]), terms, bound, str(len(found["findings"])), prepared.method]


def facts(prepared: Prepared) -> dict[str, Any]:
    """Return what ``--json`` tells of a system: sizes, evaluation, and what lint says."""
    system = prepared.system
    return {
        "rules": len(system.rules),
        "terms": [len(variable.terms) for variable in system.inputs],
        "method": prepared.method,
        "error_bound": prepared.bound,
        "findings": lint(prepared),
    }
