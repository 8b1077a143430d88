"""A load that the last link of an arm takes up: a point mass, exact in every model structure that can hold it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from torquebench.errors import Fault, ModelError
from torquebench.keys import Key, Units, check_numbers, in_words
from torquebench.robot.flat_model import CLOSED_FORM, own_copy
from torquebench.robot.perturbation import Links, links_in
from torquebench.robot.puma560.puma import wrist_load
from torquebench.robot.robot_model import RobotModel
from torquebench.timing import Timing, control_instant


@dataclass(frozen=True)
class Payload:
    """A point mass on the last link, with a belief that knows nothing of it.

    Raises:
        ValueError: the mass or the time is negative, or a number not finite.
    """

    mass: Annotated[float, Key("Mass; 0 for none", "kg", at_least=0)]
    at: Annotated[
        float,
        Key(
            "Time at which it is taken up, at the joints' position and velocity of then: a whole multiple of "
            "run.control_period, less than run.duration",
            "s",
            at_least=0,
        ),
    ] = 0.0
    offset: Annotated[
        tuple[float, float, float],
        Key(
            "Where it is, in the frame of the last joint (z along its axis): zero is a point of the axis, for puma560 "
            "the wrist centre",
            "m",
            wanted="a list of 3 numbers",
        ),
    ] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse what is no load."""
        check_numbers(self)
        if len(self.offset) != 3:
            raise ValueError(f"payload: offset is {self.offset}, wanted three finite numbers of m")

    def check(self, timing: Timing) -> Iterator[Fault]:
        """Yield what does not fit within the run."""
        yield from control_instant(("at",), self.at, timing)

    def describe(self, units: Units) -> str:
        """Return what it is in one line."""
        place = f" at {in_words(self.offset)} m" if any(self.offset) else ""
        return f"payload {self.mass:g} kg{place}" + (f" from {self.at:g} s" if self.at > 0 else "")


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
    return RobotModel(
        model.name, model.joint_names, own_copy(flat, **links._asdict(), constants=constants), model.passive
    )


def phases(model: RobotModel, payload: Payload | None) -> tuple[RobotModel, RobotModel | None]:
    """Return the model at the start of a run, and the model after a payload is taken up in its middle."""
    if payload is None:
        return model, None
    loaded = carrying(model, payload)
    return (loaded, None) if payload.at == 0.0 else (model, loaded)
