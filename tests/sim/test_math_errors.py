"""Arithmetic that has no result: interpreted and compiled, a run ends at the same step with the same bytes."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit

from tests.sim.loops import PLANTS, TARGET, arm, plant_of
from tests.user_files import load
from torquebench import Controller, Outcome, find_law, simulate
from torquebench.chain import Drawn
from torquebench.dialect import MATH, complaints
from torquebench.kernel.twin import Matrix, Vector, python_numbers
from torquebench.laws.law import Law
from torquebench.registry import restored
from torquebench.sim import checked_math, interpreted
from torquebench.sim.closed_loop import CONTROLLER_ERROR, RAISED
from torquebench.sim.job import set_up
from torquebench.sim.native import NativeRun, native_law

COMPLETED, BAD = Outcome.COMPLETED, Outcome.BAD_TORQUE
AT = 7
"""Step at which the laws below leave the domain of arithmetic."""
CASES = {
    # divisions: of numbers made from t, from elements of arrays, and of integers
    "1.0 / zero": BAD,
    "x / zero": BAD,
    "zero / zero": BAD,
    "q[i] / (q[i] - q[i])": BAD,
    "1.0 / gains.none[i]": BAD,
    "gains.none[i] / gains.none[i]": BAD,
    "ref.qd[i] / memory.zero[i]": BAD,
    "1.0 / model.scratch.zeros[i]": BAD,
    "1.0 / model.scratch.matrix[i, i]": BAD,
    "x % zero": BAD,
    "x // zero": BAD,
    "q[i] % gains.none[i]": BAD,
    "q[i] // gains.none[i]": BAD,
    "1 / (i - i)": BAD,
    "1 // (i - i)": BAD,
    "1 % (i - i)": BAD,
    "model.kind[i] / (i - i)": BAD,
    "infinite / zero": BAD,
    "missing / zero": BAD,
    "-1.0 / gains.none[i]": BAD,
    # functions, beyond their domain or with a result too large
    "math.sqrt(-x)": BAD,
    "math.sqrt(-infinite)": BAD,
    "math.log(zero)": BAD,
    "math.log(-x)": BAD,
    "math.exp(1e6 * x)": BAD,
    "math.expm1(1e6 * x)": BAD,
    "math.sinh(-1e6 * x)": BAD,
    "math.cosh(-1e6 * x)": BAD,
    "math.log1p(-1.0 - zero)": BAD,
    "math.log1p(-1e3 * x)": BAD,
    "math.asin(1.0 + x)": BAD,
    "math.acos(-1.0 - x)": BAD,
    "math.sin(infinite)": BAD,
    "math.cos(-infinite)": BAD,
    "math.tan(infinite)": BAD,
    "math.floor(infinite)": BAD,
    "math.floor(missing)": BAD,
    "also_sine(infinite)": BAD,
    "maths.sqrt(-x)": BAD,
    # what has a result, infinite or not a number as it may be
    "infinite": COMPLETED,
    "-infinite": COMPLETED,
    "math.exp(infinite)": COMPLETED,
    "math.exp(-1e6 * x)": COMPLETED,
    "math.log(infinite)": COMPLETED,
    "math.sqrt(infinite)": COMPLETED,
    "math.atan(-infinite)": COMPLETED,
    "math.tanh(infinite)": COMPLETED,
    "math.cosh(infinite)": COMPLETED,
    "math.sinh(-infinite)": COMPLETED,
    "x / infinite": COMPLETED,
    "math.atan2(zero, -zero)": COMPLETED,
    "math.copysign(1.0, -zero)": COMPLETED,
    "math.fabs(-infinite)": COMPLETED,
    "math.floor(-1e9 * x)": COMPLETED,
    "math.asin(1.0)": COMPLETED,
    "-7.5 % x": COMPLETED,
    "-7.5 // x": COMPLETED,
    "infinite % -x": BAD,
    "sat(steep(1e6 * x))": COMPLETED,
    "infinite - infinite": BAD,
    "missing": BAD,
    "math.sqrt(missing)": BAD,
    "math.sin(missing)": BAD,
    "infinite / infinite": BAD,
    "0.0 * infinite": BAD,
    "1.0 if math.isnan(missing) else zero": COMPLETED,
    "1.0 if math.isfinite(infinite) else zero": COMPLETED,
}
"""An expression, squashed by `sat` -> how a run that comes upon it ends."""
SOURCE = '''"""A law that computes what its option says from step 7 on."""

import math
import math as maths
from math import sin as also_sine
from typing import Annotated, NamedTuple

from torquebench import Array, Gain, Option, controller, sat
from torquebench.kernel import kernel


class Gains(NamedTuple):
    k: Array
    none: Annotated[Array, Gain("zero", "1", positive=False)]
    case: Annotated[int, Option("what is computed", VALUES)]


class Memory(NamedTuple):
    s: Array
    zero: Array


@kernel
def steep(x: float) -> float:
    return math.exp(x)


@controller("risky", gains=Gains, memory=Memory)
def risky(gains, model, t, q, qd, ref, memory, tau):
    """A spring, and what is asked for."""
    late = t > 0.0065
    x = t + 1.0
    zero = t - t
    infinite = 1e300 * x * 1e300
    missing = zero * infinite
    y = 0.0
    for i in range(len(tau)):
        memory.s[i] += 1.0
        model.scratch.matrix[i, i] = 0.0
        if late:
BRANCHES
        tau[i] = 30.0 * gains.k[i] * (ref.q[i] - q[i]) + sat(y)
'''


@pytest.fixture(scope="module")
def risky(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The law, registered for the tests of this file only."""
    branches = "".join(
        f"            if gains.case == {k}:\n                y = 0.0 + ({c})\n" for k, c in enumerate(CASES)
    )
    text = SOURCE.replace("BRANCHES\n", branches).replace("VALUES", repr(tuple(f"case{k}" for k in range(len(CASES)))))
    with restored():
        load(tmp_path_factory.mktemp("laws"), text)
        law = find_law("risky")
        assert [str(c) for c in complaints(law)] == []
        yield law


