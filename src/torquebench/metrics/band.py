"""Time in the boundary layer of laws that have one."""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array, kernel
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord


@kernel
def count_within(x: Array, limit: Array, out: Array) -> None:
    """Count the samples of x (N, n) with |x| <= limit (n,); NaN where a sample is not finite; out (n,)."""
    for k in range(len(x)):
        for i in range(len(out)):
            if abs(x[k, i]) <= limit[i]:
                out[i] += 1.0
            else:
                out[i] += 0.0 * x[k, i]


@metric("time_in_band", title="time in boundary layer", unit="1", better="higher", column="")
def time_in_band(run: JointRecord) -> Array:
    """Share of samples with abs(s) <= phi; none for a joint whose s is not always defined."""
    inside = np.zeros(len(run.tau_max))
    if run.phi is None:
        return inside + np.nan
    s = run.s[run.window]
    count_within(s, run.phi, inside)
    return inside / len(s)
