"""Kernels that evaluate a fuzzy system: from two normalised inputs to one normalised output."""

from __future__ import annotations

from torquebench.fuzzy.closed_form import both, even, floor_below
from torquebench.fuzzy.fis import SUGENO, SUM, Fis
from torquebench.kernel import Array, kernel, sat


@kernel(inline=True)
def infer(fis: Fis, x: float, y: float) -> float:
    """Return the output of a fuzzy system, nominally in [-1, 1]; 0 where no rule fires.

    Args:
        fis: The system, see `prepare`.
        x, y: Its inputs, clipped to [-1, 1]; a system of one input ignores y. NaN gives NaN.
    """
    x, y = sat(x), sat(y)
    nothing = (x - x) + (y - y)  # 0, or NaN; a comparison here would cost more than all the rest
    if fis.method <= SUM:
        return nothing + even(fis.table, fis.conjunction, fis.method, fis.inputs, fis.scale, fis.offset, x, y)
    return nothing + slower(fis, x, y)


@kernel
def slower(fis: Fis, x: float, y: float) -> float:
    """Evaluate by SUGENO or TABLE; arguments as of `infer`, within [-1, 1]."""
    if fis.inputs == 1:
        y = -1.0
    if fis.method == SUGENO:
        return weighted_mean(fis, x, y)
    return interpolate(fis, x, y)


@kernel
def membership(terms: Array, k: int, x: float) -> float:
    """Return the degree to which x is term k: a trapezoid with feet a, d and shoulders b, c; `terms` is (n, 4)."""
    if x < terms[k, 1]:
        return (x - terms[k, 0]) / (terms[k, 1] - terms[k, 0]) if x > terms[k, 0] else 0.0
    if x > terms[k, 2]:
        return (terms[k, 3] - x) / (terms[k, 3] - terms[k, 2]) if x < terms[k, 3] else 0.0
    return 1.0


@kernel
def fill_memberships(terms: Array, x: Array, degrees: Array) -> None:
    """Fill `degrees` (N, n) with the degree to which each of `x` (N,) is each of `terms` (n, 4)."""
    for i in range(len(x)):
        for k in range(len(terms)):
            degrees[i, k] = membership(terms, k, x[i])


@kernel
def weighted_mean(fis: Fis, x: float, y: float) -> float:
    """Mean of the rules' functions f0 + f1 x + f2 y, each weighted by how much its rule fires; Sugeno's method.

    Arguments as of `infer`, within [-1, 1]. Zero where no rule fires.
    """
    weight, total = 0.0, 0.0
    for i in range(len(fis.x_terms)):
        u = membership(fis.x_terms, i, x)
        if u > 0.0:
            for j in range(len(fis.y_terms)):
                k = fis.rules[i, j]
                if k >= 0:
                    w = both(fis.conjunction, u, membership(fis.y_terms, j, y))
                    weight += w
                    total += w * (fis.functions[k, 0] + fis.functions[k, 1] * x + fis.functions[k, 2] * y)
    if not weight > 0.0:
        return 0.0
    return total / weight


@kernel
def place_of(breaks: Array, cells: int, x: float) -> float:
    """Return where x lies among nodes that divide each stretch between two breaks into `cells`, counted in nodes."""
    k = 0
    while k < len(breaks) - 2 and x >= breaks[k + 1]:
        k += 1
    return cells * (k + (x - breaks[k]) / (breaks[k + 1] - breaks[k]))


@kernel
def interpolate(fis: Fis, x: float, y: float) -> float:
    """Bilinear interpolation in the table of outputs; arguments as of `infer`, within [-1, 1]."""
    s, t = place_of(fis.x_breaks, fis.x_cells, x), place_of(fis.y_breaks, fis.y_cells, y)
    i, j = floor_below(fis.table.shape[0] - 1, s), floor_below(fis.table.shape[1] - 1, t)
    u, v = s - i, t - j
    low = (1.0 - v) * fis.table[i, j] + v * fis.table[i, j + 1]
    high = (1.0 - v) * fis.table[i + 1, j] + v * fis.table[i + 1, j + 1]
    return (1.0 - u) * low + u * high


@kernel
def fill_outputs(fis: Fis, x: Array, y: Array, outputs: Array) -> None:
    """Fill `outputs` (N,) with the output of `fis` at each pair of inputs of `x` and `y` (N,)."""
    for i in range(len(x)):
        outputs[i] = infer(fis, x[i], y[i])


@kernel
def fill_activations(fis: Fis, x: float, y: float, degrees: Array) -> None:
    """Fill `degrees` (n1, n2) with how much the rule of each pair of terms fires; 0 where there is no rule.

    Args:
        fis: The system.
        x, y: Its inputs, clipped to [-1, 1]; a system of one input ignores y.
        degrees: Result; of one input, the second column repeats the first.
    """
    x, y = sat(x), sat(y) if fis.inputs == 2 else -1.0
    for i in range(len(fis.x_terms)):
        for j in range(len(fis.y_terms)):
            fires = both(fis.conjunction, membership(fis.x_terms, i, x), membership(fis.y_terms, j, y))
            degrees[i, j] = fires if fis.rules[i, j] >= 0 else 0.0