@pytest.mark.parametrize("case", CASES)
def test_both_paths_end_alike(risky: Any, case: str) -> None:
    """Same outcome, same step, same bytes, though `sat` would have made a torque of the infinity."""
    gains = risky.pack_gains(2, {"k": 1.0, "none": 0.0}, {"case": f"case{list(CASES).index(case)}"})
    controller = Controller("risky", risky, gains)
    runs = [
        simulate(plant_of("analytic"), controller, arm(), TARGET, duration=0.02, path=path, throw=False)
        for path in ("python", "native")
    ]
    for run in runs:
        assert (run.outcome, run.failed_at) == (CASES[case], None if CASES[case] is COMPLETED else AT)
    assert runs[0].digest() == runs[1].digest()
    assert runs[1].path == "native"


@pytest.mark.parametrize("name", PLANTS)
def test_the_interpreted_call_tells_what_the_compiled_one_met(risky: Any, name: str) -> None:
    """Where a compiled law raised, calling it interpreted gives the line and leaves the same memory."""
    gains = risky.pack_gains(2, {"k": 1.0, "none": 0.0}, {"case": f"case{list(CASES).index('math.sqrt(-x)')}"})
    plant = plant_of(name)
    desired = TARGET(np.arange(20) * 0.001)
    native = plant.native()  # type: ignore[attr-defined]
    from torquebench.chain import IDEAL

    setup = set_up(
        risky,
        gains,
        arm().flat,
        plant,
        desired,
        IDEAL,
        control_period=0.001,
        substeps=1,
        drawn=Drawn(),
        disturbance=None,
        native=native,
    )
    plant.reset(np.zeros(2), np.zeros(2))
    assert NativeRun(setup, native)(0, 20) == RAISED
    kept = setup.job.record_memory[:, AT].copy()
    assert kept[0].tolist() == [AT + 1.0, AT]  # the second joint was not reached
    status, detail = interpreted.replay(setup)
    assert status == RAISED
    assert detail.startswith("ValueError: ")
    assert (
        f"line {SOURCE[: SOURCE.index('BRANCHES')].count(chr(10)) + 2 + 2 * list(CASES).index('math.sqrt(-x)')})"
        in detail
    )
    assert setup.job.record_memory[:, AT].tobytes() == kept.tobytes()


