"""``torquebench laws``, ``configs`` and ``show``: what there is to run, and what each of it is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

import torquebench
from torquebench.cli.app import command
from torquebench.cli.parameters import argument, plugins, refuse, suggest
from torquebench.cli.terminal import say, table, tell
from torquebench.errors import Problem
from torquebench.shipped import configs as shipped_configs
from torquebench.shipped import data_root, find_config, first_line

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


@command(example="torquebench configs")
def configs() -> int:
    """List the experiments that come with the package.

    `run` and `sweep` take their names.
    """
    found = shipped_configs()
    texts = {name: first_line(path) for name, path in found.items()}
    sweeps = [name for name, path in found.items() if "\nsweep:" in path.read_text(encoding="utf-8")]
    facts = {n: {"file": found[n], "description": text, "sweep": n in sweeps} for n, text in texts.items()}
    tell(configs=facts)
    rows = [[name, "sweep" if name in sweeps else "run", text] for name, text in texts.items()]
    say(table(["config", "for", "what it asks"], rows, left=3, prose=True))
    say(f"\nfiles: {data_root() / 'configs'}")
    return 0


class LawOrConfig(click.ParamType[str]):
    """Name of a law or a shipped config."""

    name = "name"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin as typed; laws are found without importing them."""
        folder = Path(torquebench.__file__).parent / "laws"
        found = [
            re.findall(r'^@controller\(\s*"([\w-]+)"', file.read_text(), re.MULTILINE) for file in folder.glob("*.py")
        ]
        names = sorted(name for names in found for name in names) + list(shipped_configs())
        return [CompletionItem(name) for name in names if name.startswith(incomplete)]


@command(example="torquebench show linear-band-smc")
@argument("name", type=LawOrConfig(), help="a law, or a config that comes with the package")
@plugins
def show(name: str, plugin: Sequence[Path]) -> int:
    """Explain a law, or print a shipped config.

    Of a law: what it computes, its gains and options, and lines for a config.
    """
    if name in shipped_configs() or name.endswith((".yaml", ".yml")):
        return _show_config(find_config(name))
    from torquebench.laws import find_law, law_names
    from torquebench.laws.plugin import load_plugin

    for file in plugin:
        load_plugin(file)
    if name not in law_names():
        text = f"got '{name}', which is neither a law nor a shipped config"
        refuse([Problem("NAME", text=text, **suggest(name, [*law_names(), *shipped_configs()]))])
    _show_law(find_law(name))
    return 0


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
        rows = [[gain["name"], gain["unit"], gain["range"], gain["meaning"]] for gain in gains]
        say(table(["gain", "unit", "range", "meaning"], rows, left=4, prose=True))
    if options := facts["options"]:
        rows = [[choice["name"], ", ".join(choice["values"]), choice["meaning"]] for choice in options]
        say("\n" + table(["option", "values, default first", "meaning"], rows, left=3, prose=True))
    if systems := facts["fuzzy"]:
        rows = [[system["name"], system["system"], system["meaning"]] for system in systems]
        say("\n" + table(["fuzzy system", "default", "meaning"], rows, left=3, prose=True))
    say(f"\nIn a config:\n\n{facts['example']}")


def law_facts(law: Law) -> dict[str, Any]:
    """Return what a law is, for the terminal and for ``--json``."""
    import inspect

    def only(condition: str) -> str:
        return f"; only with {condition}" if condition.strip(": ") else ""

    chosen = {name: option.values[0] for name, option in law.options.items()}
    acting = {name: 1.0 for name, gain in law.gains.items() if gain.acts(chosen)}
    gains = ", ".join(f"{name}: 1.0" for name in acting)
    chosen_by = not any(law.no_rule(name) for name in acting)
    gains = f"auto}}  # or your own, {{{gains}}}" if chosen_by and acting else f"{{{gains}}}}}"
    return {
        "law": law.name,
        "text": inspect.cleandoc(law.function.__doc__ or ""),
        "gains": [
            {
                "name": name,
                "unit": gain.unit,
                "range": "> 0" if gain.positive else ">= 0",
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
