"""Kernels that evaluate a fuzzy system: from two normalised inputs to one normalised output.

Exact inference on evenly spaced triangles has a closed form, because at most four rules fire. In units of the spacing
of the output's triangles, whose half-width equals it, one clipped at height w has the area w (2 - w) about its centre;
two neighbours clipped at w1 and w2 share the area m (1 - m), m = min(w1, w2) <= 1/2, half way between them; others
share none. So the centre of area of their union is a quotient of two sums.
"""

from __future__ import annotations

import math

from torquebench.fuzzy.fis import BELL, GAUSSIAN, PRODUCT, STAIRCASE, STRAIGHT, SUGENO, SUM, UNION, Fis
from torquebench.kernel import Array, kernel, sat

TRACE = 1e-12
"""A rule that fires less than this does not fire."""


@kernel
def both(conjunction: int, a: float, b: float) -> float:
    """Return the degree of a AND b: their minimum (131), or their product."""
    if conjunction == PRODUCT:
        return a * b
    return a if a < b else b


@kernel
def one_of(conjunction: int, a: float, b: float) -> float:
    """Return the degree of a OR b, the dual of AND: their maximum, or a + b - a b."""
    if conjunction == PRODUCT:
        return a + b - a * b
    return a if a > b else b


@kernel
def floor_below(end: int, s: float) -> int:
    """Return the whole part of s >= 0, at most end - 1; 0 for NaN."""
    i = math.floor(s) if s > 0.0 else 0
    return i if i < end else end - 1


@kernel
def cell_of(last: int, x: float) -> int:
    """Return which of `last` equal parts of [-1, 1] holds x."""
    return floor_below(last, 0.5 * (x + 1.0) * last)


@kernel
def common(p: float, q: float) -> float:
    """Return the area that two neighbouring triangles clipped at p and q share, in units of their spacing.

    The smaller of p and q is at most 1/2, as of the rules that fire together only one fires above 1/2.
    """
    m = p if p < q else q
    return m * (1.0 - m)


# Written without branches, by factors 0 and 1, because a processor cannot guess which way they would go.
@kernel(inline=True)
def staircase(table: Array, conjunction: int, scale: float, offset: float, x: float, y: float) -> float:
    """Centre of area (136) of max-min (133) where each 2x2 cell of the rule table is a stair.

    A stair has the consequents b - 1 or b, then b twice on its anti-diagonal, then b or b + 1: as in clip(i + j). The
    two rules in the middle act as one, as strong as the stronger, and so does a third rule with the same consequent.

    Args:
        table: Centres of the consequents, (n1, n2).
        conjunction: MIN or PRODUCT.
        scale, offset: Spacing and middle of the output's terms.
        x, y: Inputs, within [-1, 1].
    """
    n, m = table.shape[0] - 1, table.shape[1] - 1
    i, j = cell_of(n, x), cell_of(m, y)
    u, v = 0.5 * (x + 1.0) * n - i, 0.5 * (y + 1.0) * m - j
    low, high = both(conjunction, 1.0 - u, 1.0 - v), both(conjunction, u, v)
    mixed, other = both(conjunction, 1.0 - u, v), both(conjunction, u, 1.0 - v)
    middle = mixed if mixed > other else other
    b = table[i, j + 1]
    fall, rise = b - table[i, j], table[i + 1, j + 1] - b
    third, fourth = low * (1.0 - fall), high * (1.0 - rise)
    middle = third if third > middle else middle
    middle = fourth if fourth > middle else middle
    low, high = low * fall, high * rise
    below, above = common(low, middle), common(middle, high)
    first, last = low * (2.0 - low), high * (2.0 - high)
    area = first + middle * (2.0 - middle) + last - below - above
    return offset + scale * (b + (last - first + 0.5 * (below - above)) / area)


