"""A point mass on the last link: against Pinocchio and MuJoCo's own bodies, and taken up in the middle of a run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from tests.arms import pack
from tests.errata.independent import Arm
from tests.sampled import simulate_sampled
from tests.sim import faulty_laws
from tests.sim.arm_files import LEAN, REFUSED, plant_from
from tests.sim.protocol import HOME, REFERENCES, differing_bytes
from tests.sim.test_native_refused import anything
from torquebench.chain import CHAINS
from torquebench.comparison import random_states
from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.robot import Puma560, RobotModel
from torquebench.robot.mjcf import compile_arm
from torquebench.robot.mjcf_links import links_of, with_links
from torquebench.robot.payload import Payload, add_payload, carrying
from torquebench.sim.native import NativeRun
from torquebench.sim.plants import INTEGRATORS
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.simulate import Trial, simulate_many
from torquebench.sim.trajectory import Outcome, Trajectory

HERE = (0.04, -0.07, 0.11)
PLACES = [(0.0, 0.0, 0.0), HERE]
RELATIVE = 1e-12
"""Round-off of six links is a few 1e-15; terms that cancel to a small norm lose up to two digits more."""
LAW = pack("linear-band-smc", 6, lam=10, k=0.3, phi=0.3, kv=20)


def by_pinocchio(payload: Payload | None) -> Arm:
    """Return the PUMA in Pinocchio, with a point mass added to its last joint by Pinocchio itself."""
    arm = Arm()
    if payload is not None:
        load = pin.Inertia(payload.mass, np.array(payload.offset), np.zeros((3, 3)))
        arm.model.appendBodyToJoint(6, load, pin.SE3.Identity())
        arm.data = arm.model.createData()
    return arm


def relative(x: Array, y: Array) -> float:
    """Largest norm of the difference over the norm, state by state."""
    axes = tuple(range(1, x.ndim))
    return float(np.max(np.sqrt(np.sum((x - y) ** 2, axis=axes) / np.sum(y**2, axis=axes))))


@pytest.mark.parametrize("offset", PLACES)
def test_the_loaded_arm_is_pinocchios(offset: tuple[float, ...], figure: Any) -> None:
    """M and inverse dynamics of the exact model with 2 kg, at 1000 random states of all six joints."""
    payload = Payload(2.0, offset=offset)
    arm, theirs = carrying(Puma560(), payload), by_pinocchio(payload)
    q, qd, qdd = random_states(6, 1000, seed=4)
    torque = np.array([pin.rnea(theirs.model, theirs.data, *state) for state in zip(q, qd, qdd, strict=True)])
    gaps = [
        relative(arm.inverse_dynamics(q, qd, qdd), torque),
        relative(arm.mass_matrix(q), np.array([theirs.mass_matrix(x) for x in q])),
    ]
    figure(f"2 kg at {offset}: M and inverse dynamics, Pinocchio against exact, relative", max(gaps), "<= 1e-12")
    assert max(gaps) <= RELATIVE
    assert relative(Puma560().inverse_dynamics(q, qd, qdd), torque) > 0.1


@pytest.mark.parametrize("structure", ["corrected", "printed"])
@pytest.mark.parametrize("constants", ["fitted", "printed"])
def test_the_closed_forms_take_the_load_exactly(structure: Any, constants: Any) -> None:
    """What 2 kg at the wrist centre add to M and N, wrist still, is what they add in Pinocchio; each term to 1e-12.

    The literal equations add what their misprints make of it: they are held to what is not misprinted.
    """
    payload, empty = Payload(2.0), Puma560(structure, constants)
    arm, loaded, bare = carrying(empty, payload), by_pinocchio(payload), by_pinocchio(None)
    q, qd, _ = random_states(6, 200, seed=5)
    q[:, 3:], qd[:, 3:] = 0.0, 0.0
    more = arm.mass_matrix(q) - empty.mass_matrix(q)
    wanted = np.array([loaded.mass_matrix(x) - bare.mass_matrix(x) for x in q])
    assert np.max(np.abs(arm.gravity(q) - empty.gravity(q) - [loaded.gravity(x) - bare.gravity(x) for x in q])) < 1e-12
    if structure == "corrected":
        assert np.max(np.abs(more - wanted)) < 1e-12
        bias = np.array([loaded.bias(*s) - bare.bias(*s) for s in zip(q, qd, strict=True)])
        assert np.max(np.abs(arm.bias_forces(q, qd) - empty.bias_forces(q, qd) - bias)) < 1e-11
    else:
        assert np.max(np.abs((more - wanted)[:, 1:3, 2])) < 1e-12
    assert np.max(np.abs(wanted)) > 0.5


def spec_with_body(text: str, body: str, place: Array, mass: float) -> Any:
    """Return an arm with a tiny sphere welded on by MuJoCo's own editor."""
    spec = mujoco.MjSpec.from_string(text)
    load = spec.body(body).add_body(name="load", pos=place.tolist())
    load.mass, load.inertia, load.ipos, load.explicitinertial = mass, [1e-12] * 3, [0.0] * 3, True
    return spec.compile()


