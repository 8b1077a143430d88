"""``torquebench completion``: what a shell needs to know of the command line, read from the argument parser."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from torquebench.cli import completion_scripts, words
from torquebench.cli.terminal import say, tell

FOLDERS = "folders"
"""Instead of an ending: only folders are offered."""


class Value(NamedTuple):
    """What an option or argument takes."""

    words: tuple[str, ...] = ()
    """Words to offer."""
    files: str | None = None
    """Ending of the files to offer besides, empty for all, FOLDERS for folders; None for none."""


class Option(NamedTuple):
    """An option of a command."""

    flags: tuple[str, ...]
    meaning: str
    value: Value | None
    """None for an option that takes nothing."""
    optional: bool
    """Whether the value may be left out."""
    repeats: bool


class Command(NamedTuple):
    """A command: its options, and its arguments in order."""

    name: str
    meaning: str
    options: tuple[Option, ...]
    arguments: tuple[tuple[str, Value], ...]
    """Name as shown, and what it takes; the last one repeats if `many`."""
    many: bool


VALUES = {
    "config": Value(files=".yaml"),
    "source": Value(words.SYSTEMS, ".yaml"),
    "plugin": Value(files=".py"),
    "file": Value(files=".py"),
    "a": Value(words.SIDES, ".xml"),
    "b": Value(words.SIDES, ".xml"),
    "run": Value(files=FOLDERS),
    "runs": Value(files=FOLDERS),
    "resume": Value(files=FOLDERS),
    "from_sweep": Value(files=FOLDERS),
    "overrides": Value(words.SETTINGS),
    "quality": Value(words.QUALITIES),
    "camera": Value(words.CAMERAS),
}
"""What is known of an option's or argument's values, by its `dest`; any other path is any file."""


def completion(shell: str, top: argparse.ArgumentParser) -> int:
    """Print a completion script and return 0.

    Args:
        shell: bash, zsh or fish.
        top: The parser of the command line.
    """
    script = getattr(completion_scripts, shell)(tuple(commands_of(top)))
    tell(shell=shell, script=script)
    say(script, fold=False)
    return 0


def commands_of(top: argparse.ArgumentParser) -> Iterator[Command]:
    """Read the commands of a parser, the nameless one, with the parser's own options, first.

    Args:
        top: The parser.
    """
    (choice,) = (action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    meanings = {action.dest: action.help or "" for action in choice._choices_actions}
    names = tuple(choice.choices)
    yield _command("", "", top)._replace(arguments=(("COMMAND", Value(names)),))
    for name, parser in choice.choices.items():
        yield _command(name, meanings.get(name, ""), parser)


def _command(name: str, meaning: str, parser: argparse.ArgumentParser) -> Command:
    options, arguments, many = [], [], False
    for action in parser._actions:
        if action.option_strings:
            takes = None if action.nargs == 0 else _value(action)
            repeats = isinstance(action, argparse._AppendAction)
            flags = tuple(action.option_strings)
            options.append(Option(flags, _meaning(action), takes, action.nargs == "?", repeats))
        elif not isinstance(action, argparse._SubParsersAction):
            arguments.append((str(action.metavar or action.dest), _value(action)))
            many = action.nargs in ("+", "*")
    return Command(name, meaning, tuple(options), tuple(arguments), many)


def _value(action: argparse.Action) -> Value:
    if action.choices is not None:
        return Value(tuple(str(choice) for choice in action.choices))
    if action.dest == "out" and action.metavar is None:
        return Value(files=FOLDERS)
    return VALUES.get(action.dest, Value(files="" if action.type is Path else None))


def _meaning(action: argparse.Action) -> str:
    return " ".join((action.help or "").split())
