"""Lyapunov function, its rate, the reaching condition and time, against definitions and closed forms."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.arms import PENDULUM_INERTIA, pendulum
from tests.sampled import simulate_sampled
from torquebench import CHAINS, AnalyticPlant, Chain, Controller, Puma560, find_law, load_model
from torquebench.certificates import SlidingLaw, certify, held_to, required_gain
from torquebench.errors import ResultError
from torquebench.experiment import load_experiment, parse_experiment
from torquebench.experiment.build import build
from torquebench.experiment.certify import Coarse, Overdriven, certificates, flags, resistance, sliding_law
from torquebench.experiment.folder import manifest_of
from torquebench.experiment.run import run_experiment
from torquebench.references import Quintic, Sine, Step
from torquebench.report.run_page import certificate_words
from torquebench.report.tables import certificate_table, uncovered
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
    found = np.einsum("ki,ki->k", s, arm.sliding_terms(q, qd, s)[1])
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
    wanted += np.einsum("ki,ki->k", s, arm.sliding_terms(run.q, run.qd, s)[1])
    assert np.max(np.abs(found.V_rate - wanted[:-1])) < 0.05 * np.max(np.abs(wanted))
    assert np.max(np.abs(found.V_rate + wanted[:-1])) > np.max(np.abs(wanted))  # the sign


def test_the_demand_is_the_disturbance_where_the_model_is_right() -> None:
    """A perfect model leaves the law |C s - d| to fight, (123) with tau_eq exact; 0.05 N m, what it moves in a period.

    (98) has no C s in it, unlike (113); without a disturbance s stays so small that nothing is left.
    """
    push, arm = np.array([3.0, -2.0]), load_model("two-link")
    run = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation", disturbance=np.tile(push, (1000, 1)))
    found = certify(run, arm, law_of(phi=PHI), PERIOD)
    turning = arm.sliding_terms(run.q[:-1], run.qd[:-1], found.s)[1]
    assert np.max(np.abs(turning)) > 0.2
    assert np.max(np.abs(found.demand - np.abs(turning - push))) < 0.05
    calm = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation")
    assert np.max(certify(calm, arm, law_of(phi=PHI), PERIOD).demand) < 0.05


def test_what_a_right_model_leaves_of_any_motion_is_its_disturbance() -> None:
    """By M qdd + N = tau + d, M ds + C s + tau - tau_eq is C s - d, and what wrong measurements make of tau_eq.

    To round-off for any numbers, here random ones. (122) as printed adds up the sizes of M ds, C s and g instead.
    """
    arm, n = load_model("two-link"), 40
    q, qd, q_meas, qd_meas, q_ref, qd_ref, qdd_ref, tau = np.random.default_rng(2).normal(size=(8, n, 2))
    run = Trajectory(PERIOD * np.arange(n), q, qd, q_meas, qd_meas, q_ref, qd_ref, qdd_ref, q, tau, tau, tau)
    found = certify(run, arm, law_of(phi=PHI), PERIOD)
    q, s = q[:-1], (qd_ref - qd + 10.0 * (q_ref - q))[:-1]
    qdd, wanted = np.diff(qd, axis=0) / PERIOD, qdd_ref[:-1] + 10.0 * (qd_ref - qd)[:-1]
    d = arm.inverse_dynamics(q, qd[:-1], qdd) - tau[:-1]
    _, turning, gravity = arm.sliding_terms(q, qd[:-1], s)
    believed = arm.inverse_dynamics(q_meas[:-1], qd_meas[:-1], qdd_ref[:-1] + 10.0 * (qd_ref - qd_meas)[:-1])
    left = turning - d + arm.inverse_dynamics(q, qd[:-1], wanted) - believed
    assert found.demand == pytest.approx(np.abs(left), rel=1e-9)
    assert found.margin == pytest.approx(found.K - np.abs(left), rel=1e-9)
    against = left - tau[:-1] + believed
    assert found.eta == pytest.approx(-np.sign(s) * against, rel=1e-9)
    sizes = np.abs(against - turning) + np.abs(turning) + np.abs(gravity)
    assert found.K_u == pytest.approx(np.max(sizes, axis=0), rel=1e-9)
    assert found.V == pytest.approx(0.5 * np.einsum("ki,kij,kj->k", s, arm.mass_matrix(q), s), rel=1e-12)


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
    # a disturbance that carries the arm leaves nothing to do
    carried = required_gain(arm, blind, *reference, arm.inverse_dynamics(*reference))
    assert carried == pytest.approx(np.zeros(6), abs=1e-10)


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


def test_friction_under_load_grows_with_itself() -> None:
    """Motors give what the motion takes and the friction, d = sat(qd/v0) (C + load |M qdd + N + d|), to 1e-12 N m."""
    changes = ["plant.friction={coulomb: 5, load: 0.2, speed: 0.1}"]
    experiment = load_experiment(Path("configs/paper/fig9-chattering.yaml"), changes)
    loop = build(experiment)
    drag = -resistance(experiment, loop.model, loop.reference)
    needed = loop.model.inverse_dynamics(*loop.reference)
    rising = np.clip(loop.reference.qd / 0.1, -1.0, 1.0)
    assert drag == pytest.approx(rising * (5.0 + 0.2 * np.abs(needed + drag)), abs=1e-12)
    assert np.max(np.abs(drag)) > 10.0


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


class Block:
    """An arm without bias forces whose mass matrix is constant: V is that of a body in free space."""

    def __init__(self, *rows: tuple[float, ...]) -> None:
        self.M = np.array(rows)
        self.turning = np.zeros(len(rows))

    def mass_matrix(self, q: Any) -> Any:
        """The same at every position."""
        return np.tile(self.M, (len(q), 1, 1))

    def bias_forces(self, q: Any, qd: Any) -> Any:
        """None."""
        return np.zeros_like(q)

    def sliding_terms(self, q: Any, qd: Any, s: Any) -> Any:
        """The same mass matrix, the torque C s that was set, and no gravity."""
        return self.mass_matrix(q), np.zeros_like(q) + self.turning, np.zeros_like(q)


def along(qd: Any, tau: Any = None, tau_law: Any = None, q_ref: Any = 0.0, period: float = PERIOD) -> Trajectory:
    """Return a run with given velocities (N, n), from rest at zero, by Euler's method: e_(k+1) = e_k + T de_k."""
    q = np.concatenate([np.zeros((1, qd.shape[1])), np.cumsum(qd[:-1], axis=0) * period])
    zero = np.zeros_like(qd)
    tau = zero if tau is None else tau
    reference = np.broadcast_to(q_ref, q.shape)
    law = tau if tau_law is None else tau_law
    t = period * np.arange(len(qd))
    return Trajectory(t, q, qd, q, qd, reference, zero, zero, zero, law, tau, tau)


