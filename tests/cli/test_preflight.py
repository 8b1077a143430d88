"""``torquebench preflight``: exit status, what is shown, and the document."""

import json
import re

import pytest

from torquebench.preflight import Finding, Report

PLUGIN = '''"""A user's law."""

from typing import NamedTuple

from torquebench import Array, controller, gravity


class Gains(NamedTuple):
    k: Array


@controller("own-law", gains=Gains)
def own_law(gains, model, t, q, qd, ref, memory, tau):
    gravity(model, q, tau)
    for i in range(len(tau)):
        tau[i] += gains.k[i] * (ref.q[i] - q[i] + 0.2 * (ref.qd[i] - qd[i]))
'''
CONFIG = """\
name: mine
plant: {engine: mujoco, model: two-link}
controllers:
  - {name: soft, law: pd-gravity, gains: {lam: 4, kv: 8}}
reference: {kind: quintic, target: 0.5, rise_time: 1}
run: {duration: 3}
"""
FRANKA = ("--gain", "kp=600,600,600,600,250,150,50", "--gain", "kd=50,50,50,50,30,25,15")


@pytest.mark.slow
def test_a_law_that_passes(command):
    """Status 0: a dot for each motion, a bar for each limit, and nothing to change."""
    status, out, _ = command("preflight", "joint-impedance", "--robot", "fr3", *FRANKA)
    assert status == 0
    assert out.startswith("joint-impedance on fr3: passes\n")
    assert out.count("o o o o") == 4
    assert " x " not in out.replace("; x: something", "")
    assert "of 1000 N m/s" in out
    assert "30 to 60 deg" in out
    assert "(the robot's)" in out
    assert "(yours)" in out


def test_a_law_that_is_refused(command, tmp_path, monkeypatch):
    """Status 1, and the document has reason, joint, time and number of what was found, the share, and no more."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(CONFIG.replace("{lam: 4, kv: 8}", "{lam: 20, kv: 200}"))
    status, out, err = command("preflight", "mine.yaml", "--robot", "two-link", "--chain", "fast", "--json")
    document = json.loads(out)
    assert (status, err, document["passed"], document["payload"]) == (1, "", False, 1.0)
    law = document["laws"][0]
    assert len(law["flights"]) == 16
    first = law["findings"][0]
    assert (first["reason"], first["beyond"], first["limit"], first["unit"]) == (
        "saturates",
        True,
        2.0,
        "% of the time",
    )
    assert first["value"] > 2.0
    assert first["flight"].startswith("hold, from ")
    assert law["scaled_gains"] == ["kv"]
    assert 0.0 < law["largest_share"] < 1.0


def test_what_is_said_to_pass_passes_when_it_is_typed(command):
    """Where the largest share that passes leaves less than 30 deg, one that leaves them is said, too; both pass."""
    given = "preflight", "pd-gravity", "--robot", "two-link", "--chain", "ur5e", "--payload", "0", "--gain", "lam=10"
    status, out, _ = command(*given, "--gain", "kv=240")
    lines = [line for line in out.splitlines() if "would pass" in line]
    assert (status, len(lines)) == (1, 2)
    phases = [int(re.search(r"phase margin (-?\d+) deg", line)[1]) for line in lines]
    assert phases[0] < 30 <= phases[1]
    for line in lines:
        assert command(*given, "--gain", re.search(r"--gain (kv=[\d.]+)", line)[1])[0] == 0


@pytest.mark.slow
def test_gains_too_large_for_a_franka_are_refused(command):
    """For the rate of the torque at rest, which the robot's own reflex would answer."""
    gains = ("--gain", "kp=600,600,600,600,250,150,50", "--gain", "kd=250,250,250,250,150,125,75")
    status, out, _ = command("preflight", "joint-impedance", "--robot", "fr3", "--payload", "0", *gains, "--json")
    document = json.loads(out)
    assert (status, document["passed"], document["payload"]) == (1, False, 0.0)
    law = document["laws"][0]
    assert len(law["flights"]) == 8
    first = law["findings"][0]
    unit = "N m/s filtered at 100 Hz"
    assert (first["reason"], first["beyond"], first["limit"], first["unit"]) == ("torque rate", True, 1000.0, unit)
    assert first["value"] > 1000.0
    assert first["flight"].startswith("hold, from ")
    assert law["scaled_gains"] == ["kp", "kd"]
    assert 0.0 < law["largest_share"] < 1.0


