"""``torquebench why`` of a config and of a run, and the hint that leads there."""

from __future__ import annotations

import html
import json
import shlex

from torquebench.report.why_page import free_page

CONFIG = """\
name: late
plant: {engine: analytic, model: two-link}
controllers:
  - {name: calm, law: pd-gravity, gains: {lam: 10, kv: 10}}
  - {name: stiff, law: pd-gravity, gains: {lam: 10, kv: 60}}
reference: {kind: sine, amplitude: [1.0, -0.8], frequency_hz: 0.5}
chain: {command_delay: 0.02}
run: {duration: 2.5}
"""


def test_a_run_that_shakes_says_where_to_ask(command, tmp_path, monkeypatch):
    """The last line of a run that shakes is a command which, copied, names the cause and leaves the run's page."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "late.yaml").write_text(CONFIG)
    status, out, _ = command("run", "late.yaml", "--out", "a run", "--no-figures")
    assert status == 0
    hint = next(line for line in out.splitlines() if "torquebench why" in line)
    assert hint == "stiff shakes: torquebench why 'a run' --controller stiff"
    status, out, _ = command("why", "a run")
    assert status == 0
    assert out.startswith(("joint shoulder of 'stiff' limit-cycles", "joint elbow of 'stiff' limit-cycles"))
    assert "the command delay of 20 ms does it" in out
    page = (tmp_path / "a run" / "why.html").read_text()
    assert "the command delay of 20 ms" in page
    assert "controllers.stiff.gains.kv &lt;=" in page
    for text in (out, page):
        assert "30 to 60 deg are usual" in text
    assert "command delay" in out
    assert "(yours)" in out
    assert "deg, yours" in page
    status, out, _ = command("report", "a run")
    assert status == 0, "the run is still whole"


def test_a_quiet_run_has_no_hint(command, tmp_path, monkeypatch):
    """A run that does not shake ends without it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "calm.yaml").write_text(CONFIG.replace("0.02}", "0.0}"))
    status, out, _ = command("run", "calm.yaml", "--out", "calm", "--no-figures")
    assert status == 0
    assert "torquebench why" not in out


def test_a_cure_can_be_copied(command, tmp_path, monkeypatch):
    """The line below the cure is a command that runs as it is, with what was set before, and does not shake."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "late run.yaml").write_text(CONFIG)
    given = "why", "late run.yaml", "--controller", "stiff", "--set", "run.duration=2.6"
    status, out, _ = command(*given, "--out", "page.html")
    assert status == 0
    line = next(line for line in out.splitlines() if line.startswith("try it: "))
    assert line.removeprefix("try it: ") in html.unescape((tmp_path / "page.html").read_text())
    status, out, _ = command(*given, "--json")
    assert status == 0
    found = json.loads(out)
    assert line == f"try it: {found['try_it']}"
    assert found["settings"]
    program, verb, config, *words = shlex.split(found["try_it"])
    assert (program, verb, config) == ("torquebench", "run", "late run.yaml")
    assert words[:2] == ["--set", "run.duration=2.6"]
    status, out, _ = command(verb, config, *words, "--out", "cured", "--no-figures")
    assert status == 0
    assert "torquebench why" not in out


def test_an_answer_that_differs_has_a_page_of_its_own(tmp_path):
    """The first is why.html; the same again changes nothing; others are numbered, and each is found again."""
    for page, name in ((b"a", "why"), (b"a", "why"), (b"b", "why-2"), (b"c", "why-3"), (b"b", "why-2"), (b"a", "why")):
        path = free_page(tmp_path, page)
        assert path == tmp_path / f"{name}.html"
        path.write_bytes(page)


def test_settings_of_a_run_are_refused(command, run):
    """A finished run is what it was: ``--set`` is refused and nothing is written."""
    status, _, err = command("why", run, "--set", "chain=fast")
    assert status == 2
    assert "has no effect on a run" in err
    assert not (run / "why.html").exists()


def test_an_unknown_controller_is_refused(command, tmp_path, monkeypatch):
    """The nearest name is offered."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "late.yaml").write_text(CONFIG)
    status, _, err = command("why", "late.yaml", "--controller", "stif", "--out", "page.html")
    assert status == 2
    assert "'stiff'" in err or "stiff" in err
    assert not (tmp_path / "page.html").exists()
