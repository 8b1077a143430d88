"""The functions compute what their docstrings say, and what they call `printed` is what the paper prints."""

import numpy as np
import pytest

from torquebench.kernel import Array
from torquebench.robot.puma560.puma import Puma560
from torquebench.robot.puma560.symbols import CONSTANTS, MISPRINTED, angles

from .closed_loop import belief
from .elements import (
    DROPPED,
    ELEMENTS,
    FUNCTIONS,
    POSE,
    SLOTS_FILLED_BY,
    docstring_formulas,
    element,
    fitted,
    function_name,
    index,
    pose_index,
    pose_tree,
    printed_matrix,
    printed_torque,
    printed_values,
    torque_rows,
)
from .findings import corrected_values
from .formula import FormulaError, evaluate, matrix, parse, text
from .independent import NODES, PAIRS, node_positions
from .paper_equations import EQUATIONS

TWO_FORMS = {name for name in FUNCTIONS if "corrected:" in (FUNCTIONS[name].__doc__ or "")}


def draw(seed: int) -> tuple[Array, Array]:
    """Random constants of size 1 (34,) and a random position (6,)."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=len(CONSTANTS)), rng.uniform(-np.pi, np.pi, 6)


def call(name: str, k: Array, q: Array, printed: int) -> float:
    """Call an element's function, whichever of its three signatures it has."""
    function = FUNCTIONS[name]
    if name in ("a33", "a35", "a44", "a55", "a66"):
        return function(k)
    return function(k, angles(q), printed) if name in TWO_FORMS else function(k, angles(q))


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_function_is_its_docstring(name: str) -> None:
    """Each function returns the value of its docstring's formula, as printed and corrected."""
    for seed in range(20):
        k, q = draw(seed)
        values = dict(zip(CONSTANTS, k, strict=True)) | {f"theta{i + 1}": q[i] for i in range(6)}
        for printed, formula in ((1, docstring_formulas(name)[0]), (0, docstring_formulas(name)[1])):
            # sums of some ten terms of size 1: 1e-13 is a few hundred units of round-off, a wrong term is of size 1
            assert call(name, k, q, printed) == pytest.approx(evaluate(parse(formula), values), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("number", ELEMENTS)
def test_docstring_is_the_paper(number: int) -> None:
    """The `printed:` text and the paper's LaTeX are the same tree: same terms, order, signs and brackets."""
    by_label = {printed: name for name, (printed, _) in SLOTS_FILLED_BY.items()}
    if number == 66:  # its label is a slot that (62) keeps empty; its value is what c23 should be
        assert parse(docstring_formulas("c23")[1]) == element(66).printed
        return
    name = by_label.get(number, function_name(element(number).label))
    assert parse(docstring_formulas(name)[0]) == element(number).printed


def test_docstrings_that_state_two_forms_are_the_misprinted_equations() -> None:
    """An equation has a `corrected:` text exactly when the model has a flag for it (36, 55, 62, 71: no formula)."""
    flagged = {int(number) for number in MISPRINTED} - {36, 55, 62, 71}
    formulas = {number for number in ELEMENTS if function_name(element(number).label) in TWO_FORMS} - {66}
    assert formulas == flagged
    assert TWO_FORMS - {function_name(element(n).label) for n in flagged} == {"c51"}  # (62)'s undefined slot


def test_matrices_are_the_paper() -> None:
    """A (36), b (48), C (62), G (72) of the `printed` model are the printed patterns filled with printed entries."""
    model, q = Puma560("printed"), node_positions()
    shape = (NODES, NODES)
    for number, found in ((36, model.mass_matrix(q)), (48, model.coriolis(q)), (62, model.centrifugal(q))):
        # round-off of sums below 10
        np.testing.assert_allclose(found.reshape(*shape, *found.shape[1:]), printed_matrix(number), rtol=0, atol=1e-13)
    np.testing.assert_allclose(model.gravity(q).reshape(*shape, 6), printed_matrix(72)[..., 0], rtol=0, atol=1e-12)


def test_bias_is_the_paper() -> None:
    """N of the `printed` model is (61) + (71) + (72) row by row, lost dots read as speeds."""
    q, rng = node_positions(), np.random.default_rng(5)
    for _ in range(5):
        qd = rng.uniform(-2, 2, 6)
        found = Puma560("printed").bias_forces(q, np.broadcast_to(qd, q.shape)).reshape(NODES, NODES, 6)
        paper = printed_torque(61, qd) + printed_torque(71, qd) + printed_matrix(72)[..., 0]
        np.testing.assert_allclose(found, paper, rtol=0, atol=1e-12)  # round-off of torques up to 50 N m


@pytest.mark.parametrize("flag", MISPRINTED)
def test_each_flag_is_one_equation(flag: str) -> None:
    """A flag changes one equation: A, b, C and N are the texts', all corrected but that one."""
    values = dict(corrected_values())
    if flag in ("36", "71"):
        pass
    elif flag in ("55", "62"):
        values[{"55": "b225", "62": "c51"}[flag]] = np.zeros((NODES, NODES))
    else:
        values[element(int(flag)).label] = printed_values()[element(int(flag)).label]
    model, q = belief((flag,)), node_positions()
    A = model.mass_matrix(q).reshape(NODES, NODES, 6, 6)
    assert (np.abs(A[..., 4, 2]).max() == 0) == (flag == "36")
    found = {"A": A, "b": model.coriolis(q).reshape(NODES, NODES, 6, 15)}
    found["c"] = model.centrifugal(q).reshape(NODES, NODES, 6, 6)
    for label, value in values.items():
        if label[0] in found:
            # round-off of sums below 10
            np.testing.assert_allclose(found[label[0]][(..., *index(label))], value, rtol=0, atol=1e-13, err_msg=label)
    qd = np.array([1.3, -0.7, 1.1, 0.6, -1.7, 0.4])
    torque = torque_rows(61, qd, values) + torque_rows(71, qd, values) + gravity_rows(values)
    if flag != "71":
        torque[..., 2] += (values["c31"] - values["c13"]) * qd[0] ** 2
    N = model.bias_forces(q, np.broadcast_to(qd, q.shape)).reshape(NODES, NODES, 6)
    np.testing.assert_allclose(N, torque, rtol=0, atol=1e-12)  # round-off of torques up to 50 N m


def gravity_rows(values: dict[str, Array]) -> Array:
    """(72) with these entries, (9, 9, 6) [N m]."""
    zero = np.zeros((NODES, NODES))
    return np.stack([zero, values["G2"], values["G3"], zero, values["G5"], zero], axis=-1)


def test_labels_of_the_patterns() -> None:
    """(36), (48) and (62) put every label where its own digits say; (35) lists the speeds in that order."""
    for number, letter in ((36, "A"), (48, "b"), (62, "C")):
        for i, row in enumerate(matrix(EQUATIONS[number])):
            for j, entry in enumerate(row):
                digits = f"{i + 1}{j + 1}" if letter != "b" else f"{i + 1}{PAIRS[j][0] + 1}{PAIRS[j][1] + 1}"
                assert entry in ("0", f"{letter}_{{{digits}}}")
    speeds = EQUATIONS[35].split(r"\begin{bmatrix}")[2].split(r"\\")
    assert [entry.count(r"\dot") for entry in speeds] == [2] * 15
    assert [tuple(int(c) - 1 for c in entry if c.isdigit()) for entry in speeds] == PAIRS


@pytest.mark.parametrize("number", sorted(POSE))
def test_pose_is_the_paper(number: int) -> None:
    """The literal forward kinematics are (11)-(22) as printed, the other one is them with the listed edits."""
    rng = np.random.default_rng(number)
    model, arm = Puma560("printed"), Puma560("corrected")
    for _ in range(20):
        theta = rng.uniform(-np.pi, np.pi, 6)
        values = {f"theta{i + 1}": theta[i] for i in range(6)}
        i, j = pose_index(number)
        # round-off of products of cosines
        literal = evaluate(pose_tree(number, repaired=False), values)
        assert model.forward_kinematics(theta)[i, j] == pytest.approx(literal, abs=1e-15)
        q = np.array([theta[0], -theta[1], np.pi - theta[2], theta[3], theta[4] - np.pi, theta[5]])
        T = arm.forward_kinematics(q)
        T[:3, 3] -= arm.geometry.d6 * T[:3, 2]
        # lengths: (20)-(22) print 0.4331 and 0.1491, Table 2 has 0.43307 and 0.14909
        digits = 4.1e-5 if j == 3 else 1e-14
        assert T[i, j] == pytest.approx(evaluate(pose_tree(number, repaired=True), values), abs=digits)


def test_undefined_names() -> None:
    """The printed equations use two names that nothing defines, b225 and c51, and define c22 that nothing uses."""
    defined = {element(number).label for number in ELEMENTS} | {"A21", "A31", "A32"}
    patterns = [entry for number in (36, 48, 62, 72) for row in matrix(EQUATIONS[number]) for entry in row]
    used = {str(parse(entry)[1]) for entry in patterns if entry != "0"}
    assert used - defined == {"b225", "c51"}
    assert defined - used == {"c22"}


def test_parser() -> None:
    """Precedence, juxtaposition, both bracket kinds, squares; text that is not a formula is refused, never run."""
    assert evaluate(parse("2 [3 - 2 (4 - 1)] + 0.5 2"), {}) == -5
    assert evaluate(parse(r"-b_{112} \cdot \dot{q}_2^2 3"), {"b112": 2.0, "qd2": 3.0}) == -54
    assert parse(r"I_{m1} \times \cos(\theta_2 + \theta_2 + \theta_3)") == parse("Im1 C223")
    for number in ELEMENTS:
        assert parse(text(element(number).printed)) == element(number).printed
    for bad in ("", "2 +", "(1", "1)", "sin(2)", "__import__", "I5 ** 2", r"\cos \theta_2", "2; 3"):
        with pytest.raises(FormulaError):
            parse(bad)


def test_dropped_entries_are_formulas() -> None:
    """The list of dropped entries can be read, and uses known constants only."""
    for formula in DROPPED.values():
        assert np.isfinite(evaluate(parse(formula), fitted() | {"theta2": 0.1, "theta3": 0.2}))
