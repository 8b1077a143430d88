"""Causes that are drawn at random and sized by closed forms are named, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from tests.diagnosis.drawn import ARMS, ENGINES, FAULTS, HARMLESS, Draw, Seeded, base, drawn, with_changes
from torquebench.diagnosis import diagnose
from torquebench.experiment.schema import Experiment

FEW = tuple(case for case in drawn(1731) if "two-link" in case.label)[:6]
MANY = (*drawn(1741), *drawn(1751))
LARGER = (("puma560", 1761), ("ur5e", 1771), ("ur5e", 1772))


def judge(case: Seeded) -> None:
    """Check that what is wrong with an experiment is named, and nothing else."""
    found = diagnose(Experiment.from_dict(case.sections))
    named = {cause.key for cause in found.causes}
    assert case.causes <= named, found.sentence
    assert named <= case.causes | case.allowed, found.sentence


@pytest.mark.parametrize("case", FEW, ids=[case.label for case in FEW])
def test_drawn_causes_are_named(case: Seeded) -> None:
    """Each cause of a few drawn experiments is named, and no other."""
    judge(case)


@pytest.mark.parametrize(
    ("arm", "seed"), [("two-link", 1761), *(pytest.param(*one, marks=pytest.mark.slow) for one in LARGER)]
)
@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_one_joint_is_named(kind: str, arm: str, seed: int) -> None:
    """A drive's wrong gain, one that weakens, a leak to another joint and a lock are named, and nothing else is."""
    d = Draw(np.random.default_rng([seed, list(FAULTS).index(kind)]), arm, "analytic")
    key, make = FAULTS[kind]
    changes, allowed = make(d)
    judge(Seeded(f"{kind}, {arm}", frozenset([key]), frozenset(allowed), with_changes(d, changes)))


@pytest.mark.slow
@pytest.mark.parametrize("case", MANY, ids=[case.label for case in MANY])
def test_many_drawn_causes_are_named(case: Seeded) -> None:
    """Likewise of sixty, on three arms and both engines."""
    judge(case)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("arm", ARMS[:2])
def test_the_base_is_sound(arm: str, engine: str) -> None:
    """Without a cause there is no symptom, even with a chain that does no harm: what is named comes of the cause."""
    sections = base(Draw(np.random.default_rng(0), arm, engine))
    for chain in ({}, HARMLESS):
        assert diagnose(Experiment.from_dict({**sections, "chain": chain})).symptoms == ()
