"""A belief made wrong on purpose: size, independence, acceptance and pairing of its 34 changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from torquebench.disturbances import Stream, generator
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot import RobotModel, load_model
from torquebench.robot.puma560 import mismatch
from torquebench.robot.puma560.mismatch import mismatched

VARIANTS = [(s, c) for s in ("corrected", "printed") for c in ("fitted", "printed")]
LEAST = 0.05
"""Least eigenvalue [kg m^2] that the protocol asks for."""


def rng(draw: int, seed: int = 7) -> np.random.Generator:
    """Return the generator of a draw."""
    return generator(seed, draw, Stream.MISMATCH)


def signs_of(drawn: RobotModel, nominal: RobotModel) -> Array:
    """Return +1 for each constant that grew in size, -1 for each that shrank, (34,)."""
    return np.sign(np.abs(drawn.flat.constants) - np.abs(nominal.flat.constants))


def least_eigenvalue(arm: RobotModel) -> float:
    """Return the least eigenvalue of the symmetric part of the mass matrix over a grid of 7.5 degrees.

    The frozen-wrist forms depend on theta2 and theta3 only.
    """
    grid = np.deg2rad(np.arange(0.0, 360.0, 7.5))
    q = np.zeros((len(grid) ** 2, 6))
    q[:, 1], q[:, 2] = np.repeat(grid, len(grid)), np.tile(grid, len(grid))
    M = arm.mass_matrix(q)
    return float(np.linalg.eigvalsh((M + np.swapaxes(M, 1, 2)) / 2.0).min())


@pytest.mark.parametrize(("structure", "constants"), VARIANTS)
@pytest.mark.parametrize("r", [0.1, 0.3])
def test_every_constant_is_off_by_exactly_the_relative_size(structure: str, constants: str, r: float) -> None:
    """Each of the 34 constants is (1 + r) or (1 - r) times the nominal one, to the last bit, and both occur."""
    nominal = load_model("puma560", structure, constants)
    drawn, _ = mismatched(nominal, r, rng(0))
    up, down = nominal.flat.constants * (1.0 + r), nominal.flat.constants * (1.0 - r)
    is_up, is_down = drawn.flat.constants == up, drawn.flat.constants == down
    assert drawn.flat.constants.shape == (34,)
    assert np.all(is_up ^ is_down)
    assert np.any(is_up)
    assert np.any(is_down)


def test_signs_are_even_and_independent() -> None:
    """Over 200 draws each constant goes up about half the time, and no two constants or draws go together.

    Bounds are five standard deviations: 1/sqrt(200) for the mean of a constant's signs and for the product of two
    constants, 1/sqrt(6800) for all signs, 1/sqrt(34) for the product of two draws.
    """
    nominal = load_model("puma560", "corrected", "printed")
    signs = np.array([signs_of(mismatched(nominal, 0.1, rng(draw))[0], nominal) for draw in range(200)])
    assert np.all(np.abs(signs) == 1.0)
    assert np.abs(signs.mean(axis=0)).max() < 5.0 / np.sqrt(200)
    assert abs(signs.mean()) < 5.0 / np.sqrt(signs.size)
    # how many go up varies from draw to draw: the variance of the sum of 34 signs is 34, known to 1/10 from 200 draws
    assert 17.0 < signs.sum(axis=1).var() < 51.0
    between_constants = signs.T @ signs / 200 - np.eye(34)
    assert np.abs(between_constants).max() < 5.0 / np.sqrt(200)
    between_draws = signs @ signs.T / 34 - np.eye(200)
    assert np.abs(between_draws).max() < 5.0 / np.sqrt(34)


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_draws_without_a_positive_definite_mass_matrix_are_redrawn(structure: str) -> None:
    """At r = 0.9 the first acceptable draw is taken: it is positive definite, and those before it are not.

    The sequence of signs is read off with r = 1e-6, at which nothing can be rejected, from the same generator.
    """
    nominal = load_model("puma560", structure, "printed")
    rejected = 0
    for draw in (*range(12), 19):  # draw 19 passes by a model whose least eigenvalue is 0.031, just not enough
        drawn, redraws = mismatched(nominal, 0.9, rng(draw))
        # the package looks at 300 other poses; between them the eigenvalue may be a little lower
        assert least_eigenvalue(drawn) > 0.9 * LEAST
        again = rng(draw)
        for k in range(redraws + 1):
            gentle, none = mismatched(nominal, 1e-6, again)
            assert none == 0
            signs = signs_of(gentle, nominal)
            if k < redraws:
                constants = nominal.flat.constants * (1.0 + 0.9 * signs)
                refused = RobotModel("refused", nominal.joint_names, replace(nominal.flat, constants=constants))
                # nor is a draw refused that only poses between those of this grid would refuse
                assert least_eigenvalue(refused) < 1.1 * LEAST
        assert np.array_equal(signs, signs_of(drawn, nominal))
        rejected += redraws
    assert rejected > 0


def test_no_draw_is_rejected_at_the_protocols_size() -> None:
    """At r = 0.3 every draw is acceptable, so the number of redraws is zero."""
    nominal = load_model("puma560", "corrected", "printed")
    assert [mismatched(nominal, 0.3, rng(draw))[1] for draw in range(20)] == [0] * 20


def test_draws_are_paired_between_models() -> None:
    """The same seed and draw give the same signs for both structures and both constant sets."""
    for draw in range(5):
        signs = []
        for structure, constants in VARIANTS:
            nominal = load_model("puma560", structure, constants)
            signs.append(signs_of(mismatched(nominal, 0.3, rng(draw))[0], nominal))
        assert all(np.array_equal(signs[0], other) for other in signs[1:])


def test_draws_are_repeated_by_their_key_alone() -> None:
    """The same key gives the same model, whatever was drawn in between; another draw or seed gives another."""
    nominal = load_model("puma560", "corrected", "fitted")
    first = mismatched(nominal, 0.3, rng(1))[0].flat.constants
    for draw, seed in ((2, 7), (1, 8)):
        assert not np.array_equal(first, mismatched(nominal, 0.3, rng(draw, seed))[0].flat.constants)
    assert np.array_equal(first, mismatched(nominal, 0.3, rng(1))[0].flat.constants)


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_the_given_model_is_left_alone(structure: str) -> None:
    """The model passed in keeps every value, shares nothing that can be written to, and only the constants differ."""
    nominal, untouched = (load_model("puma560", structure, "fitted") for _ in range(2))
    drawn, _ = mismatched(nominal, 0.9, rng(1))
    for name, value in vars(untouched.flat).items():
        if isinstance(value, np.ndarray):
            given, result = getattr(nominal.flat, name), getattr(drawn.flat, name)
            assert np.array_equal(given, value), name
            assert np.array_equal(result, value) == (name != "constants"), name
            assert not given.flags.writeable, name
            assert not result.flags.writeable, name
    for given, result in zip(nominal.flat.scratch, drawn.flat.scratch, strict=True):
        assert not np.shares_memory(given, result)
    assert drawn.flat.structure == nominal.flat.structure
    assert (drawn.n, drawn.joint_names) == (nominal.n, nominal.joint_names)


def test_the_search_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """When no draw is acceptable the search stops after its limit, with a ModelError that names the size."""
    monkeypatch.setattr(mismatch, "LEAST_EIGENVALUE", 1e9)
    monkeypatch.setattr(mismatch, "MAX_REDRAWS", 3)
    with pytest.raises(ModelError, match=r"within 3 draws at a relative mismatch of 0\.3"):
        mismatched(load_model("puma560", "corrected"), 0.3, rng(0))