def test_a_config(command, tmp_path, monkeypatch):
    """The controllers of a config are flown on the robot that is given, with its chain, at the config's own period."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(CONFIG)
    status, out, err = command("preflight", "mine.yaml", "--robot", "two-link", "--chain", "fast")
    assert (status, err) == (0, "")
    assert out.startswith("soft on two-link: passes")
    _, _, err = command("preflight", "mine.yaml", "--robot", "two-link", "--chain", "dynamixel")
    assert "the robot's control period is 5 ms" in err
    assert list(tmp_path.iterdir()) == [tmp_path / "mine.yaml"]


def test_a_law_of_a_plugin(command, tmp_path, monkeypatch, registries):
    """A law that --plugin registers is taken by its name, with the gains that are given; another name is refused."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(PLUGIN)
    flown = []

    def fly(experiment, payload, progress):
        flown.append((experiment.controllers[0], payload))
        return [Report("own-law", ("hold, from home, 0 kg",), (), ("k",), 1.0)]

    monkeypatch.setattr("torquebench.preflight.preflight", fly)
    given = "--plugin", "own.py", "--robot", "two-link", "--chain", "fast"
    status, out, _ = command("preflight", "own-law", *given, "--gain", "k=60,20", "--payload", "0.5")
    assert (status, out.partition(":")[0]) == (0, "own-law on two-link")
    ((keys, payload),) = flown
    assert (keys.law, keys.gains, payload) == ("own-law", {"k": (60.0, 20.0)}, 0.5)
    status, _, err = command("preflight", "own-lav", *given)
    assert (status, len(flown)) == (2, 1)
    assert "did you mean 'own-law'" in err


@pytest.mark.slow
def test_a_users_law(command, tmp_path, monkeypatch, registries):
    """A file's law is flown with the gains that are given."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(PLUGIN)
    status, out, _ = command("preflight", "own.py", "--robot", "two-link", "--chain", "fast", "--gain", "k=60,20")
    assert (status, out.partition(":")[0]) == (0, "own-law on two-link")


@pytest.mark.parametrize(
    ("words", "lines"),
    [
        (
            ["joint-impedanse", "--robot", "fr4", "--gain", "kp=a"],
            ["--gain: got 'kp=a', wanted", "--robot: got 'fr4' (did you mean", "LAW: got 'joint-impedanse' (did you"],
        ),
        (["pd", "--robot", "puma560"], ["--chain: this robot has no chain of its name: choose one by --chain, got"]),
        (
            ["pd", "--robot", "fr3", "--gain", "kp=1", "--gain", "lam=-2"],
            ["--gain: kp: unknown", "--gain: lam: got -2"],
        ),
        (["mine.yaml", "--robot", "fr3", "--gain", "k=1"], ["--gain: a config has its own gains"]),
        (["none.yaml", "--robot", "fr3"], ["none.yaml: does not exist"]),
        (["none.py", "--robot", "fr3"], ["LAW: none.py: no such file"]),
    ],
)
def test_bad_input(words, lines, command, tmp_path, monkeypatch):
    """Status 2, a line for each mistake, and nothing is flown or written."""
    monkeypatch.chdir(tmp_path)
    status, out, err = command("preflight", *words)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == len(lines)
    for line, begin in zip(err.splitlines(), lines, strict=True):
        assert begin in line
    assert not list(tmp_path.iterdir())


def test_a_layer_that_passes_is_said_as_it_is_typed(command, monkeypatch):
    """An option of the law by --option, its width by --gain; the law that is flown has what is typed."""
    flown = []

    def fly(experiment, payload, progress):
        flown.append(experiment.controllers[0])
        layer = (("switching", "saturation"), ("phi", "[0.2, 0.1]"))
        chatters = Finding("chatters", "hold, from home, 0 kg", "shoulder", 0.5, 5.0, 1.0, "% of tau_max", True)
        return [Report("smc", (chatters.flight,), (chatters,), ("k",), None, layer=layer)]

    monkeypatch.setattr("torquebench.preflight.preflight", fly)
    given = "preflight", "smc", "--robot", "two-link", "--chain", "fast"
    (line,) = [line for line in command(*given)[1].splitlines() if "would pass" in line]
    typed = "--option switching=saturation --gain phi=0.2,0.1"
    assert line == f"{typed} would pass"
    assert command(*given, *typed.split())[0] == 1
    keys = flown[-1]
    assert (keys.options["switching"], keys.gains["phi"]) == ("saturation", (0.2, 0.1))


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("surface", "--option: got 'surface', wanted NAME=VALUE"),
        ("switching=satur", "did you mean 'saturation'"),
        ("swiching=sign", "did you mean 'switching'"),
    ],
)
def test_an_option_that_the_law_does_not_have_is_refused(command, typed, said):
    """Status 2, with the flag, what was wanted and the nearest name."""
    status, out, err = command("preflight", "smc", "--robot", "two-link", "--chain", "fast", "--option", typed)
    assert (status, out) == (2, "")
    assert err.startswith("--option: ")
    assert said in err
