"""Properties any arm's dynamics must have, and the shapes of the public methods."""

import numpy as np
import pytest

from torquebench import Puma560, load_model
from torquebench.comparison import random_states
from torquebench.robot.dynamics import solve_in_place

VARIANTS = [("exact", "fitted"), ("corrected", "fitted"), ("corrected", "printed"), ("printed", "printed")]


def torus(step):
    """Positions over the whole theta2-theta3 torus, `step` degrees apart, wrist at zero."""
    grid = np.deg2rad(np.arange(0, 360, step))
    q = np.zeros((len(grid) ** 2, 6))
    q[:, 1], q[:, 2] = (x.ravel() for x in np.meshgrid(grid, grid, indexing="ij"))
    return q


def test_exact_mass_matrix_is_symmetric_and_positive_definite_on_the_torus(figure):
    """M = M^T to the last bit, and its least eigenvalue stays above the least motor inertia's 0.179 kg m^2."""
    q = torus(2.0)
    M = Puma560().mass_matrix(q)
    assert np.array_equal(M, M.transpose(0, 2, 1))
    # M = (links, positive semi-definite) + diag(Im), so no eigenvalue is below min(Im) = Im5 = 0.179
    least = np.linalg.eigvalsh(M).min()
    figure("least eigenvalue of M on the theta2-theta3 torus [kg m^2]", least, "> 0")
    assert least >= 0.179


def test_printed_mass_matrix_is_not_symmetric():
    """Read literally, (36) has A35 without A53; its symmetric part is positive definite all the same."""
    A = Puma560("printed", "printed").mass_matrix(torus(5.0))
    assert np.max(np.abs(A - A.transpose(0, 2, 1))) == pytest.approx(0.00125 + 0.000642, rel=1e-12)
    assert np.linalg.eigvalsh(0.5 * (A + A.transpose(0, 2, 1))).min() > 0.1


def derivative_of_mass_matrix(arm, q):
    """dM/dq_k, (6, 6, 6), first axis k: exact for a trigonometric polynomial of degree <= 3 in each joint.

    Seven equispaced samples determine such a polynomial; its derivative at the middle sample is
    sum_m (-1)^(m+1) / (2 sin(m pi / 7)) (f(+m) - f(-m)), m = 1..3.
    """
    out = np.zeros((6, 6, 6))
    for k in range(6):
        for m in (1, 2, 3):
            ahead, behind = q.copy(), q.copy()
            ahead[k] += 2 * np.pi * m / 7
            behind[k] -= 2 * np.pi * m / 7
            weight = (-1) ** (m + 1) / (2 * np.sin(np.pi * m / 7))
            out[k] += weight * (arm.mass_matrix(ahead) - arm.mass_matrix(behind))
    return out


def test_mdot_minus_2c_is_skew_with_the_wrist_moving(figure):
    """Mdot - 2C is skew to 1e-9, C built from the public b and centrifugal matrices: C_ij = sum_k c_ijk qd_k.

    Christoffel symbols: c_ijk = b_ijk / 2 for j != k and c_ijj = C_ij, symmetric in j and k.
    """
    arm = Puma560()
    q, qd, _ = random_states(6, 50, seed=3)
    first, second = np.triu_indices(6, 1)
    worst = 0.0
    for position, speed in zip(q, qd, strict=True):
        symbols = np.zeros((6, 6, 6))
        symbols[:, first, second] = symbols[:, second, first] = 0.5 * arm.coriolis(position)
        symbols[:, range(6), range(6)] = arm.centrifugal(position)
        C = symbols @ speed
        Mdot = np.einsum("kij,k->ij", derivative_of_mass_matrix(arm, position), speed)
        S = Mdot - 2.0 * C
        worst = max(worst, np.max(np.abs(S + S.T)))
        assert np.max(np.abs(S)) > 1e-3  # the property is not met by being zero
    figure("Mdot - 2C, wrist moving: symmetric part [kg m^2/s]", worst, "<= 1e-9")
    assert worst <= 1e-9


