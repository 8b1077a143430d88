"""Which laws can be compiled: every way of leaving the dialect is found at its line, with a cure."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import pytest
from numba.core import config

from tests.dialect_cases import BAD, GOOD, HEAD, LINE
from tests.user_files import load
from torquebench.dialect import Complaint, complaints
from torquebench.laws.law import Law, find_law
from torquebench.registry import restored
from torquebench.sim.native import law_obstacle

pytestmark = pytest.mark.usefixtures("registries")


def read(tmp_path: Path, body: str, head: str = HEAD) -> tuple[Complaint, ...]:
    """Return the complaints about a law of this body."""
    load(tmp_path, head + "".join(f"    {line}\n" for line in body.splitlines()))
    return complaints(find_law("user-law"))


@pytest.mark.parametrize("body", GOOD)
def test_a_law_in_the_dialect_has_no_complaints(body: str, tmp_path: Path) -> None:
    """Arithmetic, math, kernels of the package and of the file, constants, memory and scratch space."""
    assert read(tmp_path, GOOD[body]) == ()


@pytest.mark.parametrize("name", BAD)
def test_what_lies_outside_is_found_at_its_line(name: str, tmp_path: Path) -> None:
    """One complaint, or the first of a few, names the line, what stands there and what to write instead."""
    body, line, what, cure = BAD[name]
    found = read(tmp_path, body)
    assert any(c.line == LINE + line and what in c.what and cure in c.cure for c in found), [str(c) for c in found]
    assert all(str(c) == f"line {c.line}: {c.what}: {c.cure}" for c in found)


def test_a_kernel_of_the_file_is_read_too(tmp_path: Path) -> None:
    """A law is as good as the kernels that it calls; the complaint names the kernel's line."""
    (found,) = read(tmp_path, "tau[0] = shifting(q[0])")
    line = HEAD[: HEAD.index("return x + drift")].count("\n") + 1
    assert (found.line, found.what) == (line, "the global drift")


def test_a_kernel_of_another_file_is_refused(tmp_path: Path) -> None:
    """The compiled law would not be made again when the other file changes."""
    other = load(
        tmp_path, "from torquebench.kernel import kernel\n@kernel\ndef far(x: float) -> float:\n    return x\n"
    )
    head = HEAD.replace("LIMIT = 3.0", f"from {other.__name__} import far")
    (found,) = read(tmp_path, "tau[0] = far(q[0])", head)
    assert found.line == LINE
    assert found.what == "far() is a kernel of another file"


SIGNATURE = "def user_law(gains, model, t, q, qd, ref, memory, tau):"


@pytest.mark.parametrize(
    ("signature", "what"),
    [
        ("def user_law(gains, model, t, q, qd, ref, tau):", "the arguments are (gains, model, t, q, qd, ref, tau)"),
        (
            "def user_law(k, model, t, q, qd, ref, memory, tau):",
            "the arguments are (k, model, t, q, qd, ref, memory, tau)",
        ),
        ("def user_law(gains, model, t, qd, q, ref, memory, tau):", "the arguments are (gains, model, t, qd, q, "),
        ("def user_law(gains, model, t, q, qd, ref, memory, tau, seen=[]):", "has *args, **kwargs, or defaults"),
        ("def user_law(gains, model, t, q, qd, ref, memory, tau, *rest):", "has *args, **kwargs, or defaults"),
        ("def user_law(*arguments):", "has *args, **kwargs, or defaults"),
    ],
)
def test_another_signature_is_found(signature: str, what: str, tmp_path: Path) -> None:
    """Eight arguments under their names, and no defaults, which would be a state that survives a run."""
    found = read(tmp_path, "pass", HEAD.replace(SIGNATURE, signature))
    assert any(what in c.what for c in found), [str(c) for c in found]
    assert all(c.line in (LINE - 3, LINE - 2, LINE - 1) for c in found)


@pytest.mark.parametrize(
    ("old", "new", "what", "cure"),
    [
        ("    k: Array\n", "    k: float\n", "Gains.k is annotated float", "annotate it Array, from torquebench"),
        ("    k: Array\n", "    k: np.ndarray\n", "Gains.k is annotated ndarray", "annotate it Array"),
        ("    k: Array\n", "    k: Annotated[Array, 2]\n", "Gains.k is annotated", "annotate it Array"),
        ("    work: Array\n", "    work: int\n", "Memory.work is annotated int", "annotate it Array"),
        ("    work: Array\n", "    work: list\n", "Memory.work is annotated list", "annotate it Array"),
    ],
)
def test_gains_and_memory_that_compiled_code_cannot_receive(
    old: str, new: str, what: str, cure: str, tmp_path: Path
) -> None:
    """Gains are vectors and options, memory is vectors; the complaint names the field's line."""
    head = "from __future__ import annotations\n" + HEAD.replace(old, new)
    (found,) = read(tmp_path, "tau[0] = 0.0", head)
    assert what in found.what
    assert cure in found.cure
    assert found.line == head[: head.index(new)].count("\n") + 1