@pytest.mark.parametrize(
    "name",
    [
        "puma560",
        "two-link",
        "hinges",
        "hinges and slides",
        "two joints on a body",
        "a body welded on",
        "branches",
        "no gravity",
        "a reference angle",
    ],
)
def test_mujocos_loaded_arm_has_a_body_more(name: str, tmp_path: Path) -> None:
    """M and bias are those of the arm to which MuJoCo's editor has welded a body, at random states; 1e-9 of each.

    The body's own inertia of 1e-12 kg m^2 is what MuJoCo asks for, and a body with several joints has its axes turned.
    """
    file = tmp_path / "arm.xml"
    file.write_text(LEAN[name]())
    m = compile_arm(file).model
    payload = Payload(2.0, offset=HERE)
    loaded = with_links(m, add_payload(links_of(m), payload))
    body, d = int(m.jnt_bodyid[-1]), mujoco.MjData(m)
    d.qpos[:] = 0.0
    mujoco.mj_kinematics(m, d)
    axis, turn = m.jnt_axis[-1], d.xmat[body].reshape(3, 3)
    frame = turn
    if list(axis) != [0.0, 0.0, 1.0]:  # the frame of a joint that is not along its body's z
        x = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
        x /= np.linalg.norm(x)
        frame = turn @ np.column_stack([x, np.cross(axis, x), axis])
    place = turn.T @ (d.xanchor[-1] + frame @ np.array(HERE) - d.xpos[body])
    other = spec_with_body(file.read_text(), mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, body), place, 2.0)
    rng = np.random.default_rng(8)
    for _ in range(20):
        state = rng.normal(size=(2, m.nv))
        found = []
        for each in (loaded, other, m):
            data, M = mujoco.MjData(each), np.zeros((m.nv, m.nv))
            data.qpos[:], data.qvel[:] = state
            mujoco.mj_forward(each, data)
            mujoco.mj_fullM(each, data, M)
            found.append(np.concatenate([M.ravel(), data.qfrc_bias]))
        scale = np.max(np.abs(found[1]))
        assert np.max(np.abs(found[0] - found[1])) < 1e-9 * scale
        assert np.max(np.abs(found[2] - found[1])) > 1e-3 * scale


SIMPLE = """<mujoco><worldbody><body {}><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
  <joint name="a" type="slide" axis="1 0 0"/><joint name="b" axis="0 0 1"/></body></worldbody>
  <actuator><motor joint="a" ctrlrange="-9 9"/><motor joint="b" ctrlrange="-9 9"/></actuator></mujoco>"""


def test_an_arm_compiled_for_a_special_case_is_refused(tmp_path: Path) -> None:
    """A body whose mass matrix MuJoCo has wired in as diagonal: an error that says how to switch that off."""
    load = Payload(1.0, offset=(0.5, 0.0, 0.0))
    for text, refused in ((SIMPLE.format(""), True), (SIMPLE.format('simple="false"'), False)):
        plant_from(text, tmp_path)
        if refused:
            with pytest.raises(ModelError, match=r"cannot change the links of this arm: .*simple='false'"):
                MujocoPlant(tmp_path / "arm.xml", payload=load)
        else:
            assert MujocoPlant(tmp_path / "arm.xml", payload=load).n == 2


def plants(payload: Payload | None, integrator: str = "rk4") -> dict[str, MujocoPlant | AnalyticPlant]:
    """Return the PUMA on both plants."""
    return {
        "mujoco": MujocoPlant("puma560", 0.001, integrator, payload=payload),
        "analytic": AnalyticPlant(Puma560(), 0.001, integrator, payload=payload),
    }


