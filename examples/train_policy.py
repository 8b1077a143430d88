"""Train the policy of learned_policy.py: cross-entropy search of a small tanh net in the experiment's own loop.

    .venv/bin/python examples/train_policy.py        # about a minute on one core

One net for all joints, from error, rate and integral of a joint to its acceleration. It begins as a PID that is far too
soft, and is searched over episodes with encoder noise, a lagging drive and torque noise, a new draw for each
generation. The weights are written into a law file: in the arena a law has no file to read, and its source is what
tells one entry from another.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from torquebench import load_model
from torquebench.gym import TorqueEnv

Array = npt.NDArray[np.float64]
HERE = Path(__file__).resolve().parent
CHANGES = {
    "chain": "slow",
    "disturbances": "30 %",
    "run.duration": 1.0,
    "run.metrics_from": 0.5,
    "plant.integrator": "euler",
}
"""What it is trained under, on the motion of the config, with euler, which is quicker here."""
LAM = 20.0
"""Bandwidth at which it is trained [1/s]: the law's only gain."""
HIDDEN, INPUTS = 4, 3
SIZE = HIDDEN * (INPUTS + 1)
BEGIN = np.zeros(SIZE)
BEGIN[:INPUTS] = 0.1, 0.1, 0.05  # the first unit sees all three, the others nothing so far
BEGIN[INPUTS * HIDDEN :] = 10.0, 2.5, 2.5, 2.5
SPREAD = np.concatenate([np.full(INPUTS * HIDDEN, 0.2), np.full(HIDDEN, 5.0)])


def episode(env: TorqueEnv, weights: Array, inertia: Array, seed: int) -> float:
    """Return the mean reward of one episode.

    Args:
        env: The experiment, with torques as actions.
        weights: Of the hidden layer, (HIDDEN, INPUTS), then of the output.
        inertia: Inertia by which each joint's acceleration becomes a torque, (n,) [kg m^2].
        seed: Seed of the episode.
    """
    n, T = len(inertia), env.experiment.run.control_period
    first, last = weights[: SIZE - HIDDEN].reshape(HIDDEN, -1), weights[SIZE - HIDDEN :]
    seen, _ = env.reset(seed=seed)
    integral, total, count, over = np.zeros(n), 0.0, 0, False
    while not over:
        q, qd, q_ref, qd_ref = seen[: 4 * n].reshape(4, n)
        e = q_ref - q
        inputs = np.stack([LAM * e, qd_ref - qd, LAM * LAM * integral])
        torque = LAM * inertia * (last @ np.tanh(first @ inputs))
        seen, reward, failed, ended, _ = env.step(torque)
        integral += T * e * ~((np.abs(torque) > env.tau_max) & (torque * e > 0.0))
        total, count, over = total + reward, count + 1, failed or ended
    return total / count


def train(env: TorqueEnv, generations: int, population: int, seed: int = 0) -> Array:
    """Return weights by the cross-entropy method: a normal distribution that follows the better quarter."""
    inertia, rng = load_model(env.experiment.plant.model).flat.inertia_scale, np.random.default_rng(seed)
    mean, spread = BEGIN.copy(), SPREAD.copy()
    begun = time.monotonic()
    for generation in range(generations):
        tried = mean + spread * rng.standard_normal((population, SIZE))
        tried[0] = mean
        scores = [episode(env, weights, inertia, generation) for weights in tried]
        best = tried[np.argsort(scores)[-(population // 4) :]]
        mean, spread = best.mean(axis=0), 0.9 * best.std(axis=0) + 0.1 * spread * 0.7
        say = f"generation {generation + 1}/{generations}: of the mean {scores[0]:.3g}, the best {max(scores):.3g}"
        print(f"{say}, {time.monotonic() - begun:.0f} s", flush=True)
    return mean


def law_file(weights: Array, config: str) -> str:
    """Return the law's file: the net written out with its weights, in the dialect, so that it is compiled."""
    first, last = weights[: SIZE - HIDDEN].reshape(HIDDEN, -1), weights[SIZE - HIDDEN :]
    units = [f"math.tanh({a:.6g} * a + {b:.6g} * b + {c:.6g} * c)" for a, b, c in first]
    sums = "\n".join(
        f"        y {'+=' if i else '='} {w:.6g} * {unit}" for i, (w, unit) in enumerate(zip(last, units, strict=True))
    )
    return TEMPLATE.format(config=config, sums=sums.replace("+ -", "- "))


TEMPLATE = '''"""A learned policy as a law: written by train_policy.py, trained on {config}."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from torquebench import Array, Gain, controller


class Gains(NamedTuple):
    """Gains of the learned policy."""

    lam: Annotated[Array, Gain("bandwidth at which the net is used; it was trained at 20", "1/s")]


class Memory(NamedTuple):
    """State of the learned policy."""

    integral: Array


@controller("learned-policy", gains=Gains, memory=Memory)
def learned_policy(gains, model, t, q, qd, ref, memory, tau):
    """A net without a model: tau = lam Mbar sum_j w_j tanh(a_j lam e + b_j de + c_j lam^2 int e) on every joint.

    The integral stands still while the torque is beyond its limit in the error's direction.
    """
    for i in range(len(tau)):
        e = ref.q[i] - q[i]
        a, b, c = gains.lam[i] * e, ref.qd[i] - qd[i], gains.lam[i] * gains.lam[i] * memory.integral[i]
{sums}
        tau[i] = gains.lam[i] * model.inertia_scale[i] * y
        if not (abs(tau[i]) > model.tau_max[i] and tau[i] * e > 0.0):
            memory.integral[i] += model.control_period * e
'''


def main() -> None:
    """Train, and write the law file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", default="paper/sine")
    parser.add_argument("--generations", type=int, default=10)
    parser.add_argument("--population", type=int, default=12)
    parser.add_argument("--out", type=Path, default=HERE / "learned_policy.py")
    given = parser.parse_args()
    env = TorqueEnv(given.config, CHANGES, scaled=False)
    weights = train(env, given.generations, given.population)
    given.out.write_text(law_file(weights, given.config), encoding="utf-8")


if __name__ == "__main__":
    main()
