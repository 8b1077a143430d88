"""References: values of the protocol, rates that are derivatives, and what a user's samples are checked for."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from torquebench.errors import InconsistentReferenceError
from torquebench.kernel import Array
from torquebench.references import Quintic, Ramp, Reference, ReferenceSource, Sine, Step, from_samples
from torquebench.timing import Timing

A = np.array([1.2, -1.0, 1.0, 1.0, 1.0, 1.0])
HZ = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
STEP = np.array([1.0, -0.8, 0.8, 0.6, 0.6, 0.6])
RAMP = np.array([2.5, -1.5, 1.5, 1.5, 1.5, 1.5])
QUINTIC = np.array([1.5, -1.2, 1.0, 1.0, 1.0, 1.0])
PROTOCOL = {"sine": Sine(A, HZ), "step": Step(STEP, 0.2), "ramp": Ramp(RAMP, 3.0), "quintic": Quintic(QUINTIC, 1.0)}
"""The protocol's four references for the PUMA."""


def times(duration: float, h: float = 0.001) -> Array:
    """Sample times k h, (N,) [s]."""
    return np.arange(round(duration / h)) * h


def slope(x: Array, h: float) -> Array:
    """Five-point derivative at samples 2 .. N-3: exact up to h^4/30 times the fifth derivative, and round-off/h."""
    return (x[:-4] - 8.0 * x[1:-3] + 8.0 * x[3:-1] - x[4:]) / (12.0 * h)


@pytest.mark.parametrize("name", PROTOCOL)
def test_every_reference_starts_at_home(name: str) -> None:
    """At t = 0 the wanted position is zero; all but the ramp start at rest too."""
    at_zero = PROTOCOL[name](np.zeros(1))
    assert not np.any(at_zero.q)
    assert np.any(at_zero.qd) == (name == "ramp")
    assert all(array.shape == (1, 6) for array in at_zero)


def test_sine_is_its_own_derivative_by_spectrum() -> None:
    """Over 10 s every joint's motion is periodic, so multiplying its spectrum by i w differentiates it exactly."""
    q, qd, qdd = PROTOCOL["sine"](times(10.0))
    w = 2j * math.pi * np.fft.rfftfreq(len(q), 0.001)[:, None]
    for value, rate in ((q, qd), (qd, qdd)):
        spectral = np.fft.irfft(w * np.fft.rfft(value, axis=0), len(q), axis=0)
        # round-off of 5000 bins, each 1e-16 of values up to 6 times up to 3000 rad/s: some 1e-10 when they add up
        assert rate == pytest.approx(spectral, abs=1e-9)


@pytest.mark.parametrize("name", ["sine", "quintic"])
def test_rates_are_derivatives_by_differences(name: str) -> None:
    """Five-point differences of q give qd, and of qd give qdd, everywhere but across the quintic's end."""
    t = times(2.0)
    q, qd, qdd = PROTOCOL[name](t)
    smooth = np.ones(len(t) - 4, dtype=bool) if name == "sine" else np.abs(t[2:-2] - 1.0) > 0.0025
    for value, rate in ((q, qd), (qd, qdd)):
        # h^4/30 max|d^5 qd| = 3e-14 * 6e4 for 1 Hz; round-off 1e-15 / 1e-3
        assert rate[2:-2][smooth] == pytest.approx(slope(value, 0.001)[smooth], abs=1e-8)


def test_sine_values() -> None:
    """Joint 1: half-way up at a quarter period with speed A w / 2, on top at half a period with -A w^2 / 2."""
    w = math.pi
    q, qd, qdd = (array[:, 0] for array in PROTOCOL["sine"](np.array([0.0, 0.5, 1.0, 2.0])))
    assert q == pytest.approx([0.0, 0.6, 1.2, 0.0], abs=1e-15)
    assert qd == pytest.approx([0.0, 0.6 * w, 0.0, 0.0], abs=1e-14)
    assert qdd == pytest.approx([0.6 * w * w, 0.0, -0.6 * w * w, 0.6 * w * w], abs=1e-13)


def test_sine_peaks_have_the_protocol_s_amplitudes() -> None:
    """Each joint swings between zero and A, at half its own period."""
    for joint in range(6):
        top = PROTOCOL["sine"](np.array([0.5 / HZ[joint]])).q[0, joint]
        assert top == pytest.approx(A[joint], rel=1e-14)
    q = PROTOCOL["sine"](times(10.0)).q
    # between samples the top is missed by A w^2 h^2 / 16 at most
    assert np.max(np.abs(q), axis=0) == pytest.approx(np.abs(A), abs=3e-6)
    assert np.all(q * np.sign(A) >= 0.0)


