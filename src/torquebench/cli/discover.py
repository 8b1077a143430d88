"""``torquebench laws``, ``chains``, ``configs`` and ``show``: what there is to run, and what each of it is."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

import torquebench
from torquebench.cli.app import command
from torquebench.cli.parameters import File, argument, plugins, refuse, suggest
from torquebench.cli.terminal import say, table, tell, width
from torquebench.errors import ModelError, Problem
from torquebench.shipped import configs as shipped_configs
from torquebench.shipped import data_root, find_config, first_line, model_names

if TYPE_CHECKING:
    from torquebench.laws.law import Law


@command(example="torquebench laws")
@plugins
def laws(plugin: Sequence[Path]) -> int:
    """List the torque laws that a config can name."""
    from torquebench.laws import find_law, law_names
    from torquebench.laws.plugin import load_plugin

    for file in plugin:
        load_plugin(file)
    found = {name: find_law(name).summary for name in law_names()}
    tell(laws=found)
    say(table(["law", "what it does"], list(found.items()), left=2, prose=True))
    say("\ntorquebench show LAW explains one")
    return 0


@command(example="torquebench chains")
def chains() -> int:
    """List the sensors and actuators that a config can name.

    `chain: NAME` in a config; those of robots come with where each number is from.
    """
    from torquebench.chain import ABOUT, CHAINS

    tell(
        chains={
            name: {"summary": about.summary, "control_period": about.control_period}
            for name, about in ABOUT.items()
            if name in CHAINS
        }
    )
    rows = []
    for name in CHAINS:
        about = ABOUT[name]
        rows.append([name, _period(about.control_period), about.summary])
    say(table(["chain", "period", "what it is"], rows, left=3, prose=True))
    say("\ntorquebench show CHAIN prints its numbers, and where they come from")
    return 0


def _period(period: float | None) -> str:
    return "any" if period is None else f"{1e3 * period:g} ms"


def chain_facts(name: str) -> dict[str, Any]:
    """Return what a named chain is, for the terminal, ``--json`` and the documentation.

    Returns:
        Its name, summary, control period [s], and for each number its key, value, unit, source and link.
    """
    from torquebench.chain import ABOUT, CHAINS, Origin
    from torquebench.experiment.dump import plain_values
    from torquebench.keys import declared_keys

    about, found, ideal = ABOUT[name], CHAINS[name], CHAINS["ideal"]
    cls: Any = type(found)
    rows: list[dict[str, Any]] = []

    def add(key: str, value: Any, unit: str) -> None:
        rows.append({"key": key, "value": value, "unit": unit, **about.origins.get(key, Origin(""))._asdict()})

    if about.control_period is not None:
        add("control_period", about.control_period, "s")
    for declared in declared_keys(cls):
        value = getattr(found, declared.attribute)
        if value != getattr(ideal, declared.attribute):
            add(declared.name, plain_values(value), declared.key.unit)
    facts = {"chain": name, "summary": about.summary, "note": about.note}
    return {**facts, "control_period": about.control_period, "numbers": rows}


def _show_chain(name: str, also_arm: bool) -> None:
    """Print a chain's numbers with their sources, and, unless the arm of its name follows, lines for a config."""
    facts = chain_facts(name)
    tell(**facts)
    say(f"{name}\n\n{' '.join(filter(None, (facts['summary'], facts['note'])))}\n")
    rows = [
        [row["key"], value_text(row["value"], row["unit"]), " ".join(filter(None, (row["source"], row["link"])))]
        for row in facts["numbers"]
    ]
    if rows:
        say(table(["key", "value", "where it is from"], rows, left=3, prose=True))
    say("\n" if also_arm else _in_a_config([f"chain: {name}"], _period_of(name)))


def _period_of(chain: str) -> list[str]:
    """Return the control period of a chain as a key of ``run``; nothing where it has none."""
    from torquebench.chain import period_of

    period = period_of(chain)
    return [] if period is None else [f"control_period: {period:g}"]


def _in_a_config(lines: Sequence[str], run: Sequence[str]) -> str:
    """Return lines for a config, and keys of ``run`` as one line, for a key may be there once."""
    return "\n".join(["\nIn a config:\n", *lines, *([f"run: {{{', '.join(run)}}}"] if run else [])])


