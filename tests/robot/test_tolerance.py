"""Beliefs whose constants are drawn within the tables' tolerances, or changed one by one."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from tests.robot.test_mismatch import rng
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot import Puma560, RobotModel, load_model
from torquebench.robot.library import model_folder
from torquebench.robot.links import pseudo_inertia
from torquebench.robot.puma560 import mismatch
from torquebench.robot.puma560.consistent import (
    BASIS,
    consistent_links,
    form_conditions,
    linear_map,
    nearest_reachable,
    pseudos,
)
from torquebench.robot.puma560.constants import fitted_constants, read_constants
from torquebench.robot.puma560.mismatch import mismatched, puma_files, with_factors, within_tolerances
from torquebench.robot.puma560.symbols import CONSTANTS

TABLE = read_constants(model_folder("puma560") / "constants.yaml")[0]
FITTED = Puma560("corrected", "fitted").flat.constants
BELIEFS = [("exact", "fitted"), ("corrected", "fitted"), ("corrected", "printed"), ("printed", "printed")]


def constants_of(model: RobotModel) -> Array:
    """Return the 34 constants of any structure."""
    return model.flat.constants if len(model.flat.constants) else fitted_constants(model.flat, Puma560().geometry)


def value(constants: Array, name: str) -> float:
    """Return one of the 34."""
    return float(constants[CONSTANTS.index(name)])


@pytest.mark.parametrize("tolerances", [0.3, 1.0, 2.0])
def test_constants_are_within_their_tolerances_and_obey_the_ties(tolerances: float) -> None:
    """Each of the 34 is within k tolerances of its fitted value, many well away from it; the ties hold exactly."""
    a2, a3, d, d4, _ = Puma560().geometry
    for draw in range(6):
        drawn = constants_of(within_tolerances(Puma560("corrected", "printed"), tolerances, rng(draw))[0])
        off = (drawn - FITTED) / (tolerances * TABLE.tolerance)
        assert np.max(np.abs(off)) <= 1.0 + 1e-12
        assert np.median(np.abs(off)) > 0.2
        for x, y, ratio in (
            ("g2", "I5", -9.81 / a2),
            ("g4", "I12", -9.81 / a2),
            ("I15", "I16", d4 / a2),
            ("I18", "I16", d / a2),
            ("I22", "I16", a3 / a2),
            ("g5", "I16", -9.81 / a2),
        ):
            assert value(drawn, x) == pytest.approx(ratio * value(drawn, y), rel=1e-9)
        assert sum(value(drawn, x) for x in ("I19", "I20", "I21")) == pytest.approx(0.0, abs=1e-15)


def test_a_rigid_body_has_them() -> None:
    """The links of ``exact`` are bodies and realise the constants that a closed form gets from the same draw, to 1e-9.

    So are accepted and rejected draws the same for every structure and constant set.
    """
    total = 0
    for draw in range(3):
        found = [within_tolerances(load_model("puma560", *belief), 1.5, rng(draw)) for belief in BELIEFS]
        flat = found[0][0].flat
        for i in range(6):
            assert np.linalg.eigvalsh(pseudo_inertia(flat.mass[i], flat.com[i], flat.inertia[i]))[0] > 0.0
        wanted = constants_of(found[1][0])
        for model, redraws in found:
            assert constants_of(model) == pytest.approx(wanted, abs=1e-9 * np.max(np.abs(wanted)))
            assert redraws == found[0][1]
        total += found[0][1]
    assert total > 0


def test_what_no_body_can_have_is_never_accepted() -> None:
    """I23, I17 and I14 are sums of principal inertias: positive, though 2.5 tolerances reach below zero."""
    for draw in range(6):
        drawn = constants_of(within_tolerances(Puma560("corrected", "fitted"), 2.5, rng(draw))[0])
        assert min(value(drawn, x) for x in ("I23", "I17", "I14")) > 0.0
    assert value(FITTED, "I23") - 2.5 * value(TABLE.tolerance, "I23") < 0.0


def test_most_draws_within_one_tolerance_are_bodies() -> None:
    """Within 0.3 tolerances hardly any is rejected but for leaving the box; within one, about a third."""
    counts = {k: sum(within_tolerances(Puma560(), k, rng(draw))[1] for draw in range(12)) for k in (0.3, 1.0)}
    assert counts[0.3] <= 6
    assert 1 <= counts[1.0] <= 24


def test_draws_repeat_by_their_key() -> None:
    """The same key, the same constants; another draw, others; the model passed in stays what it was."""
    arm = Puma560("corrected", "printed")
    before = arm.flat.constants.tobytes()
    first, again, other = (within_tolerances(arm, 1.0, rng(k))[0].flat.constants for k in (1, 1, 2))
    assert first.tobytes() == again.tobytes() != other.tobytes()
    assert arm.flat.constants.tobytes() == before


def test_a_search_without_end_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 200 tolerances no draw is a body: a ModelError that says how many were tried."""
    monkeypatch.setattr(mismatch, "MAX_BODIES", 4)
    with pytest.raises(ModelError, match="no rigid body within 4 draws of constants at 200 times their tolerances"):
        within_tolerances(Puma560("corrected", "printed"), 200.0, rng(0))


