#!/usr/bin/env python3
"""Fit PUMA 560 link parameters to Tables 3 and 4, and write ``links.yaml`` and ``puma560.xml``.

Of the 28 constants (23 inertial, 5 gravitational) only 21 are independent for a rigid arm; the other seven are ties
(g2 = -g I5/a2 and so on). Two steps, both convex:

1. the constants nearest to the printed ones, weighted by 1/tolerance, among those any link parameters can give:
   linear least squares over the links' first moments and inertias;
2. among all link parameters that give these constants, the physically consistent set nearest to a rough prior:
   minimise sum_i tr(P0_i^-1 P_i) - log det P_i over the pseudo-inertias P_i (Newton's method), which keeps every
   P_i positive definite.

Motor inertias are joint armatures and are met exactly. Usage: ``fit_puma560.py [--check]``; with ``--check`` nothing
is written and the exit status is 1 when the committed files differ from a fresh fit.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np

from torquebench.robot.library import data_root
from torquebench.robot.links import inertia_tensor, pseudo_inertia
from torquebench.robot.puma560.constants import Body, link_constants, read_constants
from torquebench.robot.puma560.symbols import CONSTANTS

GRAVITY = 9.81
FIELDS = Body._fields
MASS = (13.0, 17.4, 4.8, 0.82, 0.34, 0.09)
"""Masses [kg]: links 2-6 as weighed by Armstrong et al. (1986); link 1's has no effect on the joints' dynamics."""
PRIOR_COM = ((0, 0, 0), (0.068, 0.006, -0.016), (0, -0.07, 0.014), (0, 0, -0.019), (0, 0, 0), (0, 0, 0.032))
PRIOR_INERTIA = (
    (0.3, 0.3, 0.35), (0.13, 0.524, 0.539), (0.075, 0.015, 0.086), (0.0018, 0.0018, 0.0013),
    (0.0003, 0.0003, 0.0004), (0.00015, 0.00015, 0.00004),
)  # fmt: skip
"""Rough centres of mass [m] and principal inertias [kg m^2] that only break the tie between equivalent links."""
JOINTS = ("waist", "shoulder", "elbow", "wrist-roll", "wrist-pitch", "wrist-yaw")
RANGE = ((-160, 160), (-225, 45), (-45, 225), (-110, 170), (-100, 100), (-266, 266))
"""Joint ranges [deg]: in the XML for reference, not enforced."""
TAU_MAX = (97.6, 186.4, 89.4, 24.2, 20.1, 21.3)
"""Torque limits [N m] used throughout the project."""
INERTIA_SCALE = (4.0, 7.0, 1.2, 0.20, 0.18, 0.19)
"""Mbar: rounded typical diagonal of the mass matrix [kg m^2], by which gains are scaled."""
DECIMALS = 12
"""Decimals written, to both files alike; the fit itself is good to a few 1e-13."""


def linear_map(geometry, g):
    """Matrix (28, 60) from the links' parameters to I1..I23, g1..g5."""
    rows = []
    for column in range(60):
        unit = np.zeros(60)
        unit[column] = 1.0
        rows.append(link_constants([Body(*unit[10 * i : 10 * i + 10]) for i in range(6)], geometry, g))
    return np.array(rows).T


def form_constraints():
    """Matrix of linear conditions = 0 for which the arm's dynamics have no terms beyond Armstrong's 28 constants.

    Beyond what that needs, the wrist is made plain: every centre of mass of links 4-6 on its z axis, link 5's at
    the origin, and link 1 (only its Izz matters) without first moments or products.
    """
    zero = [(link, moment) for link in (1, 5) for moment in ("hx", "hy", "hz")]
    zero += [(link, moment) for link in (4, 6) for moment in ("hx", "hy")]
    zero += [(link, product) for link in (1, 4, 5, 6) for product in ("xy", "xz", "yz")]
    rows = []
    for link, name in zero:
        row = np.zeros(60)
        row[10 * (link - 1) + FIELDS.index(name)] = 1.0
        rows.append(row)
    equal = np.zeros(60)
    equal[50 + FIELDS.index("xx")], equal[50 + FIELDS.index("yy")] = 1.0, -1.0
    return np.array([*rows, equal])


