"""The contract test of laws: good ones pass, and each way of breaking the contract is caught at its line."""

from __future__ import annotations

import re
import sys
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import event

from tests.check.bad_laws import BAD, FIELDS, HEAD, LAW, NOTES, SIGNATURES, SPRING
from tests.user_files import load
from torquebench import check, check_cases, check_law, find_law, law_names
from torquebench.check import FAIL, NOTE, PASS, Check, Report
from torquebench.errors import ControllerError
from torquebench.laws import Law, Option
from torquebench.registry import restored
from torquebench.robot.library import data_root
from torquebench.sim.trajectory import SIGNALS


@pytest.fixture(autouse=True)
def few_loops(monkeypatch: pytest.MonkeyPatch, registries: None) -> None:
    """Forget the laws that a test registers, and try fewer loops: the full number is tried on the package's laws."""
    monkeypatch.setattr(check, "SCALES", (1.0,))
    monkeypatch.setattr(check, "DURATION", 0.03)


def report_on(folder: Path, body: str, head: str = HEAD) -> Report:
    """Return the report on a law of this body."""
    load(folder, head + "".join(f"    {line}\n" for line in body.splitlines()))
    return check_law("user-law")


def failed(report: Report) -> set[str]:
    """Return the names of the checks that did not hold."""
    return {check.name for check in report.checks if check.verdict == FAIL}


def detail(report: Report, name: str) -> str:
    """Return what a check found."""
    return next(check.detail for check in report.checks if check.name == name)


def test_a_good_law_passes_everything(tmp_path: Path) -> None:
    """Every check passes, on both paths, and costs are measured on both."""
    report = report_on(tmp_path, SPRING)
    assert report.held
    assert {check.verdict for check in report.checks} == {PASS, NOTE}
    assert [check.name for check in report.checks if check.verdict == NOTE] == ["cost"]
    assert [check.name for check in report.checks] == [
        "arguments",
        "torque",
        "finite",
        "repeatable",
        "inputs",
        "state",
        "gains",
        "joints",
        "allocation",
        "dialect",
        "loop",
        "paths",
        "compiled once",
        "quiet",
        "cost",
    ]
    assert report.line == LAW
    assert report.complaints == ()
    assert report.cost is not None
    assert report.cost.native is not None
    assert 0.0 < report.cost.native < report.cost.python < 1e4


@pytest.mark.parametrize("name", BAD)
def test_a_bad_law_is_caught_at_its_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checks that fail are those that should, and the report names the line of the file.

    The law is compiled only where that is what finds it bad.
    """
    body, wanted = BAD[name]
    if "paths" not in wanted:
        monkeypatch.setattr(check, "law_obstacle", lambda law: "left out here")
    report = report_on(tmp_path, body)
    certain = {check for check in wanted if not check.startswith("?")}
    assert certain <= failed(report) <= {check.lstrip("?") for check in wanted}, str(report)
    assert not report.held
    here = next((k for k, line in enumerate(body.splitlines()) if "# here" in line), None)
    line = LAW + 2 + here if here is not None else LAW
    if name in FIELDS:
        line = HEAD[: HEAD.index(f"    {FIELDS[name] or 'k'}: ")].count("\n") + 1
    texts = [check.detail for check in report.checks if check.verdict == FAIL]
    named = {int(x) for text in texts for group in re.findall(r"lines? ([\d, ]+)\)", text) for x in group.split(", ")}
    assert line in named, str(report)


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_bad_signature_is_caught(name: str, tmp_path: Path) -> None:
    """Too few or too many arguments end the test; a mutable default is hidden state."""
    signature, wanted = SIGNATURES[name]
    head = HEAD.replace("def user_law(gains, model, t, q, qd, ref, memory, tau):", signature)
    body = SPRING.replace("memory.s[i]", "e").replace("e = ref", "e = ref") + (
        "    tau[i] += len(seen)" if "seen" in head else ""
    )
    report = report_on(tmp_path, body, head)
    assert failed(report) == wanted, str(report)
    assert any(f"line {LAW + k}" in check.detail for check in report.checks for k in (0, 1))


def test_state_around_the_law_is_caught(tmp_path: Path) -> None:
    """A law made by another function keeps its count in that function's variable."""
    text = (
        HEAD[: HEAD.index("@controller")]
        + """
def make():
    count = [0.0]
    @controller("user-law", gains=Gains, memory=Memory)
    def user_law(gains, model, t, q, qd, ref, memory, tau):
        count[0] += 1.0
        for i in range(len(tau)):
            tau[i] = gains.k[i] * (ref.q[i] - q[i]) + gains.lam[i] * (ref.qd[i] - qd[i]) + count[0]
make()
"""
    )
    load(tmp_path, text)
    report = check_law("user-law")
    assert failed(report) == {"repeatable", "state"}
    assert f"lines {text[: text.index('count[0] += 1.0')].count(chr(10)) + 1}, " in detail(report, "state")


