"""The frame of the command line: commands, shared options, mistakes as lines, exit statuses, ``--json``, signals."""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import json
import math
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import click
from click.shell_completion import CompletionItem, shell_complete

import torquebench
from torquebench.cli.terminal import Voice, complain, emit, speaking, voice
from torquebench.errors import ConfigError, Problem, TorquebenchError, did_you_mean, nearest
from torquebench.plain import plain
from torquebench.shipped import config_keys, configs, find_config

PROGRAM = "torquebench"
ENVIRONMENT = "TORQUEBENCH"
"""Prefix of the environment variables that give options their defaults: TORQUEBENCH_RUN_OUT for ``run --out``."""
BAD_INPUT, INTERNAL, INTERRUPTED, TERMINATED = 2, 3, 130, 143
"""Exit statuses of commands that ended early; one that did not returns 0, or 1 where something did not hold."""

COMMANDS = {
    "Experiments": {"run": "legacy", "sweep": "legacy", "paper": "legacy", "boundary-layer": "legacy"},
    "Look": {"report": "legacy", "video": "legacy", "view": "legacy"},
    "Check": {"check": "check", "compare": "compare", "fuzzy": "legacy", "doctor": "doctor", "bench": "bench"},
    "Discover": {"laws": "discover", "show": "discover", "configs": "discover"},
    "Shell": {"completion": "completion"},
}
"""Heading in the help -> command -> the module of this package that has it, under the command's name."""
COMMON = {"--quiet", "--verbose", "--json", "--help"}
"""Options that every command has."""


def mistakes(context: click.Context) -> list[Problem]:
    """Return the list of what is wrong with a command's arguments so far."""
    found: list[Problem] = context.meta.setdefault("torquebench.mistakes", [])
    return found


class _Collected(click.Parameter):
    """A parameter whose bad value does not hide the mistakes in other ones."""

    def handle_parse_result(self, ctx: click.Context, opts: Any, args: list[str]) -> tuple[Any, list[str]]:
        """Convert the value; note what is wrong with it."""
        try:
            return super().handle_parse_result(ctx, opts, args)
        except ConfigError as error:
            mistakes(ctx).extend(error.problems)
        except click.UsageError as error:
            mistakes(ctx).append(Problem(self._place(ctx), "", self._message(ctx, error)))
        return None, args

    def _place(self, ctx: click.Context) -> str:
        name = self.human_readable_name if isinstance(self, click.Argument) else max(self.opts, key=len)
        if ctx.get_parameter_source(self.name or "") is not click.core.ParameterSource.ENVIRONMENT:
            return name
        return f"{name} (from {ctx.auto_envvar_prefix}_{(self.name or '').upper()})"

    def _message(self, ctx: click.Context, error: click.UsageError) -> str:
        if isinstance(error, click.MissingParameter):
            return f"missing: wanted {getattr(self, 'help', None) or 'a value'}"
        return error.message


class Option(_Collected, click.Option):
    """An option of a command."""


class Argument(_Collected, click.Argument):
    """An argument of a command."""


option = functools.partial(click.option, cls=Option)
argument = functools.partial(click.argument, cls=Argument)


