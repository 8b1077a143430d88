"""Lyapunov function, its rate, the reaching condition and time, against definitions and closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sampled import simulate_sampled
from torquebench import AnalyticPlant, Controller, Puma560, find_law, load_model
from torquebench.certificates import SlidingLaw, certify, coriolis_force, required_gain
from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.experiment.build import build
from torquebench.experiment.certify import certificates, flags, sliding_law
from torquebench.experiment.run import run_experiment
from torquebench.references import Sine, Step
from torquebench.sim.trajectory import Outcome, Trajectory

PERIOD = 0.001
K = 0.3
PHI = 3.0


def run_of(reference: Any, k: float = K, duration: float = 1.0, switching: str = "sign", **more: Any) -> Trajectory:
    """Return a run of sliding mode with a perfect model on the two-link arm."""
    arm, law = load_model("two-link"), find_law("smc")
    gains = {"lam": 10.0, "k": k} | ({"phi": PHI} if switching == "saturation" else {})
    packed = law.pack_gains(2, gains, {"equivalent_control": True, "switching": switching})
    return simulate_sampled(AnalyticPlant(arm), Controller("c", law, packed), arm, reference, duration=duration, **more)


def law_of(k: float = K, phi: float | None = None) -> SlidingLaw:
    """Return what `run_of`'s certificates need."""
    limit = AnalyticPlant(load_model("two-link")).tau_max
    return SlidingLaw(np.full(2, 10.0), k * limit, None if phi is None else np.full(2, phi), load_model("two-link"))


@pytest.mark.parametrize("name", ["two-link", "puma560"])
def test_coriolis_force_makes_the_energy_balance(name: str) -> None:
    """The power s' C s is s' (dM/dt) s / 2 with dM/dt by central differences; 1e-7 of it, their error."""
    arm = load_model(name)
    q, qd, s = np.random.default_rng(0).normal(size=(3, 50, arm.n))
    h = 1e-5
    rate = (arm.mass_matrix(q + h * qd) - arm.mass_matrix(q - h * qd)) / (2 * h)
    wanted = 0.5 * np.einsum("ki,kij,kj->k", s, rate, s)
    found = np.einsum("ki,ki->k", s, coriolis_force(arm, q, qd, s))
    assert np.max(np.abs(found - wanted)) < 1e-7 * np.max(np.abs(wanted))


def test_the_rate_of_V_is_that_of_the_equation() -> None:
    """(109) is s' (M ds + C s): in the boundary layer, where all is smooth, to the control period's first order."""
    run = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation", initial_q=np.array([0.1, -0.1]))
    arm = load_model("two-link")
    found = certify(run, arm, law_of(phi=PHI), PERIOD)
    e, de = run.q_ref - run.q, run.qd_ref - run.qd
    s = de + 10.0 * e
    qdd = arm.forward_dynamics(run.q, run.qd, run.tau)
    ds = run.qdd_ref - qdd + 10.0 * de
    wanted = np.einsum("ki,kij,kj->k", s, arm.mass_matrix(run.q), ds)
    wanted += np.einsum("ki,ki->k", s, coriolis_force(arm, run.q, run.qd, s))
    assert np.max(np.abs(found.V_rate - wanted[:-1])) < 0.05 * np.max(np.abs(wanted))
    assert np.max(np.abs(found.V_rate + wanted[:-1])) > np.max(np.abs(wanted))  # the sign


def test_the_demand_is_the_disturbance_where_the_model_is_right() -> None:
    """A perfect model leaves the law |C s - d| to fight, (123) with tau_eq exact; 0.05 N m, what it moves in a period.

    (98) has no C s in it, unlike (113); without a disturbance s stays so small that nothing is left.
    """
    push, arm = np.array([3.0, -2.0]), load_model("two-link")
    run = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation", disturbance=np.tile(push, (1000, 1)))
    found = certify(run, arm, law_of(phi=PHI), PERIOD)
    turning = coriolis_force(arm, run.q[:-1], run.qd[:-1], found.s)
    assert np.max(np.abs(turning)) > 0.2
    assert np.max(np.abs(found.demand - np.abs(turning - push))) < 0.05
    calm = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation")
    assert np.max(certify(calm, arm, law_of(phi=PHI), PERIOD).demand) < 0.05


