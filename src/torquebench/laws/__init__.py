"""Torque laws; importing this package registers every law that ships with it."""

from torquebench.laws import computed_torque, fuzzy_linear_band, fuzzy_pid, pd, sliding_mode
from torquebench.laws.base import Gain, Law, Option, Rules, controller, find_law, law_names

__all__ = [
    "Gain", "Law", "Option", "Rules", "computed_torque", "controller", "find_law", "fuzzy_linear_band", "fuzzy_pid",
    "law_names", "pd", "sliding_mode",
]  # fmt: skip
