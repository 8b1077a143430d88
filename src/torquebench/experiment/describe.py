"""Describes in words what was run: the text beside every figure, on the terminal and in the metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.experiment.build import names_used, systems_of
from torquebench.experiment.schema import Experiment, slide_joints
from torquebench.fuzzy import BUILTIN, Prepared, prepare
from torquebench.fuzzy.lint import lint
from torquebench.keys import Units
from torquebench.laws import Law, find_law
from torquebench.robot import load_model
from torquebench.tuning import friction_text


def chosen_text(experiment: Experiment) -> list[str]:
    """Return a line for each controller with gains that were chosen: what they are, by joint where they differ.

    Of a user's law it also says whether it was taken for one with a model, on which the gains depend; and of an arm
    whose file has friction, what the gains leave of it.
    """
    if not experiment.chosen:
        return []
    arm, slides = load_model(experiment.plant.model), slide_joints(experiment.plant.model)
    lines, run = [], experiment.run
    for keys in experiment.controllers:
        law = find_law(keys.law)
        gains, units = [], law.gains
        for name in experiment.chosen.get(keys.name, ()):
            value, unit = keys.gains[name], "" if units[name].unit == "1" else f" {units[name].unit}"
            if "rad" in unit and any(slides):
                straight = unit.replace("rad", "m")
                unit = straight if all(slides) else f"{unit} ({straight.strip()} for slides)"
            numbers = f"[{', '.join(f'{x:g}' for x in value)}]" if isinstance(value, tuple) else f"{value:g}"
            gains.append(f"{name} {numbers}{unit}")
        if gains:
            where = f"{experiment.plant.model} at {1e3 * run.control_period:g} ms"
            taken = "" if law.ships else f"; {model_text(law, keys.options)}"
            fit = law.fit(arm, run.control_period, experiment.chain, keys.options, keys.gains)
            own = keys.gains.keys() - set(experiment.chosen[keys.name])
            taken += f"; {left}" if (left := friction_text(fit, arm.joint_names, slides, own)) else ""
            lines.append(f"controller '{keys.name}': gains chosen for {where}: {', '.join(gains)}{taken}")
    return lines


def model_text(law: Law, options: Mapping[str, str | bool]) -> str:
    """Return whether a user's law was taken for one that cancels the arm's dynamics, and what says otherwise."""
    has, told = law.has_model(options), law.declared_model is not None
    if told:
        return f"chosen as for a law with{'' if has else 'out'} a model, as has_model of @controller says"
    calls = (
        "calls inverse_dynamics or what makes it up" if has else "calls neither inverse_dynamics nor what makes it up"
    )
    if "equivalent_control" in law.options:
        calls = f"has equivalent_control: {str(has).lower()}"
    return (
        f"chosen as for a law with{'' if has else 'out'} a model, as it {calls}: "
        f"@controller(..., has_model={not has}) would say otherwise"
    )


def conditions_text(experiment: Experiment) -> str:
    """Return what was run, in two lines: plant, belief, motion; sampling, sensors and disturbances."""
    belief, run, units = experiment.model, experiment.run, units_of(experiment)
    drawn = f"; seed {run.seed}, draw {run.draw}" if experiment.is_drawn else ""
    start = "" if run.initial_q == "home" else f"; start {run.initial_q}"
    mismatch = "" if belief.mismatch is None else f", {belief.mismatch.describe(units)}"
    return (
        f"plant {experiment.plant.describe(units)}; model {belief.structure}/{belief.constants}{mismatch}; "
        f"reference {experiment.reference.kind}{start}\n"
        f"control period {1e3 * run.control_period:g} ms; chain {chain_text(experiment)}; "
        f"disturbance: {noise_text(experiment)}{drawn}; metrics from {run.metrics_from:g} s"
    )


TURN = Units("N m", "N m s/rad", "mrad", "torque")
SLIDE = Units("N", "N s/m", "mm", "force")


def units_of(experiment: Experiment) -> Units:
    """Return the units of an experiment's joints, both where some turn and some slide."""
    kinds = dict.fromkeys(SLIDE if slides else TURN for slides in slide_joints(experiment.plant.model))
    return Units(*(" or ".join(texts) for texts in zip(*kinds, strict=True)))


def chain_text(experiment: Experiment) -> str:
    """Return the chain's name, or its imperfections."""
    return experiment.chain.describe(units_of(experiment))


def noise_text(experiment: Experiment) -> str:
    """Return the definition of every disturbance in words; it moves results more than the choice of law."""
    units = units_of(experiment)
    return "; ".join(disturbance.describe(units) for disturbance in experiment.disturbances) or "none"


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
