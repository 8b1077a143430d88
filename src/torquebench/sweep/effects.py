"""Which of many inputs an output depends on: rank regression with intervals that hold for all of them at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy import stats

from torquebench.errors import ResultError
from torquebench.kernel import Array

TIED = 1.0 - 1e-6
"""Rank correlation from which on two inputs count as one."""
LEAST = 8
"""Fewest samples that are looked at."""


class Effect(NamedTuple):
    """How much an output rises with one input."""

    inputs: tuple[str, ...]
    """Name of the input; several where one cannot be told from the other: they rise, or fall, together."""
    strength: float
    """Standardised rank regression coefficient [1]: by how many standard deviations the output's rank rises with one
    of the first input's."""
    low: float
    """Lower end of its interval."""
    high: float
    """Upper end."""

    @property
    def matters(self) -> bool:
        """Whether the interval excludes zero."""
        return self.low > 0.0 or self.high < 0.0


class Effects(NamedTuple):
    """All effects on one output."""

    method: Literal["joint", "single"]
    """joint: one regression on all inputs; single: one for each by itself, where samples are too few for that."""
    explained: float | None
    """Share of the variance of the output's ranks that the inputs explain, adjusted for their number; only joint."""
    effects: tuple[Effect, ...]
    """The strongest first."""


def effects_on(
    output: Array, inputs: Mapping[str, Array], confidence: float = 0.95, tests: int | None = None
) -> Effects:
    """Regress an output's ranks on its inputs' ranks.

    With z standardised ranks, z_out = sum_j b_j z_j + noise; b by least squares, its interval b_j -+ t se_j with
    Student's t at 1 - (1 - confidence)/(2 tests) (Bonferroni), so that under pure noise all intervals together exclude
    zero nowhere with probability `confidence`. b is 1 where the output follows one input monotonically, and sum b^2
    is the explained share where the inputs are independent. An effect that first rises and then falls, or that lies in
    an interaction alone, is not seen. Iman and Conover, Technometrics 21 (1979), 499; Helton et al., Reliability
    Engineering & System Safety 91 (2006), 1175.

    The regression is joint with at least twice as many samples as inputs. With fewer, b_j is the rank correlation with
    input j alone and se_j = 1/sqrt(N - 1), its standard deviation over all orders of the samples, with the normal
    quantile: Student's finds too much in the far tail there.

    Inputs that do not vary are left out.

    Args:
        output: Samples of the output, (N,), finite.
        inputs: Name -> samples of an input, (N,), in the output's order; of several that are tied the first one counts.
        confidence: Probability that no interval misses its coefficient [1].
        tests: How many effects share this confidence; None for those of this output.

    Raises:
        ResultError: fewer than `LEAST` samples, an output that is always the same, or no input that varies.
    """
    if len(output) < LEAST:
        raise ResultError(f"{len(output)} draws are too few, wanted at least {LEAST}")
    if np.ptp(output) == 0.0:
        raise ResultError("it is the same in every draw")
    names, Z = _groups(inputs)
    if not names:
        raise ResultError("nothing that is drawn varies")
    n, k = Z.shape
    z = _standardised(output)
    level = 1.0 - 0.5 * (1.0 - confidence) / (tests or k)
    explained = None
    if n >= 2 * k and np.linalg.matrix_rank(Z.T @ Z) == k:
        b, half, explained = _regressed(z, Z, level)
    else:
        b = Z.T @ z / n
        half = np.full(k, stats.norm.ppf(level) / math.sqrt(n - 1))
    order = np.argsort(-np.abs(b), kind="stable")
    found = tuple(Effect(names[j], float(b[j]), float(b[j] - half[j]), float(b[j] + half[j])) for j in order.tolist())
    return Effects("single" if explained is None else "joint", explained, found)


def ranks(values: Array) -> Array:
    """Return the ranks along the last axis, 1 for the least; equal values share the mean of theirs."""
    return np.asarray(stats.rankdata(values, axis=-1))


def _standardised(values: Array) -> Array:
    centred = ranks(values) - 0.5 * (values.shape[-1] + 1)
    return np.asarray(centred / np.sqrt(np.mean(centred * centred, axis=-1, keepdims=True)))


def _groups(inputs: Mapping[str, Array]) -> tuple[list[tuple[str, ...]], Array]:
    """Return the inputs that vary, tied ones together, and the standardised ranks of the first of each, (N, k)."""
    varying = [name for name, values in inputs.items() if np.ptp(values) > 0.0]
    if not varying:
        return [], np.zeros((0, 0))
    Z = _standardised(np.array([inputs[name] for name in varying]))
    tied = np.abs(Z @ Z.T) >= TIED * Z.shape[1]
    first = np.argmax(tied, axis=1)
    kept = np.unique(first)
    return [tuple(varying[i] for i in np.flatnonzero(first == j)) for j in kept], Z[kept].T


def _regressed(z: Array, Z: Array, level: float) -> tuple[Array, Array, float]:
    """Return coefficients, half-widths of their intervals, and the explained share, adjusted."""
    n, k = Z.shape
    inverse = np.linalg.inv(Z.T @ Z)
    b = inverse @ (Z.T @ z)
    left = float(np.sum((z - Z @ b) ** 2)) / (n - k - 1)
    half = stats.t.ppf(level, n - k - 1) * np.sqrt(left * np.diag(inverse))
    return b, half, 1.0 - left * (n - 1) / n


def strongest(effects: Sequence[Effect], most: int) -> list[Effect]:
    """Return the effects that matter, and of the others as many of the strongest as fit into `most`."""
    found = [effect for effect in effects if effect.matters]
    rest = [effect for effect in effects if not effect.matters]
    return found + rest[: max(0, most - len(found))]
