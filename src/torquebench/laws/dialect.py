"""Whether a law can be compiled: the rules of the dialect, its signature, and what its gains and memory hold."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from functools import lru_cache, partial
from types import FunctionType
from typing import Any, get_type_hints

from torquebench.dialect.kinds import FLOAT, of_hint
from torquebench.dialect.rules import Rules
from torquebench.dialect.source import Complaint, read
from torquebench.dialect.writes import Place
from torquebench.kernel import Array
from torquebench.kernel.struct import layout
from torquebench.laws.law import Law, Nothing
from torquebench.references import Reference
from torquebench.robot.flat_model import Model

ARGUMENTS = ("gains", "model", "t", "q", "qd", "ref", "memory", "tau")
"""What a law is called with, in this order."""
MODEL, MEMORY, TAU = 1, 6, 7


def complaints(law: Law) -> list[Complaint]:
    """Return what keeps a law from being compiled; an empty list means that nothing does.

    The package's own laws are not read again: the tests hold them to the dialect.
    """
    return [] if str(getattr(law.function, "__module__", "")).startswith("torquebench.") else list(_read(law))


def keeps_dialect(law: Law) -> bool:
    """Whether a law can be compiled."""
    return not complaints(law)


@lru_cache(maxsize=256)
def _read(law: Law) -> tuple[Complaint, ...]:
    function: Any = law.function
    if not isinstance(function, FunctionType):
        what = "is compiled already" if hasattr(function, "py_func") else f"is a {type(function).__name__}"
        return (Complaint(_line(function), f"law '{law.name}' {what}", "use @controller on a plain function"),)
    return tuple(sorted({*_signature(function), *_structures(law), *law_rules(law).complaints(function)}))


def law_rules(law: Law) -> Rules:
    """Return the rules for a law's function."""
    structures = {"gains": law.gains_type, "model": Model, "ref": Reference, "memory": law.memory_type or Nothing}
    kinds = {name: of_hint(cls) for name, cls in structures.items()} | dict.fromkeys(("q", "qd", "tau"), of_hint(Array))
    return Rules(
        kinds | {"t": FLOAT},
        _may_write,
        fixed=frozenset(ARGUMENTS) - {"t"},
        returns=False,
    )


def _may_write(place: Place) -> bool:
    first = place.attributes[:1]
    own = place.parameter == MEMORY and first != ()
    return place.parameter == TAU or own or (place.parameter == MODEL and first == ("scratch",))


def _signature(function: FunctionType) -> Iterator[Complaint]:
    names = tuple(inspect.signature(function, follow_wrapped=False).parameters)
    if names != ARGUMENTS:
        yield Complaint(
            _line(function), f"the arguments are ({', '.join(names)})", f"call them ({', '.join(ARGUMENTS)})"
        )


def _structures(law: Law) -> Iterator[Complaint]:
    """Complain about gains and memory that compiled code cannot receive."""
    wanted = {name: "Array" for name in law.gains} | {name: "int" for name in law.options}
    for title, cls in (("gains", law.gains_type), ("memory", law.memory_type)):
        if cls is None:
            continue
        lines = partial(line_of, cls, function=law.function)
        if not (isinstance(cls, type) and issubclass(cls, tuple) and len(getattr(cls, "_fields", "")) > 0):
            yield Complaint(
                lines(""),
                f"its {title} are a {getattr(cls, '__name__', cls)}",
                "make them a NamedTuple class with at least one field",
            )
            continue
        try:
            hints = get_type_hints(cls)
            fields = layout(cls)[0]
        except NameError as error:
            yield Complaint(lines(""), f"an annotation of {cls.__name__}: {error}", "import it, or define it above")
            continue
        except TypeError as error:
            name = next((name for name in cls._fields if f"{cls.__name__}.{name} " in str(error)), "")  # type: ignore[attr-defined]
            yield Complaint(lines(name), f"{error}".partition(", wanted")[0], "annotate it Array, from torquebench")
            continue
        for name in cls._fields:  # type: ignore[attr-defined]
            kind = of_hint(hints[name], fields[name].dimensions)
            need = "Array" if title == "memory" else wanted.get(name)
            if (need == "Array" and kind != of_hint(Array)) or (need == "int" and kind.name != "int"):
                yield Complaint(
                    lines(name),
                    f"{cls.__name__}.{name} is annotated {_short(hints[name])}",
                    f"annotate it {need}{', from torquebench' if need == 'Array' else ''}",
                )


def line_of(structure: Any, name: str, function: Any) -> int:
    """Return the line on which a field of gains or memory stands: of the class, or else of the law, if it is elsewhere.

    Args:
        structure: The NamedTuple class.
        name: Its field; empty for the class.
        function: The law, whose file is read.
    """
    source = read(function) if isinstance(function, FunctionType) else None
    for node in ast.walk(source.module) if source is not None else ():
        if isinstance(node, ast.ClassDef) and node.name == getattr(structure, "__name__", None):
            fields = {ast.unparse(x.target): x.lineno for x in node.body if isinstance(x, ast.AnnAssign)}
            return fields.get(name, node.lineno)
    return _line(function)


def _line(function: Any) -> int:
    return getattr(getattr(getattr(function, "py_func", function), "__code__", None), "co_firstlineno", 0)


def _short(hint: Any) -> str:
    return getattr(hint, "__name__", str(hint))