def sliding(lam: float, *K: float, phi: float | None = None, Kp: float | None = None) -> SlidingLaw:
    """Return the parameters of a law without a model."""
    n = len(K)
    width, spring = None if phi is None else np.full(n, phi), None if Kp is None else np.full(n, Kp)
    return SlidingLaw(np.full(n, lam), np.array(K), width, None, spring)


def test_the_rate_of_V_is_that_of_constant_inertia() -> None:
    """Where M is constant it is the difference of V to round-off; a torque C s has its power beside it."""
    qd = np.random.default_rng(0).normal(size=(200, 2))
    arm = Block((2.0, 0.5), (0.5, 1.0))
    found = certify(along(qd), arm, sliding(3.0, 1.0, 1.0), PERIOD)
    fall = np.diff(0.5 * np.einsum("ki,ij,kj->k", found.s, arm.M, found.s)) / PERIOD
    assert found.V_rate[:-1] == pytest.approx(fall, rel=1e-9, abs=1e-9 * np.max(np.abs(fall)))
    arm.turning = np.array([7.0, -5.0])
    middle = 0.5 * (found.s[:-1] + found.s[1:])
    turned = certify(along(qd), arm, sliding(3.0, 1.0, 1.0), PERIOD).V_rate - found.V_rate
    assert turned[:-1] == pytest.approx(middle @ arm.turning, rel=1e-7, abs=1e-7)


