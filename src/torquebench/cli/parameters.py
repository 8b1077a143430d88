"""Options and arguments of commands: their types, those that many share, and the report of all mistakes at once."""

from __future__ import annotations

import contextlib
import functools
import json
import math
import os
import sys
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from torquebench.errors import ConfigError, Problem, nearest
from torquebench.shipped import configs, find_config, shipped_names


class Wrong(click.BadParameter):
    """A value that an option or argument does not take; `parts` are a `Problem`'s: text, got, wanted, nearest."""

    def __init__(self, **parts: Any) -> None:
        super().__init__(str(parts))
        self.parts = parts


def suggest(name: str, valid: Collection[str]) -> dict[str, Any]:
    """Return what a problem with a name says of the valid ones: the nearest, or all where none is near.

    Args:
        name: What the user wrote.
        valid: Names that would have been accepted.
    """
    near = nearest(name, valid)
    return {"nearest": near} if near else {"wanted": f"one of: {', '.join(valid)}"} if valid else {}


def mistakes(context: click.Context) -> list[Problem]:
    """Return the list of what is wrong with a command's arguments so far."""
    found: list[Problem] = context.meta.setdefault("torquebench.mistakes", [])
    return found


class _CollectsMistakes(click.Parameter):
    """A parameter whose bad value does not hide the mistakes in other ones."""

    def handle_parse_result(self, ctx: click.Context, opts: Any, args: list[str]) -> tuple[Any, list[str]]:
        """Convert the value; note what is wrong with it."""
        try:
            return super().handle_parse_result(ctx, opts, args)
        except ConfigError as error:
            mistakes(ctx).extend(error.problems)
        except Wrong as error:
            mistakes(ctx).append(Problem(self._place(ctx), **error.parts))
        except click.MissingParameter:
            mistakes(ctx).append(Problem(self._place(ctx), text="missing", wanted=getattr(self, "help", None) or ""))
        except click.UsageError as error:
            mistakes(ctx).append(Problem(self._place(ctx), text=error.message))
        return None, args

    def _place(self, ctx: click.Context) -> str:
        name = self.human_readable_name if isinstance(self, click.Argument) else max(self.opts, key=len)
        if ctx.get_parameter_source(self.name or "") is not click.core.ParameterSource.ENVIRONMENT:
            return name
        return f"{name} (from {self.envvar})"


class Option(_CollectsMistakes, click.Option):
    """An option of a command."""


class Argument(_CollectsMistakes, click.Argument):
    """An argument of a command."""


option = functools.partial(click.option, cls=Option)


argument = functools.partial(click.argument, cls=Argument)


class Choice(click.Choice[str]):
    """One of some words; a wrong one is answered with the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if value not in self.choices:
            raise Wrong(got=f"'{value}'", **suggest(value, self.choices))
        return str(value)


class Number(click.ParamType[float]):
    """A number in a range."""

    name = "number"

    def __init__(self, cast: type[int] | type[float], low: float | None = None, high: float | None = None) -> None:
        """Take numbers from `low`, any if it is None, to `high`; whole ones if `cast` is int."""
        self.cast, self.low, self.high = cast, low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        span = f"{self.low} or more" if self.high is None else f"{self.low} to {self.high}"
        try:
            number = self.cast(value)
        except ValueError:
            what = "a whole number" if self.cast is int else "a number"
            wanted = what if self.low is None else f"{what}, {span}"
            raise Wrong(got=f"'{value}'", wanted=wanted) from None
        if self.low is not None and not self.low <= number <= (sys.float_info.max if self.high is None else self.high):
            raise Wrong(got=str(value), wanted=span)
        return number


class Numbers(click.ParamType[list[float]]):
    """Numbers separated by commas."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[float]:
        """Return the numbers."""
        if isinstance(value, list):
            return value
        with contextlib.suppress(ValueError):
            found = [float(word) for word in str(value).split(",")]
            if all(map(math.isfinite, found)):
                return found
        raise Wrong(got=f"'{value}'", wanted="numbers separated by commas, such as 6.5,9.8")


