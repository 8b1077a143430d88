"""The frame of the command line: its commands, mistakes as lines, exit statuses, ``--json``, signals."""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import json
import keyword
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import FrameType
from typing import Any, NoReturn

import click
from click.shell_completion import shell_complete

import torquebench
from torquebench.begun import BEGUN
from torquebench.cli.parameters import Option, mistakes, refuse, suggest
from torquebench.cli.terminal import Voice, beating, complain, emit, speaking, voice, warn
from torquebench.errors import UNCHECKED, ConfigError, Problem, TorquebenchError, nearest
from torquebench.plain import plain
from torquebench.shipped import config_keys

PROGRAM = "torquebench"
ENVIRONMENT = "TORQUEBENCH"
"""Prefix of the environment variables that give options their defaults: TORQUEBENCH_RUN_OUT for ``run --out``."""

BAD_INPUT, INTERNAL, INTERRUPTED, UNREAD, TERMINATED = 2, 3, 130, 141, 143
"""Exit statuses of commands that ended early; one that did not returns 0, or 1 where something did not hold."""

COMMANDS = {
    "Experiments": {
        "run": "run",
        "sweep": "sweep",
        "audit": "audit",
        "paper": "audit",
        "tune": "tune",
        "falsify": "falsify",
        "arena": "arena",
        "why": "why",
    },
    "Arms and laws": {"import": "importing", "new-law": "new_law"},
    "Look": {"report": "report", "figures": "figures", "video": "video", "view": "view"},
    "Check": {
        "check": "check",
        "preflight": "preflight",
        "compare": "compare",
        "diff": "diff",
        "fuzzy": "fuzzy",
        "doctor": "doctor",
        "bench": "bench",
        "trust": "trust",
    },
    "Discover": {"laws": "discover", "chains": "discover", "show": "discover", "configs": "discover"},
    "Shell": {"completion": "completion"},
}
"""Heading in the help -> command -> the module of this package that has it, under the command's name."""

SHARED = {
    "quiet": (["-q", "--quiet"], "errors and nothing else; the exit status says the rest"),
    "verbose": (["-v", "--verbose"], "say more: which path was taken, the traceback of an error"),
    "as_json": (["--json"], "print one JSON document and nothing else"),
}
"""What every command has, besides ``--help``: field of `Voice` -> option and help."""
HELP = {"help_option_names": ["-h", "--help"], "max_content_width": 110}
"""How click makes the help."""


