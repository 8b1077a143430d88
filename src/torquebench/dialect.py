"""The dialect of laws and kernels: what may stand in source that gives the same bytes interpreted and compiled.

A whitelist of syntax and names (`ALLOWED`, `MATH`, `BUILTINS`), and four rules that no compiler enforces: every
variable has a value before it is read; no variable is an integer in one case and a float in another; constants do not
change; a law writes to nothing but ``tau``, ``memory`` and ``model.scratch``. A law outside the dialect runs
interpreted.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import linecache
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache, reduce
from types import FunctionType, ModuleType
from typing import Annotated, Any, Final, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from torquebench.errors import did_you_mean
from torquebench.kernel import Array, IntArray
from torquebench.kernel.struct import is_structure
from torquebench.laws.law import Law
from torquebench.references import Reference
from torquebench.robot.flat_model import Model

ALLOWED: Final = (
    *(ast.Assign, ast.AnnAssign, ast.AugAssign, ast.Expr, ast.For, ast.While, ast.If, ast.Return, ast.Pass),
    *(ast.Break, ast.Continue, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Tuple, ast.Constant),
    *(ast.Call, ast.Subscript, ast.Name, ast.Attribute),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or),
    *(ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE),
)
"""Statements, expressions and operators that mean the same interpreted and compiled."""
MATH = (
    "sin cos tan asin acos atan atan2 sinh cosh tanh sqrt exp expm1 log log1p floor fabs copysign isfinite isnan "
    "pi inf nan"
).split()
"""What may be taken from `math`: what gives the same bytes compiled. Not pow, hypot or fsum."""
BUILTINS = (abs, range, len)
"""Not min and max (compiled, they treat NaN differently), sum (it adds in another order) or round."""
ARGUMENTS = ("gains", "model", "t", "q", "qd", "ref", "memory", "tau")
"""What a law is called with, in this order."""
WRITABLE = re.compile(r"(tau|memory\.\w+|model\.scratch(\.\w+)?)(\[\])*")
"""Parts of its arguments that a law may write to."""

LOOP = "loop over the elements, for i in range(len(tau))"
STATE_CURE = "keep what must survive in memory, and pass what is chosen as a gain"
IMPURE_CURE = "a law depends on its arguments alone: the time is t, and noise belongs to the experiment"
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
IMPURE = {"random", "time", "datetime", "os", "secrets", "uuid"}
FORM, INPUTS, STATE = "form", "inputs", "state"
"""What a complaint is about: how something is written, a write to something not the law's own, hidden state."""
MISSING: Final = object()
"""What a name means that means nothing."""
MIXED = "mixed"
"""Kind of a number that is an integer in one case and a float in another."""


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


def keeps_dialect(law: Law) -> bool:
    """Whether nothing in a law's source keeps it from being compiled."""
    return not complaints(law)


def complaints(law: Law) -> list[Complaint]:
    """Return what in a law's source keeps it from being compiled; empty for a law in the dialect.

    The package's own laws are not read again: the tests hold them to the dialect.
    """
    return [] if str(getattr(law.function, "__module__", "")).startswith("torquebench.") else list(_read_once(law))


@lru_cache(maxsize=256)
def _read_once(law: Law) -> tuple[Complaint, ...]:
    return tuple(read_law(law))


def read_law(law: Law) -> list[Complaint]:
    """Read a law, and the kernels of its file that it calls, and return what lies outside the dialect, by line."""
    function: Any = law.function
    if not isinstance(function, FunctionType):
        what = "is compiled already" if hasattr(function, "py_func") else f"is a {type(function).__name__}"
        return [Complaint(_line(function), f"law '{law.name}' {what}", "use @controller on a plain function")]
    found = list(_structure_complaints(law))
    names = ", ".join(inspect.signature(function, follow_wrapped=False).parameters)
    if names != ", ".join(ARGUMENTS):
        found.append(Complaint(_line(function), f"the arguments are ({names})", f"call them ({', '.join(ARGUMENTS)})"))
    return sorted({*found, *_read(function, law, {function})})


