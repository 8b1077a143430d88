"""Causes that a test has put there are named, and no others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from torquebench.diagnosis import diagnose
from torquebench.diagnosis.seen import grows
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.robot import load_model
from torquebench.sim.trajectory import SIGNALS, Trajectory

SINE = {"kind": "sine", "amplitude": [1.0, -0.8], "frequency_hz": 0.5}
PLANT = {"engine": "analytic", "model": "two-link"}
NOISE = {"encoder_noise": 2e-4, "velocity": "differentiated"}
FRICTION = {**PLANT, "friction": {"coulomb": 6.0, "speed": 0.05}}
BIAS = [{"kind": "bias", "value": [15.0, 8.0]}]
FILTERED = {"velocity": "differentiated", "velocity_filter": 100.0}
"""A filter that a loop bears: where delay makes it swing from limit to limit it swings less without the filter."""
CURRENT = {"frequency": 25.0, "damping": 0.5}


def pd(kv: float, law: str = "pd-gravity", lam: float = 10.0) -> dict[str, Any]:
    """Return a PD controller of the arm's gravity."""
    return {"name": "c", "law": law, "gains": {"lam": lam, "kv": kv}}


def sliding(k: float = 0.3, phi: float | None = None, **more: Any) -> dict[str, Any]:
    """Return a sliding-mode controller, with a layer if `phi` is given."""
    layer = {} if phi is None else {"phi": phi}
    kind = "sign" if phi is None else "saturation"
    return {"name": "c", "law": "smc", "switching": kind, "gains": {"lam": 10.0, "k": k, **layer}, **more}


def experiment(controller: dict[str, Any], **sections: Any) -> Experiment:
    """Return an experiment with one controller on the two-joint arm, of 3 s at 1 ms unless told otherwise."""
    run = {"duration": 3.0, **sections.pop("run", {})}
    parts = {"name": "seeded", "plant": PLANT, "controllers": [controller], "reference": SINE, "run": run}
    return Experiment.from_dict({**parts, **sections})


def ids(cases: Iterable[tuple[Any, ...]]) -> list[str]:
    """Return the names of cases: their causes and place."""
    return [f"{i}-{'+'.join(sorted(case[0])) or 'none'}" for i, case in enumerate(cases)]


# M s^2 + Kp + Kd s/(1 + s/w) is stable for every w: a velocity filter shakes only together with the hold
SEEDED: list[tuple[set[str], dict[str, Any], dict[str, Any]]] = [
    ({"command_delay"}, pd(60), {"chain": {**FILTERED, "command_delay": 0.04}}),
    ({"command_delay"}, pd(60), {"chain": {"command_delay": 0.02}}),
    ({"command_delay"}, pd(120), {"chain": {"command_delay": 0.01}}),
    ({"measurement_delay"}, pd(60), {"chain": {"measurement_delay": 0.02}}),
    ({"torque_delay"}, pd(60), {"chain": {"torque_delay": 0.02}}),
    ({"actuator_lag"}, pd(200), {"chain": {"actuator_lag": 0.15}}),
    ({"current_loop"}, pd(60), {"chain": {"current_loop": CURRENT}}),
    ({"velocity", "control_period"}, pd(200), {"chain": {"velocity": "differentiated", "velocity_filter": 15.0}}),
    ({"velocity", "control_period"}, pd(200), {"chain": {"velocity": "tachometer", "velocity_filter": 3.0}}),
    ({"noise"}, pd(20), {"chain": NOISE}),
    ({"noise"}, pd(15), {"chain": {**NOISE, "encoder_noise": 1e-3}}),
    ({"noise"}, pd(20), {"chain": {"velocity": "tachometer", "velocity_noise": 0.2}}),
    ({"quantisation"}, pd(20), {"chain": {"quantisation": 1e-3, "velocity": "differentiated"}}),
    ({"torque_quantum"}, pd(20), {"chain": {"torque_quantum": 5.0}}),
    ({"torque_rate"}, pd(40), {"chain": {"torque_rate": 100.0}}),
    ({"control_period"}, pd(100), {"run": {"control_period": 0.02}}),
    ({"control_period"}, pd(200), {"run": {"control_period": 0.01}}),
    ({"control_period"}, sliding(0.3, 0.1, equivalent_control=True), {"run": {"control_period": 0.01}}),
    ({"law"}, sliding(0.3, equivalent_control=True), {}),
    ({"law"}, sliding(0.5, equivalent_control=True), {}),
    ({"law"}, sliding(0.3, equivalent_control=True), {"chain": {"command_delay": 0.001}}),
    ({"gravity"}, pd(10, "pd"), {"reference": {"kind": "step", "target": 0.5, "at": 0.2}, "run": {"duration": 4.0}}),
    ({"gravity"}, pd(20, "pd", 5.0), {}),
    ({"friction"}, pd(12), {"plant": FRICTION}),
    ({"payload"}, pd(10), {"plant": {**PLANT, "payload": {"mass": 5.0}}}),
    ({"disturbances"}, pd(12), {"disturbances": BIAS}),
    ({"torque_limit"}, pd(20), {"reference": {**SINE, "amplitude": [1.5, -1.5], "frequency_hz": 1.5}}),
    ({"noise", "friction"}, pd(12), {"chain": NOISE, "plant": FRICTION}),
    ({"noise", "disturbances"}, pd(12), {"chain": NOISE, "disturbances": BIAS}),
    ({"command_delay", "measurement_delay"}, pd(60), {"chain": {"command_delay": 0.01, "measurement_delay": 0.01}}),
    (
        {"quantisation", "payload"},
        pd(10),
        {
            "chain": {"quantisation": 1e-3, "velocity": "differentiated"},
            "plant": {**PLANT, "payload": {"mass": 5.0}},
        },
    ),
]


