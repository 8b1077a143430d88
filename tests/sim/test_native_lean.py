"""The lean step is `mujoco.mj_step` in every byte, on arms of hinges, slides and motors."""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.sim.arm_files import LEAN, plant_from, start_of
from torquebench.kernel import Array
from torquebench.sim.plants import INTEGRATORS, NativePlant
from torquebench.sim.plants.mujoco import MujocoPlant

SUBSTEPS = (1, 1, 2, 1, 5)
"""Physics steps under one torque, in turn."""


def stepper(native: NativePlant) -> Callable[[Array, int, int], int]:
    """Return the native step (torque (3, n), substeps, varying), called by its address as the compiled loop does."""
    call = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)(native.step.address)
    return lambda torque, substeps, varying: call(native.structure.address, torque.ctypes.data, substeps, varying)


def unequal_steps(plant: MujocoPlant, n_steps: int) -> tuple[int, Array]:
    """Count the steps after which the plant's own step and `mj_step` leave different bytes; return the motion too.

    Both get the same torque: weak feedback of the first one's state, which keeps the arm in bounds, and noise.
    """
    native, m = plant.native(), copy.copy(plant._m)
    d, n, step = mujoco.MjData(m), plant.n, stepper(native)
    plant.reset(*start_of(n))
    d.qpos[:], d.qvel[:] = start_of(n)
    mujoco.mj_forward(m, d)
    mass = np.zeros((n, n))
    mujoco.mj_fullM(m, d, mass)
    noise = 20.0 * np.diag(mass) * np.random.default_rng(17).normal(size=(n_steps, n))
    stiff, viscous = 60.0 * np.diag(mass), 6.0 * np.diag(mass)
    torque, unequal, motion, done = np.zeros((3, n)), 0, np.zeros((n_steps, n)), 0
    while done < n_steps:
        torque[:] = noise[done] - stiff * native.q - viscous * native.qd
        substeps = SUBSTEPS[done % len(SUBSTEPS)]
        step(torque, substeps, 0)
        d.qfrc_applied[:] = torque[0]
        mujoco.mj_step(m, d, substeps)
        unequal += native.q.tobytes() != d.qpos.tobytes() or native.qd.tobytes() != d.qvel.tobytes()
        motion[done : done + substeps] = native.q
        done += substeps
    return unequal, motion


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", LEAN)
def test_the_lean_step_is_mj_step(name: str, integrator: str, size: Any, figure: Any, tmp_path: Path) -> None:
    """After every step the state has the bytes that `mj_step` gives, and the arm does move."""
    n_steps = size(2000, 100_000)
    plant = plant_from(LEAN[name](), tmp_path, integrator)
    assert plant.native().structure.lean  # type: ignore[attr-defined]
    unequal, motion = unequal_steps(plant, n_steps)
    if n_steps > 2000 or name in ("puma560", "branches"):
        figure(f"steps unequal to mj_step, {name}, {integrator}, {n_steps} steps", unequal, "0")
    assert unequal == 0
    assert np.all(np.ptp(motion, axis=0) > 0.05)


def payload(m: Any, d: Any) -> None:
    """Add 2 kg to the last body, off its centre."""
    m.body_mass[-1] += 2.0
    m.body_ipos[-1] += [0.01, 0.02, 0.05]
    mujoco.mj_setConst(m, d)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("arm", ["puma560", "two-link"])
def test_the_lean_step_of_a_changed_model_is_mj_step(arm: str, integrator: str) -> None:
    """A model changed in memory, as for a payload, is stepped as changed; and the change shows in the motion."""
    plain, plant = (MujocoPlant(arm, 0.001, integrator) for _ in range(2))
    payload(plant._m, plant._d)
    assert plant.native().structure.lean  # type: ignore[attr-defined]
    unequal, motion = unequal_steps(plant, 500)
    assert unequal == 0
    assert motion.tobytes() != unequal_steps(plain, 500)[1].tobytes()


def test_the_comparison_sees_one_ulp() -> None:
    """A mass changed by one unit in the last place, on one side only, makes steps unequal."""
    plant = MujocoPlant("puma560")
    plant.native()
    real = copy.copy

    class Shifted:
        """Hands out copies of models with the last mass one ulp larger."""

        @staticmethod
        def copy(m: Any) -> Any:
            twin = real(m)
            twin.body_mass[-1] = np.nextafter(twin.body_mass[-1], np.inf)
            return twin

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.sim.test_native_lean.copy", Shifted)
        assert unequal_steps(plant, 500)[0] > 0
