"""``torquebench why`` of a config and of a run, and the hint that leads there."""

from __future__ import annotations

import json

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
    assert hint == "it shakes: torquebench why 'a run'"
    status, out, _ = command("why", "a run")
    assert status == 0
    assert out.startswith("joint 1 of 'stiff' limit-cycles") or out.startswith("joint 2 of 'stiff' limit-cycles")
    assert "the command delay of 20 ms does it" in out
    page = (tmp_path / "a run" / "why.html").read_text()
    assert "the command delay of 20 ms" in page
    assert "controllers.stiff.gains.kv &lt;=" in page
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
    """The cure is a key that ``--set`` takes and a number that stops the shaking."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "late.yaml").write_text(CONFIG)
    status, out, _ = command("why", "late.yaml", "--controller", "stiff", "--json")
    assert status == 0
    found = json.loads(out)
    key, _, rest = found["advice"].partition(" <= ")
    value = rest.split(",")[0].split()[0]
    status, out, _ = command("why", "late.yaml", "--controller", "stiff", "--set", f"{key}={value}")
    assert status == 0
    assert "does not shake" in out


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
