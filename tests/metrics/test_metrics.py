"""Metrics of whole runs against closed forms: sinusoids, linear step responses, windows, undefined cases."""

import itertools
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.source_tree import SOURCE
from torquebench.errors import ResultError
from torquebench.kernel import Array
from torquebench.metrics import (
    METRICS,
    JointRecord,
    Metrics,
    applicable,
    from_joints,
    headlines,
    headlines_of,
    measured,
    per_joint,
    record_of,
)
from torquebench.metrics.chattering import chattering_index
from torquebench.metrics.torque import measure_torques
from torquebench.sim.trajectory import Outcome, Trajectory

T = 0.001
TAU_MAX = np.array([50.0, 20.0])


def times(duration: float = 4.0, period: float = T) -> Array:
    """Control instants k T, (N,) [s]."""
    return period * np.arange(round(duration / period))


def columns(*signals: Array) -> Array:
    """Put one signal per joint into an (N, n) array."""
    return np.stack(signals, axis=1)


def make(
    t: Array, q: Array, q_ref: Array | None = None, tau: Array | None = None, s: Array | None = None
) -> Trajectory:
    """A completed run with the given signals (N, n); what is left out is zero, `s` NaN."""
    zero = np.zeros_like(q)
    return Trajectory(
        t=t,
        q=q,
        qd=zero,
        q_meas=zero,
        qd_meas=zero,
        q_ref=zero if q_ref is None else q_ref,
        qd_ref=zero,
        qdd_ref=zero,
        s=np.full_like(q, np.nan) if s is None else s,
        tau_law=10.0 * q + 1.0,  # must not be what the torque metrics read
        tau=zero if tau is None else tau,
        tau_applied=zero + 7.0,
    )


def metrics_of(run: Trajectory, **changes: object) -> Metrics:
    """Compute metrics with this file's defaults for what `changes` leaves out."""
    arguments = {
        "tau_max": TAU_MAX,
        "metrics_from": 1.0,
        "control_period": T,
        "step_like": False,
    } | changes
    return from_joints(per_joint(run, **arguments))  # type: ignore[arg-type]


def respond(shape: Callable[[Array], Array], amplitudes: tuple[float, ...], at: float = 0.2) -> Trajectory:
    """A run in which joint i answers a step of `amplitudes[i]` at `at` with the unit response `shape`."""
    t = times()
    unit = np.where(t >= at, shape(np.maximum(t - at, 0.0)), 0.0)
    steps = np.array(amplitudes)
    return make(t, unit[:, None] * steps, np.where(t[:, None] >= at - 1e-9, steps, 0.0))


def test_error_metrics_of_a_sinusoid() -> None:
    """Error A sin: RMSE A/sqrt 2, maximum A, mean |e| 2A/pi; IAE and ITAE are its integrals over the run."""
    t = times()
    amplitude = (0.3, 0.1)
    e = columns(*(a * np.sin(2 * math.pi * 2.0 * t) for a in amplitude))
    got = metrics_of(make(t, -e))
    # Whole periods and evenly spaced samples: the mean of squares is exact but for round-off.
    assert got.rmse.per_joint == pytest.approx([a / math.sqrt(2) for a in amplitude], rel=1e-12)
    assert got.rmse.value == pytest.approx(math.sqrt((0.3**2 + 0.1**2) / 4), rel=1e-12)
    assert got.max_error.value == pytest.approx(0.3, rel=1e-12)  # sample 125 of 500 lies on the crest
    # The trapezium rule on |sin| errs by (w T)^2 / 12 = 1.3e-5; the run ends one control period short: 2e-6.
    assert got.steady_state_error.value == pytest.approx(2 * 0.3 / math.pi, rel=2e-5)
    assert got.iae.per_joint == pytest.approx([4.0 * 2 * a / math.pi for a in amplitude], rel=2e-5)
    assert got.iae.value == pytest.approx(4.0 * 2 * 0.2 / math.pi, rel=2e-5)
    # Integral of t |sin| over whole half periods, each symmetric about its middle: mean |e| times 4^2 / 2.
    assert got.itae.value == pytest.approx(8.0 * 2 * 0.2 / math.pi, rel=2e-5)