def test_step_values() -> None:
    """Zero before 0.2 s, the target from the instant 0.2 s on; no rates ever."""
    t = times(0.5)
    q, qd, qdd = PROTOCOL["step"](t)
    assert not np.any(q[:200])
    assert np.array_equal(q[200:], np.tile(STEP, (300, 1)))
    assert not np.any(qd)
    assert not np.any(qdd)


def test_ramp_values() -> None:
    """Constant speed target/3 for 3 s, then held; the wanted acceleration is zero even where the speed jumps."""
    q, qd, qdd = PROTOCOL["ramp"](np.array([0.0, 1.5, 2.999, 3.0, 3.5]))
    assert q == pytest.approx(np.outer([0.0, 0.5, 2.999 / 3.0, 1.0, 1.0], RAMP), rel=1e-14)
    assert qd == pytest.approx(np.outer([1.0, 1.0, 1.0, 0.0, 0.0], RAMP / 3.0), rel=1e-14)
    assert not np.any(qdd)


def test_quintic_values() -> None:
    """At x = 1/4, 1/2, 3/4: 53/512, 1/2, 459/512; top speed 15/8; acceleration 45/8, 0, -45/8; at rest at the end."""
    q, qd, qdd = Quintic(QUINTIC, 2.0)(np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5]))
    assert q == pytest.approx(np.outer([0.0, 53 / 512, 0.5, 459 / 512, 1.0, 1.0], QUINTIC), rel=1e-14)
    # 30 x^2 (1 - x)^2 / 2 s and 60 x (1 - x)(1 - 2x) / 4 s^2
    assert qd == pytest.approx(np.outer([0.0, 135 / 256, 15 / 16, 135 / 256, 0.0, 0.0], QUINTIC), rel=1e-14)
    assert qdd == pytest.approx(np.outer([0.0, 45 / 32, 0.0, -45 / 32, 0.0, 0.0], QUINTIC), rel=1e-14, abs=1e-14)


@pytest.mark.parametrize("name", PROTOCOL)
def test_a_reference_is_a_function_of_time_alone(name: str) -> None:
    """Sampling a stretch gives the same bytes as sampling everything: no state, no accumulated time."""
    t = times(4.0)
    whole, part = PROTOCOL[name](t), PROTOCOL[name](t[1234:1300])
    for a, b in zip(whole, part, strict=True):
        assert a[1234:1300].tobytes() == b.tobytes()


SMOOTH = [("sine", PROTOCOL["sine"], 4.0), ("quintic", PROTOCOL["quintic"], 0.9), ("rest", Step(STEP, 9.0), 1.0)]


@pytest.mark.parametrize(("name", "source", "duration"), SMOOTH)
@pytest.mark.parametrize("h", [0.0005, 0.001, 0.004, 0.01])
def test_true_samples_are_accepted(name: str, source: ReferenceSource, duration: float, h: float) -> None:
    """A consistent triple comes back with the same values, as new arrays, whatever the sampling period."""
    t = times(duration, h)
    given = source(t)
    taken = from_samples(t, *given)
    for a, b in zip(given, taken, strict=True):
        assert np.array_equal(a, b)
        assert a is not b
    given.q[0] = 9.0
    assert taken.q[0, 0] == 0.0


def shifted(x: Array) -> Array:
    """Return the samples one late."""
    return np.concatenate([x[:1], x[:-1]])


WRONG: dict[str, tuple[str, Callable[[Reference], Reference]]] = {
    "qd flipped": ("qd", lambda r: r._replace(qd=-r.qd)),
    "q flipped": ("qd", lambda r: r._replace(q=-r.q)),
    "qdd flipped": ("qdd", lambda r: r._replace(qdd=-r.qdd)),
    "qd flipped in joint 2": ("qd", lambda r: r._replace(qd=r.qd * [1, -1])),
    "qdd flipped in joint 2": ("qdd", lambda r: r._replace(qdd=r.qdd * [1, -1])),
    "qd 5 % fast": ("qd", lambda r: r._replace(qd=1.05 * r.qd, qdd=1.05 * r.qdd)),
    "qd 5 % slow": ("qd", lambda r: r._replace(qd=0.95 * r.qd, qdd=0.95 * r.qdd)),
    "qdd 5 % high": ("qdd", lambda r: r._replace(qdd=1.05 * r.qdd)),
    "q in degrees": ("qd", lambda r: r._replace(q=np.degrees(r.q))),
    "qd one sample late": ("qd", lambda r: r._replace(qd=shifted(r.qd), qdd=shifted(r.qdd))),
    "qdd one sample late": ("qdd", lambda r: r._replace(qdd=shifted(r.qdd))),
    "qd left out": ("qd", lambda r: r._replace(qd=0 * r.qd, qdd=0 * r.qdd)),
    "qdd left out": ("qdd", lambda r: r._replace(qdd=0 * r.qdd)),
    "joints swapped": ("qd", lambda r: r._replace(q=r.q[:, ::-1])),
    "one bad sample": ("qd", lambda r: r._replace(q=np.where(np.arange(len(r.q))[:, None] == 57, 0.0, r.q))),
    "qd and qdd exchanged": ("qd", lambda r: r._replace(qd=r.qdd, qdd=r.qd)),
}


