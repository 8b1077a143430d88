"""Time in the boundary layer of laws that have one."""

from __future__ import annotations

import numpy as np

from torquebench.kernel import Array
from torquebench.metrics.declare import metric
from torquebench.metrics.record import JointRecord, pieces


@metric("time_in_band", title="time in boundary layer", unit="1", better="higher", column="")
def time_in_band(run: JointRecord) -> Array:
    """Share of samples with abs(s) <= phi; none for a joint whose s is not always defined."""
    if run.phi is None:
        return np.full(len(run.tau_max), np.nan)
    s = run.s[run.window]
    inside, known = np.zeros(len(run.tau_max), dtype=np.intp), np.ones(len(run.tau_max), dtype=bool)
    for piece in pieces(s):
        inside += np.count_nonzero(np.abs(s[piece]) <= run.phi, axis=0)
        known &= np.isfinite(s[piece]).all(axis=0)
    return np.where(known, inside / len(s), np.nan)
