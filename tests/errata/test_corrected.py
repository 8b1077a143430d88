"""The corrected equations are the arm's, by derivations that share no code with them; the misprinted ones are not."""

import math

import numpy as np
import pytest

from torquebench.robot.puma560.puma import Puma560
from torquebench.robot.puma560.symbols import MISPRINTED

from . import findings, torques
from .elements import DROPPED, ELEMENTS, element, exact, exact_on_grid, fitted
from .formula import parse
from .independent import (
    Arm,
    derivative,
    node_positions,
    on_torus,
)

WRONG_FORMULA = {37, 40, 49, 50, 51, 58, 65, 69}
WRONG_LABEL = {66, 67, 68, 69}


def test_pinocchio_is_the_exact_model() -> None:
    """Mass matrix, gravity, bias, b, C and the tool frame of `exact` are those of Pinocchio, at any wrist."""
    rng, arm, model = np.random.default_rng(3), Arm(), Puma560()
    for _ in range(200):
        q, qd = rng.uniform(-np.pi, np.pi, 6), rng.uniform(-3, 3, 6)
        b, C = arm.velocity_products(q)
        # round-off of torques up to 100 N m and of inertias up to 8 kg m^2
        np.testing.assert_allclose(model.bias_forces(q, qd), arm.bias(q, qd), rtol=0, atol=1e-12)
        np.testing.assert_allclose(model.gravity(q), arm.gravity(q), rtol=0, atol=1e-12)
        np.testing.assert_allclose(model.mass_matrix(q), arm.mass_matrix(q), rtol=0, atol=1e-13)
        np.testing.assert_allclose(model.coriolis(q), b, rtol=0, atol=1e-13)
        np.testing.assert_allclose(model.centrifugal(q), C, rtol=0, atol=1e-13)
        np.testing.assert_allclose(model.forward_kinematics(q), arm.tool_pose(q), rtol=0, atol=1e-14)


def test_christoffel_symbols_give_the_bias() -> None:
    """B [qd qd] + C [qd^2] + g from derivatives of Pinocchio's M is Pinocchio's own Newton-Euler result."""
    rng, arm = np.random.default_rng(4), Arm()
    for _ in range(50):
        q, qd = rng.uniform(-np.pi, np.pi, 6), rng.uniform(-3, 3, 6)
        b, C = arm.velocity_products(q)
        velocity = np.einsum("ijk,j,k->i", torques.quadratic(b, C), qd, qd)
        np.testing.assert_allclose(velocity + arm.gravity(q), arm.bias(q, qd), rtol=0, atol=1e-12)


def test_mass_matrix_has_degree_two_in_each_angle() -> None:
    """5 and 9 samples give the same derivative, so M has no third harmonic; and M does not depend on theta1, theta6."""
    rng, arm = np.random.default_rng(5), Arm()
    for k in range(6):
        q = rng.uniform(-np.pi, np.pi, 6)
        five, nine = (derivative(arm.mass_matrix, q, k, samples) for samples in (5, 9))
        np.testing.assert_allclose(five, nine, rtol=0, atol=1e-13)  # round-off
        assert (np.abs(five).max() < 1e-13) == (k in (0, 5))


def test_grid_determines_the_torus() -> None:
    """Values continued from the 9 x 9 grid are those computed at the point itself, derivatives included."""
    arm, D = Arm(), exact_on_grid()["D"]
    fine, slope = on_torus(exact_on_grid()["A"], 36), on_torus(exact_on_grid()["A"], 36, (0, 1))
    q = np.array([0.0, math.radians(70), math.radians(250), 0.0, 0.0, 0.0])
    np.testing.assert_allclose(fine[7, 25], arm.mass_matrix(q), rtol=0, atol=1e-13)
    np.testing.assert_allclose(slope[7, 25], arm.mass_derivatives(q)[2], rtol=0, atol=1e-13)
    np.testing.assert_allclose(on_torus(D, 36)[7, 25], arm.mass_derivatives(q), rtol=0, atol=1e-13)


@pytest.mark.parametrize("number", ELEMENTS)
def test_corrected_equations_are_exact(number: int) -> None:
    """Every corrected entry equals the arm's on the whole torus at the frozen wrist, with the fitted constants."""
    assert findings.corrected_error(number) < findings.ROUND_OFF


def test_model_is_exact_where_its_pattern_is_not_zero() -> None:
    """The `corrected` model's A, b, C, G differ from the arm's in the listed dropped entries and nowhere else.

    The listed formulas are those entries' exact values.
    """
    assert set(findings.dropped()) == set(DROPPED)
    for label, formula in DROPPED.items():
        gap = findings.on_grid(parse(formula)) - exact(label)
        assert np.abs(gap).max() < findings.ROUND_OFF, label


def test_which_equations_are_wrong() -> None:
    """The equations that differ from the arm are the listed ones, with the model's flags for them; others are exact."""
    assert {n for n in ELEMENTS if findings.value_error(n) > findings.ROUND_OFF} == WRONG_FORMULA
    assert {n for n in ELEMENTS if element(n).label != element(n).slot} == WRONG_LABEL
    assert {n for n in ELEMENTS if findings.label_error(n) > findings.ROUND_OFF} == WRONG_FORMULA | WRONG_LABEL
    # (66) has no flag: its label is a slot that (62) leaves empty. The other four have no formula of their own.
    assert {int(n) for n in MISPRINTED} == (WRONG_FORMULA | WRONG_LABEL | {36, 55, 62, 71}) - {66}


