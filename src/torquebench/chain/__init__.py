"""Sensors and actuators between a law and the plant, each imperfection by itself, and chains that configs name."""

from torquebench.chain.chain import CHAINS, IDEAL, NOTHING, Chain, Drawn, chain, late_steps
from torquebench.chain.drives import CurrentLoop, ThermalLimit, TorqueSpeed
from torquebench.chain.response import Response, response
from torquebench.chain.sensors import Ripple

__all__ = [
    "CHAINS",
    "IDEAL",
    "NOTHING",
    "Chain",
    "CurrentLoop",
    "Drawn",
    "Response",
    "Ripple",
    "ThermalLimit",
    "TorqueSpeed",
    "chain",
    "late_steps",
    "response",
]
