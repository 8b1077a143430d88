"""``laws``, ``show``, ``configs``, bare help, short options, defaults from the environment: how a user finds around."""

import json
import math
import re

import pytest
import yaml

from tests.cli.test_check import GOOD
from tests.command_line import COMMANDS, parsed
from torquebench.chain import CHAINS
from torquebench.cli.app import COMMANDS as HEADINGS
from torquebench.errors import ConfigError
from torquebench.experiment import parse_experiment
from torquebench.laws import find_law, law_names
from torquebench.registry import restored
from torquebench.shipped import configs, data_root, find_config, first_line


def test_help_when_bare(command):
    """No arguments: the help, every heading and command in it, and status 0."""
    status, out, err = command()
    assert (status, err) == (0, "")
    assert (status, out) == command("--help")[:2]
    assert all(f"\n{heading}:\n" in out for heading in HEADINGS)
    assert all(re.search(rf"^  {name} ", out, re.MULTILINE) for name in COMMANDS)
    assert "Exit status: 0 done" in out


def test_every_command_has_a_short_help(command):
    """One line of the help each, however narrow: at most 60 characters."""
    for name, found in COMMANDS.items():
        assert 10 < len(found.get_short_help_str(200)) <= 60, name


def test_chains(command):
    """All are listed; one is shown with its numbers, units, sources and links, and the same in the document."""
    out = command("chains")[1]
    assert all(name in out for name in CHAINS)
    assert list(json.loads(command("chains", "--json")[1])["chains"]) == list(CHAINS)
    shown = json.loads(command("show", "fr3", "--json")[1])
    rate = next(row for row in shown["numbers"] if row["key"] == "torque_rate")
    assert (rate["value"], rate["unit"]) == (1000.0, "N m/s")
    text = " ".join(command("show", "fr3")[1].split())
    assert "1000 N m/s" in text
    assert "control_period: 0.001" in text
    assert rate["link"].split("/")[-1] in text
    status, _, err = command("show", "ur5")
    assert status == 2
    assert "did you mean 'ur5e'?" in err


def test_laws(command):
    """Every law with the first line of its docstring; the same in the document."""
    out = command("laws")[1]
    data = json.loads(command("laws", "--json")[1])
    assert list(data["laws"]) == list(law_names())
    assert all(name in out and summary in out for name, summary in data["laws"].items())


def test_laws_of_a_plug_in(command, tmp_path):
    """A law of one's own is listed and shown as the others are."""
    (tmp_path / "mine.py").write_text(GOOD)
    with restored():
        assert "\ngood" in command("laws", "-p", tmp_path / "mine.py")[1]
    with restored():
        assert "gain" in command("show", "good", "-p", tmp_path / "mine.py")[1]


@pytest.mark.parametrize("name", law_names())
def test_show_a_law(command, name):
    """Its docstring, gains with units, options with values; the example, put into a config, is accepted."""
    status, out, _ = command("show", name)
    law = find_law(name)
    assert status == 0
    assert law.summary in out
    for gain in law.gains.values():
        assert gain.meaning in out
        assert gain.unit in out
    for option in law.options.values():
        assert option.meaning in out
    example = json.loads(command("show", name, "--json")[1])["example"]
    assert example in out
    experiment = parse_experiment(
        "name: x\nplant: {engine: analytic, model: two-link}\n"
        f"reference: {{kind: sine, amplitude: 0.5, frequency_hz: 0.5}}\nrun: {{duration: 2.0}}\n{example}\n",
        "x.yaml",
    )
    assert experiment.controllers[0].law == name


def test_show_an_arm(command, tmp_path):
    """Each number of each joint with where it is from: the file, a table given to import, or assumed."""
    link = '<inertial mass="1" pos="0.1 0 0" diaginertia="1e-2 1e-2 1e-2"/>'
    (tmp_path / "arm.xml").write_text(
        f"""<!-- Mine, of 2026. --><mujoco><worldbody><body>{link}
        <joint name="turn" axis="0 1 0" range="-90 90" armature="0.25" damping="0.5"/><body>{link}
        <joint name="lift" type="slide" frictionloss="3"/></body></body></worldbody><actuator>
        <velocity joint="turn" kv="7" ctrlrange="-2 2" forcerange="-40 40"/><motor joint="lift"/></actuator></mujoco>"""
    )
    shown = ("import", tmp_path / "arm.xml", "--torque-limits", "lift=30", "--out", tmp_path / "made")
    assert command(*shown)[0] == 0
    facts = json.loads(command("show", tmp_path / "made" / "made.xml", "--json")[1])
    turn, lift = (
        {key: (x["value"], x["source"]) for key, x in j.items() if isinstance(x, dict)} for j in facts["joints"]
    )
    assert turn == {
        "range": ([-math.pi / 2, math.pi / 2], "file"),
        "speed": (2.0, "file"),
        "torque": (40.0, "file"),
        "armature": (0.25, "file"),
        "damping": (0.5, "file"),
        "friction": (0.0, "assumed"),
    }
    assert lift["torque"] == (30.0, "table")
    assert (lift["range"], lift["armature"], lift["friction"]) == ((None, "assumed"), (0.0, "assumed"), (3.0, "file"))
    shown = command("show", tmp_path / "made" / "made.xml")[1]
    assert max(map(len, shown.partition("where it is from")[2].splitlines())) <= 120
    text = " ".join(shown.split())
    assert all(
        words in text for words in ("given to import (lift)", "assumed, 0: the file has none (turn)", "N m or N")
    )
    both = command("show", "fr3")[1].partition("In a config:")[2]  # once: a key may be there once
    assert yaml.safe_load(both) == {
        "chain": "fr3",
        "plant": {"model": "fr3"},
        "run": {"control_period": 0.001, "initial_q": "key:home"},
    }
    assert command("show", tmp_path / "none.xml")[0] == 2


