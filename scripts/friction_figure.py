#!/usr/bin/env python3
"""Draw ``docs/images/friction.png``: friction over velocity, break-away, presliding and stick-slip of the plant.

Usage: ``friction_figure.py [FILE]``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from torquebench import load_model
from torquebench.robot.library import ArmFile
from torquebench.sim.friction import Friction, steady
from torquebench.sim.plants.analytic import AnalyticPlant

MASS = ArmFile(
    "mass",
    '<mujoco><option gravity="0 0 0"/><worldbody><body><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    '<joint name="a" type="slide" axis="1 0 0"/></body></worldbody>'
    '<actuator><motor joint="a" ctrlrange="-9 9"/></actuator></mujoco>',
)
"""1 kg that slides."""
LINE = Friction(0.4, 1.0, breakaway=1.5, stribeck_speed=0.02)
BRISTLES = Friction(0.4, 1.0, breakaway=1.5, stribeck_speed=0.02, bristle_stiffness=1e4, bristle_damping=50.0)
H = 0.001
"""Time step [s]."""
COLOURS = {"line": "#1f6fb2", "bristles": "#c4501b"}


def moved(friction: Friction, seconds: float, push: Any) -> tuple[Any, Any, Any]:
    """Return time [s], position [m] and force [N] of the mass under ``push(t, position)`` [N]."""
    plant = AnalyticPlant(load_model(MASS), H, friction=friction)
    plant.reset(np.zeros(1), np.zeros(1))
    t = H * np.arange(round(seconds / H))
    rows = []
    for now in t:
        position = float(plant.state()[0][0])
        rows.append((position, push(now, position)))
        plant.step(np.array([rows[-1][1]]), 1)
    position, force = np.array(rows).T
    return t, position, force


def draw(file: Path) -> None:
    """Draw the four panels."""
    figure, ((curves, away), (loops, slip)) = plt.subplots(2, 2, figsize=(10.0, 7.0), layout="constrained")
    v = np.linspace(-0.15, 0.15, 1201)[:, None]
    for label, friction, load in (
        ("coulomb, viscous", Friction(0.4, 1.0), 0.0),
        ("and breakaway", LINE, 0.0),
        ("and load 0.1, under 5 N", Friction(0.4, 1.0, breakaway=1.5, stribeck_speed=0.02, load=0.1), 5.0),
    ):
        curves.plot(v, steady(friction.of_joints(1), v, np.full_like(v, load)), label=label)
    curves.set(title="Friction over velocity", xlabel="velocity [m/s]", ylabel="friction [N]")
    curves.legend(loc="lower right")
    for name, friction in (("line", LINE), ("bristles", BRISTLES)):
        t, position, force = moved(friction, 3.4, lambda now, _: 0.5 * now)
        away.plot(force, 1e3 * position, label=name, color=COLOURS[name])
        t, position, force = moved(friction, 12.0, lambda now, at: 8.0 * (0.05 * now - at))
        slip.plot(t, 1e3 * position, label=name, color=COLOURS[name])
    away.axvline(1.5, color="0.6", lw=1.0, ls=":")
    away.set(title="Under a force that rises by 0.5 N/s", xlabel="force [N]", ylabel="position [mm]", ylim=(-0.3, 8.0))
    away.legend()
    slip.set(title="Drawn at 50 mm/s through 8 N/m", xlabel="time [s]", ylabel="position [mm]")
    slip.plot(t, 50.0 * t, label="end of the spring", color="0.6", lw=1.0, ls=":")
    slip.legend()
    for most, colour in ((0.9, "#c4501b"), (0.6, "#e08a5b"), (0.3, "#8a3512")):
        t, position, force = moved(BRISTLES, 3.0, lambda now, _, most=most: most * np.sin(2.0 * np.pi * now))
        last = t >= 2.0
        loops.plot(1e3 * (position[last] - position[last].mean()), force[last], color=colour, label=f"{most:g} N")
    loops.set(title="Presliding: forces below Coulomb's 1 N", xlabel="position [mm]", ylabel="force [N]")
    loops.legend()
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "images" / "friction.png")
