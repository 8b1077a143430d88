"""Files as a user writes them, loaded as a plug-in is: for tests of what is read off their source."""

from __future__ import annotations

import importlib.util
import itertools
import sys
from pathlib import Path
from types import ModuleType

from torquebench.laws.plugin import SourceLoader

COUNT = itertools.count()


def load(folder: Path, text: str, name: str = "") -> ModuleType:
    """Write a Python file and import it, under a name of its own unless one is given."""
    name = name or f"user_file_{next(COUNT)}"
    path = folder / f"{name}.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(name, path, loader=SourceLoader(name, str(path)))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