def test_integrals_of_the_error_are_those_of_the_trapezium_rule() -> None:
    """Of |e| = a + b t IAE is a D + b D^2 / 2 to round-off, D the time from first to last sample.

    Rectangles are off by T b D / 2. In ITAE's t (a + b t), of second derivative 2 b, the rule itself errs by
    T^2 b D / 6.
    """
    t = times()
    a, b, D = 0.2, -0.04, t[-1]
    got = metrics_of(make(t, columns(a + b * t, -(a + b * t))))
    assert got.iae.per_joint == pytest.approx([a * D + b * D * D / 2] * 2, rel=1e-12)
    exact = a * D * D / 2 + b * D**3 / 3 + T * T * b * D / 6
    assert got.itae.per_joint == pytest.approx([exact] * 2, rel=1e-12)


def test_errors_are_reference_minus_true_position() -> None:
    """A constant lag of 0.2 rad behind the reference is an error of 0.2; measurements do not enter."""
    t = times()
    q_ref = columns(t, 2.0 * t)
    got = metrics_of(make(t, q_ref - 0.2, q_ref))
    for metric in (got.rmse, got.max_error, got.steady_state_error):
        assert metric.value == pytest.approx(0.2, rel=1e-12)
    assert got.iae.value == pytest.approx(0.2 * t[-1], rel=1e-12)


def test_torque_metrics_read_the_clipped_torque_inside_the_window() -> None:
    """Each torque metric of the run is its formula applied to `tau` for t >= 1 s, averaged over joints."""
    t = times()
    tau = np.random.default_rng(1).normal(size=(4000, 2)) * 15.0
    tau[:1000] *= 50.0
    tau[1500:] = np.clip(tau[1500:], -TAU_MAX, TAU_MAX)
    got, inside = metrics_of(make(t, 0.0 * tau, tau=tau)), tau[1000:]
    for metric, formula in (
        (got.hf, chattering_index(inside, T, TAU_MAX)),
        (got.total_variation, measure_torques(inside, T, TAU_MAX).total_variation),
        (got.reversals, measure_torques(inside, T, TAU_MAX).reversals),
        (got.effort, measure_torques(inside, T, TAU_MAX).effort),
        (got.saturation_fraction, measure_torques(inside, T, TAU_MAX).saturation_fraction),
    ):
        assert metric.per_joint == pytest.approx(tuple(formula), rel=1e-15)
        assert metric.value == pytest.approx(np.mean(formula), rel=1e-15)
        assert metric.value > 0.0


def test_time_in_band() -> None:
    """|A sin| <= A/2 for a third of the time; a joint without s leaves the headline undefined."""
    t = times()
    s = columns(2.0 * np.sin(2 * math.pi * t + 0.1), 0.2 * np.sin(2 * math.pi * t))
    run = make(t, 0.0 * s, s=s)
    got = metrics_of(run, phi=np.array([1.0, 0.5]))
    assert got.time_in_band.per_joint == pytest.approx((1 / 3, 1.0), abs=12 / 3000)  # 12 edges
    assert got.time_in_band.value == pytest.approx(2 / 3, abs=12 / 3000)
    assert metrics_of(run).time_in_band.value is None
    half = replace(run, s=columns(s[:, 0], np.full(len(t), np.nan)))
    assert metrics_of(half, phi=1.0).time_in_band.value is None
    assert metrics_of(half, phi=1.0).time_in_band.per_joint[1] is None


def test_first_order_step_response() -> None:
    """1 - exp(-t/c): rise c ln 9, settling c ln 50 = 3.912 c from the step, no overshoot, for either sign."""
    c = 0.15
    got = metrics_of(respond(lambda t: 1.0 - np.exp(-t / c), (0.8, -0.5)), step_like=True)
    # Linear interpolation between samples errs by (T/c)^2 / 8 = 6e-6 of the exponential there.
    assert got.rise_time.per_joint == pytest.approx((math.log(9) * c,) * 2, rel=1e-5)
    assert got.settling_time.value == pytest.approx(math.log(50) * c, rel=1e-5)
    assert got.overshoot.value == 0.0


