"""Parts that several laws share: the gains they have in common, and the equivalent control."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from torquebench.kernel import Array, kernel
from torquebench.laws.base import Gain, Option
from torquebench.references import Reference
from torquebench.robot.dynamics import inverse_dynamics
from torquebench.robot.model import Model

Slope: TypeAlias = Annotated[Array, Gain("slope lambda of the sliding variable s = de + lambda e", "1/s")]
Switching: TypeAlias = Annotated[Array, Gain("switching gain kK, a fraction of the torque limit, K = kK tau_max", "1")]
Rate: TypeAlias = Annotated[
    Array, Gain("rate gain kV, Kd = kV Mbar with Mbar the model's inertia scale; the position gain is lambda Kd", "1/s")
]
Integral: TypeAlias = Annotated[
    Array, Gain("integral gain kI, KI = kI Mbar; zero leaves the integral out", "1/s^3", positive=False)
]
Band: TypeAlias = Annotated[Array, Gain("half-width phi of the band |s| <= phi", "rad/s")]
UseModel: TypeAlias = Annotated[
    int, Option("add the equivalent control tau_eq = M^ (qdd_ref + lambda de) + N^ of the model", (True, False))
]


@kernel
def equivalent_control(use: int, lam: Array, model: Model, q: Array, qd: Array, ref: Reference, tau: Array) -> None:
    """Fill `tau` (n,) [N m] with tau_eq = M^(q) (qdd_ref + lambda de) + N^(q, qd), equation (98) without e's qdd.

    The printed (98) contains the measured acceleration; used literally it makes the sampled loop ring at full torque.

    Args:
        use: 1 for tau_eq, 0 for zero torque.
        lam: Slope lambda, (n,) [1/s].
        model: The law's belief; ``scratch.free`` is overwritten.
        q, qd: Measured position [rad] and velocity [rad/s], (n,).
        ref: Desired motion at this instant.
        tau: Result.
    """
    if use:
        for i in range(len(q)):
            model.scratch.free[i] = ref.qdd[i] + lam[i] * (ref.qd[i] - qd[i])
        inverse_dynamics(model, q, qd, model.scratch.free, tau)
    else:
        for i in range(len(q)):
            tau[i] = 0.0
