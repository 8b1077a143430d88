"""From a validated experiment to the objects of the loop: plant, belief, controllers, reference, disturbance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import Drawn
from torquebench.disturbances import Stream, generator
from torquebench.errors import ConfigError, InconsistentReferenceError, ModelError, Problem
from torquebench.experiment import schema
from torquebench.experiment.fuzzy_schema import fuzzy_system
from torquebench.fuzzy import BUILTIN, FuzzySystem, builtin_system
from torquebench.kernel import Array
from torquebench.keys import as_vector
from torquebench.laws import find_law
from torquebench.references import Reference, from_samples
from torquebench.robot import RobotModel, load_model
from torquebench.robot.inverse_kinematics import PathError
from torquebench.sim.friction import FrictionError
from torquebench.sim.joints import SpringError
from torquebench.sim.plants import Plant
from torquebench.sim.session import Controller
from torquebench.sim.signals import control_instants, total_torque

PLANTS = 8
"""Plants that a `Builder` keeps: each has MuJoCo's working memory, about 1 MB."""
BELIEFS, SIGNALS = 1000, 16 << 20
"""Draws of a belief, and bytes of drawn signals, that a `Builder` keeps: each case of a sweep has the same draws."""


class Loop(NamedTuple):
    """Everything one experiment's runs share, and its controllers."""

    plant: Plant
    joint_names: tuple[str, ...]
    model: RobotModel
    redraws: int
    """Rejected draws of the model's mismatch."""
    controllers: tuple[Controller, ...]
    reference: Reference
    """Desired motion at each control instant, (N, n)."""
    drawn: Drawn
    """Random values that the chain has drawn for each control instant."""
    disturbance: Array | None
    """Torque added after saturation and lag at each control instant, (N, n) [N m]."""
    initial_q: Array


class Fixed(NamedTuple):
    """Parts that all runs of an experiment share whatever is drawn, except for a perturbed plant and a mismatch."""

    plant: Plant
    model: RobotModel
    redraws: int
    controllers: tuple[Controller, ...]
    reference: Reference


