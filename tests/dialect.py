"""The dialect of kernels and laws, as a checker of source text: what keeps interpreted and compiled bytes equal."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

STATEMENTS = (
    ast.Assign, ast.AugAssign, ast.AnnAssign, ast.Expr, ast.For, ast.While, ast.If, ast.Return, ast.Pass, ast.Break,
    ast.Continue,
)  # fmt: skip
EXPRESSIONS = (
    ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call, ast.Constant, ast.Name, ast.Attribute,
    ast.Subscript, ast.Tuple,
)  # fmt: skip
OPERATORS = (
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or,
    ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE,
)  # fmt: skip
MATH = {"sin", "cos", "tan", "sqrt", "exp", "log", "atan2", "atan", "tanh", "isfinite", "isnan", "pi", "floor"}
"""What may be taken from `math`; not pow, whose compiled form with a constant exponent differs, nor fsum or prod."""
BUILTINS = {"abs", "range", "len"}
"""Not min and max (they treat NaN differently compiled), sum (its order is not ours) or round."""


@dataclass
class Module:
    """What the checker knows about one source file."""

    tree: ast.Module
    kernels: set[str] = field(default_factory=set)
    """Functions that a kernel may call: kernels, and NamedTuple classes, which are only labels on tuples."""
    constants: set[str] = field(default_factory=set)
    """Module-level names of numbers, in capitals."""
    imported: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Local name -> (module, name there)."""


def decorated(function: ast.FunctionDef) -> str | None:
    """Return ``kernel`` or ``controller`` when that is among the function's decorators."""
    for decorator in function.decorator_list:
        target = decorator.func if isinstance(decorator, ast.Call) else decorator
        name = target.id if isinstance(target, ast.Name) else target.attr if isinstance(target, ast.Attribute) else ""
        if name in ("kernel", "controller"):
            return name
    return None


def read(text: str) -> Module:
    """Return what the checker needs to know of a module's text."""
    module = Module(ast.parse(text))
    for node in ast.walk(module.tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                module.imported[alias.asname or alias.name] = (node.module, alias.name)
        elif isinstance(node, ast.FunctionDef) and decorated(node) == "kernel":
            module.kernels.add(node.name)
        elif isinstance(node, ast.ClassDef) and any(
            isinstance(b, ast.Name) and b.id == "NamedTuple" for b in node.bases
        ):
            module.kernels.add(node.name)
    for node in module.tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        for target in targets:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            module.constants |= {x.id for x in names if isinstance(x, ast.Name) and x.id.isupper()}
    return module


def package(root: Path) -> dict[str, Module]:
    """Return every module of the package under `root`, by dotted name."""
    modules = {}
    for path in sorted(root.rglob("*.py")):
        parts = [root.name, *path.relative_to(root).with_suffix("").parts]
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = read(path.read_text(encoding="utf-8"))
    return modules


def functions(module: Module) -> Iterator[ast.FunctionDef]:
    """Every kernel and every registered law of a module."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.FunctionDef) and decorated(node):
            yield node


def violations(function: ast.FunctionDef, module: Module, modules: dict[str, Module]) -> list[str]:
    """Return what in a kernel or law lies outside the dialect, as ``line: what``."""
    found: list[str] = []
    arguments = function.args
    if arguments.vararg or arguments.kwarg or arguments.defaults or arguments.kw_defaults:
        found.append(f"{function.lineno}: *args, **kwargs or defaults")
    local = {a.arg for a in (*arguments.posonlyargs, *arguments.args)}
    body = function.body
    if ast.get_docstring(function) is not None:
        body = body[1:]
    nodes = [node for statement in body for node in _walk(statement)]
    local |= {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    for node in nodes:
        problem = _problem(node, local, module, modules)
        if problem:
            found.append(f"{node.lineno}: {problem}")  # type: ignore[attr-defined]
    return found


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Walk without annotations, which do nothing at run time."""
    yield node
    for name, value in ast.iter_fields(node):
        if name == "annotation":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.stmt | ast.expr | ast.operator | ast.cmpop | ast.boolop | ast.unaryop):
                yield from _walk(child)
            elif isinstance(child, ast.comprehension | ast.keyword | ast.excepthandler | ast.withitem):
                yield from ast.walk(child)


def _problem(node: ast.AST, local: set[str], module: Module, modules: dict[str, Module]) -> str | None:
    kind = type(node).__name__
    if isinstance(node, ast.BinOp | ast.AugAssign) and not isinstance(node.op, OPERATORS):
        return f"operator {type(node.op).__name__}"
    if isinstance(node, ast.Compare) and not all(isinstance(op, OPERATORS) for op in node.ops):
        return "operator in or is"
    if isinstance(node, ast.UnaryOp) and not isinstance(node.op, OPERATORS):
        return f"operator {type(node.op).__name__}"
    if isinstance(node, ast.stmt) and not isinstance(node, STATEMENTS):
        return f"statement {kind}"
    if isinstance(node, ast.expr) and not isinstance(node, EXPRESSIONS):
        return f"expression {kind}"
    if isinstance(node, ast.Expr):
        return None if isinstance(node.value, ast.Call) else "expression without effect"
    if isinstance(node, ast.Constant) and not isinstance(node.value, int | float):
        return f"constant {node.value!r}"
    if isinstance(node, ast.For) and not (isinstance(node.iter, ast.Call) and _name(node.iter.func) == "range"):
        return "loop over anything but range()"
    if isinstance(node, ast.Attribute) and _name(node.value) == "math" and node.attr not in MATH:
        return f"math.{node.attr}"
    if isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store) and _root(node) not in local:
        return f"writes to the global {_root(node)}"
    if isinstance(node, ast.Call):
        return _call_problem(node, module, modules)
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id not in local:
        return None if _known(node.id, module, modules) else f"global {node.id}"
    return None


def _call_problem(node: ast.Call, module: Module, modules: dict[str, Module]) -> str | None:
    if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
        return "call with keywords or *"
    if isinstance(node.func, ast.Name):
        name = node.func.id
        return None if name in BUILTINS or _callable(name, module, modules) else f"call of {name}"
    if isinstance(node.func, ast.Attribute):
        owner = _name(node.func.value)
        if owner == "math":
            return None  # the attribute itself is checked
        home, there = module.imported.get(owner or "", ("", ""))
        other = modules.get(f"{home}.{there}")
        if other is not None and node.func.attr in other.kernels:
            return None
        return f"call of {owner or '...'}.{node.func.attr}"
    return "call of an expression"


def _callable(name: str, module: Module, modules: dict[str, Module]) -> bool:
    if name in module.kernels:
        return True
    home, there = module.imported.get(name, ("", ""))
    return home in modules and there in modules[home].kernels


def _known(name: str, module: Module, modules: dict[str, Module]) -> bool:
    if name in BUILTINS or name == "math" or name in module.constants or _callable(name, module, modules):
        return True
    home, there = module.imported.get(name, ("", ""))
    return f"{home}.{there}" in modules or (home in modules and there in modules[home].constants)


def _name(node: ast.AST) -> str | None:
    return node.id if isinstance(node, ast.Name) else None


def _root(node: ast.AST) -> str | None:
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return _name(node)
