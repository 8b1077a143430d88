"""Arms that the lean step must not serve: they take the whole of `mj_step`, and both paths still agree."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.arms import chain, pack
from tests.sampled import sampled_trial, simulate_sampled
from tests.sim.arm_files import LEAN, REFUSED, plant_from, start_of
from tests.sim.protocol import differing_bytes
from tests.sim.test_native_lean import stepper
from torquebench.chain import CHAINS, IDEAL, Chain
from torquebench.references import Sine
from torquebench.robot import RobotModel
from torquebench.sim.friction import NONE
from torquebench.sim.joints import rigid
from torquebench.sim.plants import INTEGRATORS, NativePlant, mujoco_native
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.simulate import simulate_many
from torquebench.sim.trajectory import Outcome, Trajectory

HARMLESS = {"a mocap body", "a motor's armature"}
"""Refused although the step would be equal: nothing moves the one, and MuJoCo's mass matrix has the other in it."""


def anything(n: int) -> RobotModel:
    """Return a belief for laws that use only its scale."""
    ones = np.ones(n)
    return chain(ones, ones, ones, ones, ones, 40.0 * ones, ones)


def run_of(plant: MujocoPlant, path: Any, actuators: Chain = IDEAL) -> Trajectory:
    """Return 0.15 s of PD control, started away from home so that limits and contacts are met."""
    n = plant.n
    return simulate_sampled(
        plant,
        pack("pd", n, lam=8, kv=12),
        anything(n),
        Sine(0.8, 2.0),
        duration=0.15,
        chain=actuators,
        initial_q=start_of(n)[0],
        path=path,
        throw=False,
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", REFUSED)
def test_refused_arms_take_the_whole_step_and_both_paths_agree(name: str, integrator: str, tmp_path: Path) -> None:
    """The lean step is off; the two paths, and a lagging actuator's varying torque on both, differ in no byte."""
    plant = plant_from(REFUSED[name](), tmp_path, integrator)
    native = plant.native()
    assert not native.structure.lean  # type: ignore[attr-defined]
    for actuators in (IDEAL, CHAINS["slow"]):
        readable, compiled = run_of(plant, "python", actuators), run_of(plant, "native", actuators)
        assert (readable.completed, compiled.path) == (True, "native")
        assert differing_bytes(readable, compiled) == 0


def steps(plant: MujocoPlant, native: NativePlant) -> bytes:
    """Return the states of 150 steps under weak noise."""
    out, noise, step = [], np.random.default_rng(2).normal(size=(150, plant.n)), stepper(native)
    plant.reset(*start_of(plant.n))
    for row in noise:
        step(np.tile(row, (3, 1)), 1, 0)
        out.append(native.q.tobytes() + native.qd.tobytes())
    return b"".join(out)


@pytest.mark.parametrize("name", REFUSED)
def test_the_refusals_are_needed(name: str, tmp_path: Path) -> None:
    """Forced upon such an arm, the lean step gives other bytes, so that each arm here has what it is named for."""
    plant = plant_from(REFUSED[name](), tmp_path)
    native = plant.native()
    forced = native._replace(structure=mujoco_native._stepped(plant._m, plant._d, NONE, rigid(plant.n), True))
    assert (steps(plant, native) == steps(plant, forced)) == (name in HARMLESS)


@pytest.mark.parametrize("name", [n for n in REFUSED if n not in HARMLESS])
def test_the_proof_alone_refuses_them(name: str, tmp_path: Path) -> None:
    """The proof on the arm at hand notices, without the list of features, whatever acts in its few steps."""
    plant = plant_from(REFUSED[name](), tmp_path)
    assert not mujoco_native._lean_is_equal(plant._m)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", [*LEAN, *REFUSED])
def test_a_varying_torque_that_does_not_vary_is_the_held_torque(name: str, integrator: str, tmp_path: Path) -> None:
    """Stage by stage with three equal rows, interpreted and compiled, the step is `mj_step` in every byte."""
    text = (LEAN | REFUSED)[name]()
    plant = plant_from(text, tmp_path, integrator)
    native, n = plant.native(), plant.n
    m = copy.copy(plant._m)
    d, step, rng = mujoco.MjData(m), stepper(native), np.random.default_rng(8)
    rows = [np.tile(rng.normal(size=n), (3, 1)) for _ in range(100)]
    d.qpos[:], d.qvel[:] = start_of(n)
    wanted = []
    for row in rows:
        d.qfrc_applied[:] = row[0]
        mujoco.mj_step(m, d)
        wanted.append(d.qpos.tobytes() + d.qvel.tobytes())
    for move in (lambda row: plant.step(row, 1), lambda row: step(row, 1, 1)):
        plant.reset(*start_of(n))
        got = []
        for row in rows:
            move(row)
            q, qd = plant.state()
            got.append(q.tobytes() + qd.tobytes())
        assert got == wanted


@pytest.mark.parametrize("name", ["an equality", "a spring"])
def test_a_refused_arm_that_diverges_ends_at_its_step(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo's own warning of a bad state, from several threads without the interpreter's lock, stops nothing.

    Each run ends at the step at which it was pushed, with the same bytes on both paths, and no log file is written.
    """
    plant, pushes = plant_from(REFUSED[name](), tmp_path), []
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    for at in range(5, 25):
        push = np.zeros((50, 3))
        push[at, at % 3] = (1e300, -1e12, 1.7e308)[at % 3]
        pushes.append(sampled_trial(pack("pd", 3, lam=8, kv=12), anything(3), Sine(0.8, 2.0), 0.05, disturbance=push))
    runs = {
        (path, workers): list(simulate_many(plant, pushes, workers=workers, path=path))  # type: ignore[arg-type]
        for path, workers in (("python", 1), ("native", 1), ("native", 4))
    }
    for kept in runs.values():
        assert [(run.outcome, run.failed_at) for run in kept] == [(Outcome.DIVERGED, at) for at in range(5, 25)]
    assert len({tuple(run.digest() for run in kept) for kept in runs.values()}) == 1
    assert list(Path.cwd().iterdir()) == []


def ulp(x: Any) -> Any:
    """Return numbers one unit in the last place larger."""
    return np.nextafter(x, np.inf)


WRONG: dict[str, Callable[[Any], dict[str, Any]]] = {
    "time step": lambda arm: {"timestep": float(ulp(arm.timestep))},
    "integrator": lambda arm: {"rk4": not arm.rk4},
    "mass matrix": lambda arm: {"M": ulp(arm.M)},
}
"""Something of the lean step that is wrong, by no more than one ulp where it is a number."""


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("wrong", WRONG)
def test_a_lean_step_that_is_wrong_by_an_ulp_is_not_used(
    wrong: str, integrator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The proof fails, the whole of `mj_step` is used instead, and the run is the readable path's to the byte."""
    real = mujoco_native._stepped
    plant = MujocoPlant("puma560", 0.001, integrator)
    assert plant.replica().native().structure.lean  # type: ignore[attr-defined]

    def spoilt(m: Any, d: Any, friction: Any, joints: Any, lean: bool) -> Any:
        arm = real(m, d, friction, joints, lean)
        return replace(arm, **WRONG[wrong](arm)) if lean else arm

    monkeypatch.setattr(mujoco_native, "_stepped", spoilt)
    assert not plant.native().structure.lean  # type: ignore[attr-defined]
    assert differing_bytes(run_of(plant, "python"), run_of(plant, "native")) == 0
