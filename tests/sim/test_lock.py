"""A joint that locks: against Pinocchio's arm without that joint, and the momentum that the others keep."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.arms import pack
from tests.errata.independent import Arm
from tests.sampled import simulate_sampled
from tests.sim.protocol import HOME, REFERENCES, differing_bytes
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot import Puma560
from torquebench.robot.lock import Lock
from torquebench.robot.payload import Payload
from torquebench.sim.joints import Transmission
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.trajectory import Trajectory

LAW = pack("linear-band-smc", 6, lam=10, k=0.3, phi=0.3, kv=20)
JOINT, AT = 2, 0.1
LOCK = Lock(JOINT + 1, AT)
OTHERS = np.arange(6) != JOINT


def plants(**options: Any) -> dict[str, Any]:
    """Return the PUMA on both engines."""
    return {"mujoco": MujocoPlant("puma560", **options), "analytic": AnalyticPlant(Puma560(), **options)}


def run_of(plant: Any, path: Any = "native", duration: float = 0.25) -> Trajectory:
    """Return a run of a sine from a bent pose."""
    return simulate_sampled(
        plant, LAW, Puma560(), REFERENCES["sine"](6), duration=duration, initial_q=np.array(HOME), path=path
    )


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_the_others_move_as_in_an_arm_without_it(engine: str) -> None:
    """From the lock on, Pinocchio's M and N without that row and column, under the same torques, give every state.

    Runge-Kutta on both sides at the same steps: 1e-9 rad is what the brake's motor of 1e12 kg m^2 and rounding leave.
    """
    run, arm = run_of(plants(lock=LOCK)[engine]), Arm()
    k0 = round(AT / 0.001)
    q, qd = run.q[k0].copy(), run.qd[k0].copy()

    def rate(state: tuple[Array, Array], tau: Array) -> tuple[Array, Array]:
        M, N = arm.mass_matrix(state[0]), arm.bias(*state)
        qdd = np.zeros(6)
        qdd[OTHERS] = np.linalg.solve(M[np.ix_(OTHERS, OTHERS)], (tau - N)[OTHERS])
        return state[1], qdd

    h, worst = 0.001, 0.0
    for k in range(k0, len(run.t)):
        worst = max(worst, float(np.max(np.abs(run.q[k] - q))))
        tau, (v1, a1) = run.tau[k], rate((q, qd), run.tau[k])
        v2, a2 = rate((q + h / 2 * v1, qd + h / 2 * a1), tau)
        v3, a3 = rate((q + h / 2 * v2, qd + h / 2 * a2), tau)
        v4, a4 = rate((q + h * v3, qd + h * a3), tau)
        q, qd = q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4), qd + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    assert worst < 1e-9
    assert np.ptp(run.q[:k0, JOINT]) > 0.01
    assert np.max(np.abs(run.q[-1, OTHERS] - run.q[k0, OTHERS])) > 0.01


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_the_brake_takes_its_momentum_alone(engine: str) -> None:
    """At the instant its speed is zero, and the momenta M qd of the other joints are what they were; 1e-12 of them."""
    free, locked = (run_of(plants(lock=lock)[engine]) for lock in (None, LOCK))
    k0, arm = round(AT / 0.001), Arm()
    assert locked.q[: k0 + 1].tobytes() == free.q[: k0 + 1].tobytes()
    M = arm.mass_matrix(free.q[k0])
    before, after = M @ free.qd[k0], M @ locked.qd[k0]
    assert locked.qd[k0, JOINT] == 0.0
    assert after[OTHERS] == pytest.approx(before[OTHERS], rel=1e-10, abs=1e-12)
    assert abs(after[JOINT] - before[JOINT]) > 0.01


def test_plants_agree_and_paths_are_equal() -> None:
    """With a payload that is taken up at another instant: 0 differing bytes, also of a replica; engines to 1e-9 rad."""
    both = plants(lock=LOCK, payload=Payload(2.0, 0.15))
    native = {engine: run_of(plant) for engine, plant in both.items()}
    for engine, plant in both.items():
        assert plant.changes == (0.1, 0.15)
        assert differing_bytes(native[engine], run_of(plant, "python")) == 0
        assert run_of(plant.replica()).digest() == run_of(plant).digest() == native[engine].digest()
    assert np.max(np.abs(native["mujoco"].q - native["analytic"].q)) < 1e-9


def test_with_a_transmission_the_motor_is_held() -> None:
    """The brake sits on the motor: that stays where it is, and its link swings on the spring."""
    gives = Transmission(stiffness=(4e3, 4e3, 4e3, 300.0, 300.0, 100.0), damping=0.02, inertia=0.5)
    for plant in plants(lock=LOCK, transmission=gives, timestep=0.00025).values():
        run = run_of(plant)
        k0 = round(AT / 0.001)
        assert np.ptp(run.motor_q[k0:, JOINT]) < 1e-9  # type: ignore[index]
        assert np.ptp(run.q[k0:, JOINT]) > 1e-4


def test_a_closed_form_has_no_motor_to_hold() -> None:
    """Structure corrected has constants, not links: refused."""
    with pytest.raises(ModelError, match="no motor"):
        AnalyticPlant(Puma560("corrected"), lock=LOCK)