def test_an_element_beyond_the_end_is_no_element(tmp_path: Path, registries: None) -> None:
    """Compiled, it raises instead of reading what lies behind the array; the interpreted call says which line."""
    load(
        tmp_path,
        """
from typing import NamedTuple
from torquebench import Array, controller
class Gains(NamedTuple):
    k: Array
@controller("beyond", gains=Gains)
def beyond(gains, model, t, q, qd, ref, memory, tau):
    for i in range(len(tau)):
        tau[i] = gains.k[i]
    if t > 0.0065:
        tau[0] = q[2]
""",
    )
    law = find_law("beyond")
    assert complaints(law) == ()
    controller = Controller("beyond", law, law.pack_gains(2, {"k": 1.0}, {}))
    runs = {
        path: simulate(plant_of("mujoco"), controller, arm(), TARGET, duration=0.02, path=path, throw=False)
        for path in ("python", "native")
    }  # type: ignore[arg-type]
    assert runs["python"].outcome is Outcome.CONTROLLER_ERROR
    assert not runs["native"].completed
    assert {run.failed_at for run in runs.values()} == {AT}
    assert runs["native"].q.tobytes() == runs["python"].q.tobytes()


SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -2.0,
    1.0 + 2**-52,
    -1.0 - 2**-52,
    5e-324,
    1e-300,
    700.0,
    709.8,
    710.5,
    -745.2,
    -746.0,
    2.0**52 + 0.5,
    2.0**62,
    9.0e18,
    -9.3e18,
    2.0**63,
    -(2.0**63),
    1e22,
    1e308,
    -1e308,
    math.inf,
    -math.inf,
    math.nan,
]


@pytest.mark.parametrize("name", [name for name in MATH if callable(getattr(math, name))])
def test_checked_functions_are_pythons(name: str) -> None:
    """Over ordinary and extreme arguments: the same bytes, or both raise. Only floor stops earlier, at 64 bits."""
    function, python = getattr(checked_math, name), getattr(math, name)
    two = name in ("atan2", "copysign")
    compiled = njit((lambda x, y: function(x, y)) if two else (lambda x: function(x)), error_model="python")
    rng = np.random.default_rng(0)
    some = [*SPECIAL, *(rng.normal(size=2000) * 10.0 ** rng.integers(-9, 5, 2000)).tolist()]
    pairs = [(x, y) for x in SPECIAL for y in SPECIAL] if two else [(x,) for x in some]
    for arguments in pairs:
        got, wanted = [_outcome(f, arguments) for f in (compiled, python)]
        if name == "floor" and not abs(arguments[0]) < 2.0**63:
            assert got == "raised"
        else:
            assert got == wanted, arguments


def _outcome(function: Any, arguments: Any) -> Any:
    try:
        return np.float64(function(*arguments)).tobytes()
    except (ValueError, OverflowError):
        return "raised"


def test_every_function_of_the_dialect_is_checked() -> None:
    """What the dialect lets a law take from `math` is what compiled laws find in its stand-in, no more and no less."""
    assert set(checked_math.__all__) == set(MATH)


def test_elements_read_as_pythons_numbers() -> None:
    """Elements of vectors, tables, rows and structures; the arrays are the same memory, and writing reaches them."""
    array = np.arange(6.0).reshape(2, 3)
    table = python_numbers(array)
    assert type(table) is Matrix
    assert type(table[1, 2]) is float
    assert type(table[0]) is Vector
    assert type(table[0][1]) is float
    table[1, 2] = 7.0
    table[0][1] = 8.0
    assert array.tolist() == [[0.0, 8.0, 2.0], [3.0, 4.0, 7.0]]
    model = arm().flat
    seen = python_numbers(model)
    assert type(seen.kind[0]) is int
    assert type(seen.scratch.zeros[0]) is float
    assert type(seen.rotation[0, 1, 1]) is float
    assert np.shares_memory(seen.mass, model.mass)
    assert python_numbers(model) is seen
    assert python_numbers(arm().flat) is not seen
    with pytest.raises(ZeroDivisionError):
        seen.mass[0] / seen.scratch.zeros[0]


