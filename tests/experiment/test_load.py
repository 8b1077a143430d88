"""A good config becomes the experiment it describes, and back; overrides and the editor's schema agree."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import torquebench
from tests.experiment.examples import ALL, GOOD, MINIMAL, STEP, edited
from torquebench.errors import ConfigError
from torquebench.experiment import (
    Experiment,
    as_vector,
    config_hash,
    dump_experiment,
    experiment_json_schema,
    load_experiment,
    parse_experiment,
)
from torquebench.experiment.yaml_tree import FORBIDDEN
from torquebench.laws.base import find_law, law_names
from torquebench.robot.library import data_root


def parse(text: str, *overrides: str) -> Experiment:
    """Return the experiment of a text that must be accepted."""
    return parse_experiment(text, "good.yaml", overrides)


def test_every_key_arrives_where_it_belongs() -> None:
    """Each value of the fully written config is found under the attribute of the same name."""
    x = parse(GOOD)
    assert (x.name, x.description, x.chain) == ("good", "every section, one key per line", "ideal")
    assert (x.plant.engine, x.plant.model, x.plant.timestep, x.plant.integrator) == (
        "mujoco", "puma560", 0.001, "rk4",
    )  # fmt: skip
    assert (x.model.structure, x.model.constants) == ("corrected", "printed")
    assert x.model.mismatch is not None
    assert x.model.mismatch.relative == 0.3
    first, second = x.controllers
    assert (first.name, first.law, first.expect) == ("conventional", "smc", "completed")
    assert first.options == {"equivalent_control": True, "switching": "saturation"}
    assert first.gains == {"lam": 10.0, "k": 0.3, "phi": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)}
    assert second.options == {"equivalent_control": False}
    assert second.gains == {"lam": 10.5, "k": 0.25, "phi": 0.35, "kv": 20.0}
    assert x.reference.kind == "sine"
    assert (x.reference.amplitude, x.reference.frequency_hz) == ((1.2, -1.0, 1.0, 1.1, 1.0, 1.0), 0.75)
    (noise,) = x.disturbances
    assert (noise.kind, noise.channel, noise.sigma, noise.hold, noise.clip_sigma) == (
        "band-limited-noise", "torque", 0.5, 0.02, 2.5,
    )  # fmt: skip
    assert (x.run.duration, x.run.control_period, x.run.initial_q) == (4.0, 0.002, "home")
    assert (x.run.seed, x.run.metrics_from, x.run.draw) == (7, 1.25, 3)


def test_defaults_are_the_documented_ones() -> None:
    """What a minimal config leaves out has the documented defaults."""
    x = parse(MINIMAL)
    assert x.description is None
    assert (x.plant.timestep, x.plant.integrator) == (0.001, "rk4")
    assert x.plant.engine == "analytic"
    assert (x.plant.structure, x.plant.constants) == ("exact", "fitted")
    assert (x.model.structure, x.model.constants, x.model.mismatch) == ("exact", "fitted", None)
    assert (x.controllers[0].expect, x.controllers[0].options, x.chain) == ("completed", {}, "ideal")
    assert (x.run.control_period, x.run.initial_q, x.run.seed, x.run.draw) == (0.001, "home", 0, 0)
    assert x.disturbances == ()
    (noise,) = parse(MINIMAL, "disturbances=[{kind: band-limited-noise, channel: torque, sigma: 1}]").disturbances
    assert (noise.hold, noise.clip_sigma) == (0.01, 3.0)


@pytest.mark.parametrize(("kind", "start"), [("sine", 1.0), ("step", 2.0), ("ramp", 1.0), ("quintic", 1.0)])
def test_metrics_start_depends_on_the_reference(kind: str, start: float) -> None:
    """Left out, the metrics' window starts at 2 s for a step and at 1 s otherwise."""
    text = ALL["good" if kind == "sine" else kind].replace("  metrics_from: 1.25\n", "")
    assert parse(text).run.metrics_from == start


def test_derived_numbers() -> None:
    """4 s at 2 ms are 2000 control instants of two 1 ms physics steps; 20 ms of hold are 10 of them."""
    x = parse(GOOD)
    assert (x.n, x.n_steps, x.substeps, x.hold_steps(x.disturbances[0])) == (6, 2000, 2, 10)
    tenth = parse(GOOD, "run.control_period=0.1", "plant.timestep=0.1", "run.duration=4.3", "disturbances=[]")
    assert (tenth.n_steps, tenth.substeps) == (43, 1)  # 4.3 / 0.1 is 42.99999999999999 in binary


def test_as_vector_repeats_numbers_and_copies_lists() -> None:
    """One number serves all joints; a list keeps its order; the result is the caller's own array."""
    assert np.array_equal(as_vector(2.0, 3), [2.0, 2.0, 2.0])
    assert np.array_equal(as_vector((1.0, 2.0, 3.0), 3), [1.0, 2.0, 3.0])
    assert as_vector(2.0, 3).dtype == np.float64
    as_vector(2.0, 3)[0] = 1.0


