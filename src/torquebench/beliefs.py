"""Finds, from a law's source alone, the parts of its model that the law reads under given options."""

from __future__ import annotations

import ast
import operator
from collections.abc import Sequence
from functools import lru_cache
from types import FunctionType
from typing import Any

from torquebench.dialect import ARGUMENTS, complaints, definition, is_kernel, plain
from torquebench.laws import Law

GAINS, MODEL = "gains", "model"
UNKNOWN = object()
"""A value that the source does not tell."""
COMPARED = {ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.Gt: operator.gt}


class _Untold(Exception):
    """The source does not tell what is read."""


def fields_read(law: Law, gains: Any) -> frozenset[str] | None:
    """Return the fields of its model that a law may read, scratch space left out; None where that cannot be told.

    The law's source, and that of the kernels that it hands its model to, is followed as the options decide: of a branch
    that depends on them alone, what is not taken is not read. Everything else counts as reached.

    Args:
        law: The law.
        gains: Its gains, as it receives them.
    """
    return _fields_read(law, tuple((name, getattr(gains, name)) for name in law.options))


ABOUT_ORIGIN = {"mass", "com", "inertia"}
"""Fields from which `Model.about_origin` is derived."""


@lru_cache(maxsize=256)
def _fields_read(law: Law, options: tuple[tuple[str, int], ...]) -> frozenset[str] | None:
    if complaints(law):
        return None
    reader = _Reader(dict(options))
    try:
        reader.follow(law.function, dict(zip(ARGUMENTS, (GAINS, MODEL, *[UNKNOWN] * 6), strict=True)))
    except _Untold:
        return None
    found = reader.fields - {"scratch"}
    return frozenset(found | (ABOUT_ORIGIN if "about_origin" in found else set()))


class _Reader:
    """Follows functions in the dialect.

    Args:
        options: Option -> its value, as the law receives it.
    """

    def __init__(self, options: dict[str, int]) -> None:
        self.options = options
        self.fields: set[str] = set()
        """Fields of the model that may be read."""
        self._seen: set[tuple[Any, ...]] = set()
        self._function: Any = None
        self._known: dict[str, Any] = {}

    def follow(self, function: Any, arguments: dict[str, Any]) -> None:
        """Follow one function; each argument is `GAINS`, `MODEL`, a number, or `UNKNOWN`."""
        function = plain(function)
        call = function, *arguments.items()
        if call in self._seen:
            return
        self._seen.add(call)
        node = definition(function) if isinstance(function, FunctionType) else None
        if node is None:
            raise _Untold
        stored = {x.id for x in ast.walk(node) if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)}
        if any(arguments[name] in (GAINS, MODEL) for name in stored & arguments.keys()):
            raise _Untold
        before, self._function = (self._function, self._known), function
        self._known = {name: value for name, value in arguments.items() if name not in stored}
        self._block(node.body)
        self._function, self._known = before

    def _block(self, body: Sequence[ast.stmt]) -> bool:
        """Follow statements; true if they certainly return."""
        for statement in body:
            match statement:
                case ast.If():
                    self._read(statement.test)
                    test = self._value(statement.test)
                    taken = [statement.body, statement.orelse] if test is UNKNOWN else []
                    if all([self._block(branch) for branch in taken or [statement.body if test else statement.orelse]]):
                        return True
                case ast.For() | ast.While():
                    self._read(statement.iter if isinstance(statement, ast.For) else statement.test)
                    self._block(statement.body)
                    self._block(statement.orelse)
                case ast.Return():
                    self._read(statement)
                    return True
                case _:
                    self._read(statement)
        return False

    def _read(self, node: ast.AST) -> None:
        """Note what an expression, or a statement without others in it, reads."""
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute) if self._known.get(name) is MODEL:
                self.fields.add(attribute)
            case ast.Name(id=name) if self._known.get(name) is MODEL:
                raise _Untold
            case ast.BoolOp():
                for operand in node.values:
                    self._read(operand)
                    value = self._value(operand)
                    if value is not UNKNOWN and bool(value) is isinstance(node.op, ast.Or):
                        break
            case ast.IfExp():
                self._read(node.test)
                test = self._value(node.test)
                for branch in [node.body, node.orelse] if test is UNKNOWN else [node.body if test else node.orelse]:
                    self._read(branch)
            case ast.Call(func=ast.Name(id=name)) if is_kernel(self._function.__globals__.get(name)):
                kernel: Any = plain(self._function.__globals__[name])
                names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
                if node.keywords or len(names) != len(node.args):
                    raise _Untold
                values = [self._value(argument) for argument in node.args]
                for argument, value in zip(node.args, values, strict=True):
                    if value is not MODEL:
                        self._read(argument)
                if any(value is MODEL for value in values):
                    self.follow(kernel, dict(zip(names, values, strict=True)))
            case _:
                for part in ast.iter_child_nodes(node):
                    self._read(part)

    def _value(self, node: ast.expr) -> Any:
        """Return `GAINS`, `MODEL`, or the number that an expression has under the options; else `UNKNOWN`."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return number
            case ast.Name(id=name) if name in self._known:
                return self._known[name]
            case ast.Name(id=name) if name not in self._function.__code__.co_varnames:
                value = self._function.__globals__.get(name)
                return value if isinstance(value, int | float) else UNKNOWN
            case ast.Attribute(value=ast.Name(id=name), attr=option) if self._known.get(name) is GAINS:
                return self.options.get(option, UNKNOWN)
            case ast.UnaryOp(op=ast.Not(), operand=inside):
                value = self._value(inside)
                return UNKNOWN if value is UNKNOWN else not value
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in COMPARED:
                both = self._value(left), self._value(right)
                if all(isinstance(value, int | float) for value in both):
                    return COMPARED[type(op)](*both)
        return UNKNOWN
