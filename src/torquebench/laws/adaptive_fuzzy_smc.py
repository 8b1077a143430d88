"""Adaptive fuzzy PI sliding mode: PI control of s, and a fuzzy system of s whose consequents adapt."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from torquebench.kernel import Array, clip, kernel, sat
from torquebench.laws.declare import Gain
from torquebench.laws.law import controller
from torquebench.laws.parts import Rate, Slope
from torquebench.references import Reference
from torquebench.robot.flat_model import Model
from torquebench.tuning import slow_pull


class AdaptiveGains(NamedTuple):
    """Gains of the law."""

    lam: Slope
    kv: Rate
    kis: Annotated[
        Array,
        Gain("gain of the integral of s, times Mbar; zero leaves the integral out", "1/s^2", False, auto=slow_pull),
    ]
    phi: Annotated[Array, Gain("s beyond which the outermost rule fires alone", "rad/s")]
    gamma: Annotated[Array, Gain("rate gamma at which the rules learn, gamma Mbar", "1/s^2", auto=slow_pull)]


class AdaptiveMemory(NamedTuple):
    """The sliding variable, its integral [rad], and the torque of each of seven rules [N m]."""

    s: Array
    s_integral: Array
    theta_1: Array
    theta_2: Array
    theta_3: Array
    theta_4: Array
    theta_5: Array
    theta_6: Array
    theta_7: Array


@kernel
def fires(rule: int, x: float) -> float:
    """Return how much a rule of seven fires: triangles centred at -1, -2/3 .. 1 that add up to 1.

    Args:
        rule: Which, from -3 to 3.
        x: Input, within [-1, 1].
    """
    degree = 1.0 - abs(3.0 * x - rule)
    return degree if degree > 0.0 else 0.0


@kernel
def learn(theta: Array, joint: int, step: float, bound: float) -> None:
    """Add a step to what a rule has learnt, within its bound.

    Args:
        theta: The rule's torque, (n,) [N m]; written.
        joint: Which joint.
        step: What is added [N m].
        bound: Largest size of the sum [N m].
    """
    theta[joint] = clip(theta[joint] + step, bound)


@controller("adaptive-fuzzy-pi-smc", gains=AdaptiveGains, memory=AdaptiveMemory)
def adaptive_fuzzy_pi_smc(
    gains: AdaptiveGains,
    model: Model,
    t: float,
    q: Array,
    qd: Array,
    ref: Reference,
    memory: AdaptiveMemory,
    tau: Array,
) -> None:
    """Adaptive fuzzy PI sliding mode: tau = Mbar (kV s + kis int s) + theta' zeta(s/phi), dtheta = gamma Mbar zeta s.

    With s = de + lambda e; zeta are seven triangles that add up to 1, theta one torque for each. Each theta stays
    within tau_max, and theta and the integral stand still while the torque is beyond its limit in the direction of s.
    No model is used. Near s = 0 one rule fires, and theta' zeta is one more integral of s: with gamma 0 and a larger
    kis the law does as well there. After Shahnazi et al., the paper's [24]: Position control of induction and DC
    servomotors: a novel adaptive fuzzy PI sliding mode control, IEEE Transactions on Energy Conversion 23, 2008. Left
    out of it: there the fuzzy system is one of the state, and the gains of the PI part adapt too.
    """
    for i in range(len(tau)):
        s = ref.qd[i] - qd[i] + gains.lam[i] * (ref.q[i] - q[i])
        x = sat(s / gains.phi[i])
        learnt = memory.theta_1[i] * fires(-3, x) + memory.theta_2[i] * fires(-2, x) + memory.theta_3[i] * fires(-1, x)
        learnt += memory.theta_4[i] * fires(0, x)
        learnt += memory.theta_5[i] * fires(1, x) + memory.theta_6[i] * fires(2, x) + memory.theta_7[i] * fires(3, x)
        memory.s[i] = s
        tau[i] = model.inertia_scale[i] * (gains.kv[i] * s + gains.kis[i] * memory.s_integral[i]) + learnt
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * s > 0.0):
            memory.s_integral[i] += model.control_period * s
            step = model.control_period * gains.gamma[i] * model.inertia_scale[i] * s
            learn(memory.theta_1, i, step * fires(-3, x), model.tau_max[i])
            learn(memory.theta_2, i, step * fires(-2, x), model.tau_max[i])
            learn(memory.theta_3, i, step * fires(-1, x), model.tau_max[i])
            learn(memory.theta_4, i, step * fires(0, x), model.tau_max[i])
            learn(memory.theta_5, i, step * fires(1, x), model.tau_max[i])
            learn(memory.theta_6, i, step * fires(2, x), model.tau_max[i])
            learn(memory.theta_7, i, step * fires(3, x), model.tau_max[i])
