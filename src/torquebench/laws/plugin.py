"""Loading a user's file of laws, metrics or other kinds: only from the command line, never from a config."""

from __future__ import annotations

import contextlib
import importlib.util
import linecache
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import decode_source
from pathlib import Path
from typing import Any

from torquebench.errors import ConfigError, ControllerError, Problem, RegistryError, did_you_mean_path
from torquebench.laws.law import law_names
from torquebench.registry import registered_by, registering_again

PYTHON = r"\.py"
"""Ending of a plug-in's file name, a regular expression."""


class SourceLoader(SourceFileLoader):
    """Runs a file as it is now, read once, and has its lines ready for whoever looks at what was run.

    Stored bytecode may be that of another text of the same size and second, and the file may be another one later.

    Args:
        name: Of the module.
        path: The file.
        text: Its text, where it was read already.
    """

    def __init__(self, name: str, path: str, text: str | None = None) -> None:
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname: str) -> Any:
        """Compile the file's text."""
        path = self.get_filename(fullname)
        text = decode_source(self.get_data(path)) if self._text is None else self._text
        linecache.cache[path] = len(text), None, text.splitlines(keepends=True), path
        return self.source_to_code(text, path)


def load_plugin(path: Path, where: str = "--plugin", text: str | None = None) -> tuple[str, ...]:
    """Run a Python file that registers laws or things of other kinds, and return the names of the laws it added.

    A file that was loaded before is run again, and what it registers now replaces what it registered then.

    Args:
        path: The file; its code runs with the user's rights.
        where: Argument of the command that names it, for messages.
        text: What is run in place of what the file has by now: its text, where that was read already.

    Raises:
        ConfigError: the file cannot be read, raises, or registers nothing.
    """
    name = f"torquebench_plugin_{path.stem.replace('-', '_')}"
    loaded = getattr(sys.modules.get(name), "__file__", None)
    again = loaded is not None and path.exists() and Path(loaded).resolve() == path.resolve()
    with registering_again(name) if again else contextlib.nullcontext():
        return _load(path, where, name, text)


def _load(path: Path, where: str, name: str, text: str | None) -> tuple[str, ...]:
    before = set(law_names())
    try:
        spec = importlib.util.spec_from_file_location(name, path)
        if not path.exists():
            raise ControllerError(f"no such file{did_you_mean_path(path, PYTHON)}")
        if spec is None or spec.loader is None:
            raise ControllerError("not a Python file (wanted a name ending in .py)")
        spec.loader = SourceLoader(name, str(path.absolute()), text)
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # a user's file may raise anything: bad input, not an internal error
        own = isinstance(error, ControllerError | RegistryError)
        message = str(error) if own else f"{type(error).__name__}: {error}"
        raise ConfigError([Problem(where, str(path), message)]) from error
    added = tuple(sorted(set(law_names()) - before))
    if not registered_by(name):
        message = (
            "registers no law, reference, disturbance, chain, plant, metric or figure (wanted a function or class "
        )
        message += "with @controller, @reference, @disturbance, @chain, @plant, @metric or @figure)"
        raise ConfigError([Problem(where, str(path), message)])
    return added
