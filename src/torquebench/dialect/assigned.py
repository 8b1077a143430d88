"""Variables that may be read before they have a value: Python raises there, compiled code takes what it finds."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from torquebench.dialect.source import Complaint, Source, body, own_nodes, parameters, stored


def unassigned(source: Source) -> list[Complaint]:
    """Return a complaint for each variable that some way through the function reads before it is given a value."""
    reader = _Reader(stored(ast.Module(body(source.node), [])))
    reader.block(body(source.node), set(parameters(source.node)))
    return [
        Complaint(line, f"{name} may not have a value yet", "give it one before the branch or the loop")
        for name, line in reader.early.items()
    ]


class _Reader:
    """Follows which variables have a value; `None` stands for a place that is never reached."""

    def __init__(self, variables: set[str]) -> None:
        self.variables = variables
        self.early: dict[str, int] = {}

    def reads(self, node: ast.AST | None, known: set[str]) -> None:
        """Note what an expression reads too early."""
        if node is not None:
            for x in (node, *own_nodes(node)):
                if isinstance(x, ast.Name) and not isinstance(x.ctx, ast.Store) and x.id in self.variables - known:
                    self.early.setdefault(x.id, x.lineno)

    def block(self, statements: Sequence[ast.stmt], known: set[str]) -> set[str] | None:
        """Return the variables that have a value after some statements."""
        now: set[str] | None = set(known)
        for statement in statements:
            if now is None:
                return None
            now = self.statement(statement, now)
        return now

    def statement(self, node: ast.stmt, known: set[str]) -> set[str] | None:
        """Return the variables that have a value after a statement."""
        match node:
            case ast.Assign() | ast.AnnAssign():
                self.reads(node.value, known)
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                for target in targets:
                    self.reads(target, known)
                given = isinstance(node, ast.Assign) or node.value is not None
                return known | {name for target in targets if given for name in _names(target)}
            case ast.AugAssign():
                if isinstance(node.target, ast.Name) and node.target.id not in known:
                    self.early.setdefault(node.target.id, node.lineno)
                self.reads(node.target, known)
                self.reads(node.value, known)
                return known
            case ast.If():
                self.reads(node.test, known)
                ways = [w for w in (self.block(node.body, known), self.block(node.orelse, known)) if w is not None]
                return set.intersection(*ways) if ways else None
            case ast.For() | ast.While():
                self.reads(node.iter if isinstance(node, ast.For) else node.test, known)
                inside = known | set(_names(node.target)) if isinstance(node, ast.For) else known
                self.block(node.body, inside)
                self.block(node.orelse, known)
                return known
            case ast.Return() | ast.Break() | ast.Continue():
                self.reads(getattr(node, "value", None), known)
                return None
        self.reads(node, known)
        return known


def _names(target: ast.expr) -> list[str]:
    elements = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
    return [x.id for x in elements if isinstance(x, ast.Name)]
