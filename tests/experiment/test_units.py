"""Units of keys are those of the schema's descriptions and of the laws' gains."""

from __future__ import annotations

import pytest

from torquebench.experiment.reference import unit_of


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("plant.payload.mass", "kg"),
        ("run.control_period", "s"),
        ("disturbances[0].hold", "s"),
        ("disturbances.0.sigma", "N m"),
        ("model.mismatch.relative", "1"),
        ("model.mismatch.constants.g1", "1"),
        ("controllers.*.gains.phi", "rad/s"),
        ("controllers.conventional.gains.k", "1"),
        ("chain.measurement_delay", "s"),
        ("plant.payload", None),
        ("chain", None),
        ("controllers.*.switching", None),
        ("plant.nothing", None),
    ],
)
def test_unit_of(key: str, unit: str | None) -> None:
    """Numbers have their unit, wherever they are; words, sections and unknown keys have none."""
    assert unit_of(key) == unit
