"""What is wrong in a sweep is told before anything runs: the place, what was wanted, and the value that causes it."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from tests.sweep.examples import BASE, SMALL, plan_of
from torquebench.errors import ConfigError, Problem
from torquebench.sweep.checking import check_plan


class Bad(NamedTuple):
    """A section with one mistake, and what the user must be told of it."""

    section: str
    """What stands below ``sweep:``, in flow style."""
    key: str
    word: str
    """What the message must contain."""
    at: str = ""
    """The text in the section at which the message must point; empty for any."""


MASS = "plant.payload.mass"
GRID, RANDOM = f"sweep.grid.'{MASS}'", f"sweep.random.'{MASS}'"
BAD = [
    Bad("{draws: 0}", "sweep.draws", "at least 1", "0}"),
    Bad("{draws: 1.5}", "sweep.draws", "whole number", "1.5"),
    Bad("{drawn: 3}", "sweep.drawn", "did you mean 'draws'?", "drawn"),
    Bad("[1, 2]", "sweep", "a list of 2", "[1, 2]"),
    Bad(f"{{grid: {{{MASS}: 3}}}}", GRID, "got 3, wanted a list of values", "3"),
    Bad(f"{{grid: {{{MASS}: []}}}}", GRID, "an empty list", "[]"),
    Bad(f"{{grid: {{{MASS}: }}}}", GRID, "nothing is given"),
    Bad(f"{{grid: {{{MASS}: [1, 2, 1]}}}}", f"{GRID}[2]", "there already"),
    Bad(f"{{grid: {{{MASS}: {{from: 1, to: 2}}}}}}", f"{GRID}.count", "missing"),
    Bad(f"{{grid: {{{MASS}: {{from: 1, to: 2, count: 1}}}}}}", f"{GRID}.count", "at least 2"),
    Bad(f"{{grid: {{{MASS}: {{from: 1, to: 1, count: 3}}}}}}", f"{GRID}.to", "another end"),
    Bad(f"{{grid: {{{MASS}: {{from: 0, to: 1, count: 3, spacing: log}}}}}}", GRID, "both positive"),
    Bad(f"{{grid: {{{MASS}: {{from: 1, to: 2, count: 3, spacing: cubic}}}}}}", f"{GRID}.spacing", "linear"),
    Bad("{grid: {'a b': [1]}}", "sweep.grid.'a b'", "is not a key", "'a b'"),
    Bad("{grid: {run.draw: [1, 2]}}", "sweep.grid.'run.draw'", "draws"),
    Bad("{grid: {controllers.*: [1]}}", "sweep.grid.'controllers.*'", "is not a key"),
    Bad("{grid: {controllers.*.gains.kf: [1]}}", "sweep", "no controller's law has it", "1]"),
    Bad("{grid: {plant.payload.mas: [1]}}", "plant.payload.mas", "did you mean 'mass'?", "1]"),
    Bad("{grid: {plant.payload.mass: [1, -1]}}", "plant.payload.mass", "got -1, wanted at least 0", "-1]"),
    Bad("{grid: {controllers.bond.gains.k: [1]}}", "controllers.bond", "nothing in controllers is named 'bond'", "1]"),
    Bad("{grid: {controllers.*.gains.phi: [0.1, 0]}}", "controllers[0].gains.phi", "more than 0", "0]}}"),
    Bad("{grid: {run.control_period: [0.001, 0.0015]}}", "run.control_period", "whole multiple", "0.0015"),
    Bad("{grid: {controllers.band.name: [x, y]}}", "controllers", "the same in every case", "y]"),
    Bad("{grid: {controllers.sign.switching: [sign, sat]}}", "controllers[1].switching", "in the sweep: ", "sat]"),
    Bad(
        "{grid: {disturbances: [[{kind: bias, channel: torque, value: 1.23456789012345678}, {kind: bias, channel: "
        "torque, value: 2}]]}}",
        "sweep.grid.disturbances[0]",
        "needs a name",
    ),
    Bad("{random: {plant.payload.mass: [1, 2]}}", RANDOM, "a mapping with one of uniform"),
    Bad("{random: {plant.payload.mass: {}}}", RANDOM, "missing: one of uniform"),
    Bad("{random: {plant.payload.mass: {unifrom: [1, 2]}}}", f"{RANDOM}.unifrom", "did you mean 'uniform'?"),
    Bad("{random: {plant.payload.mass: {uniform: [2, 1]}}}", f"{RANDOM}.uniform", "the smaller number first"),
    Bad("{random: {plant.payload.mass: {uniform: [1, 2, 3]}}}", f"{RANDOM}.uniform", ""),
    Bad("{random: {plant.payload.mass: {log_uniform: [0, 1]}}}", f"{RANDOM}.log_uniform", "more than 0"),
    Bad("{random: {plant.payload.mass: {normal: {mean: 1}}}}", f"{RANDOM}.normal.std", "missing"),
    Bad("{random: {plant.payload.mass: {choice: 1}}}", f"{RANDOM}.choice", "a list of values"),
    Bad(
        "{random: {plant.payload.mass: {choice: [1], uniform: [1, 2]}}}",
        f"{RANDOM}.choice",
        "wanted one of the two",
    ),
    Bad("{random: {plant.payload.mass: {uniform: [-1, 2]}}}", MASS, "got -1.0, wanted at least 0", MASS),
    Bad("{draws: 20, random: {plant.payload.mass: {normal: {mean: 0, std: 1}}}}", "plant.payload.mass", "at least 0"),
    Bad("{random: {chain: {choice: [ideal, fst]}}, draws: 30}", "chain", "did you mean 'fast'?", "fst"),
    Bad("{random: {run.seed: {uniform: [1, 2]}}}", "run.seed", "whole number"),
    Bad("{random: {run.duration: {uniform: [1.6, 2]}}, draws: 4}", "run.duration", "whole multiple"),
    Bad(
        "{grid: {plant.payload.mass: [0, 1]}, random: {plant.payload: {choice: [{mass: 3}, {mass: 4}]}}}",
        "sweep",
        "plant.payload.mass: plant.payload of the sweep sets it too",
        "plant.payload.mass",
    ),
    Bad(
        "{grid: {controllers.band.gains.lam: [20, 30], controllers.*.gains.lam: [5, 10]}}",
        "sweep",
        "controllers.band.gains.lam: controllers.*.gains.lam of the sweep sets it too",
        "controllers.band",
    ),
    Bad("{grid: {plant.payload: [{mass: 3}], plant.payload.mass: [0, 1]}}", "sweep", "plant.payload: plant"),
    Bad("{grid: {run: {x: {duration: 0.05, draw: 5}}}}", "sweep.run", "draws", "{duration"),
    Bad("{grid: {plant.payload.mass: {start: 0, stop: 2, num: 5}}}", GRID, "looks like a range", "{start"),
    Bad("{grid: {name: [a, b]}}", "sweep.grid.name", "cannot be varied"),
    Bad("{random: {plant.payload.mass: {uniform: [0.4]}}}", f"{RANDOM}.uniform", "wanted two numbers", "[0.4]"),
    Bad("{keep: some}", "sweep.keep", "wanted one of none, all, or a mapping", "some"),
    Bad("{keep: {worst: 0}}", "sweep.keep.worst", "at least 1", "0}"),
    Bad("{keep: {worst: 3, by: rsme}}", "sweep.keep.by", "did you mean 'rmse'?", "rsme"),
    Bad("{grid: {chain: [ideal]}, random: {chain: {choice: [fast]}}}", "sweep.random.chain", "one of the two"),
]


def problems_of(text: str) -> tuple[Problem, ...]:
    """Return the mistakes that are found in a sweep; none when it is accepted."""
    try:
        check_plan(plan_of(text))
    except ConfigError as error:
        return error.problems
    return ()


@pytest.mark.parametrize("bad", BAD, ids=lambda bad: bad.section[:60])
def test_one_mistake_gives_one_message(bad: Bad) -> None:
    """Each section is refused with one message, at the line and column of what is wrong, saying what was wanted."""
    text = BASE + f"sweep: {bad.section}\n"
    problems = problems_of(text)
    assert len(problems) == 1, problems
    assert problems[0].key == bad.key
    assert bad.word in problems[0].message
    line, column = (int(number) for number in problems[0].where.split(":")[1:])
    assert line == len(text.splitlines())
    if bad.at:
        assert text.splitlines()[-1][column - 1 :].startswith(bad.at)


def test_every_mistake_of_every_case_is_told_at_once() -> None:
    """Mistakes of the file itself once, those of values once for each value, in reading order, none twice."""
    text = BASE.replace("lam: 10, k: 0.3, phi", "lam: 10, k: -0.3, phi").replace(
        "0.0001", "0.0001, measurement_delay: 0.0015"
    )
    text += "sweep: {draws: 4, grid: {plant.payload.mass: [-1, 1, -2], controllers.*.gains.phi: [0, 0.1, 0.2]}}\n"
    problems = problems_of(text)
    assert [(p.key, "in the sweep" in p.message) for p in problems] == [
        ("controllers[0].gains.k", False),
        ("chain.measurement_delay", False),
        ("plant.payload.mass", True),
        ("plant.payload.mass", True),
        ("controllers[0].gains.phi", True),
    ]
    assert "plant.payload.mass = -1" in problems[2].message
    assert "plant.payload.mass = -2" in problems[3].message
    assert "controllers.*.gains.phi = 0" in problems[4].message


def test_a_mistake_that_two_values_make_together_names_both() -> None:
    """A delay that is a multiple of one control period but not of the other."""
    text = BASE + "sweep: {grid: {run.control_period: [0.001, 0.002], chain.measurement_delay: [0.002, 0.003]}}\n"
    (problem,) = problems_of(text)
    assert "chain.measurement_delay = 0.003" in problem.message
    assert "run.control_period = 0.002" in problem.message


def test_what_cannot_be_built_is_told_too() -> None:
    """Constants with which no arm is left: found before the first run, with the value."""
    text = BASE.replace("relative: 0.3", "constants: {g1: 1.1}")
    text += "sweep: {grid: {model.mismatch.constants.I1: [0.9, 1.0, -3]}}\n"
    (problem,) = problems_of(text)
    assert problem.key == "model.mismatch"
    assert "eigenvalue" in problem.message
    assert "model.mismatch.constants.I1 = -3" in problem.message


def test_the_example_is_good() -> None:
    """The sweep that the other tests use has no mistakes."""
    assert problems_of(SMALL) == ()