def nearest_constants(B, constraints, printed, tolerance):
    """Step 1: the reachable constants of least weighted distance to the printed ones, and chi2."""
    _, singular, vt = np.linalg.svd(constraints)
    free = vt[np.sum(singular > 1e-12) :].T
    weighted = (B @ free) / tolerance[:, None]
    solution = np.linalg.lstsq(weighted, printed / tolerance, rcond=1e-12)[0]
    constants = B @ free @ solution
    return constants, float(np.sum(((constants - printed) / tolerance) ** 2))


def prior():
    """Starting link parameters, (60,)."""
    theta = []
    for m, c, J in zip(MASS, PRIOR_COM, PRIOR_INERTIA, strict=True):
        c = np.array(c, dtype=float)
        J = np.diag(J) + m * (c @ c * np.eye(3) - np.outer(c, c))
        theta += [m, *(m * c), J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    return np.array(theta)


def pseudo(parameters):
    """Pseudo-inertia (4, 4) of one link's ten parameters, linear in them."""
    m, h, J = parameters[0], parameters[1:4], inertia_tensor(*parameters[4:])
    second = 0.5 * np.trace(J) * np.eye(3) - J
    return np.block([[second, h[:, None]], [h[None, :], np.array([[m]])]])


BASIS = [pseudo(row) for row in np.eye(10)]


def consistent_links(A, target):
    """Step 2: Newton's method on the log-det divergence subject to A theta = target, every P_i positive definite."""
    scale = np.linalg.norm(A, axis=1)
    A, target = A / scale[:, None], target / scale
    u, singular, vt = np.linalg.svd(A, full_matrices=False)
    keep = singular > 1e-10 * singular[0]
    A, target = vt[keep], (u.T @ target)[keep] / singular[keep]
    theta = prior()
    inverse0 = [np.linalg.inv(pseudo(theta[10 * i : 10 * i + 10])) for i in range(6)]
    for _ in range(200):
        gradient, hessian = np.zeros(60), np.zeros((60, 60))
        for i in range(6):
            inverse = np.linalg.inv(pseudo(theta[10 * i : 10 * i + 10]))
            products = [inverse @ E for E in BASIS]
            part = slice(10 * i, 10 * i + 10)
            gradient[part] = [np.sum(inverse0[i] * E) - np.trace(P) for E, P in zip(BASIS, products, strict=True)]
            hessian[part, part] = [[np.sum(P * Q.T) for Q in products] for P in products]
        # eliminate the equality constraints through the KKT system, scaled by the Hessian's diagonal
        d = 1.0 / np.sqrt(np.diag(hessian))
        k = len(target)
        kkt = np.block([[hessian * np.outer(d, d), (A * d).T], [A * d, np.zeros((k, k))]])
        right = np.concatenate([-gradient * d, target - A @ theta])
        step = d * np.linalg.solve(kkt, right)[:60]
        length = 1.0
        while not all(
            np.linalg.eigvalsh(pseudo((theta + length * step)[10 * i : 10 * i + 10]))[0] > 0 for i in range(6)
        ):
            length *= 0.5
        theta = theta + (length if length == 1.0 else 0.9 * length) * step
        if length == 1.0 and np.max(np.abs(step * np.sqrt(np.diag(hessian)))) < 1e-11:
            return theta
    raise SystemExit("the fit did not converge")


def fit():
    """Return masses (6,), centres of mass (6, 3), inertias about them (6, 6: xx yy zz xy xz yz), table and chi2."""
    table, geometry = read_constants(data_root() / "models" / "puma560" / "constants.yaml")
    rigid = np.array([not name.startswith("Im") for name in CONSTANTS])
    B, constraints = linear_map(geometry, GRAVITY), form_constraints()
    constants, optimum = nearest_constants(B, constraints, table.value[rigid], table.tolerance[rigid])
    masses = np.zeros((6, 60))
    masses[range(6), range(0, 60, 10)] = 1.0
    A = np.vstack([B, constraints, masses])
    theta = consistent_links(A, np.concatenate([constants, np.zeros(len(constraints)), MASS]))
    com, inertia = np.zeros((6, 3)), np.zeros((6, 6))
    for i in range(6):
        m, h, J = theta[10 * i], theta[10 * i + 1 : 10 * i + 4], inertia_tensor(*theta[10 * i + 4 : 10 * i + 10])
        c = h / m
        J = J - m * (c @ c * np.eye(3) - np.outer(c, c))
        com[i], inertia[i] = c, [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    com[np.abs(com) < 1e-13] = 0.0
    inertia[np.abs(inertia) < 1e-13] = 0.0
    armature = table.value[[name.startswith("Im") for name in CONSTANTS]]
    return com, inertia, armature, table, geometry, optimum


def number(x):
    """Text of a number with DECIMALS decimals, trailing zeros left out; never ``-0``."""
    return f"{float(x):.{DECIMALS}f}".rstrip("0").rstrip(".") if abs(x) > 1e-13 else "0"


def frames(geometry):
    """Modified Denavit-Hartenberg rows (alpha_{i-1}, a_{i-1}, d_i) of Table 2: the tool row last."""
    half = np.pi / 2
    a2, a3, d2, d4, d6 = geometry
    return [(0, 0, 0), (-half, 0, d2), (0, a2, 0), (half, a3, d4), (-half, 0, 0), (half, 0, 0), (0, 0, d6)]


def links_yaml(com, inertia, armature, geometry):
    """Text of ``links.yaml``."""
    rows = frames(geometry)
    out = [
        "# Generated by scripts/fit_puma560.py from constants.yaml; do not edit. SI units; modified Denavit-Hartenberg",
        "# rows (alpha_{i-1}, a_{i-1}, d_i); com in the link's frame, inertia [xx, yy, zz, xy, xz, yz] about the com.",
        f"gravity: [0, 0, {-GRAVITY}]",
        "joints:",
    ]
    for i, name in enumerate(JOINTS):
        alpha, a, d = rows[i]
        out += [
            f"  - name: {name}",
            "    kind: hinge",
            f"    dh: {{alpha: {float(alpha)!r}, a: {a}, d: {d}}}",
            f"    mass: {MASS[i]}",
            f"    com: [{', '.join(number(x) for x in com[i])}]",
            f"    inertia: [{', '.join(number(x) for x in inertia[i])}]",
            f"    armature: {number(armature[i])}",
            f"    tau_max: {TAU_MAX[i]}",
            f"    inertia_scale: {INERTIA_SCALE[i]}",
        ]
    alpha, a, d = rows[6]
    return "\n".join([*out, f"tool: {{alpha: {float(alpha)!r}, a: {a}, d: {d}}}"]) + "\n"


def xml(com, inertia, armature, geometry):
    """Text of ``puma560.xml``."""
    out = [
        "<!-- Generated by scripts/fit_puma560.py from constants.yaml; do not edit. -->",
        '<mujoco model="puma560">',
        '  <compiler angle="radian" autolimits="false"/>',
        f'  <option timestep="0.001" integrator="RK4" gravity="0 0 {-GRAVITY}">',
        '    <flag contact="disable" constraint="disable" autoreset="disable"/>',
        "  </option>",
        "  <worldbody>",
    ]
    turn = {0.0: "1 0 0 0", np.pi / 2: "1 1 0 0", -np.pi / 2: "1 -1 0 0"}
    for i, name in enumerate(JOINTS):
        alpha, a, d = frames(geometry)[i]
        pad = "  " * (i + 2)
        across = -d if alpha < 0 else d
        position = (a, 0, d) if alpha == 0 else (a, -across, 0)
        low, high = (number(np.deg2rad(x)) for x in RANGE[i])
        out += [
            f'{pad}<body name="link{i + 1}" pos="{" ".join(number(x) for x in position)}" quat="{turn[float(alpha)]}">',
            f'{pad}  <inertial mass="{MASS[i]}" pos="{" ".join(number(x) for x in com[i])}"'
            f' fullinertia="{" ".join(number(x) for x in inertia[i])}"/>',
            f'{pad}  <joint name="{name}" type="hinge" axis="0 0 1" armature="{number(armature[i])}"'
            f' limited="false" range="{low} {high}"/>',
        ]
    pad = "  " * 8
    out.append(f'{pad}<site name="tool" pos="0 0 {geometry.d6}"/>')
    out += ["  " * (i + 2) + "</body>" for i in reversed(range(6))]
    out += ["  </worldbody>", "  <actuator>"]
    out += [
        f'    <motor name="{name}" joint="{name}" ctrllimited="true" ctrlrange="-{TAU_MAX[i]} {TAU_MAX[i]}"/>'
        for i, name in enumerate(JOINTS)
    ]
    return "\n".join([*out, "  </actuator>", "</mujoco>"]) + "\n"


def report(com, inertia, armature, table, geometry, optimum):
    """Print constant, printed value, tolerance, achieved value and misfit in tolerances; return chi2 and worst."""
    bodies = []
    for i in range(6):
        J = inertia_tensor(*(float(number(x)) for x in inertia[i]))
        c = np.array([float(number(x)) for x in com[i]])
        J = J + MASS[i] * (c @ c * np.eye(3) - np.outer(c, c))
        bodies.append(Body(MASS[i], *(MASS[i] * c), J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]))
    rigid = link_constants(bodies, geometry, GRAVITY)
    achieved = np.concatenate([rigid[:23], armature, rigid[23:]])
    misfit = (achieved - table.value) / table.tolerance
    print(f"{'constant':>8} {'printed':>12} {'tolerance':>10} {'achieved':>16} {'misfit/tol':>11}")
    for name, value, tol, got, miss in zip(CONSTANTS, table.value, table.tolerance, achieved, misfit, strict=True):
        print(f"{name:>8} {value:>12g} {tol:>10g} {got:>16.10g} {miss:>+11.5f}")
    worst = int(np.argmax(np.abs(misfit)))
    chi2 = float(np.sum(misfit**2))
    print(f"chi2 = {chi2:.6f} (least-squares optimum {optimum:.6f}); worst misfit {abs(misfit[worst]):.5f}", end=" ")
    print(f"tolerances ({CONSTANTS[worst]})")
    least = min(np.linalg.eigvalsh(pseudo_inertia(MASS[i], com[i], inertia_tensor(*inertia[i])))[0] for i in range(6))
    print(f"least eigenvalue of the six pseudo-inertias: {least:.3g} (positive: every link is a possible body)")


def same(text, path):
    """Whether `text` and the file agree: equal words, numbers within 5e-12 (LAPACK differs by machine)."""
    pattern = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
    committed = path.read_text(encoding="utf-8") if path.is_file() else ""
    if re.sub(pattern, "#", text) != re.sub(pattern, "#", committed):
        return False
    new, old = (np.array([float(x) for x in re.findall(pattern, s)]) for s in (text, committed))
    return len(new) == len(old) and bool(np.all(np.abs(new - old) <= 5e-12))


def main():
    """Fit, report, and write or check the two generated files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the committed files; write nothing")
    check = parser.parse_args().check
    com, inertia, armature, table, geometry, optimum = fit()
    report(com, inertia, armature, table, geometry, optimum)
    folder: Path = data_root() / "models" / "puma560"
    texts = {
        folder / "links.yaml": links_yaml(com, inertia, armature, geometry),
        folder / "puma560.xml": xml(com, inertia, armature, geometry),
    }
    if check:
        stale = [str(path.name) for path, text in texts.items() if not same(text, path)]
        print(f"differs from a fresh fit: {', '.join(stale)}" if stale else "the committed files are a fresh fit")
        return 1 if stale else 0
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
