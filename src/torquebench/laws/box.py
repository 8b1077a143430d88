"""The box in which tuning looks for a law's gains on an arm: a side for each gain, by one rule for every law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from torquebench.chain import IDEAL, Chain
from torquebench.errors import ControllerError
from torquebench.keys import Vector
from torquebench.laws.declare import Gain
from torquebench.laws.law import Law, find_law
from torquebench.robot.robot_model import RobotModel
from torquebench.tuning import BOXES, MULTIPLES

DIGITS = 4
"""Significant digits of a gain that tuning tries: what is written of it is what was run."""


class Side(NamedTuple):
    """Where one gain is looked for."""

    gain: str
    unit: str
    low: float
    high: float
    log: bool
    of: str
    """Empty for numbers in the gain's own unit, the same for all joints; else of what they are multiples, in words."""

    def value(self, share: float) -> float:
        """Return the number, or multiple, at a share of the way from low to high, 0 to 1."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + (self.high - self.low) * share

    @property
    def text(self) -> str:
        """From where to where, in words."""
        unit = f"x {self.of}" if self.of else "" if self.unit == "1" else self.unit
        return f"{self.low:g} to {self.high:g} {unit}".rstrip()

    def __str__(self) -> str:
        return f"{self.gain} {self.text}"


def side_of(name: str, gain: Gain) -> Side:
    """Return where tuning looks for a gain, whatever the arm; see `Box`.

    Args:
        name: What the gain is called.
        gain: What its law declares of it.
    """
    search = gain.search or BOXES.get(gain.unit)
    low, high, spacing = search or MULTIPLES
    return Side(name, gain.unit, low, high, spacing == "log", "" if search else "auto" if gain.rule else "its own")


class Box:
    """The box of a law on an arm.

    A gain is looked for in the box that it declares (`Gain.search`), else in that of its unit (`BOXES`): one number for
    all joints. One of a unit that means another thing on another arm, as N m/rad, is looked for at `MULTIPLES` of what
    ``gains: auto`` chooses for each joint beside the other ones; where there is no rule for it, of what it is now. A
    gain that would be zero this way stays as it is.

    Args:
        law: The law, or its name.
        model: The arm.
        control_period: Time between control instants [s].
        chain: Sensors and actuators.
        options: Option name -> value; those left out take their defaults.
        given: The gains as they are; None for those that ``gains: auto`` chooses.

    Raises:
        ControllerError: no gains are given, and there is no rule by which one could be chosen.
    """

    def __init__(
        self,
        law: Law | str,
        model: RobotModel,
        control_period: float = 0.001,
        chain: Chain = IDEAL,
        options: Mapping[str, str | bool] | None = None,
        given: Mapping[str, Vector] | None = None,
    ) -> None:
        self.law = find_law(law) if isinstance(law, str) else law
        self._arm = model, control_period, chain, dict(options or {})
        if given is None:
            given = self.law.choose_gains(*self._arm)
        self.given: dict[str, Vector] = dict(given)
        """Gains that act -> as they are."""
        self.sides: tuple[Side, ...] = tuple(self._found())
        """Where they are looked for, in the law's order."""

    def _found(self) -> Iterator[Side]:
        chosen = self._chosen({})
        for name, gain in self.law.gains.items():
            if name not in self.given:
                continue
            side = side_of(name, gain)
            if not side.of or np.any(chosen.get(name, self.given[name])):
                yield side

    def _chosen(self, known: Mapping[str, Vector]) -> dict[str, Vector]:
        """Return the gains that have a rule, as ``gains: auto`` chooses them beside others that are known."""
        without = {name: value for name, value in self.given.items() if self.law.gains[name].rule is None}
        found = self.law.choose_gains(*self._arm, given={**without, **known})
        return {name: value for name, value in found.items() if name not in without}

    def gains(self, point: Sequence[float]) -> dict[str, Vector]:
        """Return the gains at a point of the unit cube, a number for each side.

        Args:
            point: Shares of the way from low to high, 0 to 1.

        Returns:
            Every gain that acts, those that are not looked for as they are.
        """
        if len(point) != len(self.sides):
            raise ControllerError(f"law '{self.law.name}': {len(point)} shares, wanted one for {len(self.sides)} gains")
        values = {side.gain: side.value(share) for side, share in zip(self.sides, point, strict=True)}
        found: dict[str, Vector] = {side.gain: _rounded(values[side.gain]) for side in self.sides if not side.of}
        if len(found) < len(self.sides):
            chosen = self._chosen({name: value for name, value in self.given.items() if name not in values} | found)
            for side in self.sides:
                if side.of:
                    base = chosen.get(side.gain, self.given[side.gain])
                    scaled = [_rounded(values[side.gain] * x) for x in np.atleast_1d(base)]
                    found[side.gain] = scaled[0] if np.ndim(base) == 0 else tuple(scaled)
        return {name: found.get(name, value) for name, value in self.given.items()}

    def to_json(self) -> list[dict[str, Any]]:
        """Return the sides as plain values."""
        return [side._asdict() for side in self.sides]


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")