def test_a_law_outside_the_dialect_gets_plain_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slices and whole-array arithmetic are numpy's there, whose divisions by zero do not raise."""
    seen: list[Any] = []

    def loose(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        seen.extend([type(q), type(model.mass), type(ref.q)])
        tau[:] = np.minimum(1.0 / (q - q + 0.0), 1.0)

    law = Law("loose", loose, SimpleNamespace, None, {}, {})
    run = simulate(plant_of("analytic"), Controller("loose", law, ()), arm(), TARGET, duration=0.003, throw=False)
    assert run.completed
    assert set(seen) == {np.ndarray}
    assert run.tau_law.tolist() == [[1.0, 1.0]] * 3


def test_edited_laws_constants_and_kernels_are_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found in the cache on disk is the law as it is now, also when only a constant or a kernel has changed."""
    text = """
from typing import NamedTuple
from torquebench import Array, controller
from torquebench.kernel import kernel
LIMIT = 1.0
class Gains(NamedTuple):
    k: Array
@kernel
def part(x: float) -> float:
    return x + 10.0
@controller("edited", gains=Gains)
def edited(gains, model, t, q, qd, ref, memory, tau):
    for i in range(len(tau)):
        tau[i] = LIMIT + part(gains.k[i]) + 100.0
"""
    names = set()
    for old, new, torque in (
        ("", "", 111.0),
        ("LIMIT = 1.0", "LIMIT = 2.0", 112.0),
        ("10.0", "20.0", 121.0),
        ("100.0", "200.0", 211.0),
        ("LIMIT + part", "-LIMIT + part", 109.0),
    ):
        with restored():
            load(tmp_path, text.replace(old, new), "edited_file")
            law = find_law("edited")
        names.add(native_law(law).name)
        controller = Controller("edited", law, law.pack_gains(2, {"k": 0.0}, {}))
        run = simulate(plant_of("analytic"), controller, arm(), TARGET, duration=0.002, path="native", throw=False)
        assert run.tau_law[0, 0] == torque
    assert len(names) == 5


def test_a_number_that_a_kernel_names_is_read_anew(tmp_path: Path) -> None:
    """A user's kernel is not taken from disk with a number that another file has changed since."""
    (tmp_path / "numbers_of.py").write_text("STIFF = 300.0\n")
    (tmp_path / "uses.py").write_text(
        "from numbers_of import STIFF\nfrom torquebench.kernel import kernel\n\n\n"
        "@kernel\ndef spring(x: float) -> float:\n    return STIFF * x\n\n\nprint(spring(1.0))\n"
    )
    for stiff in (300.0, 100.0):
        (tmp_path / "numbers_of.py").write_text(f"STIFF = {stiff}\n")
        done = subprocess.run(
            [sys.executable, "-B", "uses.py"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120
        )
        assert float(done.stdout) == stiff


def test_a_controller_error_is_told_apart_from_arithmetic(risky: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The interpreted call decides which of the two a compiled law that raised has met."""
    monkeypatch.setattr(interpreted.Call, "at", lambda *arguments: (CONTROLLER_ERROR, "IndexError: beyond"))
    job = SimpleNamespace(
        at=[3],
        memory=np.ones((1, 2)),
        record_memory=np.zeros((1, 5, 2)),
        q_ref=np.zeros((5, 2)),
        qd_ref=np.zeros((5, 2)),
        qdd_ref=np.zeros((5, 2)),
        control_period=0.001,
        measured_q=np.zeros(2),
        measured_qd=np.zeros(2),
    )
    setup: Any = SimpleNamespace(job=job, law=risky, gains=(), belief=None, memory=())
    assert interpreted.replay(setup) == (CONTROLLER_ERROR, "IndexError: beyond")
