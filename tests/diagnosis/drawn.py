"""Experiments with one or two imperfections, drawn by a seed and sized by closed forms instead of by what `why` finds.

The base is computed torque with the exact model: every joint is then a unit double integrator under kv (s + lam), and
the size from which on an imperfection shows is that of a textbook. The base itself follows quietly.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.robot import load_model

AMPLITUDE = {"two-link": 0.8, "puma560": 0.4, "ur5e": 0.4}
"""Amplitude of each joint's sine [rad]."""
FREQUENCY = 0.5
"""Its frequency [Hz]."""
SIGNS = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])


class Seeded(NamedTuple):
    """An experiment, and what is wrong with it."""

    label: str
    causes: frozenset[str]
    """Causes that were put there."""
    allowed: frozenset[str]
    """Further keys that are the same physics under another name."""
    sections: dict[str, Any]


class Draw:
    """An arm, an engine, and numbers to be drawn for them.

    Args:
        rng: Source of the numbers.
        arm, engine: Where it happens.
    """

    def __init__(self, rng: np.random.Generator, arm: str, engine: str) -> None:
        self.rng, self.arm, self.engine = rng, arm, engine
        self.model = load_model(arm)
        self.n, self.a = self.model.n, AMPLITUDE[arm]
        self.inertia, self.limit = self.model.flat.inertia_scale, self.model.flat.tau_max

    def between(self, low: float, high: float) -> float:
        """Return a number drawn evenly between two."""
        return float(self.rng.uniform(low, high))

    def one_of(self, *values: float) -> float:
        """Return one of some numbers."""
        return float(values[self.rng.integers(len(values))])

    def torque(self, frequency: float = FREQUENCY) -> Array:
        """Return the torque of the motion a/2 (1 - cos w t) over a period, (500, n) [N m]."""
        w = 2.0 * math.pi * frequency
        t = np.linspace(0.0, 1.0 / frequency, 500, endpoint=False)[:, None]
        a = 0.5 * self.a * SIGNS[: self.n]
        return self.model.inverse_dynamics(a * (1.0 - np.cos(w * t)), a * w * np.sin(w * t), a * w * w * np.cos(w * t))

    def holding(self, kv: float, lam: float, share: float) -> Array:
        """Return the torque that a joint's gains hold at an error of a share of its amplitude, (n,) [N m]."""
        return np.minimum(share * self.a * kv * lam * self.inertia, 0.35 * self.limit)


def delay_margin(kv: float, lam: float, T: float) -> float:
    """Return the delay that kv (s + lam)/s^2 exp(-s T/2) bears [s]."""
    w = np.geomspace(0.1, 10.0 * kv, 20000)
    size = kv * np.hypot(w, lam) / w**2
    at = int(np.flatnonzero(size >= 1.0)[-1])
    return float((math.pi / 2.0 - (math.pi / 2.0 - math.atan2(w[at], lam)) - 0.5 * w[at] * T) / w[at])


def slowest_current_loop(kv: float, lam: float, damping: float) -> float:
    """Return the natural frequency below which a torque loop makes kv (s + lam)/s^2 unstable [rad/s], by its poles."""
    low, high = 1.0, 1e4
    for _ in range(60):
        w = math.sqrt(low * high)
        poles = np.roots([1.0, 2.0 * damping * w, w * w, w * w * kv, w * w * kv * lam])
        low, high = (w, high) if np.max(poles.real) > 0.0 else (low, w)
    return low


Made = tuple[dict[str, Any], set[str]]
"""Sections over those of the base, and keys that are allowed beside the cause."""


def ct(kv: float, lam: float = 10.0) -> dict[str, Any]:
    """Return the base's controller with other gains."""
    return {"controllers": [{"name": "c", "law": "computed-torque", "gains": {"lam": lam, "kv": kv, "ki": 0.0}}]}


