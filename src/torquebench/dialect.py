"""The dialect of laws and kernels: what may stand in source that gives the same bytes interpreted and compiled.

A whitelist: the syntax of `ALLOWED` over numbers and elements of arrays; calls of `FUNCTIONS`, and of kernels of the
package or of the same file; constants; and, of what a law is given, writes to `WRITABLE` alone. Numba says what no
whitelist can see: which variables may be read before they have a value, and, when it compiles, which types do not fit.
`torquebench.check` runs both paths and compares their bytes. A law outside the dialect runs interpreted.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import io
import linecache
import math
import re
import tokenize
import warnings
from collections.abc import Iterator
from functools import lru_cache
from types import FunctionType, ModuleType
from typing import Annotated, Any, Final, NamedTuple, cast, get_args, get_origin, get_type_hints

import numpy as np
from numba.core import config, ssa
from numba.core.compiler import run_frontend
from numba.core.errors import NotDefinedError, NumbaError, NumbaWarning

from torquebench.errors import did_you_mean
from torquebench.fuzzy import Fis
from torquebench.kernel import Array, is_foreign
from torquebench.kernel.struct import is_structure
from torquebench.laws.law import Law, Nothing
from torquebench.syntax import parse_python

ALLOWED: Final = (
    *(ast.Assign, ast.AnnAssign, ast.AugAssign, ast.Expr, ast.For, ast.While, ast.If, ast.Return, ast.Pass),
    *(ast.Break, ast.Continue, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Tuple, ast.Constant),
    *(ast.Call, ast.Subscript, ast.Name, ast.Attribute),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or),
    *(ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE),
)
"""Statements, expressions and operators that mean the same interpreted and compiled."""
MATH: Final = (
    "sin cos tan asin acos atan atan2 sinh cosh tanh sqrt exp expm1 log log1p floor fabs copysign isfinite isnan "
    "pi inf nan"
).split()
"""Names that may be taken from `math`, as they give the same bytes compiled. Not pow, hypot or fsum."""
FUNCTIONS: Final = (abs, range, len, *(getattr(math, name) for name in MATH))
"""Not min and max (compiled, they treat NaN differently), sum (it adds in another order) or round."""
ARGUMENTS = ("gains", "model", "t", "q", "qd", "ref", "memory", "tau")
"""Arguments of a law, in this order."""
WRITABLE: Final = re.compile(r"tau|memory\.\w+|model\.scratch(\.\w+)?")
"""Those of its arguments, and of their fields, to whose elements a law may write."""
WHOLE: Final = re.compile(
    r"q|qd|tau|(ref|memory|gains)\.\w+|model\.(armature|mass|tau_max|inertia_scale|scratch\.(free|vector|zeros|matrix(\[\])?))"
)
"""Those of its arguments that have an element, or a row and a column, for each joint: kernels of the package, which
check no index, take no other arrays."""
SIZES: Final = ("shape", "size", "ndim")
"""What may be asked of an array: its other attributes lead to its address, or to the array of which it is a part."""
STRUCTURES: Final = ("gains", "model", "ref", "memory")
"""Those of its arguments that have fields, which may be called as an attribute of an array is."""
NUMBERS: Final = (int, float, bool)

LOOP = "loop over the elements, for i in range(len(tau))"
STATE_CURE = "keep what must survive in memory, and pass what is chosen as a gain"
IMPURE_CURE = "a law depends on its arguments alone: the time is t, and noise belongs to the experiment"
IMPURE = {"random", "time", "datetime", "os", "secrets", "uuid"}
CURES = {
    name: cure
    for names, cure in {
        "Pow": "write x * x, or math.sqrt for a root",
        "pow power": "write x * x, or math.exp(a * math.log(x)) for x > 0",
        "MatMult dot matmul": "write the sum as two loops of range()",
        "ListComp GeneratorExp sum fsum enumerate zip": LOOP,
        "List Dict zeros zeros_like empty array list": "use numbers, or a field of memory as working memory",
        "Global Nonlocal": STATE_CURE,
        "Lambda FunctionDef": "move it to the top of the file and decorate it with kernel",
        "Import ImportFrom": "import at the top of the file",
        "Try Raise Assert": "test for the case and fill tau; a division by zero ends the run by itself",
        "Is In": "write ==",
        "min minimum": "write x if x < y else y",
        "max maximum": "write x if x > y else y",
        "hypot": "write math.sqrt(x * x + y * y)",
        "sign": "write sign(x), from torquebench",
        "clip": "write clip(x, limit) or sat(x), from torquebench",
        "where": "write x if ... else y",
        "ceil": "write -math.floor(-x)",
        "round": "write math.floor(x + 0.5)",
        "float float64 print": "leave it out: numbers are floats, and every field of memory is recorded",
        "log10": "write math.log(x) / math.log(10.0)",
        "degrees rad2deg radians deg2rad": "multiply by 180.0 / math.pi, or divide by it",
        "arcsin arccos arctan arctan2": "write math.asin(x), math.acos(x), math.atan(x) or math.atan2(y, x)",
    }.items()
    for name in names.split()
}
"""Syntax outside the dialect, or the name of a function -> what to write instead."""
FORM, INPUTS, STATE = "form", "inputs", "state"
"""Topics of complaints: how something is written, a write to something not the law's own, hidden state."""
MISSING: Final = object()
"""Stands for the meaning of a name that has none."""


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


