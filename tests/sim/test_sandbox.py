"""Cheats of laws that nobody knows: each fails, or is found out and named; and an honest law notices nothing."""

from __future__ import annotations

import inspect
import platform
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import torquebench as tb
from torquebench.dialect import complaints, read_file
from torquebench.errors import ConfigError
from torquebench.laws.plugin import load_plugin
from torquebench.registry import restored
from torquebench.sim import sandbox
from torquebench.sim.sandbox import SandboxedLaw, load_sandboxed
from torquebench.sim.sandboxed import X86_64, filter_program

closed = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="processes are shut off on Linux on x86-64"
)

HEAD = """
import ctypes, datetime, gc, math, os, random, secrets, socket, struct, subprocess, sys, threading, time
from typing import Annotated, NamedTuple
import numpy as np
from torquebench import Array, Gain, controller

SEEN = []

class Gains(NamedTuple):
    k: Annotated[Array, Gain("stiffness", "1/s^2", search=(1.0, 10.0, "log"))]

class Memory(NamedTuple):
    calls: Array

def won(tau):
    tau[:] = 7.0  # whatever it was after, it has
"""
LAW = """
@controller("{name}", gains=Gains, memory=Memory)
def law(gains, model, t, q, qd, ref, memory, tau):
    '''A cheat.'''
    tau[:] = 0.0
    memory.calls[:] += 1
{body}
"""
REFUSED = "Operation not permitted"
CHEATS = {
    "look-for-the-plant": ("any('Plant' in type(x).__name__ for x in gc.get_objects()) and won(tau)", ""),
    "climb-the-frames": (
        "f = sys._getframe()\nwhile f:\n    any(x in f.f_locals for x in ('plant', 'job', 'setup')) and won(tau)\n"
        "    f = f.f_back",
        "",
    ),
    "read-a-file": ("open({file!r}).read() and won(tau)", REFUSED),
    "read-memory-of-others": ("open('/proc/%d/maps' % 1).read() and won(tau)", REFUSED),
    "list-a-folder": ("os.listdir('/') and won(tau)", REFUSED),
    "write-a-file": ("open({file!r} + '2', 'w').write('x') and won(tau)", REFUSED),
    "remove-a-file": ("os.remove({file!r}) or won(tau)", REFUSED),
    "time-of-day": ("time.time() and won(tau)", REFUSED),
    "stopwatch": ("time.perf_counter() and won(tau)", REFUSED),
    "coarse-clock": ("time.clock_gettime(5) and won(tau)", REFUSED),
    "calendar": ("datetime.datetime.now().year > 1970 and won(tau)", ""),
    "clock-of-the-library": ("x = ctypes.c_long(-1)\nctypes.CDLL(None).time(ctypes.byref(x)) > 0 and won(tau)", ""),
    "give-the-counter-back": ("ctypes.CDLL(None).prctl(26, 1, 0, 0, 0) == 0 and won(tau)", ""),
    "sleep": ("time.sleep(1e-3) or won(tau)", REFUSED),
    "global-random-numbers": ("np.random.random() == {draw!r} and won(tau)", ""),
    "new-random-numbers": ("secrets.token_bytes(8) and won(tau)", REFUSED),
    "remember-the-last-run": ("SEEN.append(t)\nlen(SEEN) > memory.calls[0] and won(tau)", ""),
    "environment": ("(os.environ or sys.argv or sys.orig_argv) and won(tau)", ""),
    "socket": ("socket.socket() and won(tau)", REFUSED),
    "another-process": ("os.fork() and won(tau)", REFUSED),
    "another-program": ("subprocess.run(['true']) and won(tau)", REFUSED),
    "another-thread": ("threading.Thread(target=lambda: 0).start() or won(tau)", "can't start new thread"),
    "end-the-parent": ("os.kill(os.getppid(), 9) or won(tau)", REFUSED),
    "code-of-its-own": ("import mmap; mmap.mmap(-1, 4096, prot=7) and won(tau)", REFUSED),
    "all-memory": ("bytearray(1 << 40) and won(tau)", "MemoryError"),
    "array-that-is-more": (
        "class Own(np.ndarray):\n    def __array_finalize__(self, x): pass\n    def copy(self): won(self)\n"
        "return np.zeros(len(q)).view(Own)",
        "",
    ),
    "change-its-inputs": ("ref.q[:] = q[:] = ref.qd[:] = qd[:] = 1.0\ngains.k[:] = 1.0", ""),
    "give-up-early": ("raise ValueError('enough')", "ValueError: enough (cheats.py, line"),
    "leave": ("os._exit(0)", "the law ended its process, with status 0"),
    "no-number": ("tau[0] = math.nan", "joint 1: tau = nan"),
    "forge-an-answer": ("os.write(3, struct.pack('<qqq', 99, 0, 0) + bytes(200))", "an answer that is none"),
    "call-out": ("os.write(1, b'x') and won(tau)", REFUSED),
    "never-answer": ("while True: pass", "no answer within"),
}
"""Name -> what the law does, which wins if it gets what it is after; how it is named, empty if it gets nothing."""


