"""Structures in compiled code: what is read and written there is what Python holds, whatever the kind of field."""

from __future__ import annotations

import dataclasses
import gc
import math
import struct
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest
from numba import types

from tests.arms import two_link
from torquebench import Puma560
from torquebench.kernel import Array, IntArray, kernel
from torquebench.kernel.struct import (
    Structure,
    Table,
    is_structure,
    layout,
    rewrite,
    structure,
    structure_at,
    vector,
    words,
)
from torquebench.kernel.twin import python_numbers
from torquebench.robot.flat_model import Model, own_copy
from torquebench.sim.native import NativeFunction


class Inner(NamedTuple):
    """A structure inside another."""

    label: int
    rows: Annotated[Array, 2]
    weight: float


class Deep(NamedTuple):
    """A structure with another inside and a field after it."""

    inner: Inner
    last: Array


@dataclass(frozen=True, eq=False)
class Outer(Structure):
    """Every kind of field, in an order that makes a wrong offset show."""

    number: float
    count: int
    flag: bool
    line: Array
    deep: Deep
    sheet: Annotated[Array, 2]
    block: Annotated[Array, 3]
    marks: IntArray
    grid: Annotated[IntArray, 2]
    end: float


def outer(number: float = 1.5, count: int = 7) -> Outer:
    """Return a structure in which no two numbers are the same."""
    run = iter(range(100, 10_000))

    def fill(*shape: int) -> Any:
        return np.array([next(run) for _ in range(math.prod(shape))], dtype=np.float64).reshape(shape)

    return Outer(
        number,
        count,
        True,
        fill(4),
        Deep(Inner(-3, fill(2, 5), -2.5), fill(3)),
        fill(3, 2),
        fill(2, 3, 4),
        fill(2).astype(np.int64),
        fill(3, 3).astype(np.int64),
        9.25,
    )


@kernel
def read(s: Outer, out: Array) -> None:
    """Write everything a structure holds to `out`, in the order of its fields, arrays element by element."""
    out[0], out[1], out[2] = s.number, s.count, s.flag
    k = 3
    for i in range(len(s.line)):
        out[k] = s.line[i]
        k += 1
    out[k] = s.deep.inner.label
    k += 1
    for i in range(len(s.deep.inner.rows)):
        for j in range(len(s.deep.inner.rows[i])):
            out[k] = s.deep.inner.rows[i, j]
            k += 1
    out[k] = s.deep.inner.weight
    k += 1
    for i in range(len(s.deep.last)):
        out[k] = s.deep.last[i]
        k += 1
    for i in range(len(s.sheet)):
        for j in range(len(s.sheet[i])):
            out[k] = s.sheet[i][j]
            k += 1
    for i in range(len(s.block)):
        for j in range(len(s.block[i])):
            for c in range(len(s.block[i, j])):
                out[k] = s.block[i, j, c]
                k += 1
    for i in range(len(s.marks)):
        out[k] = s.marks[i]
        k += 1
    for i in range(len(s.grid)):
        for j in range(len(s.grid[i])):
            out[k] = s.grid[i, j]
            k += 1
    out[k] = s.end


def flat(value: Any) -> list[float]:
    """Return the same by walking the Python object."""
    if isinstance(value, np.ndarray):
        return [float(x) for x in value.ravel()]
    if is_structure(type(value)):
        hints = layout(type(value))[0]
        return [x for name in hints for x in flat(getattr(value, name))]
    return [float(value)]


def test_every_kind_of_field_arrives() -> None:
    """Numbers, flags, arrays of one to three dimensions of both types, structures in structures: each in its place."""
    s = outer()
    wanted = flat(s)
    out = np.full(len(wanted) + 1, -1.0)
    read(s, out)
    assert out.tolist() == [*wanted, -1.0]
    assert len(set(wanted)) == len(wanted)


@kernel
def strides_of(s: Outer, out: IntArray) -> None:
    """Write the distances in memory of neighbours in each array of several dimensions."""
    for i in range(2):
        out[i], out[2 + i], out[4 + i] = s.sheet.strides[i], s.deep.inner.rows.strides[i], s.grid.strides[i]
    for i in range(3):
        out[6 + i] = s.block.strides[i]


def test_strides_are_numpys() -> None:
    """What compiled code says of an array's layout is what numpy says, though it does not need it to read elements."""
    s, out = outer(), np.zeros(9, dtype=np.int64)
    strides_of(s, out)
    wanted = [x for array in (s.sheet, s.deep.inner.rows, s.grid, s.block) for x in array.strides]
    assert out.tolist() == wanted


@kernel
def number_of(s: Outer, out: Array) -> None:
    """Write the number."""
    out[0] = s.number


@kernel
def count_of(s: Outer, out: IntArray) -> None:
    """Write the count."""
    out[0] = s.count


