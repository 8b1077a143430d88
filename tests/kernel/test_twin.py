"""Kernels as plain Python: on numbers and on columns of numbers they have the bytes of the compiled ones."""

from collections.abc import Callable
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from numba.core import event

from torquebench import Puma560, load_model
from torquebench.kernel import Array, kernel, twin
from torquebench.kernel.twin import BLOCK, Column, map_states
from torquebench.robot import dynamics

MODELS = {
    "exact": lambda: Puma560(),
    "corrected": lambda: Puma560("corrected", "printed"),
    "printed": lambda: Puma560("printed", "printed"),
    "two joints": lambda: load_model("two-link"),
}


@pytest.mark.parametrize("name", MODELS)
def test_columns_have_the_bytes_of_one_state_after_the_other(name: str) -> None:
    """Every term at two blocks of states and a few more, against the same source on Python's numbers: 0 differ."""
    model = MODELS[name]()
    n, count = model.n, BLOCK + 7
    q, qd, qdd = np.random.default_rng(3).normal(size=(3, count, n))
    terms: list[tuple[Callable[..., None], list[Array], tuple[int, ...]]] = [
        (dynamics.mass_matrix, [q], (n, n)),
        (dynamics.gravity, [q], (n,)),
        (dynamics.bias_forces, [q, qd], (n,)),
        (dynamics.inverse_dynamics, [q, qd, qdd], (n,)),
    ]
    some = np.r_[0, 1, BLOCK - 1, BLOCK, count - 1]
    for term, states, shape in terms:
        whole = map_states(term, model.flat, states, shape)[0]
        alone = map_states(term, model.flat, [x[some] for x in states], shape, branches=True)[0]
        assert whole[some].tobytes() == alone.tobytes()


@pytest.mark.parametrize("name", ["exact", "printed"])
def test_they_have_the_bytes_of_the_compiled_kernel(name: str) -> None:
    """The inverse dynamics called compiled, state by state: 0 differ."""
    model = MODELS[name]()
    states = list(np.random.default_rng(4).normal(size=(3, 50, 6)))
    wanted = np.empty((50, 6))
    for k in range(50):
        dynamics.inverse_dynamics(model.flat, *(np.array(x[k]) for x in states), wanted[k])
    assert map_states(dynamics.inverse_dynamics, model.flat, states, (6,))[0].tobytes() == wanted.tobytes()


def test_compiled_rows_have_the_bytes_of_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """The terms of certificates, once computed as columns and once compiled: 0 differ; so read-only states."""
    model = MODELS["exact"]()
    q, qd, s = np.random.default_rng(6).normal(size=(3, 50, 6))
    q.setflags(write=False)
    columns = map_states(dynamics.sliding_terms, model.flat, [q, qd, s], (6, 6), (6,), (6,))
    monkeypatch.setattr(twin, "WORTH", 0)
    for own, wanted in zip(model.sliding_terms(q, qd, s), columns, strict=True):
        assert own.tobytes() == wanted.tobytes()
    assert dynamics.sliding_terms_of_each.signatures  # type: ignore[attr-defined]


def test_rows_are_compiled_when_it_is_worth_it_and_used_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that is neither compiled nor in the cache is left alone until `WORTH` states have been asked for."""
    used = list[int]()

    def fill(model: Any, x: Array, out: Array) -> None:
        used.append(len(x))
        out[:] = x

    rows = Mock(side_effect=fill, overloads={}, _cache=Mock(holds=Mock(return_value=False)))
    monkeypatch.setattr(twin, "WORTH", 25)
    states = [np.ones((10, 2))]
    for _ in range(3):
        map_states(swap_and_add, None, states, (2,), rows=rows)
    assert used == [10]
    rows.overloads[0] = None
    map_states(swap_and_add, None, states, (2,), rows=rows)
    assert used == [10, 10]


def test_nothing_is_compiled() -> None:
    """No term of any model wakes the compiler, at one state or at many."""
    with event.install_recorder("numba:compile") as compiling:
        for make in MODELS.values():
            model = make()
            for count in (1, 20):
                q, qd, tau = np.random.default_rng(5).normal(size=(3, count, model.n))
                results: list[Any] = [model.mass_matrix(q), model.forward_dynamics(q, qd, tau), model.coriolis(q)]
                results += [model.forward_kinematics(q), model.inverse_dynamics(q, qd, tau)]
                assert all(len(x) == count for x in results)
    assert list(compiling.buffer) == []


@kernel
def swap_and_add(model: Any, x: Array, out: Array) -> None:
    """Fill `out` (2,) by way of names that stand for elements which are overwritten meanwhile."""
    a, b = x[0], x[1]
    out[0] = b
    kept = out[0]
    out[0] = a
    c = a
    c += b
    c -= 1.0
    c *= 2.0
    out[1] = kept + c + a


def test_a_name_keeps_its_number() -> None:
    """An element that was read stays what it was when the array is written to, or another name is added to."""
    x = np.arange(20.0).reshape(10, 2)
    filled = map_states(swap_and_add, None, [x], (2,))[0]
    wanted = np.column_stack([x[:, 0], x[:, 1] + 2.0 * (x[:, 0] + x[:, 1] - 1.0) + x[:, 0]])
    assert filled.tobytes() == wanted.tobytes()


def test_a_branch_on_a_column_is_refused() -> None:
    """What would need another way for each state fails aloud, instead of taking one of them for all."""
    with pytest.raises(ValueError, match="ambiguous"):
        bool(np.arange(3.0).view(Column) > 1.0)
