"""Lint finds each seeded defect, says where it is, and has nothing to say about the built-in systems."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from torquebench.errors import Finding, FuzzyError
from torquebench.fuzzy import BUILTIN, Functions, FuzzySystem, Rule, Variable, builtin_system, prepare
from torquebench.fuzzy.lint import gaps, lint
from torquebench.fuzzy.system import rules_of_table

BASE = builtin_system("pd-25")
NAMES = BASE.inputs[0].names


def changed(when: tuple[str, str], then: str | None) -> FuzzySystem:
    """Return the 25 rules with one of them changed, or taken away."""
    rules = [rule if rule.when != when else rule._replace(then=then or "") for rule in BASE.rules]
    return replace(BASE, rules=tuple(rule for rule in rules if rule.then))


def with_terms(first: dict[str, Any], low: float = -1.0, high: float = 1.0) -> FuzzySystem:
    """Return the 25 rules with other terms of input 1."""
    return replace(BASE, inputs=(Variable.of(first, low, high), BASE.inputs[1]))


EVEN = {"NB": -1.0, "NS": -0.5, "Z": 0.0, "PS": 0.5, "PB": 1.0}


def found(system: FuzzySystem) -> dict[str, list[Finding]]:
    """Return what lint finds, by code."""
    by_code: dict[str, list[Finding]] = {}
    for finding in lint(prepare(system)):
        assert finding.severity == "warning"
        by_code.setdefault(finding.code, []).append(finding)
    return by_code


@pytest.mark.parametrize("name", BUILTIN)
@pytest.mark.parametrize("conjunction", ["min", "product"])
@pytest.mark.parametrize("defuzzification", ["coa", "cog"])
def test_nothing_to_say_about_the_built_in_systems(name: str, conjunction: str, defuzzification: str) -> None:
    """They are continuous, complete, consistent, odd and silent at the origin."""
    assert found(replace(builtin_system(name), conjunction=conjunction, defuzzification=defuzzification)) == {}


def test_missing_rule() -> None:
    """Taking a rule away is noticed, with the names of its terms; so is that the base is no longer odd."""
    findings = found(changed(("NS", "PB"), None))
    assert set(findings) == {"missing-rule", "asymmetric"}
    assert "no rule for NS and PB" in findings["missing-rule"][0].message
    assert "rules without their mirror image: PS and NB" in findings["asymmetric"][0].message


def test_missing_rules_in_mirror_images_are_odd() -> None:
    """Two rules missing at mirrored places leave the output odd."""
    system = replace(BASE, rules=tuple(r for r in BASE.rules if r.when not in (("NS", "PB"), ("PS", "NB"))))
    assert {code: len(findings) for code, findings in found(system).items()} == {"missing-rule": 2}


def test_dead_terms_and_rules() -> None:
    """A term outside its range, and every rule with it, never act; neither does an output term that no rule uses."""
    findings = found(with_terms({**EVEN, "PB": (1.0, 1.5, 2.0), "PS": (0.0, 0.5, 1.2)}))
    assert [f.where for f in findings["dead-term"]] == [("inputs", 0, "terms", "PB")]
    assert [f.where for f in findings["dead-rule"]] == [("rules", k) for k in range(20, 25)]
    output = Variable.of({**EVEN, "PVB": 1.5})
    assert [(f.code, f.where) for f in lint(prepare(replace(BASE, output=output)))] == [
        ("dead-term", ("output", "terms", "PVB"))
    ]


def test_duplicate_rule() -> None:
    """The same rule twice is no contradiction, but worth a word, at the second."""
    findings = found(replace(BASE, rules=(*BASE.rules, BASE.rules[3])))
    assert [(f.where, "NB and PS" in f.message) for f in findings["duplicate-rule"]] == [(("rules", 25), True)]
    assert set(findings) == {"duplicate-rule"}


def test_contradictory_rule() -> None:
    """The same condition with two consequents has no meaning: the system cannot be made."""
    with pytest.raises(FuzzyError) as caught:
        replace(BASE, rules=(*BASE.rules, Rule(("NB", "PS"), "PB")))
    (finding,) = caught.value.findings
    assert (finding.code, finding.severity, finding.where) == ("contradiction", "error", ("rules", 25))
    assert "NB and PS then both NS and PB" in finding.message


def test_jump() -> None:
    """Neighbouring rules whose consequents do not overlap are not continuous: Z-Z has NS beside it on two sides."""
    findings = found(changed(("Z", "Z"), "PB"))
    assert set(findings) == {"jump", "origin"}
    index = {rule.when: k for k, rule in enumerate(BASE.rules)}
    assert {(f.where, f.message.split(" beside")[0]) for f in findings["jump"]} == {
        (("rules", index["NS", "Z"]), "jumps from NS to PB"),
        (("rules", index["Z", "NS"]), "jumps from NS to PB"),
    }


def test_consequents_one_apart_do_not_jump() -> None:
    """A table that climbs by one term from rule to rule is continuous; climbing by two is not."""
    variable = Variable.of(EVEN)
    slow = FuzzySystem("slow", (variable,), variable, rules_of_table([NAMES], [NAMES]))
    fast = replace(slow, rules=rules_of_table([NAMES], [["NB", "NB", "Z", "PB", "PB"]]))
    assert found(slow) == {}
    assert [f.where for f in found(fast)["jump"]] == [("rules", 1), ("rules", 2)]


def test_gap() -> None:
    """A stretch of the range that no term covers is found, in the input's own units."""
    low, high = -2.0, 2.0
    holes = {
        "NB": (-3.0, -2.0, -1.0),
        "NS": (-1.5, -0.9, -0.6),
        "Z": (-0.4, 0.0, 0.4),
        "PS": (0.4, 1.0, 1.6),
        "PB": (1.0, 1.5, 1.9),
    }
    system = with_terms(holes, low, high)
    assert gaps(system.inputs[0]) == [(-0.6, -0.4), (1.9, 2.0)]
    messages = [f.message for f in found(system)["gap"]]
    assert [m.split(";")[0] for m in messages] == ["no term covers -0.6 to -0.4", "no term covers 1.9 to 2"]
    assert gaps(Variable.of(EVEN, low, high)) == [(-2.0, -1.5), (1.5, 2.0)]
    assert gaps(Variable.of({"all": (-9.0, 0.0, 9.0)}, low, high)) == []


