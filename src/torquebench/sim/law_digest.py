"""What a law's compiled form depends on besides this package, as a name for it in the cache on disk."""

from __future__ import annotations

import hashlib
from types import CodeType, FunctionType, ModuleType
from typing import Any

from torquebench.kernel.struct import layout
from torquebench.laws.law import Law, Nothing


def law_digest(law: Law) -> str:
    """Return a digest of a law: its code, the numbers and kernels that it names, and what its gains and memory hold.

    A compiled law is found on disk by this, so that an edited law, constant or kernel is compiled again.
    """
    parts: list[str] = []
    _describe(law.function, parts, set())
    for cls in (law.gains_type, law.memory_type or Nothing):
        parts.append(_layout(cls))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]


def _layout(cls: type[Any]) -> str:
    fields, size = layout(cls)
    inner = {
        name: _layout(field.kind) if field.kind not in (int, float) and not field.dimensions else field
        for name, field in fields.items()
    }
    return f"{cls.__name__} {size} {inner}"


def _describe(function: Any, parts: list[str], seen: set[Any]) -> None:
    function = getattr(function, "py_func", function)
    if not isinstance(function, FunctionType) or function in seen:
        return
    seen.add(function)
    code = function.__code__
    parts.append(f"{function.__module__}.{function.__qualname__}")
    _code(code, parts)
    named = {name: function.__globals__[name] for name in code.co_names if name in function.__globals__}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        named[name] = cell.cell_contents
    for name, value in named.items():
        parts.append(f"{name} = {value!r}" if isinstance(value, int | float) else f"{name}: {_name(value)}")
        if not str(getattr(value, "__module__", "")).startswith("torquebench."):
            _describe(value, parts, seen)


def _code(code: CodeType, parts: list[str]) -> None:
    constants = [c for c in code.co_consts if not isinstance(c, str | CodeType)]
    parts.append(f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames} {code.co_flags}")


def _name(value: Any) -> str:
    if isinstance(value, ModuleType):
        return value.__name__
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)}"
