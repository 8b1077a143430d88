"""What to write instead: a cure for each thing that lies outside the dialect."""

from __future__ import annotations

import ast
import types
from collections.abc import Sequence
from typing import Any

import numpy as np

from torquebench.dialect.source import FORM, MISSING, STATE, Source
from torquebench.errors import did_you_mean

LOOP = "loop over the elements with for i in range(len(tau))"
MEMORY = "keep what must survive in memory, and pass what is chosen as a gain"
ARGUMENTS = "a law depends on its arguments alone: the time is t, and noise belongs to the experiment"
RETURN = (
    "fill tau[i] in a loop; an array that is returned is allocated at every call and keeps the law off the native path"
)
WORK = "working memory is a field of memory"
IMPURE = {"random", "time", "datetime", "os", "secrets", "uuid", "sys"}
STATEMENTS: dict[str, tuple[str, str, str]] = {
    "Global": ("a global statement", MEMORY, STATE),
    "Nonlocal": ("a nonlocal statement", MEMORY, STATE),
    "Import": ("an import", "import at the top of the file", FORM),
    "ImportFrom": ("an import", "import at the top of the file", FORM),
    "FunctionDef": ("a function within", "move it to the top of the file and mark it @kernel", FORM),
    "ClassDef": ("a class within", "move it to the top of the file", FORM),
    "Try": ("a try statement", "test for the case beforehand; a division by zero ends the run by itself", FORM),
    "Raise": ("a raise statement", "fill tau for that case too; a torque that is not finite ends the run", FORM),
    "Assert": ("an assert statement", "leave it out, or write an if", FORM),
    "With": ("a with statement", "leave it out", FORM),
    "Delete": ("a del statement", "leave it out", FORM),
    "Match": ("a match statement", "write if and elif", FORM),
}
EXPRESSIONS = {
    "Lambda": ("a lambda", "write a function at the top of the file and mark it @kernel"),
    "NamedExpr": ("an assignment within an expression", "assign on a line of its own"),
    "JoinedStr": ("a text", "compute with numbers only"),
    "Starred": ("a starred expression", "name the elements"),
    "List": ("a list", "use numbers, or " + WORK),
    "Dict": ("a dictionary", "use numbers, or " + WORK),
    "Set": ("a set", "use numbers, or " + WORK),
    "ListComp": ("a list comprehension", LOOP),
    "SetComp": ("a set comprehension", LOOP),
    "DictComp": ("a dictionary comprehension", LOOP),
    "GeneratorExp": ("a generator", LOOP),
    "Slice": ("a slice", LOOP),
}
OPERATORS = {
    "Pow": ("operator **", "write x * x, or math.sqrt for a root"),
    "MatMult": ("operator @", "write the sum as two loops of range()"),
    "In": ("operator in", "write a comparison with =="),
    "NotIn": ("operator not in", "write a comparison with !="),
    "Is": ("operator is", "write =="),
    "IsNot": ("operator is not", "write !="),
}
MATH = {
    "pow": "write x * x, or math.exp(a * math.log(x)) for x > 0",
    "hypot": "write math.sqrt(x * x + y * y)",
    "fsum": LOOP,
    "prod": LOOP,
    "sumprod": LOOP,
    "dist": LOOP,
    "ceil": "write -math.floor(-x)",
    "fmod": "write x - y * math.floor(x / y)",
    "degrees": "write x * (180.0 / math.pi)",
    "radians": "write x * (math.pi / 180.0)",
    "e": "write math.exp(1.0)",
    "tau": "write 2.0 * math.pi",
    "log2": "write math.log(x) / math.log(2.0)",
    "log10": "write math.log(x) / math.log(10.0)",
    "cbrt": "write math.exp(math.log(x) / 3.0) for x > 0",
    "exp2": "write math.exp(x * math.log(2.0))",
}
BUILTINS = {
    "min": "write x if x < y else y",
    "max": "write x if x > y else y",
    "sum": LOOP,
    "pow": MATH["pow"],
    "round": "write math.floor(x + 0.5)",
    "float": "leave it out",
    "int": "write math.floor(x)",
    "bool": "write x != 0.0",
    "print": "leave it out: every field of memory is recorded",
    "enumerate": LOOP,
    "zip": LOOP,
    "map": LOOP,
    "sorted": LOOP,
    "list": WORK,
    "isinstance": "leave it out",
    "divmod": "write // and %",
}
NUMPY = {
    "sign": "write sign(x), from torquebench",
    "clip": "write clip(x, limit) or sat(x), from torquebench",
    "abs": "write abs(x)",
    "absolute": "write abs(x)",
    "minimum": BUILTINS["min"],
    "maximum": BUILTINS["max"],
    "arcsin": "write math.asin(x)",
    "arccos": "write math.acos(x)",
    "arctan": "write math.atan(x)",
    "arctan2": "write math.atan2(y, x)",
    "square": "write x * x",
    "power": MATH["pow"],
    "hypot": MATH["hypot"],
    "deg2rad": MATH["radians"],
    "rad2deg": MATH["degrees"],
    "where": "write x if ... else y",
    "pi": "write math.pi",
    "inf": "write math.inf",
    "nan": "write math.nan",
    "e": MATH["e"],
    "heaviside": "write 1.0 if x > 0.0 else 0.0",
    "dot": OPERATORS["MatMult"][1],
    "matmul": OPERATORS["MatMult"][1],
    "floor": "write math.floor(x)",
    "float64": "leave it out",
}


