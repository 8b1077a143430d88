"""The arm without any of this project's dynamics: Pinocchio on `links.yaml`, Christoffel symbols, Table 2's chain.

The mass matrix M is a trigonometric polynomial of degree at most 2 in each joint angle: a joint enters through one
rotation matrix, and M contains it at most twice. Two exact tools follow. From 5 equispaced samples of one angle the
derivative of M is found without any truncation error, only round-off (`derivative`); and samples of M, or of its
derivatives, on a grid of 9 x 9 over theta2 and theta3 determine them on the whole torus (`on_torus`), so that an
equality that holds on the grid holds everywhere, and a maximum can be read off a fine grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from torquebench.kernel import Array

MODELS = Path(__file__).resolve().parents[2] / "models" / "puma560"
PAIRS = [(j, k) for j in range(6) for k in range(j + 1, 6)]
"""Columns of b in the paper's order (35): joints 12, 13, .., 16, 23, .., 56, counted from 0."""
NODES = 9
"""Samples of theta2 and of theta3: exact up to degree 4, one more than any formula printed or corrected has."""


def read(name: str) -> Any:
    """Read a YAML file of the model's folder."""
    return yaml.safe_load((MODELS / name).read_text(encoding="utf-8"))


class Arm:
    """The arm of `links.yaml` in Pinocchio: inverse dynamics, mass matrix and tool frame at q (6,) [rad].

    Args:
        a3: Length a3 to use instead of the file's [m]; the links stay as they are.
    """

    def __init__(self, a3: float | None = None) -> None:
        data = read("links.yaml")
        model = pin.Model()
        parent = 0
        for index, joint in enumerate(data["joints"]):
            row = dict(joint["dh"])
            if a3 is not None and index == 3:
                row["a"] = a3
            parent = model.addJoint(parent, pin.JointModelRZ(), _craig(row), joint["name"])
            xx, yy, zz, xy, xz, yz = joint["inertia"]
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            body = pin.Inertia(float(joint["mass"]), np.array(joint["com"], dtype=float), tensor)
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        self.tool = model.addFrame(pin.Frame("tool", parent, 0, _craig(data["tool"]), pin.FrameType.OP_FRAME))
        model.gravity.linear = np.array(data["gravity"], dtype=float)
        model.armature = np.array([float(joint["armature"]) for joint in data["joints"]])
        self.model = model
        self.data = model.createData()

    def mass_matrix(self, q: Array) -> Array:
        """M(q) with armature, (6, 6) [kg m^2]."""
        upper = np.triu(pin.crba(self.model, self.data, q))
        return upper + np.triu(upper, 1).T

    def gravity(self, q: Array) -> Array:
        """Torque that holds the arm still, (6,) [N m]."""
        return np.array(pin.computeGeneralizedGravity(self.model, self.data, q))

    def bias(self, q: Array, qd: Array) -> Array:
        """Torque for zero acceleration at speed qd [rad/s], (6,) [N m]."""
        return np.array(pin.nonLinearEffects(self.model, self.data, q, qd))

    def tool_pose(self, q: Array) -> Array:
        """Tool frame in the base frame, (4, 4) [-, m]."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.tool].homogeneous)

    def mass_derivatives(self, q: Array) -> Array:
        """dM/dq_k as D[k], (6, 6, 6) [kg m^2 / rad]."""
        return np.array([derivative(self.mass_matrix, q, k) for k in range(6)])

    def velocity_products(self, q: Array) -> tuple[Array, Array]:
        """Coriolis matrix b (6, 15) and centrifugal matrix C (6, 6) [kg m^2] from Christoffel's symbols.

        b_ijk = dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i for j < k, and C_ij = dM_ij/dq_j - 0.5 dM_jj/dq_i.
        """
        D = self.mass_derivatives(q)
        b = np.array([[D[k, i, j] + D[j, i, k] - D[i, j, k] for j, k in PAIRS] for i in range(6)])
        C = np.array([[D[j, i, j] - 0.5 * D[i, j, j] for j in range(6)] for i in range(6)])
        return b, C


def derivative(function: Callable[[Array], Array], q: Array, k: int, samples: int = 5) -> Array:
    """Derivative of `function` by q_k at q, exact to round-off.

    With N odd samples at x_j = 2 pi j / N, a trigonometric polynomial of degree at most (N - 1) / 2 has the derivative
    sum_j w_j f(q + x_j) with w_j = 2/N sum_m m sin(m x_j): M has degree 2, so N = 5 is enough.
    """
    total = np.zeros_like(function(q))
    for j in range(1, samples):
        x = 2 * math.pi * j / samples
        weight = 2 / samples * sum(m * math.sin(m * x) for m in range(1, (samples - 1) // 2 + 1))
        shifted = q.copy()
        shifted[k] += x
        total += weight * function(shifted)
    return total


def nodes() -> tuple[Array, Array]:
    """theta2 and theta3 of the 9 x 9 grid, each (9, 9) [rad]."""
    angle = 2 * math.pi * np.arange(NODES) / NODES
    second, third = np.meshgrid(angle, angle, indexing="ij")
    return second, third


def node_positions() -> Array:
    """The grid as joint positions, wrist frozen at zero, (81, 6) [rad]."""
    second, third = nodes()
    q = np.zeros((NODES * NODES, 6))
    q[:, 1], q[:, 2] = second.ravel(), third.ravel()
    return q


def on_torus(values: Array, points: int, order: tuple[int, int] = (0, 0)) -> Array:
    """Continue values on the 9 x 9 grid to points x points equispaced angles, optionally differentiated.

    Args:
        values: (9, 9, ...) values of trigonometric polynomials of degree at most 4.
        points: Samples of each angle, the first at zero.
        order: Number of differentiations by theta2 and theta3.
    """
    m = np.fft.fftfreq(NODES, 1 / NODES)
    angle = 2 * math.pi * np.arange(points) / points
    second, third = (np.exp(1j * np.outer(angle, m)) * (1j * m) ** n / NODES for n in order)
    spectrum = np.fft.fft2(values, axes=(0, 1))
    return np.einsum("ax,xy...,by->ab...", second, spectrum, third, optimize=True).real


def _craig(row: dict[str, float]) -> pin.SE3:
    """Placement of a frame in the previous one by modified Denavit-Hartenberg parameters, at zero joint angle."""
    c, s = math.cos(row["alpha"]), math.sin(row["alpha"])
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return pin.SE3(rotation, np.array([row["a"], -s * row["d"], c * row["d"]]))


def modified(alpha: float, a: float, d: float, theta: Array) -> Array:
    """Equation (8) as printed: Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d); theta (...), result (..., 4, 4)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), math.cos(alpha), math.sin(alpha)
    rows = [[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]]
    return _stack(rows, np.shape(theta))


