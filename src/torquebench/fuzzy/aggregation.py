"""The paper's seven aggregations: how the rules' consequents become one fuzzy set.

Each is read as (over the rules) - (activation with consequent). With w_r the activation of rule r, mu_r(u) the
membership of its consequent, and r over **all** rules of the base:

| name | set mu_U(u) |
|---|---|
| `max-min` (133) | max_r min(w_r, mu_r) |
| `sum-min` (134) | sum_r min(w_r, mu_r), not limited to 1 |
| `max-bounded-product` | max_r max(0, w_r + mu_r - 1) |
| `max-drastic-product` | max_r (w_r where mu_r = 1; mu_r where w_r = 1; else 0) |
| `max-bounded-sum` | max_r min(1, w_r + mu_r) |
| `max-algebraic-sum` | max_r (w_r + mu_r - w_r mu_r) |
| `min-max` | min_r max(1 - w_r, mu_r) |

Only the first two have an equation in the paper. In the two sums a rule that does not fire still contributes its whole
consequent. Read without the 1 -, `min-max` is zero everywhere as soon as two consequents are disjoint; as written it is
the dual of `max-min`, "not w or mu". The drastic product of a triangle is a spike at its peak unless w = 1, so it
exists on points only, and the peaks must be among them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from torquebench.kernel import Array

ONE = 1.0 - 1e-9
"""A degree from here on counts as 1 in the drastic product: peaks on a grid of output points are off by rounding."""

POINTS = 361
"""Points of the output's universe, evenly spaced from the lowest foot to the highest, unless told otherwise."""

Combine: TypeAlias = Callable[[Array, Array], Array]


class Aggregation(NamedTuple):
    """One of the seven."""

    over_rules: np.ufunc
    """How the rules' sets are joined."""
    combine: Combine
    """Activation w and membership mu of the consequent -> membership of the rule's set; never falls as w grows, except
    with `min-max`, where it never rises."""


def _drastic(w: Array, mu: Array) -> Array:
    return np.where(mu >= ONE, w, np.where(w >= ONE, mu, 0.0))


AGGREGATIONS: dict[str, Aggregation] = {
    "max-min": Aggregation(np.fmax, np.fmin),
    "sum-min": Aggregation(np.add, np.fmin),
    "max-bounded-product": Aggregation(np.fmax, lambda w, mu: np.fmax(0.0, w + mu - 1.0)),
    "max-drastic-product": Aggregation(np.fmax, _drastic),
    "max-bounded-sum": Aggregation(np.fmax, lambda w, mu: np.fmin(1.0, w + mu)),
    "max-algebraic-sum": Aggregation(np.fmax, lambda w, mu: w + mu - w * mu),
    "min-max": Aggregation(np.fmin, lambda w, mu: np.fmax(1.0 - w, mu)),
}
