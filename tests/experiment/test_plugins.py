"""A plug-in file alone adds a disturbance, reference, chain or plant, checked and run like those that ship."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.experiment.examples import MINIMAL, parse
from torquebench.errors import ConfigError
from torquebench.experiment import Experiment, dump_experiment, experiment_json_schema
from torquebench.experiment.describe import conditions_text
from torquebench.experiment.reference import unit_of
from torquebench.experiment.run import run_experiment
from torquebench.laws.plugin import load_plugin

WAVE = '''
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.disturbances import disturbance
from torquebench.keys import Key, Vector, as_vector, in_words


@disturbance("triangle-wave")
@dataclass(frozen=True)
class TriangleWave:
    """Torque that rises and falls linearly between -a and a."""

    amplitude: Annotated[Vector, Key("Amplitude a", "N m", at_least=0)]
    period: Annotated[float, Key("Period", "s", above=0)] = 0.2

    def sample(self, n, t, control_period, rng):
        phase = t / self.period
        return np.outer(1.0 - 4.0 * np.abs(phase - np.floor(phase + 0.5)), as_vector(self.amplitude, n))

    def describe(self, units):
        return f"triangular {units.what}, {in_words(self.amplitude)} {units.torque}, {self.period:g} s"
'''
LEMNISCATE = '''
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.errors import Fault
from torquebench.keys import Key
from torquebench.references import Reference, reference


@reference("lemniscate")
@dataclass(frozen=True)
class Lemniscate:
    """Figure of eight of joints 1 and 2, from zero; the others stay at zero."""

    metrics_from = 0.5
    size: Annotated[float, Key("Half of its width", "rad", above=0)]
    period: Annotated[float, Key("Time of one round, at most run.duration", "s", above=0)]

    def check(self, timing):
        if self.period > timing.duration:
            yield Fault(("period",), got=f"{self.period:g} s", wanted=f"at most {timing.duration:g} s")

    def sample(self, t, n):
        q, qd, qdd = np.zeros((3, len(t), n))
        for joint, k in ((0, 1), (1, 2)):
            w = 2.0 * np.pi * k / self.period
            q[:, joint] = self.size / k * np.sin(w * t)
            qd[:, joint] = self.size / k * w * np.cos(w * t)
            qdd[:, joint] = -self.size / k * w * w * np.sin(w * t)
        return Reference(q, qd, qdd)
'''
SENSORS = '''
from torquebench.chain import Chain, chain


@chain("worn")
def worn():
    """Coarse encoders and tired actuators."""
    return Chain(quantisation=1e-3, velocity="differentiated", actuator_lag=0.02)
'''
ENGINE = '''
from dataclasses import dataclass
from typing import Annotated

from torquebench.keys import Key
from torquebench.sim.friction import Friction
from torquebench.sim.plants.kinds import PlantKeys, plant


@plant("damped")
@dataclass(frozen=True)
class Damped(PlantKeys):
    """The analytic arm in oil."""

    damping: Annotated[float, Key("Damping of each joint", "N m s/rad", at_least=0)] = 5.0

    def build(self, factors):
        from torquebench.sim.plants.analytic import AnalyticPlant

        return AnalyticPlant(self.twin(factors), self.timestep, self.integrator, friction=Friction(self.damping))
'''
SHORT = ("run.duration=0.6", "run.metrics_from=0.05")


pytestmark = pytest.mark.usefixtures("registries")


def added(folder: Path, text: str) -> None:
    """Load a plug-in file of this text."""
    path = folder / "kinds.py"
    path.write_text(text)
    load_plugin(path)


def mistake(*overrides: str) -> tuple[str, str]:
    """Return the key and the message of the only mistake that overrides make."""
    with pytest.raises(ConfigError) as caught:
        parse(MINIMAL, *SHORT, *overrides)
    (problem,) = caught.value.problems
    assert problem.where.startswith("--set ")
    return problem.key, problem.message


def ran(experiment: Experiment) -> np.ndarray:
    """Return the position of the only controller's run."""
    return run_experiment(experiment, path="python").runs["only"].q


