"""torquebench: torque laws for robot arms, compared on a plant that an analytic model agrees with to round-off."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0.dev0"

_HOMES = {
    "arenas": ("Arena", "read_arena", "run_arena"),
    "audits": ("Audit", "run_audit"),
    "check": ("check_law",),
    "diffs": ("diff",),
    "errors": ("ConfigError", "ResultError", "TorquebenchError"),
    "experiment.schema": ("Experiment",),
    "fuzzy.fis": ("Fis",),
    "fuzzy.inference": ("infer",),
    "fuzzy.system": ("FuzzySystem",),
    "kernel": ("Array", "sat", "sign"),
    "laws": ("FixedRules", "Gain", "Option", "Rules", "controller", "find_law", "law_names"),
    "laws.new": ("new_law",),
    "laws.plugin": ("load_plugin",),
    "chain": ("CHAINS", "Chain"),
    "disturbances": ("BandLimitedNoise", "Bias", "Sinusoid", "disturbance"),
    "keys": ("Key", "Vector", "as_vector"),
    "metrics": ("JointRecord", "metric"),
    "references": ("Quintic", "Ramp", "Reference", "Sine", "Step", "reference"),
    "falsification": ("Falsification", "falsify"),
    "figures": ("figure",),
    "results": ("Result", "compare", "load_experiment", "load_result", "run_experiment"),
    "robot": ("Puma560", "RobotModel", "load_model"),
    "robot.dynamics": ("bias_forces", "gravity", "inverse_dynamics", "mass_matrix"),
    "robot.payload": ("Payload",),
    "sim.friction": ("Friction",),
    "sim.plants.analytic": ("AnalyticPlant",),
    "sim.plants.kinds": ("plant",),
    "sim.plants.mujoco": ("MujocoPlant",),
    "sim.sandbox": ("load_sandboxed",),
    "sim.session": ("Controller",),
    "sim.simulate": ("Trial", "Workers", "simulate", "simulate_many"),
    "sim.trajectory": ("Outcome", "Trajectory", "load_trajectory"),
    "sweeps": ("Sweep", "load_sweep", "run_sweep"),
    "tunings": ("Tuning", "tune"),
}
"""Module -> its public names; each is imported when it is first used. ``__init__.pyi`` says the same to editors."""
_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_MODULES]


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that ``import torquebench`` needs neither numba nor MuJoCo."""
    if name in _MODULES:
        return getattr(import_module(f"torquebench.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'torquebench' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