class Command(click.Command):
    """A command: its mistakes come all at once, it has the options of `SHARED`, and its help ends with an example."""

    def __init__(self, name: str | None, *, example: str = "", **more: Any) -> None:
        """Add the shared options.

        Args:
            *args: For click.
            name: Its name.
            example: The last line of the help.
            **more: For click.
        """
        super().__init__(name, context_settings=HELP, **more)
        self.example = example
        for field, (flags, text) in SHARED.items():
            keep = functools.partial(_keep, field)
            self.params.append(Option(flags, is_flag=True, expose_value=False, callback=keep, help=text))
        for param in self.params:
            if isinstance(param, click.Option):
                flag = max(param.opts, key=len).lstrip("-")
                param.envvar = f"{ENVIRONMENT}_{name}_{flag}".replace("-", "_").upper()

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
            raise ConfigError([*mistakes(ctx), Problem(place, text=error.message)]) from error
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
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        own, shared = list[tuple[str, str]](), list[tuple[str, str]]()
        for param in options:
            if record := param.get_help_record(ctx):
                (own if param.expose_value and not param.is_eager else shared).append(record)
        for title, records in (("Options", own), ("Options of every command", shared)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
        formatter.write(f"\nExample: {self.example}\n")


def _keep(name: str, context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if not context.resilient_parsing:
        setattr(voice(), name, bool(value))


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
                problems.setdefault(name, Problem(name, text=error.message))
                break
            word = rest.pop(at)
            value = word.partition("=")[2] or (rest[at] if at < len(rest) and not rest[at].startswith("-") else "")
            near = _setting(command, context, name, value) or _near(command, context, name)
            problems.setdefault(name, Problem(name, text=f"{context.command_path} has no such option", **near))
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


def _near(command: click.Command, context: click.Context, name: str) -> dict[str, Any]:
    """Return which option is meant, by its letters alone: all begin with the same dashes."""
    known = [flag for flag in _flags(command, context) if flag.startswith("--")]
    near = nearest(name.lstrip("-"), [flag.lstrip("-") for flag in known])
    return {"nearest": f"--{near}"} if near else {"wanted": f"one of: {', '.join(known)}"}


def _setting(command: click.Command, context: click.Context, name: str, value: str) -> dict[str, Any]:
    """Return the key of ``--set`` that an unknown option is called like, with its value; empty where there is none."""
    if "--set" not in _flags(command, context):
        return {}
    wanted = name.lstrip("-").replace("-", "_")
    with contextlib.suppress(OSError, ValueError):
        keys = [key for key in config_keys() if key.rpartition(".")[2] == wanted]
        first = next((key for key in keys if key.startswith("run.")), keys[0] if keys else None)
        if first is not None:
            return {"nearest": f"--set {first}={value}"}
    return {}


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
        attribute = name.replace("-", "_") + "_" * keyword.iskeyword(name)
        found: click.Command = getattr(import_module(f"torquebench.cli.{module}"), attribute)
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
            refuse([Problem("COMMAND", got=f"'{args[0]}'", **suggest(args[0], self.list_commands(ctx)))])
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


@click.group(cls=Commands, context_settings=HELP)
@click.version_option(torquebench.__version__, "-V", "--version", prog_name=PROGRAM, message="%(prog)s %(version)s")
def app() -> None:
    """Compare torque laws for robot arms on a plant that an analytic model agrees with to round-off.

    Exit status: 0 done and every check held; 1 a run failed unexpectedly or a check did not hold; 2 bad input, nothing
    written; 3 disk or internal error; 130 interrupted; 141 nobody reads the output; 143
    terminated. Defaults of options come from the environment: TORQUEBENCH_RUN_OUT is that of run --out.
    """


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
    """Run a line, seen to work on a terminal, and return its exit status."""
    name = next((word for word in words if not word.startswith("-")), "")
    try:
        with without_opengl() as wish, terminable(), beating(f"{PROGRAM} {name}".rstrip()):
            context = app.make_context(PROGRAM, words, obj=wish)
            with context, logged():
                return int(app.invoke(context) or 0)
    except click.exceptions.Exit as ended:  # help or version, which are no document
        voice().as_json = False
        return ended.exit_code


@contextlib.contextmanager
def logged() -> Iterator[None]:
    """Warn of what the package logs for as long as this context lasts."""
    import logging

    class Warner(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            warn(f"torquebench: {record.getMessage()}")

    log, handler = logging.getLogger("torquebench"), Warner()
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)


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
    """Mistakes or error that ended a command early, for the document of --json."""

    problems: tuple[Problem, ...] = ()
    error: str | None = None


def guarded(work: Callable[[], int], ending: Ending) -> int:
    """Return the exit status of `work`; errors become lines, an exit status, and `ending`."""
    BEGUN.clear()
    try:
        status = work()
        if sys.stdout is not None:
            sys.stdout.flush()
        return status
    except (BrokenPipeError, SystemExit) as error:
        if not isinstance(error, BrokenPipeError) and not isinstance(error.__context__, BrokenPipeError):
            raise  # rich makes a SystemExit of a pipe that is closed
        sys.stdout = None  # nobody reads it any more; the interpreter must not complain when it closes it
        return UNREAD
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001  the last resort: one line, and where to look
        return _ended(error, ending)


def _ended(error: BaseException, ending: Ending) -> int:
    """Say why a command ended early, and return its exit status."""
    if interrupt := interruption(error):
        terminated = isinstance(interrupt, Terminated)
        ending.error = "terminated" if terminated else "interrupted"
        hint = str(interrupt) or ", ".join(f"{folder} is unfinished" for folder in BEGUN)
        complain(f"torquebench: {ending.error}{f'; {hint}' if hint else ''}")
        return TERMINATED if terminated else INTERRUPTED
    if isinstance(error, ConfigError):
        ending.problems = error.problems
        for problem in error.problems:
            complain(str(problem))
        if error.unchecked:
            voice().remarks.append(UNCHECKED)
            complain(UNCHECKED)
        return BAD_INPUT
    if voice().verbose:
        complain("".join(traceback.format_exception(error)).rstrip())
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
