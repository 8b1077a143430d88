"""The paper's equations as data: what each defines, as printed and as corrected, and their exact values."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from torquebench.kernel import Array
from torquebench.robot.puma560 import centrifugal as cf
from torquebench.robot.puma560 import coriolis as co
from torquebench.robot.puma560 import gravity as gr
from torquebench.robot.puma560 import inertia as ia
from torquebench.robot.puma560.puma import Puma560
from torquebench.robot.puma560.symbols import CONSTANTS

from .formula import Tree, evaluate, matrix, parse, sides
from .independent import NODES, PAIRS, Arm, node_positions, nodes
from .paper_equations import EQUATIONS, REPAIRS

POSE = {11: "Nx", 12: "Ny", 13: "Nz", 14: "Bx", 15: "By", 16: "Bz", 17: "Tx", 18: "Ty", 19: "Tz", 20: "Px", 21: "Py"}
POSE[22] = "Pz"
"""Entries of (10), column by column."""
MASS = (37, 38, 39, 40, 41, 42, 43, 44, 45, 46)
CORIOLIS = tuple(range(49, 61))
CENTRIFUGAL = tuple(range(63, 71))
GRAVITY = (73, 74, 75)
ELEMENTS = MASS + CORIOLIS + CENTRIFUGAL + GRAVITY
"""Equations that define one entry of A, b, C or G each."""

FUNCTIONS: dict[str, Callable[..., float]] = {
    name: getattr(module, name)
    for module, listed in (
        (ia, "a11 a12 a13 a22 a23 a33 a35 a44 a55 a66"),
        (co, "b112 b113 b115 b123 b214 b223 b235 b314 b412 b413 b415 b514"),
        (cf, "c12 c13 c21 c23 c31 c32 c51 c52"),
        (gr, "gravity2 gravity3 gravity5"),
    )
    for name in listed.split()
}
"""The functions under test, by name."""
SLOTS_FILLED_BY = {"c23": (67, 66), "c31": (68, 67), "c32": (69, 68), "c51": (None, 69)}
"""Functions named after a slot of (62): equation whose label it is, equation whose value it is."""
MOVED = {66: "c23", 67: "c31", 68: "c32", 69: "c51"}
"""Equations whose label is one slot early: the slot their value belongs to."""

DROPPED = {
    "A14": "I14 C23",
    "A15": "- I18 C23",
    "A16": "I23 C23",
    "A25": "I15 + I17 + I16 S3",
    "A46": "I23",
    "b124": "(I19 + I20 - I14) S23",
    "b125": "2 I18 S23",
    "b126": "- I23 S23",
    "b134": "(I19 + I20 - I14) S23",
    "b135": "2 I18 S23",
    "b136": "- I23 S23",
    "b145": "(2 I15 + I17 - I20) S23 + 2 I16 C2 + 2 I22 C23",
    "b156": "- I23 S23",
    "b216": "I23 S23",
    "b316": "I23 S23",
    "b325": "2 I22",
    "b335": "2 I22",
    "b516": "I23 S23",
    "b523": "- 2 I22",
    "b612": "- I23 S23",
    "b613": "- I23 S23",
    "b615": "- I23 S23",
    "c15": "I18 S23",
    "c25": "I16 C3 + I22",
    "c35": "I22",
    "c53": "- I22",
}
"""Entries that (36), (48) and (62) set to zero although they are not, with what they are at the frozen wrist."""


class Element(NamedTuple):
    """One of the equations `ELEMENTS`."""

    number: int
    label: str
    """Entry it is printed for."""
    slot: str
    """Entry its value belongs to; differs from `label` for (66)-(69)."""
    printed: Tree
    claims: tuple[str, ...]
    """Further expressions printed between the label and the formula."""
    corrected: Tree


def docstring_formulas(name: str) -> tuple[str, str]:
    """Return the `printed:` and the `corrected:` text of a function's docstring; the same text if it has one only."""
    lines = [line.strip() for line in (FUNCTIONS[name].__doc__ or "").splitlines()]
    found = {
        key: line[len(key) + 1 :] for line in lines for key in ("printed", "corrected") if line.startswith(key + ":")
    }
    return found["printed"], found.get("corrected", found["printed"])


def label_of(number: int) -> str:
    """Return the entry that an equation is printed for, such as A11, b112, c12, G2."""
    tree = parse(sides(EQUATIONS[number])[0])
    assert tree[0] == "name"
    return str(tree[1])


def function_name(label: str) -> str:
    """Return the name of the function that computes entry `label`."""
    return "gravity" + label[1:] if label[0] == "G" else label.lower()


