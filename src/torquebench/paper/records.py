"""What is kept of each run of the paper's study, and how claims look it up: pure data, stored as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from torquebench.errors import ResultError
from torquebench.statistics import Ratio, paired_ratio

LOST = 0.5
"""RMSE from which a run that completed has lost its reference, whose joints move by about 1 [rad]."""

METRICS = (
    "rmse",
    "max_error",
    "steady_state_error",
    "hf",
    "total_variation",
    "effort",
    "rise_time",
    "overshoot",
    "settling_time",
)
"""Headline metrics that are kept."""


@dataclass(frozen=True, slots=True)
class Record:
    """One run: where it belongs, how it ended, and its headline figures."""

    reference: str
    chain: str
    condition: str
    controller: str
    draw: int
    plant: str
    outcome: str
    values: Mapping[str, float | None]
    """Metrics by key, and figures of the certificates and of the fuzzy part where they are computed."""


def ratio_of(a: Sequence[float | None], b: Sequence[float | None]) -> Ratio:
    """Return the paired ratio of two laws' figures; NaN where no draw has both."""
    if any(x is not None and y is not None for x, y in zip(a, b, strict=True)):
        return paired_ratio(a, b)
    return Ratio(math.nan, math.nan, math.nan, 0, (sum(x is None for x in a), sum(y is None for y in b)), len(a))


class Records:
    """All runs of a study. Verdicts rest on MuJoCo where it has all draws of a place, else on the analytic plant.

    Args:
        records: The runs, in any order; every one has a place of its own.

    Raises:
        ResultError: two runs have the same place.
    """

    def __init__(self, records: Iterable[Record]) -> None:
        self.all = tuple(records)
        self._draws: dict[tuple[str, str, str, str], dict[int, Record]] = {}
        every: dict[tuple[str, str, str, str], dict[str, dict[int, Record]]] = {}
        for record in self.all:
            place = record.reference, record.chain, record.condition, record.controller
            draws = every.setdefault(place, {}).setdefault(record.plant, {})
            if record.draw in draws:
                raise ResultError(f"run twice: {', '.join(place)}, draw {record.draw}")
            draws[record.draw] = record
        for place, plants in every.items():
            self._draws[place] = max(plants.values(), key=len)
            if len(plants.get("mujoco", ())) == len(self._draws[place]):
                self._draws[place] = plants["mujoco"]

    def draws(self, controller: str, reference: str, chain: str, condition: str) -> list[Record]:
        """Return the runs of one controller in one place, by draw.

        Args:
            controller: Its name.
            reference, chain, condition: The place.

        Raises:
            ResultError: it was not run there.
        """
        place = reference, chain, condition, controller
        if place not in self._draws:
            raise ResultError(f"not run: {', '.join(place)}")
        return [record for _, record in sorted(self._draws[place].items())]

    def values(self, key: str, controller: str, reference: str, chain: str, condition: str) -> list[float | None]:
        """Return one figure of one controller in one place, by draw; None where a run failed or has no such figure.

        Args:
            key: Name of the figure.
            controller: Name of the controller.
            reference, chain, condition: The place.
        """
        return [record.values.get(key) for record in self.draws(controller, reference, chain, condition)]

    def ratio(self, key: str, one: str, other: str, reference: str, chain: str, condition: str) -> Ratio:
        """Return how large one controller's figure is beside another's, paired by draw.

        Args:
            key: Name of the figure.
            one, other: Names of the controllers.
            reference, chain, condition: The place.
        """
        place = reference, chain, condition
        return ratio_of(self.values(key, one, *place), self.values(key, other, *place))

    def lost(self) -> dict[tuple[str, str, str, str], int]:
        """Return how many runs of each place completed, but nowhere near their reference."""
        found: dict[tuple[str, str, str, str], int] = {}
        for place, draws in self._draws.items():
            count = sum((record.values.get("rmse") or 0.0) > LOST for record in draws.values())
            if count and place[0] == "sine":
                found[place] = count
        return found

    def to_json(self) -> list[dict[str, Any]]:
        """Return plain data."""
        return [asdict(record) for record in self.all]

    @classmethod
    def from_json(cls, data: Iterable[Mapping[str, Any]]) -> Records:
        """Read what `to_json` wrote."""
        return cls(Record(**row) for row in data)