def statement(node: ast.stmt) -> tuple[str, str, str]:
    """Return what a statement is, its cure and its topic."""
    kind = type(node).__name__.replace("Star", "").replace("Async", "")
    return STATEMENTS.get(kind, (f"the statement {kind}", "use assignments, if, for and calls", FORM))


def expression(node: ast.expr) -> tuple[str, str]:
    """Return what an expression is, and its cure."""
    kind = type(node).__name__
    return EXPRESSIONS.get(kind, (f"the expression {kind}", "use arithmetic, comparisons and calls of kernels"))


def operator(node: ast.AST) -> tuple[str, str]:
    """Return what an operator is, and its cure."""
    kind = type(node).__name__
    return OPERATORS.get(kind, (f"the operator {kind}", "use + - * / // % and comparisons"))


def math_name(text: str, value: Any, known: Sequence[str]) -> str:
    """Return what to write instead of something taken from `math`; `known` may be taken."""
    name = getattr(value, "__name__", text.rpartition(".")[2])
    if name in known:
        return "call it where its value is needed"
    return MATH.get(name) or f"not among the functions that are the same compiled{did_you_mean(name, known)}"


def reference(text: str, value: Any, source: Source) -> tuple[str, str, str]:
    """Return what a global that is neither called nor a plain number is, its cure and its topic."""
    name = text.rpartition(".")[2]
    if value is MISSING:
        return f"{text}, which is not defined", f"check the spelling{did_you_mean(name, _known(source))}", FORM
    if isinstance(value, int | float | np.number):  # numpy's numbers: another arithmetic where it divides by zero
        return f"{text}, a {type(value).__name__}", NUMPY.get(name, "make it a plain Python number, float(...)"), FORM
    if isinstance(value, types.ModuleType) or callable(value):
        return f"{text} used as a value", "call a function of it, or leave it out", FORM
    if "random" in type(value).__module__:
        return f"{text}, a {type(value).__name__}", ARGUMENTS, STATE
    return f"{text}, a {type(value).__name__} outside the law", MEMORY, STATE


def call(text: str, value: Any, source: Source) -> tuple[str, str, str]:
    """Return what a call that the dialect does not know is, its cure and its topic."""
    home, name = str(getattr(value, "__module__", "") or ""), text.rpartition(".")[2]
    what = f"{text}()"
    if value is MISSING:
        return f"{what}, which is not defined", f"check the spelling{did_you_mean(name, _known(source))}", FORM
    owner = str(getattr(getattr(value, "__self__", None), "__module__", "") or home)
    if home.split(".")[0] in IMPURE or "random" in f"{owner}{text}" or text.split(".")[0] in IMPURE:
        return what, ARGUMENTS, STATE
    if home == "builtins" and name in BUILTINS:
        return what, BUILTINS[name], FORM
    if home.split(".")[0] == "numpy" or isinstance(value, np.ufunc):
        return what, NUMPY.get(name) or (f"write math.{name}(x)" if name in _MATH_LIKE else f"{LOOP}, or {WORK}"), FORM
    if isinstance(value, types.FunctionType) or hasattr(value, "py_func"):
        return what, f"mark {name} with @kernel (from torquebench.kernel import kernel), in the law's own file", FORM
    if isinstance(getattr(value, "__self__", None), list | dict | set | np.ndarray):
        return what, MEMORY, STATE
    return what, "use arithmetic, math and functions marked @kernel", FORM


_MATH_LIKE = (
    "sin",
    "cos",
    "tan",
    "sinh",
    "cosh",
    "tanh",
    "sqrt",
    "exp",
    "expm1",
    "log",
    "log1p",
    "isnan",
    "isfinite",
    "fabs",
    "copysign",
)


def _known(source: Source) -> list[str]:
    """Return the names that a function could have meant."""
    own = [name for name in source.function.__globals__ if not name.startswith("_")]
    return sorted({*own, *source.function.__code__.co_varnames, "sat", "sign", "clip", "gravity", "inverse_dynamics"})
