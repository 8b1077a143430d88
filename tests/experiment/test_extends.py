"""A config that extends another: merging, controllers by name, presets, units, places of mistakes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from torquebench.chain import CHAINS
from torquebench.errors import ConfigError
from torquebench.experiment import Experiment, dump_experiment, load_experiment
from torquebench.experiment.extends import TAGS
from torquebench.experiment.groups import OneOf, group_of
from torquebench.experiment.units import MULTIPLES, units_of, without_unit
from torquebench.sim.friction import FRICTIONS
from torquebench.sweep.plan import Plan, Source

BASE = """\
plant: {engine: analytic, model: two-link}
controllers:
  - {name: first, law: smc, gains: {lam: 10, k: 0.3}}
  - {name: second, law: smc, switching: saturation, gains: {lam: 10, k: 0.3, phi: 0.3}}
reference: {kind: sine, amplitude: 0.5, frequency_hz: 0.5}
run: {duration: 2}
"""


@pytest.fixture
def write(tmp_path: Path):
    """Write files into a folder by their names and return the first one's path."""

    def files(**texts: str) -> Path:
        for name, text in texts.items():
            (tmp_path / f"{name}.yaml").write_text(text)
        return tmp_path / f"{next(iter(texts))}.yaml"

    return files


def problems(path: Path, *overrides: str) -> list[str]:
    """Return the mistakes of a file as lines, with its folder left out."""
    with pytest.raises(ConfigError) as refused:
        load_experiment(path, overrides)
    return [str(problem).replace(f"{path.parent}/", "") for problem in refused.value.problems]


def test_own_keys_count_and_the_parents_stay(write) -> None:
    """Mappings merge key by key, names of controllers stand for the parent's, a variant differs in what it says."""
    own = "extends: base.yaml\ncontrollers: [second, {extends: first, name: third, gains: {k: 0.6}}]\nrun: {seed: 3}\n"
    found = load_experiment(write(own=own, base=BASE + "chain: fast\n"))
    assert found.name == "own"
    assert found.run.duration == 2.0
    assert found.run.seed == 3
    assert found.chain.name == "fast"
    assert [keys.name for keys in found.controllers] == ["second", "third"]
    assert found.controllers[1].gains == {"lam": 10.0, "k": 0.6}
    assert found.controllers[0].gains == {"lam": 10.0, "k": 0.3, "phi": 0.3}


def test_what_is_stored_is_whole(write, tmp_path: Path) -> None:
    """The resolved experiment reads back equal in a folder without the parent."""
    found = load_experiment(write(own="extends: base.yaml\nrun: {seed: 3}\n", base=BASE))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "stored.yaml").write_text(dump_experiment(found))
    assert load_experiment(tmp_path / "elsewhere" / "stored.yaml") == found


def test_another_kind_replaces_and_null_takes_away(write) -> None:
    """Keys of another kind of reference do not mix; a key that is null is none of the parent's."""
    own = "extends: base.yaml\nreference: {kind: step, target: 0.3, at: 0.2}\nrun: {duration: 4}\n"
    own += "model: {mismatch: null}\n"
    found = load_experiment(write(own=own, base=BASE + "model: {mismatch: {relative: 0.2}}\n"))
    assert type(found.reference).__name__ == "Step"
    assert found.model.mismatch is None


def test_a_chain_of_parents_and_the_words_that_end_it(write) -> None:
    """The nearest parent counts first; what extends itself, or nothing that there is, is refused where it says so."""
    path = write(a="extends: b.yaml\n", b="extends: base.yaml\nrun: {seed: 1}\n", base=BASE + "chain: slow\n")
    assert (load_experiment(path).run.seed, load_experiment(path).chain.name) == (1, "slow")
    write(b="extends: a.yaml\n")
    assert problems(path)[0].startswith("b.yaml:1:10: extends: 'a.yaml' extends itself")
    write(a="extends: bas.yaml\n")
    assert problems(path) == [
        "a.yaml:1:10: extends: there is no 'bas.yaml', wanted the name of a shipped config, or of a .yaml file beside "
        "this one (did you mean 'base.yaml'?)"
    ]
    for value in ("/etc/passwd", "3", "[a]", "''"):
        write(a=f"extends: {value}\n")
        assert problems(path)[0].startswith("a.yaml:1:10: extends: ")