@lru_cache(maxsize=256)
def complaints(law: Law) -> tuple[Complaint, ...]:
    """Return what in a law's source keeps it from being compiled; nothing for a law in the dialect.

    The package's own laws are not read again: the tests hold them to the dialect.
    """
    return () if str(getattr(law.function, "__module__", "")).startswith("torquebench.") else tuple(read_law(law))


def read_law(law: Law) -> list[Complaint]:
    """Read a law, and the kernels of its file that it calls, and return what lies outside the dialect, by line."""
    function: Any = law.function
    if not isinstance(function, FunctionType):
        if hasattr(function, "start"):
            return [Complaint(0, "runs in a process of its own", "keep its file to the dialect to have it compiled")]
        what = "is compiled already" if hasattr(function, "py_func") else f"is a {type(function).__name__}"
        return [Complaint(_line(function), f"law '{law.name}' {what}", "use @controller on a plain function")]
    found = {*_structure_complaints(law), *_read(function, True, {function})}
    names = ", ".join(inspect.signature(function, follow_wrapped=False).parameters)
    if names != ", ".join(ARGUMENTS):
        found.add(Complaint(_line(function), f"the arguments are ({names})", f"call them ({', '.join(ARGUMENTS)})"))
    return sorted(found)


IMPORTS: Final[dict[str, tuple[str, ...]]] = {
    "__future__": ("annotations",),
    "math": tuple(MATH),
    "typing": ("Annotated", "NamedTuple"),
    "numpy": (),
    "torquebench": tuple(
        "Array Fis FixedRules Gain Option Rules bias_forces controller gravity infer inverse_dynamics mass_matrix sat "
        "sign".split()
    ),
    "torquebench.kernel": ("Array", "clip", "kernel", "sat", "sign"),
}
"""What a file of laws may import: module -> names; none of them does more than it says when a file is loaded."""
CALLED = {"Gain", "Option", "Rules", "FixedRules", "controller", "kernel"}
DECLARATIONS = {*CALLED, "NamedTuple", "Annotated"}