def test_second_order_step_response() -> None:
    """Overshoot exp(-pi z / sqrt(1 - z^2)); rise and settling from the roots of the closed form."""
    z, w = 0.5, 10.0
    wd = w * math.sqrt(1 - z * z)

    def unit(t: Array) -> Array:
        return 1.0 - np.exp(-z * w * t) * (np.cos(wd * t) + z / math.sqrt(1 - z * z) * np.sin(wd * t))

    def root(level: float, low: float, high: float) -> float:
        rising = unit(np.array(low)) < level
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if (unit(np.array(middle)) < level) == rising else (low, middle)
        return low

    peak = math.pi / wd
    # Extrema of 1 - y shrink by exp(-pi z/sqrt(1 - z^2)) = 0.163 each: 16.3 %, 2.7 %, 0.4 %; so the response
    # enters the 2 % band for good after the second extremum (an undershoot), rising through 0.98.
    settled = root(0.98, 2 * peak, 3 * peak)
    got = metrics_of(respond(unit, (0.8, -0.5)), step_like=True)
    # A sampled crest is low by at most (wd T / 2)^2 / 2 = 1e-5 of the oscillation.
    assert got.overshoot.value == pytest.approx(100 * math.exp(-math.pi * z / math.sqrt(1 - z * z)), rel=1e-4)
    # Interpolation: curvature w^2 T^2 / 8 = 1e-5 of a step whose slope is of order w: 1e-6 s.
    assert got.rise_time.value == pytest.approx(root(0.9, 0, peak) - root(0.1, 0, peak), abs=2e-6)
    assert got.settling_time.value == pytest.approx(settled, abs=2e-5)


def test_joint_that_never_arrives_leaves_the_headline_undefined() -> None:
    """A joint that stops at 85 % has no rise or settling time, nor has the run; the other keeps its own."""
    good = respond(lambda t: 1.0 - np.exp(-t / 0.1), (0.8, 0.5))
    q = good.q.copy()
    q[:, 1] *= 0.85
    got = metrics_of(replace(good, q=q), step_like=True)
    assert got.rise_time.value is None
    assert got.rise_time.per_joint[0] == pytest.approx(math.log(9) * 0.1, rel=1e-4)
    assert got.rise_time.per_joint[1] is None
    assert got.settling_time.value is None
    assert got.rise_time.to_json() | {"per_joint": 0} == {
        "value": None,
        "per_joint": 0,
        "counted": 2,
        "defined": 1,
    }
    assert got.overshoot.value == 0.0


def test_headlines_of_a_step() -> None:
    """Overshoot and settling time are the worst joint's, the rise time is the mean of the joints."""
    run = respond(lambda t: 1.0 - np.exp(-t / 0.1), (0.8, 0.5))
    q = run.q.copy()
    q[1000:1100, 1] = 0.6  # 20 % too far from 1.0 to 1.1 s
    got = metrics_of(replace(run, q=q), step_like=True)
    assert got.overshoot.value == pytest.approx(20.0, rel=1e-9)
    # It comes back between the samples at 1.099 and 1.1 s, 0.9 s after the step.
    assert got.settling_time.value == pytest.approx(0.8995, abs=0.0005)
    slow = respond(lambda t: 1.0 - np.exp(-t / 0.2), (0.8, 0.5))
    mixed = metrics_of(replace(run, q=columns(run.q[:, 0], slow.q[:, 1])), step_like=True)
    # Interpolation between samples: (T/c)^2 / 8 relative, as above.
    assert mixed.rise_time.value == pytest.approx(0.15 * math.log(9), rel=1e-4)


def test_joint_without_a_step_is_not_counted() -> None:
    """A joint whose reference does not move has no step response and does not spoil the headline."""
    got = metrics_of(respond(lambda t: 1.0 - np.exp(-t / 0.1), (0.8, 0.0)), step_like=True)
    assert got.rise_time.counted == 1
    assert got.rise_time.per_joint[1] is None
    assert got.rise_time.value == got.rise_time.per_joint[0]
    still = metrics_of(respond(lambda t: t, (0.0, 0.0)), step_like=True)
    assert (still.settling_time.value, still.settling_time.counted) == (None, 0)


