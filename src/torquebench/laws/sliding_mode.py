"""Sliding mode control: the conventional law on its three surfaces, and the linear-band law."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array, kernel, sat, sign
from torquebench.laws.declare import Gain, Option
from torquebench.laws.law import controller
from torquebench.laws.parts import Rate, Slope, Switching, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model

PD, PI, PID = 0, 1, 2
SIGN = 0
"""Place of sgn(s) among the choices of `smc`."""
SATURATION = 0
"""Place of sat(s/phi) among the choices of `linear-band-smc`."""

Switch = Annotated[int, Option("switching function: sgn(s) (96), or sat(s/phi) (127)", ("sign", "saturation"))]
SwitchBand = Annotated[
    Array, Gain("half-width phi of the band |s| <= phi", "rad/s", only_with=("switching", "saturation"))
]


class SmcGains(NamedTuple):
    """Gains and options of the conventional law."""

    lam: Slope
    k: Switching
    phi: SwitchBand
    equivalent_control: UseModel
    switching: Switch
    surface: Annotated[
        int,
        Option(
            "sliding variable: pd is de + lambda e (83), pi is lambda e + (lambda/2)^2 int e (85), pid is both (86)",
            ("pd", "pi", "pid"),
        ),
    ]


class SmcMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded; the integral of the error; the velocity seen last."""

    s: Array
    integral: Array
    velocity: Array


@kernel
def surface_of(surface: int, lam: float, e: float, de: float, integral: float) -> float:
    """Return the sliding variable of one joint; (83), (85), (86).

    Args:
        surface: PD, PI or PID.
        lam: Slope lambda [1/s].
        e, de: Error [rad] and its rate [rad/s].
        integral: Integral of the error [rad s].
    """
    if surface == PD:
        return de + lam * e
    s = lam * e + 0.25 * lam * lam * integral
    return s if surface == PI else de + s


@controller("smc", gains=SmcGains, memory=SmcMemory)
def smc(
    gains: SmcGains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: SmcMemory, tau: Array
) -> None:
    """Conventional sliding mode: tau = [tau_eq +] K sgn(s), or K sat(s/phi); (97), (102)-(107), (126).

    On the surfaces pi and pid tau_eq has (lambda/2)^2 e in its acceleration, the rate of their integral, which stops
    growing while the torque is beyond its limit in the error's direction. On pi nothing slides: s has relative degree
    two, and the switching term alone does not damp. The measured acceleration enters tau_eq on every surface, though pi
    has none in its own rate.
    """
    pull = 0.0 if gains.surface == PD else 0.25
    equivalent_control(gains.equivalent_control, gains.lam, pull, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        s = surface_of(gains.surface, gains.lam[i], e, ref.qd[i] - qd[i], memory.integral[i])
        switch = sign(s) if gains.switching == SIGN else sat(s / gains.phi[i])
        memory.s[i] = s
        tau[i] += gains.k[i] * model.tau_max[i] * switch
        if gains.surface != PD and not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e


class LinearBandGains(NamedTuple):
    """Gains and options of the linear-band law."""

    lam: Slope
    k: Switching
    phi: SwitchBand
    kv: Rate
    equivalent_control: UseModel
    switching: Annotated[
        int,
        Option("switching function: sat(s/phi) (127), or sgn(s), which is (149) as printed", ("saturation", "sign")),
    ]


class LinearBandMemory(NamedTuple):
    """The sliding variable, kept so that it is recorded, and the velocity seen last."""

    s: Array
    velocity: Array


@controller("linear-band-smc", gains=LinearBandGains, memory=LinearBandMemory)
def linear_band_smc(
    gains: LinearBandGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: LinearBandMemory,
    tau: Array,
) -> None:
    """Linear band: tau = [tau_eq +] K sat(s/phi) + Kd s, with s = de + lambda e and Kd = kV Mbar; (147)-(148).

    With sgn for sat it is (149) without its fuzzy part, as printed.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        switch = sat(s / gains.phi[i]) if gains.switching == SATURATION else sign(s)
        memory.s[i] = s
        tau[i] += gains.k[i] * model.tau_max[i] * switch + gains.kv[i] * model.inertia_scale[i] * s
