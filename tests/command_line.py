"""The commands of the command line, and what a line of one means to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from torquebench.cli.app import app

CONTEXT = app.make_context("torquebench", ["doctor"])
COMMANDS: dict[str, click.Command] = {
    name: found for name in app.list_commands(CONTEXT) if (found := app.get_command(CONTEXT, name)) is not None
}


def parsed(words: Sequence[str]) -> dict[str, Any]:
    """Return what the options and arguments of a line are, `command` among them; ConfigError if it is wrong."""
    name, *rest = words
    context = COMMANDS[name].make_context(name, list(rest), parent=CONTEXT)
    return {"command": name, **context.params}


def flags(name: str) -> list[str]:
    """Return the options of a command."""
    command = COMMANDS[name]
    return [flag for p in command.get_params(CONTEXT) for flag in p.opts if isinstance(p, click.Option)]