def test_eta_is_the_margin_of_a_law_that_only_switches() -> None:
    """Outside its layer eta_i >= K_i less the demand where no torque is at its limit; equal where d opposes K fully."""
    push = np.array([3.0, -2.0])
    run = run_of(Step([0.3, -0.2], 0.1), disturbance=np.tile(push, (1000, 1)))
    found = certify(run, load_model("two-link"), law_of(), PERIOD)
    limit = np.asarray(AnalyticPlant(load_model("two-link")).tau_max)
    free = (np.abs(found.s) > found.layer) & (np.abs(run.tau[:-1]) < limit * (1.0 - 1e-9))
    assert free.sum() > 20
    excess = (found.eta - found.margin)[free]
    assert np.min(excess) > -1e-6 * np.max(found.K)
    assert np.min(np.abs(excess)) < 1e-6 * np.max(found.K)
    assert found.least_eta is not None
    assert found.least_eta < 1.0


def test_the_layer_is_reached_within_its_bound() -> None:
    """After a step: within the bound, and (124) holds at every instant until the first joint is in its layer."""
    run = run_of(Step([0.6, -0.4], 0.1), duration=2.0)
    found = certify(run, load_model("two-link"), law_of(), PERIOD)
    assert found.reaching_from == pytest.approx(0.1)
    assert 0.02 < found.reaching_time < found.reaching_bound < np.inf
    first = 100
    last = first + int(np.argmax(np.any(np.abs(found.s[first:]) <= found.layer, axis=1)))
    assert last > first + 10
    eta = np.min(found.margin[first:last], axis=0)
    assert np.all(eta > 0.0)
    assert np.all(found.V_rate[first : last - 1] <= -0.95 * np.abs(found.s[first : last - 1]) @ eta)


@pytest.mark.parametrize("config", ["fig10-step", "fig9-step"])
def test_no_layer_is_reached_later_than_its_bound(config: str) -> None:
    """Whatever the law has beside K sgn(s): an integral or a fuzzy part that lets V grow has no bound at all.

    2 % and a period for taking dV/dt as its mean over the control period.
    """
    experiment = load_experiment(Path(f"configs/paper/{config}.yaml"))
    result = run_experiment(experiment)
    found = certificates(experiment, result.loop, result.runs)
    assert len(found) >= 3
    for name, proof in found.items():
        grew = proof.V_rate > 0.0
        if np.isfinite(proof.reaching_bound):
            assert proof.reaching_time <= 1.02 * proof.reaching_bound + PERIOD, name
        else:
            first = round(proof.reaching_from / PERIOD)
            last = len(proof.t) if np.isinf(proof.reaching_time) else first + round(proof.reaching_time / PERIOD)
            assert np.any(grew[first : max(last, first + 1)]), name


def test_too_small_a_gain_has_no_bound() -> None:
    """A push larger than K: the margin is negative, and there is no bound on the reaching time."""
    push = np.tile([0.5 * float(AnalyticPlant(load_model("two-link")).tau_max[0]), 0.0], (1000, 1))
    run = run_of(Step([0.3, 0.3], 0.1), k=0.1, disturbance=push)
    found = certify(run, load_model("two-link"), law_of(0.1), PERIOD)
    assert found.to_json()["worst_margin"]["value"] < 0.0
    assert found.to_json()["worst_margin"]["joint"] == 1
    assert found.to_json()["reaching_bound"] is None