@pytest.mark.parametrize(
    "x",
    [
        0.0,
        -0.0,
        5e-324,
        -2.2250738585072014e-308,
        1.7976931348623157e308,
        0.1,
        math.inf,
        -math.inf,
        math.nan,
        -math.nan,
        struct.unpack("<d", struct.pack("<q", 0x7FF8000000000123))[0],
    ],
)
def test_floats_keep_every_bit(x: float) -> None:
    """Signed zeros, subnormals, infinities, NaN of either sign and its payload."""
    out = np.zeros(1)
    number_of(outer(number=x), out)
    assert out.tobytes() == struct.pack("<d", x)


@pytest.mark.parametrize("k", [0, -1, 2**62, 2**63 - 1, -(2**63)])
def test_integers_keep_every_bit(k: int) -> None:
    """Up to the ends of 64 bits; one beyond is an error, not another number."""
    out = np.zeros(1, dtype=np.int64)
    count_of(outer(count=k), out)
    assert out[0] == k
    with pytest.raises(OverflowError):
        outer(count=2**63).address  # noqa: B018


def test_what_compiled_code_writes_is_seen() -> None:
    """Elements written through a structure, at any depth, are the Python object's own; nothing else changes."""

    @kernel
    def write(s: Outer) -> None:
        s.line[1] = -1.0
        s.deep.inner.rows[1, 4] = -2.0
        s.block[1, 2, 3] += 0.5
        s.grid[2, 0] = -4

    s, untouched = outer(), outer()
    write(s)
    assert (s.line[1], s.deep.inner.rows[1, 4], s.grid[2, 0]) == (-1.0, -2.0, -4)
    assert s.block[1, 2, 3] == untouched.block[1, 2, 3] + 0.5
    assert sum(a != b for a, b in zip(flat(s), flat(untouched), strict=True)) == 4
    s.line[2] = 55.0  # and what Python writes is seen there, in a table made before
    out = np.zeros(len(flat(s)))
    read(s, out)
    assert out.tolist() == flat(s)


def test_a_table_passed_by_its_address() -> None:
    """A NamedTuple reaches a native function as its table's address, as gains and memory do; vectors likewise."""
    deep_at = structure_at(Deep)

    def total(first: int, second: int, x: int, n: int) -> float:
        a, b, v = deep_at(first), structure(Deep, second), vector(x, n)
        sum_of = a.inner.weight * 1000.0 + b.inner.label
        for i in range(n):
            sum_of += v[i] * a.last[i] * b.inner.rows[1, i]
            v[i] = -1.0
        return sum_of

    call = NativeFunction(types.float64(*[types.int64] * 4), total).call
    deep, x = outer().deep, np.array([2.0, 3.0])
    wanted = -2500.0 - 3.0 + sum(x[i] * deep.last[i] * deep.inner.rows[1, i] for i in range(2))
    tables = Table(deep), Table(deep)
    assert tables[0].address != tables[1].address
    assert call(tables[0].address, tables[1].address, x.ctypes.data, 2) == wanted
    assert x.tolist() == [-1.0, -1.0]


def test_tuples_of_one_kind_are_written_over() -> None:
    """Arrays take the other's values in place, nested ones too; another class, shape or number is told."""

    class Inner(NamedTuple):
        x: Array

    class Outer(NamedTuple):
        k: int
        a: Array
        inner: Inner

    own = Outer(1, np.zeros(3), Inner(np.zeros((2, 2))))
    arrays = own.a, own.inner.x
    assert rewrite(own, Outer(1, np.arange(3.0), Inner(np.ones((2, 2)))))
    assert arrays[0].tolist() == [0.0, 1.0, 2.0]
    assert (arrays[1] == 1.0).all()
    assert not rewrite(own, Outer(2, np.arange(3.0), own.inner))
    assert not rewrite(own, Outer(1, np.arange(4.0), own.inner))
    assert not rewrite(own, Outer(1, np.arange(3), own.inner))  # type: ignore[arg-type]
    assert not rewrite(own, (1, own.a, own.inner))


def test_a_table_keeps_its_arrays_alive() -> None:
    """Where nothing else refers to a structure and its arrays, its table still points to them."""
    wanted = outer().deep.last.tolist()
    deep_at = structure_at(Deep)

    def last(table: int, i: int) -> float:
        return deep_at(table).last[i]

    call = NativeFunction(types.float64(types.int64, types.int64), last).call
    table = Table(outer().deep)
    gc.collect()
    others = [np.full(len(wanted), -1.0) for _ in range(1000)]  # would take the place of what was let go
    assert [call(table.address, i) for i in range(len(wanted))] == wanted
    assert len(others) == 1000


@dataclass(frozen=True, eq=False)
class Line(Structure):
    """One array."""

    values: Array


@dataclass(frozen=True, eq=False)
class Sheet(Structure):
    """One matrix of integers."""

    values: Annotated[IntArray, 2]


GOOD = np.arange(12.0).reshape(3, 4)