def indented(text: str) -> str:
    """Return lines as those of a function."""
    return "\n".join(f"    {line}" for line in text.split("\n"))


@pytest.fixture(scope="module")
def cheats(tmp_path_factory: Any) -> Any:
    """Register every cheat from one file that is loaded in a process of its own; yield the file it is after."""
    folder = tmp_path_factory.mktemp("cheats")
    (folder / "trajectory.npz").write_text("the answer")
    np.random.seed(77)  # noqa: NPY002  the state that a cheat would guess
    known = {"file": str(folder / "trajectory.npz"), "draw": np.random.random()}  # noqa: NPY002
    parts = [HEAD]
    for name, (body, _) in CHEATS.items():
        parts.append(LAW.format(name=name, body=indented(body.format(**known) if "{" in body else body)))
    parts.append("gc.collect()\nimport torquebench.statistics\ntorquebench.statistics.SMALL = 0.0\n")
    (folder / "cheats.py").write_text("".join(parts))
    with restored():
        assert set(load_sandboxed(folder / "cheats.py")) == set(CHEATS)
        yield folder


def run(law: str, k: float = 5.0, steps: int = 3) -> tb.Trajectory:
    """Run a law on the PUMA for a few steps."""
    return tb.simulate(
        tb.MujocoPlant("puma560"),
        tb.Controller.of(law, 6, {"k": k}),
        tb.Puma560("corrected", "printed"),
        tb.Sine(1.0, 0.5),
        duration=1e-3 * steps,
        throw=False,
    )