def test_gains_fit_the_law() -> None:
    """What the loader accepts, the law packs without complaint."""
    for controller in parse(GOOD).controllers:
        packed = find_law(controller.law).pack_gains(6, controller.gains, controller.options)
        assert np.array_equal(packed.k, as_vector(controller.gains["k"], 6))


def test_experiment_is_read_only() -> None:
    """A loaded experiment cannot be changed by accident, nor built with unknown keys."""
    x = parse(GOOD)
    with pytest.raises(ValidationError):
        x.name = "other"  # type: ignore[misc]
    with pytest.raises(ValidationError):
        x.run.duration = 1.0  # type: ignore[misc]
    with pytest.raises(ValidationError):
        type(x.run)(duration=1.0, metrics_from=0.0, colour="red")  # type: ignore[call-arg]


def test_load_reads_the_file(tmp_path: Path) -> None:
    """From disk, with an override, the same experiment comes out as from text; messages carry the path."""
    path = tmp_path / "x.yaml"
    path.write_text(GOOD)
    assert load_experiment(path, ["run.seed=9"]) == parse(GOOD, "run.seed=9")
    path.write_text(edited("seed: 7", "sed: 7"))
    with pytest.raises(ConfigError, match=r"x\.yaml:46:3: run\.sed: unknown key \(did you mean 'seed'\?\)"):
        load_experiment(path)


AMPLITUDE, DESCRIPTION = "[1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "description: every section, one key per line"
OVERRIDES = [
    ("run.duration=2", "duration: 4", "duration: 2"),
    ("run.seed = 11", "seed: 7", "seed: 11"),
    ("controllers[0].gains.k=0.5", "k: 0.3", "k: 0.5"),
    ("controllers.conventional.gains.k=0.5", "k: 0.3", "k: 0.5"),
    ("controllers.linear-band.equivalent_control=true", "_control: false", "_control: true"),
    ("reference.amplitude[3]=9", "1.1", "9"),
    ("reference.amplitude=[1, 2, 3, 4, 5, 6]", AMPLITUDE, "[1, 2, 3, 4, 5, 6]"),
    ("model.mismatch={relative: 0.1}", "relative: 0.3", "relative: 0.1"),
    ("controllers[0].expect=failed", "    law: smc\n", "    law: smc\n    expect: failed\n"),
    ("description=a = b", DESCRIPTION, "description: a = b"),
    ("description='2'", DESCRIPTION, "description: '2'"),
]


@pytest.mark.parametrize(("override", "old", "new"), OVERRIDES)
def test_override_is_the_same_as_editing_the_file(override: str, old: str, new: str) -> None:
    """An override, of an old key or a new one, by index or by name, equals the edit it stands for."""
    assert parse(GOOD, override) == parse(edited(old, new))
    assert parse(GOOD, override) != parse(GOOD)


def test_overrides_apply_in_order_and_make_sections() -> None:
    """The last override of a key wins; a section that the file lacks is made."""
    assert parse(GOOD, "run.seed=1", "run.seed=2").run.seed == 2
    x = parse(MINIMAL, "model.structure=corrected", "model.mismatch.relative=0.2")
    assert x.model.mismatch is not None
    assert x.model.mismatch.relative == 0.2


BAD_OVERRIDES = [
    ("run.duraton=2", "run.duraton", "did you mean 'duration'"),
    ("rum.duration=2", "rum", "did you mean 'run'"),
    ("run.duration=two", "run.duration", "wanted a number [s]"),
    ("run.duration='2'", "run.duration", "remove the quotes"),
    ("run.duration=", "run.duration", "nothing"),
    ("run.duration=[1", "run.duration", "not valid YAML"),
    ("run.duration=!!int 2", "run.duration", "tags"),
    ("run.duration=1.2", "run.metrics_from", "1.75 s"),
    ("run.seed=1\x1b[2J", "run.seed", "U+001B"),
    ("controllers.conventonal.gains.k=1", "controllers.conventonal", "did you mean 'conventional'"),
    ("controllers.conventional.gains.kk=1", "controllers[0].gains.kk", "unknown gain"),
    ("controllers[2].name=x", "controllers[2]", "has 2 items"),
    ("reference.amplitude[6]=1", "reference.amplitude[6]", "has 6 items"),
    ("run.duration.x=1", "run.duration.x", "run.duration is not a mapping"),
    ("run[0]=1", "run[0]", "run is not a list"),
    ("run.duration", "", "KEY=VALUE"),
    ("=3", "", "KEY=VALUE"),
    ("", "", "KEY=VALUE"),
    ("run..seed=3", "", "KEY=VALUE"),
    ("run.seed[x]=3", "", "KEY=VALUE"),
    ("reference={kind: step, target: 1}", "reference.at", "missing"),
    ("description=" + "x" * 70_000, "", "at most 65536"),
]


