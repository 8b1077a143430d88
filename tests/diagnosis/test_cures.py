"""What is blamed first is what matters most, and what is said to cure does, when it is pasted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.test_causes import NOISE, PLANT, experiment, pd, sliding
from torquebench.diagnosis import Cause, Diagnosis, Margins, Remedy, diagnose
from torquebench.diagnosis.diagnose import _Search
from torquebench.diagnosis.margins import backwards, slopes_of
from torquebench.diagnosis.parts import Variant, with_chain
from torquebench.diagnosis.seen import KINDS
from torquebench.diagnosis.settings import settings_between
from torquebench.experiment.build import build
from torquebench.experiment.run import metrics_of, trial_of
from torquebench.experiment.schema import Experiment
from torquebench.sim.session import Session

LINK = """\
<mujoco model="link">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="RK4"><flag contact="disable" constraint="disable"/></option>
  <worldbody><body>
    <inertial mass="2" pos="0.3 0 0" diaginertia="0.002 0.05 0.05"/>
    <joint name="elbow" type="hinge" axis="0 1 0" armature="0.1"/>
  </body></worldbody>
  <actuator><motor name="elbow" joint="elbow" ctrllimited="true" ctrlrange="-40 40"/></actuator>
</mujoco>
"""
"""A link of 0.38 kg m^2 that hangs at pi/2, where gravity's stiffness is 5.9 N m/rad; 40 N m."""


@pytest.fixture
def link(tmp_path: Path) -> Any:
    """Return what makes an experiment with one controller on that link, of 3 s at 2 ms."""
    (tmp_path / "link.xml").write_text(LINK)

    def made(controller: dict[str, Any], motion: dict[str, Any], **sections: Any) -> Experiment:
        plant = {"engine": "mujoco", "model": tmp_path / "link.xml", "timestep": 0.0005, **sections.pop("plant", {})}
        run = {"duration": 3.0, "control_period": 0.002, "initial_q": "home", **sections.pop("run", {})}
        reference = {"kind": "sine", "amplitude": [0.5], "frequency_hz": 0.8, **motion}
        parts = {"name": "link", "plant": plant, "controllers": [controller], "reference": reference, "run": run}
        return Experiment.from_dict({**parts, **sections})

    return made


def impedance(kp: float, kd: float) -> dict[str, Any]:
    """Return a joint impedance."""
    return {"name": "c", "law": "joint-impedance", "damping": "velocity-error", "gains": {"kp": kp, "kd": kd}}


def test_small_gains_are_no_wrong_sign(link: Any) -> None:
    """A stiffness below gravity's, whose torque the law gives where the arm is, is stable: friction makes its error."""
    motion = {"amplitude": [0.3], "frequency_hz": 0.2, "origin": [1.42]}
    rubs = {"friction": {"coulomb": 0.3, "speed": 0.02}}
    given = link(impedance(5.0, 4.0), motion, plant=rubs, run={"duration": 6.0, "initial_q": [1.42]})
    slopes = slopes_of(given, build(given))
    assert slopes.stiffness.max() < 0.0, "the law's own slope has the sign of one that pushes away"
    assert backwards(slopes) is None
    found = diagnose(given)
    assert [cause.key for cause in found.causes] == ["friction"], found.sentence


def test_a_motion_that_is_lost_comes_before_its_harmonics(link: Any) -> None:
    """Torque at its limit nine tenths of the time, half the motion lost: the limit is blamed for that error first."""
    found = diagnose(link(impedance(200.0, 12.0), {"amplitude": [2.0], "frequency_hz": 2.2}))
    assert found.seen.size("saturates") > 0.9
    assert found.symptoms[0] == "errs", found.sentence
    assert found.causes[0].key == "torque_limit"
    assert found.remedy == Remedy("a slower motion")


def test_gains_too_large_for_a_chain_of_small_delays(link: Any) -> None:
    """What takes phase is named, the torque limit that holds the swing is not; smaller gains, tried, come first."""
    chain = {"from": "ur5e", "quantisation": 0}
    law = {"name": "c", "law": "computed-torque", "gains": {"lam": 30, "kv": 250, "ki": 0}}
    found = diagnose(link(law, {}, chain=chain))
    assert found.symptoms[0] == "shakes"
    assert {cause.key for cause in found.causes} == {"velocity", "command_delay", "current_loop"}
    (change,) = found.remedy.settings
    assert change.startswith("controllers.c.gains.kv=")
    assert found.remedy.cures


def test_damping_that_lags_the_motion(link: Any) -> None:
    """A damper on the velocity lags a moving reference by Kd qd_ref / Kp: on the velocity's error it does not."""
    law = impedance(200.0, 30.0) | {"damping": "velocity"}
    found = diagnose(link(law, {}))
    assert found.symptoms == ("errs",)
    assert found.remedy.settings == ("controllers.c.damping=velocity-error",)


