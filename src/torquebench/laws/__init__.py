"""Torque laws; importing this package registers every law that ships with it."""

from torquebench.laws import (
    adaptive_fuzzy_smc,
    computed_torque,
    fuzzy_boundary_layer,
    fuzzy_linear_band,
    fuzzy_pid,
    gravity_friction,
    joint_impedance,
    pd,
    pi_smc_fuzzy_estimator,
    position_servo,
    sliding_mode,
    sliding_mode_fuzzy,
    super_twisting,
    supervised_fuzzy_smc,
    two_input_sliding_mode_fuzzy,
)
from torquebench.laws.declare import FixedRules, Gain, Option, Rules
from torquebench.laws.law import Law, controller, find_law, law_names

__all__ = [
    "FixedRules",
    "Gain",
    "Law",
    "Option",
    "Rules",
    "adaptive_fuzzy_smc",
    "computed_torque",
    "controller",
    "find_law",
    "fuzzy_boundary_layer",
    "fuzzy_linear_band",
    "fuzzy_pid",
    "gravity_friction",
    "joint_impedance",
    "law_names",
    "pd",
    "pi_smc_fuzzy_estimator",
    "position_servo",
    "sliding_mode",
    "sliding_mode_fuzzy",
    "super_twisting",
    "supervised_fuzzy_smc",
    "two_input_sliding_mode_fuzzy",
]