def run_of(plant: Any, duration: float = 0.4, path: Any = "native", **options: Any) -> Trajectory:
    """Return a run of the linear band on the sine from HOME."""
    return simulate_sampled(
        plant,
        LAW,
        Puma560("corrected", "printed"),
        REFERENCES["sine"](6),
        duration=duration,
        initial_q=np.array(HOME),
        path=path,
        **options,
    )


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_taken_up_in_mid_run_is_two_runs_glued(engine: str, integrator: str) -> None:
    """Byte for byte: the empty arm under the recorded torques until then, the loaded one on from its state."""
    at = 150
    run = run_of(plants(Payload(2.0, 0.001 * at, HERE), integrator)[engine])
    first, second = (plants(p, integrator)[engine] for p in (None, Payload(2.0, offset=HERE)))
    first.reset(np.array(HOME), np.zeros(6))
    for k in range(len(run.t)):
        plant = first if k < at else second
        if k == at:
            second.reset(*first.state())
        q, qd = plant.state()
        assert q.tobytes() == run.q[k].tobytes()
        assert qd.tobytes() == run.qd[k].tobytes()
        plant.step(run.tau[k], 1)
    assert not np.array_equal(run.q[at + 1], run_of(plants(None, integrator)[engine]).q[at + 1])


@pytest.mark.parametrize("chain", ["ideal", "slow"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_both_paths_take_it_up_alike(engine: str, integrator: str, chain: str) -> None:
    """0 differing bytes, with and without a lag, and however many instants are asked for at once."""
    plant = plants(Payload(2.0, 0.123, HERE), integrator)[engine]
    native = run_of(plant, chain=CHAINS[chain])
    assert differing_bytes(native, run_of(plant, path="python", chain=CHAINS[chain])) == 0
    told: list[int] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(NativeRun, "longest", 50)
        pieces = run_of(plant, chain=CHAINS[chain], progress=told.append)
    assert pieces.digest() == native.digest()
    assert told == list(range(49, 400, 50))


@pytest.mark.parametrize("at", [0.0, 0.2])
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_one_plant_serves_many_runs(engine: str, at: float) -> None:
    """A second run on the same plant, and one on a replica, start without what was taken up later: the same bytes."""
    plant = plants(Payload(2.0, at))[engine]
    first = run_of(plant)
    twin = plant.replica()
    assert {run_of(each, path=path).digest() for each in (plant, twin) for path in ("native", "python")} == {
        first.digest()
    }


def test_the_lean_step_is_proven_on_both_models(tmp_path: Path) -> None:
    """The PUMA is stepped lean before and after; an arm with a spring by mj_step, before and after, on both paths."""
    native = plants(Payload(2.0, 0.1))["mujoco"].native()
    assert native.structure.lean  # type: ignore[attr-defined]
    assert [arm.lean for arm in native.later] == [True]  # type: ignore[attr-defined]
    file = tmp_path / "arm.xml"
    file.write_text(REFUSED["a spring"]())
    plant = MujocoPlant(file, payload=Payload(2.0, 0.1))
    assert [arm.lean for arm in plant.native().later] == [False]  # type: ignore[attr-defined]
    law = pack("pd", 3, lam=8, kv=12)
    runs = [
        simulate_sampled(plant, law, anything(3), REFERENCES["sine"](3), duration=0.2, path=path)  # type: ignore[arg-type]
        for path in ("native", "python")
    ]
    assert differing_bytes(*runs) == 0


FAULTS = [(at, joint) for at in (49, 50, 51, 99) for joint in (0, 5)]


@pytest.mark.parametrize("path", ["native", "python"])
@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_failures_are_at_their_own_step(engine: str, path: Any) -> None:
    """A law that fails, and a push that no arm stands, just before, at and after the load: that very step."""
    plant = plants(Payload(2.0, 0.05))[engine]
    for at, joint in FAULTS:
        controller = faulty_laws.controller(faulty_laws.NOT_A_NUMBER, 6, 0.001 * at, joint)
        push = np.zeros((100, 6))
        push[at, joint] = 1e300
        for law, disturbance, outcome in ((controller, None, Outcome.BAD_TORQUE), (LAW, push, Outcome.DIVERGED)):
            run = simulate_sampled(
                plant,
                law,
                Puma560(),
                REFERENCES["sine"](6),
                duration=0.1,
                disturbance=disturbance,
                path=path,
                throw=False,
            )
            assert (run.outcome, run.failed_at, len(run.t)) == (outcome, at, at + 1)


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_threads_do_not_matter(engine: str) -> None:
    """1, 2 and 4 threads give each trial's bytes."""
    plant = plants(Payload(2.0, 0.05))[engine]
    trials = [
        Trial(LAW, Puma560(), REFERENCES["sine"](6), 0.001 * (60 + 7 * i), initial_q=0.1 * i * np.ones(6))
        for i in range(12)
    ]
    digests = [[run.digest() for run in simulate_many(plant, trials, workers=n, path="native")] for n in (1, 2, 4)]
    assert digests[0] == digests[1] == digests[2]
    assert len(set(digests[0])) == 12


def test_the_weight_is_felt_at_once_and_the_law_knows_nothing() -> None:
    """Held still by gravity's torque of the empty arm, joint 2 falls with the load from the very next step.

    Its first speed is T times M^-1 of what Pinocchio says the load's gravity is, to first order in T: 1 %.
    """
    payload, q = Payload(2.0, 0.05), np.array(HOME)
    loaded, bare = by_pinocchio(payload), by_pinocchio(None)
    run = simulate_sampled(
        AnalyticPlant(Puma560(), payload=payload),
        pack("pd-gravity", 6, lam=1e-3, kv=1e-3),
        Puma560(),
        lambda t: REFERENCES["sine"](6)(0.0 * t),
        duration=0.1,
        initial_q=q,
    )
    assert np.max(np.abs(run.qd[:51])) < 1e-3
    change = (run.qd[51] - run.qd[50]) / 0.001
    wanted = np.linalg.solve(loaded.mass_matrix(q), bare.gravity(q) - loaded.gravity(q))
    assert change == pytest.approx(wanted, rel=0.01, abs=0.01)
    assert abs(wanted[1]) > 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mass": -1.0}, "mass is -1.0, wanted at least 0"),
        ({"mass": math.nan}, "mass is nan"),
        ({"mass": 1.0, "at": -1.0}, "at is -1.0"),
        ({"mass": 1.0, "at": math.inf}, "at is inf"),
        ({"mass": 1.0, "offset": (0.0, 0.0)}, "wanted three finite numbers"),
        ({"mass": 1.0, "offset": (0.0, 0.0, math.nan)}, "offset is .*, wanted a finite number"),
    ],
)
def test_what_is_no_load_is_refused(arguments: dict[str, Any], message: str) -> None:
    """A ValueError that names the number."""
    with pytest.raises(ValueError, match=message):
        Payload(**arguments)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        (0.0005, "whole multiple of control_period"),
        (0.4, "before the end of the run"),
        (7.0, "before the end"),
    ],
)
def test_a_time_that_never_comes_is_refused(at: float, message: str) -> None:
    """Between two instants, at the end, or beyond: a ValueError, on either plant."""
    for plant in plants(Payload(1.0, at)).values():
        with pytest.raises(ValueError, match=message):
            run_of(plant)


@pytest.mark.parametrize("structure", ["corrected", "printed"])
def test_a_closed_form_refuses_a_load_beside_the_wrist(structure: Any) -> None:
    """Its constants have no terms for it: a ModelError that says so."""
    with pytest.raises(ModelError, match="at the wrist centre only"):
        AnalyticPlant(Puma560(structure, "fitted"), payload=Payload(1.0, offset=HERE))


def test_the_arm_without_load_is_left_alone() -> None:
    """Neither the model passed in nor MuJoCo's file changes; limits and gains' scale stay those of the empty arm."""
    arm: RobotModel = Puma560()
    before = arm.flat.about_origin.tobytes()
    loaded = carrying(arm, Payload(2.0))
    assert arm.flat.about_origin.tobytes() == before != loaded.flat.about_origin.tobytes()
    for name in ("tau_max", "inertia_scale", "armature"):
        assert getattr(loaded.flat, name).tobytes() == getattr(arm.flat, name).tobytes()
    plant = plants(Payload(2.0))["mujoco"]
    assert plant.tau_max.tolist() == arm.flat.tau_max.tolist()
