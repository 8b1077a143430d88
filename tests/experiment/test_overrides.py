"""``--set key=value`` is the same as editing the file, and a mistake in it points at the option."""

from __future__ import annotations

import pytest

from tests.experiment.examples import AMPLITUDE, DESCRIPTION, GOOD, MINIMAL, edited, parse
from torquebench.errors import ConfigError
from torquebench.experiment import config_hash
from torquebench.experiment.source import read_document
from torquebench.experiment.sweep_section import take_sweep

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
    assert config_hash(parse(GOOD, override)) != config_hash(parse(GOOD))


def test_overrides_apply_in_order_and_make_sections() -> None:
    """The last override of a key wins; a section that the file lacks is made."""
    assert parse(GOOD, "run.seed=1", "run.seed=2").run.seed == 2
    x = parse(MINIMAL, "model.structure=corrected", "model.mismatch.relative=0.2")
    assert x.model.mismatch is not None
    assert x.model.mismatch.relative == 0.2


BAD_OVERRIDES = [
    ("run.duraton=2", "run.duraton", "did you mean 'duration'"),
    ("rum.duration=2", "rum", "did you mean 'run'"),
    ("controllers.linear-band.gains.kvv=2", "controllers[1].gains.kvv", "did you mean 'kv'"),
    ("disturbances.0.hold=1", "disturbances.0", "1 item, counted from 0: write disturbances[0]"),
    ("disturbances.noise.hold=1", "disturbances.noise", "write disturbances[0]"),
    ("reference.amplitude.3=9", "reference.amplitude.3", "write reference.amplitude[3]"),
    ("controllers.1.expect=failed", "controllers.1", "write controllers[1]"),
    ("controllers.5.expect=failed", "controllers.5", "2 items, counted from 0: write controllers[0]"),
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
    ("controllers=band", "controllers", "got the text 'band', wanted a list of those to run, such as ["),
    ("controllers={}", "controllers", "got an empty mapping, wanted a list of those to run, such as ["),
    ("run.duration.x=1", "run.duration.x", "run.duration is not a mapping"),
    ("run[0]=1", "run[0]", "run is not a list"),
    ("run.initial_q[1]=1", "run.initial_q[1]", "run.initial_q is not a list, give it as one"),
    ("run.duration", "", "KEY=VALUE"),
    ("=3", "", "KEY=VALUE"),
    ("", "", "KEY=VALUE"),
    ("run..seed=3", "", "KEY=VALUE"),
    ("run.seed[x]=3", "", "KEY=VALUE"),
    ("reference={kind: step, target: 1}", "reference.at", "missing"),
    ("reference={kind: sine, amplitude: x, frequency_hz: 1}", "reference.amplitude", "wanted a number"),
    ("controllers[0].gains={lam: 1, k: -1, phi: 1}", "controllers[0].gains.k", "more than 0"),
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


@pytest.mark.parametrize("depth", [33, 1_000, 30_000])
def test_a_key_of_too_many_parts_is_refused_at_once(depth: int) -> None:
    """However deep, on the command line, in a grid and in what is drawn: one line; its parts are not walked."""
    key = ".".join(["a"] * depth)
    with pytest.raises(ConfigError) as caught:
        parse(GOOD, f"{key}=1"[:65_536])
    assert len(caught.value.problems) == 1
    for section in ("grid: {? KEY : [1]}", "random: {? KEY : {uniform: [0, 1]}}"):
        document = read_document(GOOD + f"sweep: {{{section}}}\n".replace("KEY", f'"{key}"'), "deep.yaml")
        take_sweep(document)
        assert [problem.text for _, problem in document.found] == ["is not a key"]
    assert not parse(GOOD, "run.seed=1").run.seed - 1


MISTAKES = {
    "disturbances": GOOD.replace("disturbances:\n", "disturbances:\n" + "  - x\n" * 9_000),
    "controllers": GOOD.replace("controllers:\n", "controllers:\n" + "  - {law: pdd, name: a}\n" * 2_000),
    "keys": GOOD + "".join(f"key{i}: 1\n" for i in range(9_000)),
    "long names": GOOD.replace("controllers:\n", "controllers:\n" + f"  - law: {'x' * 1_800}\n" * 500),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_many_mistakes_are_few_lines(name: str) -> None:
    """Thousands of mistakes give a hundred lines at most."""
    with pytest.raises(ConfigError) as caught:
        parse(MISTAKES[name])
    assert 0 < len(caught.value.problems) <= 101