def test_mistakes_are_told_where_they_were_written(write) -> None:
    """A parent's mistake has the parent's file and line, a child's the child's, all of them at once."""
    own = "extends: base.yaml\ncontrollers: [frist, {extends: second, gains: {kk: 1}}]\nrun: {duratoin: 3}\n"
    found = problems(write(own=own, base=BASE.replace("0.5, freq", "big, freq")), "run.seed=x")
    assert [line.partition(": ")[0] for line in found] == [
        "own.yaml:2:15",
        "own.yaml:2:48",
        "own.yaml:3:7",
        "base.yaml:5:36",
        "--set run.seed=x",
    ]
    assert "(did you mean 'first'?)" in found[0]


def test_an_override_may_name_controllers_and_presets(write) -> None:
    """``--set controllers=[...]`` chooses among those that there are; a preset may be set as well."""
    path = write(own="extends: base.yaml\n", base=BASE)
    assert [keys.name for keys in load_experiment(path, ["controllers=[second]"]).controllers] == ["second"]
    found = load_experiment(
        "configs/paper/fig9-step.yaml", ["reference=puma560/sine", "controllers.band.gains=puma560/m"]
    )
    assert type(found.reference).__name__ == "Sine"
    assert found.controllers[1].gains == {"lam": 20.0, "k": 0.3, "phi": 1.0}


def test_a_law_takes_of_a_set_of_gains_those_that_act(write) -> None:
    """No gain of a set that has no effect with the options is taken; keys beside ``from`` count before the set's."""
    text = """\
plant: {model: puma560}
controllers:
  - {law: smc, gains: puma560/l}
  - {extends: smc, name: soft, switching: saturation, gains: {k: 0.6}}
reference: {from: puma560/sine, amplitude: 0.1}
run: {duration: 2}
"""
    found = load_experiment(write(own=text))
    assert found.controllers[0].gains == {"lam": 10.0, "k": 0.3}
    assert found.controllers[1].gains == {"lam": 10.0, "k": 0.6, "phi": 0.3}
    assert found.reference.amplitude == 0.1
    assert "(did you mean 'puma560/l'?)" in problems(write(own=text.replace("puma560/l", "puma560/ll")))[0]


def test_noise_in_per_cent_is_that_share_of_the_motions_torque(write) -> None:
    """Sigma is 0.3 x RMS of M(q) qdd + C(q, qd) qd + g(q) along the reference, to its four digits."""
    path = write(own="extends: base.yaml\ndisturbances: 30 %\n", base=BASE)
    found = load_experiment(path)
    (noise,) = found.disturbances
    assert (noise.kind, noise.hold, noise.relative) == ("band-limited-noise", 0.01, None)
    from torquebench.robot import load_model

    arm = load_model("two-link")
    motion = found.reference.sample(np.arange(2000) * 0.001, 2)
    states = zip(motion.q, motion.qd, motion.qdd, strict=True)
    tau = np.array([arm.mass_matrix(q) @ qdd + arm.bias_forces(q, qd) for q, qd, qdd in states])
    np.testing.assert_allclose(noise.sigma, 0.3 * np.sqrt(np.mean(tau**2, axis=0)), rtol=1e-3)
    halved = load_experiment(path, ["run.control_period=0.002"])
    assert halved.disturbances == found.disturbances


def test_every_draw_of_a_sweep_has_the_size_of_its_own_motion(write) -> None:
    """Where the amplitude is drawn, so is the noise's size: that of the experiment checked alone."""
    text = BASE + "disturbances: 30 %\nsweep: {draws: 3, random: {reference.amplitude: {uniform: [0.2, 0.9]}}}\n"
    plan = Plan(Source(text.encode(), "own.yaml"))
    drawn = [plan.experiment(0, draw) for draw in range(3)]
    for experiment in drawn:
        alone = Experiment.from_dict(experiment.to_dict(), ["disturbances=30 %"])
        assert experiment.disturbances == alone.disturbances
    assert len({experiment.disturbances[0].sigma for experiment in drawn}) == 3


def test_a_sweep_takes_its_parents_along(write, tmp_path: Path) -> None:
    """A plan made of the texts alone, as another process makes it, is that of the files; its stored text is whole."""
    path = write(own="extends: base.yaml\nsweep: {draws: 2}\n", base=BASE)
    plan = Plan(Source(path.read_bytes(), str(path)))
    path.with_name("base.yaml").unlink()
    assert Plan(plan.source).first == plan.first
    assert Plan(Source(plan.text, "sweep.yaml")).first == plan.first


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("1 ms", "s", 0.001),
        ("500us", "s", 0.0005),
        ("2 min", "s", 120.0),
        ("0.1 mrad", "rad", 0.0001),
        ("180 deg", "rad", math.pi),
        ("30 %", "1", 0.3),
        ("1e2 mN m", "N m", 0.1),
        ("5 rad/s", "rad/s", 5.0),
        ("-3 mm", "m", -0.003),
    ],
)
def test_numbers_with_a_unit(text: str, unit: str, number: float) -> None:
    """A number with a unit is the very number that it would be without: 1 ms is 0.001 to the last bit."""
    assert without_unit(text, unit) == number
    assert without_unit([text, 2.0], unit) == [number, 2.0]


