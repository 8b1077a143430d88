"""Joint friction: closed forms, energy, MuJoCo's own damping, and a torque that every stage evaluates anew."""

from __future__ import annotations

import copy
import math
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from tests.arms import pack, slider
from tests.errata.independent import Arm
from tests.sampled import simulate_sampled
from tests.sim.arm_files import LEAN, REFUSED, RUBBING, plant_from, start_of
from tests.sim.protocol import HOME, REFERENCES, differing_bytes
from tests.sim.test_native_lag import control
from tests.sim.test_native_refused import anything
from torquebench.chain import IDEAL, Chain
from torquebench.kernel import Array
from torquebench.references import Sine
from torquebench.robot import Puma560
from torquebench.shipped import data_root
from torquebench.sim.friction import FRICTIONS, STABLE, Friction
from torquebench.sim.plants import INTEGRATORS
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoModel, MujocoPlant
from torquebench.sim.trajectory import Trajectory

VISCOUS = (5.80, 9.50, 3.98, 0.412, 0.427, 0.216)
COULOMB = (26.0, 10.6, 6.36, 1.07, 0.854, 0.554)
PUMA = Friction(VISCOUS, COULOMB)
"""Friction of the PUMA [N m s/rad, N m], worked out by hand from the motors' that was published."""
BOTH = Friction(0.7, 0.9, 0.02)


def plants(friction: Friction, timestep: float = 0.001, integrator: str = "rk4") -> dict[str, Any]:
    """Return the PUMA on both plants."""
    return {
        "mujoco": MujocoPlant("puma560", timestep, integrator, friction=friction),
        "analytic": AnalyticPlant(Puma560(), timestep, integrator, friction=friction),
    }


def test_the_friction_of_the_puma_is_that_of_its_motors_through_its_gears() -> None:
    """B G^2 and G times the mean of Coulomb's in both directions, within half a unit of the third digit.

    The motors' are those of Corke and Armstrong-Helouvry (ICRA 1994), from the robotics toolbox's Puma560.py. What is
    assumed of a PUMA that sticks is a multiple of its Coulomb friction.
    """
    G = np.array([62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686])
    B = np.array([1480, 817, 1380, 71.2, 82.6, 36.7]) * 1e-6
    backward = np.array([395, 126, 132, 11.2, 9.26, 3.96]) * 1e-3
    forward = np.array([435, 71, 105, 16.9, 14.5, 10.5]) * 1e-3
    puma, sticking = FRICTIONS["puma560"], FRICTIONS["puma560-sticking"]
    assert puma == PUMA
    np.testing.assert_allclose(puma.viscous, B * G**2, rtol=5e-3, atol=0)
    np.testing.assert_allclose(puma.coulomb, 0.5 * (backward + forward) * G, rtol=5e-3, atol=0)
    for factor, name in ((1.5, "breakaway"), (1000.0, "bristle_stiffness"), (5.0, "bristle_damping")):
        np.testing.assert_allclose(getattr(sticking, name), factor * np.array(COULOMB), rtol=1e-15)


def test_no_shipped_config_writes_the_friction_of_the_puma_out() -> None:
    """It has a name, so that a correction of it reaches every config."""
    for path in sorted((data_root() / "configs").rglob("*.yaml")):
        numbers = re.findall(r"(viscous|coulomb): \[([\d., ]+)\]", path.read_text())
        for key, text in numbers:
            values = [float(x) for x in text.split(",")]
            near = np.isclose(values, getattr(PUMA, key), rtol=0.05) if len(values) == 6 else [False]
            assert not np.sum(near) >= 3, f"{path.name}: {key} {text}"


def test_a_mass_slows_down_as_it_must() -> None:
    """2 kg at 1 m/s under 3 N of Coulomb friction: v = 1 - 1.5 t down to 0.01 m/s, then v = 0.01 exp(-150 t).

    Runge-Kutta's method is exact for the first; for the second (h rate)^5/120 a step, 6e-7 of the speed at 1 ms.
    """
    plant = AnalyticPlant(slider(2.0), 0.001, friction=Friction(coulomb=3.0))
    plant.reset(np.zeros(1), np.ones(1))
    for k in range(1, 660):
        plant.step(np.zeros(1), 1)
        q, qd = plant.state()
        t = 0.001 * k
        assert qd[0] == pytest.approx(1.0 - 1.5 * t, abs=1e-13)
        assert q[0] == pytest.approx(t - 0.75 * t * t, abs=1e-13)
    plant.step(np.zeros(1), 1)
    start = plant.state()[1][0]
    assert start == pytest.approx(0.01, abs=1e-12)
    for k in range(1, 100):
        plant.step(np.zeros(1), 1)
        assert plant.state()[1][0] == pytest.approx(start * math.exp(-150.0 * 0.001 * k), rel=1e-4)


