"""`docs/errata.md` is what the equations and the arm give: recomputed and compared."""

import pytest

from torquebench.robot.puma560.symbols import MISPRINTED

from . import closed_loop
from .layout import differences, reflow
from .page import PATH, build
from .prose import FLAGS, WRONG


def test_page_is_current(request: pytest.FixtureRequest) -> None:
    """The stored page has the computed words and formulas, and its numbers to 1 %; --write-errata rewrites it."""
    page = build()
    if request.config.getoption("--write-errata", default=False):
        PATH.write_text(page, encoding="utf-8")
    # 1 %: three digits are printed, so half a unit of the last one is up to 0.5 %
    problems = differences(page, PATH.read_text(encoding="utf-8"))
    assert not problems, "docs/errata.md is not current (pytest --write-errata tests/errata):\n" + "\n".join(problems)


def test_comparison_sees_what_matters() -> None:
    """A changed word, verdict, digit in code, lost line or number off by 2 % is a difference; 0.5 % is not."""
    page = "right 2.37 N m\n\n```text\n(21) 0.4318 C2\n```\n"
    assert not differences(page, page.replace("2.37", "2.38"))
    assert not differences(page, page.replace("right 2.37", "right\n2.37"))
    for changed in ("2.42", "-2.37", "3"):
        assert differences(page, page.replace("2.37", changed))
    assert differences(page, page.replace("0.4318", "0.4312"))
    assert differences(page, page.replace("right", "wrong"))
    assert differences(page, page + "\nmore\n")


def test_wrapping() -> None:
    """Paragraphs are wrapped without changing their words, list items keep their mark, and no line turns into one."""
    words = "* " + "the difference a - b " * 20 + "\n* second"
    lines = reflow(words).split("\n")
    assert " ".join(" ".join(lines).split()) == " ".join(words.split())
    assert [line[:2] for line in lines] == ["* ", *["  "] * (len(lines) - 2), "* "]
    assert not any(line.strip().startswith("- ") for line in lines)
    assert reflow("| a | b |\n| c |") == "| a | b |\n| c |"


def test_every_flag_is_explained() -> None:
    """The page has a line on each equation that the model can take literally."""
    assert set(FLAGS) == set(MISPRINTED)
    assert {int(n) for n in MISPRINTED} <= set(WRONG)


@pytest.mark.parametrize("number", MISPRINTED)
def test_each_slip_alone_moves_the_arm(number: str) -> None:
    """One equation as printed changes the model's torque along the reference, and with it the arm's motion."""
    effect = closed_loop.effect((number,))
    # the smallest, (62), is 4 c51 joint-1 speed squared, some mN m; round-off is below 1e-12 rad
    assert effect.mass + effect.bias > 1e-3
    assert effect.shift > 1e-6


def test_corrections_pay() -> None:
    """With every equation as printed the arm tracks over ten times worse than with the corrected ones."""
    assert closed_loop.effect(MISPRINTED).rms > 10 * closed_loop.effect(()).rms
