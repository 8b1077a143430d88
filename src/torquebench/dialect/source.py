"""A function of the dialect: its source, where it stands, and what the names in it mean."""

from __future__ import annotations

import ast
import builtins
import linecache
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from types import FunctionType
from typing import Any, Final, NamedTuple

FORM, INPUTS, STATE = "form", "inputs", "state"
"""What a complaint is about: how something is written, a write to something not the function's own, hidden state."""
MISSING: Final = object()
"""What a name means that means nothing."""


class Complaint(NamedTuple):
    """Something that keeps a function out of the dialect."""

    line: int
    what: str
    """What stands there."""
    cure: str
    """What to write instead."""
    topic: str = FORM
    """FORM, INPUTS or STATE."""

    def __str__(self) -> str:
        return f"line {self.line}: {self.what}: {self.cure}"


@dataclass(frozen=True, slots=True)
class Source:
    """A function with its syntax tree."""

    function: FunctionType
    node: ast.FunctionDef
    module: ast.Module
    """The file it stands in, or the notebook's cell."""

    def meaning(self, name: str) -> Any:
        """Return what a name that is not local means when the function runs, or MISSING."""
        code = self.function.__code__
        if name in code.co_freevars and self.function.__closure__ is not None:
            cell = self.function.__closure__[code.co_freevars.index(name)]
            try:
                return cell.cell_contents
            except ValueError:  # not assigned yet
                return MISSING
        if name in self.function.__globals__:
            return self.function.__globals__[name]
        return getattr(builtins, name, MISSING)

    def changes(self, name: str) -> bool:
        """Whether the file can give a name that is not local to this function another value later on."""
        closed = name in self.function.__code__.co_freevars
        scope: ast.AST = _enclosing(self.module, self.node) if closed else self.module
        given = 0
        for node in ast.walk(scope):
            if isinstance(node, ast.Global | ast.Nonlocal) and name in node.names:
                return True
        for node in own_nodes(scope):
            if isinstance(node, ast.For | ast.While | ast.AugAssign) and name in stored(node):
                return True
            given += isinstance(node, ast.Name) and node.id == name and isinstance(node.ctx, ast.Store)
        if closed and isinstance(scope, ast.FunctionDef):
            given += name in parameters(scope)
        return given > 1


def read(function: FunctionType) -> Source | None:
    """Return a function with its syntax tree, or None where its source is not at hand."""
    code = function.__code__
    text = "".join(linecache.getlines(code.co_filename, function.__globals__))
    module = _parsed(text)
    for node in ast.walk(module):
        if isinstance(node, ast.FunctionDef) and node.name == code.co_name:
            if min([node.lineno, *(x.lineno for x in node.decorator_list)]) == code.co_firstlineno:
                return Source(function, node, module)
    return None


@lru_cache(maxsize=256)
def _parsed(text: str) -> ast.Module:
    try:
        return ast.parse(text)
    except SyntaxError:  # the file was changed since it was loaded
        return ast.Module([], [])


def own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Every node that runs when `scope` does: not the bodies of functions and classes in it, not annotations."""
    for field, value in ast.iter_fields(scope):
        if field in ("annotation", "returns", "decorator_list", "args") and not isinstance(scope, ast.Call):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield child
                if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
                    yield from own_nodes(child)


def parameters(node: ast.FunctionDef) -> list[str]:
    """Return the names of a function's parameters."""
    a = node.args
    stars = [x for x in (a.vararg, a.kwarg) if x is not None]
    return [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, *stars)]


def stored(scope: ast.AST) -> set[str]:
    """Return the names that are given a value in `scope`."""
    nodes = (scope, *own_nodes(scope))
    return {x.id for x in nodes if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)}


def body(node: ast.FunctionDef) -> list[ast.stmt]:
    """Return a function's statements without its docstring."""
    return node.body[1:] if ast.get_docstring(node) is not None else node.body


def _enclosing(module: ast.Module, node: ast.FunctionDef) -> ast.AST:
    """Return the innermost function around `node`."""
    around = [x for x in ast.walk(module) if isinstance(x, ast.FunctionDef) and x is not node and node in ast.walk(x)]
    return around[-1] if around else module
