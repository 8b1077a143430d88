"""What may stand in a function of the dialect: statements, expressions and operators."""

from __future__ import annotations

import ast

from torquebench.dialect import advice
from torquebench.dialect.names import Names, root
from torquebench.dialect.source import INPUTS, Source, body, own_nodes

OPERATORS = (
    ast.Add,
    ast.Sub,
    ast.Mult,
    ast.Div,
    ast.FloorDiv,
    ast.Mod,
    ast.USub,
    ast.UAdd,
    ast.Not,
    ast.And,
    ast.Or,
    ast.Eq,
    ast.NotEq,
    ast.Lt,
    ast.LtE,
    ast.Gt,
    ast.GtE,
)


class Grammar(Names):
    """Reads one function.

    Args:
        source: The function.
        fixed: Parameters that may not be given another value, because that only rebinds the name.
        returns: Whether it may return a value.
    """

    def __init__(self, source: Source, fixed: frozenset[str] = frozenset(), returns: bool = True) -> None:
        super().__init__(source)
        self.fixed, self.returns = fixed, returns
        for statement in body(source.node):
            self.statement(statement)

    def statement(self, node: ast.stmt) -> None:
        """Read a statement."""
        match node:
            case ast.Assign():
                for target in node.targets:
                    self.target(target)
                self.expression(node.value)
            case ast.AnnAssign():
                self.target(node.target)
                if node.value is not None:
                    self.expression(node.value)
            case ast.AugAssign():
                self.operator(node, node.op)
                self.target(node.target)
                self.expression(node.value)
            case ast.Expr(value=ast.Call() | ast.Yield() | ast.YieldFrom() | ast.Await() | ast.NamedExpr()):
                self.expression(node.value)
            case ast.Expr():
                self.complain(node, "an expression without effect", "leave it out")
            case ast.For():
                if not (isinstance(node.iter, ast.Call) and self.value(node.iter.func) is range):
                    self.complain(node.iter, "a loop over anything but range()", "write for i in range(len(tau))")
                self.target(node.target)
                self.expression(node.iter)
            case ast.While() | ast.If():
                self.expression(node.test)
            case ast.Return():
                if node.value is not None:
                    if not self.returns:
                        self.complain(node, "a value is returned", advice.RETURN)
                    self.expression(node.value)
            case ast.Pass() | ast.Break() | ast.Continue():
                return
            case _:
                what, cure, topic = advice.statement(node)
                self.complain(node, what, cure, topic)
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            self.blocks(node)

    def blocks(self, node: ast.AST) -> None:
        """Read the statements inside a statement."""
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.stmt):
                self.statement(child)
            elif isinstance(child, ast.ExceptHandler | ast.match_case):
                self.blocks(child)

    def target(self, node: ast.expr) -> None:
        """Read what is given a value."""
        match node:
            case ast.Name():
                if node.id in self.fixed:
                    self.complain(
                        node,
                        f"{node.id} = ... only rebinds the name",
                        "fill tau[i], element by element" if node.id == "tau" else "take another name",
                        INPUTS,
                    )
            case ast.Tuple():
                for element in node.elts:
                    self.target(element)
            case ast.Subscript():
                self.expression(node)
            case ast.Attribute():
                self.complain(
                    node,
                    f"the attribute {ast.unparse(node)} is assigned",
                    f"write to the elements, {ast.unparse(node)}[i] = ...",
                    INPUTS,
                )
            case _:
                self.complain(node, f"a value is assigned to {ast.unparse(node)}", "name each variable")

    def operator(self, node: ast.AST, operator: ast.AST) -> None:
        """Read an operator."""
        if not isinstance(operator, OPERATORS):
            self.complain(node, *advice.operator(operator))

    def expression(self, node: ast.expr) -> None:
        """Read an expression."""
        match node:
            case ast.BinOp() | ast.UnaryOp() | ast.BoolOp():
                self.operator(node, node.op)
            case ast.Compare():
                for operator in node.ops:
                    self.operator(node, operator)
            case ast.IfExp() | ast.Tuple():
                pass
            case ast.Constant():
                if type(node.value) not in (int, float, bool):
                    self.complain(node, f"the constant {node.value!r}", "compute with numbers only")
            case ast.Call():
                self.call(node)
                for argument in node.args:
                    if not isinstance(argument, ast.Starred):
                        self.expression(argument)
                return
            case ast.Subscript():
                self.expression(node.value)
                if any(isinstance(x, ast.Slice) for x in (node.slice, *own_nodes(node.slice))):
                    self.complain(node, f"the slice {ast.unparse(node)}", "loop over the elements")
                else:
                    self.expression(node.slice)
                return
            case ast.Name() | ast.Attribute():
                if isinstance(root(node), ast.Name):
                    self.reference(node)
                else:
                    self.expression(root(node))
                return
            case _:
                self.complain(node, *advice.expression(node))
                return
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                self.expression(child)