class Choice(click.Choice[str]):
    """One of some words; a wrong one is answered with the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if value not in self.choices:
            self.fail(f"got '{value}'{did_you_mean(value, self.choices)}", param, ctx)
        return str(value)


class Number(click.ParamType[float]):
    """A number in a range."""

    name = "number"

    def __init__(self, cast: type[int] | type[float], low: float, high: float | None = None) -> None:
        """Take numbers from `low` to `high`, whole ones if `cast` is int."""
        self.cast, self.low, self.high = cast, low, high

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        what = "a whole number" if self.cast is int else "a number"
        span = f"{what}, {self.low} or more" if self.high is None else f"{what}, {self.low} to {self.high}"
        try:
            number = self.cast(value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and self.low <= number <= (math.inf if self.high is None else self.high)):
            self.fail(f"got '{value}', wanted {span}", param, ctx)
        return number


class Words(click.ParamType[list[str]]):
    """Names separated by commas."""

    name = "names"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[str]:
        """Return the names."""
        return value if isinstance(value, list) else str(value).split(",")


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
        names = [CompletionItem(name) for name in configs() if name.startswith(incomplete)]
        return names + super().shell_complete(ctx, param, incomplete)


class Command(click.Command):
    """A command: its mistakes come all at once, and it has ``--quiet``, ``--json``, ``--verbose`` and an example."""

    def __init__(self, *args: Any, example: str = "", **more: Any) -> None:
        """Add the options that all commands have.

        Args:
            *args: As of click.
            example: The last line of its help.
            **more: As of click.
        """
        more["context_settings"] = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
        super().__init__(*args, **more)
        self.example = example
        self.params += [
            Option(
                ["-q", "--quiet"],
                is_flag=True,
                expose_value=False,
                callback=_into_voice("quiet"),
                help="errors and nothing else; the exit status says the rest",
            ),
            Option(
                ["-v", "--verbose"],
                is_flag=True,
                expose_value=False,
                callback=_into_voice("verbose"),
                help="more: the traceback of an error",
            ),
            Option(
                ["--json"],
                is_flag=True,
                expose_value=False,
                callback=_into_voice("as_json"),
                help="print one JSON document and nothing else",
            ),
        ]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments.

        Raises:
            ConfigError: some are wrong. Unknown options come alone: what else is wrong may be wrong because of them.
        """
        if not ctx.resilient_parsing:
            voice().command = ctx.info_name
            refuse_unknown_options(self, ctx, args)
        ctx.allow_extra_args = True
        try:
            rest = super().parse_args(ctx, args)
        except click.UsageError as error:
            place = getattr(error, "option_name", None) or ctx.command_path
            raise ConfigError([*mistakes(ctx), Problem(place, "", error.message)]) from error
        found = mistakes(ctx) or [
            Problem(ctx.command_path, "", f"got '{word}' as well, one argument too many") for word in rest
        ]
        if found and not ctx.resilient_parsing:
            raise ConfigError(found)
        return rest

    def invoke(self, ctx: click.Context) -> Any:
        """Run it; with --json whatever a plug-in prints is no part of the document."""
        with contextlib.redirect_stdout(sys.stderr) if voice().as_json else contextlib.nullcontext():
            return super().invoke(ctx)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write purpose, usage, arguments, options, and the example as the last line."""
        formatter.write_text(inspect.cleandoc(self.help or ""))
        formatter.write_paragraph()
        self.format_usage(ctx, formatter)
        self.format_arguments(ctx, formatter)
        shown = [
            (param, param.get_help_record(ctx)) for param in self.get_params(ctx) if isinstance(param, click.Option)
        ]
        own = [record for param, record in shown if record and not COMMON & set(param.opts)]
        common = [record for param, record in shown if record and COMMON & set(param.opts)]
        for title, records in (("Options", own), ("Options of every command", common)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
        formatter.write(f"\nExample: {self.example}\n")


def _into_voice(name: str) -> Callable[[click.Context, click.Parameter, bool], None]:
    def keep(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
        if not context.resilient_parsing:
            setattr(voice(), name, bool(value))

    return keep


command = functools.partial(click.command, cls=Command)


def refuse_unknown_options(command: click.Command, context: click.Context, words: Sequence[str]) -> None:
    """Refuse the options that a command does not have; words beside them may be their values.

    Args:
        command: The command.
        context: Its context.
        words: Its arguments.

    Raises:
        ConfigError: there are some; each is named with the option or the key of ``--set`` that may be meant.
    """
    rest, problems = list(words), dict[str, Problem]()
    while True:
        try:
            command.make_parser(context).parse_args(list(rest))
            break
        except click.NoSuchOption as error:
            name = error.option_name
            at = next((i for i, word in enumerate(rest) if _is_option(word, name)), None)
            if at is None:
                problems.setdefault(name, Problem(name, "", error.message))
                break
            word = rest.pop(at)
            value = word.partition("=")[2] or (rest[at] if at < len(rest) and not rest[at].startswith("-") else "")
            near = _setting(command, context, name, value) or _near(command, context, name)
            text = f"{context.command_path} has no such option{near}"
            problems.setdefault(name, Problem(name, "", text))
        except click.UsageError:
            break
    if problems:
        raise ConfigError(problems.values())


def _is_option(word: str, name: str) -> bool:
    if name.startswith("--"):
        return word.partition("=")[0] == name
    return word.startswith("-") and not word.startswith("--") and name[1:] in word


def _flags(command: click.Command, context: click.Context) -> list[str]:
    return [flag for param in command.get_params(context) for flag in param.opts if isinstance(param, click.Option)]


def _near(command: click.Command, context: click.Context, name: str) -> str:
    """Return which option is meant, by its letters alone: all begin with the same dashes."""
    known = [flag for flag in _flags(command, context) if flag.startswith("--")]
    near = nearest(name.lstrip("-"), [flag.lstrip("-") for flag in known])
    return did_you_mean("" if near is None else f"--{near}", known)


def _setting(command: click.Command, context: click.Context, name: str, value: str) -> str:
    """Return the key of ``--set`` that an unknown option is called like, with its value; empty where there is none."""
    if "--set" not in _flags(command, context):
        return ""
    wanted = name.lstrip("-").replace("-", "_")
    with contextlib.suppress(OSError, ValueError):
        keys = [key for key in config_keys() if key.rpartition(".")[2] == wanted]
        first = next((key for key in keys if key.startswith("run.")), keys[0] if keys else None)
        if first is not None:
            return f" (did you mean '--set {first}={value}'?)"
    return ""


class Commands(click.Group):
    """The commands, each imported when it is needed, in groups."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, in the help's order."""
        return [name for names in COMMANDS.values() for name in names]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Import a command."""
        module = next((names[name] for names in COMMANDS.values() if name in names), None)
        if module is None:
            return None
        found: click.Command = getattr(import_module(f"torquebench.cli.{module}"), name.replace("-", "_"))
        return found

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read what stands before the command; nothing at all asks for help.

        Raises:
            ConfigError: an unknown option.
        """
        if not args and not ctx.resilient_parsing:
            args = ["--help"]
        if not ctx.resilient_parsing:
            refuse_unknown_options(self, ctx, args)
        return super().parse_args(ctx, args)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command.

        Raises:
            ConfigError: there is none of this name.
        """
        found = self.get_command(ctx, args[0])
        if found is None and not ctx.resilient_parsing:
            raise ConfigError(
                [Problem("COMMAND", "", f"got '{args[0]}'{did_you_mean(args[0], self.list_commands(ctx))}")]
            )
        return (args[0] if found else None), found, args[1:]

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write purpose, usage, the commands under their headings, options, exit statuses, an example."""
        formatter.write_text(" ".join((self.help or "").partition("\n\n")[0].split()))
        formatter.write_paragraph()
        self.format_usage(ctx, formatter)
        for heading, names in COMMANDS.items():
            with formatter.section(heading):
                rows = [
                    (name, found.get_short_help_str(100)) for name in names if (found := self.get_command(ctx, name))
                ]
                formatter.write_dl(rows, col_max=16)
        self.format_options(ctx, formatter)
        formatter.write_paragraph()
        formatter.write_text(" ".join((self.help or "").partition("\n\n")[2].split()))
        formatter.write("\nExample: torquebench run fig9-chattering\n")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options alone: the commands have been written."""
        click.Command.format_options(self, ctx, formatter)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(torquebench.__version__, "-V", "--version", prog_name=PROGRAM, message="%(prog)s %(version)s")
def app() -> None:
    """Compare torque laws for robot arms on a plant that an analytic model agrees with to round-off.

    Exit status: 0 done and every check held; 1 a run failed unexpectedly or a check did not hold; 2 bad input, nothing
    written; 3 disk or internal error; 130 interrupted; 143 terminated. Defaults of options come from the environment:
    TORQUEBENCH_RUN_OUT is that of run --out.
    """


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
workers = functools.partial(option, "-j", "--workers", metavar="N", type=Number(int, 1, 4096))


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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    if instruction := os.environ.get(f"_{ENVIRONMENT}_COMPLETE"):
        import_module("torquebench.cli.completion")
        return shell_complete(app, {}, PROGRAM, f"_{ENVIRONMENT}_COMPLETE", instruction)
    words, ending = sys.argv[1:] if arguments is None else list(arguments), Ending()
    # what --quiet and --json mean for a mistake in the arguments themselves
    with speaking("--quiet" in words or "-q" in words, "--json" in words) as own:
        status = guarded(lambda: _run(words), ending)
        if not own.as_json:
            return status
        return guarded(lambda: _conclude(status, ending, own), Ending())


def _run(words: list[str]) -> int:
    """Run a line and return its exit status."""
    try:
        with without_opengl() as wish, terminable():
            context = app.make_context(PROGRAM, words, auto_envvar_prefix=ENVIRONMENT, obj=wish)
            with context:
                return int(app.invoke(context) or 0)
    except click.exceptions.Exit as ended:  # help or version, which are no document
        voice().as_json = False
        return ended.exit_code


def _conclude(status: int, ending: Ending, own: Voice) -> int:
    """Print the document of a command that ended with some status; return the status."""
    envelope = {
        "command": own.command,
        "status": status,
        "problems": [problem.to_json() for problem in ending.problems],
        "error": ending.error,
        "remarks": own.remarks,
    }
    emit(json.dumps(plain(envelope | own.facts), indent=2, allow_nan=False))
    return status


@contextlib.contextmanager
def without_opengl() -> Iterator[str | None]:
    """Take MUJOCO_GL out of the environment for as long as this context lasts; yield what it was.

    With it set and its library absent MuJoCo cannot even be imported. Only the processes that draw need it.
    """
    wish = os.environ.pop("MUJOCO_GL", None)
    try:
        yield wish
    finally:
        if wish is not None:
            os.environ["MUJOCO_GL"] = wish


class Terminated(KeyboardInterrupt):
    """SIGTERM has arrived."""


@contextlib.contextmanager
def terminable() -> Iterator[None]:
    """Raise `Terminated` on SIGTERM for as long as this context lasts; in the main thread only, which gets signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_number: int, _frame: FrameType | None) -> NoReturn:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL if before is None else before)