def read_file(text: str) -> list[Complaint]:
    """Read a file of laws and return what in it would do more, when it is loaded, than declare laws.

    A file without complaint imports `IMPORTS`, gives numbers names, and declares NamedTuple classes, laws and kernels:
    loading it runs nothing of its author's. What its functions do, `read_law` and `read_kernel` say.

    Raises:
        SyntaxError: it is not Python.
    """
    cure, found = "declare constants, NamedTuple classes, laws and kernels only", []
    encoding, lines = tokenize.detect_encoding(io.BytesIO(text.encode()).readline)
    if not encoding.startswith("utf-8"):  # loaded, it would be another text than the one that is read here
        found.append(Complaint(len(lines), f"the encoding {encoding}", "save the file as UTF-8", STATE))
    for node in parse_python(text).body:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                held = True
            case ast.Import():
                held = all(x.name in ("math", "numpy") and _may_be_named(x.asname or x.name) for x in node.names)
            case ast.ImportFrom(level=0):
                known = IMPORTS.get(node.module or "", ())
                held = all(name.name in known and name.asname is None for name in node.names)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                held = _may_be_named(name) and _declares(value)
                held = held and not any(isinstance(x, ast.Call) for x in ast.walk(node))
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
                held = _may_be_named(name) and _declares(value) and _declares(node.annotation)
                held = held and not any(isinstance(x, ast.Call) for x in ast.walk(node))
            case ast.ClassDef(bases=[ast.Name(id="NamedTuple")], keywords=[], decorator_list=[]):
                held = _may_be_named(node.name) and not _has_type_parameters(node) and all(map(_is_field, node.body))
            case ast.FunctionDef(args=ast.arguments(defaults=[], kw_defaults=[])):
                makers = {ast.unparse(getattr(x, "func", x)) for x in node.decorator_list}
                notes = [x.annotation for x in ast.walk(node.args) if isinstance(x, ast.arg) and x.annotation]
                notes += [node.returns] if node.returns else []
                held = _may_be_named(node.name) and bool(makers) and makers <= {"kernel", "controller"}
                held = held and not _has_type_parameters(node)
                held = held and all(map(_declares, [*node.decorator_list, *notes]))
            case _:
                held = False
        if not held:
            found.append(Complaint(node.lineno, ast.unparse(node).split("\n")[0][:60], cure, STATE))
    return found


def _may_be_named(name: str) -> bool:
    """Return whether a file may give something a name: not one that Python, or what is read here, understands."""
    return name not in DECLARATIONS and not name.startswith("__")


def _has_type_parameters(node: ast.AST) -> bool:
    return bool(getattr(node, "type_params", ()))


def _is_field(node: ast.stmt) -> bool:
    if isinstance(node, ast.AnnAssign):
        return isinstance(node.target, ast.Name) and node.value is None and _declares(node.annotation)
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _declares(node: ast.AST, quoted: bool = False) -> bool:
    """Return whether an expression only names, computes with numbers, and calls what is in `CALLED`.

    Args:
        node: The expression.
        quoted: Whether a text may stand there; an annotation that is one, or is made of one, would be evaluated.
    """
    match node:
        case ast.Constant(value=value):
            return quoted or not isinstance(value, str | bytes)
        case ast.Call(func=ast.Name(id=name)) if name in CALLED:
            return all(_declares(x, True) for x in [*node.args, *(keyword.value for keyword in node.keywords)])
        case ast.Name() | ast.Attribute(value=ast.Name()):
            return True
        case ast.Subscript() | ast.Tuple() | ast.UnaryOp() | ast.BinOp() if isinstance(node, ALLOWED):
            parts = [x for x in ast.iter_child_nodes(node) if isinstance(x, ast.expr)]
            quoted = quoted and isinstance(node, ast.Tuple)
            return isinstance(getattr(node, "op", None), (*ALLOWED, type(None))) and all(
                _declares(x, quoted) for x in parts
            )
    return False


def read_kernel(function: FunctionType) -> list[Complaint]:
    """Read a kernel, and the kernels of its file that it calls, and return what lies outside the dialect, by line."""
    return sorted({*_read(function, False, {function})})


def _read(function: FunctionType, is_law: bool, seen: set[FunctionType]) -> Iterator[Complaint]:
    node = definition(function)
    if node is None:
        what = f"the source of {function.__name__} cannot be read"
        yield Complaint(_line(function), what, "define it in a file, by def")
        return
    reader = _Reader(function, node, is_law)
    yield from reader.found or _without_value(function)
    for call, kernel in reader.kernels:
        if kernel.__module__.startswith("torquebench.") or kernel in seen:
            continue
        seen.add(kernel)
        if kernel.__module__ == function.__module__:
            yield from _read(kernel, False, seen)
        else:
            what = f"{kernel.__name__}() is a kernel of another file"
            yield Complaint(call.lineno, what, "move it here: changes in the other file would not be noticed")