@pytest.mark.parametrize(("override", "key", "word"), BAD_OVERRIDES, ids=lambda value: str(value)[:30])
def test_bad_override_is_reported_where_it_was_written(override: str, key: str, word: str) -> None:
    """A mistake in an override points at the option itself; a contradiction, at the key it contradicts."""
    with pytest.raises(ConfigError) as caught:
        parse(GOOD, override)
    (problem,) = caught.value.problems
    assert (problem.key, word in problem.message) == (key, True)
    assert problem.where.startswith("good.yaml:47:" if key == "run.metrics_from" else "--set ")
    assert str(problem).isprintable()
    assert len(str(problem)) < 400


@pytest.mark.parametrize("name", ALL)
def test_examples_round_trip(name: str) -> None:
    """Dumped and loaded again, each example is equal, and dumping once more changes nothing."""
    x = parse(ALL[name])
    text = dump_experiment(x)
    assert parse(text) == x
    assert dump_experiment(parse(text)) == text
    assert config_hash(parse(text)) == config_hash(x)


def test_dump_states_every_default() -> None:
    """The dump of a minimal config states every default, so that it outlives a change of defaults."""
    text = dump_experiment(parse(MINIMAL))
    for key in (
        "timestep: 0.001", "integrator: rk4", "structure: exact", "constants: fitted", "chain: ideal",
        "disturbances: []", "control_period: 0.001", "initial_q: home", "seed: 0", "metrics_from: 2.0",
        "draw: 0", "expect: completed",
    ):  # fmt: skip
        assert key in text


def test_hash_changes_with_meaning_only() -> None:
    """Comments, order of keys, 4 for 4.0 and a stated default leave the hash alone; any value changes it."""
    same = edited("duration: 4", "duration: 4.0  # seconds").replace("  integrator: rk4\n", "")
    assert config_hash(parse(same)) == config_hash(parse(GOOD))
    for override, _, _ in OVERRIDES:
        assert config_hash(parse(GOOD, override)) != config_hash(parse(GOOD))


def test_negative_zero_is_zero() -> None:
    """-0.0 and 0.0 compare equal, so they have the same hash."""
    zero, negative = (parse(STEP, f"reference.at={at}", f"reference.target={at}") for at in ("0.0", "-0.0"))
    assert zero == negative
    assert config_hash(zero) == config_hash(negative)


SLUGS = st.from_regex(r"[a-z0-9]([a-z0-9-]{0,20}[a-z0-9])?", fullmatch=True)
TEXT = st.text(max_size=60).filter(lambda text: not FORBIDDEN.search(text))


def vectors(low: float, high: float) -> st.SearchStrategy[Any]:
    """Numbers, or lists of six."""
    number = st.floats(low, high) | st.integers(int(low) + 1, int(high))
    return number | st.lists(number, min_size=6, max_size=6)


POSITIVE = vectors(1e-300, 1e300)
NOISE = st.fixed_dictionaries(
    {"kind": st.just("band-limited-noise"), "channel": st.just("torque"), "sigma": vectors(0.0, 1e300)},
    optional={"clip_sigma": st.floats(0.1, 9), "hold": st.sampled_from([0.012, 0.6, 6])},
)
REFERENCE = st.one_of(
    st.fixed_dictionaries({"kind": st.just("sine"), "amplitude": vectors(-5, 5), "frequency_hz": vectors(0, 5)}),
    st.fixed_dictionaries({"kind": st.just("step"), "target": vectors(-5, 5), "at": st.floats(0, 1)}),
    st.fixed_dictionaries(
        {
            "kind": st.sampled_from(["ramp", "quintic"]),
            "target": vectors(-5, 5),
            "rise_time": st.floats(0.1, 9),
        }
    ),
)
SMC = st.one_of(
    st.fixed_dictionaries(
        {"law": st.just("smc"), "gains": st.fixed_dictionaries({"lam": POSITIVE, "k": POSITIVE})},
        optional={"equivalent_control": st.booleans(), "expect": st.sampled_from(["completed", "failed"])},
    ),
    st.fixed_dictionaries(
        {
            "law": st.just("smc"),
            "switching": st.just("saturation"),
            "gains": st.fixed_dictionaries({"lam": POSITIVE, "k": POSITIVE, "phi": POSITIVE}),
        }
    ),
)


