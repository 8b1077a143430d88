"""Torques that disturb the joints, one kind a file; importing this package registers every kind that ships with it."""

from torquebench.disturbances.bias import Bias
from torquebench.disturbances.kinds import DISTURBANCES, disturbance
from torquebench.disturbances.noise import BandLimitedNoise, band_limited_noise
from torquebench.disturbances.pulses import Pulses
from torquebench.disturbances.sinusoid import Sinusoid
from torquebench.disturbances.streams import Stream, generator

__all__ = [
    "DISTURBANCES",
    "BandLimitedNoise",
    "Bias",
    "Pulses",
    "Sinusoid",
    "Stream",
    "band_limited_noise",
    "disturbance",
    "generator",
]