def test_asymmetry_and_the_origin() -> None:
    """A lopsided term makes the output uneven; a consequent shifted to one side makes it push at rest."""
    lopsided = found(with_terms({**EVEN, "PS": (0.0, 0.7, 1.0)}))
    assert set(lopsided) == {"asymmetric"}
    shifted = replace(BASE, output=Variable.of({name: peak + 0.1 for name, peak in EVEN.items()}))
    assert found(shifted)["origin"][0].message.startswith("the output at the origin is 0.1,")
    functions = Functions.of({name: peak for name, peak in EVEN.items()})
    assert found(replace(BASE, output=functions)) == {}
    functions = Functions.of(
        {name: (peak, 0.0, 0.0) if name != "Z" else (0.2, 0.0, 0.0) for name, peak in EVEN.items()}
    )
    assert "origin" in found(replace(BASE, output=functions))


def test_weak_output() -> None:
    """Aggregations by which idle rules push too leave little of the range; a wide range does the same."""
    assert "max-bounded-sum" in found(replace(BASE, aggregation="max-bounded-sum"))["weak"][0].message
    assert set(found(replace(BASE, output=Variable.of(EVEN, -4.0, 4.0)))) == {"weak"}


def test_thin_term() -> None:
    """A consequent of a few points of the output's universe is found, where the output is computed on points."""
    output = Variable.of({**EVEN, "Z": (-0.005, 0.0, 0.005)})
    assert [f.where for f in found(replace(BASE, output=output))["thin-term"]] == [("output", "terms", "Z")]
    assert "thin-term" not in found(replace(BASE, output=Variable.of({**EVEN, "Z": (-0.05, 0.0, 0.05)})))