def test_the_rate_of_V_is_its_mean_over_the_control_period() -> None:
    """The difference of V, to 2 % of a switching law's own, chatter and all.

    The rate at the period's beginning, s' (M ds + C s), is another one by as much as the rate itself.
    """
    run = run_of(Step([0.6, -0.4], 0.0), duration=2.0)
    found = certify(run, load_model("two-link"), law_of(), PERIOD)
    late = slice(1200, -1)
    fall = np.diff(found.V)[late] / PERIOD
    size = np.max(np.abs(fall))
    assert np.max(np.abs(found.V_rate[:-1][late] - fall)) < 0.02 * size
    jumps = np.diff(found.s, axis=0)[late] / PERIOD
    M = load_model("two-link").mass_matrix(run.q)[: len(found.s) - 1][late]
    at_first = np.einsum("ki,kij,kj->k", found.s[:-1][late], M, jumps)
    assert np.max(np.abs(at_first - fall)) > 0.3 * size


def test_the_layer_is_what_K_moves_s_in_one_period() -> None:
    """T |M^-1| K to round-off, and phi where that is wider."""
    arm = Block((2.0, 0.5), (0.5, 1.0))
    run = along(np.zeros((3, 2)))
    moved = PERIOD * np.abs(np.linalg.inv(arm.M)) @ np.array([30.0, 4.0])
    assert certify(run, arm, sliding(3.0, 30.0, 4.0), PERIOD).layer == pytest.approx(moved, rel=1e-12)
    wide = certify(run, arm, sliding(3.0, 30.0, 4.0, phi=0.015), PERIOD).layer
    assert wide == pytest.approx(np.maximum(moved, 0.015), rel=1e-12)
    assert 0.015 in wide
    assert wide.max() > 0.015
    assert certify(run, arm, sliding(3.0, 30.0, 4.0), PERIOD).to_json()["layer"] == pytest.approx(moved.tolist())


def test_the_reaching_bound_is_exact_where_s_falls_evenly() -> None:
    """One joint of inertia M under the constant torque K from s0: sqrt(2 V M) / K = M s0 / K, when s is zero.

    Of two joints V is a quarter of what M's largest row sum, 2.5, would have at that s: the bound is from it.
    """
    K, M, s0 = 4.0, 0.5, 1.6
    t = PERIOD * np.arange(300)
    qd = -np.maximum(s0 - K / M * t, 0.0)[:, None]
    found = certify(along(qd), Block((M,)), sliding(0.0, K), PERIOD)
    assert found.reaching_bound == pytest.approx(M * s0 / K, rel=1e-9)
    assert found.reaching_from == 0.0
    assert found.reaching_time == pytest.approx(M * s0 / K - PERIOD, abs=1.01 * PERIOD)
    assert found.reaching_time <= found.reaching_bound
    assert found.least_eta == pytest.approx(1.0)  # nothing opposes K
    arm = Block((2.0, 0.5), (0.5, 1.0))
    both = certify(along(np.repeat(qd, 2, axis=1)), arm, sliding(0.0, K, K), PERIOD)
    V, force = 0.5 * 4.0 * s0 * s0, 4.0 * K / M
    assert both.V[0] == pytest.approx(V)
    assert both.reaching_bound == pytest.approx(np.sqrt(2.0 * V * 2.5) / (force / 2.0), rel=1e-9)


