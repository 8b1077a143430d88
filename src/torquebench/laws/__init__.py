"""Torque laws; importing this package registers every law that ships with it."""

from torquebench.laws import computed_torque, pd, sliding_mode
from torquebench.laws.base import Gain, Law, Option, controller, find_law, law_names

__all__ = [
    "Gain", "Law", "Option", "computed_torque", "controller", "find_law", "law_names", "pd", "sliding_mode",
]  # fmt: skip
