"""What both paths are compared on: every law with every option, arms, plants, the protocol's references and chains.

Gains come from each law's own declaration, by unit, so that a law registered later is taken in without a change here.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from tests.sampled import simulate_sampled
from torquebench.chain import CHAINS, IDEAL, Chain, CurrentLoop, Drawn, Ripple, ThermalLimit, TorqueSpeed
from torquebench.fuzzy import BUILTIN, DEFAULT
from torquebench.kernel import Array
from torquebench.laws import find_law, law_names
from torquebench.references import Quintic, Ramp, ReferenceSource, Sine, Step
from torquebench.robot import Puma560, RobotModel, load_model
from torquebench.robot.flat_model import EXACT
from torquebench.robot.payload import Payload
from torquebench.sim.friction import Friction
from torquebench.sim.plants import INTEGRATORS
from torquebench.sim.plants.analytic import AnalyticPlant
from torquebench.sim.plants.mujoco import MujocoPlant
from torquebench.sim.session import Controller
from torquebench.sim.trajectory import Trajectory

GAIN = {"1/s": 15.0, "1": 0.3, "rad/s": 0.5, "1/s^3": 200.0, "rad": 0.2, "rad s": 0.1, "1/s^2": 100.0, "rad/s^2": 100.0}
GAIN |= {
    "rad^0.5/s^1.5": 10.0,
    "rad/s^3": 50.0,
    "N m/rad": 50.0,
    "N m s/rad": 5.0,
    "N m/(rad s)": 20.0,
    "N m": 0.3,
    "rad^0.5/s^2.5": 30.0,
}
GAIN |= {"1/rad": 20.0, "1/J": 0.3}
"""Size of a gain by its unit: rates and slopes, fractions, bands, integral gains."""
HOME = (0.1, -0.2, 0.15, 0.3, -0.25, 0.2)
"""Where runs start, so that no joint is at a special angle [rad]."""


class Variant(NamedTuple):
    """A law in one of its forms."""

    law: str
    options: tuple[tuple[str, str | bool], ...]
    fuzzy: str | None

    def controller(self, n: int) -> Controller:
        """Return the controller for `n` joints; each joint has gains of its own."""
        found = find_law(self.law)
        plain = {key: option.values[0] for key, option in found.options.items()}
        options, spread = plain | dict(self.options), 1.0 + 0.05 * np.arange(n)
        gains = {name: GAIN[gain.unit] * spread for name, gain in found.gains.items() if gain.acts(options)}
        return Controller(str(self), found, found.pack_gains(n, gains, options, self.fuzzy))

    def __str__(self) -> str:
        return " ".join([self.law, *(f"{name}={value}" for name, value in self.options), self.fuzzy or ""]).rstrip()


TOGETHER: dict[str, tuple[dict[str, str | bool], ...]] = {
    "smc": (
        {"equivalent_control": False, "switching": "saturation"},
        {"equivalent_control": False, "surface": "pid", "switching": "saturation"},
    ),
    "linear-band-smc": ({"equivalent_control": False, "switching": "sign"},),
    "fuzzy-linear-band-smc": (
        {"equivalent_control": False, "compensation": "clipped-sum", "band": "sign"},
        {"equivalent_control": False, "compensation": "off", "band": "off", "linear": False, "integral": False},
    ),
}
"""Choices that are tried together; every choice is tried alone as well."""
RULED = "fuzzy-linear-band-smc"
"""The law that is tried with every built-in fuzzy system; the others come with their default one."""


def plain_form(law: str) -> tuple[tuple[str, str | bool], ...]:
    """Return the defaults of a law's options."""
    return tuple((key, option.values[0]) for key, option in find_law(law).options.items())


@cache
def variants() -> tuple[Variant, ...]:
    """Return every registered law: as it is, with every choice of each option alone, and with those of `TOGETHER`.

    All combinations would be a hundred and more of one law alone; `tests/laws` calls each of them once.
    """
    found = []
    for name in law_names():
        law = find_law(name)
        plain = dict(plain_form(name))
        changes = [{key: value} for key, option in law.options.items() for value in option.values[1:]]
        forms = [plain | change for change in ({}, *changes, *TOGETHER.get(name, ()))]
        found += [Variant(name, tuple(form.items()), None) for form in forms]
    return (*found, *(Variant(RULED, plain_form(RULED), system) for system in BUILTIN if system != DEFAULT))


ARMS: dict[str, tuple[Any, Any]] = {
    "mujoco puma560": (None, lambda: Puma560()),
    "mujoco two-link": (None, lambda: load_model("two-link")),
    "analytic puma560": (lambda: Puma560(), lambda: Puma560("corrected", "printed")),
    "analytic corrected": (lambda: Puma560("corrected", "printed"), lambda: Puma560("printed", "printed")),
    "analytic two-link": (lambda: load_model("two-link"), lambda: load_model("two-link")),
}
"""Truth and belief by the plant's name; a MuJoCo plant has no analytic truth."""
PLANTS = tuple(ARMS)
REFERENCES = {
    "sine": lambda n: Sine([1.2, -1.0, 1.0, 1.0, 1.0, 1.0][:n], [0.5, 0.6, 0.7, 0.8, 0.9, 1.0][:n]),
    "step": lambda n: Step([1.0, -0.8, 0.8, 0.6, 0.6, 0.6][:n], 0.04),
    "ramp": lambda n: Ramp([2.5, -1.5, 1.5, 1.5, 1.5, 1.5][:n], 3.0),
    "quintic": lambda n: Quintic([1.5, -1.2, 1.0, 1.0, 1.0, 1.0][:n], 1.0),
}
"""The protocol's references for the first n joints, with an early step."""


