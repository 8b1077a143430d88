"""The loop: what happens at each control instant, in which order, and what is recorded of it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.arms import slider, still
from tests.sim.loops import PLANTS, TARGET, SpyPlant, arm, go, idle, law_of, plant_of, spring
from torquebench import references
from torquebench.kernel import Array
from torquebench.references import Reference
from torquebench.robot import load_model
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.trajectory import Outcome


class Counting(NamedTuple):
    """Memory with a sliding variable and another channel."""

    s: Array
    count: Array


def pushing(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
    """Push both joints with a torque that depends on time alone."""
    tau[0] = 30.0 * math.sin(20.0 * t)
    tau[1] = 9.0 * math.cos(33.0 * t)


@pytest.mark.parametrize(
    ("T", "timestep", "n_steps"), [(0.001, 0.001, 4000), (0.003, 0.001, 700), (0.0007, 0.0001, 900)]
)
def test_time_is_k_times_the_period(T: float, timestep: float, n_steps: int) -> None:
    """The law, the reference and the record all see exactly k T: multiplied, never added up."""
    seen: list[float] = []
    asked: list[Array] = []

    def noting(gains: Any, model: Any, t: float, *rest: Any) -> None:
        rest[-1][:] = 0.0
        seen.append(t)
        assert model.control_period == T

    def reference(t: Array) -> Reference:
        asked.append(t.copy())
        return TARGET(t)

    run = go(SpyPlant(timestep, stride=0.0), noting, n_steps * T, control_period=T, reference=reference)
    exact = [k * T for k in range(n_steps)]
    assert len(asked) == 1
    assert seen == exact
    assert asked[0].tolist() == exact
    assert run.t.tolist() == exact


def test_order_of_one_instant() -> None:
    """Reset once; then measure, law, clip, disturb, step: the torque of the state at k acts from k to k + 1."""
    disturbance = np.arange(20.0).reshape(10, 2)

    def law(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0], tau[1] = q[0] - 300.0, qd[1]

    plant = SpyPlant(timestep=0.0005)
    run = go(plant, law, 0.02, control_period=0.002, disturbance=disturbance, initial_q=np.array([0.1, 0.2]))
    assert plant.calls[0] == ("reset", [0.1, 0.2], [0.0, 0.0])
    assert [call[2] for call in plant.calls[1:]] == [4] * 10
    for k in range(10):
        q = [100.0 * k, 100.0 * k + 1.0]
        asked = [q[0] - 300.0, -q[1]]
        clipped = [min(max(asked[0], -80.0), 80.0), min(max(asked[1], -25.0), 25.0)]
        acting = [clipped[0] + 2.0 * k, clipped[1] + 2.0 * k + 1.0]
        assert plant.calls[1 + k][1] == acting
        for name, value in (("q", q), ("tau_law", asked), ("tau", clipped), ("tau_applied", acting)):
            assert getattr(run, name)[k].tolist() == value, name
        assert run.qd[k].tolist() == [-x for x in q]


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("substeps", [1, 2, 5])
def test_torque_is_held_between_instants(name: str, substeps: int) -> None:
    """The record is what the plant gives when stepped by hand, one time step at a time, under the held torque."""
    timestep = 0.0005
    T = substeps * timestep
    run = go(plant_of(name, timestep), pushing, 40 * T, control_period=T, initial_q=np.array([0.2, -0.4]))
    plant = plant_of(name, timestep)
    plant.reset(np.array([0.2, -0.4]), np.zeros(2))
    for k in range(40):
        q, qd = plant.state()
        assert q.tobytes() == run.q[k].tobytes()
        assert qd.tobytes() == run.qd[k].tobytes()
        assert run.tau[k].tolist() == [30.0 * math.sin(20.0 * (k * T)), 9.0 * math.cos(33.0 * (k * T))]
        for _ in range(substeps):
            plant.step(run.tau_applied[k], 1)


def test_disturbance_acts_beyond_the_torque_limit() -> None:
    """On a 2 kg slide limited to 1000 N: x_k = sum of (clip(ask) + d) T^2/m (k - i - 1/2), whatever the limit."""
    plant, T = AnalyticPlant(slider(2.0)), 0.001

    def greedy(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0] = 5e4

    d = np.array([[500.0], [0.0], [-3000.0], [0.0]])
    run = go(plant, greedy, 4 * T, disturbance=d, model=slider(), reference=still(np.zeros(1)))
    assert run.tau_law[:, 0].tolist() == [5e4] * 4
    assert run.tau[:, 0].tolist() == [1000.0] * 4
    assert run.tau_applied[:, 0].tolist() == [1500.0, 1000.0, -2000.0, 1000.0]
    assert run.qd[:, 0] == pytest.approx([0.0, 0.75, 1.25, 0.25], rel=1e-12)
    assert run.q[:, 0] == pytest.approx([0.0, 0.000375, 0.001375, 0.002125], rel=1e-12)


@pytest.mark.parametrize("name", PLANTS)
def test_the_disturbance_of_both_plants_is_a_torque(name: str) -> None:
    """On a plant whose law asks for nothing, a disturbance moves the arm exactly as the same torque asked would."""
    d = np.tile([7.0, -3.0], (50, 1))

    def asking(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[:] = [7.0, -3.0]

    disturbed, asked = go(plant_of(name), idle, disturbance=d), go(plant_of(name), asking)
    assert disturbed.q.tobytes() == asked.q.tobytes()
    assert np.any(disturbed.q != go(plant_of(name), idle).q)


@pytest.mark.parametrize("name", PLANTS)
def test_ideal_measurement_is_the_truth(name: str) -> None:
    """The law is given the plant's own state and the reference's own sample; measured and true are recorded alike."""
    seen: list[bytes] = []

    def noting(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        seen.append(q.tobytes() + qd.tobytes() + ref.q.tobytes() + ref.qd.tobytes() + ref.qdd.tobytes())
        spring(gains, model, t, q, qd, ref, memory, tau)

    run = go(plant_of(name), noting)
    columns = zip(run.q, run.qd, run.q_ref, run.qd_ref, run.qdd_ref, strict=True)
    assert seen == [b"".join(x.tobytes() for x in row) for row in columns]
    assert run.q_meas.tobytes() == run.q.tobytes()
    assert run.qd_meas.tobytes() == run.qd.tobytes()
    for wanted, got in zip(TARGET(run.t), (run.q_ref, run.qd_ref, run.qdd_ref), strict=True):
        assert np.array_equal(wanted, got)


@pytest.mark.parametrize("kind", ["array", "list", "tau itself"])
def test_a_law_may_return_its_torque(kind: str) -> None:
    """A law that returns the torque gives the same run as one that fills it in."""

    def returning(
        gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array
    ) -> Any:
        spring(gains, model, t, q, qd, ref, memory, tau)
        if kind == "tau itself":
            return tau
        answer = tau.copy()
        tau[:] = 12345.0
        return answer if kind == "array" else answer.tolist()

    assert go(plant_of("analytic"), returning).digest() == go(plant_of("analytic"), spring).digest()


def test_a_joint_the_law_forgets_is_noticed() -> None:
    """A joint without a torque is a fault at that instant, whatever it was given the instant before."""

    def once(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        tau[0] = 5.0
        if t == 0.0:
            tau[1] = 3.0

    run = go(plant_of("analytic"), once, 0.003)
    assert (run.outcome, run.failed_at) == (Outcome.BAD_TORQUE, 1)
    assert "joint 2" in run.detail
    assert "not written" in run.detail


def test_a_law_that_only_rebinds_tau_is_noticed() -> None:
    """`tau = ...` instead of `tau[:] = ...` commands nothing, and does not pass for a run with zero torque."""

    def rebinding(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Any) -> None:
        tau = 10.0 * (ref.q - q)  # noqa: F841  the mistake under test

    assert go(plant_of("analytic"), rebinding).outcome is Outcome.BAD_TORQUE


def test_plain_numbers_make_a_reference_for_every_joint() -> None:
    """A reference made from scalars or lists is the one made from arrays."""
    runs = []
    for amplitude, frequency in ((0.5, 2.0), ([0.5, 0.5], [2.0, 2.0]), (np.full(2, 0.5), np.full(2, 2.0))):
        runs.append(go(plant_of("analytic"), spring, reference=references.sine(amplitude, frequency)).digest())
    assert len(set(runs)) == 1


@pytest.mark.parametrize("name", PLANTS)
def test_a_law_cannot_change_what_it_is_shown(name: str) -> None:
    """Overwriting q, qd, ref or an old torque changes neither the record nor the plant."""
    kept: list[Array] = []

    def vandal(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
        spring(gains, model, t, q, qd, ref, memory, tau)
        answer = tau.copy()
        for array in (q, qd, ref.q, ref.qd, ref.qdd, *kept):
            array[:] = 777.0
        tau[:] = answer
        kept[:] = [q, qd, ref.q]

    # a user's own samples, which the source hands out without copying them
    samples = TARGET(np.arange(50) * 0.001)
    before = [array.copy() for array in samples]
    assert go(plant_of(name), vandal, reference=lambda t: samples).digest() == go(plant_of(name), spring).digest()
    assert all(np.array_equal(a, b) for a, b in zip(samples, before, strict=True))


@pytest.mark.parametrize("name", PLANTS)
def test_the_same_run_twice(name: str) -> None:
    """A plant that has run before gives the same bytes as a new one, and as itself."""
    d = np.random.default_rng(3).normal(size=(50, 2))
    used = plant_of(name)
    go(used, pushing, 0.03)
    digests = {go(plant, spring, disturbance=d).digest() for plant in (used, used, plant_of(name))}
    assert len(digests) == 1


def test_memory_starts_at_zero_in_every_run_and_is_recorded() -> None:
    """Memory counts from zero in each run; `s` goes to its own signal, other channels to `extra`, under their names."""

    def counting(
        gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array
    ) -> None:
        tau[:] = 0.0
        memory.s[:] = q
        memory.count[:] += 1.0

    plant, controller = plant_of("analytic"), law_of(counting, Counting)
    for _ in range(2):
        run = go(plant, controller, 0.01)
        assert run.extra["count"].tolist() == [[k, k] for k in range(1, 11)]
        assert run.s.tobytes() == run.q.tobytes()
        assert list(run.extra) == ["count"]
    assert np.all(np.isnan(go(plant, idle, 0.01).s))


def test_progress_is_told_every_instant() -> None:
    """The callback gets 0 .. N-1, in order; it does not alter the run."""
    told: list[int] = []
    run = go(plant_of("analytic"), spring, 0.02, progress=told.append)
    assert told == list(range(20))
    assert run.digest() == go(plant_of("analytic"), spring, 0.02).digest()
    assert run.outcome is Outcome.COMPLETED
    assert run.failed_at is None


def flat_reference(t: Array) -> Reference:
    """A reference of the wrong width."""
    return Reference(*np.zeros((3, len(t), 3)))


def broken_reference(t: Array) -> Reference:
    """A reference with one NaN."""
    good = TARGET(t)
    good.qd[3, 1] = math.nan
    return good


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": -1.0}, r"duration is -1\.0, wanted a finite positive"),
        ({"duration": 0.0}, "duration is 0.0, wanted a finite positive"),
        ({"duration": math.nan}, "duration is nan"),
        ({"duration": math.inf}, "duration is inf"),
        (
            {"duration": 0.0505},
            r"duration 0\.0505 s is not a whole multiple of control_period 0\.001 s \(nearest: 0\.05",
        ),
        ({"control_period": -0.001}, r"control_period is -0\.001, wanted"),
        (
            {"control_period": 0.0015},
            r"control_period 0\.0015 s is not a whole multiple of timestep 0\.001 s \(nearest: ",
        ),
        ({"control_period": 0.0004}, r"control_period 0\.0004 s is not .* \(nearest: 0\.001 s\)"),
        ({"control_period": math.nan}, "control_period is nan"),
        ({"reference": flat_reference}, r"reference q has shape \(50, 3\), wanted \(50, 2\)"),
        ({"reference": lambda t: TARGET(t[1:])}, r"reference q has shape \(49, 2\), wanted \(50, 2\)"),
        ({"reference": broken_reference}, "reference qd has values that are not finite"),
        ({"initial_q": np.zeros(3)}, r"initial_q is \[0\. 0\. 0\.\], wanted 2 finite"),
        ({"initial_q": np.array([0.0, math.nan])}, r"initial_q is \[ 0\. nan\], wanted 2 finite"),
        ({"disturbance": np.zeros((49, 2))}, r"disturbance has shape \(49, 2\), wanted \(50, 2\)"),
        ({"disturbance": np.zeros((50, 1))}, r"disturbance has shape \(50, 1\), wanted \(50, 2\)"),
        ({"disturbance": np.full((50, 2), math.inf)}, "disturbance has .* all finite"),
        ({"model": load_model("puma560")}, "the model has 6 joints, the plant 2"),
    ],
)
def test_bad_arguments_are_refused_before_anything_moves(options: dict[str, Any], message: str) -> None:
    """Each is a ValueError with the numbers; the plant is not touched and the law not called."""
    plant, called = SpyPlant(), []
    with pytest.raises(ValueError, match=message):
        go(plant, lambda *a: called.append(a), **options)
    assert plant.calls == []
    assert called == []


@pytest.mark.parametrize("make", [lambda h, i: AnalyticPlant(arm(), h, i), lambda h, i: MujocoPlant("two-link", h, i)])
def test_plants_refuse_what_they_cannot_integrate(make: Any) -> None:
    """A bad time step or integrator is refused by name, with the value."""
    for h in (0.0, -0.001, math.nan, math.inf):
        with pytest.raises(ValueError, match=f"^timestep is {h}, wanted a finite positive"):
            make(h, "rk4")
    with pytest.raises(ValueError, match="integrator is 'rk5', wanted one of rk4, euler"):
        make(0.001, "rk5")


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"path": "pyhton"}, ValueError, "did you mean 'python'"),
        ({"path": "compiled"}, ValueError, "path is 'compiled'"),
        ({"chain": "fast"}, TypeError, r"wanted a Chain, such as CHAINS\['fast'\]"),
    ],
)
def test_a_path_or_chain_that_is_none_is_refused(options: dict[str, Any], error: type[Exception], text: str) -> None:
    """A misspelt path would otherwise run compiled without a word."""
    with pytest.raises(error, match=text):
        go(plant_of("analytic"), idle, **options)
