"""Margins of a loop against closed forms of one joint under PD."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.diagnosis.test_causes import PLANT, SINE, experiment, pd
from tests.diagnosis.test_poles import WHERE, at_rest, first_pole
from torquebench.diagnosis.margins import Margins, margins_of, resonances, slopes_of, torque_noise
from torquebench.diagnosis.owners import owner_of
from torquebench.diagnosis.poles import poles_of
from torquebench.experiment.build import build
from torquebench.experiment.run import trial_of
from torquebench.robot import load_model
from torquebench.sim.session import Session

CHAIN = {"command_delay": 0.004, "actuator_lag": 0.003}


def test_slopes_of_pd() -> None:
    """At no error -d tau/d qd is Kd = kV Mbar and -d tau/d q is lambda Kd, to the differences' error."""
    built = experiment(pd(20, "pd"))
    slopes = slopes_of(built, build(built))
    Kd = 20.0 * load_model("two-link").flat.inertia_scale
    assert np.diagonal(slopes.damping, axis1=1, axis2=2) == pytest.approx(np.tile(Kd, (5, 1)), rel=1e-6)
    assert np.diagonal(slopes.stiffness, axis1=1, axis2=2) == pytest.approx(np.tile(10.0 * Kd, (5, 1)), rel=1e-6)
    assert not slopes.jumps


def test_phase_lost_to_delay_and_lag() -> None:
    """A delay d costs 360 f d degrees at the crossover f, a lag T atan(2 pi f T), half a period of hold 180 f T."""
    built = experiment(pd(60), chain=CHAIN)
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.crossover is not None
    f = found.crossover
    assert found.lost["command_delay"] == pytest.approx(360.0 * f * 0.004, rel=1e-9)
    assert found.lost["actuator_lag"] == pytest.approx(math.degrees(math.atan(2.0 * math.pi * f * 0.003)), rel=1e-9)
    assert found.lost["hold"] == pytest.approx(180.0 * f * 0.001, rel=1e-9)


def test_phase_lost_to_an_integral() -> None:
    """It is the angle between kp + s kd and that plus ki T/(z - 1) at the crossover.

    Computed torque makes a joint a double integrator, but for gravity's slope there: 0.2 degrees.
    """
    kv, lam, ki, T = 20.0, 10.0, 800.0, 0.001
    law = {"name": "c", "law": "computed-torque", "gains": {"lam": lam, "kv": kv, "ki": ki}}
    built = experiment(law)
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.crossover is not None
    s = 2j * math.pi * found.crossover
    pd_only = kv * (lam + s)
    expected = math.degrees(np.angle(pd_only / (pd_only + ki * T / (np.exp(s * T) - 1.0))))
    assert expected > 2.0
    assert found.lost["integral"] == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize(("kv", "said"), [(30, "as usual"), (48, "is little"), (80, "unstable")])
def test_what_a_margin_means(kv: float, said: str) -> None:
    """A disturbance at the crossover is |1/(1 + L)| times as large, L the open loop there; a word says what that is."""
    built = experiment(pd(kv), chain=CHAIN)
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.crossover is not None
    assert said in found.rule
    if said == "unstable":
        assert found.swell is None
        return
    real, imaginary = (np.interp(found.crossover, found.frequency, part) for part in (found.gain.real, found.gain.imag))
    # between lines 1.6 % apart
    assert found.swell == pytest.approx(1.0 / abs(1.0 + complex(real, imaginary)), rel=1e-3)