def test_the_gain_needed_is_what_the_model_leaves() -> None:
    """Without a model the peak of the inverse dynamics; with a perfect one the peak of the disturbance; exactly."""
    arm = Puma560()
    t = np.arange(0.0, 2.0, 0.01)
    reference = Sine([1.2, -1.0, 1.0, 1.0, 1.0, 1.0], [0.5, 0.6, 0.7, 0.8, 0.9, 1.0])(t)
    blind = SlidingLaw(np.full(6, 10.0), np.ones(6), None, None)
    torque = np.abs(arm.inverse_dynamics(*reference)).max(axis=0)
    assert required_gain(arm, blind, *reference, None) == pytest.approx(torque, rel=1e-12)
    push = np.random.default_rng(1).normal(size=(len(t), 6))
    knowing = replace(blind, belief=Puma560())
    assert required_gain(arm, knowing, *reference, push) == pytest.approx(np.abs(push).max(axis=0), rel=1e-9)


def test_a_gain_too_small_is_flagged_before_the_run() -> None:
    """Without a model k = 0.3 is less than the 99 of 186 N m that the shoulder peaks at on the sine."""
    config = Path("configs/paper/fig9-chattering.yaml")
    blind = ["controllers.conventional.equivalent_control=false"]
    experiment = load_experiment(config, blind)
    (flag,) = flags(experiment, build(experiment))
    assert (flag.controller, flag.joint) == ("conventional", "shoulder")
    assert flag.needed == pytest.approx(99.0, abs=0.5)
    assert flag.k_needed == pytest.approx(99.0 / 186.4, abs=0.003)
    enough = load_experiment(config, [*blind, "controllers.conventional.gains.k=0.6"])
    assert flags(enough, build(enough)) == ()


def test_forms_without_a_certificate() -> None:
    """(98) read literally has not the model's equivalent control, another surface not s = de + lambda e.

    With its switching term left out a law has no K. Other ablations, and (149) as printed, have a certificate.
    """
    literal = load_experiment(Path("configs/paper/literal.yaml"))
    loop = build(literal)
    found = {keys.name: sliding_law(keys, loop, 6) for keys in literal.controllers}
    assert found["equation-98"] is None
    assert found["equation-149"] is not None
    assert found["equation-149"].phi is None
    for surface, has in (("pd", True), ("pi", False), ("pid", False)):
        changed = load_experiment(
            Path("configs/paper/literal.yaml"),
            ["controllers.equation-98.equivalent_control=true", f"controllers.equation-98.surface={surface}"],
        )
        assert (sliding_law(changed.controllers[1], loop, 6) is not None) == has
    ablations = load_experiment(Path("configs/paper/ablations.yaml"))
    loop = build(ablations)
    laws = [sliding_law(keys, loop, 6) for keys in ablations.controllers if keys.law == "fuzzy-linear-band-smc"]
    assert len(laws) == 12
    assert all(law is not None and law.belief is None for law in laws)
    bandless = load_experiment(
        Path("configs/paper/ablations.yaml"),
        ["controllers.l-no-band.band=off", "controllers.l-no-band.gains={lam: 10, kv: 20, kf: 0.3, gd: 1, ki: 2000}"],
    )
    assert sliding_law(bandless.controllers[4], build(bandless), 6) is None


def test_a_failed_run_has_no_certificate() -> None:
    """As it has no metrics."""
    run = replace(run_of(Step([0.3, 0.3], 0.1), duration=0.2), outcome=Outcome.DIVERGED)
    with pytest.raises(ResultError, match="completed run"):
        certify(run, load_model("two-link"), law_of(), PERIOD)


def test_an_example_that_warns_explains_the_warning() -> None:
    """Whoever copies from configs/*.yaml and is warned of (123) finds in a comment what it is; nobody else does."""
    warned = set()
    for path in sorted(Path("configs").glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        if "\nsweep:" in text:
            continue
        experiment = load_experiment(path)
        comments = [line for line in text.splitlines() if line.startswith("#") and "(123)" in line]
        if flags(experiment, build(experiment)):
            warned.add(path.stem)
        assert (len(comments) == 1) == (path.stem in warned), path
    assert {"scenarios", "fuzzy"} <= warned
