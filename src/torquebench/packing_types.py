"""How numba sees a structure: one word, its table's address, whose attributes are views."""

from __future__ import annotations

from typing import Any

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

from torquebench.packing import Field, Structure, is_structure, layout

WORD = ir.IntType(64)
ELEMENTS = {np.float64: types.float64, np.int64: types.int64}


class StructureType(types.Type):  # type: ignore[misc]
    """A structure of one class, as its table's address."""

    def __init__(self, cls: type[Any]) -> None:
        self.cls = cls
        super().__init__(name=f"Structure({cls.__module__}.{cls.__qualname__})")

    @property
    def key(self) -> Any:
        """What makes two types the same."""
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


def at(cls: type[Any]) -> Any:
    """Return a function for compiled code that makes the structure of class `cls` whose table lies at an address."""

    @intrinsic
    def make(typingctx: Any, address: Any) -> Any:
        return StructureType(cls)(types.int64), lambda context, builder, signature, args: args[0]

    return make