@pytest.mark.parametrize(("late", "said"), [(0.002, "own damping, a ratio of 0.16,"), (0.008, "is little")])
def test_little_damping_is_told_from_what_is_late(late: float, said: str) -> None:
    """Computed torque makes a joint at rest s^2 + kv s + kv lambda, of damping ratio (kv/lambda)^1/2 / 2.

    Of its 18 deg of margin 2 ms cost 3, and 8 ms half.
    """
    law = {"name": "c", "law": "computed-torque", "gains": {"lam": 62.5, "kv": 6.4, "ki": 0.0}}
    rest = {"kind": "sine", "amplitude": 1e-15, "frequency_hz": 0.5, "origin": WHERE}
    built = experiment(law, chain={"command_delay": late}, reference=rest, run={"initial_q": WHERE})
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.damping == pytest.approx(0.5 * math.sqrt(6.4 / 62.5), rel=1e-5)
    assert said in found.rule


UR: dict[str, Any] = {
    "plant": {"engine": "mujoco", "model": "ur5e"},
    "run": {"control_period": 0.002, "initial_q": "home"},
}


def test_whose_each_part_is() -> None:
    """The robot's is what its chain has; what differs from it, the velocity, and a longer period are the user's own."""
    reference = {"kind": "sine", "amplitude": 0.1, "frequency_hz": 0.5}

    def owners(chain: Any, **changes: Any) -> dict[str, str]:
        run = {**UR["run"], "duration": 2.0, **changes}
        built = experiment(pd(20), plant=UR["plant"], reference=reference, chain=chain, run=run)
        return {key: owner_of(built, key) for key in ("command_delay", "current_loop", "velocity", "hold", "friction")}

    whole = {
        "command_delay": "robot",
        "current_loop": "robot",
        "velocity": "config",
        "hold": "robot",
        "friction": "arm",
    }
    assert owners("ur5e") == whole
    assert owners({"from": "ur5e", "command_delay": 0.004}) == {**whole, "command_delay": "config"}
    assert owners({"from": "ur5e", "command_delay": 0.004}, control_period=0.004) == {
        **whole,
        "command_delay": "config",
        "hold": "config",
    }
    assert set(owners("fast").values()) == {"config", "arm"}


AT = [0.482, 0.301]
STILL: dict[str, Any] = {
    "reference": {"kind": "sine", "amplitude": 0.0, "frequency_hz": 0.5, "origin": AT},
    "run": {"duration": 2.0, "control_period": 0.002, "initial_q": AT},
}
"""The arm at rest, as a resonance shows there."""


LATE = {"command_delay": 0.04}
"""Brings computed torque with kv 20, lam 10 within a third of its limit."""


def told(chain: dict[str, Any]) -> Margins:
    """Return the margins of computed torque at rest with a chain."""
    built = at_rest(0.0, LATE | chain)
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    return found


def grows(chain: dict[str, Any]) -> bool:
    """Whether an error of 1e-7 rad is larger in the last second of four than in the second one."""
    built = at_rest(0.0, LATE | chain)
    loop = build(built)
    run = Session().run(loop.plant, trial_of(built, loop, loop.controllers[0]))
    e = np.abs(run.q - run.q_ref)
    return bool(np.max(e[1500:]) > np.max(e[500:1000]))


def test_a_gain_of_the_drives_is_a_gain_of_the_loop() -> None:
    """It divides the gain margin, to rounding; and arms come to rest with 5 % less than that margin, and grow beyond.

    So does a pole about rest.
    """
    bare = told({})
    assert bare.factor is not None
    for gain in (0.7, 1.2):
        assert told({"torque_gain": gain}).factor == pytest.approx(bare.factor / gain, rel=1e-9)
    for share, is_unstable in ((0.95, False), (1.05, True)):
        chain = {"torque_gain": share * bare.factor}
        assert grows(chain) == is_unstable
        assert (first_pole(at_rest(0.0, LATE | chain)).rate > 0.0) == is_unstable
        assert ((told(chain).phase or 0.0) < 0.0) == is_unstable


