"""How far each printed equation is from the truth, and from the other printed equations.

Maxima are over the full torus of theta2 and theta3, wrist frozen at zero, with the fitted constants.
"""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.puma560.puma import Puma560

from .elements import ELEMENTS, element, exact, exact_on_grid, fitted, grid_values, printed_values, spread
from .formula import Tree, evaluate, names, parse
from .independent import NODES, PAIRS, node_positions, on_torus, read

FINE = 360
"""Points on each angle of the torus where a maximum is sought: 1 degree."""
ROUND_OFF = 1e-12
"""Differences below this are equality: sums of some twenty products of size 1 to 50."""


def peak(values: Array, points: int = FINE) -> float:
    """Largest absolute value over the torus of what is given on the grid, (9, 9, ...)."""
    return float(np.abs(on_torus(values, points)).max())


def on_grid(tree: Tree) -> Array:
    """Value of a formula on the grid, (9, 9)."""
    return spread(evaluate(tree, grid_values()))


@cache
def value_error(number: int) -> float:
    """Largest difference between a printed formula and the exact value of the entry it belongs to."""
    return peak(on_grid(element(number).printed) - exact(element(number).slot))


@cache
def label_error(number: int) -> float:
    """Largest difference between a printed formula and the exact value of the entry it is printed for."""
    return peak(on_grid(element(number).printed) - exact(element(number).label))


@cache
def corrected_error(number: int) -> float:
    """Largest difference between a corrected formula and the exact value of the entry it belongs to."""
    return peak(on_grid(element(number).corrected) - exact(element(number).slot))


def size(label: str) -> float:
    """Largest absolute value of an entry of the arm."""
    return peak(exact(label))


@cache
def corrected_matrices() -> dict[str, Array]:
    """A, b, C, G of the `corrected` model on the grid, (9, 9, ...)."""
    model, q = Puma560("corrected"), node_positions()
    found = {"A": model.mass_matrix(q), "b": model.coriolis(q), "c": model.centrifugal(q), "G": model.gravity(q)}
    return {name: value.reshape(NODES, NODES, *value.shape[1:]) for name, value in found.items()}