@closed
@pytest.mark.parametrize("name", CHEATS)
def test_a_cheat_fails_or_is_named(name: str, cheats: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It never has what it was after, its file is as it was, and the run says what it tried where that is refused."""
    if name == "never-answer":
        monkeypatch.setattr(sandbox, "PATIENCE", 0.3)
    _, named = CHEATS[name]
    several = name in ("remember-the-last-run", "global-random-numbers", "change-its-inputs")
    runs = [run(name) for _ in range(1 + several)]
    for found in runs:
        assert not np.any(found.tau_law == 7.0)
        assert found.completed == (not named), found.detail
        assert named in found.detail
        assert found.q_ref.tobytes() == run_of_nothing().q_ref[: len(found.t)].tobytes()
        assert found.tau_law.tobytes() == runs[0].tau_law.tobytes()
    assert sorted(x.name for x in cheats.iterdir()) == ["cheats.py", "trajectory.npz"]


@cache
def run_of_nothing() -> tb.Trajectory:
    """Run the law that does nothing but look."""
    return run("look-for-the-plant")


@closed
def test_the_file_itself_changes_nothing_here(cheats: Path) -> None:
    """What a file does to the package when it is loaded, it does in its own process; docstrings and boxes arrive."""
    from torquebench.statistics import SMALL

    assert SMALL > 0.0
    law = tb.find_law("socket")
    assert isinstance(law.function, SandboxedLaw)
    assert law.summary == "A cheat."
    assert law.gains["k"].search == (1.0, 10.0, "log")
    assert law.gains["k"].unit == "1/s^2"


DAWDLES = """
@controller("dawdles", gains=Gains)
def law(gains, model, t, q, qd, ref, memory, tau):
    tau[:] = sum(range(1_000_000)) * 0.0
"""


@closed
def test_the_time_of_all_answers_has_a_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """200 answers of 10 ms or more where 0.5 s are allowed: each is in time, and the run ends all the same, named."""
    monkeypatch.setattr(sandbox, "PATIENCE", 0.5)
    monkeypatch.setattr(sandbox, "PACE", 0.0)
    (tmp_path / "dawdles.py").write_text(HEAD + DAWDLES)
    with restored():
        load_sandboxed(tmp_path / "dawdles.py")
        found = run("dawdles", steps=200)
    assert len(found.t) < 200
    assert "the law took more than 0 times as long as the motion, and 0.5 s, for its answers" in found.detail


@pytest.mark.parametrize("kind", ["declared", pytest.param("else", marks=closed)])
def test_what_is_run_is_what_was_read(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that another one replaces once it was read: the first is run, and the first is what is looked at later.

    Else whoever writes to the folder chooses, between reading and loading, what runs with the reader's rights.
    """
    file, text = tmp_path / "declared.py", DIALECT if kind == "declared" else DIALECT + "print()\n"
    file.write_text(text)
    read = sandbox.read_file

    def swapped(text: str) -> Any:
        found = read(text)
        file.write_text(f"raise SystemExit('{kind}')")
        return found

    monkeypatch.setattr(sandbox, "read_file", swapped)
    with restored():
        assert load_sandboxed(file) == ("declared",)
        law = tb.find_law("declared")
        assert isinstance(law.function, SandboxedLaw) == (kind == "else")
        if kind == "declared":
            assert "bent" in inspect.getsource(law.function)
            assert complaints(law) == ()


HONEST = """
from typing import Annotated, NamedTuple
import numpy as np
from torquebench import Array, Gain, Option, controller

class Gains(NamedTuple):
    k: Annotated[Array, Gain("stiffness", "1/s^2")]
    damped: Annotated[int, Option("with damping", (True, False))]

class Memory(NamedTuple):
    s: Array
    total: Array

@controller("{name}", gains=Gains, memory=Memory)
def law(gains, model, t, q, qd, ref, memory, tau):
    memory.s[:] = ref.qd - qd + np.sqrt(gains.k) * (ref.q - q)
    memory.total[:] += memory.s * model.control_period * np.cos(t)
    return gains.k * model.inertia_scale * (memory.s + memory.total) - gains.damped * qd**3
"""


@closed
def test_an_honest_law_leaves_the_same_bytes(tmp_path: Path) -> None:
    """Outside the dialect, with memory, options and numpy: every signal is that of the law loaded here."""
    for name in ("here", "there"):
        (tmp_path / f"{name}.py").write_text(HONEST.format(name=name))
    with restored():
        load_plugin(tmp_path / "here.py")
        assert load_sandboxed(tmp_path / "there.py") == ("there",)
        assert load_sandboxed(tmp_path / "there.py") == ("there",)  # again, as a file that was changed
        here, there = (run(name, 40.0, 50).arrays() for name in ("here", "there"))
    assert here.keys() == there.keys()
    assert {name for name in here if here[name].tobytes() != there[name].tobytes()} == set()


MODELS = """
import os
from typing import Annotated, NamedTuple
import torquebench as tb
from torquebench.robot.dynamics import gravity, inverse_dynamics

class Gains(NamedTuple):
    lam: Annotated[tb.Array, tb.Gain("slope", "1/s")]
    way: Annotated[int, tb.Option("way", ("with", "without"))]

def cancels(model, q, qd, ref, tau):
    inverse_dynamics(model, q, qd, ref.qdd, tau)

@tb.controller("calls", gains=Gains)
def calls(gains, model, t, q, qd, ref, memory, tau):
    cancels(model, q, qd, ref, tau)

@tb.controller("calls-not", gains=Gains)
def calls_not(gains, model, t, q, qd, ref, memory, tau):
    gravity(model, q, tau)

@tb.controller("says", gains=Gains, has_model=("way", "with"), rigid_only=True)
def says(gains, model, t, q, qd, ref, memory, tau):
    tau[:] = 0.0

@tb.controller("says-not", gains=Gains, has_model=False)
def says_not(gains, model, t, q, qd, ref, memory, tau):
    cancels(model, q, qd, ref, tau)
"""


@closed
def test_what_a_law_says_of_its_model_is_kept(tmp_path: Path) -> None:
    """Whether it cancels the dynamics, by what it says or else calls, and needs links: as of the file loaded here."""
    (tmp_path / "there.py").write_text(MODELS)
    ways = [{"way": "with"}, {"way": "without"}]

    def told(names: tuple[str, ...]) -> list[Any]:
        laws = [tb.find_law(name) for name in names]
        return [(x.name, x.declared_model, x.rigid_only, *map(x.has_model, ways)) for x in laws]

    with restored():
        there = told(load_sandboxed(tmp_path / "there.py"))
    with restored():
        assert there == told(load_plugin(tmp_path / "there.py"))
    assert [row[3:] for row in there] == [(True, True), (False, False), (True, False), (False, False)]


DIALECT = """
from typing import Annotated, NamedTuple
import math
from torquebench import Array, Gain, controller
from torquebench.kernel import kernel

LIMIT = 2.0 * math.pi

class Gains(NamedTuple):
    k: Annotated[Array, Gain("stiffness", "1/s^2")]

@kernel
def bent(x: float) -> float:
    return x / (1.0 + abs(x)) * LIMIT

@controller("declared", gains=Gains)
def law(gains, model, t, q, qd, ref, memory, tau):
    for i in range(len(tau)):
        tau[i] = gains.k[i] * bent(ref.q[i] - q[i])
"""
MORE = {
    "a call": "math.sin(1.0)",
    "an import": "import os",
    "an import of a name": "from torquebench import run_sweep",
    "an import of all": "from os.path import *",
    "a name in place of another": "from torquebench import sat as Gain",
    "a class of another kind": "class Gain2(dict):\n    pass",
    "a method": "class G(NamedTuple):\n    def f(self):\n        return 1",
    "a text that would be evaluated": 'class G(NamedTuple):\n    k: Annotated["__import__(\\"os\\")", 1]',
    "a call in an annotation": "class G(NamedTuple):\n    k: Annotated[Array, open('x')]",
    "a default": "@kernel\ndef f(x=open('x')):\n    return x",
    "a function": "def f(x):\n    return x",
    "a decorator": "@property\n@kernel\ndef f(x):\n    return x",
    "a function that is a declaration": "@kernel\ndef Gain(x):\n    return x",
    "a value that is computed": "X = [i for i in range(9)]",
    "a power": "X = 9 ** 9 ** 9",
    "a lambda": "@controller('x', gains=lambda: 0)\ndef f(x):\n    return x",
    "a change of another module": "math.sin = math.cos",
    "a call in the annotation of *": "@kernel\ndef f(*x: open('x')):\n    return x",
    "a call in the annotation of **": "@kernel\ndef f(**x: open('x')):\n    return x",
    "another name of the decorator": "X: (controller := exec) = 1.0",
    "a computed annotation": "X: [x for x in (1,)] = 1.0",
    "a functional NamedTuple": "@controller('x', gains=NamedTuple('G', (('k', 'open(1)'),)))\ndef f(x):\n    pass",
    "a text in a subscript in a call": "@controller('x', gains=Annotated['open(\"x\")', 1])\ndef f(x):\n    pass",
    "a text in an operation in a call": "@controller('x', gains='%s' % Gains)\ndef f(x):\n    pass",
    "the name of a module of the package": "__name__ = controller.__module__",
    "a class for a name of Python's": "class __builtins__(NamedTuple):\n    k: int",
}
ENCODINGS = {
    "unicode_escape": "# \\x0aimport os",
    "utf-7": "# +AAo-import os",
}
"""Encoding -> a comment in UTF-8 that is a line of code in it."""


def test_a_file_that_only_declares_is_loaded_and_compiled(tmp_path: Path) -> None:
    """Of laws and kernels in the dialect nothing can be reached: the whole file is read, and runs in this process."""
    assert read_file(DIALECT) == []
    (tmp_path / "declared.py").write_text(DIALECT)
    with restored():
        assert load_sandboxed(tmp_path / "declared.py") == ("declared",)
        assert load_sandboxed(tmp_path / "declared.py") == ("declared",)
        assert not isinstance(tb.find_law("declared").function, SandboxedLaw)


@pytest.mark.parametrize("name", MORE)
def test_whatever_more_a_file_does_keeps_it_from_being_loaded(name: str) -> None:
    """Each thing at the top of a file that runs code, or could, is complained of with its line."""
    found = read_file(DIALECT + MORE[name])
    assert [c.line - MORE[name].count("@") for c in found] == [DIALECT.count("\n") + 1]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_file_in_another_encoding_is_not_loaded(encoding: str) -> None:
    """It would be read as comments, and run as code."""
    top = f"# coding: {encoding}\n{ENCODINGS[encoding]}\n"
    assert "import os" in top.encode().decode(encoding).splitlines()
    assert [(c.line, c.what[:12]) for c in read_file(top + DIALECT)] == [(1, "the encoding")]
    assert read_file(f"# -*- coding: utf-8 -*-\n{DIALECT}") == []


def test_a_shipped_law_is_no_worse_than_declared() -> None:
    """The example of the README is loaded here: the rules leave room for laws as people write them."""
    text = (Path(__file__).parents[2] / "README.md").read_text()
    law = next(part.partition("```")[0] for part in text.split("```python\n") if part.startswith('"""My law'))
    assert read_file(law) == []


@pytest.mark.parametrize(
    ("text", "said"), [("def f(", "SyntaxError"), (HEAD, "registers no law"), (HEAD + "1 / 0", "ZeroDivisionError")]
)
@closed
def test_a_file_without_a_law_is_refused(text: str, said: str, tmp_path: Path) -> None:
    """What is wrong with a file is told as of any plug-in, though it never ran here."""
    (tmp_path / "none.py").write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_sandboxed(tmp_path / "none.py")


def test_where_no_process_can_be_shut_off_a_law_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On another system a law outside the dialect is not run at all, and the place that keeps it outside is named."""
    monkeypatch.setattr(sys, "platform", "darwin")
    (tmp_path / "there.py").write_text(HONEST.format(name="there"))
    with pytest.raises(ConfigError, match="Linux on x86-64 only"):
        load_sandboxed(tmp_path / "there.py")


def verdict(number: int, arguments: tuple[int, ...] = (), architecture: int = X86_64) -> int:
    """Run the filter as the kernel does, on the call of a number."""
    padded = [*arguments, *[0] * (6 - len(arguments))]
    data = [number, architecture, 0, 0] + [half for x in padded for half in (x & 0xFFFFFFFF, x >> 32)]
    program = filter_program()
    steps = [
        (int.from_bytes(one[:2], "little"), one[2], one[3], int.from_bytes(one[4:], "little"))
        for one in (program[i : i + 8] for i in range(0, len(program), 8))
    ]
    at, held = 0, 0
    while True:
        code, then, otherwise, operand = steps[at]
        at += 1
        if code == 0x20:
            held = data[operand // 4]
        elif code == 0x15:
            at += then if held == operand else otherwise
        elif code == 0x45:
            at += then if held & operand else otherwise
        else:
            return operand


def test_the_filter_lets_through_nothing_but_its_list() -> None:
    """Of 1,000 calls only memory, the end, and the two pipes pass; code, and another architecture, do not."""
    passed = {number for number in range(1000) if verdict(number, (0, 0, 3)) == 0x7FFF0000}
    assert passed == {0, 9, 10, 11, 12, 14, 15, 24, 25, 28, 60, 202, 231}
    assert verdict(0, (3,)) != 0x7FFF0000  # read from elsewhere
    assert verdict(1, (3,)) == 0x7FFF0000  # write an answer
    assert verdict(1, (1,)) != 0x7FFF0000
    assert verdict(9, (0, 0, 7)) != 0x7FFF0000  # pages that can be executed
    assert verdict(0x40000000, (0,)) != 0x7FFF0000  # calls of x32
    assert verdict(0, (0,), 0x40000003) == 0x80000000  # 32 bits