def test_show_a_config(command):
    """The file's text, without its being read as an experiment."""
    out = command("show", "two-link")[1]
    assert configs()["two-link"].read_text() in out


def test_show_nothing(command):
    """Neither a law nor a config: the nearest of both."""
    assert command("show", "smcc")[::2] == (
        2,
        "NAME: got 'smcc', which is neither a law, a chain, an arm nor a shipped config (did you mean 'smc'?)\n",
    )
    assert "'fig9-step'" in command("show", "fig9-stpe")[2]


def test_configs(command):
    """Every file that ships, under a name that finds it again, with its description."""
    data = json.loads(command("configs", "--json")[1])["configs"]
    assert {fact["file"] for fact in data.values()} == {str(path) for path in (data_root() / "configs").rglob("*.yaml")}
    for name, fact in data.items():
        assert str(find_config(name)) == fact["file"]
        tree = yaml.safe_load(find_config(name).read_text())
        assert fact["description"] == tree.get("description", first_line(find_config(name)))
        assert fact["sweep"] == ("sweep" in tree)


def test_the_names_of_shipped_configs(tmp_path, monkeypatch):
    """By stem, by folder and stem, or as in the checkout; a file of the user goes first; other names are refused."""
    monkeypatch.chdir(tmp_path)
    file = data_root() / "configs" / "paper" / "fig9-chattering.yaml"
    for name in ("fig9-chattering", "paper/fig9-chattering", "configs/paper/fig9-chattering.yaml"):
        assert find_config(name) == file
    for name in ("fig9-chattering.yaml", "fig9", "../configs/sweep", "paper/../sweep", "/configs/sweep", ""):
        if name:
            with pytest.raises(ConfigError):
                find_config(name)
    (tmp_path / "sweep").touch()
    assert str(find_config("sweep")) == "sweep"


def test_run_by_name(command, tmp_path, monkeypatch):
    """A shipped config runs from anywhere by its name; its mistakes would be placed in the file."""
    monkeypatch.chdir(tmp_path)
    short = ("-s", "run.duration=1.2", "-s", "run.metrics_from=0.2", "--no-figures", "-q")
    assert command("run", "two-link", "-o", "out", *short) == (0, "", "")
    assert (tmp_path / "out" / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("short", "long"),
    [
        (["run", "x", "-o", "a", "-s", "b=1", "-p", "c"], ["run", "x", "--out", "a", "--set", "b=1", "--plugin", "c"]),
        (["sweep", "x", "-j", "3"], ["sweep", "x", "--workers", "3"]),
        (["report", "x", "-qv"], ["report", "x", "--quiet", "--verbose"]),
    ],
)
def test_short_options(short, long, tmp_path, monkeypatch):
    """Each means the same as the long one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").touch()
    assert parsed(short) == parsed(long)


def test_defaults_from_the_environment(command, tmp_path, monkeypatch):
    """TORQUEBENCH_COMMAND_OPTION is the default of an option; a bad value is placed there; the line wins."""
    monkeypatch.setenv("TORQUEBENCH_COMPARE_STATES", "7")
    sides = ("analytic:two-link", "analytic:two-link")
    assert json.loads(command("compare", *sides, "--json")[1])["states"] == 7
    assert json.loads(command("compare", *sides, "--json", "--states", "8")[1])["states"] == 8
    monkeypatch.setenv("TORQUEBENCH_RUN_SET", "run.duration=2 run.seed=x")
    assert command("run", "two-link")[2].startswith("--set run.seed=x: run.seed: ")
    monkeypatch.setenv("TORQUEBENCH_COMPARE_STATES", "many")
    status, _, err = command("compare", *sides)
    assert status == 2
    assert err == "--states (from TORQUEBENCH_COMPARE_STATES): got 'many', wanted a whole number, 1 to 1000000\n"


def test_where_results_go(command, tmp_path, monkeypatch):
    """TORQUEBENCH_RUNS takes the place of the folder `runs`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TORQUEBENCH_RUNS", str(tmp_path / "mine"))
    assert command("fuzzy", "s-7", "-q")[0] == 0
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert len(list((tmp_path / "mine").glob("fuzzy-s-7-*/*.svg"))) == 3