class Builder:
    """Makes the objects of experiments, and keeps those that the next experiments have too; one for each thread."""

    def __init__(self) -> None:
        self._last: dict[str, list[tuple[tuple[Any, ...], Any]]] = {}
        self._draws: dict[str, dict[int, tuple[tuple[Any, ...], Any]]] = {}

    def __call__(self, experiment: schema.Experiment) -> Loop:
        """Make the objects of an experiment; all randomness is drawn here, from its seed and draw.

        Raises:
            ConfigError: the reference leaves the range of floating-point numbers, the friction is too steep, or no
                acceptable mismatch was found.
            ModelError: a model is malformed.
        """
        plant, model, redraws, controllers, reference = self.fixed(experiment)
        n, steps, run = experiment.n, experiment.n_steps, experiment.run
        chain, acting = experiment.chain, experiment.disturbances
        drawn, most = (n, steps, run.control_period, run.seed, run.draw), max(1, SIGNALS // (8 * n * steps))
        return Loop(
            plant,
            model.joint_names,
            model,
            redraws,
            controllers,
            reference,
            self._drawn("chain", most, lambda: chain.draw(n, steps, run.seed, run.draw), chain, *drawn),
            self._drawn("torque", most, lambda: total_disturbance(acting, *drawn), acting, *drawn),
            np.zeros(n) if run.initial_q == "home" else as_vector(run.initial_q, n),
        )

    def fixed(self, experiment: schema.Experiment) -> Fixed:
        """Make all but the signals that are drawn; errors as of a call."""
        n, run, arm = experiment.n, experiment.run, experiment.plant.model
        drawn = run.seed, run.draw
        sampling = experiment.reference, arm, experiment.n_steps, run.control_period
        reference: Reference = self._kept("reference", 4, lambda: sampled(experiment), *sampling)
        structure, constants = experiment.model.structure, experiment.model.constants
        right = self._kept("model", 4, lambda: load_model(arm, structure, constants), arm, structure, constants)
        keys, most = (experiment.model, arm, *drawn), 1 if experiment.model.mismatch is None else BELIEFS
        model, redraws = self._drawn("belief", most, lambda: build_belief(experiment, right), *keys)
        controllers: tuple[Controller, ...] = self._kept(
            "controllers", 1, lambda: build_controllers(experiment), experiment.controllers, experiment.fuzzy, n
        )
        own = drawn if experiment.plant.perturb is not None else ()
        plant: Plant = self._kept("plant", PLANTS, lambda: build_plant(experiment), experiment.plant, *own)
        return Fixed(plant, model, redraws, controllers, reference)

    def _drawn(self, what: str, most: int, make: Callable[[], Any], *key: Any) -> Any:
        """Return what was made in the draw that ends a key, for an equal key, or make it; see `_kept`."""
        kept = self._draws.setdefault(what, {})
        found = kept.get(key[-1])
        if found is None or found[0] != key:
            while len(kept) >= most:
                del kept[next(iter(kept))]
            found = kept[key[-1]] = key, make()
        return found[1]

    def _kept(self, what: str, most: int, make: Callable[[], Any], *key: Any) -> Any:
        """Return what was made for an equal key, or make it; at most `most` of a kind are kept."""
        kept = self._last.setdefault(what, [])
        for known, value in kept:
            if known == key:
                return value
        value = make()
        del kept[: max(0, len(kept) - most + 1)]
        kept.append((key, value))
        return value


def systems_of(experiment: schema.Experiment) -> dict[str, FuzzySystem]:
    """Return the fuzzy systems of an experiment by name: its own, and the built-in ones that its controllers use."""
    used = names_used(experiment)
    own = {name: fuzzy_system(name, keys) for name, keys in experiment.fuzzy.items()}
    return own | {name: builtin_system(name) for name in BUILTIN if name in used}


def names_used(experiment: schema.Experiment) -> list[str]:
    """Return the names of the fuzzy systems that an experiment's controllers use: those chosen, and the laws' own."""
    controllers = experiment.controllers
    chosen = [c.fuzzy for c in controllers if c.fuzzy is not None]
    fixed = [own.system for c in controllers for own in find_law(c.law).fixed.values()]
    return list(dict.fromkeys(chosen + fixed))


def build(experiment: schema.Experiment) -> Loop:
    """Make the objects of one experiment; see `Builder`."""
    return Builder()(experiment)


def build_controllers(experiment: schema.Experiment) -> tuple[Controller, ...]:
    """Make the controllers."""
    systems, controllers = systems_of(experiment), []
    for c in experiment.controllers:
        law = find_law(c.law)
        fuzzy = systems[c.fuzzy] if c.fuzzy is not None else None
        controllers.append(Controller(c.name, law, law.pack_gains(experiment.n, c.gains, c.options, fuzzy)))
    return tuple(controllers)


def build_belief(experiment: schema.Experiment, right: RobotModel | None = None) -> tuple[RobotModel, int]:
    """Make the model that the laws use, and return it with the number of rejected draws of its mismatch.

    Args:
        experiment: The experiment.
        right: The model without mismatch, where it is there already.

    Raises:
        ConfigError: no acceptable mismatch was found.
    """
    keys, run = experiment.model, experiment.run
    model = load_model(experiment.plant.model, keys.structure, keys.constants) if right is None else right
    if keys.mismatch is None:
        return model, 0
    try:
        return keys.mismatch.apply(model, generator(run.seed, run.draw, Stream.MISMATCH))
    except ModelError as error:
        raise _bad("model.mismatch", str(error)) from error


def plant_factors(experiment: schema.Experiment) -> Array | None:
    """Draw what the plant's links are multiplied by, (n, 8); None for the links as they are."""
    return experiment.plant.factors(experiment.n, experiment.run.seed, experiment.run.draw)


def build_plant(experiment: schema.Experiment) -> Plant:
    """Make the plant; MuJoCo is imported only for ``engine: mujoco``.

    Raises:
        ConfigError: its friction or its joints do not fit the arm, or are too fast for its time step.
        ModelError: the arm cannot carry the payload.
    """
    try:
        return experiment.plant.build(plant_factors(experiment))
    except FrictionError as error:
        raise _bad("plant.friction", str(error)) from error
    except SpringError as error:
        raise _bad("plant.transmission", str(error)) from error


def sampled(experiment: schema.Experiment) -> Reference:
    """Return the desired motion at every control instant.

    Raises:
        ConfigError: it is not finite there, or the arm cannot follow it, or a user's kind of reference failed, gave
            something of another shape, or rates that are not the derivatives of its positions.
    """
    reference, n, n_steps = experiment.reference, experiment.n, experiment.n_steps
    t, shape = control_instants(n_steps, experiment.run.control_period), (n_steps, n)
    try:
        with np.errstate(all="ignore"):
            samples: Reference = experiment.motion.sample(t, n)
            if hasattr(reference, "highest_hz"):
                reference.highest_hz()
    except PathError as error:
        raise _bad("reference", str(error)) from error
    except Exception as error:
        if not _is_users(reference):
            raise
        raise _bad("reference", f"its kind failed: {type(error).__name__}: {error}") from error
    names = ("position", "velocity", "acceleration")
    if not isinstance(samples, tuple) or [np.shape(values) for values in samples] != [shape] * len(names):
        got = [np.shape(values) for values in samples] if isinstance(samples, tuple) else type(samples).__name__
        raise _bad("reference", f"its kind returned {got}, wanted a Reference of three arrays {shape}")
    for name, values in zip(names, samples, strict=True):
        if not np.all(np.isfinite(values)):
            raise _bad("reference", f"its {name} is beyond what floating-point numbers can hold")
        values.setflags(write=False)  # so that trajectories share it
    if _is_users(reference) and not reference.has_corners and len(t) >= 3:
        try:
            from_samples(t, *samples)
        except InconsistentReferenceError as error:
            hint = "; a kind whose rates leave out its corners says has_corners = True"
            raise _bad("reference", f"{error}{hint}") from error
    return samples


def total_disturbance(
    disturbances: Any, n: int, n_steps: int, control_period: float, seed: int, draw: int
) -> Array | None:
    """Sample disturbances and add them up; arguments as of `total_torque`.

    Raises:
        ConfigError: a user's kind of disturbance failed, or gave something of another shape or not finite.
    """
    try:
        return total_torque(disturbances, n, n_steps, control_period, seed, draw)
    except Exception as error:
        if not any(_is_users(kind) for kind in disturbances):
            raise
        raise _bad("disturbances", f"{type(error).__name__}: {error}") from error


def _is_users(kind: Any) -> bool:
    return not type(kind).__module__.startswith("torquebench.")


def _bad(key: str, text: str) -> ConfigError:
    return ConfigError([Problem("", key, text)])