def test_reaching_counts_from_outside_the_layer() -> None:
    """From the largest V while a joint is outside: a heavy joint in its layer may have more, and reaches nothing."""
    qd = np.zeros((100, 2))
    qd[:50, 0] = -0.9
    qd[60:70, 1] = -2.0
    qd[64, 1] = -2.5
    found = certify(along(qd), Block((100.0, 0.0), (0.0, 0.01)), sliding(0.0, 1.0, 1.0, phi=1.0), PERIOD)
    assert found.V[0] > 100.0 * found.V[64] > 0.0
    assert found.reaching_from == pytest.approx(0.064)
    assert found.reaching_time == pytest.approx(0.006)


def test_a_certificate_of_a_law_that_never_leaves_its_layer_is_vacuous() -> None:
    """It says so, and has no reaching time: null, not zero, nor a bound, nor a share in which V grew."""
    run = run_of(Sine([1.0, -1.0], [0.5, 0.7]), switching="saturation")
    found = certify(run, load_model("two-link"), law_of(phi=PHI), PERIOD)
    stored = found.to_json()
    assert found.is_vacuous
    assert stored["vacuous"] is True
    assert stored["share_outside"] == 0.0
    none = ("reaching_from", "reaching_time", "reaching_bound", "share_rising_outside", "least_eta_over_K")
    assert [stored[key] for key in none] == [None] * len(none)
    assert stored["no_bound"] == "vacuous: nothing is ever outside the layer"
    step = certify(run_of(Step([0.6, -0.4], 0.1), duration=2.0), load_model("two-link"), law_of(), PERIOD).to_json()
    assert (step["vacuous"], step["no_bound"]) == (False, None)
    assert step["reaching_bound"] > step["reaching_time"] > 0.0
    assert step["reaching_from"] == pytest.approx(0.1)


def test_a_bound_longer_than_the_run_is_not_given() -> None:
    """S falls evenly and would be zero after 0.2 s; of a run of 0.19 s the bound says nothing, of 0.21 s it does."""
    t = PERIOD * np.arange(400)
    qd = -np.maximum(1.6 - 8.0 * t, 0.0)[:, None]
    for samples, bound, why in ((190, None, "vacuous: longer than the run"), (210, pytest.approx(0.2), None)):
        found = certify(along(qd[:samples]), Block((0.5,)), sliding(0.0, 4.0), PERIOD)
        assert found.reaching_bound == pytest.approx(0.2)
        assert (found.to_json()["reaching_bound"], found.no_bound) == (bound, why)
    rising = certify(along(-qd[::-1]), Block((0.5,)), sliding(0.0, 4.0), PERIOD)
    assert rising.to_json()["no_bound"] == "none: V grew on the way"


def test_the_papers_own_function_has_kinetic_and_position_energy() -> None:
    """(142) of one joint at a set point is M (s^2 + qd^2) / 2 + Kp e^2 / 2; its rate is its difference."""
    qd = np.random.default_rng(1).normal(size=(50, 1))
    run = along(qd, q_ref=0.7)
    found = certify(run, Block((0.5,)), sliding(3.0, 1.0, Kp=6.0), PERIOD).set_point
    e = 0.7 - run.q
    s = -qd + 3.0 * e
    V = (0.25 * (s * s + qd * qd) + 3.0 * e * e)[:, 0]
    assert found is not None
    assert found.V == pytest.approx(V[:-1], rel=1e-12)
    assert found.V_rate == pytest.approx(np.diff(V) / PERIOD, rel=1e-9)
    assert found.zeta == pytest.approx(-np.diff(V) / PERIOD / np.abs(s[:-1, 0]), rel=1e-9)
    # it counts from the instant on from which the desired position stands still
    moved = along(qd, q_ref=np.where(np.arange(50) < 20, 0.2, 0.7)[:, None])
    late = certify(moved, Block((0.5,)), sliding(3.0, 1.0, Kp=6.0), PERIOD).set_point
    assert late is not None
    assert late.V.tobytes() == found.V[20:].tobytes()
    assert certify(run, Block((0.5,)), sliding(3.0, 1.0), PERIOD).set_point is None


