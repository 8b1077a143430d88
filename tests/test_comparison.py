"""`compare` says agree only where two sides agree, and differ only where they differ."""

from dataclasses import replace

import numpy as np
import pytest

from tests.arms import THREE
from torquebench import AnalyticPlant, Puma560, RobotModel, load_model
from torquebench.comparison import (
    ROLLOUT_TOLERANCE,
    Row,
    Side,
    compare_rollouts,
    compare_terms,
    parse_side,
    random_states,
    slightly_wrong,
)
from torquebench.laws import Law
from torquebench.robot.flat_model import own_copy
from torquebench.sim.plants.mujoco import MujocoModel


def side(model):
    """An analytic model as one side."""
    return Side("arm", "analytic", "arm", model, model)


def test_two_runs_that_both_failed_do_not_agree():
    """An arm of feathers leaves the bounds on both plants alike; the row says so instead of agreeing."""
    arm = Puma560()
    light = own_copy(arm.flat)
    light = replace(light, mass=light.mass * 1e-9, inertia=light.inertia * 1e-9, armature=light.armature * 1e-9)
    feather = RobotModel("feather", arm.joint_names, light)
    rows = compare_rollouts(side(feather), side(feather), arm, duration=0.1)
    failed = [row for row in rows if "DIVERGED" in row.where]
    assert failed
    assert not any(row.agrees for row in failed)


def test_one_run_that_failed_is_no_agreement():
    """A run that ended early is not compared with one that did not."""
    arm = Puma560()
    weak = own_copy(arm.flat)
    weak = replace(weak, mass=weak.mass * 1e-9, inertia=weak.inertia * 1e-9, armature=weak.armature * 1e-9)
    rows = compare_rollouts(side(RobotModel("x", arm.joint_names, weak)), side(arm), arm, duration=0.1)
    assert not all(row.agrees for row in rows)


@pytest.mark.parametrize("measure", ["absolute", "relative"])
def test_a_row_agrees_up_to_its_limit_and_never_on_nan(measure):
    """The limit itself agrees, the next number does not, NaN does not; the other measure does not count."""
    row = Row("x", "rad", 0.0, 0.0, "1", 1e-12, measure)
    other = "relative" if measure == "absolute" else "absolute"
    assert replace(row, **{measure: 1e-12, other: 1.0}).agrees
    assert not replace(row, **{measure: np.nextafter(1e-12, 1), other: 0.0}).agrees
    assert not replace(row, **{measure: float("nan")}).agrees


def test_rollouts_are_held_to_the_promise_of_the_design():
    """1e-12 rad: what is promised of MuJoCo against the analytic plant; a gap of 2e-12 rad is a difference."""
    assert ROLLOUT_TOLERANCE == 1e-12
    arm = Puma560()

    class Shifted(AnalyticPlant):
        def state(self):
            q, qd = super().state()
            return q + 2e-12, qd

    rows = compare_rollouts(side(arm), _With(arm, Shifted(arm)), Puma560("corrected", "printed"), duration=0.05)
    assert {row.term for row in rows if row.agrees} == {"one step, torque"}  # the speed is not shifted


STIFF = {"smc": {"lam": 10, "k": 0.9}, "linear-band-smc": {"lam": 10, "k": 0.9, "phi": 0.05, "kv": 20}}
"""Gains with which they amplify what is rounded, too."""


def rollouts(folder, change=None, duration=0.5):
    """Rows of the loops and steps of the light arm, MuJoCo's with a change of its text against the analytic one."""
    same, other = folder / "three.xml", folder / "other.xml"
    same.write_text(THREE)
    other.write_text(THREE.replace(*change) if change else THREE)
    a, b = parse_side(f"mujoco:{other}", "A"), parse_side(f"analytic:{same}", "B")
    return compare_rollouts(a, b, slightly_wrong(b, b), duration)


def test_plants_that_agree_are_not_called_different_by_loops_that_amplify(tmp_path, monkeypatch):
    """At stiff gains loops of one arm come 1e-12 rad and more apart, and so does one plant from itself: undecided.

    Single steps agree, so nothing differs. Gains chosen for the arm amplify nothing, and all loops agree.
    """
    assert {row.verdict for row in rollouts(tmp_path)} == {"agrees"}
    monkeypatch.setattr(Law, "choose_gains", lambda law, *rest: STIFF[law.name])
    rows = rollouts(tmp_path)
    apart = [row for row in rows if row.verdict == "undecided"]
    assert apart
    assert all(row.agrees for row in rows)
    for row in apart:
        assert row.term.startswith("closed loop")
        assert row.absolute > ROLLOUT_TOLERANCE
        assert row.own > ROLLOUT_TOLERANCE
        assert row.growth == pytest.approx(np.log(row.own / 2.0**-52) / 0.499)
        assert row.to_json() | {"verdict": "undecided", "agrees": True} == row.to_json()


