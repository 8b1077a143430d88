"""The closed loops of this package, by the path that ``torquebench run`` takes, and MuJoCo's open loop beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from torquebench.bench.timing import Case
from torquebench.chain import CHAINS
from torquebench.errors import ResultError
from torquebench.experiment import load_experiment
from torquebench.experiment.build import Loop, build, build_disturbance, build_position_noise
from torquebench.experiment.run import trial_of
from torquebench.experiment.schema import Experiment
from torquebench.robot.library import data_root
from torquebench.sim.plants import Plant
from torquebench.sim.session import SampledTrial, Session
from torquebench.sim.simulate import Workers
from torquebench.sim.trajectory import Trajectory

CONFIG = "bench.yaml"
HEADLINE = "closed-loop-fuzzy-euler-mujoco"
RK4 = "plant.integrator=rk4"
EXACT = ("plant={engine: analytic, model: puma560, integrator: rk4}",)
NOISE = (
    "disturbances=[{kind: band-limited-noise, channel: torque, sigma: [5.066, 16.59, 3.299, 0.5444, 0.6161, 0.8083]}]",
)
PER_THREAD = 3
"""Closed loops each thread runs in one call, so that the ends of a call weigh little."""


def experiment_of(*overrides: str, duration: float) -> tuple[Experiment, Loop]:
    """Return the benchmark's experiment with single keys changed, and its objects.

    Args:
        overrides: ``key=value`` changes.
        duration: Length of a run [s].
    """
    changes = [*overrides, f"run.duration={duration:g}"]
    experiment = load_experiment(data_root() / "configs" / CONFIG, changes)
    return experiment, build(experiment)


def closed_loops(duration: float, most_threads: int) -> list[Case]:
    """Return the closed loops and the open loops they are compared with.

    Args:
        duration: Length of a run [s].
        most_threads: Threads of the largest case; there is one with 1 and one with each power of two up to it.
    """
    cases: list[Case] = []
    counts = [2**i for i in range(most_threads.bit_length()) if 2**i <= most_threads]
    for integrator in ("euler", "rk4"):
        experiment, loop = experiment_of(f"plant.integrator={integrator}", duration=duration)
        trial = trial_of(experiment, loop, loop.controllers[0])
        check_rules(Session().run(loop.plant, trial, "native"), loop)
        for threads in counts:
            open_loop, amount = f"mujoco-rollout-{integrator}", threads * PER_THREAD * experiment.n_steps
            cases.append(
                Case(
                    open_loop,
                    rollout(integrator, experiment.n_steps, threads),
                    amount,
                    threads=threads,
                    note="mujoco.rollout, open loop, states recorded",
                )
            )
            cases.append(
                Case(
                    f"closed-loop-fuzzy-{integrator}-mujoco",
                    many(loop.plant, trial, threads),
                    amount,
                    open_loop,
                    threads,
                    "model, linear band, 49 rules on six joints, recorded",
                )
            )
    noisy, loop = experiment_of(*NOISE, duration=duration)
    cases.append(
        Case(
            "closed-loop-fuzzy-noise-euler-mujoco",
            drawn(noisy, loop),
            noisy.n_steps,
            "mujoco-rollout-euler",
            note="the same with 12 channels of noise, drawn anew each run",
        )
    )
    exact, loop = experiment_of(*EXACT, duration=duration)
    cases.append(
        Case(
            "closed-loop-fuzzy-rk4-analytic-exact",
            many(loop.plant, trial_of(exact, loop, loop.controllers[0]), 1),
            PER_THREAD * exact.n_steps,
            "mujoco-rollout-rk4",
            note="the same on the analytic plant, rigid body",
        )
    )
    experiment, loop = experiment_of(duration=1.0)
    trial = trial_of(experiment, loop, loop.controllers[0])
    cases.append(
        Case(
            "closed-loop-fuzzy-euler-mujoco-readable",
            readable(loop.plant, trial),
            experiment.n_steps,
            HEADLINE,
            note="the same source interpreted (path python)",
            most=3,
        )
    )
    return cases


def many(plant: Plant, trial: SampledTrial, threads: int) -> Callable[[], None]:
    """Return the work of running a closed loop several times on each of some threads, which are made before."""
    workers = Workers(plant, threads)

    def run() -> None:
        for trajectory in workers.simulate([trial] * (threads * PER_THREAD), "native"):
            check(trajectory)

    return run


def drawn(experiment: Experiment, loop: Loop) -> Callable[[], None]:
    """Return the work of one run under torque noise and encoder noise, their drawing included."""
    trial = trial_of(experiment, loop, loop.controllers[0])
    noisy, session = replace(experiment, chain=CHAINS["fast"]), Session()

    def run() -> None:
        position, torque = build_position_noise(noisy), build_disturbance(experiment)
        check(session.run(loop.plant, replace(trial, position_noise=position, disturbance=torque), "native"))

    return run


def readable(plant: Plant, trial: SampledTrial) -> Callable[[], None]:
    """Return the work of one run on the readable path."""
    session = Session()

    def run() -> None:
        check(session.run(plant, trial, "python"))

    return run


def rollout(integrator: str, n_steps: int, threads: int) -> Callable[[], None]:
    """Return the work of MuJoCo's own multi-threaded open loop on the same model."""
    import mujoco
    from mujoco import rollout as roll

    from torquebench.sim.plants.mujoco import MujocoPlant

    plant: Any = MujocoPlant("puma560", 0.001, integrator)
    m, data = plant._m, [mujoco.MjData(plant._m) for _ in range(threads)]
    loops = threads * PER_THREAD
    state = np.zeros((loops, mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    control = np.zeros((loops, n_steps, m.nu))
    pool = roll.Rollout(nthread=threads)

    def run() -> None:
        pool.rollout(m, data, state, control)

    return run


def check(trajectory: Trajectory) -> None:
    """Refuse to time a run that failed.

    Raises:
        ResultError: it did.
    """
    if not trajectory.completed:
        raise ResultError(f"the benchmark's run failed: {trajectory.outcome.value}: {trajectory.detail}")


def check_rules(trajectory: Trajectory, loop: Loop) -> None:
    """Refuse a benchmark whose inputs do not fire every rule of the fuzzy system.

    Raises:
        ResultError: a rule never fires.
    """
    from torquebench.analysis.firing import rule_shares

    check(trajectory)
    controller = loop.controllers[0]
    ((name, rules),) = controller.law.rules.items()
    shares = rule_shares(controller.gains, getattr(controller.gains, name), rules.inputs, trajectory).sum(axis=0)
    if np.any(shares == 0.0):
        raise ResultError(f"{np.count_nonzero(shares == 0.0)} of {shares.size} rules never fire in the benchmark")
