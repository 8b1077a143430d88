"""Figures of merit of one completed run, one family a file; each metric declares itself with `@metric`."""

from __future__ import annotations

from torquebench.metrics.declare import METRICS, MetricInfo, applicable, metric
from torquebench.metrics.record import JointRecord, shared

# isort: off
# the order of tables
from torquebench.metrics import errors, tool, step_response, chattering, torque, band

# isort: on
from torquebench.metrics.values import (
    Metric,
    Metrics,
    PerJoint,
    from_joints,
    headlines,
    headlines_of,
    measured,
    per_joint,
    record_of,
)

__all__ = [
    "METRICS",
    "JointRecord",
    "Metric",
    "MetricInfo",
    "Metrics",
    "PerJoint",
    "applicable",
    "band",
    "chattering",
    "errors",
    "from_joints",
    "headlines",
    "headlines_of",
    "measured",
    "metric",
    "per_joint",
    "record_of",
    "shared",
    "step_response",
    "tool",
    "torque",
]
