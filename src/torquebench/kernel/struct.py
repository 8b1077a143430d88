"""Structures in compiled code: a table of 8-byte words for each, passed as one address.

A compiled law has one fixed native signature whatever its gains, and no kernel takes dozens of arguments: a structure
reaches compiled code as the address of its table, and reading an attribute there makes a view, without allocating.
A field is an integer, a float, a C-contiguous array of float64 or int64 (annotated ``Annotated[Array, d]`` for d > 1
dimensions), or another structure, whose words lie inside its owner's. Interpreted, a structure is an ordinary object.
"""

from __future__ import annotations

import ctypes
import operator
import struct
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.arrayobj import make_array, populate_array

from torquebench.kernel import Array, IntArray

_KINDS = {kind: np.dtype(kind) for kind in (np.float64, np.int64)}
_DOUBLE, _DOUBLE_AS_INT = struct.Struct("<d"), struct.Struct("<q")


class Field(NamedTuple):
    """Where one field lies in its structure's table."""

    kind: Any
    """``int``, ``float``, a numpy scalar type for an array's elements, or a structure's class."""
    dimensions: int
    """Number of dimensions of an array, else 0."""
    offset: int
    """Word at which the field begins: a number, or an array's address followed by its shape."""


_layouts: dict[type[Any], tuple[dict[str, Field], int]] = {}
_readers: dict[type[Any], tuple[Callable[[Any], tuple[Any, ...]], tuple[tuple[str, Field], ...]]] = {}


def layout(structure: type[Any]) -> tuple[dict[str, Field], int]:
    """Return the fields of a structure's class by name, and the number of words in all.

    Args:
        structure: A dataclass derived from `Structure`, or a NamedTuple class.

    Raises:
        TypeError: a field is annotated with something compiled code cannot receive.
    """
    known = _layouts.get(structure)
    if known is not None:
        return known
    hints = get_type_hints(structure, include_extras=True)
    found: dict[str, Field] = {}
    offset = 0
    for name in field_names(structure):
        kind, dimensions = _kind(f"{structure.__name__}.{name}", hints[name])
        found[name] = Field(kind, dimensions, offset)
        offset += layout(kind)[1] if is_structure(kind) else 1 + dimensions
    _layouts[structure] = found, offset
    return found, offset


def field_names(cls: type[Any]) -> tuple[str, ...]:
    """Return the names of a structure's fields, in order."""
    if issubclass(cls, tuple):
        return tuple(cls._fields)  # type: ignore[attr-defined]
    return tuple(field.name for field in fields(cls))


def is_structure(kind: Any) -> bool:
    """True if a class describes a structure: a `Structure` or a NamedTuple."""
    return isinstance(kind, type) and (issubclass(kind, Structure) or hasattr(kind, "_fields"))


def _kind(name: str, hint: Any) -> tuple[Any, int]:
    dimensions = 1
    if get_origin(hint) is Annotated:
        hint, *notes = get_args(hint)
        dimensions = next((note for note in notes if type(note) is int), 1)
    for alias, element in ((Array, np.float64), (IntArray, np.int64)):
        if hint == alias:
            return element, dimensions
    if hint in (int, bool):
        return int, 0
    if hint is float or is_structure(hint):
        return hint, 0
    raise TypeError(f"{name} is annotated {hint}, wanted int, float, Array, IntArray or a structure of these")


def words(value: Any) -> list[int]:
    """Return the table of a structure; its arrays are pointed to, not copied.

    Raises:
        TypeError: a field does not hold what its class says.
    """
    table: list[int] = []
    known = _readers.get(type(value))
    if known is None:
        described = layout(type(value))[0]
        # one call for all fields: a run has some sixty arrays to point to
        known = _readers[type(value)] = operator.attrgetter(*described, "__class__"), tuple(described.items())
    for content, (name, (kind, dimensions, _)) in zip(known[0](value), known[1], strict=False):
        if dimensions:
            # numpy has one object for each of the two kinds, so that most need no comparison
            fits = isinstance(content, np.ndarray) and content.ndim == dimensions
            fits = fits and (content.dtype is _KINDS[kind] or content.dtype == kind)
            if not (fits and content.flags.c_contiguous):
                raise TypeError(
                    f"{type(value).__name__}.{name} is {content!r}, wanted a C-contiguous array of {kind.__name__} "
                    f"with {dimensions} dimensions"
                )
            table.append(_address(content))
            table += content.shape
        elif kind is int:
            table.append(int(content))
        elif kind is float:
            table.append(_DOUBLE_AS_INT.unpack(_DOUBLE.pack(content))[0])
        else:
            table += words(content)
    return table


def _address(array: Array) -> int:
    # four times as fast as array.ctypes.data, where it works
    if array.size > 0 and array.flags.writeable:
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.ctypes.data)


class Table:
    """The table of a structure, kept alive together with the arrays it points to.

    Args:
        value: The structure.
    """

    def __init__(self, value: Any) -> None:
        self._value = value
        self._words = np.array(words(value), dtype=np.int64)
        self.address = int(self._words.ctypes.data)


