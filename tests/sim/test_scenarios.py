"""The protocol's scenarios from their YAML: both plants agree in each; closed forms of their effects."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

import torquebench as tb
from tests.arms import pack, slider, still
from tests.experiment.examples import parse
from tests.sim.loops import go
from tests.sim.protocol import differing_bytes
from torquebench.chain import Chain
from torquebench.disturbances import BandLimitedNoise
from torquebench.experiment.build import build
from torquebench.experiment.run import run_experiment, trial_of
from torquebench.robot import Puma560
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.simulate import simulate, simulate_many
from torquebench.sim.trajectory import Trajectory

SIGMA = "[5.06, 16.59, 3.30, 0.54, 0.62, 0.81]"
BASE = """\
name: scenario
plant: {engine: analytic, model: puma560}
model: {structure: corrected, constants: printed}
controllers:
  - {name: sign, law: smc, gains: {lam: 10, k: 0.3}}
  - {name: proposed, law: fuzzy-linear-band-smc, equivalent_control: false,
     gains: {lam: 20, k: 0.3, phi: 1.0, kv: 60, kf: 0.3, gd: 4, ki: 15000}}
reference: {kind: sine, amplitude: [1.2, -1.0, 1.0, 1.0, 1.0, 1.0], frequency_hz: [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]}
run: {duration: 4.0, seed: 7}
"""
MISMATCH = ("model.mismatch.relative=0.3",)
PAYLOAD = ("plant.payload={mass: 2, at: 1.5}",)
NOISE = (f"disturbances=[{{kind: band-limited-noise, channel: torque, sigma: {SIGMA}}}]",)
FRICTION = "{viscous: [5.8, 9.3, 4.0, 0.36, 0.36, 0.22], coulomb: [26, 14, 6.5, 1.0, 1.3, 0.7]}"
SCENARIOS: dict[str, tuple[str, ...]] = {
    "nominal": (),
    "mismatch": MISMATCH,
    "mismatch within tolerances": ("model.mismatch.tolerance=1",),
    "one constant": ("model.mismatch.constants={g1: 1.3}",),
    "mismatch of a rigid body": ("model.structure=exact", "model.constants=fitted", *MISMATCH),
    "payload": ("plant.payload.mass=2",),
    "payload in mid-run": PAYLOAD,
    "payload off the wrist": ("plant.payload={mass: 2, offset: [0.05, 0, 0.1]}",),
    "noise": NOISE,
    "bias": (f"disturbances=[{{kind: bias, channel: torque, value: {SIGMA}}}]",),
    "sinusoid": (f"disturbances=[{{kind: sinusoid, channel: torque, rms: {SIGMA}}}]",),
    "friction": (f"plant.friction={FRICTION}",),
    "perturbed plant": ("plant.perturb.relative=0.2",),
    "all": (*MISMATCH, *PAYLOAD, *NOISE),
    "everything": (*MISMATCH, *PAYLOAD, *NOISE, f"plant.friction={FRICTION}", "plant.perturb.relative=0.2"),
}
CHAINS = {
    "ideal": "ideal",
    "fast": "fast",
    "slow": "slow",
    "late": "{encoder_noise: 1e-4, velocity: differentiated, velocity_filter: 300, measurement_delay: 0.001, "
    "actuator_lag: 0.003}",
    "rounded": "{encoder_noise: 0.0001, quantisation: 0.0002, measurement_delay: 0.002, actuator_lag: 0.002}",
}
BLIND = (
    "{encoder_noise: 0.0001, quantisation: 0.0002, velocity: differentiated, measurement_delay: 0.002, "
    "actuator_lag: 0.002}"
)
"""A chain through which a law sees whole steps of the encoders only, in position and velocity."""
TOLERANCE = 1e-12
"""Round-off of 4,000 steps is a few 1e-15 rad; 1e-12 leaves room for other processors."""


@cache
def nominal_on(chain: str) -> Mapping[str, Trajectory]:
    """Return the runs without a scenario on a chain, which are the same beside each."""
    return run_experiment(parse(BASE, f"chain={CHAINS[chain]}")).runs


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_both_plants_agree_in_every_scenario(scenario: str, chain: str, figure: Any) -> None:
    """4 s of closed loop, Runge-Kutta at 1 ms, a switching law and the proposed one: joint angles within 1e-12 rad.

    And the scenario is there: but for the nominal one, each moves the arm by more than 10 urad.
    """
    edits = (*SCENARIOS[scenario], f"chain={CHAINS[chain]}")
    runs = [run_experiment(parse(BASE, f"plant.engine={engine}", *edits)).runs for engine in ("mujoco", "analytic")]
    assert {run.path for each in runs for run in each.values()} == {"native"}
    assert all(run.completed for each in runs for run in each.values())
    gap = max(float(np.max(np.abs(runs[0][name].q - runs[1][name].q))) for name in runs[0])
    figure(f"MuJoCo against analytic, 4 s, {scenario}, {chain} [rad]", gap, "<= 1e-12")
    assert gap <= TOLERANCE
    if scenario not in ("nominal", "one constant", "mismatch within tolerances"):
        nominal = nominal_on(chain)
        assert max(float(np.max(np.abs(runs[1][name].q - nominal[name].q))) for name in nominal) > 1e-5


def test_what_a_law_cannot_see_is_the_arms_own_affair(figure: Any) -> None:
    """Rounded positions and their differences: laws on both plants see and do the same to the last bit.

    What is smaller than a step of the encoders no law corrects, so that round-off grows as the arm lets it: the
    plants come apart no faster than one of them does from itself when started one unit in the last place away.
    """
    experiments = [parse(BASE, f"plant.engine={engine}", f"chain={BLIND}") for engine in ("mujoco", "analytic")]
    loops = [build(experiment) for experiment in experiments]
    shifted = loops[1]._replace(initial_q=np.full(6, 2.0**-53))
    runs = [
        run_experiment(e, loop).runs for e, loop in zip([*experiments, experiments[1]], [*loops, shifted], strict=True)
    ]
    for name in runs[0]:
        a, b, c = (found[name] for found in runs)
        for signal in ("q_meas", "qd_meas", "tau"):
            assert getattr(a, signal).tobytes() == getattr(b, signal).tobytes()
        gap, own = (float(np.max(np.abs(x.q - b.q))) for x in (a, c))
        figure(f"MuJoCo against analytic, 4 s, blind to less than a step, {name} [rad]", gap, "shown only")
        figure(f"analytic against itself, started 1.1e-16 rad away, {name} [rad]", own, "shown only")
        assert gap < 30.0 * own
        assert own > TOLERANCE


@pytest.mark.parametrize("engine", ["mujoco", "analytic"])
def test_everything_at_once_on_both_paths_and_any_number_of_threads(engine: str) -> None:
    """0 differing bytes between the paths over 0.5 s, and between 1, 2 and 4 threads."""
    edits = (*SCENARIOS["everything"], f"chain={BLIND}", "plant.payload.at=0.1")
    experiment = parse(BASE, f"plant.engine={engine}", "run.metrics_from=0", "run.duration=0.5", *edits)
    loop = build(experiment)
    both = [run_experiment(experiment, loop, path=path).runs for path in ("native", "python")]  # type: ignore[arg-type]
    assert [differing_bytes(both[0][name], both[1][name]) for name in both[0]] == [0, 0]
    trials = [trial_of(experiment, loop, controller) for controller in loop.controllers] * 4
    wanted = [both[0][controller.name].digest() for controller in loop.controllers] * 4
    for workers in (1, 2, 4):
        assert [run.digest() for run in simulate_many(loop.plant, trials, workers=workers)] == wanted


def test_a_draw_is_the_same_for_every_law() -> None:
    """All laws of an experiment meet one plant, one belief and the same torques; another draw has others throughout."""
    edits = (*SCENARIOS["everything"], "chain=slow")
    loops = [build(parse(BASE, *edits, f"run.draw={draw}")) for draw in (0, 0, 1)]
    for same, x in ((True, loops[1]), (False, loops[2])):
        for first, second in (
            (loops[0].disturbance, x.disturbance),
            (loops[0].drawn.position, x.drawn.position),
            (loops[0].model.flat.constants, x.model.flat.constants),
            (loops[0].plant._arm.model.mass, x.plant._arm.model.mass),
        ):
            assert (np.asarray(first).tobytes() == np.asarray(second).tobytes()) is same


def test_one_use_of_chance_does_not_shift_another() -> None:
    """Mismatch, perturbation, torque noise and encoder noise each keep their numbers when the others are added."""
    alone = {name: build(parse(BASE, *SCENARIOS[name])) for name in ("mismatch", "perturbed plant", "noise")}
    together = build(parse(BASE, *SCENARIOS["everything"], "chain=slow"))
    assert np.array_equal(together.model.flat.constants, alone["mismatch"].model.flat.constants)
    assert np.array_equal(together.plant._arms[0].model.mass, alone["perturbed plant"].plant._arm.model.mass)  # type: ignore[attr-defined]
    assert together.disturbance is not None
    assert np.array_equal(together.disturbance, np.asarray(alone["noise"].disturbance))
    noise = build(parse(BASE, "chain=slow")).drawn.position
    assert np.array_equal(np.asarray(together.drawn.position), np.asarray(noise))


def test_a_bias_leaves_the_error_that_it_must() -> None:
    """PD with exact gravity compensation, at rest: e = -d/Kp, Kp = lambda kV Mbar, on every joint, to 1e-9 rad."""
    arm, bias = Puma560(), np.array([5.06, 16.59, 3.30, 0.54, 0.62, 0.81])
    target = np.array([0.3, -0.4, 0.5, 0.2, -0.3, 0.1])

    def gravity_at_target(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        tau[:] = arm.gravity(q) + 200.0 * arm.flat.inertia_scale * (ref.q - q) - 30.0 * arm.flat.inertia_scale * qd

    run = go(
        AnalyticPlant(Puma560()),
        gravity_at_target,
        3.0,
        model=Puma560(),
        reference=still(target),
        initial_q=target,
        disturbance=np.tile(bias, (3000, 1)),
        control_period=0.001,
    )
    assert run.q[-1] - target == pytest.approx(bias / (200.0 * arm.flat.inertia_scale), abs=1e-9)


def test_a_sinusoid_swings_a_mass_as_it_must() -> None:
    """2 kg under a sin(w t), sampled and held over T: velocity is T/m times the sum of the samples, exactly.

    And so near to a/(m w) (1 - cos w t), the smooth torque's, that half a sample of delay tells them apart.
    """
    a, w, period, m = 3.0, 2.0 * math.pi * 2.5, 0.002, 2.0
    t = period * np.arange(1000)
    torque = a * np.sin(w * t)[:, None]

    def nothing(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        tau[0] = 0.0

    run = go(
        AnalyticPlant(slider(m)),
        nothing,
        2.0,
        model=slider(m),
        reference=still(np.zeros(1)),
        disturbance=torque,
        control_period=period,
    )
    held = np.concatenate([[0.0], np.cumsum(torque[:-1, 0]) * period / m])
    assert run.qd[:, 0] == pytest.approx(held, abs=1e-12)
    smooth = a / (m * w) * (1.0 - np.cos(w * (t - 0.5 * period)))
    assert run.qd[:, 0] == pytest.approx(smooth - smooth[0], abs=a / (m * w) * (w * period) ** 2)


@pytest.mark.parametrize("periods", [0, 1, 4])
def test_a_delay_shifts_the_loop_as_it_must(periods: int) -> None:
    """tau_k = -c v_(k-d) on a slide: v_(k+1) = v_k - c T/m v_(k-d), the recurrence itself, to 1e-12."""
    m, c, period = 2.0, 20.0, 0.004

    def damper(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        tau[0] = 50.0 if t < 0.5 * period else -c * qd[0]

    run = go(
        AnalyticPlant(slider(m)),
        damper,
        0.4,
        model=slider(m),
        reference=still(np.zeros(1)),
        chain=Chain(measurement_delay=periods * period),
        control_period=period,
    )
    v = [0.0, 50.0 * period / m]
    for k in range(1, 99):
        v.append(v[k] - c * period / m * v[max(k - periods, 0)])
    assert run.qd[:, 0] == pytest.approx(np.array(v), abs=1e-12)
    assert abs(v[-1]) < 0.1


def test_a_coarse_encoder_leaves_a_dead_zone() -> None:
    """PD without velocity noise on rounded positions: within half a step of the target nothing pulls any more."""
    quantum = 0.01

    def spring(gains: Any, model: Any, t: float, q: Any, qd: Any, ref: Any, memory: Any, tau: Any) -> None:
        tau[0] = -200.0 * q[0] - 60.0 * qd[0]

    for start, settles in ((0.0049, 0.0049), (-0.0049, -0.0049), (0.0051, None)):
        run = go(
            AnalyticPlant(slider(2.0)),
            spring,
            1.0,
            model=slider(2.0),
            reference=still(np.zeros(1)),
            chain=Chain(quantisation=quantum),
            initial_q=np.array([start]),
        )
        if settles is None:
            assert abs(run.q[-1, 0]) < 0.5 * quantum
        else:
            assert np.all(run.q == settles)


def test_scenarios_work_from_python_alone() -> None:
    """`simulate` with plain objects gives the bytes of the YAML."""
    experiment = parse(BASE, "plant.engine=mujoco", *PAYLOAD, f"plant.friction={FRICTION}", *NOISE, "chain=slow")
    loop = build(experiment)
    wanted = run_experiment(experiment, loop).runs["sign"]
    friction = tb.Friction([5.8, 9.3, 4.0, 0.36, 0.36, 0.22], [26, 14, 6.5, 1.0, 1.3, 0.7])
    plant = tb.MujocoPlant("puma560", payload=tb.Payload(2.0, at=1.5), friction=friction)
    run = simulate(
        plant,
        pack("smc", 6, {"equivalent_control": True, "switching": "sign"}, lam=10, k=0.3),
        Puma560("corrected", "printed"),
        loop.reference,
        duration=4.0,
        chain=tb.CHAINS["slow"],
        disturbances=[BandLimitedNoise(tuple(json.loads(SIGMA)))],
        seed=experiment.run.seed,
        draw=experiment.run.draw,
    )
    assert differing_bytes(run, wanted) == 0
