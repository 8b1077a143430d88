"""``torquebench check``: the table, the JSON, and the exit status."""

import json
import re

import pytest

from torquebench import check
from torquebench.cli import check as cli_check

GOOD = '''"""A user's file."""

import math
from typing import NamedTuple

import numpy as np
from torquebench import Array, controller, gravity


class Gains(NamedTuple):
    k: Array


@controller("good", gains=Gains)
def good(gains, model, t, q, qd, ref, memory, tau):
    gravity(model, q, tau)
    for i in range(len(tau)):
        tau[i] += gains.k[i] * model.tau_max[i] * math.tanh(ref.q[i] - q[i])
'''
LOOSE = """

@controller("loose", gains=Gains)
def loose(gains, model, t, q, qd, ref, memory, tau):
    tau[:] = gains.k * model.tau_max * np.tanh(ref.q - q)
"""
BAD = """

@controller("bad", gains=Gains)
def bad(gains, model, t, q, qd, ref, memory, tau):
    for i in range(len(tau)):
        q[i] = q[i] + 1e-9
        tau[i] = gains.k[i] * (ref.q[i] - q[i])
"""


@pytest.fixture(autouse=True)
def short(tmp_path, monkeypatch, registries):
    """Run in an empty folder, with few and short loops, and forget the laws afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(check, "SCALES", (1.0,))
    monkeypatch.setattr(check, "DURATION", 0.02)


def write(tmp_path, text):
    """Write the file of laws."""
    (tmp_path / "laws.py").write_text(text)
    return "laws.py"


def test_a_good_law(tmp_path, command):
    """Status 0, a row a check, what a call costs, and that both paths agree."""
    status, out, err = command("check", write(tmp_path, GOOD))
    assert (status, err) == (0, "")
    lines = out.splitlines()
    line = GOOD[: GOOD.index("@controller")].count("\n") + 1
    assert re.fullmatch(rf"law 'good' \(.*laws\.py:{line}\)", lines[0])
    assert re.search(r"^paths +pass  interpreted and compiled, 3 loops, 0 differing bytes$", out, re.MULTILINE)
    assert re.search(
        r"^cost +note  a call on six joints: interpreted [\d.,]+ us \(.* compiled [\d.]+ us", out, re.MULTILINE
    )
    assert lines[-1] == "the contract holds, on both paths"
    assert max(map(len, lines)) <= 120


def test_a_law_outside_the_dialect(tmp_path, command):
    """Status 0 too, with each place and what to write instead."""
    status, out, _ = command("check", write(tmp_path, GOOD + LOOSE), "--law", "loose")
    assert status == 0
    line = (GOOD + LOOSE)[: (GOOD + LOOSE).index("    tau[:]")].count("\n") + 1
    assert f"laws.py:{line}: tau[:]: loop over the elements" in out
    assert f"laws.py:{line}: np.tanh(): write math.tanh(x)" in out
    assert re.search(r"^dialect +note  outside it in 2 places, listed by line$", out, re.MULTILINE)
    assert out.startswith("law 'loose' is outside the dialect in 2 places")
    assert out.splitlines()[-1] == "the contract holds, on the readable path only"
    assert "law 'good'" not in out


def test_what_is_outside_the_dialect_comes_before_any_loop(tmp_path, command, monkeypatch):
    """The places are on the screen when the law is first tried."""
    seen = []
    monkeypatch.setattr(cli_check, "say", lambda text: seen.append(text))

    def tried(name, progress):
        seen.append("tried")
        return check.Report(name, "laws.py", 1)

    monkeypatch.setattr(check, "check_law", tried)
    command("check", write(tmp_path, GOOD + LOOSE))
    assert "np.tanh" in seen[0]
    assert seen[1:3] == ["tried", "tried"]


def test_costs_have_no_exponent():
    """From a nanosecond to a second; a cost whose rounds differ says that the machine is busy."""
    text = check.cost_text(check.Cost(123456.0, 0.00123))
    assert text == ("a call on six joints: interpreted 123,456 us (12,346 % of 1 ms), compiled 0.0012 us (0.00012 %)")
    assert "busy machine" in check.cost_text(check.Cost(1.0, None, False))


def test_a_bad_law_among_good_ones(tmp_path, command):
    """Every law of the file is tried; one that fails makes the status 1."""
    text = GOOD + BAD
    status, out, _ = command("check", write(tmp_path, text))
    assert status == 1
    line = text[: text.index("        q[i] = q")].count("\n") + 1
    assert re.search(rf"^inputs +FAIL  writes to q \(laws\.py, line {line}\)$", out, re.MULTILINE)
    assert re.search(r"^1 of \d+ checks FAILED$", out, re.MULTILINE)
    assert "the contract holds, on both paths" in out


def test_json(tmp_path, command):
    """The same as data, and nothing else on standard output, whatever the file prints."""
    status, out, _ = command("check", write(tmp_path, GOOD + BAD + "\nprint('loaded')\n"), "--json")
    assert status == 1
    result = json.loads(out)
    assert result["held"] is False
    assert {law["law"]: law["held"] for law in result["laws"]} == {"good": True, "bad": False}
    bad = result["laws"][0]
    assert {check["name"] for check in bad["checks"] if check["verdict"] == "FAIL"} == {"inputs"}
    assert [set(c) for c in bad["complaints"]] == [{"line", "what", "cure"}]
    assert result["laws"][1]["cost_us"]["native"] > 0.0
    assert bad["cost_us"]["native"] is None


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (GOOD, ("--law", "goood"), "--law: laws.py registers no law 'goood' (did you mean 'good'?)"),
        (GOOD, ("--law", "smc"), "--law: laws.py registers no law 'smc'"),
        ("import nothing_of_this_name\n", (), "FILE: laws.py: ModuleNotFoundError"),
        ("def law(:\n", (), "FILE: laws.py: SyntaxError"),
        ("x = 1\n", (), "FILE: laws.py: registers no law"),
        (GOOD.replace('"good"', '"smc"'), (), "FILE: laws.py: a law named 'smc' is already registered"),
        ("raise SystemExit(0)\n", (), "FILE: laws.py: SystemExit"),
    ],
)
def test_bad_input(tmp_path, command, text, arguments, message):
    """Status 2, one line, nothing on standard output."""
    status, out, err = command("check", write(tmp_path, text), *arguments)
    assert (status, out) == (2, "")
    assert err.startswith(message)
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("name", ["missing.py", ".", "laws.txt"])
def test_no_file(name, command):
    """A file that is not there, a folder, another kind of file."""
    status, out, err = command("check", name)
    assert (status, out) == (2, "")
    assert err.startswith(f"FILE: {name}: ")
    assert "Traceback" not in err