def read_kernel(function: FunctionType) -> list[Complaint]:
    """Read a kernel, and the kernels of its file that it calls, and return what lies outside the dialect, by line."""
    return sorted(set(_read(function, None, {function})))


def _read(function: FunctionType, law: Law | None, seen: set[FunctionType]) -> Iterator[Complaint]:
    reader = _Reader.of(function, law)
    if reader is None:
        what = f"the source of {function.__name__} cannot be read"
        yield Complaint(_line(function), what, "define it in a file, by def")
        return
    yield from reader.complaints()
    for call, kernel in reader.kernels:
        if kernel.__module__.startswith("torquebench.") or kernel in seen:
            continue
        seen.add(kernel)
        if kernel.__module__ == function.__module__:
            yield from _read(kernel, None, seen)
        else:
            what = f"{kernel.__name__}() is a kernel of another file"
            yield Complaint(call.lineno, what, "move it here: changes in the other file would not be noticed")


class _Reader:
    """Reads one function: its syntax and names, then what its variables hold and what it writes to."""

    def __init__(self, function: FunctionType, node: ast.FunctionDef, module: ast.Module, law: Law | None) -> None:
        self.function, self.node, self.module, self.law = function, node, module, law
        self.body = node.body[1:] if ast.get_docstring(node) is not None else node.body
        self.nodes = list(_nodes(ast.Module(self.body, [])))[1:]
        a = node.args
        self.parameters = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x is not None]
        self.variables = _stored(self.nodes)
        self.local = {*self.variables, *function.__code__.co_varnames, *function.__code__.co_cellvars}
        self.callables = {x.arg for x in a.args if "Callable" in ast.unparse(x.annotation or x)}
        self.kernels: list[tuple[ast.Call, Any]] = []
        """Calls of kernels, in the order of the text."""
        self.collected: list[Complaint] = []
        self.early: set[str] = set()
        """Variables that may be read before they have a value."""
        self.read()
        hints = _hints(function)
        self.parts = _parts_of_law(law) if law else {str(k): hints.get(x) for k, x in enumerate(self.parameters)}
        """What the parts of the arguments are annotated: ``model.mass`` of a law, ``0`` of a kernel."""
        self.kinds: dict[str, Any] = {"t": float} if law else {k: NUMBERS.get(hints[k]) for k in hints}
        """`int`, `float` or MIXED for each variable, None where it is not known."""
        places = ARGUMENTS if law else map(str, range(len(self.parameters)))
        self.places = {name: {place} for name, place in zip(self.parameters, places, strict=False)}
        """Parts of arguments that a variable may be: of a law ``model.mass[]``, of a kernel ``0.mass[]``."""
        self.integer_at: dict[str, int] = {}
        """Line on which a variable is first given an integer."""
        self.follow_assignments()

    @classmethod
    def of(cls, function: FunctionType, law: Law | None = None) -> _Reader | None:
        """Read a function; None where its source is not at hand."""
        module, code = _module_of(function), function.__code__
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef) and node.name == code.co_name:
                if min([node.lineno, *(x.lineno for x in node.decorator_list)]) == code.co_firstlineno:
                    return cls(function, node, module, law)
        return None

    def complain(self, node: ast.AST, what: str, cure: str, topic: str = FORM) -> None:
        """Note something outside the dialect: where, what it is, what to write instead, and its topic."""
        self.collected.append(Complaint(getattr(node, "lineno", self.node.lineno), what, cure, topic))

    def complaints(self) -> list[Complaint]:
        """Return all that lies outside the dialect."""
        a = self.node.args
        if a.vararg or a.kwarg or a.defaults or a.kwonlyargs:
            what = f"{self.node.name}() has *args, **kwargs, or defaults"
            self.complain(self.node, what, "list its arguments by name, without defaults", STATE)
        self.check_values(self.body, set(self.parameters))
        self.check_numbers()
        for line, place, how in self.writes({}) if self.law else ():
            is_explained = not place and any(c.line == line and c.topic == STATE for c in self.collected)
            if not is_explained and not WRITABLE.fullmatch(place):
                what = f"writes to {place.replace('[]', '') or 'what is not its own'} ({how})"
                self.collected.append(Complaint(line, what, "write to elements of tau and memory only", INPUTS))
        return self.collected

    # Syntax and names.

    def read(self) -> None:
        """Check each statement and expression against the whitelist."""
        done: set[int] = set()
        for node in self.nodes:
            operators = [*getattr(node, "ops", ()), *([node.op] if hasattr(node, "op") else ())]
            outside = [x for x in (node, *operators) if not isinstance(x, ALLOWED)]
            if id(node) in done or not isinstance(node, ast.expr | ast.stmt):
                continue
            text = ast.unparse(node).split("\n")[0].rstrip(":")[:60]
            for name in [type(x).__name__ for x in outside]:
                cure = CURES.get(name.removeprefix("Not"), "use arithmetic, if, for, while and calls of kernels")
                self.complain(node, text, cure, STATE if name in ("Global", "Nonlocal") else FORM)
            if outside == [node] and isinstance(node, ast.expr):
                done.update(map(id, ast.walk(node)))
                continue
            match node:
                case ast.Assign() | ast.AugAssign() | ast.AnnAssign():
                    for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                        self.check_target(target)
                case ast.Expr() if isinstance(node.value, ALLOWED) and not isinstance(node.value, ast.Call):
                    self.complain(node, f"{text}, without effect", "leave it out")
                case ast.For():
                    self.check_target(node.target)
                    if not (isinstance(node.iter, ast.Call) and self.meaning(node.iter.func) is range):
                        self.complain(node.iter, text, "write for i in range(len(tau))")
                case ast.Return(value=ast.expr()) if self.law:
                    cure = "fill tau[i] in a loop; an array that is returned is allocated at every call"
                    self.complain(node, "a value is returned", cure)
                case ast.Subscript() if any(isinstance(x, ast.Slice) for x in ast.walk(node.slice)):
                    self.complain(node, text, LOOP)
                    done.update(map(id, ast.walk(node.slice)))
                case ast.Constant() if type(node.value) not in NUMBERS:
                    self.complain(node, f"the constant {text}", "compute with numbers only")
                case ast.Call():
                    self.check_call(node, ast.unparse(node.func))
                    done.update(id(x) for x in _chain(node.func) if isinstance(x, ast.Attribute | ast.Name))
                case ast.Name() | ast.Attribute() if not isinstance(node.ctx, ast.Store):
                    self.check_name(node, text)
                    done.update(id(x) for x in _chain(node) if isinstance(x, ast.Attribute | ast.Name))

    def check_target(self, node: ast.expr) -> None:
        """Check what is given a value: variables and elements of arrays."""
        text = ast.unparse(node)
        if isinstance(node, ast.Tuple):
            for element in node.elts:
                self.check_target(element)
        elif isinstance(node, ast.Attribute):
            self.complain(node, f"the attribute {text} is assigned", f"write to the elements, {text}[i] = ...", INPUTS)
        elif isinstance(node, ast.Name) and self.law and text in self.parameters and text != "t":
            cure = "fill tau[i], element by element" if text == "tau" else "take another name"
            self.complain(node, f"{text} = ... only rebinds the name", cure, INPUTS)

    def is_local(self, node: ast.expr) -> bool:
        """Whether an expression is no name of the file's: a parameter, a variable, or no name at all."""
        return not isinstance(node, ast.Name) or node.id in self.local

    def meaning(self, node: ast.expr) -> Any:
        """Return what a global name, or an attribute of a global module, means; MISSING for anything local."""
        if isinstance(node, ast.Attribute):
            owner = self.meaning(node.value)
            return getattr(owner, node.attr, MISSING) if isinstance(owner, ModuleType) else MISSING
        if self.is_local(node) or not isinstance(node, ast.Name) or node.id in self.function.__code__.co_freevars:
            return MISSING
        return self.function.__globals__.get(node.id, getattr(builtins, node.id, MISSING))

    def check_name(self, node: ast.Name | ast.Attribute, text: str) -> None:
        """Check a name, or an attribute, that is used as a value: local ones and numbers that do not change."""
        *_, root = _chain(node)
        if self.is_local(root) or not isinstance(root, ast.Name):
            return
        value, name = self.meaning(node), text.rpartition(".")[2]
        if root.id in self.function.__code__.co_freevars:
            self.complain(node, f"{text}, of the function around it", STATE_CURE, STATE)
        elif type(value) in NUMBERS and isinstance(node, ast.Name):
            if self.changes(text):
                self.complain(node, f"{text}, which changes", STATE_CURE, STATE)
            elif not text.isupper():
                self.complain(node, f"the global {text}", f"call it {text.upper()}, as a constant is", STATE)
        elif type(value) in NUMBERS:
            home = self.meaning(root).__name__.partition(".")[0]
            if home == "math" and name not in MATH:
                self.complain(node, text, f"not the same compiled{did_you_mean(name, MATH)}")
            elif home not in ("math", "numpy", "torquebench"):
                self.complain(node, f"{text}, a number of another file", f"from {home} import {name}", STATE)
        elif value is MISSING and (root is node or isinstance(self.meaning(root), ModuleType)):
            self.complain(node, f"{text}, which is not defined", f"check the spelling{self.nearest(name)}")
        elif isinstance(value, np.number):  # which divides by zero in another way than Python's
            self.complain(node, f"{text}, a {type(value).__name__}", "make it a plain Python number, float(...)")
        elif isinstance(value, ModuleType) or callable(value):
            self.complain(node, f"{text} used as a value", "call it where its value is needed")
        else:
            kind = type(self.meaning(root))
            cure = IMPURE_CURE if "random" in kind.__module__ else STATE_CURE
            self.complain(node, f"{root.id}, a {kind.__name__} outside the law", cure, STATE)

    def changes(self, name: str) -> bool:
        """Whether the file can give a global another value later on."""
        if any(name in x.names for x in ast.walk(self.module) if isinstance(x, ast.Global)):
            return True
        nodes = list(_nodes(self.module))
        loops = (x for x in nodes if isinstance(x, ast.For | ast.While | ast.AugAssign))
        times = sum(isinstance(x, ast.Name) and x.id == name and isinstance(x.ctx, ast.Store) for x in nodes)
        return times > 1 or any(name in _stored(_nodes(loop)) for loop in loops)

    def check_call(self, node: ast.Call, text: str) -> None:
        """Check a call: of a kernel, of `math` or of BUILTINS, with arguments by position."""
        *_, root = _chain(node.func)
        value = self.meaning(node.func)
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            self.complain(node, f"{text}() is called with keywords or *", "give its arguments by position")
        if self.is_local(root):
            if text not in self.callables:
                self.complain(node, f"a call of {text}()", f"{LOOP}, or call math and kernels")
        elif is_kernel(value):
            self.kernels.append((node, plain(value)))
        elif value is MISSING and isinstance(node.func, ast.Name | ast.Attribute):
            self.check_name(node.func, text)
        elif not any(value is known for known in (*BUILTINS, *(getattr(math, name) for name in MATH))):
            is_label = isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")
            if not is_label:  # a NamedTuple is but labels on a tuple
                self.complain(node, f"{text}()", *_call_cure(text, value))

    def nearest(self, name: str) -> str:
        """Return the name that was most likely meant instead of one that is not defined."""
        own = {*self.function.__globals__, *self.variables, *self.parameters, *MATH, "sat", "sign", "clip", "gravity"}
        return did_you_mean(name, sorted(name for name in own if not name.startswith("_")))

    # Values: every variable has one before it is read.

    def check_values(self, block: Sequence[ast.stmt], known: set[str]) -> set[str] | None:
        """Complain about variables that may be read too early: there Python raises, and compiled code goes on.

        Returns those that have a value after the block, or None where its end is never reached.
        """
        for statement in block:
            parts = [x for x in ast.iter_child_nodes(statement) if isinstance(x, ast.expr)]
            for x in (x for part in parts for x in _nodes(part) if isinstance(x, ast.Name)):
                is_read = isinstance(x.ctx, ast.Load) or isinstance(statement, ast.AugAssign)
                if is_read and x.id in self.variables - known - self.early:
                    self.early.add(x.id)
                    self.complain(x, f"{x.id} may not have a value yet", "give it one before the branch or the loop")
            match statement:
                case ast.If():
                    ends = [self.check_values(way, known) for way in (statement.body, statement.orelse)]
                    if ends == [None, None]:
                        return None
                    known = set.intersection(*(end for end in ends if end is not None))
                case ast.For() | ast.While():
                    counter = _stored(_nodes(statement.target)) if isinstance(statement, ast.For) else set()
                    self.check_values(statement.body, known | counter)
                    self.check_values(statement.orelse, known)
                case ast.Return() | ast.Break() | ast.Continue():
                    return None
                case ast.Assign() | ast.AnnAssign(value=ast.expr()):
                    known = known | _stored(_nodes(statement))
        return known

    # Numbers: no variable is an integer in one case and a float in another, where compiled code would make 0 a 0.0,
    # whose negative is -0.0; and no arithmetic is on whole arrays.

    def follow_assignments(self) -> None:
        """Find out what each variable holds, and which part of an argument it may be."""
        pairs = [pair for node in self.nodes for pair in _assigned(node)]
        for _ in range(len(pairs) + 1):  # a name is followed through at least one more per round
            before = str((self.kinds, self.places))
            for name, value, line in pairs:
                kind = self.kind(value)
                if kind is int:
                    self.integer_at.setdefault(name, line)
                self.kinds[name] = _joined(self.kinds[name], kind) if name in self.kinds else kind
                self.places[name] = self.places.get(name, set()) | self.places_of(value)
            if str((self.kinds, self.places)) == before:
                break

    def kind(self, node: ast.expr) -> Any:
        """Return the kind of an expression's value; see `kinds`."""
        match node:
            case ast.Constant():
                return NUMBERS.get(type(node.value))
            case ast.Name() if node.id in self.kinds:
                return self.kinds[node.id]
            case ast.Name() | ast.Attribute() | ast.Subscript():
                parts = {self.parts.get(place.replace("[]", "")) for place in self.places_of(node)}
                known = [ELEMENTS.get(part, NUMBERS.get(part)) for part in parts]
                return reduce(_joined, known) if known else NUMBERS.get(type(self.meaning(node)))
            case ast.BinOp():
                kinds = {self.kind(node.left), self.kind(node.right)}
                is_float = isinstance(node.op, ast.Div) or float in kinds
                return float if is_float else reduce(_joined, kinds)
            case ast.UnaryOp():
                return int if isinstance(node.op, ast.Not) else self.kind(node.operand)
            case ast.BoolOp():
                return reduce(_joined, map(self.kind, node.values))
            case ast.Compare():
                return int
            case ast.IfExp():
                return _joined(self.kind(node.body), self.kind(node.orelse))
            case ast.Call():
                function = plain(self.meaning(node.func))
                if function in (len, math.floor, math.isfinite, math.isnan):
                    return int
                if function is abs:
                    return self.kind(node.args[0])
                return (
                    float
                    if getattr(function, "__module__", "") == "math"
                    else NUMBERS.get(_hints(function).get("return"))
                )
        return None

    def check_numbers(self) -> None:
        """Complain about numbers that may be of two kinds, whole arrays, and divisions where they may not be."""
        for name, line in self.integer_at.items():
            if self.kinds[name] == MIXED:
                what = f"{name} is an integer here and a float elsewhere"
                self.collected.append(Complaint(line, what, "write a float, as 0.0"))
        lines: set[int] = set()
        for node in self.nodes:
            if isinstance(node, ast.IfExp) and self.kind(node) == MIXED:
                self.complain(node, f"{ast.unparse(node)} is an integer or a float", "write both as floats")
            numbers = ast.iter_child_nodes(node) if isinstance(node, ast.BinOp | ast.UnaryOp | ast.Compare) else ()
            for x in numbers if self.law else ():
                places = self.places_of(x) if isinstance(x, ast.Name | ast.Attribute) else set()
                is_whole = any(self.parts.get(place) in ELEMENTS for place in places)
                if is_whole and isinstance(x, ast.expr) and x.lineno not in lines:
                    lines.add(x.lineno)
                    self.complain(x, f"{ast.unparse(x)} is a whole array in arithmetic", LOOP)
            is_division = isinstance(getattr(node, "op", None), ast.Div | ast.FloorDiv | ast.Mod)
            if is_division and getattr(self.function, "is_inline", False):  # copied into a law, it would raise there
                self.complain(node, "a division in an inline kernel", "decorate it with plain kernel")

    # Writes.

    def places_of(self, node: ast.expr) -> set[str]:
        """Return the parts of arguments that an expression may be, or be part of; see `places`."""
        match node:
            case ast.Name():
                return self.places.get(node.id, set())
            case ast.Attribute():
                return {f"{place}.{node.attr}" for place in self.places_of(node.value) if place.count(".") < 4}
            case ast.Subscript() | ast.Call():
                inside = [node.value] if isinstance(node, ast.Subscript) else node.args
                return {f"{place.removesuffix('[]')}[]" for x in inside for place in self.places_of(x)}
            case ast.IfExp():
                return self.places_of(node.body) | self.places_of(node.orelse)
            case ast.Tuple():
                return {place for x in node.elts for place in self.places_of(x)}
        return set()

    def writes(self, known: dict[Any, set[str]]) -> Iterator[tuple[int, str, str]]:
        """Yield the line of each write to elements, the part of an argument ("" for anything else), and what it says.

        Args:
            known: What kernels write to, as far as it is known.
        """
        for node in self.nodes:
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                for place in sorted(self.places_of(node.value)) or [""]:
                    yield node.lineno, place, f"{ast.unparse(node)} = ..."
        for call, kernel in self.kernels:
            for place in sorted(_written(kernel, known)):
                index, dot, rest = place.partition(".")
                for own in sorted(self.places_of(call.args[int(index)])) if int(index) < len(call.args) else ():
                    yield call.lineno, own + dot + rest, f"{ast.unparse(call.func)}() fills it"