def test_a_disturbance_of_a_plug_in(tmp_path: Path) -> None:
    """A triangle wave acts on the joints, its keys are checked, and it says of itself what it is."""
    wave = "disturbances=[{kind: triangle-wave, channel: torque, amplitude: [0, 3, 0, 0, 0, 0]}]"
    assert "did you mean" not in mistake(wave)[1]
    added(tmp_path, WAVE)
    experiment = parse(MINIMAL, *SHORT, wave)
    assert "disturbance: triangular torque, 0 3 0 0 0 0 N m, 0.2 s; metrics" in conditions_text(experiment)
    assert parse(dump_experiment(experiment)) == experiment
    assert unit_of("disturbances[0].period") == "s"
    assert "TriangleWave" in experiment_json_schema()["$defs"]
    assert np.any(ran(experiment) != ran(parse(MINIMAL, *SHORT)))
    here = "disturbances[0]"
    for old, new, key, word in [
        ("amplitude: [0, 3, 0, 0, 0, 0]", "amplitude: [1, 2]", f"{here}.amplitude", "one number or 6"),
        ("amplitude: [0, 3, 0, 0, 0, 0]", "amplitude: -1", f"{here}.amplitude", "at least 0"),
        ("amplitude", "amplitud", f"{here}.amplitud", "did you mean 'amplitude'?"),
        ("triangle-wave", "triangel-wave", f"{here}.kind", "did you mean 'triangle-wave'?"),
        ("channel: torque", "channel: torqe", f"{here}.channel", "did you mean 'torque'?"),
    ]:
        found = mistake(wave.replace(old, new, 1))
        assert found[0] == key
        assert word in found[1]


def test_a_reference_of_a_plug_in(tmp_path: Path) -> None:
    """A lemniscate is followed; its own rule and its own window for metrics hold."""
    added(tmp_path, LEMNISCATE)
    eight = "reference={kind: lemniscate, size: 0.2, period: 0.5}"
    experiment = parse(MINIMAL, "run.duration=1.2", eight)
    assert experiment.run.metrics_from == 0.5
    assert "reference lemniscate" in conditions_text(experiment)
    assert float(np.ptp(ran(experiment)[:, 0])) > 0.1
    assert mistake(eight.replace("0.5}", "2}")) == ("reference.period", "got 2 s, wanted at most 0.6 s")
    assert "did you mean 'lemniscate'?" in mistake(eight.replace("lemniscate", "lemniskate"))[1]
    assert "has no effect with kind: lemniscate (it belongs to kind: quintic" in mistake(eight[:-1] + ", target: 1}")[1]


def test_a_chain_of_a_plug_in(tmp_path: Path) -> None:
    """A chain has a name that configs use, and stays a name in what is written."""
    added(tmp_path, SENSORS)
    experiment = parse(MINIMAL, *SHORT, "chain=worn")
    assert experiment.chain.quantisation == 1e-3
    assert "chain: worn\n" in dump_experiment(experiment)
    assert "; chain worn; " in conditions_text(experiment)
    assert np.any(ran(experiment) != ran(parse(MINIMAL, *SHORT)))
    assert "did you mean 'worn'?" in mistake("chain=warn")[1]


def test_a_plant_of_a_plug_in(tmp_path: Path) -> None:
    """An engine of one's own has the keys of every plant and one more, and moves the arm."""
    added(tmp_path, ENGINE)
    oil = "plant={engine: damped, model: puma560, damping: 20}"
    experiment = parse(MINIMAL, *SHORT, oil)
    assert conditions_text(experiment).startswith("plant damped:puma560 (rk4, 1 ms); ")
    assert parse(dump_experiment(experiment)) == experiment
    assert np.any(ran(experiment) != ran(parse(MINIMAL, *SHORT)))
    assert mistake(oil.replace("20", "-1")) == ("plant.damping", "got -1, wanted at least 0 [N m s/rad]")
    assert "did you mean 'damped'?" in mistake(oil.replace("damped", "dampd"))[1]
    structure = mistake(oil[:-1] + ", structure: exact}")[1]
    assert structure == "has no effect with engine: damped (it belongs to engine: analytic)"