def test_sizes_of_the_errors() -> None:
    """The largest errors are what the misprinted terms alone make of them, worked out by hand."""
    k = fitted()
    by_hand = {
        40: 4 * abs(k["I12"]),  # 2 I12 (C2 - C3)
        49: 4 * k["I15"],  # 8 I15 S23 C23
        58: 2 * (k["I14"] + k["I19"]),  # two terms with the other sign
        65: 2 * k["I15"],
        51: 1 - k["I15"] - k["I20"],  # 2 (-1 + I20 + I15) S23 C23, and S23 C23 is at most 0.5
        69: 0.5 * (1 - k["I15"] - k["I20"]),
    }
    for number, expected in by_hand.items():
        # the grid of 1 degree contains 45 and 90 degrees, where these sines peak
        assert findings.value_error(number) == pytest.approx(expected, rel=1e-9), number
    assert findings.size("A35") == pytest.approx(k["I15"] + k["I17"])
    assert findings.size("b225") == pytest.approx(2 * (k["I16"] + abs(k["I22"])))
    assert findings.claims()[57, "b_{214}"][0] == pytest.approx(2 * (k["I14"] + k["I19"] + k["I20"]))


def test_terms_that_are_no_inertia() -> None:
    """Everything in A, b and C is proportional to the constants, except a bare 2 in (37) and a bare product in two."""
    assert {n for n in ELEMENTS if not findings.scales_with_constants(element(n).printed)} == {37, 51, 69}
    assert all(findings.scales_with_constants(element(n).corrected) for n in ELEMENTS)


def test_printed_equations_against_each_other() -> None:
    """Derivatives of (37)-(41) are (49)-(68) once all are corrected; as printed (37) and (40) contradict eight others.

    Mending only (37) and (40) leaves exactly the errors of (49), (50) and (65): no arm and no constants are needed.
    """
    fails = [
        {i[0] for i in findings.IDENTITIES if findings.identity_error(i, mended) > findings.ROUND_OFF}
        for mended in ((), (37,), (37, 40), ELEMENTS)
    ]
    assert fails == [{49, 50, 54, None, 65, 67, 68}, {49, 50, 54, None, 65, 68}, {49, 50, 65}, set()]


def test_what_the_labels_claim() -> None:
    """Of the chains `label = claim = formula` five fail as printed; b412 = b214 fails however one corrects it."""
    printed = {n for (n, _), (gap, _) in findings.claims().items() if gap is None or gap > findings.ROUND_OFF}
    corrected = {n for (n, _), (_, gap) in findings.claims().items() if gap is None or gap > findings.ROUND_OFF}
    assert printed == {57, 58, 67, 68, 70}
    assert corrected == {57}


def test_corrected_pattern_against_the_arm() -> None:
    """The entries that the patterns drop are worth at most 0.0032 kg m^2 and 0.041 N m at 2 rad/s."""
    A = findings.peak(exact_on_grid()["A"] - findings.corrected_matrices()["A"])
    V = torques.torque_peak(torques.corrected_quadratic() - torques.exact_quadratic())
    assert A < 3.2e-3
    assert V.max() < 0.041
    # and not smaller than the largest dropped entry alone: A25, and b145 at 2 rad/s
    assert A == pytest.approx(findings.dropped()["A25"], rel=1e-9)
    assert V[0] > 4 * 0.99 * findings.dropped()["b145"]


def test_power_of_the_velocity_torques() -> None:
    """V of the arm does no work of its own; the printed V does, whichever A it is held against.

    With the wrist at rest the corrected pattern is as good as the arm: (dA/dt - 2V) can be skew only then.
    """
    D = exact_on_grid()["D"]
    assert torques.power(torques.exact_quadratic(), D, 6) < 1e-12  # round-off of 60 W
    assert torques.power(torques.corrected_quadratic(), D, 3) < 1e-12
    assert 0.01 < torques.power(torques.corrected_quadratic(), D, 6) < 0.1
    assert torques.power(torques.printed_quadratic(), D, 3) > 10
    assert torques.power(torques.printed_quadratic(), torques.printed_mass_derivatives(), 3) > 10


def test_joint_3_as_printed() -> None:
    """Joint 3's velocity torque as printed is wrong by more than its largest true value."""
    error = torques.torque_peak(torques.printed_quadratic() - torques.exact_quadratic())
    assert error[2] > torques.torque_peak(torques.exact_quadratic())[2]


def test_positive_definite() -> None:
    """A is positive definite over the torus in every structure; the printed one is not symmetric, by A35."""
    assert all(least > 0.17 for least, _ in torques.definiteness().values())
    A = Puma560("printed").mass_matrix(node_positions())
    assert np.abs(A - A.transpose(0, 2, 1)).max() == pytest.approx(findings.size("A35"), rel=1e-12)