@pytest.mark.parametrize("chosen", [True, False], ids=["its own gains", "stiff gains"])
def test_an_inertia_changed_by_a_millionth_is_a_difference_whatever_the_loops_do(tmp_path, monkeypatch, chosen):
    """The elbow's inertia, 1e-6 relative, leaves torque unexplained in single steps, in loops that amplify too."""
    if not chosen:
        monkeypatch.setattr(Law, "choose_gains", lambda law, *rest: STIFF[law.name])
    for change in (('"1e-4 1e-4', '"1.000001e-4 1e-4'), ('mass="1"', 'mass="1.000001"')):
        rows = {row.term: row for row in rollouts(tmp_path, change)}
        assert rows["one step, torque"].verdict == "differs"
        if chosen:
            assert any(row.verdict == "differs" for term, row in rows.items() if term.startswith("closed loop"))


def test_a_loop_is_undecided_only_where_its_own_plant_comes_apart():
    """Beyond the limit: undecided up to 1,000 times A from itself, a difference beyond, or where A keeps together."""
    row = Row("x", "rad", 1e-3, 1.0, "1", 1e-12, "absolute", own=1e-6, growth=1.0)
    assert row.verdict == "undecided"
    assert replace(row, absolute=1.1e-3).verdict == "differs"
    assert replace(row, absolute=1e-12 + 1e-15, own=2.0**-52).verdict == "differs"
    assert replace(row, own=None).verdict == "differs"
    assert replace(row, absolute=float("nan")).verdict == "differs"
    assert replace(row, absolute=1e-12).verdict == "agrees"


@pytest.mark.parametrize("text", ["SCARA", "PENDULUM"])
def test_single_steps_of_arms_that_need_little_torque_agree(tmp_path, text):
    """Without gravity there is hardly a torque to measure by: what rounds the velocity is no difference."""
    path = tmp_path / "arm.xml"
    path.write_text(globals()[text])
    a, b = parse_side(f"mujoco:{path}", "A"), parse_side(f"analytic:{path}", "B")
    rows = compare_rollouts(a, b, slightly_wrong(a, b), 0.5)
    assert {row.verdict for row in rows} == {"agrees"}, [(row.term, row.absolute, row.own) for row in rows]


class _With:
    """A side with a plant of the test's own."""

    def __init__(self, model, plant):
        self.dynamics, self._plant = model, plant

    def plant(self, timestep):
        """The plant, whatever the time step."""
        return self._plant


SCARA = """
<mujoco><worldbody>
  <body><inertial mass="2" pos="0.3 0 0" diaginertia="0.01 0.1 0.1"/><joint name="a" axis="0 0 1"/>
    <body pos="0.6 0 0"><inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.05 0.05"/>
      <joint name="b" axis="0 0 1"/></body>
  </body></worldbody>
  <actuator><motor joint="a" ctrllimited="true" ctrlrange="-9 9"/><motor joint="b" ctrllimited="true" ctrlrange="-5 5"/>
</actuator></mujoco>"""

PENDULUM = """
<mujoco><worldbody>
  <body><inertial mass="2" pos="0.3 0 0.1" diaginertia="0.01 0.1 0.1"/><joint name="a" axis="1 2 3"/></body></worldbody>
  <actuator><motor joint="a" ctrllimited="true" ctrlrange="-9 9"/></actuator></mujoco>"""


@pytest.mark.parametrize("text", [SCARA, PENDULUM], ids=["gravity is nothing", "velocity terms are nothing"])
def test_a_term_that_is_only_round_off_is_no_difference(tmp_path, text):
    """Vertical axes have no gravity torque, one joint no velocity torque: 1e-16 N m against 1e-17 is agreement."""
    path = tmp_path / "arm.xml"
    path.write_text(text)
    arm = load_model(path)
    rows = compare_terms(MujocoModel(path), arm, random_states(arm.n, 100, seed=1), 1e-12)
    assert all(row.agrees for row in rows), [(row.term, row.relative) for row in rows]


def test_a_small_term_that_is_wrong_is_still_a_difference():
    """The floor under a term's scale hides round-off only: gravity wrong by 1e-6 of itself is seen on the PUMA."""
    arm = Puma560()
    flat = own_copy(arm.flat)
    heavier = RobotModel("x", arm.joint_names, replace(flat, gravity=flat.gravity * (1 + 1e-6)))
    rows = {row.term: row for row in compare_terms(arm, heavier, random_states(6, 50, seed=1), 1e-12)}
    assert not rows["gravity"].agrees
    assert rows["mass matrix"].agrees
    assert rows["Coriolis + centrifugal"].agrees


def test_sides_of_every_form(tmp_path):
    """mujoco:MODEL, analytic:MODEL, analytic:FILE.xml and FILE.xml describe the same arm."""
    path = tmp_path / "two.xml"
    path.write_text(SCARA)
    states = random_states(2, 5, seed=1)
    torques = [parse_side(text, "A").dynamics.inverse_dynamics(*states) for text in (str(path), f"analytic:{path}")]
    assert np.allclose(*torques, rtol=1e-12, atol=1e-13)
    assert parse_side("analytic:puma560:corrected", "A").links is None