@st.composite
def configs(draw: st.DrawFn) -> dict[str, Any]:
    """Any valid config, as plain values."""
    names = draw(st.lists(SLUGS, min_size=1, max_size=3, unique=True))
    period = draw(st.sampled_from([0.001, 0.002, 0.006]))
    belief = st.fixed_dictionaries({}, optional={"structure": st.sampled_from(["exact", "printed"])})
    config: dict[str, Any] = {
        "name": draw(SLUGS),
        "plant": {"engine": draw(st.sampled_from(["mujoco", "analytic"])), "model": "puma560"},
        "model": draw(belief),
        "controllers": [{"name": name, **draw(SMC)} for name in names],
        "reference": draw(REFERENCE),
        "run": {
            "duration": 6 * draw(st.integers(1, 3)),
            "control_period": period,
            "seed": draw(st.integers(0, 2**63 - 1)),
            "initial_q": draw(st.just("home") | vectors(-3, 3)),
        },
    }
    if draw(st.booleans()):
        config["description"] = draw(TEXT)
    noises = draw(st.lists(NOISE, max_size=2))
    config["disturbances"] = [{"hold": 0.6, **noise} for noise in noises]
    return config


@settings(max_examples=60, derandomize=True, deadline=None, database=None)
@given(config=configs())
def test_any_valid_config_round_trips(config: dict[str, Any]) -> None:
    """Any valid config, written as JSON (which is YAML), survives loading, dumping and loading again."""
    x = parse(json.dumps(config, ensure_ascii=False))
    again = parse(dump_experiment(x))
    assert again == x
    assert config_hash(again) == config_hash(x)
    assert x.description == config.get("description")
    assert x.run.seed == config["run"]["seed"]


def shipped_laws() -> list[str]:
    """Names of the laws of this package, without those that other tests register."""
    return [name for name in law_names() if find_law(name).function.__module__.startswith("torquebench.")]


def test_committed_schema_is_current() -> None:
    """configs/schema.json is what the code says; if not, run scripts/config_schema.py."""
    stored = json.loads((data_root() / "configs" / "schema.json").read_text())
    assert stored == json.loads(json.dumps(experiment_json_schema(shipped_laws())))


def properties(node: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every key that a JSON schema describes."""
    if isinstance(node, list):
        for item in node:
            yield from properties(item)
    elif isinstance(node, dict):
        yield from node.get("properties", {}).items()
        for value in node.values():
            yield from properties(value)


def test_schema_describes_every_key_with_its_unit() -> None:
    """Every key has a description, every numeric key a unit in it; laws' gains and options are all there."""
    found = list(properties(experiment_json_schema(shipped_laws())))
    keys = {key for key, _ in found}
    for law in map(find_law, shipped_laws()):
        assert {*law.gains, *law.options} <= keys
    for key, described in found:
        assert described.get("description"), key
        kinds = [described, *described.get("oneOf", [])]
        if any(kind.get("type") in ("number", "integer") for kind in kinds):
            assert "]" in described["description"], key


def test_schema_and_loader_know_the_same_keys() -> None:
    """The keys of the fully written examples are those of the JSON schema, none more and none less."""
    schema = experiment_json_schema(["smc", "linear-band-smc"])
    described = {key for key, _ in properties(schema)}
    written = {
        line.strip().removeprefix("- ").partition(":")[0]
        for name in ("good", "step", "ramp", "analytic")
        for line in ALL[name].splitlines()
    }
    assert written == described


TWO_LINKS = """\
<mujoco>
  <worldbody>
    <body name="a"><joint name="a" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="a" ctrlrange="-9 9" ctrllimited="true"/>
    <motor joint="b" ctrlrange="-9 9" ctrllimited="true"/>
  </actuator>
</mujoco>
"""


def test_other_arms_have_their_own_number_of_joints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Vector lengths follow the arm that is named, and closed forms are refused for any but the PUMA."""
    pytest.importorskip("mujoco")
    folder = tmp_path / "models" / "two-links"
    folder.mkdir(parents=True)
    (folder / "two-links.xml").write_text(TWO_LINKS)
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    text = MINIMAL.replace("puma560", "two-links")
    assert parse(text, "reference.target=[1, 2]").n == 2
    for override, key, word in [
        ("reference.target=[1, 2, 3]", "reference.target", "wanted one number or 2"),
        ("model.structure=corrected", "model.structure", "wanted exact"),
        ("model.constants=printed", "model.constants", "seven ties"),
        ("plant.structure=printed", "plant.structure", "wanted exact"),
        ("plant.model=puma560", "plant.model", "unknown model"),
    ]:
        with pytest.raises(ConfigError) as caught:
            parse(text, override)
        assert caught.value.problems[0].key == key
        assert word in caught.value.problems[0].message


def test_pydantic_stays_inside_the_experiment_package() -> None:
    """No other package imports pydantic: configs are one layer's business."""
    source = Path(torquebench.__file__).parent
    users = {path.parent.name for path in source.rglob("*.py") if "pydantic" in path.read_text()}
    assert users <= {"experiment"}
