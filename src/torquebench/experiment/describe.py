"""What was run, in words: beside every figure, on the terminal and in the metrics."""

from __future__ import annotations

from typing import Any, NamedTuple

from torquebench.experiment.build import names_used, systems_of
from torquebench.experiment.scenario_schema import (
    BandLimitedNoise,
    Bias,
    Chain,
    Disturbance,
    Mismatch,
    Sinusoid,
)
from torquebench.experiment.schema import AnalyticPlant, Experiment, slide_joints
from torquebench.fuzzy import BUILTIN, Prepared, prepare
from torquebench.fuzzy.lint import lint
from torquebench.keys import Vector


def conditions_text(experiment: Experiment) -> str:
    """Return what was run, in two lines: plant, belief, motion; sampling, sensors and disturbances."""
    plant, belief, run = experiment.plant, experiment.model, experiment.run
    form = f":{plant.structure}:{plant.constants}" if isinstance(plant, AnalyticPlant) else ""
    drawn = f"; seed {run.seed}, draw {run.draw}" if experiment.is_drawn else ""
    start = "" if run.initial_q == "home" else f"; start {run.initial_q}"
    return (
        f"plant {plant.engine}:{plant.model}{form} ({plant.integrator}, {1e3 * plant.timestep:g} ms)"
        f"{burden_text(experiment)}; "
        f"model {belief.structure}/{belief.constants}{mismatch_text(experiment)}; "
        f"reference {experiment.reference.kind}{start}\n"
        f"control period {1e3 * run.control_period:g} ms; chain {chain_text(experiment)}; "
        f"disturbance: {noise_text(experiment)}{drawn}; metrics from {run.metrics_from:g} s"
    )


class Units(NamedTuple):
    """How what acts on joints, and what is measured of them, is written."""

    torque: str
    viscous: str
    milli: str
    what: str


TURN = Units("N m", "N m s/rad", "mrad", "torque")
SLIDE = Units("N", "N s/m", "mm", "force")


def units_of(experiment: Experiment) -> Units:
    """Return the units of an experiment's joints, both where some turn and some slide."""
    kinds = dict.fromkeys(SLIDE if slides else TURN for slides in slide_joints(experiment.plant.model))
    return Units(*(" or ".join(texts) for texts in zip(*kinds, strict=True)))


def burden_text(experiment: Experiment) -> str:
    """Return what the plant has that the belief does not know of."""
    units = units_of(experiment)
    payload, friction, perturb = experiment.plant.payload, experiment.plant.friction, experiment.plant.perturb
    text = "" if perturb is None else f", links perturbed up to {100 * perturb.relative:g} %"
    if payload is not None:
        place = f" at {_numbers(payload.offset)} m" if any(payload.offset) else ""
        text += f", payload {payload.mass:g} kg{place}" + (f" from {payload.at:g} s" if payload.at > 0 else "")
    if friction is not None:
        text += f", friction viscous {_numbers(friction.viscous)} {units.viscous}"
        text += f", Coulomb {_numbers(friction.coulomb)} {units.torque}"
    return text


def mismatch_text(experiment: Experiment) -> str:
    """Return what is wrong on purpose with the belief."""
    match experiment.model.mismatch:
        case Mismatch(relative=float(relative)):
            return f", mismatch +-{100 * relative:g} %"
        case Mismatch(tolerance=float(tolerance)):
            return f", constants drawn within {tolerance:g} tolerances"
        case Mismatch(constants=dict(factors)):
            return ", mismatch " + " ".join(f"{name} x {factor:g}" for name, factor in factors.items())
    return ""


def chain_text(experiment: Experiment) -> str:
    """Return the chain's name, or its imperfections."""
    chain = experiment.chain
    if not isinstance(chain, Chain):
        return chain
    units = units_of(experiment)
    parts = [f"noise {1e3 * chain.encoder_noise:g} {units.milli}"] * (chain.encoder_noise > 0)
    parts += [f"encoder step {1e3 * chain.quantisation:g} {units.milli}"] * (chain.quantisation > 0)
    if chain.velocity == "differentiated":
        filtered = "" if chain.velocity_filter is None else f", filtered at {chain.velocity_filter:g} rad/s"
        parts.append(f"velocity differentiated{filtered}")
    parts += [f"delay {1e3 * chain.delay:g} ms"] * (chain.delay > 0)
    parts += [f"actuator lag {1e3 * chain.actuator_lag:g} ms"] * (chain.actuator_lag > 0)
    return f"({', '.join(parts)})" if parts else "ideal"


def noise_text(experiment: Experiment) -> str:
    """Return the definition of every disturbance in words; it moves results more than the choice of law."""
    units = units_of(experiment)
    return "; ".join(_disturbance_text(d, units) for d in experiment.disturbances) or "none"


def _disturbance_text(disturbance: Disturbance, units: Units) -> str:
    match disturbance:
        case BandLimitedNoise(sigma=sigma, hold=hold, clip_sigma=clip):
            held = f"{units.what} noise held {1e3 * hold:g} ms"
            return f"{held}, Gaussian, sigma {_numbers(sigma)} {units.torque}, clipped at {clip:g} sigma"
        case Bias(value=value):
            return f"constant {units.what} {_numbers(value)} {units.torque}"
        case Sinusoid(rms=rms, amplitude=amplitude, frequency_hz=frequency):
            size = f"amplitude {_numbers(amplitude)}" if amplitude is not None else f"RMS {_numbers(rms or 0.0)}"
            return f"sinusoidal {units.what}, {size} {units.torque}, {_numbers(frequency)} Hz"


def _numbers(vector: Vector) -> str:
    return " ".join(f"{x:g}" for x in (vector if isinstance(vector, tuple) else (vector,)))


def fuzzy_in_use(experiment: Experiment) -> dict[str, Prepared]:
    """Return the fuzzy systems that an experiment's controllers use, by name."""
    systems = systems_of(experiment)
    return {name: prepare(systems[name]) for name in names_used(experiment)}


def fuzzy_facts(experiment: Experiment) -> dict[str, dict[str, Any]]:
    """Return how each fuzzy system in use is evaluated, for the manifest and for ``--json``."""
    systems = fuzzy_in_use(experiment)
    return {name: {"method": system.method, "error_bound": system.bound} for name, system in systems.items()}


def fuzzy_remarks(experiment: Experiment) -> list[str]:
    """Return a line for each fuzzy system in use, saying how it is evaluated, and one for each warning about it."""
    lines = []
    for name, prepared in fuzzy_in_use(experiment).items():
        lines.append(f"fuzzy system {name}: {evaluation(prepared)}")
        # lint has nothing to say of the built-in ones, and asking it compiles what the run itself may not need
        lines += [f"fuzzy system {name}: {finding}" for finding in ([] if name in BUILTIN else lint(prepared))]
    return lines


def evaluation(prepared: Prepared) -> str:
    """Return how a fuzzy system is evaluated, and how far that is from its definition at most."""
    if prepared.bound == 0.0:
        return prepared.method
    return f"{prepared.method}, error at most {prepared.bound:.2g} of the output's 1"