def _written(kernel: FunctionType, known: dict[Any, set[str]]) -> set[str]:
    """Return the parts of its arguments that a kernel writes to."""
    if kernel not in known:
        known[kernel] = set()  # one that calls itself
        reader = _Reader.of(kernel)
        everything = set(map(str, range(kernel.__code__.co_argcount)))
        places = everything if reader is None else {place for _, place, _ in reader.writes(known)} - {""}
        known[kernel] = {place.removesuffix("[]") for place in places}
    return known[kernel]


def _assigned(node: ast.AST) -> Iterator[tuple[str, ast.expr, int]]:
    """Yield each variable that a statement gives a value, the value, and the line."""
    match node:
        case ast.Assign():
            for target in node.targets:
                yield from _matched(target, node.value)
        case ast.AnnAssign(value=ast.expr() as value):
            yield from _matched(node.target, value)
        case ast.AugAssign(target=ast.Name(id=name)):
            yield name, ast.BinOp(ast.Name(name, ast.Load()), node.op, node.value), node.lineno
        case ast.For(target=ast.Name(id=name)):
            yield name, ast.Constant(0), node.lineno


def _matched(target: ast.expr, value: ast.expr) -> Iterator[tuple[str, ast.expr, int]]:
    if isinstance(target, ast.Name):
        yield target.id, value, target.lineno
    elif isinstance(target, ast.Tuple):
        values: list[ast.expr] = value.elts if isinstance(value, ast.Tuple) else []
        for k, element in enumerate(target.elts):
            is_same = len(values) == len(target.elts)
            yield from _matched(element, values[k] if is_same else ast.Subscript(value, ast.Constant(k), ast.Load()))


