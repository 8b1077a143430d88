"""What kind of value each variable and each expression of a function has: number, array, structure."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from torquebench.dialect.grammar import Grammar
from torquebench.dialect.names import plain
from torquebench.dialect.source import own_nodes
from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import is_structure, layout

INTEGERS_FROM = ("floor", "isfinite", "isnan")
"""Functions of `math` that return integers, or True and False."""


class Kind(NamedTuple):
    """The kind of a value."""

    name: str
    """``int``, ``float``, ``mixed`` (one or the other), ``array``, ``element`` (of an array whose dimensions are not
    known: a number, or a row), ``structure`` or ``unknown``."""
    detail: Any = None
    """Of an array or an element: the dimensions, if known, and the kind of the numbers; of a structure: its class."""


INT, FLOAT, MIXED, UNKNOWN = Kind("int"), Kind("float"), Kind("mixed"), Kind("unknown")
NUMBERS = (INT, FLOAT, MIXED)


def of_hint(hint: Any, dimensions: int = 1) -> Kind:
    """Return the kind that an annotation states."""
    if hint in (int, bool):
        return INT
    if hint is float:
        return FLOAT
    if hint == Array or hint == IntArray:
        return Kind("array", (dimensions, FLOAT if hint == Array else INT))
    return Kind("structure", hint) if is_structure(hint) else UNKNOWN


class Kinds:
    """The kinds of a function's variables, found by following its assignments.

    Args:
        grammar: The function, read.
        given: Kinds of parameters, where they are known.
    """

    def __init__(self, grammar: Grammar, given: Mapping[str, Kind]) -> None:
        self.grammar = grammar
        self.kinds: dict[str, Kind] = dict(given)
        self.integer_at: dict[str, int] = {}
        """Where a variable is first given an integer."""
        nodes = list(own_nodes(grammar.source.node))
        for _ in range(8):  # a variable made from others is known once they are
            before = dict(self.kinds)
            for node in nodes:
                self.follow(node)
            if self.kinds == before:
                break

    def follow(self, node: ast.AST) -> None:
        """Take in what an assignment says about its variables."""
        match node:
            case ast.Assign():
                for target in node.targets:
                    self.bind(target, node.value)
            case ast.AnnAssign(value=ast.expr() as value):
                self.bind(node.target, value)
            case ast.AugAssign(target=ast.Name(id=name)):
                self.join(name, self.arithmetic(node.op, self.of(node.target), self.of(node.value)), node.lineno)
            case ast.For(target=ast.Name(id=name)):
                self.join(name, INT, node.lineno)

    def bind(self, target: ast.expr, value: ast.expr) -> None:
        """Take in that a variable, or several, are given a value."""
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
            for t, v in zip(target.elts, value.elts, strict=True):
                self.bind(t, v)
        elif isinstance(target, ast.Tuple):
            for t in target.elts:
                if isinstance(t, ast.Name):
                    self.kinds[t.id] = UNKNOWN
        elif isinstance(target, ast.Name):
            self.join(target.id, self.of(value), target.lineno)

    def join(self, name: str, kind: Kind, line: int) -> None:
        """Take in that a variable may be of a kind."""
        if kind == INT:
            self.integer_at.setdefault(name, line)
        self.kinds[name] = either(self.kinds[name], kind) if name in self.kinds else kind

    def of(self, node: ast.expr) -> Kind:
        """Return the kind of an expression."""
        match node:
            case ast.Constant():
                return FLOAT if type(node.value) is float else INT if type(node.value) in (int, bool) else UNKNOWN
            case ast.Name():
                value = self.grammar.value(node)
                known = FLOAT if type(value) is float else INT if type(value) in (int, bool) else UNKNOWN
                return self.kinds.get(node.id, known)
            case ast.Attribute():
                return self.attribute(node)
            case ast.Subscript():
                kind = self.of(node.value)
                if kind.name not in ("array", "element"):
                    return UNKNOWN
                if kind.detail[0] is None:
                    return Kind("element", kind.detail)
                left = kind.detail[0] - (len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1)
                return Kind("array", (left, kind.detail[1])) if left > 0 else kind.detail[1]
            case ast.BinOp():
                return self.arithmetic(node.op, self.of(node.left), self.of(node.right))
            case ast.UnaryOp():
                return INT if isinstance(node.op, ast.Not) else self.of(node.operand)
            case ast.BoolOp():
                kinds = [self.of(value) for value in node.values]
                return kinds[0] if all(kind == kinds[0] for kind in kinds) else either(*kinds[:2])
            case ast.Compare():
                return INT
            case ast.IfExp():
                return either(self.of(node.body), self.of(node.orelse))
            case ast.Call():
                return self.result(node)
        return UNKNOWN

    def attribute(self, node: ast.Attribute) -> Kind:
        """Return the kind of an attribute."""
        owner, value = self.of(node.value), self.grammar.value(node)
        if type(value) is float:
            return FLOAT
        if owner.name != "structure":
            return UNKNOWN
        try:
            field = layout(owner.detail)[0].get(node.attr)
        except (TypeError, NameError):  # which the law's own check reports
            return UNKNOWN
        if field is None:
            return UNKNOWN
        if field.dimensions:
            return Kind("array", (field.dimensions, FLOAT if field.kind is np.float64 else INT))
        return of_hint(field.kind)

    def result(self, node: ast.Call) -> Kind:
        """Return the kind of what a call gives."""
        function = self.grammar.value(node.func)
        if function is len:
            return INT
        if function is abs and node.args:
            return self.of(node.args[0])
        if getattr(function, "__module__", "") == "math":
            return INT if function.__name__ in INTEGERS_FROM else FLOAT
        return of_hint(hints_of(plain(function)).get("return")) if hasattr(plain(function), "__code__") else UNKNOWN

    def arithmetic(self, operator: ast.operator, a: Kind, b: Kind) -> Kind:
        """Return the kind of what an operator makes of two values."""
        if "array" in (a.name, b.name):
            return a if a.name == "array" else b
        a, b = number(a), number(b)
        if isinstance(operator, ast.Div) and a in NUMBERS and b in NUMBERS:
            return FLOAT
        if a in NUMBERS and b in NUMBERS:
            return FLOAT if FLOAT in (a, b) else MIXED if MIXED in (a, b) else INT
        return UNKNOWN


def either(a: Kind, b: Kind) -> Kind:
    """Return the kind of a value that may be of one kind or of another."""
    if a == b:
        return a
    a, b = number(a), number(b)
    return a if a == b else MIXED if a in NUMBERS and b in NUMBERS else UNKNOWN


def number(kind: Kind) -> Kind:
    """Return the kind of an element that is a number."""
    return kind.detail[1] if kind.name == "element" else kind


def hints_of(function: Any) -> dict[str, Any]:
    """Return a function's annotations, as far as they mean something."""
    try:
        return get_type_hints(function)
    except (NameError, TypeError, AttributeError, SyntaxError):
        return {}