def delay(key: str) -> Callable[[Draw], Made]:
    """Return what makes a delay of 1.3 to 1.9 delay margins."""

    def make(d: Draw) -> Made:
        kv = d.one_of(60, 100, 150)
        whole = math.ceil(d.between(1.3, 1.9) * delay_margin(kv, 10.0, 1e-3) / 1e-3)
        return {**ct(kv), "chain": {key: round(1e-3 * whole, 6)}}, set()

    return make


def lag(d: Draw) -> Made:
    """Lag beyond 1/lam, at which Routh's criterion fails."""
    return {**ct(d.one_of(60, 100), 15.0), "chain": {"actuator_lag": round(d.between(2.0, 3.0) / 15.0, 3)}}, set()


def current_loop(d: Draw) -> Made:
    """Torque loop slower than the poles allow."""
    kv = d.one_of(60, 100)
    w = slowest_current_loop(kv, 10.0, 0.5) / d.between(1.3, 2.0)
    return {**ct(kv), "chain": {"current_loop": {"frequency": round(w, 1), "damping": 0.5}}}, set()


def _share(d: Draw, kv: float) -> float:
    """Return the rate noise that makes 0.4 to 2 % of the torque limit, the mean over joints [rad/s]."""
    return d.between(0.004, 0.02) / float(np.mean(kv * d.inertia / d.limit))


def noise(d: Draw) -> Made:
    """Encoder noise of which the difference makes 0.4 to 2 % of the limit."""
    kv = d.one_of(20, 30)
    size = _share(d, kv) * 1e-3 / math.sqrt(2.0)
    return {**ct(kv), "chain": {"encoder_noise": float(f"{size:.3g}"), "velocity": "differentiated"}}, set()


def tachometer(d: Draw) -> Made:
    """Likewise of a tachometer."""
    kv = d.one_of(20, 30)
    return {**ct(kv), "chain": {"velocity": "tachometer", "velocity_noise": float(f"{_share(d, kv):.3g}")}}, set()


def quantisation(d: Draw) -> Made:
    """Encoder step q, of whose difference about 0.4 q/T is left as noise."""
    kv = d.one_of(20, 30)
    size = float(f"{_share(d, kv) * 1e-3 / 0.4:.3g}")
    return {**ct(kv), "chain": {"quantisation": size, "velocity": "differentiated"}}, set()


def torque_quantum(d: Draw) -> Made:
    """Torque step of 6 to 12 % of the smallest limit."""
    return {**ct(20), "chain": {"torque_quantum": round(d.between(0.06, 0.12) * float(np.min(d.limit)), 2)}}, set()


def torque_rate(d: Draw) -> Made:
    """Rate limit of 0.2 to 0.4 of the RMS rate of the motion's torque."""
    torque = d.torque()
    rate = np.sqrt(np.mean((np.diff(torque, axis=0) * 500 * FREQUENCY) ** 2, axis=0))
    rate = np.maximum(d.between(0.2, 0.4) * rate, 0.02 * d.limit)
    return {**ct(40), "chain": {"torque_rate": np.round(rate, 2).tolist()}}, set()


def control_period(d: Draw) -> Made:
    """Kv T of 2.3 to 3.3, beyond the 2 of a sampled integrator."""
    T = d.one_of(0.01, 0.02)
    return {**ct(round(d.between(2.3, 3.3) / T, 1)), "run": {"control_period": T}}, set()


def law(d: Draw) -> Made:
    """Sliding mode without a layer."""
    keys = {"name": "c", "law": "smc", "switching": "sign", "equivalent_control": True}
    return {"controllers": [{**keys, "gains": {"lam": 10.0, "k": round(d.between(0.2, 0.5), 2)}}]}, set()


def gravity(d: Draw) -> Made:
    """PD at rest, sagging by 15 to 50 % of its step."""
    weight = np.abs(d.model.bias_forces(d.a * SIGNS[None, : d.n], np.zeros((1, d.n))))[0]
    kv = float(np.max(weight / d.inertia)) / (10.0 * d.between(0.15, 0.5) * d.a)
    controller = {"name": "c", "law": "pd", "gains": {"lam": 10.0, "kv": round(kv, 1)}}
    step = {"kind": "step", "target": (d.a * SIGNS[: d.n]).tolist(), "at": 0.2}
    return {"controllers": [controller], "reference": step, "run": {"duration": 4.0}}, set()