def test_a_name_is_given_once(tmp_path: Path) -> None:
    """A plug-in cannot put its own kind in place of one that ships."""
    with pytest.raises(ConfigError, match="a disturbance named 'bias' is already registered"):
        added(tmp_path, WAVE.replace("triangle-wave", "bias"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Reference(q, qd, qdd)", "Reference(q, 2.0 * qd, qdd)", "qd is not the derivative of q"),
        ("Reference(q, qd, qdd)", "Reference(q[:-1], qd, qdd)", "wanted a Reference of three arrays (600, 6)"),
        ("((0, 1), (1, 2))", "((0, 1), (6, 2))", "its kind failed: IndexError"),
    ],
)
def test_a_reference_of_a_plug_in_that_is_wrong(tmp_path: Path, old: str, new: str, words: str) -> None:
    """Rates that are no derivatives, another shape and an exception are bad input, with the section's name."""
    assert old in LEMNISCATE
    added(tmp_path, LEMNISCATE.replace(old, new))
    experiment = parse(MINIMAL, *SHORT, "reference={kind: lemniscate, size: 0.3, period: 0.5}")
    with pytest.raises(ConfigError, match=r"^reference: ") as caught:
        ran(experiment)
    assert words in str(caught.value)


def test_a_disturbance_of_a_plug_in_that_is_wrong(tmp_path: Path) -> None:
    """A torque of another shape is bad input, with its place in the list."""
    added(tmp_path, WAVE.replace("as_vector(self.amplitude, n))", "as_vector(self.amplitude, n))[1:]"))
    experiment = parse(MINIMAL, *SHORT, "disturbances=[{kind: triangle-wave, channel: torque, amplitude: 1}]")
    with pytest.raises(ConfigError, match=r"disturbances\[0\] has shape \(599, 6\), wanted \(600, 6\)"):
        ran(experiment)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "def describe(self, units)",
            "def description(self, units)",
            "class TriangleWave wants a method describe(units)",
        ),
        ("def sample(self, n, t, ", "def samples(self, n, t, ", "wants a method sample(n, t, control_period, rng)"),
    ],
)
def test_a_kind_that_lacks_a_method(tmp_path: Path, old: str, new: str, words: str) -> None:
    """It is refused where it registers, with its class and what it wants."""
    assert old in WAVE
    with pytest.raises(ConfigError, match="disturbance 'triangle-wave': ") as caught:
        added(tmp_path, WAVE.replace(old, new))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return Fault((), 'odd')", "TriangleWave.check(timing) returns a Fault, wanted a method that yields a Fault"),
        ("return None", "TriangleWave.check(timing) returns a NoneType, wanted a method that yields a Fault"),
        ("yield 'odd'", "TriangleWave.check(timing) yields a str, wanted a method that yields a Fault"),
        ("yield Fault(('amplitude',), f'{timing.n} joints in {timing.duration:g} s')", "6 joints in 0.6 s"),
    ],
)
def test_what_a_kinds_own_rule_finds(tmp_path: Path, body: str, words: str) -> None:
    """A rule of a kind knows the run's times and the number of joints; one that yields no faults is named."""
    rule = f"    def check(self, timing):\n        from torquebench.errors import Fault\n        {body}\n"
    added(tmp_path, f"{WAVE}\n{rule}")
    key, message = mistake("disturbances=[{kind: triangle-wave, channel: torque, amplitude: 1}]")
    assert key.startswith("disturbances[0]")
    assert words in message
