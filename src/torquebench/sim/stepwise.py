"""One closed loop taken a control period at a time, with a torque from outside in place of a law's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np

from torquebench.errors import ControllerError
from torquebench.kernel import Array
from torquebench.laws.law import Law, Nothing
from torquebench.sim.closed_loop import COMPLETED
from torquebench.sim.interpreted import PythonRun
from torquebench.sim.job import Job, Setup
from torquebench.sim.plants import Plant
from torquebench.sim.session import Controller, SampledTrial, Session
from torquebench.sim.trajectory import Trajectory, trajectory_of


class _Given:
    """The function of a law that asks for whatever torque was put here."""

    __module__, __name__ = __name__, "given"

    def __init__(self, n: int) -> None:
        self.torque = np.full(n, np.nan)

    def __call__(self, *arguments: Any) -> None:
        """Refuse: there is nothing to compute."""
        raise ControllerError("the torque comes from outside")

    def start(self, setup: Setup) -> _Given:
        """Return itself, which the loop calls in place of the function; see `Call`."""
        return self

    def at(self, job: Job, k: int) -> tuple[int, str]:
        """Write down the torque at control instant k."""
        for i in range(len(self.torque)):
            job.record_tau_law[k][i] = self.torque[i]
        return COMPLETED, ""


class Stepwise:
    """A closed loop at rest at its first control instant, measured there and waiting for a torque.

    Args:
        plant: The truth; reset here.
        trial: What to run; its controller is not asked.

    Raises:
        ValueError: as of `Session.run`.
    """

    def __init__(self, plant: Plant, trial: SampledTrial) -> None:
        self._given = _Given(plant.n)
        law = Law("given", self._given, Nothing, None, {}, {})
        self._begun = Session().begin(plant, replace(trial, controller=Controller("given", law, ())), "python")
        self._run = cast(PythonRun, self._begun.run)
        self.k, self.status = 0, COMPLETED
        """Control instant at which a torque is wanted, and how the loop ended so far."""
        self._sense()

    @property
    def job(self) -> Job:
        """The loop's signals."""
        return self._run.setup.job

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self.status != COMPLETED or self.k == len(self._begun.t)

    def step(self, torque: Array) -> None:
        """Ask for a torque (n,) [N m] over one control period, and measure at the end of it."""
        self._given.torque[:] = torque
        self.status = self._begun.advance(self.k, self.k + 1)
        self.k += 1
        if not self.over:
            self._sense()

    def _sense(self) -> None:
        self._begun.change(self.k)
        self._run.sense(self.k)

    def trajectory(self) -> Trajectory:
        """Return the trajectory of the run, which must be over."""
        return trajectory_of(self._run.setup, self._begun.t, self.status, "", "python", "")
