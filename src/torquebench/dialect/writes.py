"""What a function writes to: the places, among those that its parameters name, whose elements it may change."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from types import FunctionType
from typing import Any, NamedTuple

from torquebench.dialect.grammar import Grammar
from torquebench.dialect.names import plain
from torquebench.dialect.source import Source, own_nodes, parameters, read


class Place(NamedTuple):
    """Part of an argument: ``model.scratch.matrix`` is parameter 1, attributes ``scratch, matrix``."""

    parameter: int
    attributes: tuple[str, ...]


class Write(NamedTuple):
    """A place that is written to, and where in the source."""

    line: int
    place: Place | None
    """None for something that is no part of an argument."""
    how: str


class Writes:
    """What functions write to; remembers what each kernel does.

    A place is found by following names: through assignments, attributes, elements and calls of kernels. Where a name
    may stand for several places, it stands for all of them.
    """

    def __init__(self) -> None:
        self._known: dict[FunctionType, list[Write]] = {}

    def of(self, source: Source, grammar: Grammar) -> list[Write]:
        """Return the writes of a function in the order of its text.

        Args:
            source: The function.
            grammar: The same, read.
        """
        function = source.function
        if function not in self._known:
            self._known[function] = []  # a function that calls itself
            self._known[function] = list(self._find(source, grammar))
        return self._known[function]

    def _find(self, source: Source, grammar: Grammar) -> Iterator[Write]:
        names: dict[str, set[Place]] = {name: {Place(i, ())} for i, name in enumerate(parameters(source.node))}
        nodes = list(own_nodes(source.node))
        for _ in range(len(nodes)):  # until nothing is added; a name is followed through at most one more per round
            before = sum(map(len, names.values()))
            for node in nodes:
                if isinstance(node, ast.Assign):
                    for target in node.targets:
                        _bind(target, node.value, names)
                elif isinstance(node, ast.AnnAssign) and node.value is not None:
                    _bind(node.target, node.value, names)
            if sum(map(len, names.values())) == before:
                break
        for node in nodes:
            if isinstance(node, ast.Assign | ast.AugAssign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                for target in (x for t in targets for x in _elements(t)):
                    if isinstance(target, ast.Subscript):
                        yield from _writes(target.lineno, _places(target.value, names), f"{ast.unparse(target)} = ...")
        for call, kernel in grammar.kernels:
            for place in self._written(kernel):
                if place.parameter < len(call.args):
                    found = _places(call.args[place.parameter], names)
                    inner = {Place(p.parameter, p.attributes + place.attributes) for p in found}
                    yield from _writes(call.lineno, inner, f"{ast.unparse(call.func)}() fills it")

    def _written(self, kernel: Any) -> set[Place]:
        """Return the places that a kernel writes to."""
        source = read(plain(kernel))
        if source is None:
            return {Place(i, ()) for i in range(plain(kernel).__code__.co_argcount)}  # who knows
        return {write.place for write in self.of(source, Grammar(source)) if write.place is not None}


def _writes(line: int, places: set[Place], how: str) -> Iterator[Write]:
    if not places:
        yield Write(line, None, how)
    for place in sorted(places):
        yield Write(line, place, how)


def _bind(target: ast.expr, value: ast.expr, names: dict[str, set[Place]]) -> None:
    """Follow an assignment."""
    if isinstance(target, ast.Tuple):
        values = value.elts if isinstance(value, ast.Tuple) and len(value.elts) == len(target.elts) else []
        for i, element in enumerate(target.elts):
            _bind(element, values[i] if values else value, names)
    elif isinstance(target, ast.Name):
        names.setdefault(target.id, set()).update(_places(value, names))


def _elements(target: ast.expr) -> Iterator[ast.expr]:
    if isinstance(target, ast.Tuple | ast.List):
        for element in target.elts:
            yield from _elements(element)
    else:
        yield target


def _places(node: ast.expr, names: dict[str, set[Place]]) -> set[Place]:
    """Return the places that an expression may be, or be part of."""
    match node:
        case ast.Name():
            return names.get(node.id, set())
        case ast.Attribute():
            return {Place(p.parameter, (*p.attributes, node.attr)[:4]) for p in _places(node.value, names)}
        case ast.Subscript():
            return _places(node.value, names)
        case ast.IfExp():
            return _places(node.body, names) | _places(node.orelse, names)
        case ast.Tuple():
            return {place for element in node.elts for place in _places(element, names)}
        case ast.Call():
            return {place for argument in node.args for place in _places(argument, names)}
    return set()