def friction(d: Draw) -> Made:
    """Coulomb friction that the gains answer with 15 to 35 % of the amplitude."""
    dry = np.round(d.holding(12, 10, d.between(0.15, 0.35)), 3).tolist()
    return {**ct(12), "plant": {"friction": {"coulomb": dry, "speed": 0.15}}}, set()


def payload(d: Draw) -> Made:
    """Load that the model does not know."""
    mass = d.between(2.0, 4.0) if d.arm == "two-link" else d.between(4.0, 8.0)
    return {**ct(8), "plant": {"payload": {"mass": round(mass, 1)}}}, set()


def bias(d: Draw) -> Made:
    """Constant torque that the gains answer with 15 to 35 % of the amplitude."""
    value = np.round(d.holding(12, 10, d.between(0.15, 0.35)), 3).tolist()
    return {**ct(12), "disturbances": [{"kind": "bias", "value": value}]}, set()


def torque_offset(d: Draw) -> Made:
    """Likewise of the drives."""
    value = np.round(d.holding(12, 10, d.between(0.15, 0.35)), 3).tolist()
    return {**ct(12), "chain": {"torque_offset": value}}, set()


def torque_limit(d: Draw) -> Made:
    """Motion so fast that it takes 1.3 to 2 times the limit."""
    factor, f = d.between(1.3, 2.0), FREQUENCY
    while np.max(np.abs(d.torque(f)) / d.limit) < factor and f < 6.0:
        f += 0.05
    sine = {"kind": "sine", "amplitude": (d.a * SIGNS[: d.n]).tolist(), "frequency_hz": round(f, 2)}
    return {**ct(20), "reference": sine}, set()


def encoder_offset(d: Draw) -> Made:
    """Offset of 10 to 30 % of the amplitude."""
    value = np.round(d.between(0.1, 0.3) * d.a * SIGNS[: d.n], 4).tolist()
    return {**ct(20), "chain": {"encoder_offset": value}}, set()


def encoder_ripple(d: Draw) -> Made:
    """Ripple of 10 to 25 % of the amplitude, once a turn, at its crest where the motion is."""
    amplitude = round(d.between(0.1, 0.25) * d.a, 4)
    return {**ct(20), "chain": {"encoder_ripple": {"amplitude": amplitude, "cycles": 1.0, "phase": 1.57}}}, set()


def missed_deadlines(d: Draw) -> Made:
    """Share p that makes a command late by T p/(1 - p), 1.2 to 2 delay margins; at a shorter period by less."""
    late = d.between(1.2, 2.0) * delay_margin(100, 10.0, 0.005) / 0.005
    chain = {"missed_deadlines": round(late / (1.0 + late), 2)}
    return {**ct(100), "chain": chain, "run": {"control_period": 0.005}}, {"control_period"}


def mismatch(d: Draw) -> Made:
    """Model wrong by 35 to 50 %."""
    return {**ct(5, 4), "model": {"mismatch": {"relative": round(d.between(0.35, 0.5), 2)}}}, set()


def perturb(d: Draw) -> Made:
    """Arm that differs from its model by 40 to 55 %."""
    return {**ct(5, 4), "plant": {"perturb": {"relative": round(d.between(0.4, 0.55), 2)}}}, set()


def transmission(d: Draw) -> Made:
    """Joints that ring at 15 to 25 Hz, seen on the link: kv is beyond 2 zeta w, so that the resonance is unstable."""
    w = 2.0 * math.pi * d.between(15.0, 25.0)
    motor, link = 0.4 * d.inertia, 0.6 * d.inertia
    k = w * w * motor * link / (motor + link)
    keys = {"stiffness": k, "damping": 2.0 * 0.02 * k / w, "inertia": motor}
    gives = {name: [float(f"{x:.4g}") for x in value] for name, value in keys.items()}
    return {
        **ct(d.one_of(30, 50)),
        "plant": {"timestep": 1e-4 if d.arm == "puma560" else 2.5e-4, "transmission": {**gives, "sensor": "link"}},
    }, set()