@pytest.mark.parametrize(("structure", "constants"), VARIANTS)
def test_bias_is_what_the_matrices_say(structure, constants):
    """N(q, 0) = g(q); and for right structures N - g = b [qd qd] + C [qd^2] to round-off."""
    arm = Puma560(structure, constants)
    q, qd, _ = random_states(6, 200, seed=4)
    assert np.array_equal(arm.bias_forces(q, np.zeros_like(q)), arm.gravity(q))
    first, second = np.triu_indices(6, 1)
    V = np.einsum("nij,nj->ni", arm.coriolis(q), qd[:, first] * qd[:, second])
    V += np.einsum("nij,nj->ni", arm.centrifugal(q), qd * qd)
    gap = np.abs(arm.bias_forces(q, qd) - arm.gravity(q) - V)
    if structure == "printed":
        # (71) uses c13 where the matrix (62) has c31: joint 3 alone is affected
        assert np.max(np.delete(gap, 2, axis=1)) <= 1e-12
        assert np.max(gap[:, 2]) > 0.1
    else:
        assert np.max(gap) <= 1e-12


@pytest.mark.parametrize(("structure", "constants"), VARIANTS)
def test_forward_dynamics_inverts_inverse_dynamics(structure, constants):
    """FD(q, qd, ID(q, qd, qdd)) = qdd to 1e-11 rad/s^2: cond(M) is 44, torques reach 100 N m."""
    arm = Puma560(structure, constants)
    q, qd, qdd = random_states(6, 500, seed=5)
    assert np.max(np.abs(arm.forward_dynamics(q, qd, arm.inverse_dynamics(q, qd, qdd)) - qdd)) <= 1e-11


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_closed_forms_ignore_the_wrist(structure):
    """theta4..theta6 change nothing in the frozen-wrist structures, gravity included."""
    arm = Puma560(structure, "printed")
    q, qd, _ = random_states(6, 50, seed=6)
    still = q.copy()
    still[:, 3:] = 0.0
    assert np.array_equal(arm.mass_matrix(q), arm.mass_matrix(still))
    assert np.array_equal(arm.bias_forces(q, qd), arm.bias_forces(still, qd))


def test_corrected_against_exact_on_the_frozen_wrist(figure):
    """The terms (36), (48), (62) drop are worth <= 3.2e-3 kg m^2 in M and <= 0.04 N m in V at |qd| <= 2 rad/s.

    Over 10^4 random states. With all six speeds at the worst corner of their box V reaches 0.0409 N m on joint 1:
    docs/errata.md and tests/errata search the corners.
    """
    q, qd, _ = random_states(6, 10_000, seed=7)
    q[:, 3:] = 0.0
    qd *= 2.0 / 3.0
    exact, corrected = Puma560(), Puma560("corrected")
    gap = np.max(np.abs(exact.mass_matrix(q) - corrected.mass_matrix(q)))
    figure("corrected against exact, frozen wrist, M [kg m^2]", gap, "<= 3.2e-3")
    assert gap <= 3.2e-3
    V = exact.bias_forces(q, qd) - exact.gravity(q)
    W = corrected.bias_forces(q, qd) - corrected.gravity(q)
    figure("corrected against exact, frozen wrist, V at |qd| <= 2 rad/s [N m]", np.max(np.abs(V - W)), "<= 0.04")
    assert np.max(np.abs(V - W)) <= 0.04
    assert np.max(np.abs(exact.gravity(q) - corrected.gravity(q))) <= 1e-12


def test_corrected_pose_is_the_exact_pose():
    """The repaired (11)-(22) with Table 2's lengths and d6, in mapped joint coordinates, is the DH product."""
    q, _, _ = random_states(6, 500, seed=8)
    gap = np.abs(Puma560("corrected").forward_kinematics(q) - Puma560().forward_kinematics(q))
    assert np.max(gap) <= 1e-14