@pytest.mark.parametrize("what", WRONG)
def test_inconsistent_samples_are_refused(what: str) -> None:
    """Each mistake is refused, by the name of the rate that does not fit; a 10 ms delay of 1 Hz is 6 %, beyond 1 %."""
    rate, spoil = WRONG[what]
    t = times(4.0, 0.01)
    good = Sine(np.array([1.2, -1.0]), np.array([0.75, 1.0]))(t)
    with pytest.raises(InconsistentReferenceError, match=f"^{rate} is not the derivative of .*joint [12]"):
        from_samples(t, *spoil(good))


def test_jumps_are_refused() -> None:
    """A step's speed and a ramp's acceleration are not derivatives, so sampled ones cannot be given as a motion."""
    t = times(4.0)
    with pytest.raises(InconsistentReferenceError, match=r"qd .* at t = 0\.(199|2) s"):
        from_samples(t, *PROTOCOL["step"](t))
    with pytest.raises(InconsistentReferenceError, match=r"is not the derivative"):
        from_samples(t, *PROTOCOL["ramp"](t))


@pytest.mark.parametrize("which", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused(which: int, value: float) -> None:
    """One bad number in any of the four arrays is enough."""
    t = times(1.0)
    arrays = [t, *PROTOCOL["sine"](t)]
    arrays[which][17, ...] = value
    with pytest.raises(InconsistentReferenceError, match="not finite"):
        from_samples(*arrays)


def test_wrong_shapes_are_refused() -> None:
    """Fewer than three samples, flat arrays, arrays of different lengths or widths: the message states the shapes."""
    t = times(0.1)
    q, qd, qdd = PROTOCOL["sine"](t)
    for bad in (
        (t[:2], q[:2], qd[:2], qdd[:2]),
        (t, q[:, 0], qd[:, 0], qdd[:, 0]),
        (t[:-1], q, qd, qdd),
        (t, q[:-1], qd, qdd),
        (t, q, qd[:, :5], qdd),
        (t[:, None], q, qd, qdd),
        (t, q, qd, qdd[1:]),
    ):
        with pytest.raises(InconsistentReferenceError, match=r"shapes t \(\d+,.*wanted \(N,\)"):
            from_samples(*bad)


def test_uneven_times_are_refused() -> None:
    """Times must increase by one and the same step; a wrong time scale shows as wrong rates."""
    t = times(1.0)
    motion = PROTOCOL["sine"](t)
    jitter = t.copy()
    jitter[50] += 1e-8  # 1e-5 of the step
    for bad in (jitter, t[::-1].copy(), np.zeros_like(t)):
        with pytest.raises(InconsistentReferenceError, match="evenly spaced and increasing"):
            from_samples(bad, *motion)
    with pytest.raises(InconsistentReferenceError, match="qd is not the derivative"):
        from_samples(2.0 * t, *motion)


def test_a_wrong_rate_of_a_joint_that_hardly_moves_is_refused() -> None:
    """Each joint is held to its own movement: a flipped sign of 4 mrad is found beside a swing of 1.2 rad."""
    t = np.arange(1000) * 0.001
    true = Sine(np.array([1.2, 0.004]), np.array([1.0, 1.0]))(t)
    from_samples(t, *true)
    flipped = true.qd * np.array([1.0, -1.0])
    with pytest.raises(InconsistentReferenceError, match="joint 2"):
        from_samples(t, true.q, flipped, true.qdd)


def test_a_quintic_may_take_the_whole_run() -> None:
    """It must reach its target: a rise as long as the run does, one that is longer by a millionth does not."""
    assert not list(Quintic(1.0, 2.0).check(Timing(2.0, 0.001)))
    assert list(Quintic(1.0, 2.000002).check(Timing(2.0, 0.001)))


def test_the_joint_that_is_most_wrong_is_named() -> None:
    """Most wrong is what exceeds its own tolerance by most: a small joint's flipped rate, not a large one's 3 %."""
    t = times(1.0)
    right = Sine([0.01, 1.0], [1.0, 1.0])(t)
    qd = right.qd * np.array([-1.0, 1.03])
    with pytest.raises(InconsistentReferenceError, match=r"qd is not the derivative of q: at .* joint 1,"):
        from_samples(t, right.q, qd, right.qdd)
