"""Finds which of many inputs an output depends on, alone and in pairs: rank regression with simultaneous intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from torquebench.errors import ResultError
from torquebench.kernel import Array

TIED = 1.0 - 1e-6
"""Rank correlation from which on two inputs count as one."""
ROUNDING = 1e-9
"""Least half-width of an interval."""
LEAST = 8
"""Fewest samples that are looked at."""


class Effect(NamedTuple):
    """Effect on an output of one input, or of the product of two."""

    inputs: tuple[str, ...]
    """The input, or the two; the same twice for a square. Inputs that cannot be told apart share a name, ``a = b``."""
    strength: float
    """Standardised rank regression coefficient [1]: by how many standard deviations the output's rank rises with one
    of the input's rank, or of the product's; of tied inputs the first one counts."""
    low: float
    """Lower end of its interval."""
    high: float
    """Upper end."""

    @property
    def matters(self) -> bool:
        """Whether the interval excludes zero."""
        return self.low > 0.0 or self.high < 0.0

    @property
    def name(self) -> str:
        """The input, ``a x b``, or ``a^2``."""
        if len(self.inputs) == 2 and self.inputs[0] == self.inputs[1]:
            return f"{self.inputs[0]}^2"
        return " x ".join(self.inputs)


class Effects(NamedTuple):
    """All effects on one output."""

    method: Literal["joint", "single"]
    """joint: one regression on all inputs; single: one for each by itself, where samples are too few for that."""
    explained: float | None
    """Share of the variance of the output's ranks that the inputs explain, adjusted for their number, without their
    products; only joint."""
    pairs: int
    """Number of products that were looked at."""
    effects: tuple[Effect, ...]
    """Those of all inputs and of the products that matter, the strongest first."""


def effects_on(output: Array, inputs: Mapping[str, Array], confidence: float = 0.95, outputs: int = 1) -> Effects:
    """Regress an output's ranks on its inputs' ranks, and look at the products of two of them.

    With z standardised ranks, z_out = sum_j b_j z_j + noise; b by least squares, its interval b_j -+ t se_j. b is 1
    where the output follows one input monotonically, and sum b^2 is the explained share where the inputs are
    independent. Iman and Conover, Technometrics 21 (1979), 499; Helton et al., Reliability Engineering & System Safety
    91 (2006), 1175. With fewer than twice as many samples N as inputs, b_j is the rank correlation with input j alone
    and se_j = 1/sqrt(N - 1), its standard deviation over all orders of the samples, with the normal quantile: Student's
    finds too much in the far tail there.

    That alone is blind where an error is as bad upwards as downwards, or where one error makes up for another: the
    square of a sum of signed errors. Therefore products z_i z_j and squares z_i^2 are looked at one by one, against
    what the inputs leave of z_out (against z_out itself where they are too many). Input j has no part in a product
    whose strength the orders of z_j alone explain, with the output and z_i held: its standard deviation over all of
    them is that of r z_i over sqrt(N - 1), r what is left; the interval is the wider one of the two inputs', so that
    one that matters does not lend its effect to one that does not. Effects of third order are not seen.

    Half of the risk 1 - confidence goes to the inputs and half to the products, shared evenly (Bonferroni): under pure
    noise, nothing at all is found with probability `confidence`. Inputs that do not vary are left out.

    Args:
        output: Samples of the output, (N,), finite.
        inputs: Name -> samples of an input, (N,), in the output's order.
        confidence: Probability that no interval misses its coefficient [1].
        outputs: How many outputs share this confidence.

    Raises:
        ResultError: fewer than `LEAST` samples, an output that is always the same, or no input that varies.
    """
    from scipy import special

    if len(output) < LEAST:
        raise ResultError(f"{len(output)} draws are too few, wanted at least {LEAST}")
    if np.ptp(output) == 0.0:
        raise ResultError("it is the same in every draw")
    names, Z = _groups(inputs)
    if not names:
        raise ResultError("nothing that is drawn varies")
    k, n = Z.shape
    z = _standardised(output)
    risk = 0.25 * (1.0 - confidence) / outputs
    explained, left = None, z
    if n >= 2 * k and np.linalg.matrix_rank(Z @ Z.T) == k:
        b, half, explained, left = _regressed(z, Z.T, 1.0 - risk / k)
    else:
        b, half = Z @ z / n, np.full(k, special.ndtri(1.0 - risk / k) / math.sqrt(n - 1))
    found = [_effect((name,), *ends) for name, *ends in zip(names, b.tolist(), half.tolist(), strict=True)]
    places, b, spread = _products(left, Z)
    if places:
        half = special.ndtri(1.0 - risk / len(places)) * spread
        pairs = [((names[i], names[j]), *ends) for (i, j), *ends in zip(places, b.tolist(), half.tolist(), strict=True)]
        found += [effect for effect in (_effect(*pair) for pair in pairs) if effect.matters]
    found.sort(key=lambda effect: -abs(effect.strength))
    return Effects("single" if explained is None else "joint", explained, len(places), tuple(found))


def _effect(inputs: tuple[str, ...], strength: float, half: float) -> Effect:
    half = max(half, ROUNDING)  # an exact fit leaves nothing but that
    return Effect(inputs, strength, strength - half, strength + half)


def ranks(values: Array) -> Array:
    """Return the ranks along the last axis, 1 for the least; equal values share the mean of theirs, NaN is the last."""

    def in_a_row(row: Array) -> Array:
        _, place, counts = np.unique(row, return_inverse=True, return_counts=True)
        return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[place])

    return np.apply_along_axis(in_a_row, -1, values)


def _standardised(values: Array) -> Array:
    centred = ranks(values) - 0.5 * (values.shape[-1] + 1)
    return np.asarray(centred / np.sqrt(np.mean(centred * centred, axis=-1, keepdims=True)))


def _groups(inputs: Mapping[str, Array]) -> tuple[list[str], Array]:
    """Return the inputs that vary, tied ones together, and the standardised ranks of the first of each, (k, N)."""
    varying = [name for name, values in inputs.items() if np.ptp(values) > 0.0]
    if not varying:
        return [], np.zeros((0, 0))
    Z = _standardised(np.array([inputs[name] for name in varying]))
    tied = np.abs(Z @ Z.T) >= TIED * Z.shape[1]
    first = np.argmax(tied, axis=1)
    kept = np.unique(first)
    return [" = ".join(varying[i] for i in np.flatnonzero(first == j)) for j in kept], Z[kept]


def _products(left: Array, Z: Array) -> tuple[list[tuple[int, int]], Array, Array]:
    """Return pairs of inputs, the strength of their product, and its standard deviation where one has no part in it.

    Args:
        left: What is left of the output's ranks, (N,).
        Z: Standardised ranks of the inputs, (k, N).
    """
    i, j = np.triu_indices(len(Z))
    squares = Z * Z - 1.0
    size = np.sqrt(np.mean(squares * squares, axis=1))
    varies = (i != j) | np.array([len(np.unique(z)) > 2 for z in Z])[i]  # an input with two values has no square
    i, j = i[varies], j[varies]
    n, weighted = len(left), left * Z
    strength = (weighted @ Z.T)[i, j] / n
    alone = np.std(weighted, axis=1)
    spread = np.maximum(alone[i], alone[j]) / math.sqrt(n - 1)
    own = i == j
    strength[own] = squares[i[own]] @ left / (n * size[i[own]])
    spread[own] = np.std(left) / math.sqrt(n - 1)
    return list(zip(i.tolist(), j.tolist(), strict=True)), strength, spread


def _regressed(z: Array, Z: Array, level: float) -> tuple[Array, Array, float, Array]:
    """Return coefficients, half-widths, the explained share, adjusted, and what is left for products, (N,)."""
    from scipy import special

    n, k = Z.shape
    inverse = np.linalg.inv(Z.T @ Z)
    b = inverse @ (Z.T @ z)
    left = z - Z @ b
    variance = float(np.sum(left * left)) / (n - k - 1)
    half = special.stdtrit(n - k - 1, level) * np.sqrt(variance * np.diag(inverse))
    # of a product about as large a share goes into the inputs as there are of them: what is left of it is given back
    return b, half, 1.0 - variance * (n - 1) / n, left * n / (n - k)


def strongest(effects: Sequence[Effect], most: int) -> list[Effect]:
    """Return the effects that matter, and of the others as many of the strongest as fit into `most`."""
    found = [effect for effect in effects if effect.matters]
    rest = [effect for effect in effects if not effect.matters]
    return found + rest[: max(0, most - len(found))]


def ranked(effects: Sequence[Effect]) -> list[str]:
    """Return the inputs that matter, by the sum of the squared strengths of what they matter in."""
    share: dict[str, float] = {}
    for effect in effects:
        for name in dict.fromkeys(effect.inputs) if effect.matters else ():
            share[name] = share.get(name, 0.0) + effect.strength**2
    return sorted(share, key=lambda name: -share[name])
