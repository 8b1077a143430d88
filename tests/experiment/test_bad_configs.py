"""Whatever is wrong in a config, the user is told where, what, and what was wanted; nothing slips through."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.experiment.bad_configs import BAD, Bad
from tests.experiment.examples import ALL, ANALYTIC, GOOD, QUINTIC, SCENARIO, STEP, edited, line_of
from torquebench.errors import UNCHECKED, ConfigError, Problem
from torquebench.experiment import parse_experiment
from torquebench.experiment.source import MAX_PROBLEMS


def problems_of(text: str | bytes, *overrides: str) -> tuple[Problem, ...]:
    """Return the mistakes found in a config; none when it is accepted."""
    try:
        parse_experiment(text, "bad.yaml", overrides)
    except ConfigError as error:
        return error.problems
    return ()


@pytest.mark.parametrize("bad", BAD, ids=lambda bad: f"{bad.key}<-{bad.new[:24]!r}"[:60])
def test_one_mistake_gives_one_message(bad: Bad) -> None:
    """Each edit is refused with exactly one message, at the right line and key, saying what is wanted."""
    problems = problems_of(bad.config)
    assert len(problems) == 1, problems
    assert problems[0].key == bad.key
    assert problems[0].where.startswith(f"bad.yaml:{bad.line}:")
    assert bad.word in problems[0].message
    assert "\n" not in str(problems[0])


def test_table_is_large_and_has_no_repeats() -> None:
    """The table holds well over eighty different broken configs."""
    assert len({bad.config for bad in BAD}) == len(BAD) >= 150


def typos(word: str) -> Iterator[str]:
    """Yield every misspelling of `word` by one letter: doubled, dropped, replaced, swapped with the next."""
    for i, letter in enumerate(word):
        yield word[:i] + letter + word[i:]
        if len(word) > 1:
            yield word[:i] + word[i + 1 :]
            yield word[:i] + ("x" if letter != "x" else "y") + word[i + 1 :]
        if i + 1 < len(word):
            yield word[:i] + word[i + 1] + letter + word[i + 2 :]


def keys_of(text: str) -> list[tuple[int, str]]:
    """Return (line index, key) of every key of a config written with one key per line."""
    lines = enumerate(text.splitlines())
    return [(i, line.strip().removeprefix("- ").partition(":")[0]) for i, line in lines]


HEIR = """extends: fig9-chattering
run:
  duration: 2.0
controllers:
  - extends: band
    name: other
