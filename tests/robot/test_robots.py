"""The UR5e, the FR3 and the iiwa 14: the makers' tables of frames, Pinocchio's dynamics, and both plants."""

import numpy as np
import pinocchio
import pytest

from torquebench.comparison import random_states
from torquebench.robot import load_model
from torquebench.robot.library import file_of_arm
from torquebench.robot.loading import keyframes

ARMS = {"ur5e": 6, "fr3": 7, "iiwa14": 7}
HALF = np.pi / 2

# (alpha, a, d) of each row; standard: Universal Robots, "DH parameters for calculations of kinematics and dynamics"
STANDARD = {
    "ur5e": [(HALF, 0, 0.1625), (0, -0.425, 0), (0, -0.3922, 0), (HALF, 0, 0.1333), (-HALF, 0, 0.0997), (0, 0, 0.0996)],
}
# Modified rows (Craig), then the flange: Franka, "Denavit-Hartenberg parameters"; KUKA's lengths 360, 420, 400, 126 mm
MODIFIED = {
    "fr3": [(0, 0, 0.333), (-HALF, 0, 0), (HALF, 0, 0.316), (HALF, 0.0825, 0), (-HALF, -0.0825, 0.384), (HALF, 0, 0)]
    + [(HALF, 0.088, 0), (0, 0, 0.107)],
    "iiwa14": [(0, 0, 0.36), (-HALF, 0, 0), (HALF, 0, 0.42), (HALF, 0, 0), (-HALF, 0, 0.4), (-HALF, 0, 0)]
    + [(HALF, 0, 0), (0, 0, 0.126)],
}


def turn_z(angle: float) -> np.ndarray:
    """Turn about z, (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def turn_x(alpha: float, a: float) -> np.ndarray:
    """Turn about x, and shift along it, (4, 4)."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def shift_z(d: float) -> np.ndarray:
    """Shift along z, (4, 4)."""
    return np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, d], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("name", ARMS)
def test_the_tool_is_where_the_makers_table_has_it(name: str) -> None:
    """Denavit-Hartenberg rows of the maker at random angles, in place and direction, but for round-off."""
    for q in random_states(ARMS[name], 50, seed=3)[0]:
        frame = np.eye(4)
        for angle, (alpha, a, d) in zip(q, STANDARD.get(name, ()), strict=False):
            frame = frame @ turn_z(angle) @ shift_z(d) @ turn_x(alpha, a)
        for angle, (alpha, a, d) in zip([*q, 0.0], MODIFIED.get(name, ()), strict=False):
            frame = frame @ turn_x(alpha, a) @ turn_z(angle) @ shift_z(d)
        assert load_model(name).forward_kinematics(q) == pytest.approx(frame, abs=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_inverse_dynamics_are_pinocchios(name: str) -> None:
    """tau(q, qd, qdd) of Pinocchio on the same file, reflected inertias included, to 1e-12 of the largest."""
    model, arm = pinocchio.buildModelFromMJCF(str(file_of_arm(name).origin)), load_model(name)
    states = random_states(ARMS[name], 200, seed=4)
    ours = arm.inverse_dynamics(*states)
    theirs = np.array([pinocchio.rnea(model, model.createData(), *state) for state in zip(*states, strict=True)])
    assert np.max(np.abs(ours - theirs)) <= 1e-12 * np.max(np.abs(theirs))


@pytest.mark.parametrize(
    ("name", "mass", "limits"),
    [
        ("ur5e", 17.7, [150, 150, 150, 28, 28, 28]),
        ("fr3", 15.4948010262, [87, 87, 87, 87, 12, 12, 12]),
        ("iiwa14", 25.61, [320, 320, 176, 176, 110, 40, 40]),
    ],
)
def test_mass_and_torque_limits(name: str, mass: float, limits: list[float]) -> None:
    """The sum of the published masses of what moves, and the published limits; home is a position."""
    arm = load_model(name)
    assert arm.flat.tau_max == pytest.approx(limits)
    model = pinocchio.buildModelFromMJCF(str(file_of_arm(name).origin))
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(mass, rel=1e-12)
    assert keyframes(name)["home"].shape == (ARMS[name],)