def torque_speed(d: Draw) -> Made:
    """Motors without torque at 0.3 to 0.5 of the motion's speed."""
    peak = 0.5 * d.a * 2.0 * math.pi * FREQUENCY
    return {
        **ct(20),
        "chain": {"torque_speed": {"corner": 0.0, "no_load": round(d.between(0.3, 0.5) * peak, 3)}},
    }, set()


def backlash(d: Draw) -> Made:
    """Gap of 15 to 30 % of the amplitude between the motors, which are measured, and the links; and its springs."""
    motor = 0.4 * d.inertia
    k = (2.0 * math.pi * 40.0) ** 2 * 0.24 * d.inertia
    keys = {"stiffness": k, "damping": 0.1 * k / (2.0 * math.pi * 40.0), "inertia": motor}
    gives = {name: [float(f"{x:.4g}") for x in value] for name, value in keys.items()}
    wide = round(d.between(0.3, 0.6) * d.a, 3)
    return {
        **ct(20),
        "plant": {"timestep": 1e-4 if d.arm == "puma560" else 2.5e-4, "transmission": {**gives, "backlash": wide}},
    }, set()


def integral(d: Draw) -> Made:
    """Integral of 3 to 5 times kv^2 lam, at which Routh's criterion of s^3 + kv s^2 + kv lam s + ki fails."""
    kv = d.one_of(10, 20)
    made = ct(kv)
    made["controllers"][0]["gains"]["ki"] = round(d.between(3.0, 5.0) * kv * kv * 10.0, 0)
    return made, set()


def thermal_limit(d: Draw) -> Made:
    """Continuous torque of 0.4 to 0.7 of what the motion takes on average."""
    rms = np.sqrt(np.mean(d.torque() ** 2, axis=0))
    torque = np.round(np.maximum(d.between(0.4, 0.7) * rms, 0.01 * d.limit), 3).tolist()
    return {**ct(20), "chain": {"thermal_limit": {"torque": torque, "time": 0.2}}}, set()


SINGLE: dict[str, tuple[str, Callable[[Draw], Made]]] = {
    "command_delay": ("command_delay", delay("command_delay")),
    "measurement_delay": ("measurement_delay", delay("measurement_delay")),
    "torque_delay": ("torque_delay", delay("torque_delay")),
    "actuator_lag": ("actuator_lag", lag),
    "current_loop": ("current_loop", current_loop),
    "noise": ("noise", noise),
    "tachometer": ("noise", tachometer),
    "quantisation": ("quantisation", quantisation),
    "torque_quantum": ("torque_quantum", torque_quantum),
    "torque_rate": ("torque_rate", torque_rate),
    "control_period": ("control_period", control_period),
    "law": ("law", law),
    "gravity": ("gravity", gravity),
    "friction": ("friction", friction),
    "payload": ("payload", payload),
    "bias": ("disturbances", bias),
    "torque_offset": ("torque_offset", torque_offset),
    "torque_limit": ("torque_limit", torque_limit),
    "encoder_offset": ("encoder_offset", encoder_offset),
    "encoder_ripple": ("encoder_ripple", encoder_ripple),
    "missed_deadlines": ("missed_deadlines", missed_deadlines),
    "mismatch": ("mismatch", mismatch),
    "perturb": ("perturb", perturb),
    "transmission": ("transmission", transmission),
    "torque_speed": ("torque_speed", torque_speed),
    "thermal_limit": ("thermal_limit", thermal_limit),
    "backlash": ("backlash", backlash),
    "integral": ("integral", integral),
}
"""Label -> key of the cause, and what makes it."""


def at_one(d: Draw, joint: int, value: float, others: float) -> list[float]:
    """Return a number for a joint, counted from 0, and another for all others."""
    return [float(f"{value:.3g}") if i == joint else others for i in range(d.n)]