@pytest.mark.parametrize("turns", [1.0, -1.0])
def test_cross_talk_is_a_matrix_in_the_loop(turns: float) -> None:
    """Arms come to rest with 15 % less of it than the margins bear, and grow with 15 % more; so does a pole about rest.

    Computed torque makes both joints alike: leaks x and +-x make a gain of 1 + x of it, which is then the gain margin
    without but for gravity's slope, 1 %, or 1 + jx, which takes phase.
    """
    bare = told({})
    assert bare.factor is not None
    low, high = 0.0, 1.0
    for _ in range(8):
        x = 0.5 * (low + high)
        talk = {"cross_talk": {"following": x, "preceding": turns * x}}
        low, high = (x, high) if (told(talk).phase or 0.0) > 0.0 else (low, x)
    if turns > 0.0:
        assert 1.0 + x == pytest.approx(bare.factor, rel=0.01)
    for share, is_unstable in ((0.85, False), (1.15, True)):
        chain = {"cross_talk": {"following": share * x, "preceding": turns * share * x}}
        assert grows(chain) == is_unstable
        assert (first_pole(at_rest(0.0, LATE | chain)).rate > 0.0) == is_unstable


def test_viscous_friction_is_damping_of_the_arm() -> None:
    """The open loop is Kd (s + lam) H (M s^2 + D s + G)^-1 with the hold H, of which each line has an eigenvalue.

    To the differences of slopes and gravity, 1e-5. Poles are those of M s^2 + (D + Kd) s + G + lam Kd, to 1 % by the
    hold of 2 ms; without friction the slowest is elsewhere.
    """
    lam, kv, drag = 5.0, 10.0, np.array([8.0, 1.5])
    keys: dict[str, Any] = {"reference": STILL["reference"], "run": STILL["run"]}
    built = experiment(pd(kv, "pd", lam), plant={**PLANT, "friction": {"viscous": drag.tolist()}}, **keys)
    loop = build(built)
    slopes = slopes_of(built, loop)
    found = margins_of(built, loop, slopes)
    assert found is not None
    arm, q = load_model("two-link"), np.array(AT)
    M, Kd = arm.mass_matrix(q[None])[0], np.diag(kv * arm.flat.inertia_scale)
    G = np.stack([(arm.gravity(q + x) - arm.gravity(q - x)) / 2e-5 for x in 1e-5 * np.eye(2)], axis=1)
    T = built.run.control_period
    for f, gain in list(zip(found.frequency, found.gain, strict=True))[::40]:
        s = 2j * math.pi * f
        hold = (1.0 - np.exp(-s * T)) / (s * T)
        values = np.linalg.eigvals(hold * (lam + s) * Kd @ np.linalg.inv(M * s * s + np.diag(drag) * s + G))
        assert np.min(np.abs(values - gain)) <= 1e-5 * abs(gain)
    rates = np.linalg.solve(M, -np.hstack([G + lam * Kd, np.diag(drag) + Kd]))
    wanted = max(np.linalg.eigvals(np.vstack([np.eye(2, 4, 2), rates])), key=lambda x: (x.real, x.imag))
    near, far = (
        min(abs(complex(one.rate, math.tau * one.frequency) - wanted) for one in poles_of(each, loop, slopes))
        for each in (built, experiment(pd(kv, "pd", lam), **keys))
    )
    assert near <= 0.01 * abs(wanted)
    assert far > 0.1 * abs(wanted)


@pytest.mark.parametrize("free", [0, 1])
def test_a_locked_joint_does_not_count(free: int) -> None:
    """The other one is M s^2 + G alone under Kd (s + lambda): its crossover, 10 % or more from that with both free.

    To 0.1 %, between lines of the response.
    """
    lam, kv = 5.0, 30.0
    keys: dict[str, Any] = {"reference": STILL["reference"], "run": STILL["run"]}
    both, alone = (
        experiment(pd(kv, "pd", lam), plant={**PLANT, **lock}, **keys) for lock in ({}, {"lock": {"joint": 2 - free}})
    )
    found, before = (margins_of(built, build(built), slopes_of(built, build(built))) for built in (alone, both))
    assert found is not None
    assert before is not None
    assert found.crossover is not None
    assert before.crossover is not None
    arm, q = load_model("two-link"), np.array(AT)
    M, Kd = arm.mass_matrix(q[None])[0, free, free], kv * arm.flat.inertia_scale[free]
    step = 1e-5 * np.eye(2)[free]
    G = (arm.gravity(q + step) - arm.gravity(q - step))[free] / 2e-5
    s = 2j * math.pi * found.crossover
    assert abs(Kd * (s + lam) / (M * s * s + G)) == pytest.approx(1.0, rel=1e-3)
    assert found.joint == free
    assert abs(before.crossover / found.crossover - 1.0) > 0.1