@pytest.mark.parametrize(
    ("speeds", "asked", "says"),
    [
        ([1.0, 1.5, 2.0, 2.5], [], "falls"),
        ([1.0, 0.5, 4.0, 4.5], [], "rises"),
        ([1.0, 0.5, 4.0, 4.5], [0], "lost to saturation"),
        ([1.0, 0.5, 4.0, 4.5], [1], "rises"),
        ([1.0, 1.0, 1.0, 1.0], [], "falls"),
    ],
)
def test_what_the_papers_own_function_says(speeds: list[float], asked: list[int], says: str) -> None:
    """Lost to saturation only where at every instant at which V rises the law asks for more than the limit."""
    qd = np.array(speeds)[:, None]
    tau = np.zeros_like(qd)
    law = tau.copy()
    law[asked] = 9.0
    found = certify(along(qd, tau, law, q_ref=1.0, period=0.01), Block((0.5,)), sliding(10.0, 1.0, Kp=60.0), 0.01)
    assert found.set_point is not None
    assert found.set_point.says == says
    assert found.set_point.to_json()["says"] == says


def test_there_is_no_function_for_tracking() -> None:
    """(142) is judged while the desired position stands still: not on a sine, on a quintic from where it ends."""
    limit = np.asarray(AnalyticPlant(load_model("two-link")).tau_max)
    law = replace(law_of(phi=PHI), Kp=3.0 * limit)
    moving = certify(run_of(Sine([1.0, -1.0], [0.5, 0.7])), load_model("two-link"), law, PERIOD).set_point
    assert moving is not None
    assert len(moving.V) == 0
    assert moving.to_json() == dict.fromkeys(moving.to_json()) | {"says": "no function for tracking"}
    run = run_of(Quintic([1.0, -1.0], 0.5))
    still = certify(run, load_model("two-link"), law, PERIOD).set_point
    assert still is not None
    assert len(still.V) == 499
    assert still.says == "vacuous"
    assert still.to_json()["share_rising_outside"] is None


def test_the_papers_function_for_the_papers_law_on_the_papers_step() -> None:
    """An independent program's figures: set L falls by zeta 0.97 N m, M rises in 32 %, always with a joint at a limit.

    Conventional control has no linear term, and so no such function.
    """
    found = run_experiment(load_experiment(Path("configs/paper/fig10-step.yaml"))).certified
    gentle, strong = found["proposed-l"]["set_point"], found["proposed-m"]["set_point"]
    assert gentle["says"] == "falls"
    assert gentle["least_zeta"] == pytest.approx(0.97, abs=0.005)
    assert strong["says"] == "lost to saturation"
    assert strong["share_rising_outside"] == pytest.approx(0.32, abs=0.005)
    assert strong["share_of_rising_saturated"] == 1.0
    assert found["conventional"]["set_point"] is None


def one_joint_run(plant: AnalyticPlant, arm: Any, options: dict[str, Any], gains: dict[str, float]) -> Trajectory:
    """Return 2 s of one joint that is to reach 0.3 rad, under `linear-band-smc`."""
    law = find_law("linear-band-smc")
    controller = Controller("c", law, law.pack_gains(1, gains, options))
    return simulate_sampled(plant, controller, arm, Quintic([0.3], 0.8), duration=2.0)