def test_step_at_time_zero_starts_from_the_initial_position() -> None:
    """A reference that is at its target from the first sample is a step from where the arm stands."""
    run = respond(lambda t: 1.0 - np.exp(-t / 0.1), (0.8, -0.5), at=0.0)
    assert metrics_of(run, step_like=True).rise_time.value == pytest.approx(math.log(9) * 0.1, rel=1e-4)


def test_step_metrics_only_for_references_like_a_step() -> None:
    """Any other reference has no rise time, overshoot or settling time."""
    got = metrics_of(respond(lambda t: 1.0 - np.exp(-t / 0.1), (0.8, 0.5)), step_like=False)
    assert {got.rise_time.value, got.overshoot.value, got.settling_time.value} == {None}


def test_window_and_rounded_times() -> None:
    """What happens before `metrics_from` is unseen; the sample at it is seen however k T was rounded."""
    t = times(4.0, 0.1)
    q = np.zeros((40, 2))
    q[:3] = 100.0
    q[3] = 1.0  # 3 * 0.1 = 0.30000000000000004
    for start in (0.3, 3 * 0.1, math.nextafter(3 * 0.1, 1.0)):
        got = metrics_of(make(t, q, tau=q), metrics_from=start, control_period=0.1)
        assert got.max_error.value == 1.0
        assert got.rmse.value == pytest.approx(1.0 / math.sqrt(37), rel=1e-12)
        assert got.effort.per_joint[0] == pytest.approx(1.0 / 50.0**2 / 37, rel=1e-12)


def test_steady_state_uses_exactly_the_last_half_second() -> None:
    """500 samples at 1 ms, worst joint; undefined for a run shorter than that."""
    t = times()
    q = np.zeros((4000, 2))
    q[-500:, 1] = -0.4
    q[-501] = 9.0
    assert metrics_of(make(t, q)).steady_state_error.value == pytest.approx(0.4, rel=1e-12)
    short = metrics_of(make(t[:499], q[:499]), metrics_from=0.0)
    assert short.steady_state_error.value is None


def test_failed_run_and_bad_input_are_refused() -> None:
    """No metrics for a run that did not complete, an empty window, or limits that are not positive."""
    run = make(times(), np.zeros((4000, 2)))
    with pytest.raises(ResultError, match="did not complete"):
        metrics_of(replace(run, outcome=Outcome.DIVERGED, failed_at=3999))
    with pytest.raises(ResultError, match="window"):
        metrics_of(run, metrics_from=3.9995)
    for limits in ([50.0], [50.0, 0.0], [50.0, np.inf], [np.nan, 1.0]):
        with pytest.raises(ResultError, match="torque limits"):
            metrics_of(run, tau_max=np.array(limits))


def test_json_is_plain_and_follows_the_table() -> None:
    """Strict JSON (no NaN), keys in table order, one entry for each metric."""
    got = metrics_of(make(times(), np.zeros((4000, 2))), control_period=0.02)
    text = json.dumps(got.to_json(), allow_nan=False)
    assert list(json.loads(text)) == [info.key for info in applicable(tool=False)]
    assert all(type(x) is float for x in got.to_json()["rmse"]["per_joint"])
    assert [info.key for info, _ in got.items() if info.better == "higher"] == ["time_in_band"]


