"""What `torquebench paper` runs: which configs, on which references, chains and conditions, how many draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from torquebench.experiment import load_experiment
from torquebench.experiment.scenario_schema import (
    BandLimitedNoise,
    Bias,
    Chain,
    Disturbance,
    Friction,
    Mismatch,
    Payload,
    Sinusoid,
)
from torquebench.experiment.schema import Experiment
from torquebench.robot.library import data_root
from torquebench.sim.chain import CHAINS as CHAIN_NAMED

CHAINS = ("ideal", "fast", "slow")
NOMINAL, NOISE, UNCERTAIN, MISMATCH = "nominal", "noise", "noise and a wrong model", "a wrong model"
EXACT = "exact encoders"
SLOW_NOISE, LIMIT_NOISE = "noise held 100 ms", "noise of 30 % of the limit held 100 ms"
BIAS, SINUSOID = "constant torque of sigma", "1 Hz torque of sigma"
PAYLOAD, FRICTION = "payload of 2 kg", "friction"
"""Conditions: nothing else; the paper's noise; model error and noise; model error alone; encoders without noise; other
readings of the paper's noise, with model error; disturbances that are no noise; burdens that no model knows of."""
PAIRED_DRAWS = {"quick": 4, "full": 30}
"""Draws behind each interval, by size."""
FEW_DRAWS = 5
"""At most this many where the encoders alone draw noise, and for certificates, which cost as much as runs."""
RELATIVE = 0.3
"""Error of every constant of the controllers' model in uncertain conditions [1]."""
OF_LIMIT = (29.28, 55.92, 26.82, 7.26, 6.03, 6.39)
"""30 % of the torque limits [N m]: the amplitude if the paper's 30 % is of the limit."""

CLAIMED = (
    "conventional",
    "conventional-blind",
    "conventional-m",
    "proposed-l",
    "proposed-l-model",
    "proposed-m",
    "proposed-m-model",
)
"""Controllers of Figs 10 and 11."""
STRONG = "conventional-strong"
"""A conventional controller that is as fast as the torque limits allow, on the step only."""
EQUAL = ("conventional-06", "conventional-m-06")
"""Conventional controllers with as much torque to spend against noise as the proposed ones, K_K + K_F."""
LINEAR = ("m-computed-torque", "m-pid")
"""Laws without any of the paper's parts, at the proposed law's gains of set M."""
BANDS = ("band", "linear-band")
"""Controllers of Fig 9 besides the conventional one, which is Fig 10's too."""
FAMILIES = (
    "fuzzy-boundary-layer",
    "pi-smc-fuzzy-estimator",
    "pi-fuzzy-smc-supervised",
    "adaptive-fuzzy-pi-smc",
    "sliding-mode-fuzzy",
    "two-input-sliding-mode-fuzzy",
)
"""The controllers of the paper's introduction, which no claim names: run once for the table."""
FORMS = ("no-fuzzy", "clipped-sum", "no-integral", "no-band", "no-linear")
"""Ablations of the proposed law; their names follow the set's, as in ``l-no-fuzzy``."""


class Block(NamedTuple):
    """Some controllers of one config under one condition, for a number of draws."""

    config: str
    """File in ``configs/paper``, without its ending."""
    chain: str
    condition: str
    controllers: tuple[str, ...]
    draws: int

    def draws_on(self, plant: str) -> int:
        """Number of draws on an engine: the first is run on both and compared, the rest on the analytic plant."""
        return self.draws if plant == "analytic" else min(self.draws, 1)


PLANTS = ("mujoco", "analytic")
"""The engines that everything is run on."""


