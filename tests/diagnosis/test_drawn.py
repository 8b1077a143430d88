"""Causes that are drawn at random and sized by closed forms are named, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from tests.diagnosis.drawn import ARMS, ENGINES, HARMLESS, LATER, Draw, Seeded, base, drawn, with_changes
from torquebench.diagnosis import diagnose
from torquebench.experiment.schema import Experiment

FEW = tuple(case for case in drawn(1731) if "two-link" in case.label)[:6]
MANY = (*drawn(1741), *drawn(1751))


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


@pytest.mark.parametrize("arm", [ARMS[0], *(pytest.param(arm, marks=pytest.mark.slow) for arm in ARMS[1:])])
@pytest.mark.parametrize("key", LATER)
def test_faults_of_drives_and_brakes_are_named(key: str, arm: str) -> None:
    """A wrong gain, one that weakens, leaks between joints and a joint that locks are each named, and no other."""
    d = Draw(np.random.default_rng(1761), arm, "analytic")
    changes, allowed = LATER[key](d)
    judge(Seeded(f"{key}, {arm}", frozenset([key]), frozenset(allowed), with_changes(d, changes)))


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
