"""What `torquebench paper` runs: sweeps, each with its config, chains, condition and number of draws."""

from __future__ import annotations

import functools
import json
from dataclasses import asdict, replace
from typing import Any, NamedTuple

from torquebench.chain import CHAINS as CHAINS_NAMED
from torquebench.shipped import data_root
from torquebench.sweep.plan import Plan, Source

CHAINS = ("ideal", "fast", "slow")
NOMINAL, NOISE, UNCERTAIN, MISMATCH = "nominal", "noise", "noise and a wrong model", "a wrong model"
EXACT = "exact encoders"
SLOW_NOISE, LIMIT_NOISE = "noise held 100 ms", "noise of 30 % of the limit held 100 ms"
BIAS, SINUSOID = "constant torque of sigma", "1 Hz torque of sigma"
PAYLOAD, FRICTION = "payload of 2 kg", "friction"
"""Conditions: nothing else; the paper's noise; model error and noise; model error alone; encoders without noise; other
readings of the paper's noise, with model error; disturbances that are no noise; burdens that no model knows of."""
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
    """One sweep on each plant: some controllers of a config on some chains under one condition."""

    config: str
    """File in ``configs/paper``, without its ending."""
    chains: tuple[str, ...]
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
    few, ideal = min(draws, FEW_DRAWS), ("ideal",)
    for chains, some in ((ideal, 1), (("fast", "slow"), few)):
        every += [Block(f"fig9-{name}", chains, NOMINAL, BANDS, some) for name in ("chattering", "step")]
        every.append(Block("fig9-ramp", chains, NOMINAL, ("conventional", *BANDS), some))
        every.append(Block("fig10-following", chains, NOMINAL, CLAIMED, some))
        every.append(Block("fig10-step", chains, NOMINAL, (*CLAIMED, STRONG), some))
        every.append(Block("literal", chains, NOMINAL, ("equation-149", "equation-98"), some))
    every.append(Block("families", CHAINS, NOMINAL, FAMILIES, 1))
    every.append(Block("fig9-noise", CHAINS, NOISE, BANDS, draws))
    every += [Block("fig11-noise", CHAINS, condition, CLAIMED, draws) for condition in (NOISE, UNCERTAIN)]
    every.append(Block("fig9-chattering", ("fast", "slow"), EXACT, ("conventional", *BANDS), 1))
    every.append(Block("fig9-noise", ideal, UNCERTAIN, BANDS, draws))
    every.append(Block("fig10-step", ideal, UNCERTAIN, (*CLAIMED, STRONG), draws))
    every.append(Block("ablations", ideal, UNCERTAIN, tuple(f"l-{form}" for form in FORMS), draws))
    every.append(Block("ablations", ("slow",), UNCERTAIN, (*(f"m-{form}" for form in FORMS), *LINEAR), draws))
    every.append(Block("fig11-noise", ideal, MISMATCH, tuple(n for n in CLAIMED if n.startswith("proposed")), draws))
    every += [Block("fig11-noise", ideal, name, CLAIMED, 1) for name in (BIAS, SINUSOID, PAYLOAD, FRICTION)]
    noisy = ("conventional", "conventional-m", "proposed-l", "proposed-m")
    every.append(Block("fig11-noise", ideal, SLOW_NOISE, noisy, draws))
    every.append(Block("fig11-noise", ideal, LIMIT_NOISE, (*noisy, *EQUAL), draws))
    return every


@functools.cache
def plan_of(block: Block, plant: str = "mujoco") -> Plan:
    """Return a block's sweep on one plant; its grid is the chains.

    Args:
        block: What to run.
        plant: Engine of the plant.

    Raises:
        ConfigError: the config has mistakes.
    """
    config = read_config(block.config)
    config["controllers"] = [keys for keys in config["controllers"] if keys["name"] in block.controllers]
    config["disturbances"] = disturbances_under(block.condition)
    if block.condition in (UNCERTAIN, MISMATCH, SLOW_NOISE, LIMIT_NOISE):
        config["model"]["mismatch"] = {"relative": RELATIVE}
    if plant == "analytic":
        config["plant"] = {"engine": "analytic", "model": "puma560", "timestep": 0.001, "integrator": "rk4"}
    config["plant"] |= BURDENS.get(block.condition, {})
    chains = {name: exact_encoders(name) if block.condition == EXACT else name for name in block.chains}
    config["sweep"] = {"draws": block.draws_on(plant), "grid": {"chain": chains}}
    text = json.dumps(config)  # which is YAML too
    return Plan(Source(text.encode(), f"configs/paper/{block.config}.yaml, {block.condition}"))


def read_config(name: str) -> dict[str, Any]:
    """Return a config of the paper as plain data."""
    path = data_root() / "configs" / "paper" / f"{name}.yaml"
    return Plan(Source(path.read_bytes() + b"\nsweep: {}\n", str(path))).raw


def disturbances_under(condition: str) -> list[dict[str, Any]]:
    """Return the disturbances of a condition; the noise is the paper's, that of Fig 11."""
    (noise,) = read_config("fig11-noise")["disturbances"]
    sigma = noise["sigma"]
    found: dict[str, dict[str, Any]] = {
        NOISE: noise,
        UNCERTAIN: noise,
        SLOW_NOISE: noise | {"hold": 0.1},
        LIMIT_NOISE: noise | {"hold": 0.1, "sigma": list(OF_LIMIT)},
        BIAS: {"kind": "bias", "channel": "torque", "value": sigma},
        SINUSOID: {"kind": "sinusoid", "channel": "torque", "rms": sigma},
    }
    return [found[condition]] if condition in found else []


def exact_encoders(name: str) -> dict[str, Any]:
    """Return the keys of a named chain without its encoders' noise."""
    keys = asdict(replace(CHAINS_NAMED[name], encoder_noise=0.0))
    return {key: value for key, value in keys.items() if key != "name" and value is not None}


BURDENS: dict[str, dict[str, Any]] = {
    PAYLOAD: {"payload": {"mass": 2.0}},
    FRICTION: {"friction": {"viscous": [5.8, 9.3, 4.0, 0.36, 0.36, 0.22], "coulomb": [26.0, 14.0, 6.5, 1.0, 1.3, 0.7]}},
}
"""What the plant bears in a condition."""