@settings(max_examples=20, deadline=None)
@given(scale=st.floats(1e-3, 1e3), seed=st.integers(0, 2**32 - 1))
def test_scaling_sign_and_permutation(scale: float, seed: int) -> None:
    """Error metrics have degree 1, torque metrics degree 0 in (tau, limit); signs and joint order cancel."""
    rng = np.random.default_rng(seed)
    t = times(0.6)
    q, tau, s = (rng.normal(size=(600, 2)) for _ in range(3))
    base = metrics_of(make(t, q, tau=tau, s=s), metrics_from=0.2, phi=1.0).to_json()
    scaled_run = make(t, -scale * q, tau=-scale * tau, s=-s)
    scaled = metrics_of(scaled_run, metrics_from=0.2, phi=1.0, tau_max=scale * TAU_MAX).to_json()
    swapped_run = make(t, q[:, ::-1], tau=tau[:, ::-1], s=s[:, ::-1])
    swapped = metrics_of(swapped_run, metrics_from=0.2, phi=1.0, tau_max=TAU_MAX[::-1]).to_json()
    for info in applicable(tool=False):
        factor = scale if info.unit.startswith("rad") else 1.0
        if base[info.key]["value"] is None:
            assert scaled[info.key]["value"] is None
            continue
        # A few roundings of sums of 400 terms.
        assert scaled[info.key]["value"] == pytest.approx(factor * base[info.key]["value"], rel=1e-9)
        assert swapped[info.key]["value"] == pytest.approx(base[info.key]["value"], rel=1e-12)
        assert swapped[info.key]["per_joint"] == pytest.approx(base[info.key]["per_joint"][::-1], rel=1e-12)


def test_the_documentation_has_a_row_for_every_metric() -> None:
    """docs/definitions.md says of each metric, in the order of tables, what the metric says of itself."""
    text = (SOURCE.parents[1] / "docs" / "definitions.md").read_text(encoding="utf-8")
    rows = [f"| `{info.key}` | {info.meaning} | {info.headline} |" for info in METRICS.values()]
    assert "\n".join(rows) in text


def test_angles_are_shown_in_thousandths():
    """Whatever is in rad by itself is shown in mrad, a thousand times its SI value; other units as they are."""
    assert (METRICS["rmse"].shown_unit, METRICS["rmse"].scale) == ("mrad", 1000.0)
    assert (METRICS["rise_time"].shown_unit, METRICS["rise_time"].scale) == ("s", 1.0)


def many_runs(rng: np.random.Generator) -> Iterator[JointRecord]:
    """Runs of several kinds: lengths, joints, windows, boundary layers, steps of some joints, of none, limit cycles."""
    for i in range(60):
        t, n = times(1.0 + 0.5 * (i % 2)), 1 + i % 3
        shape = len(t), n
        moving = rng.integers(0, 2, n) * (t[:, None] >= 0.2)
        chatter = 30.0 * rng.integers(0, 2, n) * np.sign(np.sin(2.0 * math.pi * (40.0 + i) * t))[:, None]
        run = make(
            t, moving + 0.1 * rng.normal(size=shape), moving, chatter + rng.normal(size=shape), rng.normal(size=shape)
        )
        yield record_of(
            run,
            tau_max=rng.uniform(20.0, 50.0, n),
            metrics_from=0.1 * (i % 2),
            control_period=T,
            step_like=i % 4 < 2,
            phi=rng.uniform(0.1, 1.0, n) if i % 5 else None,
        )


def test_a_headline_asked_for_alone_is_that_of_all() -> None:
    """Also one that is taken at the joint with the worst of another metric; others are not computed."""
    for run in itertools.islice(many_runs(np.random.default_rng(5)), 6):
        whole = headlines(measured(run))
        for row, key in enumerate(METRICS.names()):
            alone = headlines(measured(run, [key]))
            assert alone[row].tobytes() == whole[row].tobytes(), key
            assert np.isnan(alone).sum() >= len(alone) - 2


def test_runs_side_by_side_have_the_bytes_of_runs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever stands beside a run, and though its arrays are written over as soon as the next one is asked for."""
    alone = [headlines(measured(run)) for run in many_runs(np.random.default_rng(5))]

    def written_over() -> Iterator[tuple[int, JointRecord]]:
        for number, run in enumerate(many_runs(np.random.default_rng(5))):
            yield number, run
            for signal in (run.q, run.tau, run.s, run.e):
                signal.setflags(write=True)
                signal.fill(np.nan)

    for block in (1, 12_000, 10**6):
        monkeypatch.setattr("torquebench.metrics.values.BLOCK", block)
        found = dict(headlines_of(written_over()))
        assert sorted(found) == list(range(len(alone)))
        assert all(found[i].tobytes() == alone[i].tobytes() for i in found)
