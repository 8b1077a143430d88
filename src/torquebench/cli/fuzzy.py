"""``torquebench fuzzy``: what a fuzzy system is, how it is evaluated, and what is odd about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from torquebench.cli.app import command
from torquebench.cli.parameters import Config, Numbers, argument, option, out_folder, plugins, refuse, suggest
from torquebench.cli.terminal import progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.shipped import find_config

if TYPE_CHECKING:
    from torquebench.fuzzy import FuzzySystem, Prepared

SYSTEMS = ("pd-49", "pd-25", "pd-9", "s-7")
"""Built-in fuzzy systems, known before what defines them is imported."""


class Source(Config):
    """A config, or the name of a built-in fuzzy system."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the file, or the system's name as a path."""
        return Path(value) if value in SYSTEMS else find_config(str(value), SYSTEMS)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return systems, shipped configs and files."""
        systems = [CompletionItem(name) for name in SYSTEMS if name.startswith(incomplete)]
        return systems + super().shell_complete(ctx, param, incomplete)


@command(example="torquebench fuzzy pd-49")
@argument(
    "source",
    type=Source(),
    metavar="CONFIG",
    help=f"experiment, a file or a shipped one; a file of systems alone; or {', '.join(SYSTEMS)}",
)
@option("--name", help="the only system of the file to describe (default: all)")
@out_folder(help="folder for the figures, new or empty (default: runs/fuzzy-NAME-UTC)")
@option("--at", type=Numbers(), metavar="X,Y", help="inputs in their own units; say the output, and draw nothing")
@option("--oracle", is_flag=True, help="compare with scikit-fuzzy on a grid of inputs; status 1 where they differ")
@plugins
def fuzzy(
    source: Path, name: str | None, out: Path | None, at: list[float] | None, oracle: bool, plugin: Sequence[Path]
) -> int:
    """Describe and draw the fuzzy systems of a config.

    It is said how they are evaluated, and what is odd about them. A built-in system goes by its name.

    Args:
        source: The config, or the name of a built-in system.
        name: The only system to describe.
        out: Folder for the figures.
        at: Inputs, one for each that the systems have.
        oracle: Whether scikit-fuzzy is asked.
        plugin: Files that register laws.
    """
    from torquebench.experiment.store import atomic_write, claim_folder, release_folder
    from torquebench.fuzzy import prepare
    from torquebench.fuzzy.oracle import compare
    from torquebench.laws.plugin import load_plugin
    from torquebench.report.figures.files import figure_bytes
    from torquebench.report.figures.fuzzy import system_figures

    for file in plugin:
        load_plugin(file)
    label, systems, is_law = _systems(source, name)
    if at is not None:
        return _say_outputs(systems, at)
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
    facts = {key: _facts(system, is_law) for key, system in prepared.items()}
    for key, comparison in compared.items():
        facts[key]["oracle"] = comparison._asdict()
    tell(directory=folder, systems=facts)
    say("\n\n".join(_description(system, is_law) for system in prepared.values()))
    for key, comparison in compared.items():
        say(f"\n{key} beside {comparison}")
    with progress_bar((6 if is_law else 4) * len(prepared), "figure", "drawing") as bar:
        for key, system in prepared.items():
            for what, figure in system_figures(system, is_law).items():
                for fmt in ("svg", "png"):
                    atomic_write(folder / f"{key}-{what}.{fmt}", figure_bytes(figure, fmt))
                    bar.update(1)
    release_folder(folder)
    header = ["system", "rules", "terms", "error at most", "remarks", "evaluated"]
    rows = [
        [
            key,
            str(fact["rules"]),
            " x ".join(str(count) for count in fact["terms"]),
            f"{fact['error_bound']:.2g}" if fact["error_bound"] else "0",
            str(len(fact["findings"])),
            fact["method"],
        ]
        for key, fact in facts.items()
    ]
    say("\n" + table(header, rows, prose=True))
    say(f"\nfigures: {folder}")
    return 0 if all(comparison.within for comparison in compared.values()) else 1


def _say_outputs(systems: Mapping[str, FuzzySystem], at: list[float]) -> int:
    """Say the output of each system for some inputs, in own units; return the exit status."""
    from torquebench.fuzzy import prepare

    wrong = {key: len(system.inputs) for key, system in systems.items() if len(system.inputs) != len(at)}
    refuse([Problem("--at", f"{len(at)} numbers", wanted=f"{n}, as {key} has") for key, n in wrong.items()])
    outputs = {}
    for key, system in systems.items():
        prepared = prepare(system)
        output, in_loop, bound = prepared.evaluate(*at), prepared.in_loop(*at), prepared.bound * system.output.half
        outputs[key] = {"output": output, "in_loop": in_loop, "error_bound": bound}
        table = f" ({in_loop:.6g} from the loop's table, whose error is at most {bound:.2g})" if bound else ""
        say(f"{key} at {', '.join(f'{x:g}' for x in at)}: {output:.6g}{table}")
    tell(inputs=at, systems=outputs)
    return 0


def _systems(source: Path, name: str | None) -> tuple[str, Mapping[str, FuzzySystem], bool]:
    """Return what to call the result, the systems to describe by name, and whether laws use them."""
    from torquebench.experiment import load_experiment, load_systems
    from torquebench.experiment.build import systems_of
    from torquebench.fuzzy import builtin_system

    if str(source) in SYSTEMS and not source.exists():
        if name not in (None, str(source)):
            raise ConfigError([Problem("--name", str(name), f"goes with a config file; {source} is built in")])
        return str(source), {str(source): builtin_system(str(source))}, True
    alone = load_systems(source)
    experiment = None if alone is not None else load_experiment(source)
    systems = systems_of(experiment) if experiment is not None else alone or {}
    if not systems:
        message = "there is no fuzzy system in it, and no controller uses one"
        raise ConfigError([Problem(str(source), "fuzzy", message)])
    is_law = experiment is not None
    if name is None:
        return experiment.name if experiment is not None else source.stem, systems, is_law
    if name not in systems:
        refuse([Problem("--name", name, f"no such fuzzy system in {source}", **suggest(name, systems))])
    return name, {name: systems[name]}, is_law


def _description(prepared: Prepared, is_law: bool) -> str:
    """Return a system's size, how it is evaluated, the bound of the error, and what lint says, in lines."""
    from torquebench.experiment.describe import evaluation
    from torquebench.fuzzy.lint import lint

    system = prepared.system
    sizes = " x ".join(str(len(variable.terms)) for variable in system.inputs)
    findings = [f"  {finding}" for finding in lint(prepared, is_law)] or ["  nothing to remark"]
    head = f"fuzzy system {system.name}: {len(system.rules)} rules on {sizes} terms"
    return "\n".join([head, f"evaluated: {evaluation(prepared)}", "lint:", *findings])


def _facts(prepared: Prepared, is_law: bool) -> dict[str, Any]:
    """Return what ``--json`` tells of a system: sizes, evaluation, and what lint says."""
    from torquebench.fuzzy.lint import lint

    return {
        "rules": len(prepared.system.rules),
        "terms": [len(variable.terms) for variable in prepared.system.inputs],
        "method": prepared.method,
        "error_bound": prepared.bound,
        "findings": lint(prepared, is_law),
    }
