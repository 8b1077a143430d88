"""A dumped experiment loads to an equal one, and its hash follows its meaning."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.experiment.examples import ALL, DESCRIPTION, GOOD, MINIMAL, STEP, edited, parse
from torquebench.experiment import config_hash, dump_experiment
from torquebench.experiment.yaml_tree import FORBIDDEN


@pytest.mark.parametrize("name", ALL)
def test_examples_round_trip(name: str) -> None:
    """Dumped and loaded again, each example is equal, and dumping once more changes nothing."""
    x = parse(ALL[name])
    text = dump_experiment(x)
    assert parse(text) == x
    assert dump_experiment(parse(text)) == text
    assert config_hash(parse(text)) == config_hash(x)


@pytest.mark.parametrize(
    "text", ["1e-3", "7", "1e5", "0.5", "true", "null", "no", "010", "1:30", "-", "a: b", "#", " x "]
)
def test_text_that_looks_like_something_else_round_trips(text: str) -> None:
    """Quoted text that would be a number, a boolean or a comment without its quotes stays text."""
    x = parse(edited(DESCRIPTION, f"description: '{text}'"))
    assert parse(dump_experiment(x)).description == x.description == text


@pytest.mark.parametrize("name", ["1e-3", "7", "1e5", "true", "null"])
def test_names_that_look_like_something_else_round_trip(name: str) -> None:
    """So do names, which may consist of digits."""
    x = parse(edited("name: good", f"name: '{name}'"))
    assert parse(dump_experiment(x)).name == x.name == name


def test_dump_states_every_default() -> None:
    """The dump of a minimal config states every default, so that it outlives a change of defaults."""
    text = dump_experiment(parse(MINIMAL))
    for key in (
        "timestep: 0.001",
        "integrator: rk4",
        "structure: exact",
        "constants: fitted",
        "chain: ideal",
        "disturbances: []",
        "control_period: 0.001",
        "initial_q: home",
        "seed: 0",
        "metrics_from: 2.0",
        "draw: 0",
        "expect: completed",
    ):
        assert key in text


def test_hash_changes_with_meaning_only() -> None:
    """Comments, order of keys, 4 for 4.0 and a stated default leave the hash alone; any value changes it."""
    same = edited("duration: 4", "duration: 4.0  # seconds").replace("  integrator: rk4\n", "")
    same = edited("      lam: 10\n      k: 0.3\n", "      k: 0.3\n      lam: 10\n", same)
    assert config_hash(parse(same)) == config_hash(parse(GOOD))
    assert config_hash(parse(GOOD, "run.seed=8")) != config_hash(parse(GOOD))
    assert config_hash(parse(GOOD, "controllers[0].gains.k=0.31")) != config_hash(parse(GOOD))


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
            "rise_time": st.floats(0.1, 6),
        }
    ),
)
SMC = st.one_of(
    st.fixed_dictionaries(
        {"law": st.just("smc"), "gains": st.fixed_dictionaries({"lam": POSITIVE, "k": POSITIVE})},
        optional={
            "equivalent_control": st.sampled_from([True, False, "measured-acceleration"]),
            "expect": st.sampled_from(["completed", "failed"]),
        },
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
