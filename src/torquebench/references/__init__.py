"""Desired motions, one kind a file; importing this package registers every kind that ships with it."""

from torquebench.references.quintic import Quintic
from torquebench.references.ramp import Ramp
from torquebench.references.reference import REFERENCES, Reference, ReferenceSource, from_samples, reference
from torquebench.references.sine import Sine
from torquebench.references.step import Step
from torquebench.references.tool_path import ClosedToolPath, ToolCircle, ToolLemniscate, ToolLine, ToolWaypoints

__all__ = [
    "REFERENCES",
    "ClosedToolPath",
    "Quintic",
    "Ramp",
    "Reference",
    "ReferenceSource",
    "Sine",
    "Step",
    "ToolCircle",
    "ToolLemniscate",
    "ToolLine",
    "ToolWaypoints",
    "from_samples",
    "reference",
]
