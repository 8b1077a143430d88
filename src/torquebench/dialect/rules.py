"""All rules of the dialect, applied to one function and to the kernels in its file that it calls."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from types import FunctionType

from torquebench.dialect.arithmetic import mistakes
from torquebench.dialect.assigned import unassigned
from torquebench.dialect.grammar import Grammar
from torquebench.dialect.kinds import Kind, Kinds, hints_of, of_hint
from torquebench.dialect.names import plain
from torquebench.dialect.source import INPUTS, STATE, Complaint, Source, own_nodes, parameters, read
from torquebench.dialect.writes import Place, Writes


class Rules:
    """The rules for a function that has its own idea of what it may write to, as a law has.

    Args:
        kinds: Kinds of its parameters.
        may_write: Whether it may write to a place; None for a function that may write to whatever it is given.
        fixed: Parameters that may not be given another value.
        returns: Whether it may return a value.
    """

    def __init__(
        self,
        kinds: Mapping[str, Kind] | None = None,
        may_write: Callable[[Place], bool] | None = None,
        fixed: frozenset[str] = frozenset(),
        returns: bool = True,
    ) -> None:
        self.kinds, self.may_write, self.fixed, self.returns = kinds, may_write, fixed, returns

    def complaints(self, function: FunctionType) -> list[Complaint]:
        """Return what in a function lies outside the dialect, in the order of its lines."""
        return sorted(set(self._read(function, {function})))

    def _read(self, function: FunctionType, seen: set[FunctionType]) -> list[Complaint]:
        source = read(function)
        line = function.__code__.co_firstlineno
        if source is None:
            return [Complaint(line, f"the source of {function.__name__} cannot be read", "define it in a file, by def")]
        arguments = source.node.args
        found = []
        if arguments.vararg or arguments.kwarg or arguments.defaults or arguments.kwonlyargs or arguments.kw_defaults:
            found.append(
                Complaint(
                    source.node.lineno,
                    f"{function.__name__}() has *args, **kwargs, or defaults",
                    "list its arguments by name, without defaults",
                    STATE,
                )
            )
        grammar = Grammar(source, self.fixed, self.returns)
        hints = {name: _parameter(hint) for name, hint in hints_of(function).items() if name != "return"}
        found += grammar.complaints + unassigned(source)
        given = {name: kind for name, kind in hints.items() if kind is not None} | dict(self.kinds or {})
        found += mistakes(Kinds(grammar, given))
        if getattr(function, "is_inline", False):
            found += [
                Complaint(x.lineno, "a division in an inline kernel", "mark it with plain @kernel")
                for x in own_nodes(source.node)
                if isinstance(x, ast.BinOp | ast.AugAssign) and isinstance(x.op, ast.Div | ast.FloorDiv | ast.Mod)
            ]
        for write in Writes().of(source, grammar) if self.may_write is not None else []:
            told = write.place is None and any(c.line == write.line and c.topic == STATE for c in found)
            if not told and (write.place is None or not self.may_write(write.place)):  # type: ignore[misc]
                where = "what is not the law's own" if write.place is None else _named(write.place, source)
                what = f"writes to {where} ({write.how})"
                found.append(Complaint(write.line, what, "write to elements of tau and memory only", INPUTS))
        for call, kernel in grammar.kernels:
            inner = plain(kernel)
            if inner.__module__.startswith("torquebench.") or inner in seen:
                continue
            seen.add(inner)
            if inner.__module__ != function.__module__:
                what = f"{inner.__name__}() is a kernel of another file"
                found.append(Complaint(call.lineno, what, "move it here: over there, changes would not be noticed"))
            else:
                found += Rules()._read(inner, seen)
        return found


def _parameter(hint: object) -> Kind | None:
    """Return the kind of a kernel's parameter: an array's dimensions are not stated."""
    kind = of_hint(hint)
    return Kind("array", (None, kind.detail[1])) if kind.name == "array" else kind if kind.name != "unknown" else None


def _named(place: Place, source: Source) -> str:
    return ".".join((parameters(source.node)[place.parameter], *place.attributes))