SPRINGS = {"stiffness": [14930.0, 1415.0], "inertia": [1.11, 0.105]}


def test_a_locked_motor_leaves_its_link_on_the_spring() -> None:
    """With joint 2 locked, links and motor 1 are three masses on two springs of which one end stands."""
    built = experiment(pd(20), plant={**PLANT, "transmission": SPRINGS, "lock": {"joint": 2}}, **STILL)
    k, B = np.array(SPRINGS["stiffness"]), SPRINGS["inertia"][0]
    arm = load_model("two-link")
    M = np.zeros((3, 3))
    M[:2, :2], M[2, 2] = arm.mass_matrix(np.array(AT)[None])[0] - np.diag(arm.flat.armature), B
    K = np.array([[k[0], 0.0, -k[0]], [0.0, k[1], 0.0], [-k[0], 0.0, k[0]]])
    expected = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real)[1:]) / math.tau
    assert np.sort(resonances(built, build(built))) == pytest.approx(expected, rel=1e-6)


def test_resonances_of_elastic_joints() -> None:
    """They are those of the motors and links that the plant integrates: eigenvalues of its states."""
    from torquebench.sim.friction import NONE
    from torquebench.sim.joints import modes

    built = experiment(pd(20), plant={**PLANT, "transmission": SPRINGS})
    loop = build(built)
    found = resonances(built, loop)
    flat = load_model("two-link")
    between = built.plant.transmission
    assert between is not None
    joints = between.of_joints(flat.flat.armature)
    q = loop.reference.q[len(loop.reference.q) * 2 // 3 : len(loop.reference.q) * 2 // 3 + 1]
    links = flat.mass_matrix(q) - np.diag(flat.flat.armature)
    assert np.max(found) == pytest.approx(abs(modes(joints, NONE, links)[0].rate) / math.tau, rel=0.01)


@pytest.mark.parametrize(("sensor", "is_stable"), [("motor", True), ("link", False)])
def test_margins_of_elastic_joints(sensor: str, is_stable: bool) -> None:
    """PD is stable through a spring from the motor's side, and from the link's not: the margin's sign says so."""
    built = experiment(pd(30), plant={**PLANT, "transmission": {**SPRINGS, "damping": [4.0, 0.38], "sensor": sensor}})
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.phase is not None
    assert (found.phase > 0.0) == is_stable


def a_pole_grows(law: dict[str, Any], **keys: Any) -> bool:
    """Whether a pole of the sampled loop grows at some instant."""
    built = experiment(law, **keys)
    loop = build(built)
    slopes = slopes_of(built, loop)
    return max(poles_of(built, loop, slopes, m)[0].rate for m in range(len(slopes.damping))) > 1e-6


def test_the_gain_margin_is_that_of_all_joints() -> None:
    """The poles of both joints' loop grow beyond it and not below it, whichever joint has the least phase margin.

    To 5 %: poles are of the sampled loop, margins as if time went on between instants.
    """
    chain = {"command_delay": 0.004, "current_loop": {"frequency": 300.0, "damping": 0.8}}
    built = experiment(pd(25, "pd"), chain=chain, run=STILL["run"], reference=STILL["reference"])
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.phase is not None
    assert found.factor is not None
    assert found.phase > 0.0
    assert not a_pole_grows(pd(0.95 * 25 * found.factor, "pd"), chain=chain, **STILL)
    assert a_pole_grows(pd(1.05 * 25 * found.factor, "pd"), chain=chain, **STILL)


def test_a_resonance_that_comes_late_encircles_nothing() -> None:
    """A resonance whose gain is above 1 from -208 to -284 degrees alone is stable, as its poles say, up to its margins.

    To a period, and 5 %.
    """
    springs = {"stiffness": [1241.0, 521.7], "damping": [0.656, 0.276], "inertia": [0.1, 0.05], "sensor": "link"}
    chain = {"actuator_lag": 0.002, "velocity": "differentiated", "velocity_filter": 100.0}
    keys = {**STILL, "plant": {**PLANT, "transmission": springs}}

    def law(gain: float = 1.0) -> dict[str, Any]:
        return {"name": "c", "law": "pd-gravity", "gains": {"lam": 3.0, "kv": 5.61 * gain}}

    built = experiment(law(), chain=chain, **keys)
    loop = build(built)
    found = margins_of(built, loop, slopes_of(built, loop))
    assert found is not None
    assert found.phase is not None
    assert found.delay is not None
    assert found.factor is not None
    assert found.phase > 0.0
    assert not a_pole_grows(law(), chain=chain, **keys)
    periods = round(found.delay / 0.002)
    assert not a_pole_grows(law(), chain={**chain, "command_delay": 0.002 * (periods - 1)}, **keys)
    assert a_pole_grows(law(), chain={**chain, "command_delay": 0.002 * (periods + 1)}, **keys)
    assert not a_pole_grows(law(0.95 * found.factor), chain=chain, **keys)
    assert a_pole_grows(law(1.05 * found.factor), chain=chain, **keys)


def test_the_loop_oscillates_where_its_phase_says() -> None:
    """With a delay beyond its margin the loop limit-cycles near the frequency at which its phase is -180 degrees.

    A quarter off at most: the cycle is clipped, and of a joint that pulls the other along.
    """
    from torquebench.diagnosis import diagnose

    found = diagnose(experiment(pd(60), chain={"command_delay": 0.02}, reference={**SINE, "frequency_hz": 0.3}))
    assert found.margins is not None
    assert found.margins.oscillation is not None
    assert found.margins.phase is not None
    assert found.margins.phase < 0.0
    assert found.seen.shaking is not None
    assert found.seen.shaking.frequency == pytest.approx(found.margins.oscillation, rel=0.25)


@pytest.mark.parametrize("rate", [None, 200.0])
def test_noise_through_the_gains(rate: float | None) -> None:
    """Noise meets (b0 + b1/z)/(1 - c/z), whose power is (b0^2 + b1^2 + 2 c b0 b1)/(1 - c^2), and the run shows as much.

    b0 = K + g, b1 = -c K - g, g = a Kd/T, c = 1 - a. Of a run's noise 10 % are chance and what the corner of chattering
    leaves out; of the law's slopes 0.1 % are gravity's.
    """
    from torquebench.diagnosis import diagnose

    chain = {"encoder_noise": 2e-4, "velocity": "differentiated"} | ({} if rate is None else {"velocity_filter": rate})
    built = experiment(pd(20), chain=chain)
    loop = build(built)
    predicted = torque_noise(built, slopes_of(built, loop))
    a = 1.0 if rate is None else 1.0 - math.exp(-rate * 0.001)
    Kd = 20.0 * load_model("two-link").flat.inertia_scale
    g, c = a * Kd / 0.001, 1.0 - a
    b0, b1 = 10.0 * Kd + g, -c * 10.0 * Kd - g
    power = (b0**2 + b1**2 + 2.0 * c * b0 * b1) / (1.0 - c * c)
    assert predicted == pytest.approx(2e-4 * np.sqrt(power), rel=2e-3)
    assert diagnose(built).seen.torque == pytest.approx(predicted, rel=0.1)