def _joined(a: Any, b: Any) -> Any:
    """Return the kind of a number that is of one kind or of another."""
    return a if a == b else MIXED if None not in (a, b) else None


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


NUMBERS: Final[dict[Any, Any]] = {int: int, bool: int, float: float}
ELEMENTS: Final[dict[Any, Any]] = {Array: float, IntArray: int}


def _parts_of_law(law: Law) -> dict[str, Any]:
    """Return the annotation of each part of a law's arguments that is a number or an array."""
    structures = {"gains": law.gains_type, "model": Model, "ref": Reference, "memory": law.memory_type}
    parts = {f"{name}.{field}": hint for name, cls in structures.items() for field, hint in _hints(cls).items()}
    return parts | {"t": float, "q": Array, "qd": Array, "tau": Array}


def _structure_complaints(law: Law) -> Iterator[Complaint]:
    """Complain about gains and memory that compiled code cannot receive."""
    wanted = {name: Array for name in law.gains} | {name: int for name in law.options}
    structures: dict[str, Any] = {"gains": law.gains_type, "memory": law.memory_type}
    for title, cls in structures.items():
        line = line_of(cls, "", law.function)
        try:
            hints = get_type_hints(cls, include_extras=True) if cls is not None else {}
        except NameError as error:
            yield Complaint(line, f"an annotation of {cls.__name__}: {error}", "import it, or define it above")
            continue
        if cls is not None and not (is_structure(cls) and getattr(cls, "_fields", None)):
            what = f"its {title} are a {getattr(cls, '__name__', cls)}"
            yield Complaint(line, what, "make them a NamedTuple class with at least one field")
            continue
        for name, annotation in hints.items():
            hint, *notes = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
            need = Array if title == "memory" else wanted.get(name, hint)
            if NUMBERS.get(hint, hint) != need or (need == Array and any(type(note) is int for note in notes)):
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
    for node in ast.walk(_module_of(function)):
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


