"""Imperfections of an experiment that can be taken away one by one, or made smaller."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from torquebench.certificates import Phases
from torquebench.chain import Chain
from torquebench.experiment.build import Loop
from torquebench.experiment.certify import truth_of
from torquebench.experiment.schema import Experiment
from torquebench.keys import in_words
from torquebench.sim.friction import FRICTIONS

FINER = 10
"""Times by which the control period is shortened where its own effect is wanted."""
FREE = 1e3
"""Times the torque limit that counts as none."""


def same_loop(loop: Loop) -> Loop:
    """Return a loop as it is."""
    return loop


@dataclass(frozen=True)
class Part:
    """One imperfection.

    Taking it away changes the experiment, then the objects made of it.
    """

    key: str
    """Key of the config, or the name of what has none."""
    title: str
    """The imperfection with its number, as the subject of a sentence: ``the command delay of 4 ms``."""
    without: Callable[[Experiment], Experiment]
    """Takes it away."""
    loop: Callable[[Loop], Loop] = same_loop
    """Takes it out of the loop's objects."""
    smaller: Callable[[Experiment, float], tuple[Experiment, str] | None] | None = None
    """Makes it a share of what it is, and says what it is then; None where there is no such value."""
    beside: tuple[str, ...] = ()
    """Parts that are taken away first: its effect is that beyond theirs."""
    remedy: str = ""
    """Cure in words, where there is no smaller value of it."""


def parts_of(experiment: Experiment, lacks_gravity: bool) -> list[Part]:
    """Return every imperfection of an experiment, its control period and torque limits included.

    Args:
        experiment: The experiment.
        lacks_gravity: Whether the law leaves gravity to its error.
    """
    return [
        *_sensors(experiment.chain),
        *_drives(experiment.chain, experiment.run.control_period),
        *_arm(experiment),
        *_loop(experiment, lacks_gravity),
    ]


def with_chain(experiment: Experiment, **keys: Any) -> Experiment:
    """Return an experiment with other values for some keys of its chain."""
    return replace(experiment, chain=replace(experiment.chain, name="custom", **keys))


def _sensors(chain: Chain) -> Iterator[Part]:
    noisy = chain.encoder_noise > 0.0 or chain.velocity_noise > 0.0
    if noisy:
        sizes = [f"{1e3 * chain.encoder_noise:g} mrad"] * (chain.encoder_noise > 0.0)
        sizes += [f"{chain.velocity_noise:g} rad/s"] * (chain.velocity_noise > 0.0)

        def quieter(experiment: Experiment, share: float) -> tuple[Experiment, str]:
            own = experiment.chain
            changed = with_chain(
                experiment, encoder_noise=share * own.encoder_noise, velocity_noise=share * own.velocity_noise
            )
            now = [f"encoder_noise <= {share * own.encoder_noise:.3g} rad"] * (own.encoder_noise > 0.0)
            now += [f"velocity_noise <= {share * own.velocity_noise:.3g} rad/s"] * (own.velocity_noise > 0.0)
            return changed, ", ".join(now)

        yield Part(
            "noise",
            f"sensor noise of {' and '.join(sizes)}",
            lambda experiment: experiment,
            lambda loop: loop._replace(drawn=loop.drawn._replace(position=None, velocity=None)),
            quieter,
        )
    if np.any(chain.encoder_offset):
        title = f"the encoders' offset of {in_words(chain.encoder_offset)} rad"
        yield Part("encoder_offset", title, lambda experiment: with_chain(experiment, encoder_offset=0.0))
    if chain.encoder_ripple is not None:
        title = f"the encoders' ripple of {in_words(chain.encoder_ripple.amplitude)} rad"
        yield Part("encoder_ripple", title, lambda experiment: with_chain(experiment, encoder_ripple=None))
    if chain.quantisation > 0.0 and chain.velocity != "kalman":
        title = f"the encoders' step of {1e3 * chain.quantisation:g} mrad"
        yield _scalar(chain, "quantisation", title, "rad")
    if chain.velocity != "exact":
        title = "the differentiated velocity"
        if chain.velocity_filter is not None:
            title = f"the velocity filter of {chain.velocity_filter:g} rad/s"
        elif chain.velocity != "differentiated":
            title = f"the velocity by {'Kalman filter' if chain.velocity == 'kalman' else 'tachometer'}"

        def quicker(experiment: Experiment, share: float) -> tuple[Experiment, str] | None:
            corner = experiment.chain.velocity_filter
            if corner is None:
                return None
            return with_chain(experiment, velocity_filter=corner / share), f"velocity_filter >= {corner / share:g}"

        beside = ("noise", "quantisation", "encoder_ripple")
        exact: dict[str, Any] = {"velocity": "exact", "velocity_filter": None, "velocity_noise": 0.0}
        exact["kalman_acceleration"] = None
        yield Part("velocity", title, lambda experiment: with_chain(experiment, **exact), same_loop, quicker, beside)
    if chain.measurement_delay > 0.0:
        title = f"the measurement delay of {1e3 * chain.measurement_delay:g} ms"
        yield _delay("measurement_delay", title)