@lru_cache(maxsize=256)
def _without_value(function: FunctionType) -> tuple[Complaint, ...]:
    """Return the first variable that may be read too early, says numba: there Python raises, compiled code goes on."""
    kept, config.ALWAYS_WARN_UNINIT_VAR = config.ALWAYS_WARN_UNINIT_VAR, 1
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", NumbaWarning)
            ssa.reconstruct_ssa(run_frontend(function))
    except (NumbaWarning, NumbaError) as caught:
        is_unset, error = isinstance(caught, NumbaWarning | NotDefinedError), cast(Any, caught)
        if is_unset:  # compiling tells of the others
            name = getattr(error, "name", str(error.msg).rpartition(" ")[2])
            what = f"{name} may not have a value yet"
            return (Complaint(error.loc.line, what, "give it one before the branch or the loop"),)
    finally:
        config.ALWAYS_WARN_UNINIT_VAR = kept
    return ()


class _Reader:
    """Reads one function.

    Args:
        function: The function.
        node: Its definition.
        is_law: Whether it is a law, or a kernel.
    """

    def __init__(self, function: FunctionType, node: ast.FunctionDef, is_law: bool) -> None:
        self.function, self.is_law = function, is_law
        code, a = function.__code__, node.args
        self.parameters = {x.arg: ast.unparse(x.annotation or x) for x in (*a.posonlyargs, *a.args)}
        """Name of each -> its annotation, as far as it matters."""
        if is_law:
            self.parameters["t"] = "float"
        self.local = {*code.co_varnames, *code.co_cellvars}
        self.found: list[Complaint] = []
        """What lies outside the dialect."""
        self.kernels: list[tuple[ast.Call, Any]] = []
        """Calls of kernels, in the order of the text."""
        self.assigned: dict[str, list[ast.expr]] = {}
        """What each variable is given."""
        self.stored: list[ast.Subscript] = []
        """Elements that are written to."""
        if a.vararg or a.kwarg or a.defaults or a.kwonlyargs:
            what = f"{node.name}() has *args, **kwargs, or defaults"
            self.complain(node, what, "list its arguments by name, without defaults", STATE)
        for statement in node.body[1:] if ast.get_docstring(node) is not None else node.body:
            self.read(statement)
        for line, place, how in self.writes({}) if is_law else ():
            if not WRITABLE.fullmatch(place):
                what = f"writes to {place} ({how})"
                self.found.append(Complaint(line, what, "write to elements of tau and memory only", INPUTS))
        for line, place, how in self.handed({}) if is_law and is_foreign(function) else ():
            if not WHOLE.fullmatch(place):
                cure = "hand over tau, q, a field of memory, or another array with an element for each joint"
                self.found.append(Complaint(line, f"{how} is given {place}", cure))

    def complain(self, node: Any, what: str, cure: str, topic: str = FORM) -> None:
        """Note something outside the dialect: where, what it is, what to write instead, and its topic."""
        self.found.append(Complaint(node.lineno, what, cure, topic))

    def read(self, node: Any) -> None:
        """Check a statement or an expression, and what it is made of, against the whitelist."""
        operators = [*getattr(node, "ops", ()), *([node.op] if hasattr(node, "op") else ())]
        for name in [type(x).__name__ for x in (node, *operators) if not isinstance(x, ALLOWED)]:
            cure = CURES.get(name.removeprefix("Not"), "use arithmetic, if, for, while and calls of kernels")
            self.complain(node, _text_of(node), cure, STATE if name in ("Global", "Nonlocal") else FORM)
        if not isinstance(node, ALLOWED):
            return
        parts: list[ast.AST] = [x for x in ast.iter_child_nodes(node) if isinstance(x, ast.expr | ast.stmt)]
        match node:
            case ast.Assign():
                for target in node.targets:
                    self.assign(target, node.value)
            case ast.AnnAssign():
                parts.remove(node.annotation)
                if node.value is not None:
                    self.assign(node.target, node.value)
            case ast.AugAssign(target=ast.Name(id=name)):
                if not all(place.endswith("[]") for place in self.places(node.target)):
                    what = f"{_text_of(node)}, which changes a whole array"
                    self.complain(node, what, f"write {name}[i], or {name} = ...")
            case ast.For() if not (isinstance(node.iter, ast.Call) and self.meaning(node.iter.func) is range):
                self.complain(node.iter, ast.unparse(node.iter), "write for i in range(len(tau))")
            case ast.Return(value=ast.expr()) if self.is_law:
                cure = "fill tau[i] in a loop; an array that is returned is allocated at every call"
                self.complain(node, "a value is returned", cure)
            case ast.Subscript() if any(isinstance(x, ast.Slice) for x in ast.walk(node.slice)):
                self.complain(node, _text_of(node), LOOP)
                parts = [node.value]
            case ast.Subscript(ctx=ast.Store()):
                self.stored.append(node)
            case ast.Constant() if type(node.value) not in NUMBERS:
                self.complain(node, f"the constant {_text_of(node)}", "compute with numbers only")
            case ast.Call():
                self.check_call(node, ast.unparse(node.func))
                parts = [*_beneath(node.func), *node.args]
            case ast.Attribute(ctx=ast.Store()):
                text = _text_of(node)
                cure = f"write to the elements, {text}[i] = ..."
                self.complain(node, f"the attribute {text} is assigned", cure, INPUTS)
            case ast.Name(id=name, ctx=ast.Store()) if self.is_law and name in self.parameters and name != "t":
                cure = "fill tau[i], element by element" if name == "tau" else "take another name"
                self.complain(node, f"{name} = ... only rebinds the name", cure, INPUTS)
            case ast.Name(ctx=ast.Load()) | ast.Attribute():
                self.check_name(node, _text_of(node))
                parts = [*_beneath(node)]
        if isinstance(getattr(node, "op", None), ast.Div | ast.FloorDiv | ast.Mod):
            if getattr(self.function, "is_inline", False):  # copied into a law, it would raise there
                self.complain(node, "a division in an inline kernel", "decorate it with plain kernel")
        for part in parts:
            self.read(part)

    # Names and calls.

    def meaning(self, node: ast.expr) -> Any:
        """Return what a global name, or an attribute of a global module, means; MISSING for anything local."""
        if isinstance(node, ast.Attribute):
            owner = self.meaning(node.value)
            return getattr(owner, node.attr, MISSING) if isinstance(owner, ModuleType) else MISSING
        if not isinstance(node, ast.Name) or node.id in (*self.local, *self.function.__code__.co_freevars):
            return MISSING
        return self.function.__globals__.get(node.id, getattr(builtins, node.id, MISSING))

    def check_name(self, node: ast.expr, text: str) -> None:
        """Check a name, or an attribute of one, that is read: local ones, and numbers that do not change."""
        root = _root(node)
        if not isinstance(root, ast.Name) or root.id in self.local:
            for x in ast.walk(node):
                if isinstance(x, ast.Attribute) and self.leads_away(x):
                    self.complain(node, text, "compute with elements, x[i], and with fields", INPUTS)
            return
        value, owner, name = self.meaning(node), self.meaning(root), text.rpartition(".")[2]
        home = getattr(owner, "__name__", "").partition(".")[0]
        if root.id in self.function.__code__.co_freevars:
            self.complain(node, f"{text}, of the function around it", STATE_CURE, STATE)
        elif value is MISSING and (root is node or isinstance(owner, ModuleType)):
            known = {*self.function.__globals__, *self.local, *MATH, "sat", "sign", "clip", "gravity"}
            near = did_you_mean(name, sorted(x for x in known if not x.startswith("_")))
            self.complain(node, f"{text}, which is not defined", f"check the spelling{near}")
        elif type(value) in NUMBERS and root is not node:
            if home not in ("math", "numpy", "torquebench"):
                self.complain(node, f"{text}, a number of another file", f"from {home} import {name}", STATE)
        elif type(value) in NUMBERS:
            if name in _changed_in(module_of(self.function)):
                self.complain(node, f"{text}, which changes", STATE_CURE, STATE)
            elif not text.isupper():
                self.complain(node, f"the global {text}", f"call it {text.upper()}, as a constant is", STATE)
        elif isinstance(value, np.number):  # which divides by zero in another way than Python's
            self.complain(node, f"{text}, a {type(value).__name__}", "make it a plain Python number, float(...)")
        elif isinstance(value, ModuleType) or callable(value):
            self.complain(node, f"{text} used as a value", "call it where its value is needed")
        else:
            kind = type(owner)
            cure = IMPURE_CURE if "random" in kind.__module__ else STATE_CURE
            self.complain(node, f"{root.id}, a {kind.__name__} outside the law", cure, STATE)

    def leads_away(self, node: ast.Attribute) -> bool:
        """Return whether an attribute is none that a law needs: Python's own, or an array's other than its size."""
        if node.attr.startswith("_"):
            return True
        if node.attr in SIZES or not hasattr(np.ndarray, node.attr):
            return False
        name = node.value.id if isinstance(node.value, ast.Name) else ""
        note = self.parameters.get(name, name)
        return name not in STRUCTURES if self.is_law else note in (name, "Array", "IntArray")

    def check_call(self, node: ast.Call, text: str) -> None:
        """Check a call: of a kernel, or of FUNCTIONS, with arguments by position."""
        root, value = _root(node.func), self.meaning(node.func)
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            self.complain(node, f"{text}() is called with keywords or *", "give its arguments by position")
        if not isinstance(root, ast.Name) or root.id in self.local:
            if "Callable" not in self.parameters.get(text, ""):
                self.complain(node, f"a call of {text}()", f"{LOOP}, or call math and kernels")
        elif is_kernel(value):
            self.kernels.append((node, plain(value)))
        elif value is MISSING:
            self.check_name(node.func, text)
        elif is_foreign(self.function) and value is Fis:  # whose indices nobody has checked
            self.complain(node, f"{text}() makes a fuzzy system", "declare it, Annotated[Fis, Rules(...)]")
        elif not any(value is known for known in FUNCTIONS) and not hasattr(value, "_fields"):  # labels on a tuple
            self.complain(node, f"{text}()", *_call_cure(text, value))

    # Writes.

    def assign(self, target: ast.expr, value: ast.expr) -> None:
        """Note what a variable is given."""
        if isinstance(target, ast.Tuple):
            values = value.elts if isinstance(value, ast.Tuple) else [value] * len(target.elts)
            for one, its in zip(target.elts, values, strict=False):
                self.assign(one, its)
        elif isinstance(target, ast.Name):
            self.assigned.setdefault(target.id, []).append(value)

    def places(self, node: ast.expr, seen: frozenset[str] = frozenset()) -> set[str]:
        """Return the arguments and their fields, ``q`` or ``memory.s``, that a value may be, or be part of, ``q[]``.

        Args:
            node: The expression.
            seen: Variables that have been followed.
        """
        match node:
            case ast.Name(id=name):
                values = [] if name in seen else self.assigned.get(name, [])
                own = set() if self.parameters.get(name, "float") in ("float", "int", "bool") else {name}
                return own.union(*(self.places(x, seen | {name}) for x in values))
            case ast.Attribute():
                return {f"{place}.{node.attr}" for place in self.places(node.value, seen)}
            case ast.IfExp():
                return self.places(node.body, seen) | self.places(node.orelse, seen)
            case ast.Subscript(value=inside):
                return {place.removesuffix("[]") + "[]" for place in self.places(inside, seen)}
            case ast.Call(args=inside) | ast.Tuple(elts=inside):
                return {place.removesuffix("[]") + "[]" for x in inside for place in self.places(x, seen)}
        return set()

    def writes(self, known: dict[Any, set[str]]) -> Iterator[tuple[int, str, str]]:
        """Yield the line of each write to an argument, the argument or its field, and how it is written to.

        Args:
            known: What kernels write to, as far as it is known.
        """
        for node in self.stored:
            for place in self.places(node.value):
                yield node.lineno, place.replace("[]", ""), f"{ast.unparse(node)} = ..."
        for call, kernel in self.kernels:
            for name, dot, rest in (written.partition(".") for written in _written(kernel, known)):
                index = kernel.__code__.co_varnames.index(name)
                for place in self.places(call.args[index]) if index < len(call.args) else ():
                    yield call.lineno, place.replace("[]", "") + dot + rest, f"{ast.unparse(call.func)}() fills it"

    def handed(self, known: dict[Any, set[str]]) -> Iterator[tuple[int, str, str]]:
        """Yield the line of each call that hands an array to a kernel of the package, what it may be, and the call.

        Args:
            known: What kernels hand over, as far as it is known.
        """
        for call, kernel in self.kernels:
            for name, rest in (re.fullmatch(r"(\w*)(.*)", own).groups() for own in _handed(kernel, known)):  # type: ignore[union-attr]
                names = kernel.__code__.co_varnames[: len(call.args)]
                given = self.places(call.args[names.index(name)]) if name in names else set()
                for place in given or {"what cannot be told"}:
                    yield call.lineno, re.sub(r"(\[\])+", "[]", place + rest), f"{ast.unparse(call.func)}()"


