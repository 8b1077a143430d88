"""PD with gravity and friction compensation, as UR's torque interface has it."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array, sat
from torquebench.laws.declare import Gain, Option
from torquebench.laws.law import controller
from torquebench.laws.parts import Damping, Stiffness
from torquebench.references import Reference
from torquebench.robot.dynamics import gravity
from torquebench.robot.flat_model import Model
from torquebench.tuning import crawl, none


class Gains(NamedTuple):
    """Gains of the law; what it believes of the friction is among them."""

    kp: Stiffness
    kd: Damping
    viscous: Annotated[Array, Gain("viscous friction that the law believes in", "N m s/rad", positive=False, auto=none)]
    coulomb: Annotated[Array, Gain("Coulomb friction that the law believes in", "N m", positive=False, auto=none)]
    speed: Annotated[
        Array,
        Gain("speed above which its Coulomb friction is full", "rad/s", auto=crawl, search=(0.005, 0.5, "log")),
    ]
    friction_at: Annotated[
        int,
        Option(
            "velocity at which friction is compensated: the desired one, a feed-forward; or the measured one, as UR's "
            "controller does it, which takes damping away from the loop",
            ("desired", "measured"),
        ),
    ]


@controller("gravity-friction", gains=Gains)
def gravity_friction(
    gains: Gains, model: Model, t: float, q: Array, qd: Array, ref: Reference, memory: object, tau: Array
) -> None:
    """PD with gravity and friction compensation: tau = Kp e + Kd de + g^(q) + viscous v + coulomb sat(v/speed).

    v is the desired velocity or the measured one. UR's `direct_torque` (PolyScope 5.23 and later) adds gravity and a
    share of the friction, `viscous_scale` and `coulomb_scale`, to the PD torque that the user's program gives; the
    friction itself is UR's own and not published. `gains: auto` knows of no friction and takes zero.
    """
    gravity(model, q, tau)
    for i in range(len(tau)):
        v = qd[i] if gains.friction_at == 1 else ref.qd[i]
        tau[i] += gains.kp[i] * (ref.q[i] - q[i]) + gains.kd[i] * (ref.qd[i] - qd[i])
        tau[i] += gains.viscous[i] * v + gains.coulomb[i] * sat(v / gains.speed[i])