@pytest.mark.parametrize("torque", [1.0, 2.9, -2.9])
def test_a_joint_creeps_under_less_than_its_coulomb_friction(torque: float) -> None:
    """3 N of Coulomb friction hold a force F to the creeping speed 0.01 F/3, as stated; beyond, it runs away."""
    plant = AnalyticPlant(slider(2.0), 0.001, friction=Friction(coulomb=3.0))
    plant.reset(np.zeros(1), np.zeros(1))
    plant.step(np.array([torque]), 2000)
    assert plant.state()[1][0] == pytest.approx(0.01 * torque / 3.0, rel=1e-9)
    plant.step(np.array([3.1]), 2000)
    assert plant.state()[1][0] > 0.05


@pytest.mark.parametrize("friction", [Friction(VISCOUS), PUMA], ids=["viscous", "both"])
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_the_energy_lost_is_the_friction_s_work(engine: str, friction: Friction, figure: Any) -> None:
    """A free swing of 0.4 s: kinetic and potential energy from Pinocchio fall by the integral of qd . friction.

    The integral is Simpson's over steps of 0.1 ms; the kinks of Coulomb friction leave 1e-6 of the energy lost.
    """
    arm, plant, h = Arm(), plants(friction, 0.0001)[engine], 0.0001
    plant.reset(np.array([0.3, -0.8, 0.6, 0.4, -0.5, 0.2]), np.array([2.0, -1.5, 1.8, 3.0, -2.0, 4.0]))
    states = [plant.state()]
    for _ in range(4_000):
        plant.step(np.zeros(6), 1)
        states.append(plant.state())
    q, qd = (np.array(x) for x in zip(*states, strict=True))
    ends = [
        0.5 * v @ arm.mass_matrix(x) @ v + pin.computePotentialEnergy(arm.model, arm.data, x)
        for x, v in ((q[0], qd[0]), (q[-1], qd[-1]))
    ]
    coulomb = np.asarray(friction.coulomb) * np.clip(qd / 0.01, -1.0, 1.0)
    power = np.sum(qd * (np.asarray(friction.viscous) * qd + coulomb), axis=1)
    weights = np.ones(len(q))
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    lost, work = ends[0] - ends[1], float(weights @ power) * h / 3.0
    figure(f"energy lost against the friction's work, {engine} [J of {work:.3g}]", abs(lost - work), "<= 1e-6 of it")
    assert abs(lost - work) <= 1e-6 * work
    assert work > 5.0


@pytest.mark.parametrize("name", ["puma560", "two-link", "hinges and slides", "branches"])
def test_viscous_friction_is_mujocos_damping(name: str, tmp_path: Path) -> None:
    """0.5 s of free motion, Runge-Kutta: the model with ``dof_damping`` and the one with our friction, 1e-12 rad."""
    b, ends = 0.3 + 0.1 * np.arange(8), []
    for ours in (True, False):
        n = plant_from(LEAN[name](), tmp_path).n
        plant = MujocoPlant(tmp_path / "arm.xml", friction=Friction(b[:n]) if ours else None)
        if not ours:
            plant._m.dof_damping[:] = b[:n]
        plant.reset(*start_of(n))
        plant.step(np.zeros(n), 500)
        ends.append(plant.state()[0])
    assert np.max(np.abs(ends[0] - ends[1])) <= 1e-12
    plain = plant_from(LEAN[name](), tmp_path)
    plain.reset(*start_of(plain.n))
    plain.step(np.zeros(plain.n), 500)
    assert np.max(np.abs(ends[0] - plain.state()[0])) > 1e-3


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_friction_keeps_the_order_of_the_method(engine: str, figure: Any) -> None:
    """Viscous friction, 0.2 s: halving the step divides the error by 2^4; held over a step it would by 2."""
    errors, ends = [], []
    for h in (0.008, 0.004, 0.002, 0.00025):
        plant = plants(Friction(VISCOUS), h)[engine]
        plant.reset(np.array(HOME), np.array([2.0, -1.5, 1.8, 3.0, -2.0, 4.0]))
        plant.step(np.zeros(6), round(0.2 / h))
        ends.append(plant.state()[0])
    errors = [float(np.max(np.abs(end - ends[-1]))) for end in ends[:-1]]
    order = np.polyfit(np.log([4.0, 2.0, 1.0]), np.log(errors), 1)[0]
    figure(f"order of Runge-Kutta with viscous friction, {engine}", order, "4 within 0.2")
    assert order == pytest.approx(4.0, abs=0.2)