@kernel
def four_rules(table: Array, conjunction: int, method: int, scale: float, offset: float, x: float, y: float) -> float:
    """Centre of area of max-min, or of the sum of the clipped consequents, for any table on even triangles.

    Args:
        table: Centres of the consequents, (n1, n2); NaN where there is no rule.
        conjunction: MIN or PRODUCT.
        method: UNION or SUM.
        scale, offset: Spacing and middle of the output's terms.
        x, y: Inputs, within [-1, 1].

    Returns:
        The centre; zero where no rule fires.
    """
    n, m = table.shape[0] - 1, table.shape[1] - 1
    i, j = cell_of(n, x), cell_of(m, y)
    u, v = 0.5 * (x + 1.0) * n - i, 0.5 * (y + 1.0) * m - j
    a, b, c, d = table[i, j], table[i, j + 1], table[i + 1, j], table[i + 1, j + 1]
    p, q = both(conjunction, 1.0 - u, 1.0 - v), both(conjunction, 1.0 - u, v)
    r, s = both(conjunction, u, 1.0 - v), both(conjunction, u, v)
    # on a term's peak rounding leaves its neighbour a trace, which must not count where the peak has no rule
    p, q = p if p > TRACE else 0.0, q if q > TRACE else 0.0
    r, s = r if r > TRACE else 0.0, s if s > TRACE else 0.0
    if a != a:
        a, p = 0.0, 0.0
    if b != b:
        b, q = 0.0, 0.0
    if c != c:
        c, r = 0.0, 0.0
    if d != d:
        d, s = 0.0, 0.0
    if method == UNION:
        # rules with the same consequent act as one, as strong as the strongest
        if b == a:
            p, q = p if p > q else q, 0.0
        if c == a:
            p, r = p if p > r else r, 0.0
        elif c == b:
            q, r = q if q > r else r, 0.0
        if d == a:
            p, s = p if p > s else s, 0.0
        elif d == b:
            q, s = q if q > s else s, 0.0
        elif d == c:
            r, s = r if r > s else s, 0.0
    e, f, g, h = p * (2.0 - p), q * (2.0 - q), r * (2.0 - r), s * (2.0 - s)
    area, moment = e + f + g + h, a * e + b * f + c * g + d * h
    if method == UNION:
        ab, ac, ad = shared(a, b, p, q), shared(a, c, p, r), shared(a, d, p, s)
        bc, bd, cd = shared(b, c, q, r), shared(b, d, q, s), shared(c, d, r, s)
        area -= ab + ac + ad + bc + bd + cd
        moment -= 0.5 * ((a + b) * ab + (a + c) * ac + (a + d) * ad + (b + c) * bc + (b + d) * bd + (c + d) * cd)
    if not area > 0.0:
        return 0.0
    return offset + scale * (moment / area)


@kernel
def shared(a: float, b: float, p: float, q: float) -> float:
    """Return the area that triangles with centres a and b, clipped at p and q, share: none unless neighbours."""
    return common(p, q) if abs(a - b) == 1.0 else 0.0


@kernel(inline=True)
def infer(fis: Fis, x: float, y: float) -> float:
    """Return the output of a fuzzy system, nominally in [-1, 1]; 0 where no rule fires.

    Args:
        fis: The system, see `prepare`.
        x, y: Its inputs, clipped to [-1, 1]; a system of one input ignores y. NaN gives NaN.
    """
    x, y = sat(x), sat(y)
    nothing = (x - x) + (y - y)  # 0, or NaN; a comparison here would cost more than all the rest
    if fis.method == STAIRCASE:
        return nothing + staircase(fis.table, fis.conjunction, fis.scale, fis.offset, x, y)
    if fis.method <= SUM:
        y = y if fis.inputs == 2 else -1.0
        return nothing + four_rules(fis.table, fis.conjunction, fis.method, fis.scale, fis.offset, x, y)
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
def logistic(s: float) -> float:
    """Return 1 / (1 + exp(-s)), without an exponential that overflows."""
    if s < 0.0:
        grown = math.exp(s)
        return grown / (1.0 + grown)
    return 1.0 / (1.0 + math.exp(-s))


@kernel
def curved(centre: float, width: float, slope: float, code: float, x: float) -> float:
    """Return the degree to which x is a curved term; arguments as in a row of `Fis.x_terms`."""
    z = (x - centre) / width
    if code == GAUSSIAN:
        return math.exp(-0.5 * z * z)
    if code == BELL:
        return logistic(-slope * math.log(abs(z))) if z != 0.0 else 1.0
    return logistic(slope * z)


@kernel
def membership(terms: Array, k: int, x: float) -> float:
    """Return the degree to which x is term k, a trapezoid or a curve; `terms` is (n, 5), as `Fis.x_terms`."""
    if terms[k, 4] != STRAIGHT:
        return curved(terms[k, 0], terms[k, 1], terms[k, 2], terms[k, 4], x)
    if x < terms[k, 1]:
        return (x - terms[k, 0]) / (terms[k, 1] - terms[k, 0]) if x > terms[k, 0] else 0.0
    if x > terms[k, 2]:
        return (terms[k, 3] - x) / (terms[k, 3] - terms[k, 2]) if x < terms[k, 3] else 0.0
    return 1.0


@kernel
def fill_memberships(terms: Array, x: Array, degrees: Array) -> None:
    """Fill `degrees` (N, n) with the degree to which each of `x` (N,) is each of `terms` (n, 5)."""
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
    for i in range(len(fis.either)):
        for j in range(fis.either.shape[1]):
            k = fis.either[i, j]
            if k >= 0:
                w = one_of(fis.conjunction, membership(fis.x_terms, i, x), membership(fis.y_terms, j, y))
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
    """Fill `degrees` (n1, n2) with how much the rules of each pair of terms fire; 0 where there is no rule.

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
    for i in range(len(fis.either)):
        for j in range(fis.either.shape[1]):
            if fis.either[i, j] >= 0:
                degrees[i, j] += one_of(fis.conjunction, membership(fis.x_terms, i, x), membership(fis.y_terms, j, y))
