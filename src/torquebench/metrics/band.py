"""Time in the boundary layer of laws that have one."""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord


@metric("time_in_band", title="time in boundary layer", unit="1", better="higher", column="")
def time_in_band(run: JointRecord) -> Array:
    """Share of samples with abs(s) <= phi; none for a joint whose s is not always defined."""
    if run.phi is None:
        return np.full(len(run.tau_max), np.nan)
    s = run.s[run.window]
    share: Array = np.count_nonzero(np.abs(s) <= run.phi, axis=0) / len(s)
    share[~np.isfinite(s).all(axis=0)] = np.nan
    return share
