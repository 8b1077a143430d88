"""The integrators do what their names promise: order, energy."""

import numpy as np
import pytest

from torquebench import AnalyticPlant, MujocoPlant, Puma560

START = np.array([0.3, -0.8, 0.6, 0.4, -0.5, 0.2])
SPEED = np.array([1.0, -0.5, 0.8, 0.5, -0.7, 0.3])


def plants(timestep, integrator="rk4"):
    """Both plants at one time step."""
    return {
        "mujoco": MujocoPlant("puma560", timestep, integrator),
        "analytic": AnalyticPlant(Puma560(), timestep, integrator),
    }


def fall(plant, duration):
    """Position after a free motion from START at SPEED without torque."""
    plant.reset(START, SPEED)
    plant.step(np.zeros(6), round(duration / plant.timestep))
    return plant.state()[0]


def energy(arm, q, qd):
    """Kinetic plus potential energy [J]; potential from the work of gravity along a straight path, by Gauss."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    path = 0.5 * (nodes[:, None] + 1.0) * q
    potential = 0.5 * weights @ (arm.gravity(path) @ q)
    return 0.5 * qd @ arm.mass_matrix(q) @ qd + potential


@pytest.mark.parametrize("name", ["mujoco", "analytic"])
def test_energy_is_kept_without_torque(name, figure):
    """5 s of free motion, RK4 at 1 ms: energy drifts by at most 1e-6 J while tens of joules are exchanged."""
    plant, arm = plants(0.001)[name], Puma560()
    plant.reset(START, SPEED)
    energies, kinetic = [], []
    for _ in range(51):
        q, qd = plant.state()
        energies.append(energy(arm, q, qd))
        kinetic.append(0.5 * qd @ arm.mass_matrix(q) @ qd)
        plant.step(np.zeros(6), 100)
    # the potential is path-independent, so that a straight path from zero will do whatever the arm did
    figure(f"energy drift in 5 s, {name} [J]", np.ptp(energies), "<= 1e-6")
    assert np.ptp(energies) <= 1e-6
    assert np.ptp(kinetic) > 10.0


@pytest.mark.parametrize("name", ["mujoco", "analytic"])
@pytest.mark.parametrize(("integrator", "order", "margin"), [("rk4", 4.0, 0.1), ("euler", 1.0, 0.1)])
def test_observed_order(name, integrator, order, margin, figure):
    """The error of a 1 s free motion falls as timestep^order, slope fitted over four halvings.

    Steps are chosen so that the error is above round-off (1e-14 rad) and below where higher orders show.
    """
    steps = np.array([0.02, 0.01, 0.005, 0.0025] if integrator == "rk4" else [0.002, 0.001, 0.0005, 0.00025])
    truth = fall(AnalyticPlant(Puma560(), 0.00025, "rk4"), 1.0)
    errors = [np.linalg.norm(fall(plants(h, integrator)[name], 1.0) - truth) for h in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    figure(f"observed order, {integrator}, {name}", slope, f"{order:g} +- {margin:g}")
    assert abs(slope - order) <= margin