def test_another_arm_has_no_table() -> None:
    """A ModelError that names it."""
    with pytest.raises(ModelError, match="'two-link' has no table of tolerances"):
        within_tolerances(load_model("two-link"), 1.0, rng(0))


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_single_constants_are_changed_alone(structure: Any) -> None:
    """g1 x 1.3 adds 0.3 g1 cos theta2 to joint 2's gravity (73) and nothing else; Im4 x 2 doubles that motor in A44."""
    nominal = Puma560(structure, "printed")
    changed = with_factors(nominal, {"g1": 1.3, "Im4": 2.0})
    q, qd, qdd = np.random.default_rng(2).normal(size=(3, 50, 6))
    more = changed.inverse_dynamics(q, qd, qdd) - nominal.inverse_dynamics(q, qd, qdd)
    wanted = np.zeros((50, 6))
    wanted[:, 1] = 0.3 * -37.2 * np.cos(q[:, 1])
    wanted[:, 3] = 0.2 * qdd[:, 3]
    assert more == pytest.approx(wanted, abs=1e-12)
    assert np.count_nonzero(changed.flat.constants != nominal.flat.constants) == 2


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"g6": 1.0}, "unknown constant 'g6'"),
        ({"Im4": 0.0, "I14": 0.0}, "eigenvalue of .* wanted all above 0.05"),
        ({"I1": -5.0}, "eigenvalue of -"),
    ],
)
def test_constants_without_a_model_are_refused(factors: dict[str, float], message: str) -> None:
    """An unknown name, and what leaves no positive definite mass matrix: a ModelError that names it."""
    with pytest.raises(ModelError, match=message):
        with_factors(Puma560("corrected", "printed"), factors)


def test_a_rigid_body_has_no_single_constants() -> None:
    """A ModelError that says which structures have."""
    with pytest.raises(ModelError, match="in structure 'corrected' or 'printed'"):
        with_factors(Puma560(), {"g1": 1.3})


@pytest.mark.parametrize("name", ["puma560", "two-link"])
def test_a_relative_mismatch_of_a_rigid_body_scales_its_links(name: str) -> None:
    """Masses and rotors within 1 +- r, mass matrix positive definite and of another value; no redraws; keyed."""
    arm = load_model(name)
    drawn, redraws = mismatched(arm, 0.3, rng(0))
    assert redraws == 0
    assert np.max(np.abs(drawn.flat.mass / arm.flat.mass - 1.0)) <= 0.3
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (50, arm.n))
    M = drawn.mass_matrix(q)
    assert np.linalg.eigvalsh(M).min() > 0.0
    assert np.max(np.abs(M / arm.mass_matrix(q).max() - arm.mass_matrix(q) / arm.mass_matrix(q).max())) > 0.02
    assert mismatched(arm, 0.3, rng(0))[0].flat.about_origin.tobytes() == drawn.flat.about_origin.tobytes()
    assert mismatched(arm, 0.3, rng(1))[0].flat.about_origin.tobytes() != drawn.flat.about_origin.tobytes()
    assert drawn.flat.inertia_scale.tobytes() == arm.flat.inertia_scale.tobytes()


THREADED = """
import hashlib, numpy
from torquebench.robot import Puma560
from torquebench.robot.puma560.mismatch import within_tolerances
digest = hashlib.sha256()
for draw in range(12):
    model, redraws = within_tolerances(Puma560(), 2.0, numpy.random.default_rng(draw))
    digest.update(model.flat.inertia.tobytes() + bytes([redraws]))
print(digest.hexdigest())
"""


def test_draws_do_not_depend_on_threads() -> None:
    """Linear algebra on one, two or four threads: the same bodies to the last bit, and as many rejected.

    Twelve draws at two tolerances take some 500 Newton steps, many of them next to the edge of what a body can be.
    """
    found = set()
    for threads in ("1", "2", "4"):
        env = os.environ | {"OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads, "MKL_NUM_THREADS": threads}
        command = [sys.executable, "-c", THREADED]
        found.add(subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout)
    assert len(found) == 1
    assert len(found.pop().strip()) == 64


def test_the_body_found_is_the_nearest() -> None:
    """The distance's gradient P0^-1 - P^-1 at the body found is a combination of the conditions' rows, to 1e-5.

    The search stops at a step of 1e-6 in the distance's own units; the gradient is small with it.
    """
    B, conditions = linear_map(Puma560().geometry, 9.81), form_conditions()
    prior = puma_files()[0].about_origin.ravel()
    A = np.vstack([B, conditions])
    target = np.concatenate([B @ prior * np.linspace(0.99, 1.01, len(B)), np.zeros(len(conditions))])
    target[: len(B)] = nearest_reachable(B, target[: len(B)], np.abs(target[: len(B)]))
    found = consistent_links(A, target, prior)
    assert found is not None
    assert A @ found == pytest.approx(target, abs=1e-9)
    slopes = np.linalg.inv(pseudos(prior)) - np.linalg.inv(pseudos(found))
    gradient = np.einsum("iab,eab->ie", slopes, BASIS).ravel()
    left = gradient - A.T @ np.linalg.lstsq(A.T, gradient, rcond=1e-12)[0]
    assert np.linalg.norm(gradient) > 1.0
    assert np.linalg.norm(left) < 1e-5 * np.linalg.norm(gradient)
