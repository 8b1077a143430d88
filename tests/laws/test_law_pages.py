"""The pages of docs/laws: as the code and the stored runs have them, whole, small, run by the code that is there."""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Mapping
from typing import Any

import pytest

from torquebench.arena.record import digest_of
from torquebench.laws import find_law
from torquebench.laws.law import LAWS
from torquebench.shipped import data_root

FOLDER = data_root() / "docs" / "laws"
SHIPPED = sorted(name for name, law in LAWS.items() if law.ships)
AGAIN = "run .venv/bin/python scripts/law_pages.py"


@pytest.fixture(scope="module")
def script() -> Mapping[str, Any]:
    """What scripts/law_pages.py defines."""
    return runpy.run_path(str(data_root() / "scripts" / "law_pages.py"))


@pytest.fixture(scope="module")
def data() -> Mapping[str, Any]:
    """The stored runs."""
    found: Mapping[str, Any] = json.loads((FOLDER / "laws.json").read_text(encoding="utf-8"))
    return found


def test_the_pages_are_what_the_code_and_the_stored_runs_say(script: Mapping[str, Any]) -> None:
    """Each page as it would be written now; there is none that would not be."""
    written = script["pages"]()
    for path, text in written.items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: {AGAIN}"
    assert {path.stem for path in FOLDER.glob("*.md")} == set(SHIPPED)


def test_the_runs_are_of_the_laws_as_they_are(data: Mapping[str, Any]) -> None:
    """Every law that ships was run under every condition, by the code that it has; docstrings do not count."""
    assert sorted(data) == SHIPPED
    for name, own in data.items():
        assert own["digest"] == digest_of(find_law(name)), f"{name} has changed: {AGAIN} --run"
    assert len({tuple(own["cells"]) for own in data.values()}) == 1


def test_figures_are_small() -> None:
    """One for each law, under 25 kB, under 800 kB together: a clone stays light."""
    sizes = {path.stem: path.stat().st_size for path in FOLDER.glob("*.svg")}
    assert sorted(sizes) == SHIPPED
    assert max(sizes.values()) < 25_000
    assert sum(sizes.values()) < 800_000


@pytest.mark.parametrize("name", SHIPPED)
def test_a_law_says_its_equation_and_where_it_is_from(name: str) -> None:
    """Its first line has the equation after a colon; a year, an equation of the paper or a product names the source."""
    text = find_law(name).function.__doc__ or ""
    assert "=" in text.partition("\n")[0].partition(": ")[2]
    assert re.search(r"\b(19|20)\d\d\b|\(\d{2,3}\)|the paper|libfranka|PolyScope|Dynamixel", text)


def test_sentences_follow_from_the_table(script: Mapping[str, Any], data: Mapping[str, Any]) -> None:
    """What fails is said to fail, what chatters to chatter, and the best place is that of the least error."""
    names = list(next(iter(data.values()))["cells"])
    fine = {"runs": 1, "outcomes": {"COMPLETED": 1}, "rmse": [1.0], "chattering": [0.2]}
    made = {law: {"cells": {name: dict(fine) for name in names}} for law in ("good", "bad")}
    made["bad"]["cells"][names[1]] = {"runs": 1, "outcomes": {"DIVERGED": 1}, "rmse": [None], "chattering": [None]}
    made["bad"]["cells"][names[2]] = {**fine, "rmse": [4.0], "chattering": [7.0]}
    good, bad = (" ".join(script["where_it_fails"](made, law)) for law in ("good", "bad"))
    chain, burden = names[1].split("/")
    assert f"Fails under {burden} on {chain} (diverged)" in bad
    assert "7 % at most" in bad
    assert f"{names[2].split('/')[1]} on {chain} (x4)" in bad
    assert "Of 2 laws by error: place 1 at best" in bad
    assert "Completes every run" in good
    assert "Chatters by less than" in good
    assert "Is off by less than" in good


@pytest.mark.slow
def test_a_stored_cell_is_run_again(script: Mapping[str, Any], data: Mapping[str, Any]) -> None:
    """PD under two conditions leaves the stored figures, to their four digits."""
    for name, experiment in script["conditions"]():
        if name in ("ideal/nominal", "slow/payload"):
            alone = tuple(one for one in experiment.controllers if one.name == "pd")
            found, _ = script["run_cells"](script["altered"](experiment, controllers=alone))
            assert found["pd"]["rmse"] == pytest.approx(data["pd"]["cells"][name]["rmse"], rel=1e-3)
            assert found["pd"]["chattering"] == pytest.approx(data["pd"]["cells"][name]["chattering"], rel=1e-3)