@pytest.mark.parametrize("name", NOTES)
def test_a_law_outside_the_dialect_holds_the_contract(name: str, tmp_path: Path) -> None:
    """It runs interpreted: a note with the line and the cure, no failure."""
    body, what = NOTES[name]
    report = report_on(tmp_path, body)
    assert report.held, str(report)
    assert {"dialect", "paths"} <= {check.name for check in report.checks if check.verdict == NOTE}
    line = LAW + 2 + next(k for k, text in enumerate(body.splitlines()) if "# here" in text)
    assert any(c.line == line and what in c.what and c.cure for c in report.complaints), str(report)
    assert report.cost is not None
    assert report.cost.native is None
    assert ("returns an array" in str(report)) == (name == "an array returned")


def test_integer_gains_keep_a_law_interpreted(tmp_path: Path) -> None:
    """A gain annotated as a number is handed over as an array all the same, which compiled code could not receive."""
    report = report_on(tmp_path, SPRING, HEAD.replace("k: Annotated[Array,", "k: Annotated[float,"))
    assert report.held
    line = HEAD[: HEAD.index("    k: Annotated")].count("\n") + 1
    assert [(c.line, c.cure) for c in report.complaints] == [(line, "annotate it Array, from torquebench")]


def test_what_a_law_prints_is_noted_and_not_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Hundreds of calls would bury the table."""
    report = report_on(tmp_path, SPRING + "print('hello', t)")
    assert report.held
    assert detail(report, "quiet") == "prints: 'hello 0.0'"
    assert capsys.readouterr().out == ""


def test_an_option_without_effect_is_caught(tmp_path: Path) -> None:
    """Each option is tried with each value; one that makes no difference fails as an ignored gain does."""
    option = '    mode: Annotated[int, Option("mode", ("soft", "hard"))]\n\n\nclass Memory'
    head = HEAD.replace("\n\nclass Memory", option)
    with restored():
        assert "option 'mode' makes no difference (" in detail(report_on(tmp_path, SPRING, head), "gains")
    assert report_on(tmp_path, SPRING + "    tau[i] *= 1.0 + gains.mode", head).held


def test_a_fault_under_one_choice_of_options_only_is_caught(tmp_path: Path) -> None:
    """The report names the choice."""
    option = '    mode: Annotated[int, Option("mode", ("soft", "hard"))]\n\n\nclass Memory'
    body = SPRING + "    if gains.mode == 1:\n        tau[i] = math.sqrt(-1.0 - t)  # here"
    report = report_on(tmp_path, body, HEAD.replace("\n\nclass Memory", option))
    assert "mode: hard" in detail(report, "finite")
    assert "finite" in failed(report)


AT_ONCE = (
    "adrc",
    "linear-band-smc",
    "pd-gravity",
    "sliding-pi",
)
"""Laws that between them have options, a model, memory and none; the others are tried with -m slow."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in AT_ONCE)) for name in law_names()]
)
def test_the_packages_laws_pass(name: str) -> None:
    """Every registered law holds the contract on both paths, with every value of its options."""
    report = check_law(name)
    assert report.held, str(report)
    assert [check.verdict for check in report.checks if check.name == "paths"] == [PASS]