def test_positive_theta2_lowers_the_arm():
    """The sign convention: gravity torque at q = 0 is g1 + g4 on joint 2, and raising theta2 lowers the tool."""
    arm = Puma560()
    down = arm.forward_kinematics([0, 0.1, 0, 0, 0, 0])[2, 3]
    assert down < arm.forward_kinematics(np.zeros(6))[2, 3]
    assert arm.gravity(np.zeros(6))[1] == pytest.approx(-37.2 + 0.249, abs=1e-3)


def test_leading_batch_axes_change_nothing():
    """(2, 3, 6) input gives (2, 3, ...) output with each state's own values, for every method."""
    arm = Puma560()
    q, qd, qdd = (x.reshape(2, 3, 6) for x in random_states(6, 6, seed=9))
    for method, arguments, shape in (
        (arm.mass_matrix, (q,), (6, 6)),
        (arm.coriolis, (q,), (6, 15)),
        (arm.centrifugal, (q,), (6, 6)),
        (arm.gravity, (q,), (6,)),
        (arm.bias_forces, (q, qd), (6,)),
        (arm.inverse_dynamics, (q, qd, qdd), (6,)),
        (arm.forward_dynamics, (q, qd, qdd), (6,)),
        (arm.forward_kinematics, (q,), (4, 4)),
    ):
        batch = method(*arguments)
        assert batch.shape == (2, 3, *shape)
        assert np.array_equal(batch[1, 2], method(*(x[1, 2] for x in arguments)))


def test_one_position_with_many_velocities_broadcasts():
    """A (6,) position with (N, 6) velocities gives (N, 6)."""
    arm = Puma560()
    _, qd, _ = random_states(6, 4, seed=10)
    q = np.full(6, 0.3)
    assert np.array_equal(arm.bias_forces(q, qd), arm.bias_forces(np.tile(q, (4, 1)), qd))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda arm: arm.mass_matrix(np.zeros(5)), r"q has shape \(5,\), wanted \(\.\.\., 6\)"),
        (lambda arm: arm.gravity(0.0), r"q has shape \(\), wanted"),
        (lambda arm: arm.bias_forces(np.zeros(6), [np.nan] * 6), "qd has values that are not finite"),
    ],
)
def test_wrong_shapes_and_values_are_refused(call, message):
    """Every method names the argument, its shape, and what was wanted."""
    with pytest.raises(ValueError, match=message):
        call(Puma560())


def test_exact_with_printed_constants_is_refused():
    """Seven ties make the printed constants no rigid body's."""
    with pytest.raises(ValueError, match="seven exact ties"):
        Puma560("exact", "printed")


@pytest.mark.parametrize(("arguments", "hint"), [(("exat",), "exact"), (("exact", "fited"), "fitted")])
def test_unknown_structure_or_constants_name_the_nearest(arguments, hint):
    """A misspelt name is refused with the nearest valid one."""
    with pytest.raises(ValueError, match=f"did you mean '{hint}'"):
        Puma560(*arguments)


def test_load_model_is_the_exact_puma():
    """The generic loader's `puma560` has the same dynamics, bit for bit, as Puma560()."""
    states = random_states(6, 20, seed=11)
    assert np.array_equal(load_model("puma560").inverse_dynamics(*states), Puma560().inverse_dynamics(*states))


def test_solver_pivots_and_matches_lapack():
    """LU with partial pivoting solves general systems to 1e-12, also with a zero first pivot."""
    rng = np.random.default_rng(12)
    for _ in range(50):
        A, x = rng.normal(size=(6, 6)), rng.normal(size=6)
        A[0, 0] = 0.0
        b = A @ x
        solution, expected = b.copy(), np.linalg.solve(A, b)
        solve_in_place(A.copy(), solution)
        assert np.allclose(solution, expected, rtol=1e-9, atol=1e-10)
