"""Arithmetic that is not the same compiled: of whole arrays, and of integers that are floats elsewhere."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from torquebench.dialect.kinds import MIXED, Kinds, hints_of
from torquebench.dialect.names import plain
from torquebench.dialect.source import Complaint, own_nodes


def mistakes(kinds: Kinds) -> Iterator[Complaint]:
    """Return complaints about whole arrays in arithmetic, and about numbers that may be integers or floats.

    Compiled, a variable has one type: where it is an integer here and a float there it is a float, and 0 becomes 0.0,
    whose negative is -0.0.

    Args:
        kinds: The kinds of values in a function.
    """
    for name, line in kinds.integer_at.items():
        if kinds.kinds[name] == MIXED:
            yield Complaint(line, f"{name} is an integer here and a float elsewhere", "write a float, as 0.0")
    lines = set()
    for node in own_nodes(kinds.grammar.source.node):
        if isinstance(node, ast.IfExp) and kinds.of(node) == MIXED:
            yield Complaint(node.lineno, f"{ast.unparse(node)} is an integer or a float", "write both as floats")
        for operand in _operands(node, kinds):
            if kinds.of(operand).name == "array" and operand.lineno not in lines:
                lines.add(operand.lineno)
                what = f"{ast.unparse(operand)} is a whole array in arithmetic"
                yield Complaint(operand.lineno, what, "loop over the elements, for i in range(len(tau))")


def _operands(node: ast.AST, kinds: Kinds) -> list[ast.expr]:
    """Return the expressions in a node that must be numbers."""
    match node:
        case ast.BinOp():
            return [node.left, node.right]
        case ast.UnaryOp():
            return [node.operand]
        case ast.Compare():
            return [node.left, *node.comparators]
        case ast.AugAssign():
            return [node.target, node.value]
        case ast.Assign() if any(isinstance(target, ast.Subscript) for target in node.targets):
            return [*node.targets, node.value]
        case ast.Call():
            function = plain(kinds.grammar.value(node.func))
            if function is abs or getattr(function, "__module__", "") == "math":
                return node.args
            if hasattr(function, "__code__"):
                hints = [hints_of(function).get(name) for name in function.__code__.co_varnames]
                return [a for a, hint in zip(node.args, hints, strict=False) if hint in (float, int)]
    return []