def one_of_each(cases: list[tuple[Any, ...]]) -> list[Any]:
    """Return cases as parameters with their names; those of whose causes each was met before are slow."""
    met, found = set[str](), []
    for (causes, *rest), name in zip(cases, ids(cases), strict=True):
        again = bool(causes) and causes <= met
        met |= causes
        found.append(pytest.param(causes, *rest, id=name, marks=[pytest.mark.slow] * again))
    return found


@pytest.mark.parametrize(("causes", "controller", "sections"), one_of_each(SEEDED))
def test_seeded_causes_are_named_and_no_others(
    causes: set[str], controller: dict[str, Any], sections: dict[str, Any]
) -> None:
    """Each cause that was put there is named, with a remedy or a number for it, and nothing else is."""
    found = diagnose(experiment(controller, **sections))
    assert {cause.key for cause in found.causes} == causes, found.sentence
    assert found.causes[0].title.rstrip(",") in found.sentence


@pytest.mark.parametrize(
    "chain",
    [
        "ideal",
        {"command_delay": 0.002, "actuator_lag": 0.002},
        {"encoder_noise": 1e-7, "velocity": "differentiated", "velocity_filter": 500.0},
        {"torque_rate": 5000.0, "quantisation": 1e-6},
    ],
)
def test_nothing_is_named_where_nothing_is_wrong(chain: Any) -> None:
    """A controller that follows quietly has no symptom and no cause, whatever its chain has in it."""
    found = diagnose(experiment(pd(20), chain=chain))
    assert found.symptoms == found.causes == ()
    assert "does not shake" in found.sentence


def test_what_gravity_leaves_counts_the_drives() -> None:
    """The sag is weight over the torque that drives give for 1 rad: twice that of whole ones where they give half."""
    step = {"reference": {"kind": "step", "target": 0.5, "at": 0.2}, "run": {"duration": 4.0}}
    found = diagnose(experiment(pd(20, "pd"), chain={"torque_gain": 0.5}, **step))
    (gravity,) = (cause for cause in found.causes if cause.key == "gravity")
    arm = load_model("two-link")
    sags = np.abs(arm.gravity(np.full(2, 0.5))) / (0.5 * 20.0 * 10.0 * arm.flat.inertia_scale)
    assert gravity.detail == f"gravity / Kp = {sags[found.seen.joint('errs')]:.2g} rad"


T = np.arange(3000) * 1e-3
ERRORS = {
    "swings": (0.6 * np.cos(np.pi * (T - 2.5)) + 0.3 * np.cos(2.0 * np.pi * (T - 2.5)), False),
    "oscillates": (1.0 + 1e-3 * np.exp(2.0 * T) * np.cos(40.0 * T), True),
    "creeps": (1e-3 * np.exp(T), True),
    "settles": (np.exp(-T), False),
    "hardly is": (1e-7 * np.exp(T), False),
}
"""Error, and whether it grows by half of the window from 1 s on."""


@pytest.mark.parametrize(("e", "strays"), ERRORS.values(), ids=ERRORS)
def test_an_error_strays_that_grows_and_not_one_that_swings(e: Array, strays: bool) -> None:
    """Half of a steady swing of 0.5 Hz may be flat, and half its crest; what grows, swinging or creeping, strays.

    A ten-thousandth of a milliradian says nothing, whatever it does: the hold leaves as much of a motion.
    """
    column = e[:, None]
    still = dict.fromkeys(SIGNALS, np.zeros_like(column))
    assert grows(Trajectory(T, **still | {"q_ref": column}), 1.0, 8.0) == (False, strays)
