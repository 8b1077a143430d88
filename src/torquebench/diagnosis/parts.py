"""Imperfections of an experiment that can be taken away one by one, or made smaller."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import ABOUT, Chain
from torquebench.diagnosis.margins import Slopes, leaves_gravity, true_arm
from torquebench.diagnosis.owners import Owner, owner_of, robot_of
from torquebench.experiment.build import Loop
from torquebench.experiment.controllers import Controller
from torquebench.experiment.schema import Experiment
from torquebench.kernel import Array
from torquebench.keys import Vector, as_vector
from torquebench.laws import Gain, find_law
from torquebench.sim.friction import FRICTION_ORIGINS, FRICTIONS
from torquebench.sim.joints import Transmission
from torquebench.tuning import (
    CRAWL,
    acceleration_rate,
    damping,
    fuzzy_torque,
    integral,
    rate,
    robust,
    stiffness,
    switching,
    twist,
    twist_rate,
)

FINER = 10
"""Times by which the control period is shortened where its own effect is wanted."""
FREE = 1e3
"""Times the torque limit that counts as none."""


SMALLER = (0.5, 0.25, 0.1, 0.05)
"""Shares of an imperfection that are tried as its cure [1]: one over a whole number, so that delays fit a period."""
CORNERS = (500.0, 200.0, 100.0, 50.0)
"""Corners of a velocity filter that are tried against noise [rad/s]."""
WIDER = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Times the layer that one reaction of the loop crosses, tried for a law without one [1]."""
STRENGTHS = (rate, acceleration_rate, damping, stiffness, robust, switching, fuzzy_torque, integral, twist, twist_rate)
"""Rules of the gains that make torque of errors: not those of slopes, widths, or what is believed of friction."""


def as_yaml(value: Vector) -> str:
    """Return a number, or several as a list, as ``--set`` takes it."""
    return f"[{', '.join(f'{x:g}' for x in value)}]" if isinstance(value, tuple) else f"{value:g}"


def three_digits(value: Any) -> Any:
    """Return a number, or several, with three significant digits, so that what is tried is what is said."""
    return tuple(map(three_digits, value)) if isinstance(value, tuple) else float(f"{value:.3g}")


def scaled(value: Vector, factor: float) -> Vector:
    """Return a number, or several, times a factor, with three significant digits."""
    times: Vector = three_digits(tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value)
    return times


def strengths(keys: Controller, rules: Iterable[Any] = STRENGTHS) -> tuple[str, ...]:
    """Return the names of a controller's gains that make torque of errors.

    Args:
        keys: The controller.
        rules: Rules of the gains that are meant; those of integrals in torque always are. Of a user's gain, which has
            none, the unit decides.
    """
    law = find_law(keys.law)

    def is_strength(name: str, gain: Gain) -> bool:
        own = gain.rule is None and rules is STRENGTHS and gain.unit not in ("rad", "rad/s") and name != "lam"
        return own or gain.rule in rules or gain.unit == "N m/(rad s)"

    return tuple(name for name in keys.gains if is_strength(name, law.gains[name]))


def with_share(keys: Controller, names: Iterable[str], share: float) -> Controller:
    """Return a controller with a share of some of its gains, three digits of each."""
    return replace(keys, gains={**keys.gains, **{name: scaled(keys.gains[name], share) for name in names}})