def test_the_layer_that_can_be_held_is_that_of_the_sampled_loop() -> None:
    """T (K/phi + Kd) / M = 1.95 comes to rest, 2.05 does not, and only the second is named; with the k for 1."""
    arm = pendulum(gravity=0.0)
    plant = AnalyticPlant(arm)
    kv = 300.0  # Mbar is 0.5: Kd = 150 N m s, T Kd / M = 0.25
    for loop, rests in ((1.95, True), (2.05, False)):
        phi = 12.0 * PERIOD / PENDULUM_INERTIA / (loop - 0.25)
        gains = {"lam": 10.0, "k": 0.3, "phi": phi, "kv": kv}
        run = one_joint_run(plant, arm, {}, gains)
        assert (np.max(np.abs(run.s[-200:])) < 1e-9) == rests
        law = SlidingLaw(np.array([10.0]), np.array([12.0]), np.array([phi]), None, None, np.array([150.0]))
        held = held_to(arm, law, np.zeros((1, 1)), np.array([0.3]), PERIOD)
        assert held.coarse.tolist() == [not rests]
        assert held.step == pytest.approx([12.0 * PERIOD / PENDULUM_INERTIA])
        assert (held.K / phi + 150.0) * PERIOD / PENDULUM_INERTIA == pytest.approx([1.0])


def test_the_gain_that_can_be_held_in_a_layer() -> None:
    """T (K/phi + Kd) / M is below 2 up to what is named, 1 at the K that would do; none does where Kd alone has 2."""
    arm, phi, law = Block((0.5,)), 0.02, sliding(10.0, 17.9, phi=0.02)
    law = replace(law, Kd=np.array([100.0]))  # T Kd / M = 0.2, T / (phi M) = 0.1
    for K, coarse in ((17.9, False), (18.1, True)):
        held = held_to(arm, replace(law, K=np.array([K])), np.zeros((1, 1)), np.ones(1), PERIOD)
        assert held.coarse.tolist() == [coarse]
        assert held.step == pytest.approx([0.1 * phi * K])
        assert held.most == pytest.approx([1.8 * phi])
        assert held.K == pytest.approx([8.0])
    held = held_to(arm, replace(law, Kd=np.array([1100.0])), np.zeros((1, 1)), np.ones(1), PERIOD)
    assert (held.coarse.tolist(), held.most.tolist(), held.K.tolist()) == ([True], [0.0], [0.0])


def test_a_layer_too_wide_is_named() -> None:
    """Where T K / M is over ten times phi; of a law that switches, over lambda times the joint's motion.

    A joint that is to stand still has the motion of the one that moves most; where none moves none is named.
    """
    arm, still = Block((2.0, 0.0), (0.0, 1.0)), along(np.zeros((3, 2)))
    (one,) = certify(still, arm, sliding(3.0, 30.0, 4.0, phi=0.001), PERIOD).too_wide
    assert one == (1, pytest.approx(0.015), 0.001, pytest.approx(0.005))
    assert certify(still, arm, sliding(3.0, 30.0, 14.0), PERIOD).too_wide == ()
    far = replace(still, q=still.q + 1.0)
    for motion, named in ((0.004, [1, 2]), (0.0048, [1]), (0.0052, [])):
        run = replace(far, q_ref=far.q + [motion, 0.0])
        found = certify(run, arm, sliding(3.0, 30.0, 14.0), PERIOD)
        assert [one.joint for one in found.too_wide] == named


def test_a_law_that_switches_is_held_to_a_tenth_of_its_motion() -> None:
    """K moves s by T K / M, which over lambda is an error: joint by joint, at the pose where the joint is lightest."""
    arm = Block((2.0, 0.5), (0.5, 1.0))
    light = np.diag(np.linalg.inv(arm.M)) * PERIOD
    law = sliding(10.0, 30.0, 4.0)
    held = held_to(arm, law, np.zeros((1, 2)), np.array([0.3, 0.001]), PERIOD)
    assert held.step == pytest.approx(light * [30.0, 4.0], rel=1e-12)
    assert held.most == pytest.approx([0.3, 0.001], rel=1e-12)
    assert held.coarse.tolist() == [False, True]
    assert held.K == pytest.approx(np.array([0.3, 0.001]) / light, rel=1e-12)
    assert not held_to(arm, replace(law, K=held.K), np.zeros((1, 2)), np.array([0.3, 0.001]), PERIOD).coarse.any()
    two = load_model("two-link")
    poses = np.array([[0.0, 0.0], [0.0, 1.6], [0.0, 3.1]])
    least = np.max(np.diagonal(np.linalg.inv(two.mass_matrix(poses)), axis1=1, axis2=2), axis=0)
    assert held_to(two, law, poses, np.ones(2), PERIOD).step == pytest.approx(PERIOD * least * [30.0, 4.0])