@dataclass
class Ending:
    """How a command ended before its end, for the document of --json."""

    problems: tuple[Problem, ...] = ()
    error: str | None = None


def guarded(work: Callable[[], int], ending: Ending) -> int:
    """Return the exit status of `work`; errors become lines, an exit status, and `ending`."""
    try:
        status = work()
        if sys.stdout is not None:
            sys.stdout.flush()
        return status
    except BrokenPipeError:
        sys.stdout = None  # nobody reads it any more; the interpreter must not complain when it closes it
        return INTERNAL
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the last resort: one line, and where to look
        if voice().verbose:
            complain("".join(traceback.format_exception(error)).rstrip())
        return _ended(error, ending)


def _ended(error: BaseException, ending: Ending) -> int:
    """Say why a command ended early, and return its exit status."""
    if interrupt := interruption(error):
        terminated = isinstance(interrupt, Terminated)
        ending.error = "terminated" if terminated else "interrupted"
        hint = str(interrupt) or "a run directory without manifest.json is unfinished"
        complain(f"torquebench: {ending.error}; {hint}")
        return TERMINATED if terminated else INTERRUPTED
    if isinstance(error, ConfigError):
        ending.problems = error.problems
        for problem in error.problems:
            complain(str(problem))
        return BAD_INPUT
    if isinstance(error, TorquebenchError | OSError):
        ending.error = str(error)
        complain(f"torquebench: {error}")
        drop_broken_output()
        return INTERNAL
    frame = traceback.extract_tb(error.__traceback__)[-1]
    ending.error = f"{type(error).__name__}: {error} ({frame.filename}, line {frame.lineno})"
    complain(f"torquebench: internal error: {ending.error}")
    return INTERNAL


def interruption(error: BaseException) -> KeyboardInterrupt | None:
    """Return the Ctrl-C or SIGTERM that an error comes from, if any.

    Python 3.11 turns one that arrives in a ``__set_name__`` into a RuntimeError, and others may wrap it too.
    """
    seen, rest = set[int](), [error]
    while rest:
        if isinstance(found := rest.pop(), KeyboardInterrupt):
            return found
        if id(found) not in seen:
            seen.add(id(found))
            rest += [other for other in (found.__context__, found.__cause__) if other is not None]
    return None


def drop_broken_output() -> None:
    """Forget standard output if it takes nothing, so that the interpreter does not complain when it closes it."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        sys.stdout = None
