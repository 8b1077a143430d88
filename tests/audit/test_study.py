"""The section ``audit``: what is read, and every mistake at once with its place."""

import pytest

from tests.audit.studies import STUDY
from torquebench.audit.run import parts_of
from torquebench.audit.study import take_audit
from torquebench.audits import run_audit
from torquebench.cli.app import main
from torquebench.errors import ConfigError
from torquebench.experiment.source import read_document


def study_of(text=STUDY):
    """Read a study."""
    return take_audit(read_document(text, "study.yaml"))


def mistakes(text):
    """Return the mistakes of a study as lines."""
    with pytest.raises(ConfigError) as caught:
        parts_of(study_of(text))
    return [str(problem) for problem in caught.value.problems]


def line_of(text, words):
    """Return the line of a text, from 1, on which some words first stand."""
    return text[: text.index(words)].count("\n") + 1


def test_conditions_are_combinations_of_levels():
    """A claim's cases are every combination of the levels that it names; the first level where it names none."""
    removes, exact, growth, _, knows = study_of().questions
    assert list(removes.conditions) == [
        ("ideal", "nominal"),
        ("ideal", "wrong"),
        ("fast", "nominal"),
        ("fast", "wrong"),
    ]
    assert exact.conditions == {("fast", "nominal"): 2, ("ideal", "nominal"): 3}
    assert knows.conditions == {("ideal", "nominal"): 3}
    assert list(removes.ablated) == [("ideal", "wrong")]
    assert growth.ablations == ()


def test_only_what_some_claim_needs_is_run():
    """Each condition has the controllers that a claim names there, in the file's order, in the most draws asked for."""
    parts = {part.condition: part for part in parts_of(study_of())}
    names = {key: tuple(keys.name for keys in part.experiment.controllers) for key, part in parts.items()}
    assert names["fast", "nominal"] == ("switching", "band", "pd")
    draws = {key: part.plan.draws for key, part in parts.items()}
    assert draws == {
        ("ideal", "nominal"): 1,  # nothing is drawn
        ("ideal", "wrong"): 3,
        ("fast", "nominal"): 3,
        ("fast", "wrong"): 3,
    }
    assert parts["ideal", "wrong"].plan.keys.certificates
    assert not parts["fast", "wrong"].plan.keys.certificates


def test_the_condition_runs_by_itself():
    """The config of a condition is a whole sweep with the condition's keys in it."""
    part = parts_of(study_of())[-1]
    experiment = part.plan.first
    assert experiment.model.mismatch.relative == 0.2
    assert experiment.chain.name == "fast"


BROKEN = [
    ("figure: hf", "figure: hff", "measures[0].figure: no such figure", "did you mean 'hf'"),
    (
        "[band, switching]}\n      unlike",
        "[bend, switching]}\n      unlike",
        "pairs.band[0]: no such controller",
        "'band'",
    ),
    ("chain: all, burden: all", "chian: all, burden: all", "under.chian: no such axis", "'chain'"),
    ("chain: fast, draws: 2", "chain: fst, draws: 2", "under[0].chain: no such level", "'fast'"),
    ("draws: 2}", "draws: 0}", "under[0].draws", "a whole number, 1 to"),
    ("below: 0.5, floor: 0.1", "floor: 0.1", "measures[0].below: one of below and above is needed", ""),
    ("below: 0.01, why", "below: 0.01, above: 0.2, why", "measures[0].below: one of below and above", ""),
    (
        "pairs: {band: [band, switching]}\n      measures: [{figure: rmse, as: ratio",
        "pairs: {band: band}\n      measures: [{figure: rmse, as: ratio",
        "measures[0].as: ratio, but some pairs have one controller",
        "",
    ),
    ("counts: {above: 0}", "counts: {over: 0}", "measures[0].counts", "{above: 0} or {below: 0}"),
    ("as: share, counts: {above: 0}", "as: share", "measures[0].counts: got nothing", "{above: 0} or {below: 0}"),
    ("      quoted: insensitive\n", "", "quoted: one of quoted and implied is needed", ""),
    ("against: {burden: nominal}", "against: {burden: [nominal, wrong]}", "against.burden", "wanted one level"),
    (
        "wrong: {model.mismatch: {relative: 0.2}}",
        "wrong: {controllers: []}",
        "burden.wrong.controllers: cannot be varied",
        "",
    ),
    (
        "wrong: {model.mismatch: {relative: 0.2}}",
        "wrong: {model.mismatch: {relativ: 0.2}}",
        "relativ: unknown key",
        "'relative'",
    ),
    (
        "against: {burden: nominal}",
        "against: {burden: wrong}",
        "growth.measures[0].against: is the case itself",
        "another level",
    ),
    ("ablations: {PD: [pd, band]}", "ablations: {PD: pd}", "ablations.PD", "[controller, the one that is judged]"),
    (
        "      nominal: {}\n",
        "      nominal: {chain: slow}\n",
        "burden.nominal.chain: undoes what axis 'chain' sets (chain)",
        "each key on one axis",
    ),
    ("expect: holds", "expect: hold", "claims.removes.expect", "'holds'"),
    ("says: The laws know the arm.", "says: " + "word " * 26, "claims.knows.says: has 26 words", "at most 25"),
    ("    burden:\n", "    draws:\n", "conditions.draws: is the number of draws", ""),
]


