"""Table 2, (8) and (11)-(22) against the arm of the dynamics; and what Tables 3 and 4 say about that arm."""

import math

import numpy as np
import pytest

from torquebench.kernel import Array

from . import chains, findings
from .elements import POSE, fitted
from .independent import (
    Arm,
    modified,
    modified_chain,
    read,
    standard,
    standard_chain,
    table2,
)
from .paper_equations import EQUATIONS, TABLE_2, TABLES_3_AND_4


def test_table_2_and_the_sign_of_a3() -> None:
    """Table 2 as standard DH, or as (8) with alpha and a of the row before, is the arm only with a3 negative."""
    rng, arm = np.random.default_rng(6), Arm()
    q = rng.uniform(-np.pi, np.pi, (50, 6))
    T = np.array([arm.tool_pose(x) for x in q])
    used = table2(a3_as_printed=False)
    np.testing.assert_allclose(standard_chain(used, q), T, rtol=0, atol=1e-14)
    np.testing.assert_allclose(modified_chain(used, q, same_row=False), T, rtol=0, atol=1e-14)
    assert np.abs(modified_chain(used, q, same_row=True) - T).max() > 0.5
    assert np.abs(standard_chain(table2(a3_as_printed=True), q) - T).max() > 0.02


def test_dynamics_carry_a_negative_a3() -> None:
    """I12, I13, I22 and g4 have the printed signs for an arm with a3 < 0 and the opposite ones for a3 > 0.

    They are read off Pinocchio's arm: I12 from A23 at theta3 = 0 and pi, I13 from A13 at theta2 = +-90 degrees, I22
    from c52 at theta3 = 90 degrees, g4 from G3 at zero.
    """

    def at(second: float, third: float) -> Array:
        return np.array([0.0, second, third, 0.0, 0.0, 0.0])

    def read_off(arm: Arm) -> dict[str, float]:
        A, up = arm.mass_matrix, np.pi / 2
        return {
            "I12": 0.5 * (A(at(0, 0)) - A(at(0, np.pi)))[1, 2],
            "I13": 0.5 * (A(at(up, 0)) - A(at(-up, 0)))[0, 2],
            "I22": -arm.velocity_products(at(0.3, up))[1][4, 1],
            "g4": arm.gravity(at(0, 0))[2],
        }

    printed, negative, positive = findings.printed_constants(), read_off(Arm(-0.0203)), read_off(Arm(0.0203))
    for name in negative:
        assert negative[name] == pytest.approx(fitted()[name], rel=1e-6)
        assert np.sign(negative[name]) == np.sign(printed[name]) == -np.sign(positive[name])
    # the tables alone say so too, to the two digits that I22 is printed with
    for value in findings.link_length_a3().values():
        assert value == pytest.approx(-0.0203, rel=0.02)


def test_ties() -> None:
    """A rigid arm's constants obey the seven ties; the printed ones break each, by at most the digits they have."""
    # links.yaml is rounded to 12 digits, and I19 .. I21 are differences of inertias near 1e-3
    for name, (left, right) in findings.ties(fitted()).items():
        assert left == pytest.approx(right, rel=1e-6), name
    for name, (left, right) in findings.ties(findings.printed_constants()).items():
        assert 1e-3 < abs(left / right - 1) < 0.03, name


def test_equation_8() -> None:
    """(8) is Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d), modified DH; (3)-(5) are standard DH: two conventions."""
    alpha, a, d, theta = 0.7, 0.3, -0.4, 2.1
    printed = " ".join(EQUATIONS[8].split()).split(r"\begin{bmatrix}")[1].split(r"\end")[0]
    c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    pieces = {r"C\theta_i": c, r"S\theta_i": s, r"C\alpha_{i-1}": ca, r"S\alpha_{i-1}": sa, "a_{i-1}": a, "d_i": d}
    for row, wanted in zip(printed.split(r"\\"), modified(alpha, a, d, np.array(theta)), strict=True):
        for entry, value in zip(row.split("&"), wanted, strict=True):
            rest, product = entry.strip(), 1.0
            for name, factor in pieces.items():
                if name in rest:
                    rest, product = rest.replace(name, "").strip(), product * factor
            product *= {"": 1.0, "-": -1.0, "0": 0.0, "1": 1.0}[rest]
            assert value == pytest.approx(product, abs=1e-15)
    U = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    V = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    np.testing.assert_allclose(standard(alpha, a, d, np.array(theta))[:3, :3], U @ V, atol=1e-15)
    np.testing.assert_allclose(modified(alpha, a, d, np.array(theta))[:3, :3], V @ U, atol=1e-15)
    assert np.abs(U @ V - V @ U).max() > 0.1


def test_repaired_forward_kinematics() -> None:
    """The repaired (11)-(22) are a rotation and a standard-DH arm; in mapped coordinates they are the dynamics' arm."""
    q = np.random.default_rng(8).uniform(-np.pi, np.pi, (200, 6))
    own = chains.repaired(q)
    R = own[:, :3, :3]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (200, 1, 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(own, standard_chain(chains.PAPER_CHAIN, q), rtol=0, atol=1e-14)
    mapped, arm = chains.repaired(chains.to_paper(q)), standard_chain(chains.wrist(table2(a3_as_printed=False)), q)
    np.testing.assert_allclose(mapped[:, :3, :3], arm[:, :3, :3], rtol=0, atol=1e-14)
    # lengths are rounded to 0.1 mm in (20)-(22): 0.43307 -> 0.4331, 0.14909 -> 0.1491
    np.testing.assert_allclose(mapped[:, :3, 3], arm[:, :3, 3], rtol=0, atol=4.1e-5)


def test_which_pose_equations_are_wrong() -> None:
    """Six of (11)-(22) are misprinted; literally they are no rotation and can even mirror."""
    assert {n for n in POSE if chains.pose_error(n) > 0} == {11, 12, 14, 15, 20, 21}
    # (20): |cos(theta2 cos theta1) - cos theta2 cos theta1| is 2 at theta1 = pi, theta2 = 0 (cos 0 = 1 against -1)
    assert chains.pose_error(20) == pytest.approx(2 * 0.4318, rel=1e-6)
    assert chains.pose_error(21) == pytest.approx(0.0006, rel=1e-6)
    gaps = chains.pose_gaps()
    assert gaps["defect"] > 1
    assert gaps["least"] < -1


def test_tables_are_the_paper() -> None:
    """`constants.yaml` holds Tables 2, 3 and 4, digit for digit."""
    data = read("constants.yaml")
    angles = {"0": 0.0, r"\pi/2": math.pi / 2, r"-\pi/2": -math.pi / 2}
    for row, line in zip(data["dh"]["rows"], TABLE_2, strict=True):
        link, theta, alpha, a, d = line.split(" & ")
        assert (row["joint"], theta) == (int(link), rf"\theta_{link}")
        assert (row["alpha"], row["a"], row["d"]) == (angles[alpha], float(a), float(d))
    rows = data["inertial"] | data["motor"] | data["gravitational"]
    assert len(rows) == len(TABLES_3_AND_4)
    for line in TABLES_3_AND_4:
        name, value = line.split(" = ")
        row = rows[name.replace("_", "").replace("{", "").replace("}", "")]
        assert [row["value"], row["tolerance"]] == [float(x) for x in value.split(r" \pm ")]