def layers(experiment: Experiment, loop: Loop) -> Iterator[Controller]:
    """Yield a controller with wider and wider layers: from twice its own on, else from what one reaction crosses.

    Nothing is yielded for a law that has no layer.

    Args:
        experiment: With one controller.
        loop: Its objects.
    """
    (keys,) = experiment.controllers
    law, own, n = find_law(keys.law), keys.gains.get("phi"), experiment.n
    if "phi" not in law.gains or "k" not in keys.gains:
        return
    options, width = dict(keys.options), as_vector(0.0 if own is None else own, n) * 2.0
    if own is None:
        q = loop.reference.q
        M = true_arm(experiment).mass_matrix(q[:: max(1, len(q) // 20)])
        mobility = np.max(np.diagonal(np.linalg.inv(M), axis1=1, axis2=2), axis=0)
        K = as_vector(keys.gains["k"], n) * np.array(loop.plant.tau_max)
        width = experiment.chain.reaction(experiment.run.control_period) * mobility * K
    if "switching" in law.options and "saturation" in law.options["switching"].values:
        options["switching"] = "saturation"
    for factor in WIDER:
        wide = scaled(tuple(width.tolist()), factor)
        phi = wide if not isinstance(wide, tuple) or len(set(wide)) > 1 else wide[0]
        yield replace(keys, gains={**keys.gains, "phi": phi}, options=options)


class Variant(NamedTuple):
    """A change that may cure."""

    experiment: Experiment
    text: str
    """The change, as a key of the config and a number."""


def no_variants(experiment: Experiment) -> Iterator[Variant]:
    """Yield nothing."""
    yield from ()


def shares(smaller: Callable[[Experiment, float], Variant | None]) -> Callable[[Experiment], Iterator[Variant]]:
    """Return what yields an experiment with less and less of a part; `smaller` gives None where that has no value."""

    def variants(experiment: Experiment) -> Iterator[Variant]:
        found = (smaller(experiment, share) for share in SMALLER)
        return (one for one in found if one is not None)

    return variants


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
    cures: Callable[[Experiment], Iterator[Variant]] = no_variants
    """Yields what to try against it, the least change first."""
    beside: tuple[str, ...] = ()
    """Parts that are taken away first: its effect is that beyond theirs."""
    remedy: str = ""
    """Cure in words, where nothing that was tried cures."""
    calms: str = ""
    """Cure in words where it shakes the arm, if that is another."""
    owner: Owner = "config"
    """Who can change it; what is the robot's only the law can answer."""
    origin: str = ""
    """Where its number is from, of a robot's chain or a friction with a name."""


def parts_of(experiment: Experiment, slopes: Slopes, weight: Array) -> list[Part]:
    """Return every imperfection of an experiment, its control period and torque limits included.

    Args:
        experiment: The experiment.
        slopes: The law's derivatives.
        weight: Gravity's torque along the motion, (m, n) [N m].
    """
    found = [
        *_sensors(experiment.chain),
        *_drives(experiment.chain),
        *_arm(experiment, slopes),
        *_integral(experiment),
        *_loop(experiment, leaves_gravity(slopes, weight)),
    ]
    owned = [replace(part, owner=owner_of(experiment, part.key)) for part in found]
    return [replace(part, origin=_origin(experiment, part)) for part in owned]


def _origin(experiment: Experiment, part: Part) -> str:
    """Return where a part's number is from, if that is known."""
    robot, friction = robot_of(experiment), experiment.plant.friction
    if part.owner == "robot" and robot is not None:
        return f"chain {robot}: {ABOUT[robot].origins[part.key]}"
    if part.key == "torque_limit" or (part.key == "friction" and friction is None):
        return "the arm's file"
    if part.key == "friction" and friction is not None:
        known = (name for name, one in FRICTIONS.items() if one.coulomb == friction.coulomb and np.any(one.coulomb))
        return next((f"friction {name}: {FRICTION_ORIGINS[name]}" for name in known), "")
    return ""


def with_chain(experiment: Experiment, **keys: Any) -> Experiment:
    """Return an experiment with other values for some keys of its chain."""
    return replace(experiment, chain=replace(experiment.chain, name="custom", **keys))


def _sensors(chain: Chain) -> Iterator[Part]:
    noisy = chain.encoder_noise > 0.0 or chain.velocity_noise > 0.0
    if noisy:
        sizes = [f"{1e3 * chain.encoder_noise:g} mrad"] * (chain.encoder_noise > 0.0)
        sizes += [f"{chain.velocity_noise:g} rad/s"] * (chain.velocity_noise > 0.0)

        def quieter(experiment: Experiment, share: float) -> Variant:
            own = experiment.chain
            place, speed = three_digits((share * own.encoder_noise, share * own.velocity_noise))
            now = [f"chain.encoder_noise <= {place:g} rad"] * (place > 0.0)
            now += [f"chain.velocity_noise <= {speed:g} rad/s"] * (speed > 0.0)
            return Variant(with_chain(experiment, encoder_noise=place, velocity_noise=speed), ", ".join(now))

        yield Part(
            "noise",
            f"sensor noise of {' and '.join(sizes)}",
            lambda experiment: experiment,
            lambda loop: loop._replace(drawn=loop.drawn._replace(position=None, velocity=None)),
            filtered(shares(quieter)),
        )
    if np.any(chain.encoder_offset):
        title = f"the encoders' offset of {as_yaml(chain.encoder_offset)} rad"
        yield Part(
            "encoder_offset",
            title,
            lambda experiment: with_chain(experiment, encoder_offset=0.0),
            remedy="calibrate the encoders",
        )
    if chain.encoder_ripple is not None:
        title = f"the encoders' ripple of {as_yaml(chain.encoder_ripple.amplitude)} rad"
        yield Part(
            "encoder_ripple",
            title,
            lambda experiment: with_chain(experiment, encoder_ripple=None),
            remedy="calibrate the encoders",
        )
    if chain.quantisation > 0.0 and chain.velocity != "kalman":
        title = f"the encoders' step of {1e3 * chain.quantisation:g} mrad"
        part = _scalar(chain, "quantisation", title, "rad")
        yield replace(part, cures=filtered(part.cures))
    if chain.velocity != "exact":
        title = "the differentiated velocity"
        if chain.velocity_filter is not None:
            title = f"the velocity filter of {chain.velocity_filter:g} rad/s"
        elif chain.velocity != "differentiated":
            title = f"the velocity by {'Kalman filter' if chain.velocity == 'kalman' else 'tachometer'}"

        def quicker(experiment: Experiment, share: float) -> Variant | None:
            corner = experiment.chain.velocity_filter
            if corner is None:
                return None
            text = f"chain.velocity_filter >= {corner / share:g} rad/s"
            return Variant(with_chain(experiment, velocity_filter=corner / share), text)

        beside = ("noise", "quantisation", "encoder_ripple")
        exact: dict[str, Any] = {"velocity": "exact", "velocity_filter": None, "velocity_noise": 0.0}
        exact["kalman_acceleration"] = None
        yield Part(
            "velocity", title, lambda experiment: with_chain(experiment, **exact), same_loop, shares(quicker), beside
        )
    if chain.measurement_delay > 0.0:
        title = f"the measurement delay of {1e3 * chain.measurement_delay:g} ms"
        yield _delay("measurement_delay", title)


def filtered(then: Callable[[Experiment], Iterator[Variant]]) -> Callable[[Experiment], Iterator[Variant]]:
    """Return what yields filters of the velocity, wide ones first, and then other cures."""

    def variants(experiment: Experiment) -> Iterator[Variant]:
        chain = experiment.chain
        if chain.velocity in ("differentiated", "tachometer"):
            for corner in CORNERS:
                if corner < (chain.velocity_filter or math.inf):
                    text = f"chain.velocity_filter <= {corner:g} rad/s"
                    yield Variant(with_chain(experiment, velocity_filter=corner), text)
        yield from then(experiment)

    return variants


def _drives(chain: Chain) -> Iterator[Part]:
    if chain.command_filter is not None:
        corner = chain.command_filter

        def wider(experiment: Experiment, share: float) -> Variant:
            higher = three_digits(corner / share)
            return Variant(with_chain(experiment, command_filter=higher), f"chain.command_filter >= {higher:g} rad/s")

        title = f"the commands' filter of {corner:.4g} rad/s"
        yield Part("command_filter", title, lambda x: with_chain(x, command_filter=None), same_loop, shares(wider))
    if chain.torque_rate is not None:
        most = chain.torque_rate

        def faster(experiment: Experiment, share: float) -> Variant:
            limit = scaled(most, 1.0 / share)
            return Variant(with_chain(experiment, torque_rate=limit), f"chain.torque_rate >= {as_yaml(limit)} N m/s")

        title = f"the torque-rate limit of {as_yaml(most)} N m/s"
        yield Part("torque_rate", title, lambda x: with_chain(x, torque_rate=None), same_loop, shares(faster))
    if chain.missed_deadlines > 0.0:
        yield _scalar(chain, "missed_deadlines", f"the loss of {100 * chain.missed_deadlines:g} % of the commands", "")
    if chain.jitter > 0.0:
        yield Part(
            "jitter", f"the jitter of {1e3 * chain.jitter:g} ms", lambda experiment: with_chain(experiment, jitter=0.0)
        )
    if chain.command_delay > 0.0:
        yield _delay("command_delay", f"the command delay of {1e3 * chain.command_delay:g} ms")
    if chain.torque_quantum > 0.0:
        yield _scalar(chain, "torque_quantum", f"the torque step of {chain.torque_quantum:g} N m", "N m")
    if np.any(np.not_equal(chain.torque_gain, 1.0)):
        title, cure = f"the drives' gain of {as_yaml(chain.torque_gain)}", "drives that are calibrated"
        yield Part("torque_gain", title, lambda experiment: with_chain(experiment, torque_gain=1.0), remedy=cure)
    if np.any(chain.torque_offset):
        title = f"the drives' offset of {as_yaml(chain.torque_offset)} N m"
        cure = "an integral in the law, or drives that are calibrated"
        yield Part("torque_offset", title, lambda experiment: with_chain(experiment, torque_offset=0.0), remedy=cure)
    if chain.actuator_lag > 0.0:
        yield _scalar(chain, "actuator_lag", f"the actuators' lag of {1e3 * chain.actuator_lag:g} ms", "s")
    if chain.current_loop is not None:
        loop = chain.current_loop

        def quicker(experiment: Experiment, share: float) -> Variant:
            made = replace(loop, frequency=three_digits(loop.frequency / share))
            text = f"chain.current_loop.frequency >= {made.frequency:g} rad/s"
            return Variant(with_chain(experiment, current_loop=made), text)

        title = f"the current loop of {loop.frequency:g} rad/s"
        yield Part("current_loop", title, lambda x: with_chain(x, current_loop=None), same_loop, shares(quicker))
    if chain.torque_speed is not None:
        cure = f"a motion much slower than {as_yaml(chain.torque_speed.no_load)} rad/s, where the motors give nothing"
        title = "the motors' torque-speed limit"
        yield Part("torque_speed", title, lambda x: with_chain(x, torque_speed=None), remedy=cure)
    if chain.thermal_limit is not None:
        cure = f"a motion that takes less than {as_yaml(chain.thermal_limit.torque)} N m RMS"
        title = "the motors' continuous torque"
        yield Part("thermal_limit", title, lambda x: with_chain(x, thermal_limit=None), remedy=cure)
    if chain.derating is not None:
        cure, title = "motors that hold their torque", f"the motors' weakening from {chain.derating.at:g} s on"
        yield Part("derating", title, lambda x: with_chain(x, derating=None), remedy=cure)
    if chain.cross_talk is not None:
        cure, title = "drives that are calibrated together", "the torque that leaks from joint to joint"
        yield Part("cross_talk", title, lambda x: with_chain(x, cross_talk=None), remedy=cure)
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

    def smaller(experiment: Experiment, share: float) -> Variant:
        less = three_digits(share * own)
        return Variant(with_chain(experiment, **{key: less}), f"chain.{key} <= {less:g} {unit}".rstrip())

    return Part(key, title, lambda experiment: with_chain(experiment, **{key: 0.0}), same_loop, shares(smaller))


def _delay(key: str, title: str) -> Part:
    def smaller(experiment: Experiment, share: float) -> Variant | None:
        step = experiment.plant.timestep if key == "torque_delay" else experiment.run.control_period
        time = step * math.floor(share * getattr(experiment.chain, key) / step + 1e-9)
        if time <= 0.0:
            return None
        return Variant(with_chain(experiment, **{key: time}), f"chain.{key} <= {1e3 * time:g} ms")

    return Part(key, title, lambda experiment: with_chain(experiment, **{key: 0.0}), same_loop, shares(smaller))


def _arm(experiment: Experiment, slopes: Slopes) -> Iterator[Part]:
    plant = experiment.plant

    def other(key: str, value: Any) -> Callable[[Experiment], Experiment]:
        return lambda experiment: replace(experiment, plant=replace(experiment.plant, **{key: value}))

    friction = plant.acting
    if friction is not None and friction != FRICTIONS["none"]:
        dry = max((friction.coulomb, friction.breakaway), key=np.max)
        title = f"friction, {'Coulomb' if dry is friction.coulomb else 'break-away'} {as_yaml(dry)} N m,"
        sliding = {"coulomb": friction.coulomb, "viscous": friction.viscous}
        known = {name: three_digits(torque) for name, torque in sliding.items() if np.any(torque)}

        def compensated(experiment: Experiment) -> Iterator[Variant]:
            K, B = (np.max(np.diagonal(x, axis1=1, axis2=2), axis=0) for x in (slopes.stiffness, slopes.damping))
            if not known or slopes.jumps or min(*K, *B) <= 0.0:
                return
            own = {"kp": three_digits(tuple(K.tolist())), "kd": three_digits(tuple(B.tolist())), "speed": CRAWL}
            made = {**own, "viscous": 0.0, "coulomb": 0.0, **known}
            text = f"law gravity-friction, PD as now, with the sliding friction's {_words_of(known)}"
            yield Variant(_with_law(experiment, "gravity-friction", made, {"friction_at": "desired"}), text)

        cure = "less friction, or larger gains"
        if known:
            cure = f"add {_words_of(known)} to the law, with the sign of the desired velocity, as gravity-friction does"
        yield Part("friction", title, other("friction", FRICTIONS["none"]), same_loop, compensated, (), cure)
    if plant.transmission is not None:
        yield from _between(plant.transmission)
    if plant.load is not None:
        title = f"the payload of {plant.load.mass:g} kg"
        yield Part("payload", title, other("payload", None), remedy=_told(plant.load.mass))
    if plant.lock is not None:
        yield Part("lock", f"the lock of joint {plant.lock.joint}", other("lock", None), remedy="a brake that is off")
    if plant.perturb is not None:
        cure = "identify the arm's constants"
        yield Part("perturb", "the arm's own difference from its model", other("perturb", None), remedy=cure)
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
        cure = "larger gains, or an integral against what is constant"
        calms = "take it away where it comes from; larger gains would answer it with more torque"
        yield Part("disturbances", "the disturbance", lambda x: replace(x, disturbances=()), remedy=cure, calms=calms)


def _told(mass: float) -> str:
    """Return how a robot is told of a load [kg]."""
    return f"tell the robot of {mass:g} kg: set_payload of a UR, setLoad of a Franka, or the masses of the law's model"


def _between(between: Transmission) -> Iterator[Part]:
    """Yield the parts of the joints that give.

    Args:
        between: What lies between motors and links.
    """

    def other(experiment: Experiment, made: Transmission | None, finer: int = 1) -> Experiment:
        plant = replace(experiment.plant, transmission=made, timestep=experiment.plant.timestep / finer)
        return replace(experiment, plant=plant)

    def cures(experiment: Experiment) -> Iterator[Variant]:
        if between.sensor == "link":
            made = replace(between, sensor="motor")
            yield Variant(other(experiment, made), "plant.transmission.sensor: motor")
        for share in SMALLER:
            k = scaled(between.stiffness, 1.0 / share)
            finer = math.ceil(math.sqrt(1.0 / share))
            text = f"plant.transmission.stiffness >= {as_yaml(k)} N m/rad"
            yield Variant(other(experiment, replace(between, stiffness=k), finer), text)

    if np.any(between.backlash):
        gap = between.backlash

        def narrower(experiment: Experiment, share: float) -> Variant:
            width = scaled(gap, share)
            text = f"plant.transmission.backlash <= {as_yaml(width)} rad"
            return Variant(other(experiment, replace(between, backlash=width)), text)

        tight = replace(between, backlash=0.0)
        title = f"the joints' backlash of {as_yaml(gap)} rad"
        yield Part("backlash", title, lambda x: other(x, tight), same_loop, shares(narrower), remedy="tighter gears")
    title = f"the joints' elasticity, {as_yaml(between.stiffness)} N m/rad,"
    yield Part("transmission", title, lambda x: other(x, None), same_loop, cures, ("backlash",), "stiffer joints")


def _integral(experiment: Experiment) -> Iterator[Part]:
    """Yield the integral action of the law of an experiment's only controller, if it has some."""
    (keys,) = experiment.controllers
    gains = find_law(keys.law).gains
    own = {
        name: value
        for name, value in keys.gains.items()
        if not gains[name].positive and "integral" in gains[name].meaning and np.any(value)
    }
    if not own:
        return

    def less(experiment: Experiment, share: float) -> Variant:
        made = with_share(keys, own, share)
        words = ", ".join(f"controllers.{keys.name}.gains.{name} <= {as_yaml(made.gains[name])}" for name in own)
        return Variant(replace(experiment, controllers=(made,)), words)

    title = f"the integral action, {' and '.join(f'{name} = {as_yaml(value)}' for name, value in own.items())},"
    yield Part("integral", title, lambda x: less(x, 0.0).experiment, same_loop, shares(less))


def _with_law(experiment: Experiment, law: str, gains: Mapping[str, Vector], options: Mapping[str, Any]) -> Experiment:
    """Return an experiment whose only controller keeps its name and becomes another law."""
    (keys,) = experiment.controllers
    made = replace(keys, law=law, gains=dict(gains), options=dict(options), fuzzy=None)
    return replace(experiment, controllers=(made,))


def _words_of(known: Mapping[str, Vector]) -> str:
    return ", ".join(f"{name} {as_yaml(torque)}" for name, torque in known.items())


def _holding(experiment: Experiment) -> Iterator[Variant]:
    """Yield a PD law with the same gains that holds the arm, for a law that has some."""
    (keys,) = experiment.controllers
    for law, names, options in (
        ("pd-gravity", ("lam", "kv"), {}),
        ("joint-impedance", ("kp", "kd"), {"damping": "velocity-error"}),
    ):
        if set(names) <= set(keys.gains):
            same = {name: keys.gains[name] for name in names}
            yield Variant(_with_law(experiment, law, same, options), f"law {law}, with the same {' and '.join(names)}")


def _loop(experiment: Experiment, lacks_gravity: bool) -> Iterator[Part]:
    if lacks_gravity:
        arm = true_arm(experiment)

        def held(loop: Loop) -> Loop:
            weight = arm.bias_forces(loop.reference.q, np.zeros_like(loop.reference.q))
            acting = weight if loop.disturbance is None else loop.disturbance + weight
            return loop._replace(disturbance=acting)

        cure = "a law with gravity compensation, such as pd-gravity"
        yield Part("gravity", "gravity, which the law leaves to its error,", lambda x: x, held, _holding, (), cure)

    def free(loop: Loop) -> Loop:
        loop.plant.tau_max = FREE * np.asarray(loop.plant.tau_max)
        return loop

    cure = "a slower motion, or smaller gains"
    beside = "torque_speed", "thermal_limit", "derating"  # they are shares of the limit
    yield Part("torque_limit", "the torque limit", lambda x: x, free, beside=beside, remedy=cure)
    period = experiment.run.control_period

    def finer(experiment: Experiment, share: float) -> Variant:
        text = f"run.control_period <= {1e3 * share * period:.3g} ms"
        return Variant(with_period(experiment, share * period), text)

    title = f"the control period of {1e3 * period:g} ms"
    yield Part("control_period", title, lambda x: with_period(x, period / FINER), same_loop, shares(finer))


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