@cache
def dropped() -> dict[str, float]:
    """Entries that are zero in the `corrected` pattern and not in the arm: name -> largest absolute value.

    The upper triangle of A stands for the lower one. An entry of G would be here too.
    """
    found = {}
    for letter in ("A", "b", "c", "G"):
        gap = on_torus(exact_on_grid()[letter] - corrected_matrices()[letter], FINE // 3)
        for where in itertools.product(*(range(n) for n in gap.shape[2:])):
            largest = float(np.abs(gap[(..., *where)]).max())
            digits = (where[0], *PAIRS[where[1]]) if letter == "b" else where
            if largest > ROUND_OFF and not (letter == "A" and where[0] > where[1]):
                found[letter + "".join(str(d + 1) for d in digits)] = largest
    return found


@cache
def waist_inertia() -> tuple[float, float, float, float, float]:
    """A11 over the torus: exact least and largest, printed least and largest, largest ratio printed / exact."""
    right, wrong = (on_torus(x, FINE) for x in (exact("A11"), printed_values()["A11"]))
    return *(float(x) for x in (right.min(), right.max(), wrong.min(), wrong.max())), float((wrong / right).max())


def scales_with_constants(tree: Tree) -> bool:
    """Whether a formula doubles when all constants double, as anything in kg m^2 or N m must."""
    if not any(name[0] in "Ig" for name in names(tree)):
        return False
    doubled = grid_values() | {name: 2 * value for name, value in fitted().items()}
    return bool(np.abs(evaluate(tree, doubled) - 2 * evaluate(tree, grid_values())).max() < ROUND_OFF)


Identity = tuple[int | None, float, tuple[tuple[int, tuple[int, int]], ...]]
BY_2, BY_3 = (1, 0), (0, 1)
IDENTITIES: tuple[Identity, ...] = (
    (49, 1.0, ((37, BY_2),)),
    (50, 1.0, ((37, BY_3),)),
    (52, 1.0, ((38, BY_3), (39, BY_2))),
    (54, 1.0, ((40, BY_3),)),
    (None, 1.0, ((40, BY_2),)),
    (63, 1.0, ((38, BY_2),)),
    (64, 1.0, ((39, BY_3),)),
    (65, -0.5, ((37, BY_2),)),
    (66, 1.0, ((41, BY_3),)),
    (67, -0.5, ((37, BY_3),)),
    (68, -0.5, ((40, BY_3),)),
)
"""Christoffel's symbols among joints 1 to 3: equation = factor x sum of derivatives of equations; None is zero.

They hold for every arm, whatever its constants, so they test the printed equations against each other. (66), (67)
and (68) stand for c23, c31 and c32.
"""


def identity_error(identity: Identity, mended: tuple[int, ...]) -> float:
    """Largest violation of one of `IDENTITIES` when the equations `mended` are corrected and the others as printed."""
    number, factor, derivatives = identity

    def value(n: int) -> Array:
        return on_grid(element(n).corrected if n in mended else element(n).printed)

    left = on_torus(value(number), FINE) if number else 0.0
    right = sum(on_torus(value(n), FINE, order) for n, order in derivatives)
    return float(np.abs(left - factor * right).max())


@cache
def corrected_values() -> dict[str, Array]:
    """Every entry as corrected, by the slot it belongs to, on the grid; b225 = b235 included."""
    values = {e.slot: on_grid(e.corrected) for e in map(element, ELEMENTS)}
    return values | {"b225": values["b235"]}


@cache
def claims() -> dict[tuple[int, str], tuple[float | None, float | None]]:
    """Chains `label = claim = formula`: largest gap claim - formula as printed, and with everything corrected.

    None where the claim names something nothing defines.
    """

    def gap(claim: str, values: dict[str, Array], formula: Tree) -> float | None:
        tree = parse(claim)
        return peak(spread(evaluate(tree, values)) - on_grid(formula)) if names(tree) <= set(values) else None

    return {
        (n, claim): (
            gap(claim, printed_values(), element(n).printed),
            gap(claim, corrected_values(), element(n).corrected),
        )
        for n in ELEMENTS
        for claim in element(n).claims
    }


def printed_constants() -> dict[str, float]:
    """Constants of Tables 3 and 4 by name."""
    data = read("constants.yaml")
    return {name: row["value"] for part in ("inertial", "motor", "gravitational") for name, row in data[part].items()}


def ties(k: dict[str, float]) -> dict[str, tuple[float, float]]:
    """The seven ties of a rigid arm: left and right side with the constants `k`, g = 9.81 m/s^2.

    I15/d4, I16/a2, I18/d2, I22/a3 and -g5/g are one first moment of the hand, m6 rz6 [kg m]: four ties.
    """
    rows, g = read("constants.yaml")["dh"]["rows"], 9.81
    a2, a3, d2, d4 = rows[1]["a_used"], rows[2]["a_used"], rows[1]["d"], rows[3]["d"]
    return {
        "g2 = -g I5/a2": (k["g2"], -g * k["I5"] / a2),
        "g4 = -g I12/a2": (k["g4"], -g * k["I12"] / a2),
        "I16/a2 = I15/d4": (k["I16"] / a2, k["I15"] / d4),
        "I18/d2 = I15/d4": (k["I18"] / d2, k["I15"] / d4),
        "I22/a3 = I15/d4": (k["I22"] / a3, k["I15"] / d4),
        "-g5/g = I15/d4": (-k["g5"] / g, k["I15"] / d4),
        "I19 + I20 = -I21": (k["I19"] + k["I20"], -k["I21"]),
    }


@cache
def link_length_a3() -> dict[str, float]:
    """a3 [m] that the printed constants imply, by the ties that contain it."""
    k, rows = printed_constants(), read("constants.yaml")["dh"]["rows"]
    return {
        "d4 I22/I15": rows[3]["d"] * k["I22"] / k["I15"],
        "a2 I22/I16": rows[1]["a"] * k["I22"] / k["I16"],
        "d2 I22/I18": rows[1]["d"] * k["I22"] / k["I18"],
        "-g I22/g5": -9.81 * k["I22"] / k["g5"],
    }


def largest_misfit() -> tuple[str, float]:
    """Constant that the arm misses by the largest fraction of its printed tolerance, and that fraction."""
    data = read("constants.yaml")
    rows = data["inertial"] | data["motor"] | data["gravitational"]
    found = {name: abs(fitted()[name] - row["value"]) / row["tolerance"] for name, row in rows.items()}
    worst = max(found, key=lambda name: found[name])
    return worst, found[worst]


def unsigned_constants() -> list[str]:
    """Constants whose printed tolerance exceeds their value, so that not even the sign is known."""
    data = read("constants.yaml")
    rows = data["inertial"] | data["motor"] | data["gravitational"]
    return [name for name, row in rows.items() if row["tolerance"] > abs(row["value"])]