def blocks(draws: int) -> list[Block]:
    """Return everything that is run.

    Args:
        draws: Draws of model error and noise behind each interval.
    """
    every: list[Block] = []
    for chain in CHAINS:
        some = 1 if chain == "ideal" else min(draws, FEW_DRAWS)
        every += [Block(f"fig9-{name}", chain, NOMINAL, BANDS, some) for name in ("chattering", "step")]
        every.append(Block("fig9-ramp", chain, NOMINAL, ("conventional", *BANDS), some))
        every.append(Block("fig10-following", chain, NOMINAL, CLAIMED, some))
        every.append(Block("fig10-step", chain, NOMINAL, (*CLAIMED, STRONG), some))
        every.append(Block("families", chain, NOMINAL, FAMILIES, 1))
        every.append(Block("literal", chain, NOMINAL, ("equation-149", "equation-98"), some))
        every.append(Block("fig9-noise", chain, NOISE, BANDS, draws))
        every += [Block("fig11-noise", chain, condition, CLAIMED, draws) for condition in (NOISE, UNCERTAIN)]
    every += [Block("fig9-chattering", chain, EXACT, ("conventional", *BANDS), 1) for chain in ("fast", "slow")]
    every.append(Block("fig9-noise", "ideal", UNCERTAIN, BANDS, draws))
    every.append(Block("fig10-step", "ideal", UNCERTAIN, (*CLAIMED, STRONG), draws))
    every.append(Block("ablations", "ideal", UNCERTAIN, tuple(f"l-{form}" for form in FORMS), draws))
    every.append(Block("ablations", "slow", UNCERTAIN, (*(f"m-{form}" for form in FORMS), *LINEAR), draws))
    every.append(Block("fig11-noise", "ideal", MISMATCH, tuple(n for n in CLAIMED if n.startswith("proposed")), draws))
    for condition in (BIAS, SINUSOID, PAYLOAD, FRICTION):
        every.append(Block("fig11-noise", "ideal", condition, CLAIMED, 1))
    noisy = ("conventional", "conventional-m", "proposed-l", "proposed-m")
    every.append(Block("fig11-noise", "ideal", SLOW_NOISE, noisy, draws))
    every.append(Block("fig11-noise", "ideal", LIMIT_NOISE, (*noisy, *EQUAL), draws))
    return every


def experiment_of(block: Block, plant: str = "mujoco") -> Experiment:
    """Return a block's experiment, at draw 0.

    Args:
        block: What to run.
        plant: Engine of the plant.
    """
    overrides = [f"chain={block.chain}"]
    if plant == "analytic":
        overrides.append("plant={engine: analytic, model: puma560, timestep: 0.001, integrator: rk4}")
    experiment = load_experiment(data_root() / "configs" / "paper" / f"{block.config}.yaml", overrides)
    return under(chosen(experiment, block.controllers), block.condition)


def chosen(experiment: Experiment, controllers: Sequence[str]) -> Experiment:
    """Return an experiment with only some of its controllers."""
    kept = tuple(keys for keys in experiment.controllers if keys.name in controllers)
    return replace(experiment, controllers=kept)


def under(experiment: Experiment, condition: str) -> Experiment:
    """Return an experiment under a condition; the noise that a config has is the paper's."""
    noise, chain = experiment.disturbances, experiment.chain
    if condition == UNCERTAIN and not noise:
        noise = experiment_of(Block("fig11-noise", "ideal", UNCERTAIN, (), 0)).disturbances
    change = _CHANGES.get(condition)
    disturbances = () if change is None else tuple(change(d) for d in noise if isinstance(d, BandLimitedNoise))
    error = Mismatch(relative=RELATIVE) if condition in (UNCERTAIN, MISMATCH, SLOW_NOISE, LIMIT_NOISE) else None
    plant = replace(experiment.plant, **_BURDENS.get(condition, {}))  # type: ignore[arg-type]
    belief = replace(experiment.model, mismatch=error)
    if condition == EXACT and isinstance(chain, str):
        chain = exact_encoders(chain)
    return replace(experiment, plant=plant, model=belief, chain=chain, disturbances=disturbances)


def exact_encoders(name: str) -> Chain:
    """Return the chain of a name without its encoders' noise."""
    known = CHAIN_NAMED[name]
    return Chain(
        velocity="differentiated",
        velocity_filter=known.velocity_rate,
        actuator_lag=known.lag,
        delay=known.delay,
        quantisation=known.quantum,
    )


_CHANGES: dict[str, Callable[[BandLimitedNoise], Disturbance]] = {
    NOISE: lambda noise: noise,
    UNCERTAIN: lambda noise: noise,
    SLOW_NOISE: lambda noise: replace(noise, hold=0.1),
    LIMIT_NOISE: lambda noise: replace(noise, hold=0.1, sigma=OF_LIMIT),
    BIAS: lambda noise: Bias(value=noise.sigma),
    SINUSOID: lambda noise: Sinusoid(rms=noise.sigma),
}
_BURDENS: dict[str, dict[str, Payload | Friction]] = {
    PAYLOAD: {"payload": Payload(2.0)},
    FRICTION: {
        "friction": Friction(viscous=(5.8, 9.3, 4.0, 0.36, 0.36, 0.22), coulomb=(26.0, 14.0, 6.5, 1.0, 1.3, 0.7))
    },
}