def rewrite(own: Any, new: Any) -> bool:
    """Write the arrays of a tuple of arrays, numbers and such tuples over those of another one.

    Returns:
        False where they differ in class, shape or number: then some arrays may have been written.
    """
    if isinstance(own, np.ndarray):
        fits = isinstance(new, np.ndarray) and own.shape == new.shape and own.dtype == new.dtype
        if fits:
            own[...] = new
        return fits
    if isinstance(own, tuple):
        return type(own) is type(new) and all(map(rewrite, own, new))
    return bool(own == new)


@dataclass(frozen=True, eq=False)
class Structure:
    """Base of structures that Python code hands to kernels; a subclass is a frozen dataclass.

    Numbers are fixed (`dataclasses.replace` makes a changed copy, which shares the arrays); arrays may be written to.
    """

    @cached_property
    def address(self) -> int:
        """Address of the table, for compiled code; built on first use."""
        table = np.array(words(self), dtype=np.int64)
        object.__setattr__(self, "_table", table)  # kept alive
        return int(table.ctypes.data)


WORD = ir.IntType(64)
ELEMENTS = {np.float64: types.float64, np.int64: types.int64}


class StructureType(types.Type):  # type: ignore[misc]
    """A structure of one class, as its table's address."""

    def __init__(self, cls: type[Any]) -> None:
        self.cls = cls
        super().__init__(name=f"Structure({cls.__module__}.{cls.__qualname__})")

    @property
    def key(self) -> Any:
        """Types with equal keys are the same type."""
        return self.cls


@register_model(StructureType)
class StructureModel(models.PrimitiveModel):  # type: ignore[misc]
    """One word."""

    def __init__(self, manager: Any, kind: StructureType) -> None:
        super().__init__(manager, kind, WORD)


@typeof_impl.register(Structure)
def _typeof(value: Structure, context: Any) -> StructureType:
    return StructureType(type(value))


@unbox(StructureType)
def _unbox(kind: StructureType, value: Any, context: Any) -> NativeValue:
    number = context.pyapi.object_getattr_string(value, "address")
    address = context.pyapi.long_as_longlong(number)
    context.pyapi.decref(number)
    return NativeValue(address)


def field_type(field: Field) -> types.Type:
    """Return the type that reading a field has."""
    if is_structure(field.kind):
        return StructureType(field.kind)
    if field.dimensions:
        return types.Array(ELEMENTS[field.kind], field.dimensions, "C")
    return types.float64 if field.kind is float else types.int64


@infer_getattr
class StructureAttributes(AttributeTemplate):  # type: ignore[misc]
    """Types of a structure's attributes."""

    key = StructureType

    def generic_resolve(self, kind: StructureType, name: str) -> types.Type | None:
        """Return the type of one attribute."""
        found = layout(kind.cls)[0].get(name)
        return None if found is None else field_type(found)


@lower_getattr_generic(StructureType)
def _getattr(context: Any, builder: Any, kind: StructureType, value: Any, name: str) -> Any:
    field = layout(kind.cls)[0][name]
    table = builder.inttoptr(value, WORD.as_pointer())

    def word(k: int) -> Any:
        return builder.load(builder.gep(table, [ir.Constant(WORD, field.offset + k)]))

    if is_structure(field.kind):
        return builder.add(value, ir.Constant(WORD, 8 * field.offset))
    if field.dimensions:
        return view(context, builder, field_type(field), word(0), [word(1 + k) for k in range(field.dimensions)])
    return builder.bitcast(word(0), ir.DoubleType()) if field.kind is float else word(0)


def view(context: Any, builder: Any, kind: types.Array, address: Any, shape: list[Any]) -> Any:
    """Emit a C-contiguous array that owns nothing, and return it.

    Args:
        context, builder: What numba is compiling with.
        kind: The array's type.
        address: Where its elements lie.
        shape: Its extents, a word each.
    """
    array = make_array(kind)(context, builder)
    strides = [ir.Constant(WORD, 8)]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    populate_array(
        array,
        data=builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer()),
        shape=cgutils.pack_array(builder, shape, WORD),
        strides=cgutils.pack_array(builder, strides, WORD),
        itemsize=ir.Constant(WORD, 8),
        meminfo=None,
        parent=None,
    )
    return array._getvalue()


@intrinsic
def structure(typingctx: Any, cls: Any, address: Any) -> Any:
    """Return the structure of class `cls` whose table lies at `address`; compiled code only."""
    return StructureType(cls.instance_class)(cls, types.int64), lambda context, builder, signature, args: args[1]


@intrinsic
def vector(typingctx: Any, address: Any, length: Any) -> Any:
    """Return the float64 vector of `length` elements at `address`, as a view; compiled code only."""
    kind = types.Array(types.float64, 1, "C")

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return view(context, builder, kind, args[0], [args[1]])

    return kind(types.int64, types.int64), build


def structure_at(cls: type[Any]) -> Any:
    """Return a function for compiled code that makes the structure of class `cls` whose table lies at an address."""

    @intrinsic
    def make(typingctx: Any, address: Any) -> Any:
        return StructureType(cls)(types.int64), lambda context, builder, signature, args: args[0]

    return make