WRIST = """<mujoco model="wrist"><compiler angle="radian"/><worldbody><body>
  <inertial mass="0.2" pos="0 0 0.03" diaginertia="1e-4 1e-4 1e-4"/><joint name="roll" axis="0 0 1"/>
</body></worldbody><actuator><motor joint="roll" ctrlrange="-28 28"/></actuator></mujoco>"""
LIGHT = """
name: wrist
plant: {engine: analytic, model: wrist}
controllers:
  - {name: sign, law: smc, gains: {lam: 10, k: 0.3}}
  - {name: layer, law: smc, switching: saturation, gains: {lam: 10, k: 0.3, phi: 0.3}}
  - {name: gentle, law: smc, switching: saturation, gains: {lam: 10, k: 0.001, phi: 0.5}}
  - {name: fast, law: linear-band-smc, gains: {lam: 10, k: 0.001, phi: 0.5, kv: 2500}}
reference: {kind: quintic, target: -0.3, rise_time: 0.8}
run: {duration: 2.0, metrics_from: 0.0}
"""


def test_a_joint_too_light_for_its_gain_is_named_before_the_run(tmp_path: Path, monkeypatch: Any) -> None:
    """K moves s by 84 rad/s in a period: both that miss by 4 rad are named, with a k that does, and no others are.

    The words are in the manifest as well. With the k that would do, the joint follows, and nothing is said.
    """
    (tmp_path / "models" / "wrist").mkdir(parents=True)
    (tmp_path / "models" / "wrist" / "wrist.xml").write_text(WRIST)
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    experiment = parse_experiment(LIGHT)
    found = flags(experiment, build(experiment))
    assert [(one.controller, one.joint) for one in found] == [("sign", "roll"), ("layer", "roll"), ("fast", "roll")]
    assert all(isinstance(one, Coarse) for one in found)
    assert [one.step for one in found] == pytest.approx([84.0, 84.0, 0.28])
    assert [one.most for one in found] == pytest.approx([0.3, 0.6, 0.0])
    assert str(found[0]) == (
        "controller 'sign' cannot hold s at its control period: in 1 ms K = 8.4 N m moves s of roll by 84 rad/s, and "
        "it errs by less than a tenth of its motion only up to 0.3; k <= 0.00107 would do for all joints, or a period "
        "of 3.6e-06 s"
    )
    assert "comes to rest in its layer only up to 0.6" in str(found[1])
    assert str(found[2]).endswith("no k would do: the rate gain kv alone is too large")
    result = run_experiment(experiment)
    for name in ("sign", "layer"):
        assert result.metrics[name].max_error.value > 4.0
    assert result.metrics["gentle"].max_error.value < 1e-5
    said = manifest_of(result)["flags"]
    assert [line for line in said if not line.startswith("no armature")] == [*map(str, found), *result.explained]
    assert [line.split("'")[1] for line in result.explained] == ["sign", "layer", "fast"]  # and not the gentle one
    assert all(one.cause in line for one, line in zip(found, result.explained, strict=True))
    for name in ("sign", "layer"):  # s stays within a layer that is an error of 8.4 rad: nothing is shown
        facts, phi = result.certified[name], 0.3 if name == "layer" else None
        one = {"joint": 1, "layer": pytest.approx(84.0), "phi": phi, "error": pytest.approx(8.4)}
        assert facts["too_wide"] == [one]
        assert (facts["vacuous"], facts["reaching_time"], facts["reaching_bound"]) == (True, None, None)
        assert facts["no_bound"] == "vacuous: the layer is too wide"
    assert result.certified["gentle"]["too_wide"] == []
    assert [line.split("'")[1] for line in uncovered(result)] == ["sign", "layer"]
    assert "roll: K moves s by 84 rad/s, 280 phi, before the loop" in uncovered(result)[1]
    assert [row[3] for row in certificate_table(result)[1]][:2] == ["vacuous", "vacuous"]
    told = {name: [text for _, text in cells[1:]] for name, cells in certificate_words(result)}
    assert told["sign"] == told["layer"] == ["so wide that it covers nothing", "nothing shown"]
    assert told["gentle"] == ["never outside", "nothing to certify"]
    calm = experiment.with_({f"controllers.{one.controller}.gains.k": one.k_most for one in found[:2]})
    cured = run_experiment(calm.with_({"controllers.fast.gains.kv": 500}))
    assert [line for line in cured.flags if not line.startswith(("no armature", "no controller uses"))] == []
    assert uncovered(cured) == []
    assert cured.metrics["sign"].max_error.value < 0.03
    assert cured.metrics["layer"].max_error.value < 1e-3


