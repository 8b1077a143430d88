"""What the study rests on: HF does not depend on the control period, and the noise is what it is said to be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import signal

from torquebench.disturbances import Stream, band_limited_noise, generator
from torquebench.experiment import load_experiment
from torquebench.experiment.run import run_experiment
from torquebench.shipped import data_root

PERIODS = (0.00025, 0.0005, 0.001, 0.002, 0.005)
"""Control periods between which HF is compared [s]."""


class Chattering(NamedTuple):
    """Two chattering indices of conventional sliding mode at one control period."""

    control_period: float
    hf: float
    """HF [% of the torque limit]."""
    total_variation: float
    """Total variation of the torque [limits/s]."""


def chattering_by_period() -> list[Chattering]:
    """Run Fig 9's conventional controller at several control periods, plant step at most 1 ms."""
    found = []
    for period in PERIODS:
        step = f"plant.timestep={min(period, 0.001):g}"
        experiment = load_experiment(
            data_root() / "configs" / "paper" / "fig9-chattering.yaml", [step, f"run.control_period={period:g}"]
        )
        laws = tuple(keys for keys in experiment.controllers if keys.name == "conventional")
        metrics = run_experiment(replace(experiment, controllers=laws)).metrics["conventional"]
        hf, variation = metrics.hf.value, metrics.total_variation.value
        found.append(Chattering(period, float("nan") if hf is None else hf, float(variation or 0.0)))
    return found


def noise_spectrum(samples: int, hold: int = 10, control_period: float = 0.001) -> dict[str, Any]:
    """Return how far the noise is from its definition: standard deviation, and spectrum against sinc^2(f hold).

    Args:
        samples: Control instants of the sample; 2,000 seconds of them tell 0.1 dB.
        hold: Control periods each value lasts.
        control_period: Time between control instants [s].
    """
    noise = band_limited_noise(np.ones(1), hold, samples, generator(7, 0, Stream.TORQUE_NOISE))[:, 0]
    frequency, power = signal.welch(noise, fs=1.0 / control_period, window="hann", nperseg=round(1.0 / control_period))
    seen = (frequency >= 1.0) & (frequency <= 80.0)
    wanted = 2.0 * hold * control_period * np.sinc(frequency[seen] * hold * control_period) ** 2
    return {
        "samples": samples,
        "standard_deviation_over_sigma": float(np.std(noise)),
        "largest_deviation_dB": float(np.max(np.abs(10.0 * np.log10(power[seen] / wanted)))),
        "up_to_Hz": 80.0,
    }