def law_of(function: Any, gains: Any = None) -> Law:
    """Return a law of a function that is in no file of its own."""
    return Law("made", function, gains or find_law("pd").gains_type, None, {}, {})


def test_what_is_around_the_law_is_no_constant(tmp_path: Path) -> None:
    """A law made by another function names nothing of that function's: neither a number, which may change, nor more."""
    text = """
def make(limit, seen):
    def reading(gains, model, t, q, qd, ref, memory, tau):
        tau[0] = limit
    def listing(gains, model, t, q, qd, ref, memory, tau):
        tau[0] = seen[0]
    return reading, listing
"""
    for function, name in zip(load(tmp_path, text).make(2.0, [1.0]), ("limit", "seen"), strict=True):
        (found,) = complaints(law_of(function))
        assert found.what == f"{name}, of the function around it"
        assert found.line == function.__code__.co_firstlineno + 1


def test_a_constant_that_a_function_gives_another_value_is_none(tmp_path: Path) -> None:
    """Compiled code takes the value of a constant once."""
    head = HEAD.replace("LIMIT = 3.0\n", "LIMIT = 3.0\ndef f():\n    global LIMIT\n    LIMIT = 2.0\n")
    assert [c.what for c in read(tmp_path, "tau[0] = LIMIT", head)] == ["LIMIT, which changes"]


def test_a_number_of_another_file_is_imported_by_name(tmp_path: Path) -> None:
    """A law is compiled again when a number that it names changes, which is seen in its own file only."""
    other = load(tmp_path, "LIMIT = 3.0\n")
    head = HEAD.replace("LIMIT = 3.0", f"import {other.__name__} as numbers\nfrom {other.__name__} import LIMIT")
    with restored():
        found = read(tmp_path, "tau[0] = numbers.LIMIT", head)
    assert [c.what for c in found] == ["numbers.LIMIT, a number of another file"]
    assert read(tmp_path, "tau[0] = LIMIT * math.pi + np.pi", head) == ()


COMPILER = {
    "e = ref.q - q\ntau[0] = e[0]": "an array where a number is wanted",
    "if q > 0.0:\n    tau[0] = 1.0": "an array where a number is wanted",
    "e = -q\ntau[0] = e[0]": "an array where a number is wanted",
    "tau[0] = sat(memory.s)": "an array where a number is wanted",
    "tau[0] = q": "an array where a number is wanted",
    "tau[0] = abs(q)": "an array where a number is wanted",
    "tau[0] = math.sin(ref.q)": "an array where a number is wanted",
    "tau[0] = model.rotation[0]": "an array where a number is wanted",
    "row = model.rotation[0]\nrow = row + row": "an array where a number is wanted",
    "tau[0] = gains.lamb[0]": "Unknown attribute 'lamb'",
    "tau[0] = q[0, 0]": "an array where a number is wanted",
    "fill(q)": "Cannot bind",
    "x = gains if t > 1.0 else memory": "Cannot unify",
}


AT_ONCE = ("tau[0] = q", "tau[0] = gains.lamb[0]", "fill(q)", "x = gains if t > 1.0 else memory")
"""One for each of the compiler's reasons; the others are tried with -m slow."""


@pytest.mark.parametrize(
    "body", [pytest.param(body, marks=[pytest.mark.slow] * (body not in AT_ONCE)) for body in COMPILER]
)
@pytest.mark.skipif(config.DISABLE_JIT, reason="numba is switched off")
def test_the_compiler_refuses_the_rest(body: str, tmp_path: Path) -> None:
    """What a whitelist cannot see, types and attributes, the compiler does; its message is one line, with the place."""
    assert read(tmp_path, body) == ()
    reason = law_obstacle(find_law("user-law"))
    lines = body.splitlines()
    line = len(lines) - 1 if body.startswith(("row", "x")) else 0
    assert reason.startswith(f"law 'user-law' cannot be compiled: line {LINE + line}: {lines[line]}: ")
    assert COMPILER[body] in reason
    assert len(reason.splitlines()) == 1
    assert "0x" not in reason


def test_what_cannot_be_read_is_a_complaint() -> None:
    """Code without source, a partial, a lambda: the readable path, with the reason."""
    scope: dict[str, Any] = {}
    exec("def ghost(gains, model, t, q, qd, ref, memory, tau):\n    tau[0] = 0.0\n", scope)
    assert "cannot be read" in complaints(law_of(scope["ghost"]))[0].what
    assert "is a partial" in complaints(law_of(functools.partial(scope["ghost"])))[0].what
    assert complaints(law_of(lambda gains, model, t, q, qd, ref, memory, tau: None)) != ()


def test_gains_without_fields_are_a_complaint() -> None:
    """A law in no registry may have any object for gains; compiled code receives a NamedTuple."""
    assert any("its gains are a tuple" in c.what for c in complaints(law_of(plain_law, tuple)))


def plain_law(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
    """Ask for nothing."""
    for i in range(len(tau)):
        tau[i] = 0.0


def test_the_packages_own_laws_are_not_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the package is installed without its source they run all the same."""
    monkeypatch.setattr("linecache.getlines", lambda *arguments: [])
    assert complaints(find_law("smc")) == ()