def test_a_rate_gain_too_large_for_its_period_is_named_before_the_run(tmp_path: Path, monkeypatch: Any) -> None:
    """T Kd / M = 2.1 grows from period to period, and is named; 1.9 dies out, and is not; nor is what auto chooses."""
    (tmp_path / "models" / "wrist").mkdir(parents=True)
    (tmp_path / "models" / "wrist" / "wrist.xml").write_text(WRIST)
    monkeypatch.setenv("TORQUEBENCH_DATA", str(tmp_path))
    laws = "".join(f"  - {{name: kv-{kv}, law: pd, gains: {{lam: 10, kv: {kv}}}}}\n" for kv in (1900, 2100))
    text = LIGHT.partition("controllers:")[0] + f"controllers:\n{laws}  - {{law: pd, gains: auto}}\n"
    experiment = parse_experiment(text + "reference:" + LIGHT.partition("reference:")[2])
    (found,) = flags(experiment, build(experiment))
    assert isinstance(found, Overdriven)
    assert (found.controller, found.joint, found.times) == ("kv-2100", "roll", pytest.approx(2.1))
    assert "Kd = 0.21 N m s/rad of roll, moves s by 2.1 s" in str(found)
    errors = {name: values.max_error.value for name, values in run_experiment(experiment).metrics.items()}
    assert errors["kv-2100"] > 100.0 * errors["kv-1900"]


def test_no_shipped_config_has_a_joint_too_light_for_its_gain() -> None:
    """Rotors are heavy enough at every control period that a config has, those whose complaint it is left out."""
    for path in sorted(Path("configs").rglob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        if path.parent.name != "shaking" and not re.search(r"^(sweep|audit|falsify|tune|arena):", text, re.MULTILINE):
            experiment = load_experiment(path)
            assert not [one for one in flags(experiment, build(experiment)) if isinstance(one, Coarse | Overdriven)], (
                path
            )


def test_a_slow_loop_widens_the_layer():
    """The layer is what K moves s until the torque answers: with ten times the reaction it is ten times as wide."""
    run, arm = run_of(Step([0.6, -0.4], 0.1), duration=1.0), load_model("two-link")
    narrow, wide = (certify(run, arm, law_of(), PERIOD, reaction).layer for reaction in (PERIOD, 10.0 * PERIOD))
    assert wide == pytest.approx(10.0 * narrow, rel=1e-12)
    assert certify(run, arm, law_of(), PERIOD).layer == pytest.approx(narrow, rel=1e-12)


def test_reaction_of_a_chain():
    """Control period, delay, filter and lag add up: 1 + 2 + 5 + 8 ms; of an ideal chain it is the period."""
    slow = Chain(velocity="differentiated", velocity_filter=200.0, actuator_lag=0.008, measurement_delay=0.002)
    assert slow.reaction(0.001) == pytest.approx(0.016)
    assert CHAINS["ideal"].reaction(0.001) == 0.001
