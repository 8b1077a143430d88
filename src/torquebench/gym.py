"""Any experiment as a Gymnasium environment: the torque of a learned policy in the loop that every law runs in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from torquebench.errors import ResultError
from torquebench.experiment.build import Builder
from torquebench.experiment.run import trial_of
from torquebench.experiment.schema import MAX_SEED, Experiment
from torquebench.kernel import Array
from torquebench.results import Source, load_experiment
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.stepwise import Stepwise
from torquebench.sim.trajectory import OUTCOMES, Trajectory

ID = "torquebench/Experiment-v0"
"""Name under which `gymnasium.make` and `make_vec` know it."""
ERROR, FAILED = 0.01, 100.0
"""Error that costs 1 [rad], and what every control instant costs that a failed run is short of."""
Reward: TypeAlias = Callable[[Array, Array], float]


def tracking(e: Array, change: Array) -> float:
    """Return -mean((e/10 mrad)^2) - mean(change^2), in which the second term is what chattering costs.

    Args:
        e: Error q_ref - q at a control instant, (n,) [rad].
        change: Change of the command there since the instant before, over the torque limit, (n,) [1].
    """
    return -float(np.mean((e / ERROR) ** 2) + np.mean(change**2))


class TorqueEnv(gymnasium.Env[npt.NDArray[np.float64], npt.NDArray[Any]]):
    """An experiment whose law is the agent: the same plant, chain, noise, faults and limits as in `torquebench run`.

    The observation is what a law sees at a control instant, (5 n + 1,): q and qd as measured, q_ref, qd_ref, qdd_ref
    [rad, rad/s, rad/s^2] and t [s]. The action is a torque for each joint over the control period: a share of the
    torque limit from -1 to 1, or N m with ``scaled=False``; whatever is asked beyond the limit is clipped, as of a
    law. An episode is terminated where a run fails (``info["outcome"]`` says how) and truncated at the end of
    run.duration, N control instants after its start; the observation of either is the last one that there was. The
    reward is that of the instant at which the action is asked for, `tracking` if none is given, so that its sum is -N
    times the mean square; a failed episode loses `FAILED` for every instant that it is short of.

    ``reset(seed=s)`` takes seed s in place of run.seed, and draw 0; every further reset the next draw, with its own
    noise, mismatch and perturbation.

    Args:
        experiment: An experiment, or what `load_experiment` takes; its controllers are not asked.
        changes: Dotted key -> value, set before the check.
        scaled: Whether actions are shares of the torque limit, in float32, or torques [N m], in float64.
        reward: Another reward of error and change of command; arguments as of `tracking`.

    Raises:
        ConfigError: the experiment has mistakes.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  Gymnasium's own name and type

    def __init__(
        self,
        experiment: Experiment | Source,
        changes: Mapping[str, Any] | None = None,
        *,
        scaled: bool = True,
        reward: Reward = tracking,
    ) -> None:
        if isinstance(experiment, Experiment):
            self.experiment = experiment.with_(changes or {})
        else:
            self.experiment = load_experiment(experiment, changes)
        self._builder, self._reward = Builder(), reward
        self._loop: Stepwise | None = None
        self._next = self.experiment.run.seed, self.experiment.run.draw
        n, self.tau_max = self.experiment.n, self._builder(self.experiment).plant.tau_max.copy()
        self.observation_space = spaces.Box(-np.inf, np.inf, (5 * n + 1,), np.float64)
        self._unit = self.tau_max if scaled else np.ones(n)
        most = self.tau_max / self._unit
        kind = np.float32 if scaled else np.float64
        self.action_space = spaces.Box(-most.astype(kind), most.astype(kind), (n,), kind)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float64], dict[str, Any]]:
        """Start an episode, and return its first observation; `info` has seed and draw, which replay it in a config.

        Args:
            seed: Source of the episode's random numbers, and of those that follow without one.
            options: None are known.
        """
        super().reset(seed=seed)
        source, draw = self._next if seed is None else (seed % (MAX_SEED + 1), 0)
        self._next = source, draw + 1
        run = replace(self.experiment.run, seed=source, draw=draw)
        experiment = replace(self.experiment, run=run)
        loop = self._builder(experiment)
        self._loop = Stepwise(loop.plant, trial_of(experiment, loop, loop.controllers[0]))
        self._seen = observation(self._loop)
        return self._seen, {"seed": source, "draw": draw}

    def step(self, action: npt.NDArray[Any]) -> tuple[npt.NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Ask for a torque over one control period; see the class.

        Raises:
            ResultError: no episode has begun, or the last one is over.
        """
        loop = self._loop
        if loop is None or loop.over:
            raise ResultError("no episode is running: wanted a reset first")
        k, job = loop.k, loop.job
        e = job.q_ref[k] - job.q  # before the step moves q on
        loop.step(np.asarray(action, dtype=np.float64) * self._unit)
        before = job.record_tau[max(k - 1, 0)]
        failed = loop.status != COMPLETED
        reward = self._reward(e, (job.record_tau[k] - before) / self.tau_max) if not failed else 0.0
        if failed:
            reward = -FAILED * (len(job.q_ref) - k)
        info: dict[str, Any] = {"e": e}
        if loop.over:
            info["outcome"] = OUTCOMES[loop.status].name
        else:
            self._seen = observation(loop)
        return self._seen, reward, failed, loop.over and not failed, info

    def trajectory(self) -> Trajectory:
        """Return the trajectory of the episode that is over, as of a run of `torquebench run`.

        Raises:
            ResultError: it is not over.
        """
        if self._loop is None or not self._loop.over:
            raise ResultError("the episode is not over: wanted steps until it is terminated or truncated")
        return self._loop.trajectory()


def observation(loop: Stepwise) -> npt.NDArray[np.float64]:
    """Return what a law sees at the control instant at which a loop waits, (5 n + 1,); see `TorqueEnv`."""
    job, k = loop.job, loop.k
    seen = job.measured_q, job.measured_qd, job.q_ref[k], job.qd_ref[k], job.qdd_ref[k]
    return np.concatenate([*seen, [k * job.control_period]])


gymnasium.register(ID, entry_point=TorqueEnv, disable_env_checker=True)
