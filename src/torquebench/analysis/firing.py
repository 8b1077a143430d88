"""Which rules of a law's fuzzy system took part in a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from torquebench.errors import ResultError
from torquebench.fuzzy import Fis
from torquebench.fuzzy.inference import fill_activations
from torquebench.kernel import Array
from torquebench.sim.trajectory import Trajectory


def rule_shares(gains: Any, fis: Fis, inputs: Callable[..., tuple[float, float]] | None, run: Trajectory) -> Array:
    """Return how much each rule took part in a run, (n, n1, n2); of each joint the shares add up to 1.

    A rule's share is the mean over the control instants of its activation over the sum of all rules' activations.
    Where no rule fires, or the state is not finite, no rule gets anything.

    Args:
        gains: The gains the law received.
        fis: The fuzzy system in it.
        inputs: The law's own scaling of the system's inputs, `Rules.inputs`.
        run: The run; the inputs follow from what the law measured.

    Raises:
        ResultError: the law does not say how it scales the inputs.
    """
    if inputs is None:
        raise ResultError("the law's Rules do not say how it scales the inputs of its fuzzy system")
    e: Array = run.q_ref - run.q_meas
    de: Array = run.qd_ref - run.qd_meas
    shares = np.zeros((run.q.shape[1], *fis.rules.shape))
    fired: Array = np.zeros(fis.rules.shape)
    columns = 1 if fis.inputs == 1 else fired.shape[1]
    for k, i in np.argwhere(np.isfinite(e) & np.isfinite(de)).tolist():
        fill_activations(fis, *inputs(gains, i, float(e[k, i]), float(de[k, i])), fired)
        total = fired[:, :columns].sum()
        if total > 0.0:
            shares[i] += fired / (total * len(e))
    return shares
