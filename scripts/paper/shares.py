"""How much of the equivalent dynamics the fuzzy part of the proposed law supplies."""

from __future__ import annotations

import numpy as np

from torquebench.experiment.build import Loop
from torquebench.experiment.schema import Controller, Experiment
from torquebench.fuzzy.inference import fill_outputs
from torquebench.laws import find_law
from torquebench.robot import load_model
from torquebench.sim.trajectory import Trajectory

EVERY = 10
"""Control instants of which one is looked at."""


def fuzzy_share(experiment: Experiment, loop: Loop, keys: Controller, run: Trajectory) -> dict[str, float | None]:
    """Return 1 - sum (tau_eq - tau_fuzzy)^2 / sum tau_eq^2, the mean over joints: 1 for a perfect estimate.

    tau_eq is the inverse dynamics of the arm, without payload, along the reference; worse than none is negative.

    Args:
        experiment: What was run.
        loop: Its objects.
        keys: The controller; one without a fuzzy part has no share.
        run: Its run.
    """
    law = find_law(keys.law)
    if not law.rules or "kf" not in keys.gains:
        return {}
    ((field, rules),) = law.rules.items()
    if rules.inputs is None:
        return {}
    gains = next(c.gains for c in loop.controllers if c.name == keys.name)
    fis, window = getattr(gains, field), run.t >= experiment.run.metrics_from
    q, qd, q_ref, qd_ref, qdd_ref = (
        x[window][::EVERY] for x in (run.q_meas, run.qd_meas, run.q_ref, run.qd_ref, run.qdd_ref)
    )
    e, de = q_ref - q, qd_ref - qd
    joints = range(e.shape[1])
    x, y = np.array([rules.inputs(gains, i, e[k, i], de[k, i]) for k in range(len(e)) for i in joints]).T.copy()
    output = np.empty(len(x))
    fill_outputs(fis, x, y, output)
    supplied = gains.kf * np.asarray(loop.plant.tau_max) * output.reshape(e.shape)
    needed = load_model(experiment.plant.model).inverse_dynamics(q_ref, qd_ref, qdd_ref)
    left = np.sum((needed - supplied) ** 2, axis=0) / np.sum(needed**2, axis=0)
    return {"fuzzy_share": float(np.mean(1.0 - left))}