def _drives(chain: Chain, control_period: float) -> Iterator[Part]:
    if chain.torque_rate is not None:
        rate = chain.torque_rate

        def faster(experiment: Experiment, share: float) -> tuple[Experiment, str]:
            more = tuple((np.asarray(rate) / share).ravel().tolist())
            limit = more if isinstance(rate, tuple) else more[0]
            return with_chain(experiment, torque_rate=limit), f"torque_rate >= {in_words(limit)} N m/s"

        title = f"the torque-rate limit of {in_words(rate)} N m/s"
        yield Part("torque_rate", title, lambda x: with_chain(x, torque_rate=None), same_loop, faster)
    if chain.missed_deadlines > 0.0:
        yield _scalar(chain, "missed_deadlines", f"{100 * chain.missed_deadlines:g} % of missed deadlines", "")
    if chain.jitter > 0.0:
        yield Part(
            "jitter", f"the jitter of {1e3 * chain.jitter:g} ms", lambda experiment: with_chain(experiment, jitter=0.0)
        )
    if chain.command_delay > 0.0:
        yield _delay("command_delay", f"the command delay of {1e3 * chain.command_delay:g} ms")
    if chain.torque_quantum > 0.0:
        yield _scalar(chain, "torque_quantum", f"the torque step of {chain.torque_quantum:g} N m", "N m")
    if np.any(chain.torque_offset):
        title = f"the drives' offset of {in_words(chain.torque_offset)} N m"
        yield Part("torque_offset", title, lambda experiment: with_chain(experiment, torque_offset=0.0))
    if chain.actuator_lag > 0.0:
        yield _scalar(chain, "actuator_lag", f"the actuators' lag of {1e3 * chain.actuator_lag:g} ms", "s")
    if chain.current_loop is not None:
        loop = chain.current_loop

        def quicker(experiment: Experiment, share: float) -> tuple[Experiment, str]:
            made = replace(loop, frequency=loop.frequency / share)
            return with_chain(experiment, current_loop=made), f"current_loop.frequency >= {made.frequency:g} rad/s"

        title = f"the current loop of {loop.frequency:g} rad/s"
        yield Part("current_loop", title, lambda x: with_chain(x, current_loop=None), same_loop, quicker)
    if chain.torque_speed is not None:
        yield Part("torque_speed", "the motors' torque-speed limit", lambda x: with_chain(x, torque_speed=None))
    if chain.thermal_limit is not None:
        yield Part("thermal_limit", "the motors' continuous torque", lambda x: with_chain(x, thermal_limit=None))
    if chain.torque_delay > 0.0:
        yield _delay("torque_delay", f"the torque delay of {1e3 * chain.torque_delay:g} ms")


def _scalar(chain: Chain, key: str, title: str, unit: str) -> Part:
    """Return a part that is one number of the chain, 0 for none.

    Args:
        chain: The chain.
        key, title: As of a `Part`.
        unit: Its unit.
    """
    own = float(getattr(chain, key))

    def smaller(experiment: Experiment, share: float) -> tuple[Experiment, str]:
        return with_chain(experiment, **{key: share * own}), f"{key} <= {share * own:.3g} {unit}".rstrip()

    return Part(key, title, lambda experiment: with_chain(experiment, **{key: 0.0}), same_loop, smaller)