@pytest.mark.parametrize("document", ["README.md", "docs/writing-a-law.md"])
def test_the_laws_of_the_documents_pass(document: str, tmp_path: Path) -> None:
    """What is shown to copy holds the contract, on both paths."""
    text = (data_root() / document).read_text()
    sources = [
        s for s in re.findall(r"^```python\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE) if "@controller" in s
    ]
    assert sources
    for source in sources:
        load(tmp_path, source)
        report = check_law(re.search(r'@controller\("([\w-]+)"', source)[1])  # type: ignore[index]
        assert report.held, str(report)
        assert report.complaints == ()


def test_the_guide_shows_what_check_prints(tmp_path: Path) -> None:
    """The table in docs/writing-a-law.md has the checks of a good law, in their order, and their words."""
    guide = (data_root() / "docs" / "writing-a-law.md").read_text()
    shown = re.findall(r"^([a-z ]+?) +(pass|note)  (.*)$", guide, flags=re.MULTILINE)
    readme = (data_root() / "README.md").read_text()
    sources = re.findall(r"^```python\n(.*?)^```$", readme, re.DOTALL | re.MULTILINE)
    load(tmp_path, next(source for source in sources if "my-law" in source))
    made = check_law("my-law").checks
    assert [row[:2] for row in shown] == [(check.name, check.verdict) for check in made]
    for (name, _, text), row in zip(shown, made, strict=True):
        if name not in ("loop", "paths", "cost"):  # fewer loops here; times are the machine's
            assert text == row.detail


def test_paths_that_differ_are_caught(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the compiled law's torque were another in its last bit, the first step and signal that differ are named."""
    real = check._controller

    def other(law: Any, name: str, options: Any, scale: float) -> Any:
        called_by = sys._getframe(1).f_code.co_name
        return real(law, name, options, scale * (1.0 + 2**-52) if called_by == "difference" else scale)

    monkeypatch.setattr(check, "_controller", other)
    report = report_on(tmp_path, SPRING.replace("sat(memory.s[i])", "sat(1e-3 + memory.s[i])"))
    assert failed(report) == {"paths"}
    assert re.search(r"the paths differ from step \d+ on, first in (tau_law|memory\.s)", detail(report, "paths"))


@pytest.mark.parametrize("signal", ["tau_law", "s", "integral"])
def test_the_first_difference_is_found_in_every_signal(signal: str) -> None:
    """One bit at one instant, in the torque or in any channel of the memory, is found there; without it nothing is."""
    law = find_law("smc")
    options = {"equivalent_control": False, "switching": "saturation", "surface": "pid"}
    run = check._run(law, "two-link", "mujoco", options, 1.0)
    assert check.difference(law, "two-link", options, 1.0, run) == ""
    changed = (getattr(run, signal) if hasattr(run, signal) else run.extra[signal]).copy()
    changed[17, 1] = np.nextafter(changed[17, 1], np.inf)
    new: dict[str, Any] = {signal: changed} if hasattr(run, signal) else {"extra": {**run.extra, signal: changed}}
    name = "tau_law" if signal == "tau_law" else f"memory.{signal}"
    wanted = f"the paths differ from step 17 on, first in {name}"
    assert check.difference(law, "two-link", options, 1.0, replace(run, **new)) == wanted


def test_a_run_that_raises_ends_at_one_instant_on_both_paths(tmp_path: Path) -> None:
    """A division by zero after some steps is no difference; one that only the compiled law meets is one."""
    load(tmp_path, HEAD + "".join(f"    {line}\n" for line in f"{SPRING}    tau[i] = tau[i] / (t - 0.02)".splitlines()))
    law = find_law("user-law")
    run = check._run(law, "two-link", "mujoco", {}, 1.0)
    assert run.failed_at == 20
    assert check.difference(law, "two-link", {}, 1.0, run) == ""
    longer: dict[str, Any] = {name: np.concatenate([x := getattr(run, name), x[-1:]]) for name in ("t", *SIGNALS)}
    found = check.difference(law, "two-link", {}, 1.0, replace(run, **longer))
    assert found == "the paths differ from step 20 on: compiled, the law raises"


def test_a_law_that_is_compiled_again_is_caught(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba says when it compiles; after the first loops nothing may be left to compile."""
    real = check.difference

    def compiling(*arguments: Any) -> Any:
        if arguments[3] == 3.0:  # the run that is watched
            numba.njit(lambda x: x + 1.0)(1.0)
        return real(*arguments)

    monkeypatch.setattr(check, "difference", compiling)
    assert failed(report_on(tmp_path, SPRING)) == {"compiled once"}


def test_neither_loop_nor_plant_is_compiled(tmp_path: Path) -> None:
    """Trying a law compiles the law, the kernels that it calls and what calls it: nothing of loop and plants."""
    share = 0.8 + uuid.uuid4().int % 10**8 / 1e9  # a law that has never been compiled, so that it is in no cache
    own = SPRING.replace("* sat(", f"* {share} * sat(")
    with event.install_recorder("numba:compile") as compiling:
        assert report_on(tmp_path, own).held
    compiled = " ".join(str(e.data["dispatcher"]) for _, e in compiling.buffer)
    assert "user_law" in compiled
    assert not re.search(r"closed_loop|integrate|runge_kutta|forward_dynamics", compiled)


def test_no_such_law() -> None:
    """The nearest name is suggested."""
    with pytest.raises(ControllerError, match=r"did you mean 'smc'\?"):
        check_law("smcc")


def test_the_motions_are_what_they_say() -> None:
    """The first is at rest on its reference; the others move, and their references state their own derivatives."""
    first, *rest = check_cases.motions(2)
    assert all(not x.any() for x in first[1:])
    for motion in rest:
        slope = (motion.q_ref[2:] - motion.q_ref[:-2]) / 0.002
        assert abs(slope - motion.qd_ref[1:-1]).max() < 1e-4
    sizes = [abs(m.q_ref - m.q).max() for m in rest]
    assert min(sizes) < 5e-3
    assert max(sizes) > 0.5


def test_gains_differ_between_joints_and_are_the_same_under_every_option() -> None:
    """So that an effect of an option is not one of other gains, and a gain of another joint's is found."""
    law = find_law("smc")
    some = [check_cases.gains_of(law, 3, options, 1) for options in check_cases.combinations(law)]
    assert len(some) == 18  # equivalent control, switching and surface: 3 x 2 x 3
    for gains in some:
        assert len(set(gains["lam"])) == 3
        assert gains["lam"].tolist() == some[0]["lam"].tolist()
    assert {"phi" in gains for gains in some} == {True, False}


def test_many_options_are_tried_one_at_a_time() -> None:
    """2^5 combinations are too many: the defaults, and each other value once."""
    options = {f"o{k}": Option("", (True, False)) for k in range(5)}
    law = Law("x", lambda: None, tuple, None, {}, options)
    found = check_cases.combinations(law)
    assert len(found) == 6
    assert sorted(sum(not value for value in chosen.values()) for chosen in found) == [0, 1, 1, 1, 1, 1]


def test_a_report_as_text_and_as_data() -> None:
    """A failed check is in both; a report without one has held."""
    report = Report("x", "/somewhere/x.py", 3)
    report.add("one", "", "fine")
    assert report.held
    report.add("two", "odd", "fine", NOTE)
    report.add("three", "broken", "fine")
    assert not report.held
    place = "broken (x.py, line 3)"
    assert report.checks == [Check("one", PASS, "fine"), Check("two", NOTE, "odd"), Check("three", FAIL, place)]
    assert report.to_json()["checks"][2] == {"name": "three", "verdict": FAIL, "detail": place}
    assert "FAIL  three  broken" in str(report)
    assert check_cases.CONTROL_PERIOD != 0.001


def test_without_a_compiler_the_readable_path_is_checked_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba is switched off, or MuJoCo cannot be called from compiled code, that is a note with the reason."""
    monkeypatch.setattr(check, "law_obstacle", lambda law: "numba is switched off")
    report = report_on(tmp_path, SPRING)
    assert report.held
    assert detail(report, "paths") == "readable path only: numba is switched off"
    assert report.cost is not None
    assert report.cost.native is None