def _module_of(function: Any) -> ast.Module:
    """Return the syntax tree of a function's file, or of the notebook's cell; an empty one where there is none."""
    if not isinstance(function, FunctionType):
        return ast.Module([], [])
    return _parsed("".join(linecache.getlines(function.__code__.co_filename, function.__globals__)))


@lru_cache(maxsize=256)
def _parsed(text: str) -> ast.Module:
    try:
        return ast.parse(text)
    except SyntaxError:  # the file was changed since it was loaded
        return ast.Module([], [])


def _nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Yield every node that runs when `scope` does, itself first: no functions and classes in it, no annotations."""
    yield scope
    for name, value in ast.iter_fields(scope):
        if name not in ("annotation", "returns", "decorator_list"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda):
                    yield child
                elif isinstance(child, ast.AST):
                    yield from _nodes(child)


def _stored(nodes: Iterable[ast.AST]) -> set[str]:
    """Return the names that are given a value in some nodes."""
    return {x.id for x in nodes if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)}


def _chain(node: ast.expr) -> Iterator[ast.expr]:
    """Yield an expression and what its attributes belong to: ``a.b.c``, ``a.b``, ``a``."""
    yield node
    if isinstance(node, ast.Attribute):
        yield from _chain(node.value)


def _hints(function: Any) -> dict[str, Any]:
    """Return a function's annotations, as far as they mean something."""
    try:
        return get_type_hints(function)
    except (NameError, TypeError, AttributeError, SyntaxError):
        return {}


def _line(function: Any) -> int:
    return getattr(getattr(plain(function), "__code__", None), "co_firstlineno", 0)