@pytest.mark.parametrize("text", ["1 m", "1 MS", "ms", "1 ms 2", "%", "1 %%", "0x1 s", "1_0 s", "nan s"])
def test_other_texts_stay_what_they_are(text: str) -> None:
    """No other unit, and nothing that is not a number, becomes one."""
    assert without_unit(text, "s") == text


def test_no_unit_has_two_meanings() -> None:
    """Within a key's units each is named once; the key's own is accepted."""
    for unit in MULTIPLES:
        assert len(set(units_of(unit))) == len(units_of(unit))


def test_the_keys_that_decide_others_are_those_of_the_schema() -> None:
    """`TAGS` are the tags of every section that has kinds."""
    found = set()
    for node in group_of(Experiment).nodes.values():
        for inner in (node, *vars(node).values()):
            if isinstance(inner, OneOf):
                found.add(inner.tag)
    assert found == set(TAGS)


def test_numbers_with_a_unit_are_numbers_in_a_sweep(write) -> None:
    """In a grid, a range and a distribution 1 deg/s is the number of rad/s: one axis of numbers, none of them twice."""
    sweep = "sweep: {grid: {controllers.second.gains.phi: [100 mrad/s, 0.2, 3 deg/s], "
    sweep += "run.control_period: {from: 1 ms, to: 2 ms, count: 2}}, "
    sweep += "random: {run.seed: {choice: [1, 2]}, controllers.*.gains.k: {uniform: [20 %, 0.3]}}}\n"
    plan = Plan(Source((BASE + sweep).encode(), "own.yaml"))
    phi, period = plan.keys.axes
    assert phi.numeric
    assert [value.word for value in phi.values] == [0.1, 0.2, math.radians(3.0)]
    assert [value.word for value in period.values] == [0.001, 0.002]
    assert next(r for r in plan.keys.random if r.kind == "uniform").numbers == (0.2, 0.3)
    with pytest.raises(ConfigError, match="is there already"):
        Plan(Source((BASE + sweep.replace("0.2, 3", "0.1, 3")).encode(), "own.yaml"))


def test_another_law_takes_no_gains_over(write) -> None:
    """A controller that extends one of another law is its own: gains of the other do not mix."""
    own = "extends: base.yaml\ncontrollers: [{extends: second, law: pd, gains: {lam: 5, kv: 10}}]\n"
    (found,) = load_experiment(write(own=own, base=BASE)).controllers
    assert (found.name, found.law, found.gains) == ("pd", "pd", {"lam": 5.0, "kv": 10.0})


def test_a_name_given_twice_points_at_where_it_is_given(write) -> None:
    """Both places are in the file that takes the controller over, not where the parent defines it."""
    found = problems(write(own="extends: base.yaml\ncontrollers: [first, {extends: first}]\n", base=BASE))
    assert found == [
        "own.yaml:2:32: controllers[1].name: 'first' is already the name of another controller (own.yaml:2:15), "
        "wanted a name of its own"
    ]


def test_what_null_takes_away_is_missed_where_it_was_taken(write) -> None:
    """The place is the key's that is null."""
    (found,) = problems(write(own="extends: base.yaml\nrun: {seed: 1}\nreference: null\n", base=BASE))
    assert found.startswith("own.yaml:3:1: reference: missing")


def test_an_unknown_parent_hides_nothing(write) -> None:
    """Mistakes in the file's own keys are told with it; what only the parent would have given is not called missing."""
    own = "extends: bas\ncontrollers: [first, {extends: second, gains: {lam: x}}]\nrun: {duratoin: 3}\nreference: 3\n"
    found = problems(write(own=own, base=BASE))
    assert [line.partition(": ")[0] for line in found] == [
        "own.yaml:1:10",
        "own.yaml:2:53",
        "own.yaml:3:7",
        "own.yaml:4:12",
    ]
    middle = "extends: nothing.yaml\nrun: {sede: 1}\n"
    found = problems(write(own="extends: b.yaml\nchain: fats\ncontrollers: [first]\n", b=middle))
    assert [line.partition(": ")[0] for line in found] == ["own.yaml:2:8", "b.yaml:1:10", "b.yaml:2:7"]


