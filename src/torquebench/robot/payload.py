"""A load that the last link of an arm takes up: a point mass, exact in every model structure that can hold it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from torquebench.errors import ModelError
from torquebench.robot.flat_model import CLOSED_FORM, own_copy
from torquebench.robot.perturbation import Links, links_in
from torquebench.robot.puma560.puma import wrist_load
from torquebench.robot.robot_model import RobotModel


@dataclass(frozen=True, slots=True)
class Payload:
    """A point mass fixed to the last link, in the frame of the last joint: z along its axis.

    Raises:
        ValueError: the mass is not positive, the time negative, or a number not finite.
    """

    mass: float
    """Mass [kg]."""
    at: float = 0.0
    """Time at which it is taken up [s]; the joints keep their position and velocity."""
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Where it is in that frame, three coordinates [m]; the origin is on the joint's axis: the PUMA's wrist centre."""

    def __post_init__(self) -> None:
        """Refuse a mass, time or position that no payload can have."""
        if not (math.isfinite(self.mass) and self.mass > 0.0):
            raise ValueError(f"payload: mass is {self.mass}, wanted a finite positive number of kg")
        if not (math.isfinite(self.at) and self.at >= 0.0):
            raise ValueError(f"payload: at is {self.at}, wanted a finite number of seconds, at least 0")
        if len(self.offset) != 3 or not all(math.isfinite(x) for x in self.offset):
            raise ValueError(f"payload: offset is {self.offset}, wanted three finite numbers of m")


def add_payload(links: Links, payload: Payload) -> Links:
    """Return the links with the payload on the last one; Huygens' and Steiner's theorem.

    With c' the common centre of mass, J' = J + m S(c - c') + mp S(p - c'), S(r) = r.r 1 - r r^T.
    """
    mass, com, inertia = links.mass.copy(), links.com.copy(), links.inertia.copy()
    point, total = np.array(payload.offset), links.mass[-1] + payload.mass
    mass[-1] = total
    com[-1] = (links.mass[-1] * links.com[-1] + payload.mass * point) / total
    for m, r in ((links.mass[-1], links.com[-1] - com[-1]), (payload.mass, point - com[-1])):
        inertia[-1] += m * (np.dot(r, r) * np.eye(3) - np.outer(r, r))
    return Links(mass, com, inertia, links.armature)


def carrying(model: RobotModel, payload: Payload) -> RobotModel:
    """Return a model of the same arm with the payload on its last link.

    Raises:
        ModelError: a closed form of the PUMA, which has no terms for a load beside the wrist centre.
    """
    flat = model.flat
    links = add_payload(links_in(flat), payload)
    constants = flat.constants
    if flat.structure == CLOSED_FORM:
        if any(payload.offset):
            raise ModelError(
                "structures 'corrected' and 'printed' hold a payload at the wrist centre only (offset 0): their "
                "constants have no terms for any other point"
            )
        constants = constants + wrist_load(payload.mass, float(-flat.gravity[2]))
    return RobotModel(model.name, model.joint_names, own_copy(flat, **links._asdict(), constants=constants))


def phases(model: RobotModel, payload: Payload | None) -> tuple[RobotModel, RobotModel | None]:
    """Return the model at the start of a run, and the model after a payload is taken up in its middle."""
    if payload is None:
        return model, None
    loaded = carrying(model, payload)
    return (loaded, None) if payload.at == 0.0 else (model, loaded)