@pytest.mark.parametrize(("old", "new", "place", "wanted"), BROKEN, ids=[place for _, _, place, _ in BROKEN])
def test_a_mistake_has_its_place(old, new, place, wanted):
    """Each mistake is told with the line, the key, what was wanted and the nearest name."""
    assert STUDY.count(old) >= 1
    text = STUDY.replace(old, new, 1)
    found = [line for line in mistakes(text) if place in line]
    assert found, mistakes(text)
    assert wanted in found[0]
    assert found[0].startswith("study.yaml:")


def test_every_mistake_at_once():
    """Two mistakes in two claims are told together, in the order of the file."""
    text = STUDY.replace("figure: hf", "figure: hff", 1).replace("under: {burden: all}", "under: {burden: al}", 1)
    found = mistakes(text)
    assert len(found) == 2
    assert found[0].startswith(f"study.yaml:{line_of(text, 'figure: hff')}:")
    assert found[1].startswith(f"study.yaml:{line_of(text, 'burden: al}')}:")


def test_a_config_without_the_section():
    """It is said what is missing."""
    (found,) = mistakes(STUDY[: STUDY.index("audit:")])
    assert "audit: missing" in found


def test_run_refuses_a_study():
    """A study is for many runs; ``run`` says which command it is for."""
    from torquebench.experiment.config import parse_experiment

    with pytest.raises(ConfigError, match="torquebench audit"):
        parse_experiment(STUDY)


TOOL = """\
name: path
plant: {engine: analytic, model: puma560, timestep: 0.002, integrator: rk4}
controllers: [{law: computed-torque, gains: puma560/l}]
reference:
  kind: tool-circle
  radius: 0.1
  period: 2
  start: [0, -1, 3.3, 0, 0.84, 0]
  approach: 0.2
  origin: [0, -1, 3.3, 0, 0.84, 0]
run: {duration: 0.8, control_period: 0.002, initial_q: [0, -1, 3.3, 0, 0.84, 0]}
audit:
  conditions: {way: {round: {}, line: {reference.radius: 0.05}}}
  claims:
    near:
      says: The tool stays on its path.
      where: here
      implied: here
      pairs: {ct: computed-torque}
      measures: [{figure: tool_max_error, below: 0.01, why: A centimetre}]
      under: {way: all}
"""


def test_a_study_of_tool_paths_judges_errors_of_the_tool(tmp_path):
    """They are figures where the reference is a path of the tool under each condition, and no others."""
    (tmp_path / "path.yaml").write_text(TOOL)
    done = run_audit(tmp_path / "path.yaml", folder=tmp_path / "out", workers=1, figures=False)
    (claim,) = done.claims
    assert str(claim.verdict) == "holds"
    assert all(0.0 < one.interval.value < 0.01 for case in claim.cases for one in case.figures)
    other = TOOL.replace("line: {reference.radius: 0.05}", "line: {reference.kind: sine}")
    with pytest.raises(ConfigError, match="no such figure, got the text 'tool_max_error'"):
        take_audit(read_document(other, "path.yaml"))


def test_show_config_prints_the_whole_study(tmp_path, capsys):
    """What is printed is the study with its changes, and is judged as it; nothing is run."""
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    assert main(["audit", str(path), "--show-config", "--set", "audit.draws=5"]) == 0
    printed = capsys.readouterr().out
    shown, given = take_audit(read_document(printed, "shown.yaml")), take_audit(read_document(STUDY, "study.yaml"))
    assert shown.audit.draws == 5
    assert [part.text for part in parts_of(shown, 3)] == [part.text for part in parts_of(given, 3)]
    assert [path.name for path in tmp_path.iterdir()] == ["study.yaml"]
