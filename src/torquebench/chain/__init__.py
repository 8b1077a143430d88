"""Sensors and actuators between a law and the plant, each imperfection by itself, and chains that configs name."""

from torquebench.chain.chain import (
    ABOUT,
    CHAINS,
    IDEAL,
    NOTHING,
    About,
    Chain,
    Drawn,
    Origin,
    chain,
    late_steps,
    period_of,
    rate_remarks,
)
from torquebench.chain.drives import CrossTalk, CurrentLoop, Derating, ThermalLimit, TorqueSpeed
from torquebench.chain.response import Response, mixing, response
from torquebench.chain.robots import ROBOT_CHAINS
from torquebench.chain.sensors import Ripple

__all__ = [
    "ABOUT",
    "CHAINS",
    "IDEAL",
    "NOTHING",
    "ROBOT_CHAINS",
    "About",
    "Chain",
    "CrossTalk",
    "CurrentLoop",
    "Derating",
    "Drawn",
    "Origin",
    "Response",
    "Ripple",
    "ThermalLimit",
    "TorqueSpeed",
    "chain",
    "late_steps",
    "mixing",
    "period_of",
    "rate_remarks",
    "response",
]