@cache
def element(number: int) -> Element:
    """Return one of the equations `ELEMENTS`."""
    _, *claims, formula = sides(EQUATIONS[number])
    label = label_of(number)
    slot = MOVED.get(number, label)
    return Element(
        number, label, slot, parse(formula), tuple(claims), parse(docstring_formulas(function_name(slot))[1])
    )


def index(label: str) -> tuple[int, ...]:
    """Return where an entry sits in A (6, 6), b (6, 15), C (6, 6) or G (6,)."""
    digits = [int(d) - 1 for d in label[1:]]
    return (digits[0], PAIRS.index((digits[1], digits[2]))) if label[0] == "b" else tuple(digits)


@cache
def fitted() -> dict[str, float]:
    """Constants of the arm of `links.yaml`, by name [kg m^2, N m]."""
    return dict(zip(CONSTANTS, Puma560("corrected").flat.constants.tolist(), strict=True))


@cache
def grid_values() -> Mapping[str, Any]:
    """Names for `evaluate` on the 9 x 9 grid: the constants, theta2 and theta3."""
    second, third = nodes()
    return fitted() | {"theta2": second, "theta3": third}


@cache
def exact_on_grid() -> dict[str, Array]:
    """A, b, C, G of Pinocchio's arm on the grid, (9, 9, ...), and D = dA/dq_k (9, 9, 6, 6, 6)."""
    arm = Arm()
    q = node_positions()
    products = [arm.velocity_products(x) for x in q]
    found = {
        "A": np.array([arm.mass_matrix(x) for x in q]),
        "b": np.array([b for b, _ in products]),
        "c": np.array([C for _, C in products]),
        "G": np.array([arm.gravity(x) for x in q]),
        "D": np.array([arm.mass_derivatives(x) for x in q]),
    }
    return {name: value.reshape(NODES, NODES, *value.shape[1:]) for name, value in found.items()}


def exact(label: str) -> Array:
    """Exact value of an entry on the grid, (9, 9)."""
    return exact_on_grid()[label[0]][(..., *index(label))]


def spread(value: Any) -> Array:
    """Return a formula's value on the grid as (9, 9), also when it is a constant."""
    return np.broadcast_to(np.asarray(value, dtype=float), (NODES, NODES))


@cache
def printed_values() -> dict[str, Array]:
    """Every entry as printed, by its printed label, on the grid; what nothing defines is not in it."""
    values = {e.label: spread(evaluate(e.printed, grid_values())) for e in map(element, ELEMENTS)}
    for left, right in re.findall(r"A_\{(\d\d)\} = A_\{(\d\d)\}", EQUATIONS[47]):
        values[f"A{left}"] = values[f"A{right}"]
    return values


def printed_matrix(number: int) -> Array:
    """(36), (48), (62) or (72) filled with the entries as printed, on the grid; what nothing defines is zero."""
    rows = matrix(EQUATIONS[number])
    zero = np.zeros((NODES, NODES))
    filled = [[printed_values().get(_name(entry), zero) for entry in row] for row in rows]
    return np.moveaxis(np.array(filled), (0, 1), (2, 3))


def _name(entry: str) -> str:
    tree = parse(entry)
    return str(tree[1]) if tree[0] == "name" else "0"


def torque_rows(number: int, speeds: Array, values: Mapping[str, Any]) -> Array:
    """Rows of (61) or (71) as printed with these entries, lost dots read as speeds (6,), (9, 9, 6) [N m]."""
    moving = {f"{letter}{i + 1}": speeds[i] for letter in ("q", "qd") for i in range(6)}
    rows = [spread(evaluate(parse(row[0]), {**values, **moving})) for row in matrix(EQUATIONS[number])]
    return np.moveaxis(np.array(rows), 0, -1)


def printed_torque(number: int, speeds: Array) -> Array:
    """Rows of (61) or (71) with every entry as printed; b225 and c51, which nothing defines, are zero."""
    return torque_rows(number, speeds, {"b225": 0.0, "c51": 0.0} | printed_values())


def pose_tree(number: int, repaired: bool) -> Tree:
    """Formula of (11)-(22), as printed or with the edits of `REPAIRS`."""
    latex = " ".join(EQUATIONS[number].split())
    for old, new in REPAIRS.get(number, ()) if repaired else ():
        assert latex.count(old) == 1, (number, old)
        latex = latex.replace(old, new)
    return parse(sides(latex)[-1])


def pose_index(number: int) -> tuple[int, int]:
    """Row and column in (10) of equation `number`."""
    return "xyz".index(POSE[number][1]), "NBTP".index(POSE[number][0])