def value_text(value: Any, unit: str) -> str:
    """Return a number of a chain with its unit."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {number:g}" for key, number in value.items())
    return value if isinstance(value, str) else f"{value:g} {unit}".rstrip()


@command(example="torquebench configs")
def configs() -> int:
    """List the experiments that come with the package.

    `run`, `sweep`, `tune`, `arena` and `falsify` take their names.
    """
    found = shipped_configs()
    texts = {name: first_line(path) for name, path in found.items()}
    kinds = {name: _command_for(path.read_text(encoding="utf-8")) for name, path in found.items()}
    facts = {n: {"file": found[n], "description": text, "sweep": kinds[n] == "sweep"} for n, text in texts.items()}
    tell(configs=facts)
    rows = [[name, kinds[name], text] for name, text in texts.items()]
    say(table(["config", "for", "what it asks"], rows, left=3, prose=True))
    say(f"\nfiles: {data_root() / 'configs'}")
    return 0


def _command_for(text: str) -> str:
    """Return the command that a config is for."""
    return next((section for section in ("sweep", "tune", "arena", "falsify") if f"\n{section}:" in text), "run")


class Shown(File):
    """Name of a law, a chain, an arm or a shipped config; or an arm's or a config's file."""

    name = "name"

    def __init__(self) -> None:
        """Offer names, and files of arms."""
        super().__init__(".xml", ".urdf", ".mjcf")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return what was typed."""
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin as typed; laws and chains are found without importing them."""
        package, names = Path(torquebench.__file__).parent, [*shipped_configs(), *model_names()]
        for folder, decorator in (("laws", "controller"), ("chain", "chain")):
            for file in sorted((package / folder).glob("*.py")):
                names += re.findall(rf'^@{decorator}\(\s*"([\w-]+)"', file.read_text(), re.MULTILINE)
        found = [CompletionItem(name) for name in sorted(set(names)) if name.startswith(incomplete)]
        return found + (super().shell_complete(ctx, param, incomplete) if incomplete else [])


@command(example="torquebench show linear-band-smc")
@argument("name", type=Shown(), help="a law, a chain, an arm, its file, or a config that comes with the package")
@plugins
def show(name: str, plugin: Sequence[Path]) -> int:
    """Explain a law, a chain or an arm, or print a shipped config.

    Of a law: what it computes, its gains and options, and lines for a config; of a chain: its numbers and their
    sources; of an arm: what its file says of each joint. A chain and its arm of the same name are both shown.
    """
    if name in shipped_configs() or name.endswith((".yaml", ".yml")):
        return _show_config(find_config(name))
    if name.lower().endswith((".xml", ".urdf", ".mjcf")):
        return _show_arm(Path(name), name)
    from torquebench.chain import CHAINS
    from torquebench.experiment.store import EXPERIMENT
    from torquebench.laws import find_law, law_names
    from torquebench.laws.plugin import load_plugin
    from torquebench.robot.described import described_arm

    for file in plugin:
        load_plugin(file)
    is_arm = bool(name in model_names() or described_arm(name))
    if name in CHAINS:
        _show_chain(name, also_arm=is_arm)
    if is_arm:
        return _show_arm(name, name)
    if name in CHAINS:
        return 0
    if name not in law_names():
        text = f"got '{name}', which is neither a law, a chain, an arm nor a shipped config"
        if (Path(name) / EXPERIMENT).is_file():
            text += f", but a run: its gains are in {Path(name) / EXPERIMENT}"
        names = [*law_names(), *CHAINS, *model_names(), *shipped_configs()]
        refuse([Problem("NAME", text=text, **suggest(name, names))])
    _show_law(find_law(name))
    return 0


NUMBERS = {
    "range": ("range", "no limit"),
    "speed": ("speed limit", "no limit"),
    "torque": ("torque limit", "no limit"),
    "armature": ("armature", "0"),
    "damping": ("damping", "0"),
    "friction": ("dry friction", "0"),
}
"""Numbers of a joint: what they are called, and what is assumed where the arm's file says nothing."""


