"""Small arms whose dynamics fit in a line each, for tests: the formulas here share nothing with the package.

Both arms move in the vertical plane: every joint axis is the base's z, and gravity pulls along -y.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from torquebench.kernel import Array
from torquebench.laws import find_law
from torquebench.references import Reference
from torquebench.robot import RobotModel
from torquebench.robot.flat_model import HINGE, SLIDE, rigid_model
from torquebench.sim.session import Controller

G = 9.81
MASS, LENGTH, INERTIA, ROTOR = 2.0, 0.5, 0.03, 0.07
"""Pendulum: mass [kg], distance of its centre from the joint [m], inertia about it and of the rotor [kg m^2]."""
PENDULUM_INERTIA = INERTIA + MASS * LENGTH * LENGTH + ROTOR
"""0.6 kg m^2."""
MGL = MASS * G * LENGTH
"""9.81 N m."""
M1, M2, L1, C1, C2, J1, J2, R1, R2 = 2.0, 1.0, 1.0, 0.5, 0.4, 0.167, 0.0535, 0.1, 0.05
"""Two-joint arm: masses, length of the first link, centres of mass, inertias, rotor inertias."""


def chain(
    offsets: Array,
    masses: Array,
    centres: Array,
    inertias: Array,
    rotors: Array,
    tau_max: Array,
    scale: Array,
    *,
    kind: int = HINGE,
    gravity: float = G,
) -> RobotModel:
    """Return a planar chain; everything along each link's x axis, inertias about z."""
    n = len(masses)
    along_x = np.array([1.0, 0.0, 0.0])
    flat = rigid_model(
        kind=[kind] * n,
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        offset=np.outer(offsets, along_x),
        mass=masses,
        com=np.outer(centres, along_x),
        inertia=np.array([np.diag([0.0, j, j]) for j in inertias]),
        armature=rotors,
        gravity=np.array([0.0, -gravity, 0.0]),
        tool_rotation=np.eye(3),
        tool_offset=np.zeros(3),
        tau_max=tau_max,
        inertia_scale=scale,
    )
    return RobotModel("planar", tuple(f"joint{i + 1}" for i in range(n)), flat)


def pendulum(gravity: float = G, tau_max: float = 40.0) -> RobotModel:
    """Return the pendulum; q = 0 is horizontal, positive q lifts it."""
    return chain(
        np.array([0.0]),
        np.array([MASS]),
        np.array([LENGTH]),
        np.array([INERTIA]),
        np.array([ROTOR]),
        np.array([tau_max]),
        np.array([0.5]),
        gravity=gravity,
    )


def slider(mass: float = 2.0) -> RobotModel:
    """Return a mass on a slide across gravity: tau = mass qdd, nothing else."""
    return chain(
        np.array([0.0]),
        np.array([mass]),
        np.array([0.0]),
        np.array([0.01]),
        np.array([0.0]),
        np.array([1000.0]),
        np.array([mass]),
        kind=SLIDE,
    )


def two_link() -> RobotModel:
    """Return the two-joint arm."""
    return chain(
        np.array([0.0, L1]),
        np.array([M1, M2]),
        np.array([C1, C2]),
        np.array([J1, J2]),
        np.array([R1, R2]),
        np.array([80.0, 25.0]),
        np.array([2.5, 0.4]),
    )


def pendulum_terms(q: Array, qd: Array) -> tuple[Array, Array, Array]:
    """Mass matrix, velocity torque and gravity torque of the pendulum: I, 0 and m g l cos q."""
    return np.array([[PENDULUM_INERTIA]]), np.zeros(1), MGL * np.cos(q)


def two_link_terms(q: Array, qd: Array) -> tuple[Array, Array, Array]:
    """Mass matrix, velocity torque and gravity torque of the two-joint arm, as in any textbook (Craig, 6.7)."""
    c2, s2 = math.cos(q[1]), math.sin(q[1])
    m22 = J2 + M2 * C2 * C2
    m12 = m22 + M2 * L1 * C2 * c2
    m11 = J1 + M1 * C1 * C1 + M2 * L1 * L1 + m22 + 2.0 * M2 * L1 * C2 * c2
    h = M2 * L1 * C2 * s2
    velocity = np.array([-h * (2.0 * qd[0] * qd[1] + qd[1] * qd[1]), h * qd[0] * qd[0]])
    lower = M2 * G * C2 * math.cos(q[0] + q[1])
    gravity = np.array([(M1 * C1 + M2 * L1) * G * math.cos(q[0]) + lower, lower])
    return np.array([[m11 + R1, m12], [m12, m22 + R2]]), velocity, gravity


def pack(law: str, n: int, options: Mapping[str, Any] | None = None, **gains: Any) -> Controller:
    """Return a controller of a registered law, under the law's name."""
    found = find_law(law)
    return Controller(law, found, found.pack_gains(n, gains, options or {}))


def still(target: Array) -> Any:
    """Return a reference that asks for `target` (n,) from the first instant on."""

    def sample(t: Array) -> Reference:
        zero = np.zeros((len(t), len(target)))
        return Reference(np.tile(target, (len(t), 1)), zero, zero.copy())

    return sample


THREE = """
<mujoco model="three"><worldbody>
  <body><inertial mass="3" pos="0 0 0.1" diaginertia="0.05 0.05 0.05"/><joint name="j1" axis="0 1 0"/>
    <body pos="0 0 0.3"><inertial mass="1" pos="0.02 0 0.1" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="j2" axis="0 0 1"/>
      <body pos="0 0 0.3"><inertial mass="0.2" pos="0.03 0 0.1" diaginertia="1e-4 1e-4 1e-4"/>
        <joint name="j3" axis="1 0 0"/></body></body></body>
  </worldbody>
  <actuator><motor joint="j1" ctrlrange="-150 150"/><motor joint="j2" ctrlrange="-28 28"/>
    <motor joint="j3" ctrlrange="-28 28"/></actuator></mujoco>"""
"""An arm whose joints are light for their torque limits: gains that suit the PUMA make it ring."""