"""
TYPED = {"good": GOOD, "step": STEP, "quintic": QUINTIC, "analytic": ANALYTIC, "scenario": SCENARIO, "heir": HEIR}


@pytest.mark.parametrize("stride", [pytest.param(7, id="small"), pytest.param(1, id="large", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", TYPED)
def test_any_one_letter_typo_in_any_key_suggests_the_key(name: str, stride: int) -> None:
    """A key misspelt by one letter is the only thing reported, and the message names the right key.

    Left out: a typo that makes another valid key of the same section (``kv`` without its v is ``k``). The small size
    takes every seventh typo, from another one on at each key.
    """
    text = TYPED[name]
    known = {key for _, key in keys_of(text)}
    tried = 0
    for index, key in keys_of(text):
        for typo in sorted(set(typos(key)) - known)[index % stride :: stride]:
            lines = text.splitlines()
            lines[index] = lines[index].replace(f"{key}:", f"{typo}:", 1)
            problems = problems_of("\n".join(lines))
            assert len(problems) == 1 or key == "extends", (typo, problems)  # without its parent much is missing
            problems = [problem for problem in problems if problem.key.endswith(typo)]
            assert problems[0].where.startswith(f"bad.yaml:{index + 1}:")
            assert problems[0].key.endswith(typo)
            assert problems[0].message.endswith(f"(did you mean '{key}'?)"), (typo, problems)
            tried += 1
    assert tried > (80 if name == "heir" else 500) / stride


WORDS = [
    ("mujoco", "plant.engine"),
    ("rk4", "plant.integrator"),
    ("corrected", "model.structure"),
    ("printed", "model.constants"),
    ("puma560", "plant.model"),
    ("linear-band-smc", "controllers[1].law"),
    ("saturation", "controllers[0].switching"),
    ("completed", "controllers[1].expect"),
    ("sine", "reference.kind"),
    ("band-limited-noise", "disturbances[0].kind"),
    ("torque", "disturbances[0].channel"),
    ("home", "run.initial_q"),
]


@pytest.mark.parametrize(("word", "key"), WORDS)
def test_any_one_letter_typo_in_a_named_value_suggests_it(word: str, key: str) -> None:
    """An enumerated value misspelt by one letter is answered with the value that was meant."""
    for typo in sorted(set(typos(word)) - {word}):
        problems = problems_of(edited(f": {word}\n", f": {typo}\n"))
        assert [(p.key, f"(did you mean '{word}'?)" in p.message) for p in problems] == [(key, True)], typo


def test_every_mistake_is_reported_at_once_in_reading_order() -> None:
    """Mistakes in every section, in two controllers and in an override come out together, sorted by place."""
    text = GOOD
    for old, new in [
        ("name: good", "name: Good"),
        ("engine: mujoco", "engine: gazebo"),
        ("  integrator: rk4", "  integrater: rk4"),
        ("relative: 0.3", "relative: 3"),
        ("      lam: 10\n", "      lambda: 10\n"),
        ("law: linear-band-smc", "law: linear-band"),
        ("1.1", "one"),
        ("clip_sigma: 2.5", "clip_sigma: -1"),
        ("seed: 7", "seed: x"),
    ]:
        text = edited(old, new, text)
    problems = problems_of(text, "run.drow=1")
    assert [p.key for p in problems] == [
        "name",
        "plant.engine",
        "plant.integrater",
        "model.mismatch.relative",
        "controllers[0].gains.lambda",
        "controllers[1].law",
        "reference.amplitude[3]",
        "disturbances[0].clip_sigma",
        "run.seed",
        "run.drow",
    ]
    lines = [int(p.where.split(":")[1]) for p in problems[:-1]]
    assert lines == sorted(lines)
    assert problems[-1].where == "--set run.drow=1"


def test_message_has_file_line_column_key_and_suggestion() -> None:
    """The whole line is what an editor can jump to: file, line and column counted from 1, key, reason."""
    text = "\n" * 3 + edited("      lam: 10\n", "      lamda: 10\n")
    assert [str(p) for p in problems_of(text)] == [
        "bad.yaml:22:7: controllers[0].gains.lamda: unknown gain (did you mean 'lam'?)"
    ]


def test_nearest_valid_value_is_accepted() -> None:
    """What a message gives as the nearest multiple is itself accepted."""
    for key, value in [("control_period", 0.00255), ("duration", 3.9991), ("hold", 0.0333)]:
        old = next(line for line in GOOD.splitlines() if line.strip().startswith(f"{key}:"))
        indent = old[: len(old) - len(old.lstrip())]
        problem = problems_of(edited(old, f"{indent}{key}: {value}"))[0]
        nearest = problem.message.rpartition(" ")[2]
        changed = edited(old, f"{indent}{key}: {nearest}")
        assert not [p for p in problems_of(changed) if p.key == problem.key]


def test_longest_run_given_in_the_message_is_accepted() -> None:
    """A run shortened to what the work limit's message allows passes it, and a tenth longer does not."""
    message = problems_of(edited("duration: 4", "duration: 40000"))[-1].message
    allowed = float(message.partition(" GiB are used: lower run.duration to at most ")[2].split()[0])
    assert not problems_of(edited("duration: 4", f"duration: {int(allowed) - 1}"))
    assert "GiB" in problems_of(edited("duration: 4", f"duration: {int(allowed * 1.1)}"))[0].message


def test_too_many_controllers_and_disturbances_are_refused() -> None:
    """Sixty-four of each are accepted, sixty-five are not."""
    for section, key, most in [("controllers", "name: c", 64), ("disturbances", "", 64)]:
        for count in (most, most + 1):
            if section == "controllers":
                items = [f"{{{key}{i}, law: pd, gains: {{lam: 1, kv: 1}}}}" for i in range(count)]
            else:
                items = ["{kind: band-limited-noise, channel: torque, sigma: 1}"] * count
            ears = ["video.ears=[c0, c1]"] if section == "controllers" else []
            problems = problems_of(GOOD, f"{section}=[{', '.join(items)}]", *ears)
            assert [p.key for p in problems] == ([] if count == most else [section])


@pytest.mark.parametrize("value", ["{}", "[]", "5", "text", "~", "[1]", "[~]", "[[]]", "{a: 1}"])
@pytest.mark.parametrize(
    "section", ["plant", "model", "controllers", "reference", "disturbances", "run", "chain", "name"]
)
def test_any_section_may_be_anything(section: str, value: str) -> None:
    """A section of the wrong kind is refused at that section; only those with defaults may be empty."""
    problems = problems_of(GOOD, f"{section}={value}")
    valid = {("model", "{}"), ("chain", "{}"), ("disturbances", "[]"), ("name", "text")}
    assert bool(problems) != ((section, value) in valid)
    assert all(p.key.startswith(section) for p in problems), problems


def test_flood_of_mistakes_is_cut_short() -> None:
    """Thousands of mistakes give the first hundred, and say that there are more."""
    problems = problems_of(GOOD + "".join(f"key{i}: 1\n" for i in range(5000)))
    assert len(problems) == MAX_PROBLEMS + 1
    assert "more mistakes" in problems[-1].message


CUTS = st.integers(0, len(GOOD))


