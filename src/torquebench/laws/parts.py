"""Parts that several laws share: the gains they have in common, and the equivalent control."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from torquebench.kernel import Array, kernel
from torquebench.laws.declare import Gain, Option
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics
from torquebench.robot.flat_model import Model
from torquebench.tuning import damping, rate, stiffness

Slope: TypeAlias = Annotated[Array, Gain("slope lambda of the sliding variable s = de + lambda e", "1/s")]
Switching: TypeAlias = Annotated[Array, Gain("switching gain kK, a fraction of the torque limit, K = kK tau_max", "1")]
Rate: TypeAlias = Annotated[
    Array,
    Gain(
        "rate gain kV, Kd = kV Mbar with Mbar the model's inertia scale; the position gain is lambda Kd",
        "1/s",
        auto=rate,
    ),
]
Integral: TypeAlias = Annotated[
    Array, Gain("integral gain kI, KI = kI Mbar; zero leaves the integral out", "1/s^3", positive=False)
]
Stiffness: TypeAlias = Annotated[Array, Gain("position gain Kp, a stiffness", "N m/rad", auto=stiffness)]
Damping: TypeAlias = Annotated[Array, Gain("rate gain Kd, a damping", "N m s/rad", auto=damping)]
Band: TypeAlias = Annotated[Array, Gain("half-width phi of the band |s| <= phi", "rad/s")]
UseModel: TypeAlias = Annotated[
    int,
    Option(
        "add the equivalent control tau_eq = M^ (qdd_ref + lambda de) + N^ of the model; measured-acceleration is (98) "
        "read literally, M^ (qdd_ref - qdd + lambda de) + N^, with qdd from differences of the measured velocity",
        (True, False, "measured-acceleration"),
    ),
]
WITHOUT_MODEL, WITH_MODEL, MEASURED = 0, 1, 2
"""Values of the option `UseModel` as a law receives them."""


@kernel
def equivalent_control(
    use: int, lam: Array, pull: float, model: Model, q: Array, qd: Array, ref: Reference, last_qd: Array, tau: Array
) -> None:
    """Fill `tau` (n,) [N m] with the equivalent control, equation (98) with the change of S of (101).

    The printed (98) contains the measured acceleration, as de's derivative; used literally it makes the sampled loop
    ring at full torque. The workable form leaves it out: tau_eq = M^(q) (qdd_ref + lambda de) + N^(q, qd).

    Args:
        use: WITH_MODEL, WITHOUT_MODEL for zero torque, or MEASURED for the literal form.
        lam: Slope lambda, (n,) [1/s].
        pull: Share of lambda^2 e that is added to the acceleration: 0, or 1/4 for a surface with (lambda/2)^2 int e.
        model: The law's belief; ``scratch.free`` is overwritten.
        q, qd: Measured position [rad] and velocity [rad/s], (n,).
        ref: Desired motion at this instant.
        last_qd: Measured velocity at the last instant, (n,) [rad/s]; becomes `qd`.
        tau: Result.
    """
    if use == WITHOUT_MODEL:
        for i in range(len(q)):
            tau[i] = 0.0
        return
    for i in range(len(q)):
        model.scratch.free[i] = ref.qdd[i] + lam[i] * (ref.qd[i] - qd[i])
    if pull > 0.0:
        for i in range(len(q)):
            model.scratch.free[i] += pull * lam[i] * lam[i] * (ref.q[i] - q[i])
    if use == MEASURED:
        for i in range(len(q)):
            model.scratch.free[i] -= (qd[i] - last_qd[i]) / model.control_period
            last_qd[i] = qd[i]
    inverse_dynamics(model, q, qd, model.scratch.free, tau)
