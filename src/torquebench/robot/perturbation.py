"""The links of an arm as rigid bodies, and links that differ from them but are rigid bodies still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from torquebench.errors import ModelError
from torquebench.kernel import Array
from torquebench.keys import Key, Units
from torquebench.robot.flat_model import EXACT, Model, own_copy
from torquebench.robot.robot_model import RobotModel

FACTORS = ("mass", "com x", "com y", "com z", "spread x", "spread y", "spread z", "motor inertia")
"""Parameters of a link that `scaled` multiplies; spread: second moment of mass about its centre, along an axis."""


class Links(NamedTuple):
    """The links of an arm as rigid bodies; frame i is that of joint i."""

    mass: Array
    """Masses, (n,) [kg]."""
    com: Array
    """Centres of mass in frame i, (n, 3) [m]."""
    inertia: Array
    """Inertia tensors about them, axes of frame i, (n, 3, 3) [kg m^2]."""
    armature: Array
    """Reflected rotor inertias, (n,) [kg m^2]."""


def links_in(model: Model) -> Links:
    """Return the links of a flat model."""
    return Links(model.mass, model.com, model.inertia, model.armature)


def draw_factors(n: int, relative: float, rng: np.random.Generator) -> Array:
    """Return factors between 1 - r and 1 + r, drawn evenly and independently, (n, 8), in the order of `FACTORS`.

    Args:
        n: Number of joints.
        relative: Spread r, 0 <= r < 1.
        rng: Source of all randomness.
    """
    factors: Array = 1.0 + relative * rng.uniform(-1.0, 1.0, (n, len(FACTORS)))
    return factors


def scaled(links: Links, factors: Array) -> Links:
    """Return links whose masses, centres of mass, spreads and rotors are multiplied by factors, (n, 8).

    With S = tr(J)/2 1 - J the second moment about the centre of mass, S' = D S D for D = diag(sqrt(factors)), and J' =
    tr(S') 1 - S'. The pseudo-inertia is positive definite just when the mass and S are (Wensing, Kim and Slotine,
    2018), so that for positive factors every link stays a possible body. The diagonal of J stays between the factors.
    """
    spread = 0.5 * np.trace(links.inertia, axis1=1, axis2=2)[:, None, None] * np.eye(3) - links.inertia
    stretch = np.sqrt(factors[:, 4:7])
    spread = stretch[:, :, None] * spread * stretch[:, None, :]
    return Links(
        links.mass * factors[:, 0],
        links.com * factors[:, 1:4],
        np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(3) - spread,
        links.armature * factors[:, 7],
    )


def perturbed(model: RobotModel, factors: Array) -> RobotModel:
    """Return a rigid-body model with scaled links; see `scaled`.

    Raises:
        ModelError: the model is a closed form, whose constants are no link's.
    """
    if model.flat.structure != EXACT:
        raise ModelError("links can be perturbed in structure 'exact' only: the closed forms have constants, not links")
    flat = own_copy(model.flat, **scaled(links_in(model.flat), factors)._asdict())
    return RobotModel(model.name, model.joint_names, flat, model.passive)


@dataclass(frozen=True)
class Perturbation:
    """A plant that differs from its model's file, and is a rigid body still."""

    relative: Annotated[
        float,
        Key(
            "Masses, centres of mass, second moments about them along the link's axes and motor inertias are each "
            "multiplied by a number drawn evenly between 1 - r and 1 + r; r is a fraction",
            "1",
            at_least=0,
            below=1,
        ),
    ]

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Return what the parameters of `n` links are multiplied by, (n, 8); see `draw_factors`."""
        return draw_factors(n, self.relative, rng)

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        return f"links perturbed up to {100 * self.relative:g} %"
