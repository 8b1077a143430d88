"""The package's source as syntax trees, for the tests that hold its architecture and its manners."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1] / "src" / "torquebench"
FILES = {path.relative_to(SOURCE).as_posix(): path for path in sorted(SOURCE.rglob("*.py"))}
ALL = sorted(FILES)


@cache
def tree_of(name: str) -> ast.Module:
    """The syntax tree of a file of the package, read when the first test asks."""
    return ast.parse(FILES[name].read_text(encoding="utf-8"))


def imports(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Every module that a file imports, wherever in the file, and the line; names of submodules are resolved."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the direction"
            base = node.module or ""
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield (full if is_module(full) else base), node.lineno


def is_module(dotted: str) -> bool:
    """Whether a dotted name is a module or package of ours."""
    path = "/".join(dotted.split(".")[1:])
    return dotted.startswith("torquebench.") and (f"{path}.py" in FILES or f"{path}/__init__.py" in FILES)