def _handed(kernel: FunctionType, known: dict[Any, set[str]]) -> set[str]:
    """Return the parameters of a kernel, or parts of them, that are handed to a kernel of the package as arrays."""
    if kernel not in known:
        known[kernel] = set()  # one that calls itself
        if kernel.__module__.startswith("torquebench."):
            known[kernel] = {name for name, note in kernel.__annotations__.items() if "Array" in str(note)}
        elif (node := definition(kernel)) is not None:
            known[kernel] = {place for _, place, _ in _Reader(kernel, node, False).handed(known)}
    return known[kernel]


_OWN: Final[dict[Any, set[str]]] = {}
"""What kernels of the package write to, as far as a law has asked."""


def _written(kernel: FunctionType, known: dict[Any, set[str]]) -> set[str]:
    """Return the parameters of a kernel, or fields of them, that it writes to."""
    if kernel.__module__.startswith("torquebench."):
        known = _OWN
    if kernel not in known:
        known[kernel] = set()  # one that calls itself
        node = definition(kernel)
        everything = set(kernel.__code__.co_varnames[: kernel.__code__.co_argcount])
        known[kernel] = everything if node is None else {x for _, x, _ in _Reader(kernel, node, False).writes(known)}
    return known[kernel]


def _call_cure(text: str, value: Any) -> tuple[str, str]:
    """Return what to write instead of a call outside the dialect, and the topic."""
    name, owner = text.rpartition(".")[2], getattr(value, "__self__", None)
    home = {text.partition(".")[0], str(getattr(value, "__module__", "")).partition(".")[0]}
    if IMPURE & home or "random" in f"{text}{type(owner).__module__}":
        return IMPURE_CURE, STATE
    if name in CURES or name in MATH:
        return CURES.get(name) or f"write math.{name}(x)", FORM
    if "numpy" in home or isinstance(value, np.ufunc):
        return LOOP, FORM
    return f"decorate {name} with kernel (from torquebench.kernel import kernel), in the law's own file", FORM


