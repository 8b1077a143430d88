"""Fuzzy systems in configs: what the keys mean, that nothing odd gets through, and which system reaches the law."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.experiment.examples import FUZZY, MINIMAL, edited, parse
from tests.experiment.test_bad_configs import VALUES, problems_of, typos
from torquebench.experiment import dump_experiment, load_experiment
from torquebench.experiment.build import build, systems_of
from torquebench.experiment.fuzzy_schema import fuzzy_system
from torquebench.fuzzy import Functions, Rule, builtin_system, infer, prepare
from torquebench.fuzzy.fis import STAIRCASE
from torquebench.robot.library import data_root

LAW = "controllers=[{name: a, law: fuzzy-linear-band-smc, gains: {lam: 1, k: 1, phi: 1, kv: 1, kf: 1, gd: 1, ki: 0}}]"


def test_keys_become_the_system_they_describe() -> None:
    """Ranges, shapes, a table with a hole, a list of rules and the operators arrive as written."""
    x = parse(FUZZY)
    three, other = (fuzzy_system(name, x.fuzzy[name]) for name in ("three", "list"))
    assert (three.inputs[0].low, three.inputs[0].high, three.inputs[1].low) == (-2.0, 2.0, -1.0)
    assert [term.corners for term in three.inputs[0].terms] == [(-4, -2, -2, 0), (-2, 0, 0, 2), (0, 2, 2, 4)]
    assert three.inputs[1].terms[1].corners == (-0.5, -0.1, 0.1, 0.5)
    assert three.table.tolist() == [[0, 0, 1], [0, 1, -1], [1, 2, 2]]
    assert (three.conjunction, three.aggregation, three.defuzzification) == ("product", "max-bounded-product", "cog")
    assert other.rules == (Rule(("low",), "down"), Rule(("high",), "up"))
    assert isinstance(other.output, Functions)
    assert other.output.coefficients == (("down", (0.0, -0.5)), ("up", (1.0,)))


def test_rows_belong_to_input_1_and_columns_to_input_2() -> None:
    """In a table of three rows and two columns each consequent lands at its own pair of terms."""
    text = edited("terms: {N: [-1, -1, 0], Z: [-0.5, -0.1, 0.1, 0.5], P: [0, 1, 1]}", "terms: {A: -1, B: 1}", FUZZY)
    for row in ("[N, N, Z]", "[N, Z, none]", "[Z, P, P]"):
        text = edited(row, f"{row[:-1].rpartition(',')[0]}]", text)
    rules = fuzzy_system("three", parse(text).fuzzy["three"]).rules
    assert [(*rule.when, rule.then) for rule in rules] == [
        ("N", "A", "N"),
        ("N", "B", "N"),
        ("Z", "A", "N"),
        ("Z", "B", "Z"),
        ("P", "A", "Z"),
        ("P", "B", "P"),
    ]


def test_the_paper_s_five_terms_are_the_built_in_ones_in_other_units() -> None:
    """configs/fuzzy.yaml defines on [-2, 2] what pd-25 is on [-1, 1]; both are evaluated exactly."""
    experiment = load_experiment(data_root() / "configs" / "fuzzy.yaml")
    own, known = prepare(systems_of(experiment)["fig7"]), prepare(builtin_system("pd-25"))
    assert own.fis.method == known.fis.method == STAIRCASE
    x, y = np.random.default_rng(0).uniform(-1.1, 1.1, (2, 1000))
    assert own.outputs(x, y) == pytest.approx(known.outputs(x, y), abs=1e-12)
    assert set(systems_of(experiment)) == {"fig7", "pd-49"}


@pytest.mark.parametrize("name", ["pd-49", "pd-25", "pd-9"])
def test_the_chosen_system_reaches_the_law(name: str) -> None:
    """The gains that the law gets hold the system that its controller names; the first built-in one is the default."""
    chosen = build(parse(MINIMAL, LAW, f"controllers[0].fuzzy={name}")).controllers[0].gains.fis
    assert infer(chosen, 0.4, 0.3) == infer(prepare(builtin_system(name)).fis, 0.4, 0.3)
    default = parse(MINIMAL, LAW)
    assert default.controllers[0].fuzzy == "pd-49"
    assert "fuzzy: pd-49" in dump_experiment(default)
    assert default.fuzzy == {}
    assert "\nfuzzy:" not in dump_experiment(default)


def test_a_system_of_the_file_reaches_the_law() -> None:
    """So does one that the file defines, and another controller without a fuzzy system is left alone."""
    loop = build(parse(FUZZY))
    wanted = prepare(fuzzy_system("three", parse(FUZZY).fuzzy["three"])).fis
    assert infer(loop.controllers[1].gains.fis, 0.4, 0.3) == infer(wanted, 0.4, 0.3)
    assert not hasattr(loop.controllers[0].gains, "fis")


def test_overrides_reach_into_systems() -> None:
    """``--set`` changes an operator, a term, a rule, and which system a controller uses."""
    x = parse(
        FUZZY,
        "fuzzy.three.aggregation=min-max",
        "fuzzy.three.inputs[0].terms.P=1.5",
        "fuzzy.three.rules[1][2]=P",
        "controllers.fuzzy-band.fuzzy=pd-9",
    )
    system = fuzzy_system("three", x.fuzzy["three"])
    assert (system.aggregation, system.inputs[0].terms[2].b, system.table[1, 2]) == ("min-max", 1.5, 2)
    assert x.controllers[1].fuzzy == "pd-9"


KEYS = [
    "kind",
    "inputs",
    "range",
    "terms",
    "output",
    "rules",
    "conjunction",
    "aggregation",
    "defuzzification",
    "functions",
    "if",
    "then",
]


@pytest.mark.parametrize("key", KEYS)
def test_any_one_letter_typo_in_a_key_suggests_the_key(key: str) -> None:
    """As everywhere in a config: one message, which names the key that was meant."""
    lines = FUZZY.splitlines()
    start = lines.index("fuzzy:")
    index = next(
        i for i, line in enumerate(lines) if i > start and line.strip().removeprefix("- ").startswith(f"{key}:")
    )
    for typo in sorted(set(typos(key)) - {key, ""}):
        changed = lines.copy()
        changed[index] = changed[index].replace(f"{key}:", f"{typo}:", 1)
        problems = problems_of("\n".join(changed))
        assert len(problems) == 1, (typo, problems)
        assert problems[0].where.startswith(f"bad.yaml:{index + 1}:")
        assert problems[0].message.endswith(f"(did you mean '{key}'?)"), (typo, problems)


def test_mistakes_in_several_systems_come_out_together() -> None:
    """Each system is checked whatever is wrong with another, and its name stays known to controllers."""
    text = FUZZY
    for old, new in [("[N, N, Z]", "[N, N, Y]"), ("if: low", "if: lo"), ("range: [-3, 3]", "range: [3, 3]")]:
        text = edited(old, new, text)
    keys = [problem.key for problem in problems_of(text)]
    assert keys == ["fuzzy.three.output.range", "fuzzy.list.rules[0]"]
    text = edited("range: [3, 3]", "range: [-3, 3]", text)
    assert [p.key for p in problems_of(text)] == ["fuzzy.three.rules[0][2]", "fuzzy.list.rules[0]"]


def test_too_many_systems_are_refused() -> None:
    """Sixty-four are accepted, sixty-five are not."""
    one = "{kind: sugeno, inputs: [{terms: {a: -1, b: 1}}], output: {functions: {c: 1}}, rules: [c, c]}"
    for count in (64, 65):
        systems = ", ".join(f"s{k}: {one}" for k in range(count))
        messages = [p.message for p in problems_of(MINIMAL, f"fuzzy={{{systems}}}")]
        assert messages == ["got 65 fuzzy systems, wanted at most 64"] * (count > 64)


WITHIN = [line for line in FUZZY.partition("\nfuzzy:\n")[2].partition("\nreference:")[0].splitlines() if ":" in line]


@settings(max_examples=150, derandomize=True, deadline=None, database=None)
@given(line=st.sampled_from(WITHIN), value=VALUES)
def test_any_value_for_any_key_raises_nothing_but_config_error(line: str, value: object) -> None:
    """Each key in turn takes an arbitrary value; the loader accepts it or says what is wrong."""
    key, colon, _ = line.partition(":")
    written = str(value).replace("None", "~").replace("True", "true").replace("False", "false")
    for problem in problems_of(FUZZY.replace(line + "\n", f"{key}{colon} {written}\n", 1)):
        assert str(problem).isprintable()


NUMBERS = st.floats(-1e6, 1e6)


@settings(max_examples=100, derandomize=True, deadline=None, database=None)
@given(shape=st.lists(NUMBERS, max_size=5), low=NUMBERS, high=NUMBERS, word=st.sampled_from(["N", "none", "if", "~"]))
def test_any_numbers_for_shapes_and_ranges(shape: list[float], low: float, high: float, word: str) -> None:
    """Shapes, ranges and rules with arbitrary numbers are accepted, and then can be built, or refused with a reason."""
    edits = (
        f"fuzzy.three.inputs[0].terms.Z={shape}",
        f"fuzzy.three.inputs[1].range=[{low}, {high}]",
        f"fuzzy.three.rules[0][0]={word}",
    )
    if not problems_of(FUZZY, *edits):
        x = parse(FUZZY, *edits)
        fuzzy_system("three", x.fuzzy["three"])
        assert parse(dump_experiment(x)) == x


def test_a_law_that_leaves_its_rules_out_uses_no_system() -> None:
    """Without `fuzzy` in the text none is chosen, so that no figure shows rules that the law never asks."""
    text = edited("    fuzzy: three\n", "", FUZZY)
    for choice, gains in (("clipped-sum", True), ("off", False)):
        changed = edited("compensation: fuzzy", f"compensation: {choice}", text)
        if not gains:
            changed = edited("      kf: 0.3\n      gd: 1.0\n", "", changed)
        x = parse(changed)
        assert x.controllers[1].fuzzy is None
        assert set(systems_of(x)) == {"three", "list"}
        assert "fuzzy: pd-49" not in dump_experiment(x)
        assert parse(dump_experiment(x)) == x
        build(x)
    assert parse(text).controllers[1].fuzzy == "pd-49"


def test_configs_that_ship_say_what_they_mean() -> None:
    """The config with fuzzy laws loads, and its dump reads back to the same bytes."""
    text = dump_experiment(load_experiment(Path(data_root()) / "configs" / "fuzzy.yaml"))
    assert dump_experiment(parse(text)) == text
