"""Every kernel and every law keeps the dialect, and gives the same bytes interpreted and compiled."""

from __future__ import annotations

import ast
import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest

from tests.source_tree import ALL, FILES, tree_of
from tests.user_files import load
from torquebench.dialect import is_kernel, plain, read_kernel, read_law
from torquebench.laws import find_law, law_names
from torquebench.sim.closed_loop import closed_loop

ROOT = Path(__file__).resolve().parents[1]


def marked(tree: ast.Module, mark: str) -> set[str]:
    """Return the names of the functions of a file, at any depth, that are decorated with `mark` or a call of it."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            marks = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
            if mark in {ast.unparse(m).rpartition(".")[2] for m in marks}:
                found.add(node.name)
    return found


def kernels() -> dict[str, FunctionType]:
    """Return every kernel of the package as a plain function, by ``module.name``."""
    found = {}
    for file in ALL:
        if not re.search(r"@[\w.]*\bkernel\b", FILES[file].read_text(encoding="utf-8")):
            continue
        tree = tree_of(file)
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        if marked(tree, "kernel"):
            module = importlib.import_module(f"torquebench.{name}")
            mine = {k: plain(v) for k, v in vars(module).items() if is_kernel(v) and v.__module__ == module.__name__}
            assert marked(tree, "kernel") == set(mine), "a kernel that is not at the top of its file"
            found |= {f"{name}.{k}": function for k, function in mine.items()}
    return found


KERNELS = kernels()
LAWS = {name: find_law(name) for name in law_names()}
EXCUSED = {"fuzzy.inference.staircase": "a division in an inline kernel", "kernel.arithmetic.fill": "math.pow()"}
"""What is allowed once: an area that is never zero as divisor, and a function in the table of functions."""


def test_the_checker_sees_the_kernels_and_the_laws() -> None:
    """The shared functions, the dynamics, integrators, the loop's parts and every registered law are among them."""
    assert {
        "kernel.sat",
        "robot.rigid_body.newton_euler",
        "robot.dynamics.forward_dynamics",
        "sim.plants.analytic.rk4_steps",
        "sim.plants.analytic.euler_steps",
        "robot.puma560.closed_form.fill_bias",
        "fuzzy.inference.infer",
        "chain.sensors.measure",
        "chain.drives.drive",
        "sim.closed_loop.actuate",
        "sim.closed_loop.give",
    } <= set(KERNELS)
    written = {n for file in ALL if file.startswith("laws/") for n in marked(tree_of(file), "controller")}
    assert written == {law.function.__name__ for law in LAWS.values()}
    assert len(written) >= 6


def test_kernels_keep_the_dialect() -> None:
    """Arithmetic, `math`, indexing, loops over range() and calls of kernels; nothing else."""
    found = {name: [c for c in read_kernel(KERNELS[name]) if c.what != EXCUSED.get(name)] for name in KERNELS}
    assert {name: complaints for name, complaints in found.items() if complaints} == {}


def test_laws_keep_the_dialect() -> None:
    """The same, and they write to nothing but tau, memory and the model's scratch space."""
    assert {name: found for name, law in LAWS.items() if (found := read_law(law))} == {}  # type: ignore[arg-type]


def test_the_loop_keeps_the_dialect() -> None:
    """The loop is no kernel, because it is handed law and plant as functions; else it is held to the same rules."""
    assert read_kernel(closed_loop) == []


def found_in(tmp_path: Path, source: str, function: str = "bad") -> list[str]:
    """Return the complaints about a kernel of a file."""
    module = load(tmp_path, source)
    return [str(c) for c in read_kernel(plain(getattr(module, function)))]


HEAD = """
import math
import numpy as np
from torquebench.kernel import Array, kernel, sat
from torquebench.references import Sine
from torquebench.robot import dynamics
from torquebench.robot.dynamics import gravity
from torquebench.robot.flat_model import EXACT, Model
TABLE = np.zeros(3)
LIMIT = 3.0
state = [0]

def plain(x):
    return x

@kernel
def good(model: Model, x: Array, out: Array) -> float:
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
def test_the_checker_catches(what: str, tmp_path: Path) -> None:
    """Each construct outside the dialect, put into an otherwise empty kernel, is found, at its line and with a cure."""
    text = HEAD + "    " + BAD[what] + "\n"
    module: Any = load(tmp_path, text)
    if what != "global statement":  # after which LIMIT is no constant for any other function either
        assert read_kernel(plain(module.good)) == []
    lines = range(HEAD.count("\n") + 1, text.count("\n") + 1)
    found = read_kernel(plain(module.bad))
    assert found
    assert all(c.line in lines and c.what and c.cure for c in found), found


@pytest.mark.parametrize("signature", ["x: Array, limit: float = 1.0", "*x: Array", "**x: Array", "*, x: Array"])
def test_the_checker_catches_signatures(signature: str, tmp_path: Path) -> None:
    """Defaults and variable arguments have no place in the one native signature."""
    text = f"from torquebench.kernel import Array, kernel\n@kernel\ndef bad({signature}) -> float:\n    return 0.0\n"
    assert found_in(tmp_path, text)[0].startswith("line 3: bad() has *args, **kwargs, or defaults")


BRANCHES = {
    "if x[0] > 0.0:\n        y = 1.0\n    out[0] = y": "y",
    "for i in range(len(x)):\n        y = x[i]\n    out[0] = y": "y",
    "while x[0] > 0.0:\n        y = x[0]\n        break\n    out[0] = y": "y",
    "y += 1.0\n    out[0] = y": "y",
    "for i in range(3):\n        if x[i] > 0.0:\n            continue\n        y = 1.0\n    out[i] = 1.0": "i",
    "if x[0] > 0.0:\n        y = 1.0\n    elif x[1]:\n        y = 2.0\n    else:\n        pass\n    return y": "y",
    "y = 1.0 if x[0] > 0.0 else z\n    z = 2.0\n    out[0] = y": "z",
}


@pytest.mark.parametrize("body", BRANCHES)
def test_a_variable_that_may_have_no_value_is_found(body: str, tmp_path: Path) -> None:
    """Python raises where it is read; compiled code goes on with zero or with what lies there."""
    found = found_in(tmp_path, f"{HEAD}    {body}\n")
    assert len(found) == 1
    assert f": {BRANCHES[body]} may not have a value yet: " in found[0]


@pytest.mark.parametrize(
    "body",
    [
        "if x[0] > 0.0:\n        y = 1.0\n    else:\n        return 0.0\n    return y",
        "y = 0.0\n    for i in range(3):\n        y += x[i]\n    return y",
        "for i in range(3):\n        if i > 1:\n            y = 1.0\n    "
        "    else:\n            break\n        return y",
    ],
)
def test_a_variable_with_a_value_on_every_way_is_fine(body: str, tmp_path: Path) -> None:
    """Branches that return or go on with the loop do not count."""
    assert found_in(tmp_path, f"{HEAD}    {body}\n") == []


def test_a_division_in_an_inline_kernel_is_found(tmp_path: Path) -> None:
    """Copied into a law it raises where the divisor is zero; called, it does not."""
    text = (
        "from torquebench.kernel import kernel\n@kernel(inline=True)\ndef bad(x: float) -> float:\n    return 1.0 / x\n"
    )
    assert "inline" in found_in(tmp_path, text)[0]


def digests(**environment: str) -> dict[str, str]:
    """Return what ``tests/kernel_bytes.py`` prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "tests.kernel_bytes"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "NUMBA_DISABLE_JIT": "0", **environment},
    )
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