def _structure_complaints(law: Law) -> Iterator[Complaint]:
    """Complain about gains and memory that compiled code cannot receive."""
    for title, cls in (("gains", law.gains_type), ("memory", law.memory_type or Nothing)):
        line = line_of(cls, "", law.function)
        if not (is_structure(cls) and cls._fields):
            yield Complaint(line, f"its {title} are a {cls.__name__}", "make them a NamedTuple class with fields")
            continue
        try:
            annotations = get_type_hints(cls, include_extras=True)
        except NameError as error:
            yield Complaint(line, f"an annotation of {cls.__name__}: {error}", "import it, or define it above")
            continue
        for name, annotation in annotations.items():
            hint, *notes = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
            need = Array if title == "memory" or name in law.gains else int if name in law.options else hint
            if (int if hint is bool else hint) != need or (need == Array and any(type(note) is int for note in notes)):
                what = f"{cls.__name__}.{name} is annotated {getattr(annotation, '__name__', annotation)}"
                cure = f"annotate it {'int' if need is int else 'Array, from torquebench'}"
                yield Complaint(line_of(cls, name, law.function), what, cure)


def compiler_message(error: Exception, function: Any) -> str:
    """Say in one line what numba, whose texts are long, has against a function, and where.

    Args:
        error: What numba raised.
        function: The law.
    """
    text = re.sub(r" at 0x[0-9a-f]+", "", str(error))
    reason = re.search(r"Unknown attribute '\w+'|Cannot (unify|bind) [^\n,]*|Variable '[\w.]+' [^\n]*", text)
    calls = [x for x in re.findall(r">>> (\w+\([^\n]*\))", text) if not x.startswith(f"{function.__name__}(")]
    if "NRT required" in text or any("array(" in call for call in calls):
        what = f"an array where a number is wanted: {LOOP}"
    else:
        what = " ".join((reason.group() if reason else f"no {calls[0]}" if calls else text.partition("\n")[0]).split())
    code = function.__code__
    place = re.search(rf"{re.escape(code.co_filename)} \((\d+)\)", text)
    if place is None:
        return what
    line = int(place.group(1))
    return f"line {line}: {linecache.getline(code.co_filename, line, function.__globals__).strip()}: {what}"


