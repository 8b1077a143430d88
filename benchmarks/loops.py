"""The closed loop of `bench.yaml` on the compiled path, and MuJoCo's open loop beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.timing import Case
from torquebench import CHAINS, AnalyticPlant, Controller, MujocoPlant, Puma560, Trajectory, Trial, Workers, simulate
from torquebench.errors import ResultError
from torquebench.references import sine

HEADLINE = "closed-loop-fuzzy-euler-mujoco"
LAW = "fuzzy-linear-band-smc"
GAINS = {"lam": 10, "k": 0.3, "phi": 0.3, "kv": 20, "kf": 0.3, "ki": 2000}
GD = [0.001, 0.002, 0.0001, 0.0001, 0.0001, 0.003]
"""So small that the fuzzy system's inputs cross all of its rules, which `check_rules` makes sure of."""
AMPLITUDE, FREQUENCY = [1.2, -1.0, 1.0, 1.0, 1.0, 1.0], [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
PERIOD = 0.001
"""Control period and time step [s]."""
SIGMA = np.array([5.066, 16.59, 3.299, 0.5444, 0.6161, 0.8083])
"""Standard deviation of the torque noise [N m]."""
PER_THREAD = 3
"""Closed loops each thread runs in one call, so that the ends of a call weigh little."""


@dataclass(frozen=True)
class HeldNoise:
    """Gaussian torque, each value held for ten control periods."""

    sigma: np.ndarray[Any, Any]

    def sample(self, n: int, t: Any, control_period: float, rng: np.random.Generator) -> Any:
        """Draw the torque at each control instant, (N, n) [N m]; arguments as of `torquebench.sim.signals`."""
        blocks = -(-len(t) // 10)
        values = np.clip(rng.standard_normal((blocks, n)), -3.0, 3.0) * self.sigma
        return np.repeat(values, 10, axis=0)[: len(t)]


def trial_of(duration: float) -> Trial:
    """Return the closed loop of `bench.yaml`: frozen-wrist model, linear band, 49 rules on six joints.

    Args:
        duration: Length of the run [s].
    """
    controller = Controller.of(LAW, 6, GAINS | {"gd": GD}, {"equivalent_control": True}, "fuzzy")
    model = Puma560("corrected", "printed")
    return Trial(controller, model, sine(AMPLITUDE, FREQUENCY), duration, PERIOD)


def closed_loops(duration: float, most_threads: int) -> list[Case]:
    """Return the closed loops and the open loops they are compared with.

    Args:
        duration: Length of a run [s].
        most_threads: Threads of the largest case; there is one with 1 and one with each power of two up to it.
    """
    trial, steps = trial_of(duration), round(duration / PERIOD)
    cases: list[Case] = []
    for integrator in ("euler", "rk4"):
        plant = MujocoPlant("puma560", PERIOD, integrator)
        check_rules(run(plant, trial))
        for threads in [2**i for i in range(most_threads.bit_length()) if 2**i <= most_threads]:
            open_loop, amount = f"mujoco-rollout-{integrator}", threads * PER_THREAD * steps
            note = "mujoco.rollout, open loop, states recorded"
            cases.append(Case(open_loop, rollout(integrator, steps, threads), amount, threads=threads, note=note))
            name, note = (
                f"closed-loop-fuzzy-{integrator}-mujoco",
                "model, linear band, 49 rules on six joints, recorded",
            )
            cases.append(Case(name, many(plant, trial, threads), amount, open_loop, threads, note))
    plant = MujocoPlant("puma560", PERIOD, "euler")
    noisy = replace(trial, chain=CHAINS["fast"], disturbances=[HeldNoise(SIGMA)])
    short = trial_of(1.0)
    return [
        *cases,
        Case(
            "closed-loop-fuzzy-noise-euler-mujoco",
            many(plant, noisy, 1, per_thread=1),
            steps,
            "mujoco-rollout-euler",
            note="the same with 12 channels of noise, drawn anew each run",
        ),
        Case(
            "closed-loop-fuzzy-rk4-analytic-exact",
            many(AnalyticPlant(Puma560(), PERIOD, "rk4"), trial, 1),
            PER_THREAD * steps,
            "mujoco-rollout-rk4",
            note="the same on the analytic plant, rigid body",
        ),
        Case(
            "closed-loop-fuzzy-euler-mujoco-readable",
            lambda: check(run(plant, short, path="python")),
            round(short.duration / PERIOD),
            HEADLINE,
            note="the same source interpreted (path python)",
            most=3,
        ),
    ]


def run(plant: Any, trial: Trial, path: Any = "native") -> Trajectory:
    """Run a closed loop once."""
    return simulate(
        plant, trial.controller, trial.model, trial.reference, duration=trial.duration, path=path, throw=False
    )


def many(plant: Any, trial: Trial, threads: int, per_thread: int = PER_THREAD) -> Callable[[], None]:
    """Return the work of running a closed loop several times on each of some threads, which are made before.

    Args:
        plant: The truth.
        trial: What to run; sampled before, unless something in it is drawn.
        threads: Number of threads.
        per_thread: Runs on each.
    """
    workers = Workers(plant, threads)
    sampled: Any = trial if trial.disturbances else trial.sampled(plant.n)

    def work() -> None:
        for trajectory in workers.simulate([sampled] * (threads * per_thread), "native"):
            check(trajectory)

    return work


def rollout(integrator: str, n_steps: int, threads: int) -> Callable[[], None]:
    """Return the work of MuJoCo's own multi-threaded open loop on the same model."""
    import mujoco
    from mujoco import rollout as roll

    model = MujocoPlant("puma560", PERIOD, integrator)._m
    data = [mujoco.MjData(model) for _ in range(threads)]
    loops = threads * PER_THREAD
    state = np.zeros((loops, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    control = np.zeros((loops, n_steps, model.nu))
    pool = roll.Rollout(nthread=threads)
    return lambda: pool.rollout(model, data, state, control) and None


def check(trajectory: Trajectory) -> None:
    """Refuse to time a run that failed.

    Raises:
        ResultError: it did.
    """
    if not trajectory.completed:
        raise ResultError(f"the benchmark's run failed: {trajectory.outcome.value}: {trajectory.detail}")


def check_rules(trajectory: Trajectory) -> None:
    """Refuse a benchmark whose inputs do not fire every rule of the fuzzy system.

    Raises:
        ResultError: a rule never fires.
    """
    from torquebench.report.figures.fuzzy_rules import rule_shares

    check(trajectory)
    controller = trial_of(1.0).controller
    ((name, rules),) = controller.law.rules.items()
    shares = rule_shares(controller.gains, getattr(controller.gains, name), rules.inputs, trajectory).sum(axis=0)
    if np.any(shares == 0.0):
        raise ResultError(f"{np.count_nonzero(shares == 0.0)} of {shares.size} rules never fire in the benchmark")
