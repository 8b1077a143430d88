"""What all commands' arguments have in common: the parser, --quiet and --json, examples, and how values are read."""

from __future__ import annotations

import argparse
import itertools
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from torquebench.cli.terminal import warn
from torquebench.errors import ConfigError, Problem, did_you_mean, nearest

EXAMPLES = {
    "run": "torquebench run configs/paper/fig9-chattering.yaml --set run.duration=2",
    "compare": "torquebench compare mujoco:puma560 analytic:puma560 --rollout 5",
    "fuzzy": "torquebench fuzzy pd-49",
    "sweep": "torquebench sweep configs/sweep.yaml --dry-run",
    "paper": "torquebench paper --quick",
    "report": "torquebench report runs/one runs/two --out both.html",
    "view": "torquebench view runs/one --browser",
    "video": "torquebench video runs/one --speed 0.5",
    "check": "torquebench check my_law.py",
    "bench": "torquebench bench --quick --json",
    "doctor": "torquebench doctor",
    "completion": "torquebench completion bash > ~/.local/share/bash-completion/completions/torquebench",
}
"""The last line of each command's help."""
EXAMPLE = "Example: "


class Help(argparse.HelpFormatter):
    """Help whose examples are lines to copy, however narrow the terminal."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith(EXAMPLE) else super()._fill_text(text, width, indent)


class Parser(argparse.ArgumentParser):
    """An argument parser whose complaints are problems like all others."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**{"formatter_class": Help} | more)

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments.

        Raises:
            ConfigError: always.
        """
        warn(self.format_usage().rstrip())
        found = re.fullmatch(r"argument (\S+?)(?:/\S+)?: (.*)", message, flags=re.DOTALL)
        where, what = found.groups() if found else (self.prog, message)
        raise ConfigError([Problem(where, "", what)])

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Read arguments as `argparse` does; what this command does not know is refused here, not by its caller.

        Raises:
            ConfigError: bad arguments. Unknown options come first: what else is wrong may be wrong because of them.
        """
        self._refuse([word for word in self._own_words(args) if word.startswith("--") and not self._knows(word)])
        found, extra = super().parse_known_args(args, namespace)
        self._refuse(extra)
        return found, extra

    def _own_words(self, words: Sequence[str]) -> Iterator[str]:
        """Yield the words that may be options of this command, not of one that is named by the first that is none."""
        return itertools.takewhile(lambda word: word.startswith("-") if self._subparsers else word != "--", words)

    def _long_options(self) -> list[str]:
        return [flag for action in self._actions for flag in action.option_strings if flag.startswith("--")]

    def _knows(self, word: str) -> bool:
        """Whether `argparse` takes a word for an option, perhaps abbreviated, or, because of a space, for a value."""
        name = word.partition("=")[0]
        return " " in name or any(flag.startswith(name) for flag in self._long_options())

    def _near(self, name: str) -> str:
        """Return which option was meant, by its letters alone: all begin with the same dashes."""
        known = self._long_options()
        near = nearest(name.lstrip("-"), [flag.lstrip("-") for flag in known])
        return did_you_mean("" if near is None else f"--{near}", known)

    def _refuse(self, words: Sequence[str]) -> None:
        """Refuse words of no known meaning, if there are any; those beside an unknown option may be its value."""
        names = [word.partition("=")[0] for word in words if word.startswith("-")]
        problems = [
            Problem(name, "", f"{self.prog} has no such option{self._near(name)}") for name in dict.fromkeys(names)
        ] or [Problem(self.prog, "", f"got '{word}' as well, one argument too many") for word in words]
        if problems:
            warn(self.format_usage().rstrip())
            raise ConfigError(problems)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"got '{value}'{did_you_mean(value, action.choices)}")


def add_common(commands: Mapping[str, argparse.ArgumentParser]) -> None:
    """Give every command --quiet, --json and its example.

    Args:
        commands: Name -> parser.
    """
    for name, command in commands.items():
        command.add_argument(
            "--quiet", action="store_true", help="errors and nothing else; the exit status says the rest"
        )
        if name == "bench":
            command.add_argument(
                "--json",
                nargs="?",
                const=True,
                default=False,
                type=Path,
                metavar="FILE",
                help="print one JSON document and nothing else; with FILE, write the rows there and print the table",
            )
        else:
            command.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
        if name in EXAMPLES:
            command.epilog = EXAMPLE + EXAMPLES[name]


def check_out(path: Path | None) -> None:
    """Refuse a file that cannot be written.

    Raises:
        ConfigError: it is a folder, or its own folder is not there or must not be written to.
    """
    if path is None:
        return
    if path.is_dir():
        raise ConfigError([Problem("--out", "", f"{path} is a folder, wanted a file")])
    if not path.parent.is_dir():
        raise ConfigError([Problem("--out", "", f"{path.parent} is not a folder")])
    if not os.access(path.parent, os.W_OK):
        raise ConfigError([Problem("--out", "", f"{path.parent} must not be written to")])


def frame_size(text: str) -> tuple[int, int]:
    """Read the size of a frame."""
    found = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted WIDTHxHEIGHT, for example 640x480")
    return int(found[1]), int(found[2])


def name_list(text: str) -> list[str]:
    """Read names separated by commas."""
    return text.split(",")


def joint_list(text: str) -> list[int]:
    """Read joint numbers separated by commas."""
    try:
        return [int(word) for word in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted joint numbers separated by commas") from error