def by_mujoco(plant: MujocoPlant, run: Trajectory, friction: Friction, substeps: int) -> Array:
    """Return the positions that plain `mj_step` gives when MuJoCo asks for the torque at each of its stages."""
    m, n = copy.copy(plant._m), plant.n
    d, k = mujoco.MjData(m), 0
    d.qpos[:] = start_of(n)[0]
    positions = [d.qpos.copy()]

    def torque(_: Any, data: Any) -> None:
        drag = friction.viscous * data.qvel + friction.coulomb * np.clip(data.qvel / friction.speed, -1.0, 1.0)
        data.qfrc_applied[:] = run.tau[k] - drag

    with control(torque):
        while k < len(run.t) - 1:
            mujoco.mj_step(m, d, substeps)
            positions.append(d.qpos.copy())
            k += 1
    return np.array(positions)


def rubbing(
    plant: Any, substeps: int = 1, path: Any = "native", chain: Chain = IDEAL, n_steps: int = 150
) -> Trajectory:
    """Return a run of PD on a plant."""
    n, period = plant.n, substeps * plant.timestep
    return simulate_sampled(
        plant,
        pack("pd", n, lam=8, kv=12),
        anything(n),
        Sine(0.8, 2.0),
        duration=n_steps * period,
        control_period=period,
        chain=chain,
        initial_q=start_of(n)[0],
        path=path,
    )


ARMS = (
    "puma560",
    "two-link",
    "hinges and slides",
    "branches",
    "damping",
    "damping in a tree",
    "explicit damping",
    "joint friction",
    "enforced limits",
    "contacts",
    "a spring",
    "an equality",
    "a stiff tendon",
)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("name", ARMS)
def test_friction_is_mj_step_with_a_torque_of_velocity(
    name: str, substeps: int, integrator: str, tmp_path: Path
) -> None:
    """In every byte, on both paths, lean or not, in place of the arm's own friction, beside springs and contacts."""
    plant_from((LEAN | REFUSED | RUBBING)[name](), tmp_path, integrator)
    plant = MujocoPlant(tmp_path / "arm.xml", 0.001, integrator, friction=BOTH)
    assert plant.native().structure.lean == (name not in REFUSED)  # type: ignore[attr-defined]
    run = rubbing(plant, substeps, n_steps=60)
    assert run.path == "native"
    assert run.q.tobytes() == by_mujoco(plant, run, BOTH, substeps).tobytes()
    assert differing_bytes(run, rubbing(plant, substeps, "python", n_steps=60)) == 0
    without = rubbing(MujocoPlant(tmp_path / "arm.xml", 0.001, integrator), substeps, n_steps=60)
    assert np.max(np.abs(without.q - run.q)) > 1e-4


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("lag", [0.0, 0.004])
@pytest.mark.parametrize("engine", ["mujoco", "analytic", "corrected"])
def test_both_paths_rub_alike(engine: str, lag: float, integrator: str) -> None:
    """0 differing bytes, with a lagging actuator too, and on a replica."""
    plant = plants(PUMA, integrator=integrator).get(engine) or AnalyticPlant(
        Puma560("corrected", "printed"), 0.001, integrator, friction=PUMA
    )
    runs = [
        rubbing(p, 2, path, Chain(actuator_lag=lag)) for path in ("native", "python") for p in (plant, plant.replica())
    ]
    assert [differing_bytes(runs[0], run) for run in runs[1:]] == [0, 0, 0]


