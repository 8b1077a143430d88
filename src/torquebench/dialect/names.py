"""The names in a function of the dialect: what may be read, whose functions may be called."""

from __future__ import annotations

import ast
import math
from types import ModuleType
from typing import Any

from torquebench.dialect import advice
from torquebench.dialect.source import FORM, MISSING, STATE, Complaint, Source, body, parameters, stored

MATH = (
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sinh",
    "cosh",
    "tanh",
    "sqrt",
    "exp",
    "expm1",
    "log",
    "log1p",
    "floor",
    "fabs",
    "copysign",
    "isfinite",
    "isnan",
    "pi",
    "inf",
    "nan",
)
"""What may be taken from `math`: what gives the same bytes compiled. Not pow, hypot or fsum."""
BUILTINS = (abs, range, len)
"""Not min and max (they treat NaN differently compiled), sum (its order is not ours) or round."""


def is_kernel(value: Any) -> bool:
    """Whether a value is a function marked `@kernel`."""
    return getattr(plain(value), "is_kernel", None) is True


def plain(value: Any) -> Any:
    """Return the Python function behind a compiled one."""
    return getattr(value, "py_func", value)


class Names:
    """Reads the names of one function, and collects the complaints.

    Args:
        source: The function.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.complaints: list[Complaint] = []
        self.kernels: list[tuple[ast.Call, Any]] = []
        """Kernels that it calls, in the order of the text."""
        node = source.node
        self.local = set(parameters(node)) | stored(ast.Module(body(node), []))
        self.callables = {a.arg for a in node.args.args if "Callable" in ast.unparse(a.annotation or a)}

    def complain(self, node: ast.AST, what: str, cure: str, topic: str = FORM) -> None:
        """Note something that lies outside the dialect.

        Args:
            node: Where.
            what, cure, topic: See `Complaint`.
        """
        self.complaints.append(Complaint(getattr(node, "lineno", self.source.node.lineno), what, cure, topic))

    def value(self, node: ast.expr) -> Any:
        """Return what a global name, or an attribute of a global module, means; MISSING for anything local."""
        if isinstance(node, ast.Name):
            return MISSING if node.id in self.local else self.source.meaning(node.id)
        if isinstance(node, ast.Attribute):
            owner = self.value(node.value)
            return getattr(owner, node.attr, MISSING) if isinstance(owner, ModuleType) else MISSING
        return MISSING

    def reference(self, node: ast.Name | ast.Attribute) -> None:
        """Read a name, or an attribute, that is used as a value."""
        owner = root(node)
        if not isinstance(owner, ast.Name) or owner.id in self.local:
            return
        value, text = self.value(node), ast.unparse(node)
        if isinstance(node, ast.Attribute) and self.value(node.value) is math:
            if node.attr not in MATH or callable(value):
                self.complain(node, text, advice.math_name(text, value, MATH))
        elif type(value) in (int, float, bool):
            self.constant(node, text)
        else:
            self.complain(node, *advice.reference(text, value, self.source))

    def constant(self, node: ast.Name | ast.Attribute, text: str) -> None:
        """Read a number that is not local."""
        if isinstance(node, ast.Name) and self.source.changes(node.id):
            self.complain(node, f"{text}, which changes", advice.MEMORY, STATE)
        elif isinstance(node, ast.Name) and node.id in self.source.function.__code__.co_freevars:
            return  # a number around the function, the same for ever
        elif not text.rpartition(".")[2].isupper() and not isinstance(node, ast.Attribute):
            self.complain(node, f"the global {text}", f"call it {text.upper()}, as a constant is", STATE)

    def call(self, node: ast.Call) -> None:
        """Read a call: whose function it is, and that arguments are given by position."""
        function, text = node.func, ast.unparse(node.func)
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            self.complain(node, f"{text}() is called with keywords or *", "give its arguments by position")
        name = root(function)
        if not isinstance(name, ast.Name):
            self.complain(node, f"a call of {text}", "call a function by its name")
            return
        if name.id in self.local:
            if text not in self.callables:
                self.complain(node, f"a call of {text}()", "loop over the elements; methods are not compiled")
            return
        value, owner = self.value(function), self.value(name)
        if value is MISSING and owner is not MISSING and not isinstance(owner, ModuleType):
            self.reference(name)  # a method of something global
        elif is_kernel(value):
            self.kernels.append((node, value))
        elif any(value is getattr(math, name) for name in MATH):
            return
        elif getattr(value, "__module__", "") == "math" or (value is MISSING and owner is math):
            self.complain(node, f"{text}()", advice.math_name(text, value, MATH))
        elif not (any(value is builtin for builtin in BUILTINS) or _is_label(value)):
            self.complain(node, *advice.call(text, value, self.source))


def root(node: ast.expr) -> ast.expr:
    """Return what the attributes of an expression belong to."""
    while isinstance(node, ast.Attribute):
        node = node.value
    return node


def _is_label(value: Any) -> bool:
    """Whether a value is a NamedTuple class, which is only labels on a tuple."""
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")