@pytest.mark.parametrize(
    "bad",
    [
        GOOD[0, ::2],
        GOOD[:, 0],
        GOOD[0].astype(np.float32),
        GOOD[0].astype(np.int64),
        GOOD[0].astype(">f8"),
        GOOD,
        np.float64(1.0),
        np.array(1.0),
        [1.0, 2.0],
        (1.0,),
        None,
        3.0,
        GOOD[0].astype(complex),
        GOOD[0][::-1],
    ],
    ids=str,
)
def test_arrays_that_do_not_fit_are_refused_by_name(bad: Any) -> None:
    """Strides, another type or byte order, other dimensions, and what is no array: a TypeError names the field."""
    for value in (Line(bad), dataclasses.replace(outer(), line=bad)):
        where = "Line.values" if isinstance(value, Line) else "Outer.line"
        with pytest.raises(TypeError, match=rf"{where} is [\s\S]*C-contiguous array of float64 with 1 dimensions"):
            value.address  # noqa: B018
        with pytest.raises(TypeError, match=where):
            words(value)


@pytest.mark.parametrize("bad", [GOOD.astype(np.int64).T, GOOD.astype(np.int32), GOOD, GOOD.astype(np.int64)[0]])
def test_matrices_of_integers_that_do_not_fit_are_refused(bad: Any) -> None:
    """A transposed matrix, narrow integers, floats, and a single row."""
    with pytest.raises(TypeError, match=r"Sheet.values is [\s\S]*wanted a C-contiguous array of int64 with 2 dim"):
        Sheet(bad).address  # noqa: B018


@pytest.mark.parametrize("empty", [np.zeros(0), np.zeros((0, 3)), np.zeros((3, 0))])
def test_empty_and_read_only_arrays_fit(empty: Array) -> None:
    """An array of no elements keeps its shape; a read-only one is read like any other."""
    kind = dataclasses.make_dataclass(
        "Kind", [("values", Annotated[Array, empty.ndim])], bases=(Structure,), frozen=True, eq=False
    )
    assert words(kind(empty))[1:] == list(empty.shape)
    fixed = np.arange(4.0)
    fixed.setflags(write=False)
    s = dataclasses.replace(outer(), line=fixed)
    out = np.zeros(len(flat(s)))
    read(s, out)
    assert out.tolist() == flat(s)


@pytest.mark.parametrize("hint", [str, Any, complex, list[float], np.ndarray, "Missing", Array | None])
def test_fields_that_compiled_code_cannot_receive_are_refused(hint: Any) -> None:
    """The class is refused by the name of its field, before any value is looked at."""
    kind = dataclasses.make_dataclass("Kind", [("odd", hint)], bases=(Structure,), frozen=True)
    with pytest.raises((TypeError, NameError), match=r"Kind\.odd is annotated|Missing"):
        layout(kind)


def test_a_changed_copy_has_its_own_python_numbers() -> None:
    """A law that is run as Python sees the control period of its model, though those of another were seen before."""
    flat = two_link().flat
    assert python_numbers(flat).control_period == flat.control_period
    assert python_numbers(own_copy(flat, control_period=0.25)).control_period == 0.25


@kernel
def mass_and_scratch(model: Model, out: Array) -> None:
    """Write a mass, a derived number and a number of the scratch space, and mark the scratch space."""
    out[0], out[1], out[2] = model.mass[0], model.about_origin[0, 0], model.control_period
    out[3] = model.scratch.free[0]
    model.scratch.free[0] = 7.0


@pytest.mark.parametrize("make", [Puma560, two_link, lambda: Puma560("corrected", "printed")])
def test_a_changed_copy_has_a_table_of_its_own(make: Any) -> None:
    """`replace` and `own_copy` give tables that point to the new arrays, after the old table was made too."""
    model = make().flat
    first = model.address
    lighter = dataclasses.replace(model, mass=0.5 * model.mass)
    copied = own_copy(model, control_period=0.25)
    out = np.zeros(4)
    for changed, wanted in (
        (model, [model.mass[0], model.mass[0], model.control_period]),
        (lighter, [0.5 * model.mass[0], 0.5 * model.mass[0], model.control_period]),
        (copied, [model.mass[0], model.mass[0], 0.25]),
    ):
        mass_and_scratch(changed, out)
        assert out[:3].tolist() == wanted
    assert len({first, lighter.address, copied.address}) == 3
    assert model.address == first
    assert copied.scratch.free[0] == model.scratch.free[0] == 7.0
    assert out[3] == 0.0  # the copy's scratch space is not the model's, which had been marked
    for changed in (model, lighter, copied):
        for field in dataclasses.fields(changed):
            array = getattr(changed, field.name)
            if isinstance(array, np.ndarray):
                assert not array.flags.writeable, field.name  # so that copies may share it
    assert not any(np.shares_memory(a, b) for a, b in zip(model.scratch, copied.scratch, strict=True))


def test_a_model_is_not_changed_through_the_arrays_it_was_made_from() -> None:
    """Whoever keeps an array that a model was made from cannot change the model with it."""
    model = two_link().flat
    mine = np.array([3.0, 4.0])
    heavier = dataclasses.replace(model, mass=mine, armature=mine)
    mine[:] = -1.0
    out = np.zeros(4)
    mass_and_scratch(heavier, out)
    assert out[:2].tolist() == [3.0, 3.0]
    assert heavier.mass.tolist() == heavier.armature.tolist() == [3.0, 4.0]