def test_no_cure_makes_an_error_worse(link: Any) -> None:
    """Motors that give nothing at the motion's speed: gains that calm the torque and lose the motion are no cure."""
    chain = {"command_delay": 0.002, "torque_speed": {"corner": 0.3, "no_load": 1.6}}
    found = diagnose(link(impedance(150.0, 10.0), {"amplitude": [1.0]}, chain=chain))
    assert found.causes[0].key == "torque_speed", found.sentence
    assert "slower" in found.advice


@pytest.mark.parametrize(("ki", "duration"), [(3300.0, 3.0), (3600.0, 2.0), (3600.0, 6.0)])
def test_an_integral_that_makes_a_loop_unstable(link: Any, ki: float, duration: float) -> None:
    """It is the first cause, whatever the duration, though without it the arm sags; its cure has a phase margin."""
    controller = {"name": "c", "law": "pid", "gains": {"lam": 8.0, "kv": 20.0, "ki": ki}}
    given = link(controller, {}, chain={"command_delay": 0.004}, run={"duration": duration})
    found = diagnose(given)
    assert found.margins is not None
    assert found.margins.phase is not None
    assert found.margins.phase < 0.0
    assert found.causes[0].key == "integral", found.sentence
    assert "gravity" not in {cause.key for cause in found.causes}
    cured = diagnose(Experiment.from_dict(given.to_dict(), found.remedy.settings))
    assert cured.margins is not None
    assert cured.margins.phase is not None
    assert cured.margins.phase > 0.0
    assert not cured.symptoms


def test_an_unstable_loop_that_shows_nothing_yet_is_said(link: Any) -> None:
    """Too short a run to have a symptom: the sentence has the margin; at a smaller integral there is none to tell."""
    for ki, is_said in ((3080.0, True), (1500.0, False)):
        controller = {"name": "c", "law": "pid", "gains": {"lam": 8.0, "kv": 20.0, "ki": ki}}
        found = diagnose(link(controller, {}, chain={"command_delay": 0.004}, run={"duration": 2.5}))
        assert found.symptoms == ()
        assert ("unstable at joint elbow" in found.sentence) == is_said


def test_what_a_disturbance_forces_is_no_limit_cycle(link: Any) -> None:
    """It is called by its cause, and no gains that would raise the torque are its cure."""
    wave = {"kind": "sinusoid", "channel": "torque", "amplitude": [4.0], "frequency_hz": 25.0}
    found = diagnose(link(impedance(400.0, 40.0), {}, disturbances=[wave]))
    assert found.seen.shaking is not None
    assert found.seen.shaking.frequency == pytest.approx(25.0, rel=0.05)
    assert "limit-cycles" not in found.sentence
    assert [cause.key for cause in found.causes] == ["disturbances"]
    assert not found.advice.startswith("larger")


def test_a_forced_response_is_told_from_a_limit_cycle(link: Any) -> None:
    """In the metric as well: the same torque without the wave in its disturbances counts as a limit cycle."""
    wave = {"kind": "sinusoid", "channel": "torque", "amplitude": [4.0], "frequency_hz": 25.0}
    given = link(impedance(400.0, 40.0), {}, disturbances=[wave])
    loop = build(given)
    run = Session().run(loop.plant, trial_of(given, loop, loop.controllers[0]))
    forced, free = (
        metrics_of(given, loop._replace(disturbance=torque), given.controllers[0], run)
        for torque in (loop.disturbance, None)
    )
    assert forced.limit_cycle.value == 0.0
    assert free.limit_cycle.value == pytest.approx(forced.chattering.value, rel=0.05)


def cases(link: Any) -> list[Experiment]:
    """Return experiments of which each has a cure with a number."""
    coarse = {"quantisation": 0.0015, "velocity": "differentiated", "velocity_filter": 300.0}
    pid = {"name": "c", "law": "computed-torque", "gains": {"lam": 5.0, "kv": 10.0, "ki": 20.0}}
    return [
        link(impedance(100.0, 10.0), {}, chain={**NOISE, "command_delay": 0.002}),
        link(impedance(100.0, 10.0), {}, chain=coarse),
        experiment(pd(60), chain={"command_delay": 0.02}),
        experiment(pd(60), chain="slow-delay"),
        experiment(pd(100), run={"control_period": 0.02}),
        experiment(sliding(0.3, equivalent_control=True)),
        experiment(pd(12, lam=2.0), plant={**PLANT, "payload": {"mass": 5.0}}),
        link(pid, {"amplitude": [0.3], "frequency_hz": 0.2}, plant={"friction": {"coulomb": 3.0, "speed": 0.02}}),
        link({**pid, "law": "pid", "gains": {"lam": 5.0, "kv": 10.0, "ki": 1.0}}, {}),
        link({"name": "c", "law": "position-servo", "gains": {"kp": 20.0, "kd": 4.0, "ki": 1.0}}, {}),
    ]