def _show_arm(source: str | Path, name: str) -> int:
    """Print what an arm's file says of its joints.

    Args:
        source: The arm.
        name: What a config calls it.
    """
    from torquebench.chain import CHAINS
    from torquebench.robot.joint_facts import arm_facts

    try:
        facts = arm_facts(source)
    except ModelError as error:
        refuse(error.problems)
    tell(**facts._asdict())
    say(f"{facts.arm}, {len(facts.joints)} joints: {facts.file}\n", fold=False)
    for text in filter(None, (facts.comment, *facts.changes)):
        say(f"{text}\n")
    header, rows, sources = ["joint"], [[joint.joint] for joint in facts.joints], list[list[str]]()
    for key, (title, none) in NUMBERS.items():
        numbers = [getattr(joint, key) for joint in facts.joints]
        units = " or ".join(dict.fromkeys(number.unit for number in numbers))
        header.append(f"{title} [{units}]")
        for row, number in zip(rows, numbers, strict=True):
            row.append(_limit_text(number.value))
        names = {number.source: list[str]() for number in numbers}
        for joint, number in zip(facts.joints, numbers, strict=True):
            names[number.source].append(joint.joint)
        where = {"file": "the file", "table": "given to import", "assumed": f"assumed, {none}: the file has none"}
        texts = [where[source] + f" ({', '.join(who)})" * (len(names) > 1) for source, who in names.items()]
        if key == "range" and "file" in names and not any(joint.enforced for joint in facts.joints):
            texts.append('as information, limited="false": preflight keeps to it, a run does not look at it')
        if width() is None:  # no terminal tells where to break
            texts = [line for text in texts for line in textwrap.wrap(text, 100)]
        sources += [["" if i else title, text] for i, text in enumerate(texts)]
    say(table(header, rows))
    say("\n" + table(["number", "where it is from"], sources, left=2, prose=True))
    for text in facts.remarks:
        say(f"\n{text}")
    chain = [f"chain: {name}"] * (name in CHAINS)
    begin = [*_period_of(name), *(f"initial_q: key:{key}" for key in facts.keyframes[:1])]
    say(_in_a_config([*chain, f"plant: {{model: {name}}}"], begin), fold=False)
    return 0


def _limit_text(value: float | tuple[float, float] | None) -> str:
    return "-" if value is None else " to ".join(f"{x:.4g}" for x in (value if isinstance(value, tuple) else (value,)))


def _show_config(path: Path) -> int:
    text = path.read_text(encoding="utf-8")
    tell(file=path, text=text)
    say(f"# {path}")
    say(text.rstrip("\n"), fold=False)
    return 0


def _show_law(law: Law) -> None:
    """Print what a law is."""
    facts = law_facts(law)
    tell(**facts)
    say(f"{law.name}\n\n{facts['text']}\n")
    if gains := facts["gains"]:
        keys = ("name", "unit", "range", "search", "meaning")
        rows = [[gain[key] for key in keys] for gain in gains]
        say(table(["gain", "unit", "range", "tuned within", "meaning"], rows, left=5, prose=True))
    if options := facts["options"]:
        rows = [[choice["name"], ", ".join(choice["values"]), choice["meaning"]] for choice in options]
        say("\n" + table(["option", "values, default first", "meaning"], rows, left=3, prose=True))
    if systems := facts["fuzzy"]:
        rows = [[system["name"], system["system"], system["meaning"]] for system in systems]
        say("\n" + table(["fuzzy system", "default", "meaning"], rows, left=3, prose=True))
    say(f"\nIn a config:\n\n{facts['example']}")


def law_facts(law: Law) -> dict[str, Any]:
    """Return what a law is, for the terminal and for ``--json``."""
    from torquebench.laws.box import side_of
    from torquebench.registry import docstring

    def only(condition: str) -> str:
        return f"; only with {condition}" if condition.strip(": ") else ""

    chosen = {name: option.values[0] for name, option in law.options.items()}
    acting = {name: 1.0 for name, gain in law.gains.items() if gain.acts(chosen)}
    gains = ", ".join(f"{name}: 1.0" for name in acting)
    chosen_by = not any(law.no_rule(name) for name in acting)
    gains = f"auto}}  # or your own, {{{gains}}}" if chosen_by and acting else f"{{{gains}}}}}"
    return {
        "law": law.name,
        "text": docstring(law.function),
        "gains": [
            {
                "name": name,
                "unit": gain.unit,
                "range": "> 0" if gain.positive else ">= 0",
                "search": side_of(name, gain).text,
                "meaning": gain.meaning + only(gain.condition),
            }
            for name, gain in law.gains.items()
        ],
        "options": [
            {"name": name, "values": [_yaml(value) for value in choice.values], "meaning": choice.meaning}
            for name, choice in law.options.items()
        ],
        "fuzzy": [
            {"name": "fuzzy", "system": rules.default, "meaning": rules.meaning + only(rules.condition)}
            for rules in law.rules.values()
        ],
        "example": f"controllers:\n  - {{name: mine, law: {law.name}, gains: {gains}",
    }


def _yaml(value: str | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else value