def left_over(d: Draw, joint: int, kv: float, lam: float, share: float) -> float:
    """Return the gain g of a drive that misses (1 - g)/g of its torque: gains answer with a share of the motion."""
    rms = float(np.sqrt(np.mean(d.torque() ** 2, axis=0))[joint])
    return 1.0 / (1.0 + share * kv * lam * float(d.inertia[joint]) * d.a / rms)


def torque_gain(d: Draw) -> Made:
    """A drive that gives so much less than asked that gains answer with 15 to 30 % of the amplitude."""
    joint = int(d.rng.integers(d.n))
    return {
        **ct(12),
        "chain": {"torque_gain": at_one(d, joint, left_over(d, joint, 12, 10, d.between(0.15, 0.3)), 1.0)},
    }, set()


def derating(d: Draw) -> Made:
    """Likewise of a motor that weakens before the metrics' window."""
    joint = int(d.rng.integers(d.n))
    gain = at_one(d, joint, left_over(d, joint, 12, 10, d.between(0.15, 0.3)), 1.0)
    return {**ct(12), "chain": {"derating": {"at": 0.4, "over": 0.4, "gain": gain}}}, set()


def derated_limit(d: Draw) -> Made:
    """A motor whose limit falls to 0.4 to 0.7 of what the motion takes at most."""
    joint = int(d.rng.integers(d.n))
    most = float(np.max(np.abs(d.torque()[:, joint])) / d.limit[joint])
    return {
        **ct(20),
        "chain": {"derating": {"at": 0.4, "limit": at_one(d, joint, d.between(0.4, 0.7) * most, 1.0)}},
    }, set()


def cross_talk(d: Draw) -> Made:
    """A leak from the joint before, or behind, that gains answer with 15 to 35 % of the amplitude."""
    rms = np.sqrt(np.mean(d.torque() ** 2, axis=0))
    joint, way = int(d.rng.integers(d.n - 1)), int(d.rng.integers(2))
    to, of = (joint + 1, joint) if way else (joint, joint + 1)
    leak = d.holding(12, 10, d.between(0.15, 0.35))[to] / rms[of]
    return {
        **ct(12),
        "chain": {"cross_talk": {"preceding" if way else "following": at_one(d, to, float(leak), 0.0)}},
    }, set()


def lock(d: Draw) -> Made:
    """A joint that stays where it is as the metrics' window begins."""
    return {**ct(5, 4), "plant": {"lock": {"joint": int(d.rng.integers(1, d.n + 1)), "at": 1.0}}}, set()


FAULTS: dict[str, tuple[str, Callable[[Draw], Made]]] = {
    "torque_gain": ("torque_gain", torque_gain),
    "derating": ("derating", derating),
    "derated limit": ("derating", derated_limit),
    "cross_talk": ("cross_talk", cross_talk),
    "lock": ("lock", lock),
}
"""Faults of one joint, likewise: those of `SINGLE` are drawn from without these, so that a seed stays what it was."""


def both(*makers: Callable[[Draw], Made]) -> Callable[[Draw], Made]:
    """Return what makes two imperfections at once, with the controller of the second."""

    def make(d: Draw) -> Made:
        whole: dict[str, Any] = {}
        for maker in makers:
            for section, value in maker(d)[0].items():
                whole[section] = {**whole.get(section, {}), **value} if isinstance(value, dict) else value
        return whole, set()

    return make


def split(first: str, second: str) -> Callable[[Draw], Made]:
    """Return what makes two delays, each within the margin by itself and together beyond it."""

    def make(d: Draw) -> Made:
        kv = d.one_of(60, 100)
        each = max(2, round(d.between(0.7, 0.85) * delay_margin(kv, 10.0, 1e-3) / 1e-3))
        return {**ct(kv), "chain": {first: 1e-3 * each, second: 1e-3 * each}}, set()

    return make


