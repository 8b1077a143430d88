"""A lagging actuator inside the integrator, against plain `mj_step` with a torque that depends on MuJoCo's clock."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.arms import pack
from tests.sampled import simulate_sampled
from tests.sim.arm_files import LEAN, REFUSED, plant_from, start_of
from tests.sim.protocol import HOME, REFERENCES, differing_bytes
from tests.sim.test_native_refused import anything
from torquebench.chain import CHAINS, Chain
from torquebench.kernel import Array
from torquebench.references import Sine
from torquebench.robot import Puma560
from torquebench.sim.plants import INTEGRATORS
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.trajectory import Trajectory

N_STEPS = 150
LAG = 0.008
ARMS = (
    "puma560",
    "two-link",
    "hinges and slides",
    "branches",
    "enforced limits",
    "contacts",
    "a spring",
    "an equality",
    "a fluid",
    "a stiff tendon",
)


@contextmanager
def control(callback: Any) -> Iterator[None]:
    """Let MuJoCo ask `callback(m, d)` for the torque at each stage of its own integrator."""
    mujoco.set_mjcb_control(callback)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(None)


def lagging_run(plant: MujocoPlant, substeps: int, path: Any) -> tuple[Trajectory, Array]:
    """Return a run whose actuators lag, with a disturbance after the lag, and the disturbance."""
    n = plant.n
    disturbance = np.random.default_rng(9).normal(size=(N_STEPS, n))
    run = simulate_sampled(
        plant,
        pack("pd", n, lam=8, kv=12),
        anything(n),
        Sine(0.8, 2.0),
        duration=N_STEPS * substeps * plant.timestep,
        control_period=substeps * plant.timestep,
        chain=Chain(actuator_lag=LAG),
        disturbance=disturbance,
        initial_q=start_of(n)[0],
        path=path,
    )
    return run, disturbance


def by_mujoco(plant: MujocoPlant, run: Trajectory, disturbance: Array, substeps: int, exact: bool) -> Array:
    """Return the positions that plain `mj_step` gives under u(t) = tau + (u0 - tau) exp(-t/lag), t on MuJoCo's clock.

    Args:
        plant: The arm, its time step and integrator.
        run: Where the clipped torque tau of each control instant is taken from.
        disturbance: Added to u.
        substeps: Physics steps in a control period.
        exact: Whether t counts from the control instant, as it is; else from the last physics step, in halves of one:
            then each number is the rounded value of the same expression as in the loop, and can be compared in bytes.
    """
    m, h = copy.copy(plant._m), plant.timestep
    d = mujoco.MjData(m)
    d.qpos[:] = start_of(plant.n)[0]
    u, since, k = np.zeros(plant.n), 0.0, 0
    positions = [d.qpos.copy()]

    def torque(model: Any, data: Any) -> None:
        elapsed = data.time - since if exact else round((data.time - since) / (0.5 * h)) * (0.5 * h)
        output = u if elapsed == 0.0 else run.tau[k] + (u - run.tau[k]) * math.exp(-elapsed / LAG)
        data.qfrc_applied[:] = output + disturbance[k]

    with control(torque):
        for k in range(N_STEPS - 1):
            for _ in range(1 if exact else substeps):
                mujoco.mj_step(m, d, substeps if exact else 1)
                elapsed = substeps * h if exact else h
                u, since = run.tau[k] + (u - run.tau[k]) * math.exp(-elapsed / LAG), d.time
            positions.append(d.qpos.copy())
    return np.array(positions)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("name", ARMS)
def test_lag_is_mj_step_with_a_torque_of_time(name: str, substeps: int, integrator: str, tmp_path: Path) -> None:
    """In every byte, on both paths, whether the arm has the lean step or not."""
    plant = plant_from((LEAN | REFUSED)[name](), tmp_path, integrator)
    run, disturbance = lagging_run(plant, substeps, "native")
    wanted = by_mujoco(plant, run, disturbance, substeps, exact=False)
    assert run.q.tobytes() == wanted.tobytes()
    assert differing_bytes(run, lagging_run(plant, substeps, "python")[0]) == 0
    assert np.all(np.ptp(run.q, axis=0) > 0.01)


@pytest.mark.parametrize("substeps", [1, 4])
def test_lag_is_the_exact_exponential(substeps: int, figure: Any, tmp_path: Path) -> None:
    """With t from the control instant and MuJoCo's clock as it is: within 1e-12 rad, rounding of 600 steps.

    A lag of one more per cent moves the arm by more than 1e-6 rad, so that the bound is a strict one.
    """
    plant = plant_from(LEAN["puma560"](), tmp_path)
    run, disturbance = lagging_run(plant, substeps, "native")
    gap = np.max(np.abs(run.q - by_mujoco(plant, run, disturbance, substeps, exact=True)))
    figure(f"lag against MuJoCo under the exact exponential, x{substeps} [rad]", gap, "<= 1e-12")
    assert gap <= 1e-12
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.sim.test_native_lag.LAG", LAG * 1.01)
        assert np.max(np.abs(run.q - by_mujoco(plant, run, disturbance, substeps, exact=True))) > 1e-6


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("chain", ["fast", "slow"])
def test_both_plants_agree_under_lag(chain: str, integrator: str, figure: Any) -> None:
    """MuJoCo and the analytic plant, each on both paths, 1 s on the protocol's sine: joint angles within 1e-12 rad."""
    arm, q = Puma560(), []
    for plant in (MujocoPlant("puma560", 0.001, integrator), AnalyticPlant(arm, 0.001, integrator)):
        for path in ("python", "native"):
            run = simulate_sampled(
                plant,
                pack("linear-band-smc", 6, lam=10, k=0.3, phi=0.3, kv=20),
                Puma560("corrected", "printed"),
                REFERENCES["sine"](6),
                duration=1.0,
                chain=CHAINS[chain],
                initial_q=np.array(HOME),
                path=path,  # type: ignore[arg-type]
            )
            q.append(run.q)
    gap = max(float(np.max(np.abs(x - q[0]))) for x in q[1:])
    figure(f"MuJoCo against analytic under lag, {chain}, {integrator} [rad]", gap, "<= 1e-12")
    assert q[0].tobytes() == q[1].tobytes()
    assert q[2].tobytes() == q[3].tobytes()
    assert gap <= 1e-12