def test_friction_of_zero_is_none() -> None:
    """The same state, to the last bit, as without any."""
    for engine, plant in plants(Friction()).items():
        plain = MujocoPlant("puma560") if engine == "mujoco" else AnalyticPlant(Puma560())
        assert rubbing(plant).q.tobytes() == rubbing(plain).q.tobytes()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_friction_of_the_puma_is_stable_at_a_millisecond(integrator: str, figure: Any) -> None:
    """The fastest decay at 3000 poses, 1058 1/s, times 1 ms is within each method's interval; each joint's own too.

    A joint alone decays at (viscous + coulomb/0.01)/M_ii, at most 1014 1/s, joint 1 with the arm stretched up.
    """
    M = MujocoModel("puma560").mass_matrix(np.random.default_rng(3).uniform(-math.pi, math.pi, (3000, 6)))
    steep = np.array(VISCOUS) + np.array(COULOMB) / 0.01
    fastest = float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(M, np.broadcast_to(np.diag(steep), M.shape))))))
    figure(f"fastest decay of the PUMA's friction x 1 ms, {integrator}", 0.001 * fastest, f"<= {STABLE[integrator]}")
    assert 0.001 * fastest <= STABLE[integrator]
    assert 0.001 * np.max(steep / np.min(np.diagonal(M, axis1=1, axis2=2), axis=0)) <= 0.001 * fastest
    run = simulate_sampled(
        plants(PUMA, integrator=integrator)["analytic"],
        pack("pd-gravity", 6, lam=10, kv=20),
        Puma560(),
        REFERENCES["quintic"](6),
        duration=3.0,
    )
    assert np.max(np.abs(run.qd[-500:])) < 0.01  # comes to rest: no oscillation at the time step


@pytest.mark.parametrize("engine", [MujocoPlant, AnalyticPlant])
@pytest.mark.parametrize(
    ("integrator", "speed", "refused"),
    [
        ("rk4", 0.0035, True),
        ("rk4", 0.0042, False),
        ("euler", 0.0050, True),
        ("euler", 0.0056, False),
    ],
)
def test_friction_too_steep_for_the_time_step_is_refused(
    engine: Any, integrator: str, speed: float, refused: bool
) -> None:
    """2.785 and 2 over 1058 1/s x 0.01 rad/s are 0.0038 and 0.0053 rad/s: below, a ValueError that says what to do."""
    source: Any = "puma560" if engine is MujocoPlant else Puma560()
    friction = Friction(VISCOUS, COULOMB, speed)
    if refused:
        with pytest.raises(
            ValueError, match=r"a shorter time step, plant.timestep of .* or a higher speed than .*, or bristles"
        ):
            engine(source, 0.001, integrator, friction=friction)
        engine(source, 0.0005, integrator, friction=friction)
    else:
        engine(source, 0.001, integrator, friction=friction)


def test_too_steep_friction_would_chatter() -> None:
    """What the refusal is for: just within the interval a resting joint stays at rest, just beyond it does not."""
    ends = []
    for rate in (2.7, 2.9):
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(STABLE, "rk4", math.inf)
            plant = AnalyticPlant(slider(1.0), 0.001, friction=Friction(viscous=1000.0 * rate))
        plant.reset(np.zeros(1), np.array([1e-6]))
        plant.step(np.zeros(1), 400)
        ends.append(abs(plant.state()[1][0]))
    assert ends[0] < 1e-9
    assert ends[1] > 1e-3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"viscous": -1.0}, "viscous is -1.0"),
        ({"coulomb": [1.0, math.nan]}, "coulomb is"),
        ({"speed": 0.0}, "speed is 0"),
        ({"speed": math.inf}, "speed is inf"),
    ],
)
def test_what_is_no_friction_is_refused(arguments: dict[str, Any], message: str) -> None:
    """A ValueError that names the number."""
    with pytest.raises(ValueError, match=message):
        Friction(**arguments)


def test_friction_of_another_count_of_joints_is_refused() -> None:
    """A ValueError that names both."""
    with pytest.raises(ValueError, match=r"viscous has shape \(3,\), wanted one number or 6"):
        AnalyticPlant(Puma560(), friction=Friction([1.0, 2.0, 3.0]))
