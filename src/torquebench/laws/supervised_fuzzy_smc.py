"""PI fuzzy sliding mode whose gain a second fuzzy system, a supervisor of nine rules, tunes."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.fuzzy.fis import Fis
from torquebench.fuzzy.inference import infer
from torquebench.kernel import Array, kernel, sat
from torquebench.laws.declare import FixedRules, Gain, Rules
from torquebench.laws.fuzzy_pid import integrate
from torquebench.laws.law import controller
from torquebench.laws.parts import Band, Slope, Switching, UseModel, equivalent_control
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import as_much, fuzzy_width, slow_integral


@kernel
def how_far(gains: SupervisedGains, joint: int, e: float, de: float) -> tuple[float, float]:
    """Return the supervisor's inputs 2 |e|/ge - 1 and 2 |de|/gd - 1, clipped to [-1, 1].

    Args:
        gains: The law's gains.
        joint: Which joint.
        e, de: Its error [rad] and the error's rate [rad/s].
    """
    return sat(2.0 * abs(e) / gains.ge[joint] - 1.0), sat(2.0 * abs(de) / gains.gd[joint] - 1.0)


class SupervisedGains(NamedTuple):
    """Gains and option of the law."""

    lam: Slope
    k: Switching
    phi: Band
    gis: Annotated[
        Array,
        Gain("integral of s that the fuzzy system sees as 1; it sees s = phi as 1", "rad", auto=slow_integral("phi")),
    ]
    boost: Annotated[
        Array,
        Gain(
            "how much of K the supervisor adds to K at most; zero for no supervisor",
            "1",
            False,
            auto=as_much,
            search=(0.1, 10.0, "log"),
        ),
    ]
    ge: Annotated[Array, Gain("error at which the supervisor's first input is largest", "rad")]
    gd: Annotated[
        Array, Gain("rate of the error at which the supervisor's second input is largest", "rad/s", auto=fuzzy_width)
    ]
    equivalent_control: UseModel
    fis: Annotated[
        Fis, Rules("fuzzy system FIS(s/phi, int s/gis) whose output is multiplied by the tuned K", default="pd-25")
    ]
    supervisor: Annotated[Fis, FixedRules("how much of the boost is added, from the size of e and de", "pd-9")]


class SupervisedMemory(NamedTuple):
    """The sliding variable and its integral [rad]; the velocity seen last."""

    s: Array
    s_integral: Array
    velocity: Array


@controller("pi-fuzzy-smc-supervised", gains=SupervisedGains, memory=SupervisedMemory)
def pi_fuzzy_smc_supervised(
    gains: SupervisedGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: SupervisedMemory,
    tau: Array,
) -> None:
    """Supervised PI fuzzy sliding mode: tau = [tau_eq +] K (1 + boost (1 + w)/2) FIS(s/phi, int s/gis).

    With s = de + lambda e, 25 rules unless the config names others, and w = SUP(2 |e|/ge - 1, 2 |de|/gd - 1) of a
    supervisor with nine: small, medium and large error by small, medium and large rate raise the gain the more the
    farther the joint is from its motion. The integral stops growing at its scale gis. It is what the paper says in a
    sentence of its [23], with these numbers of rules; it is not that law. Barrero et al., Speed control of induction
    motors using a novel fuzzy sliding-mode structure, IEEE Transactions on Fuzzy Systems 10, 2002, blend two
    controllers by a Takagi-Sugeno supervisor: sliding mode in the transient, PI fuzzy in the steady state.
    """
    equivalent_control(gains.equivalent_control, gains.lam, 0.0, model, q, qd, ref, memory.velocity, tau)
    for i in range(len(tau)):
        e, de = ref.q[i] - q[i], ref.qd[i] - qd[i]
        s = de + gains.lam[i] * e
        far, fast = how_far(gains, i, e, de)
        gain = gains.k[i] * (1.0 + 0.5 * gains.boost[i] * (1.0 + infer(gains.supervisor, far, fast)))
        memory.s[i] = s
        pushed = infer(gains.fis, s / gains.phi[i], memory.s_integral[i] / gains.gis[i])
        tau[i] += gain * model.tau_max[i] * pushed
        integrate(memory.s_integral, i, s, gains.gis[i], model.control_period)