def _delay(key: str, title: str) -> Part:
    def smaller(experiment: Experiment, share: float) -> tuple[Experiment, str] | None:
        step = experiment.plant.timestep if key == "torque_delay" else experiment.run.control_period
        time = step * math.floor(share * getattr(experiment.chain, key) / step + 1e-9)
        return (with_chain(experiment, **{key: time}), f"{key} <= {1e3 * time:g} ms") if time > 0.0 else None

    return Part(key, title, lambda experiment: with_chain(experiment, **{key: 0.0}), same_loop, smaller)


def _arm(experiment: Experiment) -> Iterator[Part]:
    plant = experiment.plant

    def other(key: str, value: Any) -> Callable[[Experiment], Experiment]:
        return lambda experiment: replace(experiment, plant=replace(experiment.plant, **{key: value}))

    friction = plant.acting
    if friction is not None and (np.any(friction.viscous) or np.any(friction.coulomb)):
        title = f"friction, Coulomb {in_words(friction.coulomb)} N m"
        cure = "compensate friction in the law"
        yield Part("friction", title, other("friction", FRICTIONS["none"]), remedy=cure)
    if getattr(plant, "joints", None) is not None:
        yield Part("joints", "the joints' elasticity", other("joints", None), remedy="stiffer joints, or smaller gains")
    if plant.load is not None:
        title = f"the payload of {plant.load.mass:g} kg"
        yield Part("payload", title, other("payload", None), remedy="tell the model of the load")
    if plant.perturb is not None:
        yield Part("perturb", "the arm's own difference from its model", other("perturb", None))
    if experiment.model.mismatch is not None:

        def right(experiment: Experiment) -> Experiment:
            return replace(experiment, model=replace(experiment.model, mismatch=None))

        yield Part("mismatch", "the model's mismatch", right, remedy="identify the arm's constants")
    if experiment.model.form != plant.form:

        def exact(experiment: Experiment) -> Experiment:
            structure, constants = experiment.plant.form
            return replace(experiment, model=replace(experiment.model, structure=structure, constants=constants))

        yield Part("model", f"the model's {' and '.join(experiment.model.form)} equations", exact)
    if experiment.disturbances:
        yield Part("disturbances", "the disturbance", lambda experiment: replace(experiment, disturbances=()))


def _loop(experiment: Experiment, lacks_gravity: bool) -> Iterator[Part]:
    if lacks_gravity:
        truth = truth_of(experiment)
        arm = truth.later if isinstance(truth, Phases) else truth

        def held(loop: Loop) -> Loop:
            weight = arm.bias_forces(loop.reference.q, np.zeros_like(loop.reference.q))
            acting = weight if loop.disturbance is None else loop.disturbance + weight
            return loop._replace(disturbance=acting)

        cure = "a law with gravity compensation, such as pd-gravity"
        yield Part("gravity", "gravity, which the law leaves to its error", lambda x: x, held, remedy=cure)

    def free(loop: Loop) -> Loop:
        loop.plant.tau_max = FREE * np.asarray(loop.plant.tau_max)
        return loop

    yield Part("torque_limit", "the torque limit", lambda x: x, free, remedy="a slower motion, or smaller gains")
    period = experiment.run.control_period

    def finer(experiment: Experiment, share: float) -> tuple[Experiment, str]:
        return with_period(experiment, share * period), f"control_period <= {1e3 * share * period:.3g} ms"

    title = f"the control period of {1e3 * period:g} ms"
    yield Part("control_period", title, lambda x: with_period(x, period / FINER), same_loop, finer)


def with_period(experiment: Experiment, period: float) -> Experiment:
    """Return an experiment with a shorter control period, and physics steps that fit in it."""
    timestep = period / math.ceil(period / experiment.plant.timestep - 1e-9)
    chain = experiment.chain
    if chain.torque_delay > 0.0:
        chain = replace(chain, torque_delay=timestep * round(chain.torque_delay / timestep), name="custom")
    if chain.jitter > period:
        chain = replace(chain, jitter=period, name="custom")
    plant, run = replace(experiment.plant, timestep=timestep), replace(experiment.run, control_period=period)
    return replace(experiment, plant=plant, run=run, chain=chain)