PAIRS: dict[str, tuple[tuple[str, str], Callable[[Draw], Made]]] = {
    "two delays": (("command_delay", "measurement_delay"), split("command_delay", "measurement_delay")),
    "delay at both ends": (("torque_delay", "measurement_delay"), split("torque_delay", "measurement_delay")),
    "noise+bias": (("noise", "disturbances"), both(noise, bias)),
    "noise+friction": (("noise", "friction"), both(noise, friction)),
    "tachometer+payload": (("noise", "payload"), both(tachometer, payload)),
    "quantisation+payload": (("quantisation", "payload"), both(quantisation, payload)),
    "quantum+payload": (("torque_quantum", "payload"), both(torque_quantum, payload)),
    "friction+offset": (("friction", "torque_offset"), both(friction, torque_offset)),
    "law+encoder": (("law", "encoder_offset"), both(encoder_offset, law)),
    "noise+encoder": (("noise", "encoder_offset"), both(encoder_offset, noise)),
    "noise+mismatch": (("noise", "mismatch"), both(noise, mismatch)),
    "quantisation+bias": (("quantisation", "disturbances"), both(quantisation, bias)),
}
"""Label -> keys of the causes, and what makes them."""
ARMS = ("two-link", "puma560", "ur5e")
ENGINES = ("mujoco", "analytic")


HARMLESS: dict[str, Any] = {
    "quantisation": 1e-6,
    "velocity": "differentiated",
    "velocity_filter": 500.0,
    "command_delay": 0.001,
    "current_loop": {"frequency": 1500.0, "damping": 0.7},
    "torque_quantum": 0.002,
    "encoder_offset": 1e-4,
}
"""A chain that does no harm to the base, which stands beside the causes in every other experiment."""


def beside(d: Draw, changes: dict[str, Any]) -> dict[str, Any]:
    """Return what is left of `HARMLESS` beside a cause: nothing that smooths its noise, or has its key."""
    own = changes.get("chain", {})
    period = changes.get("run", {}).get("control_period", 0.001)
    kept = {key: value for key, value in HARMLESS.items() if key not in own}
    if "velocity" in own:
        kept = {key: value for key, value in kept.items() if key not in ("velocity_filter", "quantisation")}
    if "actuator_lag" in own:
        kept.pop("current_loop", None)
    if period > 0.001:
        kept = {key: value for key, value in kept.items() if key in ("torque_quantum", "encoder_offset")}
    return {**kept, **own}


def base(d: Draw) -> dict[str, Any]:
    """Return the experiment with nothing wrong."""
    sine = {"kind": "sine", "amplitude": (d.a * SIGNS[: d.n]).tolist(), "frequency_hz": FREQUENCY}
    run = {"duration": 3.0}
    return {"name": "drawn", "plant": {"engine": d.engine, "model": d.arm}, **ct(20), "reference": sine, "run": run}


def with_changes(d: Draw, changes: dict[str, Any]) -> dict[str, Any]:
    """Return the base with sections of its own, or keys of plant and run."""
    whole = base(d)
    for section, value in changes.items():
        whole[section] = {**whole.get(section, {}), **value} if section in ("plant", "run") else value
    return whole


@functools.cache
def drawn(seed: int, singles: int = 20, pairs: int = 10) -> tuple[Seeded, ...]:
    """Return experiments with one cause each, then with two, on arms and engines drawn at random."""
    rng = np.random.default_rng(seed)
    chosen = [*rng.choice(list(SINGLE), singles, replace=False), *rng.choice(list(PAIRS), pairs, replace=False)]
    found = []
    for label in map(str, chosen):
        d = Draw(rng, ARMS[rng.integers(3)], ENGINES[rng.integers(2)])
        if label in SINGLE:
            key, make = SINGLE[label]
            causes = frozenset([key])
        else:
            keys, make = PAIRS[label]
            causes = frozenset(keys)
        changes, allowed = make(d)
        whole = with_changes(d, changes)
        if rng.random() < 0.5 and label not in ("law", "two delays", "delay at both ends", "law+encoder"):
            whole["chain"] = beside(d, changes)
            label += ", harmless chain"
        whole["run"]["seed"] = int(rng.integers(1000))
        found.append(Seeded(f"{label}, {d.arm} {d.engine}", causes, frozenset(allowed), whole))
    return tuple(found)