def line_of(structure: Any, name: str, function: Any) -> int:
    """Return the line of a field of gains or memory, or of its class; of the law where that is in another file.

    Args:
        structure: The NamedTuple class.
        name: Its field; empty for the class.
        function: The law, whose file is read.
    """
    for node in ast.walk(module_of(function)):
        if isinstance(node, ast.ClassDef) and node.name == getattr(structure, "__name__", None):
            fields = {ast.unparse(x.target): x.lineno for x in node.body if isinstance(x, ast.AnnAssign)}
            return fields.get(name, node.lineno)
    return _line(function)


def is_kernel(value: Any) -> bool:
    """Whether a value is a function decorated with `kernel`."""
    return getattr(plain(value), "is_kernel", None) is True


def plain(value: Any) -> Any:
    """Return the Python function behind a compiled one."""
    return getattr(value, "py_func", value)


def _line(function: Any) -> int:
    return getattr(getattr(plain(function), "__code__", None), "co_firstlineno", 0)


def module_of(function: Any) -> ast.Module:
    """Return the syntax tree of a function's file as it was loaded, or of the cell; empty where there is none."""
    if not isinstance(function, FunctionType):
        return ast.Module([], [])
    return _tree_of("".join(linecache.getlines(function.__code__.co_filename, function.__globals__)))