@settings(max_examples=150, derandomize=True, deadline=None, database=None)
@given(
    base=st.sampled_from(sorted(ALL)),
    edits=st.lists(st.tuples(CUTS, st.integers(0, 40), st.one_of(st.binary(max_size=8), CUTS)), min_size=1, max_size=6),
)
def test_mutated_bytes_raise_nothing_but_config_error(base: str, edits: list[tuple[int, int, bytes | int]]) -> None:
    """Bytes cut out, inserted and moved around in a good config are accepted or refused, never a crash."""
    data = ALL[base].encode()
    for start, length, insert in edits:
        piece = insert if isinstance(insert, bytes) else data[insert : insert + 30]
        data = data[:start] + piece + data[start + length :]
    for problem in problems_of(data):
        assert problem.message
        assert str(problem).isprintable()


SCALARS = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=12))
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, derandomize=True, deadline=None, database=None)
@given(line=st.sampled_from(GOOD.splitlines()), value=VALUES)
def test_any_value_for_any_key_raises_nothing_but_config_error(line: str, value: object) -> None:
    """Each key in turn takes an arbitrary value; the loader accepts it or says what is wrong."""
    key, colon, _ = line.partition(":")
    written = str(value).replace("None", "~").replace("True", "true").replace("False", "false")
    for problem in problems_of(GOOD.replace(line + "\n", f"{key}{colon} {written}\n", 1)):
        assert str(problem).isprintable()


def test_duplicate_name_points_at_the_first() -> None:
    """Two controllers of one name: the message at the second says where the first is."""
    problem = problems_of(edited("name: linear-band", "name: conventional"))[0]
    assert f"(bad.yaml:{line_of('- name: conventional', GOOD)}:" in problem.message


SEVERAL = {
    "plant.engine": ("engine: mujoco", "engine: mujoko"),
    "plant.model": ("model: puma560", "model: puma650"),
    "reference.kind": ("kind: sine", "kind: sinus"),
    "reference.amplitude": ("amplitude: [1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "amplitude: 30 kg"),
    "controllers[0].law": ("law: smc", "law: smcc"),
    "controllers[0].gains.lam": ("      lam: 10\n", "      lam: 10 kg\n"),
    "run.metrics_from": ("duration: 4\n", "duration: 4 ms\n"),
}
"""Mistakes of which each once hid others: the key, and the edit that makes it."""


def test_mistakes_do_not_hide_one_another() -> None:
    """Mistakes whose check needs nothing that is wrong are all told at once, and that others may follow."""
    text = GOOD
    for old, new in SEVERAL.values():
        assert old in text, old
        text = text.replace(old, new, 1)
    with pytest.raises(ConfigError) as caught:
        parse_experiment(text, "bad.yaml")
    assert {problem.key for problem in caught.value.problems} == SEVERAL.keys()
    assert str(caught.value).endswith(f"\n{UNCHECKED}")


def test_the_length_of_a_vector_is_told_beside_other_mistakes_of_its_section_and_of_the_plant() -> None:
    """A vector is held against the arm's joints as soon as the arm is known, whatever else is wrong."""
    text = edited("phi: [0.1,", "phi: [0.05, 0.1,", GOOD).replace("lam: 10\n", "lam: x\n", 1)
    text = text.replace("engine: mujoco", "engine: mujoko", 1)
    keys = {problem.key for problem in problems_of(text)}
    assert keys == {"plant.engine", "controllers[0].gains.lam", "controllers[0].gains.phi"}


def test_nothing_more_is_announced_where_all_was_checked() -> None:
    """A mistake on which no other check depends is told alone."""
    with pytest.raises(ConfigError) as caught:
        parse_experiment(edited("metrics_from: 1.25", "metrics_from: 100", GOOD), "bad.yaml")
    assert not caught.value.unchecked


def test_a_missing_section_is_told_with_what_it_must_hold() -> None:
    """Who leaves out `run` reads which of its keys are wanted: the duration alone."""
    (problem,) = problems_of(
        "name: short\nplant: {model: two-link}\ncontrollers: [{name: a, law: pd, gains: auto}]\n"
        "reference: {kind: sine, amplitude: 0.1, frequency_hz: 1.0}\n"
    )
    assert str(problem).startswith("bad.yaml:1:1: run: missing, wanted {duration: ..} (")


def test_what_many_long_mistakes_print_is_bounded():
    """Beyond 20,000 characters the same one is told once, with its count; parts are cut, and the rest is counted."""
    same = [Problem("f", f"a[{k}]", "no number", got="x" * 3000) for k in range(60)]
    other = [Problem("f", "b" * 5000, f"mistake {k}") for k in range(100)]
    error = ConfigError([*same, *other])
    assert len(str(error)) < 25_000
    assert "the same in 59 more places" in error.problems[0].message
    assert "(3,000 characters)" in error.problems[0].message
    told = [problem for problem in error.problems if problem.text.startswith("mistake")]
    assert error.problems[-1].text == f"{100 - len(told)} more mistakes are not shown"
    few = [Problem("f", f"a[{k}]", "no number") for k in range(100)]
    assert ConfigError(few).problems == tuple(few)  # what can be read stays as it is
