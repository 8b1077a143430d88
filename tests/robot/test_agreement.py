"""Three implementations of the exact arm agree: this package, MuJoCo, Pinocchio."""

import numpy as np
import pinocchio
import pytest

from tests.errata.independent import Arm
from torquebench import Puma560
from torquebench.comparison import random_states
from torquebench.sim.plants.mujoco import MujocoModel

RELATIVE = 1e-12
"""Round-off of six links is a few 1e-15; terms that cancel to a small norm lose up to two digits more."""


@pytest.fixture(scope="module")
def states():
    """10^4 random states of all six joints."""
    return random_states(6, 10_000, seed=1)


@pytest.fixture(scope="module")
def arm():
    """The analytic arm."""
    return Puma560()


@pytest.fixture(scope="module")
def engine():
    """MuJoCo's arm."""
    return MujocoModel("puma560")


def relative(x, y):
    """Largest norm of the difference over the norm, state by state."""
    axes = tuple(range(1, x.ndim))
    return np.max(np.sqrt(np.sum((x - y) ** 2, axis=axes) / np.sum(y**2, axis=axes)))


def test_mass_matrix_is_mujocos(arm, engine, states, figure):
    """M(q), armature included, over 10^4 states."""
    gap = relative(arm.mass_matrix(states[0]), engine.mass_matrix(states[0]))
    figure("M, MuJoCo against exact, relative", gap, "<= 1e-12")
    assert gap <= RELATIVE


def test_gravity_is_mujocos(arm, engine, states, figure):
    """g(q) over 10^4 states."""
    gap = relative(arm.gravity(states[0]), engine.gravity(states[0]))
    figure("gravity, MuJoCo against exact, relative", gap, "<= 1e-12")
    assert gap <= RELATIVE


def test_velocity_terms_are_mujocos(arm, engine, states, figure):
    """b(q) [qd qd] + C(q) [qd^2], from the two matrices, is MuJoCo's bias less its gravity."""
    q, qd, _ = states
    first, second = np.triu_indices(6, 1)
    ours = np.einsum("nij,nj->ni", arm.coriolis(q), qd[:, first] * qd[:, second])
    ours += np.einsum("nij,nj->ni", arm.centrifugal(q), qd * qd)
    theirs = engine.bias_forces(q, qd) - engine.gravity(q)
    # MuJoCo's term is the difference of two numbers up to 46 N m, so its own round-off is 1e-14 N m absolute
    largest = np.max(np.linalg.norm(ours - theirs, axis=1)) / np.sqrt(np.mean(np.sum(theirs**2, axis=1)))
    figure("Coriolis + centrifugal, MuJoCo against exact, over rms norm", largest, "<= 1e-12")
    figure("the same, state by state, relative", relative(ours, theirs), "<= 1e-12")
    assert largest <= RELATIVE


def test_inverse_dynamics_is_mujocos(arm, engine, states, figure):
    """tau(q, qd, qdd) against mj_inverse over 10^4 states."""
    gap = relative(arm.inverse_dynamics(*states), engine.inverse_dynamics(*states))
    figure("inverse dynamics, MuJoCo against exact, relative", gap, "<= 1e-12")
    assert gap <= RELATIVE


def test_tool_pose_is_mujocos(arm, engine, states):
    """Rotation and position of the tool, to round-off of a product of seven poses."""
    assert np.max(np.abs(arm.forward_kinematics(states[0]) - engine.forward_kinematics(states[0]))) <= 1e-14


def test_inverse_dynamics_is_pinocchios(arm, states, figure):
    """tau(q, qd, qdd) against Pinocchio's rnea on an arm built by hand from links.yaml."""
    pin = Arm()
    theirs = np.array([pinocchio.rnea(pin.model, pin.data, *state) for state in zip(*states, strict=True)])
    gap = relative(arm.inverse_dynamics(*states), theirs)
    figure("inverse dynamics, Pinocchio against exact, relative", gap, "<= 1e-12")
    assert gap <= RELATIVE


def test_mass_matrix_is_pinocchios(arm, states, figure):
    """M(q) against Pinocchio's crba."""
    pin = Arm()
    theirs = np.array([pin.mass_matrix(q) for q in states[0]])
    gap = relative(arm.mass_matrix(states[0]), theirs)
    figure("M, Pinocchio against exact, relative", gap, "<= 1e-12")
    assert gap <= RELATIVE
