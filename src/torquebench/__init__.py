"""torquebench: torque laws for robot arms, compared on a plant that an analytic model agrees with to round-off."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0.dev0"

_HOMES = {
    "AnalyticPlant": "torquebench.sim.plants.analytic",
    "Array": "torquebench.kernel",
    "CHAINS": "torquebench.sim.chain",
    "Chain": "torquebench.sim.chain",
    "Controller": "torquebench.sim.session",
    "Fis": "torquebench.fuzzy.fis",
    "FixedRules": "torquebench.laws",
    "Friction": "torquebench.sim.friction",
    "FuzzySystem": "torquebench.fuzzy.system",
    "Gain": "torquebench.laws",
    "MujocoPlant": "torquebench.sim.plants.mujoco",
    "Option": "torquebench.laws",
    "Outcome": "torquebench.sim.trajectory",
    "Payload": "torquebench.robot.payload",
    "Puma560": "torquebench.robot",
    "Reference": "torquebench.references",
    "RobotModel": "torquebench.robot",
    "Rules": "torquebench.laws",
    "Trajectory": "torquebench.sim.trajectory",
    "Trial": "torquebench.sim.simulate",
    "Workers": "torquebench.sim.simulate",
    "bias_forces": "torquebench.robot.dynamics",
    "check_law": "torquebench.check",
    "controller": "torquebench.laws",
    "find_law": "torquebench.laws",
    "gravity": "torquebench.robot.dynamics",
    "infer": "torquebench.fuzzy.inference",
    "inverse_dynamics": "torquebench.robot.dynamics",
    "law_names": "torquebench.laws",
    "load_model": "torquebench.robot",
    "load_trajectory": "torquebench.sim.trajectory",
    "mass_matrix": "torquebench.robot.dynamics",
    "sat": "torquebench.kernel",
    "sign": "torquebench.kernel",
    "simulate": "torquebench.sim.simulate",
    "simulate_many": "torquebench.sim.simulate",
}

__all__ = [
    "CHAINS",
    "AnalyticPlant",
    "Array",
    "Chain",
    "Controller",
    "Fis",
    "FixedRules",
    "Friction",
    "FuzzySystem",
    "Gain",
    "MujocoPlant",
    "Option",
    "Outcome",
    "Payload",
    "Puma560",
    "Reference",
    "RobotModel",
    "Rules",
    "Trajectory",
    "Trial",
    "Workers",
    "__version__",
    "bias_forces",
    "check_law",
    "controller",
    "find_law",
    "gravity",
    "infer",
    "inverse_dynamics",
    "law_names",
    "load_model",
    "load_trajectory",
    "mass_matrix",
    "sat",
    "sign",
    "simulate",
    "simulate_many",
]

if TYPE_CHECKING:
    from torquebench.check import check_law
    from torquebench.fuzzy.fis import Fis
    from torquebench.fuzzy.inference import infer
    from torquebench.fuzzy.system import FuzzySystem
    from torquebench.kernel import Array, sat, sign
    from torquebench.laws import FixedRules, Gain, Option, Rules, controller, find_law, law_names
    from torquebench.references import Reference
    from torquebench.robot import Puma560, RobotModel, load_model
    from torquebench.robot.dynamics import bias_forces, gravity, inverse_dynamics, mass_matrix
    from torquebench.robot.payload import Payload
    from torquebench.sim.chain import CHAINS, Chain
    from torquebench.sim.friction import Friction
    from torquebench.sim.plants.analytic import AnalyticPlant
    from torquebench.sim.plants.mujoco import MujocoPlant
    from torquebench.sim.session import Controller
    from torquebench.sim.simulate import Trial, Workers, simulate, simulate_many
    from torquebench.sim.trajectory import Outcome, Trajectory, load_trajectory


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that ``import torquebench`` needs neither numba nor MuJoCo."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'torquebench' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
