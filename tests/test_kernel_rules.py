"""Every kernel and every law keeps the dialect, and gives the same bytes interpreted and compiled."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.dialect import functions, package, read, violations
from torquebench.laws import law_names

ROOT = Path(__file__).resolve().parents[1]
MODULES = package(ROOT / "src" / "torquebench")
CASES = [
    pytest.param(module, function, id=f"{name.removeprefix('torquebench.')}.{function.name}")
    for name, module in MODULES.items()
    for function in functions(module)
]


def test_the_checker_sees_the_kernels_and_the_laws() -> None:
    """The shared functions, the dynamics, both integrators and every registered law are among those checked."""
    seen = {case.id for case in CASES}
    assert {
        "kernel.sat", "robot.rigid_body.newton_euler", "robot.dynamics.forward_dynamics", "laws.pd.pid",
        "sim.analytic_plant.rk4_steps", "sim.analytic_plant.euler_steps", "robot.puma560.closed_form.fill_bias",
    } <= seen  # fmt: skip
    laws = [case for case in CASES if str(case.id).startswith("laws.") and "equivalent" not in str(case.id)]
    assert len(laws) >= len([name for name in law_names()])


@pytest.mark.parametrize(("module", "function"), CASES)
def test_dialect(module: object, function: ast.FunctionDef) -> None:
    """Arithmetic, `math`, indexing, loops over range() and calls of kernels; nothing else."""
    assert violations(function, module, MODULES) == []  # type: ignore[arg-type]


HEAD = """
import math
import numpy as np
from torquebench.kernel import Array, kernel, sat
from torquebench.references import sine
from torquebench.robot import dynamics
from torquebench.robot.dynamics import gravity
from torquebench.robot.model import EXACT
TABLE = np.zeros(3)
LIMIT = 3.0
state = [0]

def plain(x):
    return x

@kernel
def good(model, x: Array, out: Array) -> float:
    '''A docstring.'''
    n: int = len(x)
    total, i = 0.0, 0
    work = out[0]
    for k in range(1, n):
        total += math.sin(x[k]) * sat(x[k] / LIMIT) if k > 1 and not x[k] < 0.0 else -abs(x[k])
        out[k, 0], work[k] = total, 1.0
    while i < n:
        i += 1
        if model.structure == EXACT:
            continue
    gravity(model, x, out)
    dynamics.mass_matrix(model, x, out)
    return total

@kernel
def bad(x: Array, out: Array) -> float:
"""

BAD = {
    "power operator": "return x[0] ** 2",
    "power assignment": "x[0] **= 2",
    "numpy function": "return np.exp(x[0])",
    "numpy reduction": "return np.sum(x)",
    "method reduction": "return x.sum()",
    "matrix product": "return x @ x",
    "matrix product in place": "out @= x",
    "sum": "return sum(x)",
    "min": "return min(x[0], 0.0)",
    "round": "return round(x[0])",
    "power of math": "return math.pow(x[0], 2.0)",
    "pairwise sum of math": "return math.fsum(x)",
    "list": "y = [0.0, 1.0]\n    return y[0]",
    "list comprehension": "return [v for v in x][0]",
    "generator": "return max(v for v in x)",
    "dictionary": "y = {0: 1.0}\n    return y[0]",
    "set": "return len({1, 2})",
    "allocation": "y = np.zeros(3)\n    return y[0]",
    "whole-array assignment": "out[:] = x",
    "slice": "return len(x[1:])",
    "print": "print(x[0])",
    "formatted text": "y = f'{x[0]}'\n    return 0.0",
    "global statement": "global LIMIT\n    LIMIT = 2.0",
    "global list": "return state[0]",
    "writing to a global list": "state[0] = 1",
    "writing to a global array": "TABLE[0] = x[0]",
    "function that is no kernel": "return plain(x[0])",
    "imported function that is no kernel": "sine(x, x)",
    "function of a module that is no kernel": "return dynamics.nothing(x)",
    "loop over an array": "for v in x:\n        out[0] += v",
    "loop over pairs": "for i, v in enumerate(x):\n        out[i] = v",
    "lambda": "f = lambda v: v\n    return f(x[0])",
    "nested function": "def f(v):\n        return v\n    return f(x[0])",
    "exception": "raise ValueError",
    "handler": "try:\n        out[0] = 1.0\n    except ValueError:\n        pass",
    "assertion": "assert x[0] > 0.0",
    "context": "with x:\n        pass",
    "import": "import math",
    "membership": "return x[0] in x",
    "identity": "return x[0] is None",
    "walrus": "return (y := x[0])",
    "bit operation": "return 1 << 2",
    "keyword": "return sat(x=x[0])",
    "starred call": "return sat(*x)",
    "None": "return None",
    "deletion": "del out",
    "yield": "yield x[0]",
}


@pytest.mark.parametrize("what", BAD)
def test_the_checker_catches(what: str) -> None:
    """Each construct outside the dialect, put into an otherwise empty kernel, is found."""
    module = read(HEAD + "    " + BAD[what] + "\n")
    good, bad = functions(module)
    assert violations(good, module, MODULES) == []
    assert violations(bad, module, MODULES) != []


@pytest.mark.parametrize("signature", ["x: Array, limit: float = 1.0", "*x: Array", "**x: Array"])
def test_the_checker_catches_signatures(signature: str) -> None:
    """Defaults and variable arguments have no place in the one native signature."""
    module = read(f"@kernel\ndef bad({signature}) -> float:\n    return 0.0\n")
    (bad,) = functions(module)
    assert violations(bad, module, MODULES) != []


def test_the_checker_finds_laws() -> None:
    """A registered law is held to the dialect without being marked as a kernel."""
    module = read("@controller('x', gains=G)\ndef law(q, tau) -> None:\n    tau[0] = q[0] ** 2\n")
    (law,) = functions(module)
    assert violations(law, module, MODULES) == ["3: operator Pow"]


def digests(**environment: str) -> dict[str, str]:
    """Return what ``tests/kernel_bytes.py`` prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "tests.kernel_bytes"], cwd=ROOT, capture_output=True, text=True,
        timeout=300, check=False, env={**os.environ, "NUMBA_DISABLE_JIT": "0", **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result: dict[str, str] = json.loads(done.stdout)
    return result


def test_interpreted_and_compiled_bytes_are_equal() -> None:
    """Dynamics of the three structures, every law, closed loops and a diverging one: 0 differing bytes."""
    compiled, interpreted = digests(), digests(NUMBA_DISABLE_JIT="1")
    assert compiled.pop("compiled") == "True"
    assert interpreted.pop("compiled") == "False"
    assert {key for key in compiled if compiled[key] != interpreted[key]} == set()
    assert len(compiled) >= 30
    assert compiled.keys() == interpreted.keys()
    # the digests depend on what they should: no two of them are the same
    assert len(set(compiled.values())) == len(compiled)
