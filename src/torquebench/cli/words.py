"""Names that shells complete; tests hold them against the registries, which are too heavy to import for this."""

from __future__ import annotations

SETTINGS = (
    "name=",
    "description=",
    "plant.engine=",
    "plant.model=",
    "plant.timestep=",
    "plant.integrator=",
    "plant.payload=",
    "plant.friction=",
    "plant.perturb=",
    "model.structure=",
    "model.constants=",
    "model.mismatch=",
    "controllers.",
    "reference.kind=",
    "reference.amplitude=",
    "reference.frequency_hz=",
    "chain=",
    "disturbances=",
    "run.duration=",
    "run.control_period=",
    "run.metrics_from=",
    "run.initial_q=",
    "run.seed=",
    "run.draw=",
    "video=",
)
"""Keys for --set that most experiments have."""
SIDES = (
    "analytic:puma560",
    "analytic:puma560:corrected",
    "analytic:puma560:corrected:fitted",
    "analytic:puma560:corrected:printed",
    "analytic:puma560:exact",
    "analytic:puma560:exact:fitted",
    "analytic:puma560:printed",
    "analytic:puma560:printed:fitted",
    "analytic:puma560:printed:printed",
    "analytic:two-link",
    "mujoco:puma560",
    "mujoco:two-link",
)
"""Models and plants for compare."""
SYSTEMS = ("pd-25", "pd-49", "pd-9", "s-7")
"""Built-in fuzzy systems."""
QUALITIES = ("fast", "pretty")
CAMERAS = ("overview", "side")
"""Cameras of the PUMA, and of arms without any."""
