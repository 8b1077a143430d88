"""What a refused config's message advises is what was meant, is possible, and never absurd."""

from __future__ import annotations

import re

import pytest

from tests.experiment.examples import GOOD, MINIMAL, QUINTIC, RAMP, STEP, parse
from torquebench.errors import ConfigError, Problem, did_you_mean
from torquebench.robot.puma560.puma import Puma560


def problems_of(text: str, *overrides: str) -> tuple[Problem, ...]:
    """Return the mistakes found; none when the config is accepted."""
    try:
        parse(text, *overrides)
    except ConfigError as error:
        return error.problems
    return ()


NO_DRAW = GOOD.replace("  draw: 3\n", "")


def test_override_suggests_names_that_the_file_already_gives() -> None:
    """``duraton`` beside a given duration: an override meant it, a second key in the file something absent."""
    (by_override,) = problems_of(NO_DRAW, "run.duraton=2")
    assert by_override.message == "unknown key (did you mean 'duration'?)"
    (in_file,) = problems_of(NO_DRAW.replace("  seed: 7\n", "  seed: 7\n  duraw: 2\n"))
    assert in_file.message == "unknown key (did you mean 'draw'?)"
    (whole,) = problems_of(GOOD, "reference={kind: sine, amplitud: 1, frequency_hz: 1}")
    assert whole.message == "unknown key (did you mean 'amplitude'?)"


@pytest.mark.parametrize("word", ["pd", "PD", "Pd", "pD"])
def test_case_does_not_matter_for_a_hint(word: str) -> None:
    """However a name is capitalised, the hint gives the valid spelling."""
    assert did_you_mean(word, ["smc", "pd"]) == " (did you mean 'pd'?)"
    assert did_you_mean(word, ["SMC", "PD"]) == " (did you mean 'PD'?)"


def test_names_that_differ_in_case_only_keep_apart() -> None:
    """Of two names alike but for case, the one written more like the user's is suggested."""
    for names in (["KI", "ki"], ["ki", "KI"]):
        assert did_you_mean("kii", names) == " (did you mean 'ki'?)"
        assert did_you_mean("KII", names) == " (did you mean 'KI'?)"


def test_unknown_kinds_tell_about_plugins() -> None:
    """A law, reference, disturbance or engine that is not there may be the user's own; what is no text cannot be."""
    (problem,) = problems_of(GOOD, "controllers[0].law=my-law")
    assert problem.message.endswith("; a law of your own needs --plugin FILE, the file that registers it")
    (other,) = problems_of(GOOD, "controllers[0].law=[pd]")
    assert "--plugin" not in other.message
    for key, noun in (
        ("plant.engine", "plant"),
        ("reference.kind", "reference"),
        ("disturbances[0].kind", "disturbance"),
    ):
        (own,) = problems_of(GOOD, f"{key}=my-kind")
        assert own.message.endswith(f"; a {noun} of your own needs --plugin FILE, the file that registers it")


@pytest.mark.parametrize(("value", "hint"), [("30", "0.3 for 30 %"), ("5", "0.05 for 5 %"), ("1e300", "0.3 for 30 %")])
def test_percentages_are_answered_with_the_fraction(value: str, hint: str) -> None:
    """A mismatch given in per cent is refused with the fraction that was meant."""
    (problem,) = problems_of(GOOD, f"model.mismatch.relative={value}")
    assert problem.message.endswith(f"wanted less than 1; it is a fraction: {hint}")


def test_exact_with_printed_is_refused_in_the_models_own_words() -> None:
    """The config's reason is the one that the model itself gives."""
    (problem,) = problems_of(MINIMAL, "model.constants=printed")
    reason = problem.text.partition(": ")[2]
    assert reason.startswith("the printed constants break the seven exact ties")
    with pytest.raises(ValueError, match=re.escape(reason)):
        Puma560("exact", "printed")


def test_quintic_must_end_within_the_run() -> None:
    """A minimum-jerk motion may last as long as the run but not longer; a ramp may."""
    assert not problems_of(QUINTIC, "reference.rise_time=4")
    assert [p.key for p in problems_of(QUINTIC, "reference.rise_time=4.002")] == ["reference.rise_time"]
    assert [p.key for p in problems_of(QUINTIC, "run.duration=1.9")] == ["reference.rise_time"]
    assert not problems_of(RAMP, "reference.rise_time=400")


HUGE_OR_TINY = [
    f"{key}={value}"
    for key in (
        "run.duration",
        "run.control_period",
        "plant.timestep",
        "run.metrics_from",
        "disturbances[0].hold",
        "reference.at",
        "reference.rise_time",
        "model.mismatch.relative",
        "run.seed",
    )
    for value in ("1e300", "1.7e308", "1e-300", "9007199254740993")
]


@pytest.mark.parametrize("override", HUGE_OR_TINY)
@pytest.mark.parametrize("other", [(), ("plant.timestep=1e-300",), ("run.duration=1.7e308",)], ids=str)
def test_advice_is_never_infinite_nor_absurd(override: str, other: tuple[str, ...]) -> None:
    """Numbers at the ends of the range give no advice that is infinite, and none that itself is out of range."""
    text = QUINTIC if "rise_time" in override else STEP
    for problem in problems_of(text, *other, override):
        assert not re.search(r"\b(inf|nan)\b", problem.message), problem
        for pattern in (r"at most ([-+.e0-9]+) s\b", r"nearest is ([-+.e0-9]+)", r"longer, ([-+.e0-9]+) s"):
            for number in re.findall(pattern, problem.message):
                assert 1e-6 < float(number) < 1e6, problem


def test_each_cure_for_too_much_work_is_one() -> None:
    """Only changes that help by themselves are proposed: one controller less does not make 1e300 s possible."""
    (problem,) = problems_of(GOOD, "run.duration=6000")  # 1.61 GiB for each of two controllers
    for cure in ("lower run.duration to at most", "raise run.control_period", "or fewer controllers"):
        assert cure in problem.message
    assert not problems_of(GOOD, "run.duration=6000", "run.control_period=0.004", "disturbances=[]")
    assert all("fewer" not in p.message and "raise" not in p.message for p in problems_of(GOOD, "run.duration=1e300"))
    huge = problems_of(GOOD, "run.duration=1e300")
    assert len(huge) == 2
    assert all("lower run.duration to at most" in p.message for p in huge)


def test_a_value_far_shorter_than_its_unit_blames_the_unit() -> None:
    """A physics step of 1e300 s is what must change, not the control period to that."""
    (problem,) = problems_of(GOOD, "plant.timestep=1e300")
    assert problem.message.endswith("plant.timestep must not be longer than that")


def test_hold_longer_than_the_run_lasts_the_run() -> None:
    """A disturbance held beyond the end counts as held to the end: 2000 instants, however long it is."""
    for hold in ("1e300", "8"):
        x = parse(GOOD, f"disturbances[0].hold={hold}")
        assert x.disturbances[0].hold_steps(x.n_steps, x.run.control_period) == x.n_steps == 2000


def test_a_typo_is_answered_with_the_key_beside_it() -> None:
    """``vmodel`` meant model and not video; ``speed`` under run meant seed, though a film has a speed."""
    (section,) = problems_of(GOOD.replace("\nmodel:", "\nvmodel:"))
    assert (section.key, section.nearest) == ("vmodel", "model")
    (key,) = problems_of(GOOD.replace("  seed: 7\n", "  speed: 7\n"))
    assert (key.key, key.nearest) == ("run.speed", "seed")