class Words(click.ParamType[list[str]]):
    """Names separated by commas."""

    name = "names"

    def __init__(self, choices: Sequence[str] = ()) -> None:
        """Take any names, or only some; a wrong one is answered with the nearest."""
        self.choices = choices

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[str]:
        """Return the names."""
        words = value if isinstance(value, list) else str(value).split(",")
        for word in words:
            if self.choices and word not in self.choices:
                raise Wrong(got=f"'{word}'", **suggest(word, self.choices))
        return words

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin as typed after the last comma."""
        before, comma, begun = incomplete.rpartition(",")
        return [CompletionItem(before + comma + word) for word in self.choices if word.startswith(begun)]


class File(click.Path):
    """A file or folder; completion offers those with one of some endings, or folders alone."""

    def __init__(self, *endings: str, folders: bool = False) -> None:
        """Offer files that end in one of `endings`, all without any; no files if only `folders` are wanted."""
        super().__init__(path_type=Path)
        self.endings, self.folders = endings, folders

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return paths that begin as typed, folders with a slash."""
        folder, _, begun = incomplete.rpartition("/")
        base = Path(f"{folder}/" if "/" in incomplete else ".")
        found = []
        with contextlib.suppress(OSError):
            for path in sorted(base.iterdir()):
                hidden = path.name.startswith(".") and not begun.startswith(".")
                wanted = not self.folders and (not self.endings or path.name.endswith(self.endings))
                if path.name.startswith(begun) and not hidden and (path.is_dir() or wanted):
                    shown = (f"{folder}/" if "/" in incomplete else "") + path.name
                    found.append(CompletionItem(shown + "/" * path.is_dir()))
        return found


class Config(File):
    """A config: a YAML file, or the name of one that comes with the package."""

    def __init__(self) -> None:
        """Offer YAML files and shipped configs."""
        super().__init__(".yaml", ".yml")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return its path; that there is none is said before anything large is imported."""
        return find_config(str(value))

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return names of shipped configs, and files."""
        known = shipped_names() if "/" in incomplete else configs()
        names = [CompletionItem(name) for name in known if name.startswith(incomplete)]
        return names + super().shell_complete(ctx, param, incomplete)


def _complete_settings(context: click.Context, _parameter: click.Parameter, typed: str) -> list[CompletionItem]:
    from torquebench.cli.completion import keys_for

    return [CompletionItem(f"{key}=") for key in keys_for(context) if key.startswith(typed)]


out_folder = functools.partial(option, "-o", "--out", type=File(folders=True), metavar="DIR")


out_file = functools.partial(option, "-o", "--out", type=File(), metavar="FILE")


plugins = option(
    "-p",
    "--plugin",
    type=File(".py"),
    multiple=True,
    metavar="FILE",
    help="Python file that registers laws of your own with @controller; may be given several times",
)


settings = functools.partial(
    option, "-s", "--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=_complete_settings
)


model = option(
    "--model",
    type=File(".xml", ".urdf"),
    metavar="ARM",
    help="another arm than the config's: an MJCF or URDF file anywhere, or a name",
)


allow_outside = option("--allow-outside", is_flag=True, help="let the config name an arm's file outside its own folder")


def with_arm(overrides: Iterable[str], arm: Path | None) -> tuple[str, ...]:
    """Return changes of keys, with that of the arm where one is given."""
    if arm is None:
        return tuple(overrides)
    from torquebench.experiment.source import OptionChange

    return (*overrides, OptionChange(f"plant.model={json.dumps(str(arm))}", "--model", str(arm)))


workers = functools.partial(option, "-j", "--workers", metavar="N", type=Number(int, 1, 4096))


def refuse(problems: Iterable[Problem | tuple[str, str]]) -> None:
    """Refuse a command's arguments if anything is wrong with them.

    Args:
        problems: Mistakes; or option or argument, and what is wrong with it.

    Raises:
        ConfigError: there are some.
    """
    if found := [one if isinstance(one, Problem) else Problem(one[0], text=one[1]) for one in problems]:
        raise ConfigError(found)


def check_out(path: Path | None) -> None:
    """Refuse a file that cannot be written.

    Raises:
        ConfigError: it is a folder, or its own folder is not there or must not be written to.
    """
    if path is None:
        return
    if path.is_dir():
        refuse([Problem("--out", text=f"{path} is a folder", wanted="a file")])
    if not path.parent.is_dir():
        refuse([("--out", f"{path.parent} is not a folder")])
    if not os.access(path.parent, os.W_OK):
        refuse([("--out", f"{path.parent} must not be written to")])
