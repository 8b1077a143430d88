"""Laws written for one test, and the two-joint arm on both plants, for the tests of the loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.sampled import simulate_sampled
from torquebench.kernel import Array
from torquebench.laws.law import Law
from torquebench.references import Reference, Sine
from torquebench.robot import RobotModel, load_model
from torquebench.sim.plants import Plant
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.simulate import simulate
from torquebench.sim.trajectory import Trajectory

TARGET = Sine(np.array([1.0, -0.8]), np.array([0.5, 0.7]))
PLANTS = ("analytic", "mujoco")


def arm() -> RobotModel:
    """Return the two-joint arm that ships with the package, limits 80 and 25 N m."""
    return load_model("two-link")


def plant_of(name: str, timestep: float = 0.001) -> Plant:
    """Return that arm as a plant."""
    return MujocoPlant("two-link", timestep) if name == "mujoco" else AnalyticPlant(arm(), timestep)


class SpyPlant:
    """A plant without dynamics: joint i is at `stride` k + i after k steps, and every call is noted."""

    def __init__(self, timestep: float = 0.001, stride: float = 100.0) -> None:
        self.n, self.timestep, self.tau_max, self.stride = 2, timestep, np.array([80.0, 25.0]), stride
        self.calls: list[tuple[Any, ...]] = []

    def reset(self, q: Array, qd: Array) -> None:
        """Note the start."""
        self.calls = [("reset", q.tolist(), qd.tolist())]

    def state(self) -> tuple[Array, Array]:
        """Return a state that tells the step from the joint."""
        q = self.stride * (len(self.calls) - 1) + np.arange(self.n)
        return q, -q

    def step(self, tau: Array, substeps: int) -> None:
        """Note the torque."""
        self.calls.append(("step", tau.tolist(), substeps))


def law_of(function: Callable[..., Any], memory: type[Any] | None = None) -> Controller:
    """Return a controller of a law that is in no registry and has no gains."""
    return Controller("mine", Law("mine", function, tuple, memory, {}, {}), ())


def idle(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
    """Ask for no torque."""
    tau[:] = 0.0


def spring(gains: Any, model: Any, t: float, q: Array, qd: Array, ref: Reference, memory: Any, tau: Array) -> None:
    """PD in numpy, strong enough to clip at first."""
    tau[:] = [300.0, 60.0] * (ref.q - q) + [40.0, 8.0] * (ref.qd - qd)


def go(plant: Plant, law: Callable[..., Any] | Controller, duration: float = 0.05, **options: Any) -> Trajectory:
    """Run a law on a plant, towards TARGET unless told otherwise; failures are returned, not raised."""
    controller = law if isinstance(law, Controller) else law_of(law)
    options = {"throw": False, "reference": TARGET, "model": arm(), **options}
    model, reference = options.pop("model"), options.pop("reference")
    made_here = options.keys() & {"chain", "drawn", "disturbance"}
    run = simulate_sampled if made_here else simulate
    return run(plant, controller, model, reference, duration=duration, **options)
