"""`compare` names the term in which two arms differ: each is seeded into a copy of an arm, alone and in pairs."""

import numpy as np
import pytest

from torquebench import Sine
from torquebench.comparison import Motion, compare, name_terms, parse_side, random_states, rate_terms

ARM = """
<mujoco model="three"><compiler angle="radian"/><option integrator="RK4"/><worldbody>
  <body name="l1"><inertial mass="3" pos="0.01 0.02 0.1" diaginertia="0.05 0.04 0.03"/>
    <joint name="j1" axis="0 1 0" damping="0.3" frictionloss="0.2" armature="0.01"/>
    <body name="l2" pos="0 0 0.3" euler="0.3 0 0"><inertial mass="1" pos="0.02 0 0.1" diaginertia="3e-3 2e-3 2e-3"/>
      <joint name="j2" axis="0 0 1" damping="0.1" armature="0.02" stiffness="2"/>
      <body name="l3" pos="0 0 0.3"><inertial mass="0.4" pos="0.03 0 0.1" diaginertia="4e-4 3e-4 3e-4"/>
        <joint name="j3" axis="1 0 0" range="-1 1"/><site name="tool" pos="0 0 0.2"/></body></body></body>
  </worldbody>
  <actuator><motor joint="j1" ctrlrange="-150 150"/><motor joint="j2" ctrlrange="-28 28"/>
    <motor joint="j3" ctrlrange="-28 28"/></actuator></mujoco>"""
LOAD = '<body pos="0.05 0 0.2"><inertial mass="0.5" pos="0 0 0" diaginertia="1e-13 1e-13 1e-13"/></body>'
SEEDS = {
    "armature": (('armature="0.02"', 'armature="0.05"'), "armature of joint 'j2': +0.03 kg m^2"),
    "damping": (('damping="0.1"', 'damping="0.5"'), "damping of joint 'j2': +0.4 N m s/rad"),
    "frictionloss": (('frictionloss="0.2"', ""), "frictionloss of joint 'j1': -0.2 N m"),
    "payload": (('<site name="tool"', f'{LOAD}<site name="tool"'), "payload of the link of joint 'j3': +0.5 kg"),
    "gravity": (("<option ", '<option gravity="0 0.5 -9.7" '), "gravity vector: (0, 0.5, -9.7) m/s^2"),
    "sign": (('axis="0 0 1"', 'axis="0 0 -1"'), "sign of the axis of joint 'j2': the opposite"),
    "axis": (('axis="0 0 1"', 'axis="0 1 1"'), "frame of the axis of joint 'j2': turned by 45 deg"),
    "frame": (
        ('pos="0 0 0.3" euler="0.3', 'pos="0 0 0.35" euler="0.3'),
        "frame of joint 'j2': moved by (0.05, 0, 0) m",
    ),
    "COM": (('pos="0.02 0 0.1"', 'pos="0.025 0 0.09"'), "COM of the link of joint 'j2': (+0.005, +0, -0.01) m"),
    "inertia": (('diaginertia="4e-4', 'diaginertia="5e-4'), "inertia of the link of joint 'j3': Izz +0.0001 kg m^2"),
    "gear": (('<motor joint="j2"', '<motor gear="10" joint="j2"'), "gear of joint 'j2': 10 in B, 1 in A"),
    "integrator": (("RK4", "Euler"), "integrator: euler in B, rk4 in A"),
    "unit": (('<compiler angle="radian"/>', ""), "unit of angles: those of B are read in the other unit"),
    "ref": (('name="j3"', 'name="j3" ref="0.5"'), "ref of joint 'j3': +0.5 rad"),
    "springref": (('stiffness="2"', 'stiffness="2" springref="0.4"'), "springref of joint 'j2': +0.4 rad"),
    "gravcomp": (('name="l3"', 'name="l3" gravcomp="0.6"'), "gravcomp of joint 'j3': +0.6 of its link's weight"),
}
"""What of the arm's text is replaced by what, and how the only term that is named begins."""


def seeded(folder, *changes):
    """A copy of the arm with changes of its text, as a side."""
    text = ARM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "arm.xml"
    path.write_text(text)
    return parse_side(str(path), "B")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The arm itself, as a side."""
    return seeded(tmp_path_factory.mktemp("arm"))


STATES = random_states(3, 60, seed=1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_seeded_term_is_the_only_one_that_is_named(arm, tmp_path, seed):
    """With its joint and number; it leaves nothing but round-off, and from B to A as well as from A to B."""
    change, named = SEEDS[seed]
    other = seeded(tmp_path, change)
    found = name_terms(arm, other, STATES)
    assert [str(term)[: len(named)] for term in found.terms] == [named]
    assert found.whole
    back = name_terms(other, arm, STATES)
    assert [term.name for term in back.terms] == [found.terms[0].name]


def test_a_velocity_that_is_not_the_derivative_is_named():
    """Degrees, a sign, and a velocity late by 50 ms are told apart; a motion that is consistent has none."""
    t = np.arange(0.0, 2.0, 0.001)
    q, qd, qdd = Sine((0.5, 0.4, 0.3), 1.0)(t)
    assert rate_terms(Motion(t, q, qd, qdd), ("a", "b", "c")) == []
    wrong = np.column_stack([np.degrees(qd[:, 0]), -qd[:, 1], np.roll(qd[:, 2], 50)])
    degrees, sign, late = rate_terms(Motion(t, q, wrong, qdd), ("a", "b", "c"))
    assert (degrees.name, degrees.where, sign.where) == ("reference velocity", "joint 'a'", "joint 'b'")
    assert degrees.number == "57.2958 times the derivative of the position: degrees/s beside radians?"
    assert sign.number == "-1 times the derivative of the position: the opposite sign"
    assert late.number.startswith("not the derivative of the position: at t = ")


def test_an_arm_of_which_nothing_was_changed_has_no_missing_term(arm, tmp_path):
    """A copy of it; and the analytic model of one without a spring, which the testbed has not."""
    assert name_terms(arm, seeded(tmp_path), STATES) == ((), 0.0)
    plain = seeded(tmp_path, (' stiffness="2"', ""))
    taken = parse_side(f"analytic:{plain.label}", "B")
    assert name_terms(plain, taken, STATES).terms == ()


def test_two_terms_at_once_are_both_named(arm, tmp_path):
    """Damping on one joint, an armature on another, and a sign beside a centre of mass."""
    found = name_terms(arm, seeded(tmp_path, SEEDS["armature"][0], SEEDS["frictionloss"][0]), STATES)
    assert {term.name for term in found.terms} == {"armature", "frictionloss"}
    found = name_terms(arm, seeded(tmp_path, SEEDS["sign"][0], SEEDS["inertia"][0]), STATES)
    assert [term.name for term in found.terms] == ["sign", "inertia"]
    assert found.whole


def test_a_difference_that_is_none_of_them_is_said_to_be_none():
    """The paper's equations as printed differ from the arm in products of velocities: no term, whatever the numbers."""
    a, b = parse_side("analytic:puma560", "A"), parse_side("analytic:puma560:printed:printed", "B")
    found = compare(a, b, states=60, tolerance=1e-12)
    assert found.named.terms == ()
    assert not found.named.whole
    assert "is not one of the terms that are known" in found.sentence
