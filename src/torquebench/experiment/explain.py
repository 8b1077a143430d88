"""Explains what went wrong in a run: a line for each controller, with the causes that its data support, in numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from torquebench.certificates import LONGER
from torquebench.experiment import schema
from torquebench.experiment.arm import planned_range, planned_speed
from torquebench.experiment.build import Loop
from torquebench.experiment.certify import TOO_MUCH, Coarse, Flag, Overdriven, flags, planned_torque, sliding_law
from torquebench.experiment.controllers import Controller
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.laws import find_law
from torquebench.metrics import Metrics
from torquebench.metrics.shaking import shaking
from torquebench.metrics.torque import SATURATED
from torquebench.robot.flat_model import SLIDE
from torquebench.sim.signals import control_instants
from torquebench.sim.trajectory import Outcome, Trajectory

ALLOWED = 1.0 / 3.0
"""Most lambda times delay for which the delay is no cause [1]: Slotine and Li, Applied Nonlinear Control, 7.2."""
NONE = "its data support none of the usual causes: see torquebench why"


def explained(
    experiment: schema.Experiment,
    loop: Loop,
    runs: Mapping[str, Trajectory],
    metrics: Mapping[str, Metrics],
    certified: Mapping[str, Mapping[str, Any]],
) -> list[str]:
    """Return a line for each controller whose run shows a symptom, with the causes that its data support.

    Symptoms are: it fails, errs by more than its motion, never reaches its surface, limit-cycles, saturates. Where the
    data support no cause, the first three are told all the same.

    Args:
        experiment: What was run.
        loop: Its objects.
        runs: Controller name -> its run.
        metrics: Controller name -> its metrics, where it completed.
        certified: Controller name -> headline figures of its certificates, where it has some.
    """
    found, lines = list[Flag | Coarse | Overdriven](), list[str]()
    infeasible: list[str] | None = None
    for keys in experiment.controllers:
        run = runs[keys.name]
        seen = dict(_symptoms(experiment, loop, run, metrics.get(keys.name), certified.get(keys.name, {})))
        if not seen:
            continue
        if infeasible is None:
            found, infeasible = list(flags(experiment, loop)), _infeasible(experiment, loop)
        own = [each for each in found if each.controller == keys.name]
        causes = list(dict.fromkeys(_causes(experiment, loop, keys, run, seen, own, infeasible)))
        if causes or seen.keys() - {"limit-cycles", "saturates"}:
            lines.append(f"controller '{keys.name}' {' and '.join(seen.values())}: {'; '.join(causes) or NONE}")
    return lines


def _symptoms(
    experiment: schema.Experiment, loop: Loop, run: Trajectory, metrics: Metrics | None, certified: Mapping[str, Any]
) -> Iterator[tuple[str, str]]:
    """Yield what a run shows, by name."""
    names, kind = loop.joint_names, loop.model.flat.kind
    if not run.completed and run.outcome is not Outcome.CONTROLLER_ERROR:
        yield "fails", f"fails: {run.ending}"
    if metrics is not None:
        span = np.max(np.abs(loop.reference.q - loop.initial_q), axis=0)
        span = np.where(span > 0.0, span, np.max(span))
        rmse = np.array([value or 0.0 for value in metrics["rmse"].per_joint])
        far = rmse / np.where(span > 0.0, span, np.inf)
        worst = int(np.argmax(far))
        if far[worst] > 1.0:
            unit = "m" if kind[worst] == SLIDE else "rad"
            yield (
                "errs",
                f"errs by {rmse[worst]:.3g} {unit} on {names[worst]}, whose motion is {span[worst]:.3g} {unit}",
            )
    outside = certified.get("reaching_from") is not None and certified.get("reaching_time") is None
    if outside and certified["no_bound"] != LONGER and len(certified["too_wide"]) < len(names):
        yield "misses", "never reaches its surface"
    shakes = None if metrics is None else shaking(metrics, loop.plant.tau_max.tolist())
    if shakes is not None and shakes.is_cycle:
        yield "limit-cycles", f"limit-cycles at {shakes.frequency:.3g} Hz on {names[shakes.joint]}"
    share = _saturated(loop, run)
    if np.max(share) >= SATURATED:
        at = int(np.argmax(share))
        yield "saturates", f"saturates ({names[at]} {100.0 * share[at]:.3g} % of the whole run)"


def _saturated(loop: Loop, run: Trajectory) -> Array:
    """Return the share of the instants at which each joint's torque is at its limit, (n,) [1]."""
    share: Array = np.mean(np.abs(run.tau) >= np.asarray(loop.plant.tau_max) * (1.0 - 1e-12), axis=0)
    return share


def _infeasible(experiment: schema.Experiment, loop: Loop) -> list[str]:
    """Return what the arm cannot do of its reference, and that it cannot hold itself."""
    t = control_instants(experiment.n_steps, experiment.run.control_period)
    speed = planned_speed(experiment, t, loop.reference.qd)
    reach = planned_range(experiment, t, loop.reference.q) if experiment.plant.limits == "stop" else []
    return [*planned_torque(experiment, loop), *speed, *reach]


def _causes(
    experiment: schema.Experiment,
    loop: Loop,
    keys: Controller,
    run: Trajectory,
    seen: Mapping[str, str],
    found: Sequence[Flag | Coarse | Overdriven],
    infeasible: Sequence[str],
) -> Iterator[str]:
    """Yield the causes that a run's data support."""
    names, n, period = loop.joint_names, experiment.n, experiment.run.control_period
    follows = seen.keys() & {"fails", "errs", "misses"}
    share = _saturated(loop, run)
    worst = int(np.argmax(share))
    if share[worst] >= SATURATED and follows:
        yield f"the torque limit of {names[worst]}"
    if follows or "saturates" in seen:
        yield from infeasible if share[worst] >= SATURATED else (x for x in infeasible if not x.startswith(TOO_MUCH))
    for each in found:
        if follows or not isinstance(each, Flag):
            yield each.cause
    chain, gains = experiment.chain, keys.gains
    delay = chain.reaction(period) - period
    unit = find_law(keys.law).gains["lam"].unit if "lam" in gains else ""
    if unit == "1/s" and delay > 0.0:
        lam = float(np.max(as_vector(gains["lam"], n)))
        if lam * delay > ALLOWED:
            yield (
                f"what is late in the loop, {1e3 * delay:.3g} ms, is more than lambda = {lam:.4g} 1/s allows, "
                f"1/(3 lambda) = {1e3 * ALLOWED / lam:.3g} ms"
            )
    law = sliding_law(keys, loop, n)
    if law is not None and law.phi is not None and follows:
        span = np.max(np.abs(loop.reference.q - loop.initial_q), axis=0)
        edge = law.phi / law.lam
        wide = edge / np.where(span > 0.0, span, np.max(span) or 1.0)
        j = int(np.argmax(wide))
        if wide[j] > 1.0:
            yield (
                f"the layer of {names[j]} is wider than its motion: phi = {law.phi[j]:.4g} lets it err by phi/lambda = "
                f"{edge[j]:.3g}"
            )