@lru_cache(maxsize=256)
def _tree_of(text: str) -> ast.Module:
    try:
        return parse_python(text)
    except SyntaxError:  # the file was changed since it was loaded
        return ast.Module([], [])


@lru_cache(maxsize=256)
def _changed_in(tree: ast.Module) -> frozenset[str]:
    """Return the names of a file that a function of it declares global."""
    return frozenset(name for node in ast.walk(tree) if isinstance(node, ast.Global) for name in node.names)


@lru_cache(maxsize=256)
def _definitions(tree: ast.Module) -> dict[tuple[str, int], ast.FunctionDef]:
    """Return the functions of a file, at any depth: name and first line, decorators included -> definition."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return {(x.name, min([x.lineno, *(d.lineno for d in x.decorator_list)])): x for x in reversed(functions)}


def definition(function: FunctionType) -> ast.FunctionDef | None:
    """Return a function's definition in the text of its file; None where that is not at hand."""
    code = function.__code__
    return _definitions(module_of(function)).get((code.co_name, code.co_firstlineno))


def _text_of(node: ast.AST) -> str:
    """Return the beginning of what stands there, for a message."""
    return ast.unparse(node).split("\n")[0].rstrip(":")[:60]


def _root(node: ast.expr) -> ast.expr:
    """Return what attributes belong to: ``a`` of ``a.b.c``."""
    return _root(node.value) if isinstance(node, ast.Attribute) else node


def _beneath(node: ast.expr) -> list[ast.expr]:
    """Return what is left to read beneath attributes, where they are not those of a name."""
    return [root for root in [_root(node)] if not isinstance(root, ast.Name)]