def standard(alpha: float, a: float, d: float, theta: Array) -> Array:
    """Standard Denavit-Hartenberg, Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha), as (3)-(5); (..., 4, 4)."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), math.cos(alpha), math.sin(alpha)
    rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return _stack(rows, np.shape(theta))


def _stack(rows: list[list[Any]], shape: tuple[int, ...]) -> Array:
    flat = [np.broadcast_to(np.asarray(entry, dtype=float), shape) for row in rows for entry in row]
    return np.stack(flat, axis=-1).reshape(*shape, 4, 4)


def table2(a3_as_printed: bool) -> list[tuple[float, float, float]]:
    """Rows (alpha, a, d) of Table 2, with its own sign of a3 or with the sign the dynamics carry."""
    key = "a" if a3_as_printed else "a_used"
    return [(row["alpha"], row[key], row["d"]) for row in read("constants.yaml")["dh"]["rows"]]


def standard_chain(rows: list[tuple[float, float, float]], q: Array) -> Array:
    """Product of the standard transformations of all rows at joint positions q (..., 6), (..., 4, 4)."""
    T = np.eye(4)
    for i, (alpha, a, d) in enumerate(rows):
        T = T @ standard(alpha, a, d, q[..., i])
    return T


def modified_chain(rows: list[tuple[float, float, float]], q: Array, same_row: bool) -> Array:
    """Product of (8) over all rows, with alpha and a of the same row (`same_row`) or of the row before."""
    T = np.eye(4)
    before = [(0.0, 0.0), *((alpha, a) for alpha, a, _ in rows)]
    for i, (alpha, a, d) in enumerate(rows):
        T = T @ modified(*((alpha, a) if same_row else before[i]), d, q[..., i])
    return T
