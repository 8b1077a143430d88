"""Constants that a figure depends on are found from seed and draw alone, in all cases together, and no others."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sweep.tables import made
from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.experiment.schema import Experiment
from torquebench.robot.puma560.symbols import CONSTANTS
from torquebench.sweep.sensitivity import constant_changes, sensitivities

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DRAWS = 90


def draws_of(override: str, draws: int = DRAWS) -> list[Experiment]:
    """An experiment with noise under some mismatch, in many draws."""
    first = load_experiment(CONFIGS / "paper" / "fig9-noise.yaml", [override])
    runs = [replace(first.run, draw=draw) for draw in range(draws)]
    return [replace(first, run=run) for run in runs]


RELATIVE = draws_of("model.mismatch={relative: 0.3}")
TOLERANCE = draws_of("model.mismatch={tolerance: 1}", 10)
NONE = draws_of("model={structure: corrected, constants: printed}")


def test_a_relative_mismatch_is_its_signs() -> None:
    """Each constant is 30 % up or down; draw k is the same by itself as among others."""
    changes = constant_changes(RELATIVE[:20])
    assert tuple(changes) == CONSTANTS
    assert np.abs(np.array(list(changes.values()))) == pytest.approx(0.3, rel=1e-12)
    alone = constant_changes([RELATIVE[13]])
    assert all(alone[name][0] == changes[name][13] for name in CONSTANTS)


def test_tied_constants_move_together() -> None:
    """Within tolerances a rigid body ties I5 with g2, and I15 with I16: their changes are the same, up to round-off."""
    changes = constant_changes(TOLERANCE)
    assert np.corrcoef(changes["I5"], changes["g2"])[0, 1] == pytest.approx(1.0, abs=1e-9)
    assert np.corrcoef(changes["I15"], changes["I16"])[0, 1] == pytest.approx(1.0, abs=1e-9)
    assert abs(np.corrcoef(changes["I1"], changes["g1"])[0, 1]) < 0.999


def test_a_right_model_has_no_changes() -> None:
    """Without mismatch every constant is its own."""
    assert not np.any(list(constant_changes(NONE[:3]).values()))


def dependent(law: str, draw: int, values: Mapping[str, Any]) -> dict[str, float]:
    """Law a depends on g1 and, less, on I2; law b on nothing that is drawn but noise; larger under a payload."""
    rng = np.random.default_rng((draw, "ab".index(law), int(values["plant.payload.mass"])))
    load = 1.0 + float(values["plant.payload.mass"])
    if law == "b":
        return {"rmse": load * float(rng.lognormal()), "hf": 0.0}
    return {
        "rmse": load * float(np.exp(2.0 * CHANGES["g1"][draw] - CHANGES["I2"][draw] + 0.1 * rng.normal())),
        "hf": 0.0,
    }


CHANGES = constant_changes(RELATIVE)
GRID = {"plant.payload.mass": (0, 2), "model.mismatch": ("none", "30 %", "15 %")}
HALF = draws_of("model.mismatch={relative: 0.15}")


def experiment_of(case: int, draw: int) -> Experiment:
    """Mismatch none, 30 % and 15 %, each without and with a payload."""
    return (NONE, RELATIVE, HALF)[case % 3][draw]


def test_exactly_what_matters_is_found() -> None:
    """g1 and I2 for law a, in this order; nothing for b. Cases of 30 and 15 % have the same signs, and are one."""
    table = made("ab", DRAWS, dependent, GRID)
    a, b = sensitivities(table, experiment_of, ["rmse"])
    assert (a.controller, a.cases, a.draws, a.left_out) == ("a", (1, 2, 4, 5), DRAWS, 0)
    assert a.effects is not None
    assert b.effects is not None
    assert [e.name for e in a.effects.effects if e.matters] == ["g1", "I2"]
    assert a.effects.effects[0].strength > 0.0 > a.effects.effects[1].strength
    assert not any(e.matters for e in b.effects.effects)


def test_failures_are_left_out_and_counted() -> None:
    """Draws in which a law failed in any of the cases taken together are not looked at."""
    table = made("ab", DRAWS, lambda law, draw, v: None if law == "a" and draw < 5 else dependent(law, draw, v), GRID)
    a, b = sensitivities(table, experiment_of, ["rmse"])
    assert (a.draws, a.left_out) == (DRAWS - 5, 5)
    assert (b.draws, b.left_out) == (DRAWS, 0)


def test_what_cannot_be_told_says_why() -> None:
    """HF is zero throughout: no effects, and the reason; plain data all the same."""
    table = made("a", DRAWS, dependent, GRID)
    (rmse, hf) = sensitivities(table, experiment_of, ["rmse", "hf"])
    assert rmse.reason == ""
    assert hf.effects is None
    assert hf.reason == "it is the same in every draw"
    data = json.loads(json.dumps([rmse.to_json(), hf.to_json()], allow_nan=False))
    assert data[0]["effects"]["effects"][0]["inputs"] == ["g1"]
    assert data[0]["effects"]["ranked"] == ["g1", "I2"]
    assert data[1]["effects"] is None


def test_drawn_keys_count_beside_the_constants() -> None:
    """A payload drawn anew in each draw is found where the figure follows it, with a right model too."""
    mass = np.random.default_rng(2).uniform(0.0, 2.0, DRAWS)
    table = made("a", DRAWS, lambda law, draw, v: {"rmse": 1.0 + mass[draw] ** 2}, metrics=["rmse"])
    table = dict(table) | {"plant.payload.mass": mass[table["draw"]]}
    (only,) = sensitivities(table, lambda case, draw: NONE[draw], ["rmse"])
    assert only.effects is not None
    assert [(e.name, round(e.strength, 9)) for e in only.effects.effects] == [("plant.payload.mass", 1.0)]
    first = {name: column[:10] for name, column in table.items()}
    (both,) = sensitivities(first, lambda case, draw: TOLERANCE[draw], ["rmse"])
    assert both.effects is not None
    assert both.effects.effects[0].name == "plant.payload.mass"
    assert "I5 = g2" in {effect.name for effect in both.effects.effects}


def test_only_the_puma_has_constants() -> None:
    """Another arm has none, which is said; without a mismatch and drawn keys there is nothing to say."""
    two_link = load_experiment(CONFIGS / "two-link.yaml")
    with pytest.raises(ResultError, match="only puma560 has"):
        constant_changes([two_link])
    table = made("a", 10, lambda law, draw, v: {"rmse": 1.0 + draw}, metrics=["rmse"])
    assert sensitivities(table, lambda case, draw: two_link, ["rmse"]) == []
