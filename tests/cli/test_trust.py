"""``torquebench trust``: what gave way is counted and told, and a small size of the quick rows holds."""

from __future__ import annotations

import random

import pytest

from torquebench.shipped import from_checkout

trust = from_checkout("tests/trust")
QUICK = {"configs": 12, "typos": 10, "slow-files": 4, "arms": 8, "closed-forms": 40, "engines": 40, "trajectories": 1}
"""Row -> tries here; ``.ci/run`` runs the size ``tiny`` of others, and the rest waits for ``torquebench trust``."""


@pytest.fixture
def made_up(monkeypatch):
    """Rows of which every third try is wrong, that raise, and that cannot be run here."""
    monkeypatch.setattr("trust.rows.ROWS", {})
    declare = trust.rows.row

    @declare("thirds", "Nothing gives way.", ci=9, release=90)
    def thirds(shop, tries):
        """Every third.

        And more.
        """
        yield from ("" if k % 3 else f"number {k}" for k in range(tries))

    @declare("raises", "Nothing raises.", ci=2, release=2)
    def raises(shop, tries):
        """By raising."""
        yield ""
        raise ValueError("no more")

    @declare("absent", "Nothing is missing.", ci=2, release=2)
    def absent(shop, tries):
        """Not at all."""
        raise trust.rows.Unavailable("no such program")
        yield ""

    monkeypatch.setattr(trust, "ROWS", trust.rows.ROWS)


def test_what_gives_way_is_counted_and_told(made_up, command, tmp_path):
    """Status 1, first findings in words, tries and wrong ones counted; one that raises or tries nothing is no proof."""
    page = tmp_path / "trust.md"
    status, out, _ = command("trust", "--page", str(page))
    assert status == 1
    assert "thirds: number 0" in out
    assert "raises: the attack ended: ValueError: no more" in out
    text = page.read_text()
    assert "| `thirds` | Nothing gives way. | Every third | 9 | 3 |" in text
    assert "| `raises` | Nothing raises. | By raising | 2 | 1 |" in text
    assert "| `absent` | Nothing is missing. | Not at all | no such program | - |" in text
    assert command("trust", "--only", "absent")[0] == 0


def test_a_row_that_is_unknown(command):
    """Status 2 and the nearest."""
    status, _, err = command("trust", "--only", "config")
    assert (status, "did you mean 'configs'" in err) == (2, True)


@pytest.mark.parametrize("name", QUICK)
def test_a_small_size_holds(name, tmp_path):
    """No try of a row is wrong, with other random choices than the page's."""
    shop = trust.Workshop(tmp_path)
    shop.random = random.Random(7)
    done = trust.attack(trust.ROWS[name], shop, QUICK[name], lambda k: None)
    assert done.findings == []
    assert (done.tried, done.wrong, done.left_out) == (QUICK[name], 0, "")


def test_a_mutant_differs_in_one_operator_and_is_still_python():
    """The text is another and compiles; every line but one is as it was."""
    text = "def f(x, y):\n    z = x + 2.0 * y\n    return -z if z < 1.0 else z\n"
    seen = {trust.numbers.mutated(random.Random(seed), text)[0] for seed in range(40)}
    assert len(seen) == 4
    for mutant in seen:
        compile(mutant, "mutant", "exec")
        assert sum(a != b for a, b in zip(text.split("\n"), mutant.split("\n"), strict=True)) == 1