@pytest.mark.parametrize(
    "number", [pytest.param(k, marks=[pytest.mark.slow] * (k in (0, 3, 6, 8, 9))) for k in range(10)]
)
def test_a_cure_does_when_it_is_pasted(link: Any, number: int) -> None:
    """With its settings the symptom is half as large at most, nothing is new, and no other symptom 10 % larger."""
    given = cases(link)[number]
    found = diagnose(given)
    tried = [one for one in (found.remedy, *found.cures, *(c.remedy for c in found.causes)) if one.settings]
    assert tried, found.sentence
    law = {7: "gravity-friction", 8: "pd-gravity", 9: "joint-impedance"}.get(number)
    assert law is None or f"controllers.c.law={law}" in found.causes[0].remedy.settings
    (kind, *_), seen = found.symptoms, found.seen
    for one in tried[:2]:
        pasted = Experiment.from_dict(given.to_dict(), one.settings)
        cured = _Search(pasted, pasted.controllers[0], None).whole
        joint = seen.joint(kind)
        assert not cured.has(kind) or cured.size(kind, joint) <= 0.5 * seen.size(kind, joint), one
        for other in set(KINDS) - {kind}:
            assert not cured.has(other) or cured.size(other) <= 1.1 * seen.size(other), one


@pytest.mark.parametrize(
    ("phases", "taken"),
    [((12.0, 25.0, 35.0, 50.0), 2), ((12.0, 25.0, 20.0), 1), ((40.0, 50.0), 0), ((None, 35.0), 0), ((-5.0, 9.0), 1)],
)
def test_a_cure_that_leaves_30_deg_is_preferred(
    link: Any, monkeypatch: pytest.MonkeyPatch, phases: tuple[float | None, ...], taken: int
) -> None:
    """Of changes that calm it is the first that leaves as much, or of which none is known; else the one with most."""
    given = link(impedance(100.0, 10.0), {})
    search = _Search(given, given.controllers[0], None)
    variants = [Variant(replace(given, name=f"v{k}"), f"v{k}") for k in range(len(phases))]

    def margins(self: _Search, changed: Experiment) -> Margins | None:
        phase = phases[int(changed.name[1:])]
        none: Any = np.zeros(1)
        return None if phase is None else Margins(0, 0.0, none, none, none, 1.0, phase, 1e-3, None, None, {})

    monkeypatch.setattr(_Search, "look", lambda self, *what: self.whole)
    monkeypatch.setattr(_Search, "_cured", lambda self, *what: True)
    monkeypatch.setattr(_Search, "_margins", margins)
    best, _ = search._first("shakes", "a change", variants)
    assert (best.text.split()[0], best.phase) == (f"v{taken}", phases[taken])


@pytest.mark.parametrize(
    ("in_law", "in_chain", "first"),
    [
        (Remedy("law", cures=True, phase=26.0), Remedy("chain", cures=True, phase=85.0), "chain"),
        (Remedy("law", cures=True, phase=35.0), Remedy("chain", cures=True, phase=85.0), "law"),
        (Remedy("law", cures=True, phase=26.0), Remedy("chain", cures=False, left=0.3, phase=85.0), "law"),
        (Remedy("law", cures=False, left=0.2, phase=12.0), Remedy("chain", cures=False, left=0.3, phase=50.0), "law"),
        (Remedy("law", cures=False, left=0.4, phase=50.0), Remedy("chain", cures=False, left=0.3, phase=12.0), "chain"),
        (Remedy("law", cures=True, phase=12.0), Remedy("chain", cures=True, phase=None), "chain"),
    ],
)
def test_the_change_to_make_first(in_law: Remedy, in_chain: Remedy, first: str) -> None:
    """Effect comes before margin, and margin, up to the 30 deg that are enough, before where it is changed."""
    seen: Any = None
    cause = Cause("command_delay", "the delay", "shakes", 1.0, "", "", remedy=in_chain)
    given = Diagnosis("e", "c", "pd", ("joint",), seen, ("shakes",), (cause,), None, (in_law,), 1, False, None)
    assert given.remedy.text == first
    other = replace(cause, symptom="errs", remedy=Remedy("elsewhere"))
    assert replace(given, causes=(other,)).remedy.text == "law", "a cure of the first symptom"
    assert replace(given, causes=(other,), cures=()).remedy.text == "elsewhere"


@pytest.mark.parametrize("chain", ["ideal", "slow-delay", {"encoder_noise": 1e-3, "velocity": "differentiated"}])
def test_settings_make_one_experiment_of_the_other(chain: Any) -> None:
    """Lists, small numbers and chains that have a name survive it."""
    before = experiment(pd(20), chain=chain)
    changed = with_chain(before, encoder_noise=2e-5, torque_rate=(1e3, 25.5))
    after = changed.with_({"controllers.c.gains.kv": (12.5, 3.0), "plant.timestep": 0.0005})
    assert Experiment.from_dict(before.to_dict(), settings_between(before, after)) == after
    assert settings_between(before, before) == ()