def test_slips_in_short_files_are_told_with_the_cure(write) -> None:
    """A share of noise without its sign, and a variant that does not say of which controller."""
    own = "extends: base.yaml\ndisturbances: 0.3\ncontrollers: [{name: first, gains: {k: 1}}]\n"
    found = problems(write(own=own, base=BASE))
    assert len(found) == 2
    assert found[0].startswith("own.yaml:2:15: disturbances: got 0.3, wanted a list")
    assert "0.3 times the motion's torque: 30 %" in found[0]
    assert found[1].startswith("own.yaml:3:15: controllers[0].law: missing")
    assert "{extends: first, ...}" in found[1]


def test_an_override_may_take_over_what_only_the_parent_has(write) -> None:
    """``--set controllers=[first]`` of a file that lists another one."""
    path = write(own="extends: base.yaml\ncontrollers: [second]\n", base=BASE)
    assert [keys.name for keys in load_experiment(path, ["controllers=[first]"]).controllers] == ["first"]
    with pytest.raises(ConfigError, match=r"--set controllers=first: .* such as \[first, second\], or of whole ones"):
        load_experiment(path, ["controllers=first"])


def test_the_short_files_of_the_documents(write) -> None:
    """Fig 9 in three lines is the shipped Fig 9 with the sine; five lines are a sweep over noise of that motion."""
    found = load_experiment(write(fig9="extends: paper/sine\ncontrollers: [conventional, band, linear-band]\n"))
    shipped = load_experiment("configs/paper/fig9-chattering.yaml")
    assert found.controllers == shipped.controllers
    assert (found.plant, found.reference, found.model) == (shipped.plant, shipped.reference, shipped.model)
    (other,) = load_experiment("configs/paper/fig9-chattering.yaml", ["controllers=[proposed-m]"]).controllers
    assert other.gains["phi"] == 1.0
    text = """\
extends: paper/sine
controllers: [proposed-m, {law: pd-gravity, gains: {lam: 10, kv: 20}}]
disturbances: 30 %
sweep: {draws: 30}
"""
    plan = Plan(Source(text.encode(), "mine.yaml"))
    assert plan.draws == 30
    assert plan.first.disturbances[0].sigma == pytest.approx((5.06, 16.59, 3.30, 0.54, 0.62, 0.81), abs=0.01)


def test_a_named_chain_but_for_one_key(write) -> None:
    """``{from: ur5e, ...}``, and an override or a swept key inside a name, keep every other number of the name."""
    path = write(own=BASE + "chain: {from: ur5e, command_delay: 4 ms}\n", named=BASE)
    wanted = replace(CHAINS["ur5e"], command_delay=0.004, name="custom")
    assert load_experiment(path).chain == wanted
    other = path.with_name("named.yaml")
    assert load_experiment(other, ["chain=ur5e", "chain.command_delay=4 ms"]).chain == wanted
    swept = BASE + "chain: ur5e\nsweep: {grid: {chain.command_delay: [0, 0.004]}}\n"
    plan = Plan(Source(swept.encode(), "own.yaml"))
    assert [plan.experiment(case, 0).chain.command_delay for case in (0, 1)] == [0.0, 0.004]
    assert plan.experiment(1, 0).chain == wanted


def test_named_friction_but_for_one_key(write) -> None:
    """The other numbers are those of the name."""
    six = BASE.replace("model: two-link", "model: puma560, friction: {from: puma560, speed: 0.05}")
    found = load_experiment(write(own=six)).plant.friction
    assert found == replace(FRICTIONS["puma560"], speed=0.05)


def test_a_name_that_is_none_is_refused_at_its_place(write) -> None:
    """The nearest chain is told, and nothing else of the mapping is complained of."""
    path = write(own=BASE + "chain: {from: ur5, command_delay: 4 ms}\n")
    told = problems(path)[0]
    assert told.startswith("own.yaml:7:15: chain.from: got the text 'ur5'")
    assert "did you mean 'ur5e'?" in told


@pytest.mark.parametrize("broken", ["!!python/name:os.system x", "{extends: band, name: {a: b}}", "{name: [1]}"])
def test_a_sweep_that_extends_tells_what_cannot_be_read(broken: str) -> None:
    """A value that cannot be read, or a name that is none, is a mistake of the file, also before it is written out."""
    text = f"extends: fig9-chattering\ncontrollers: [band, {broken}]\nsweep: {{draws: 2}}\n"
    with pytest.raises(ConfigError, match=r"controllers\[1\]"):
        _ = Plan(Source(text.encode(), "swept.yaml")).first