class Condition(NamedTuple):
    """What a law has to cope with."""

    chain: Chain = IDEAL
    noisy: bool = False
    """Whether there are position noise and a torque disturbance."""
    payload: Payload | None = None
    friction: Friction | None = None


LATE = Chain(
    velocity="differentiated", velocity_filter=300.0, quantisation=1e-4, measurement_delay=0.004, actuator_lag=0.003
)
LOAD, RUB = Payload(2.0, at=0.02), Friction(0.7, 0.9)
"""Taken up at a control instant of 1 ms and of 4 ms, as early as the step, for short runs; friction for any arm."""
DRIVEN = Chain(
    encoder_ripple=Ripple(1e-4, 20.0),
    encoder_offset=1e-3,
    quantisation=1e-5,
    velocity="kalman",
    kalman_acceleration=50.0,
    torque_rate=5000.0,
    torque_quantum=0.01,
    torque_offset=0.05,
    command_delay=0.004,
    torque_delay=0.002,
    current_loop=CurrentLoop(700.0, 0.5),
    torque_speed=TorqueSpeed(1.5, 8.0),
    thermal_limit=ThermalLimit(15.0, 0.05),
)
"""All parts of sensors and drives that draw nothing."""
CONDITIONS = {
    "ideal": Condition(),
    "ideal, noisy": Condition(IDEAL, True),
    "fast, noisy": Condition(CHAINS["fast"], True),
    "slow, noisy": Condition(CHAINS["slow"], True),
    "slow": Condition(CHAINS["slow"]),
    "rounded and late": Condition(Chain(velocity="differentiated", quantisation=2e-4, measurement_delay=0.008)),
    "late, noisy": Condition(LATE, True),
    "payload": Condition(payload=LOAD),
    "friction": Condition(friction=RUB),
    "driven, noisy": Condition(DRIVEN, True),
    "slow, noisy, payload and friction": Condition(CHAINS["slow"], True, LOAD, RUB),
}
"""Their number has no divisor in common with the stride of the small size, nor with 3: see `interpreted`."""


@cache
def plant_of(
    name: str,
    integrator: str = "rk4",
    timestep: float = 0.001,
    payload: Payload | None = None,
    friction: Friction | None = None,
) -> MujocoPlant | AnalyticPlant:
    """Return a plant of `ARMS`; one object serves every run, as `simulate` resets it."""
    if name.startswith("mujoco"):
        return MujocoPlant(name.removeprefix("mujoco "), timestep, integrator, payload=payload, friction=friction)
    return AnalyticPlant(ARMS[name][0](), timestep, integrator, payload=payload, friction=friction)


@cache
def belief_of(name: str, law: str = "smc") -> RobotModel:
    """Return what a law believes on the plant called `name`: one that wants links has those of the PUMA."""
    model: RobotModel = ARMS[name][1]()
    return Puma560() if find_law(law).rigid_only and model.flat.structure != EXACT else model


@cache
def signals(n: int, n_steps: int) -> tuple[Array, Array]:
    """Return position noise of 1e-4 rad and a disturbance of 2 N m, (n_steps, n) each."""
    rng = np.random.default_rng(5)
    return 1e-4 * rng.normal(size=(n_steps, n)), 2.0 * rng.normal(size=(n_steps, n))


class Case(NamedTuple):
    """One closed loop, but for the path and its length."""

    plant: str
    variant: Variant
    reference: str
    integrator: str
    condition: str
    substeps: int

    def run(self, n_steps: int, path: Any) -> Trajectory:
        """Run `n_steps` control instants; a failure is returned, not raised."""
        chain, noisy, payload, friction = CONDITIONS[self.condition]
        plant = plant_of(self.plant, self.integrator, payload=payload, friction=friction)
        n, period = plant.n, self.substeps * plant.timestep
        noise, disturbance = signals(n, n_steps) if noisy else (None, None)
        target: ReferenceSource = REFERENCES[self.reference](n)
        return simulate_sampled(
            plant,
            self.variant.controller(n),
            belief_of(self.plant, self.variant.law),
            target,
            duration=n_steps * period,
            control_period=period,
            chain=chain,
            drawn=Drawn(noise),
            disturbance=disturbance,
            initial_q=np.array(HOME[:n]),
            path=path,
            throw=False,
        )

    def __str__(self) -> str:
        parts = (self.plant, self.variant, self.reference, self.integrator, self.condition, f"x{self.substeps}")
        return ", ".join(map(str, parts))


def cases(plant: str) -> Iterator[Case]:
    """Every law and option, reference, integrator, condition and control period, on one plant."""
    axes = (variants(), REFERENCES, INTEGRATORS, CONDITIONS, (1, 4))
    return (Case(plant, *values) for values in itertools.product(*axes))


def differing_bytes(a: Trajectory, b: Trajectory) -> int:
    """Return the number of bytes in which two trajectories differ; all of an array's where its shapes do."""
    first, second, count = a.arrays(), b.arrays(), 0
    for name in first.keys() | second.keys():
        x, y = (side.get(name, np.zeros(0)) for side in (first, second))
        if x.shape == y.shape:
            count += int(np.count_nonzero(np.frombuffer(x.tobytes(), np.uint8) != np.frombuffer(y.tobytes(), np.uint8)))
        else:
            count += max(x.nbytes, y.nbytes)
    return count
