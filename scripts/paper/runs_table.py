"""The table of all runs of the study, and how claims look figures up in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from torquebench.errors import ResultError
from torquebench.statistics import Ratio, paired_ratio

LOST = 0.5
"""RMSE from which a run that completed has lost its reference, whose joints move by about 1 [rad]."""
PLACE = ["reference", "chain", "condition", "controller"]
"""Columns that say where a run belongs; draw and plant tell its runs apart."""
TEXTS = (*PLACE, "plant", "outcome")
"""Columns that are not numbers."""
JUDGED = ("eta", "outside", "rising", "fuzzy_share")
"""Columns of figures of the certificates and of the fuzzy part; NaN where they are not computed."""


def ratio_of(a: Sequence[float | None], b: Sequence[float | None]) -> Ratio:
    """Return the paired ratio of two laws' figures; NaN where no draw has both."""
    if any(x is not None and y is not None for x, y in zip(a, b, strict=True)):
        return paired_ratio(a, b)
    return Ratio(math.nan, math.nan, math.nan, 0, (sum(x is None for x in a), sum(y is None for y in b)), len(a))


class Runs:
    """All runs of the study. Verdicts rest on MuJoCo where it has all draws of a place, else on the analytic plant.

    Args:
        table: A row for each run, in any order: the columns of a sweep's table, and ``reference``, ``condition`` and
            ``plant``.

    Raises:
        ResultError: two runs have the same place, draw and plant.
    """

    def __init__(self, table: pd.DataFrame) -> None:
        self.table = table
        twice = table[table.duplicated([*PLACE, "plant", "draw"])]
        if len(twice):
            raise ResultError(f"run twice: {', '.join(twice[PLACE].iloc[0])}, draw {twice['draw'].iloc[0]}")
        self._of_place: dict[tuple[str, ...], pd.DataFrame] = {}
        for place, runs in table.groupby(PLACE, sort=False):
            on_mujoco = runs["plant"] == "mujoco"
            chosen = on_mujoco if on_mujoco.sum() >= (~on_mujoco).sum() else ~on_mujoco
            self._of_place[tuple(map(str, place))] = runs[chosen].sort_values("draw")

    def of(self, controller: str, reference: str, chain: str, condition: str) -> pd.DataFrame:
        """Return the runs of one controller in one place, by draw.

        Args:
            controller: Its name.
            reference, chain, condition: The place.

        Raises:
            ResultError: it was not run there.
        """
        place = reference, chain, condition, controller
        if place not in self._of_place:
            raise ResultError(f"not run: {', '.join(place)}")
        return self._of_place[place]

    def values(self, key: str, controller: str, reference: str, chain: str, condition: str) -> list[float | None]:
        """Return one figure of one controller in one place, by draw; None where a run failed or lacks it.

        Args:
            key: Name of the figure.
            controller: Name of the controller.
            reference, chain, condition: The place.
        """
        return known(self.of(controller, reference, chain, condition)[key])

    def ratio(self, key: str, one: str, other: str, reference: str, chain: str, condition: str) -> Ratio:
        """Return how large one controller's figure is beside another's, paired by draw.

        Args:
            key: Name of the figure.
            one, other: Names of the controllers.
            reference, chain, condition: The place.
        """
        place = reference, chain, condition
        return ratio_of(self.values(key, one, *place), self.values(key, other, *place))

    def lost(self) -> dict[tuple[str, ...], int]:
        """Return how many runs of each place completed, but nowhere near their reference."""
        counts = {place: int((runs["rmse"] > LOST).sum()) for place, runs in self._of_place.items()}
        return {place: count for place, count in counts.items() if count and place[0] == "sine"}

    def to_csv(self) -> bytes:
        """Return the table as CSV; numbers read back to the last bit."""
        return self.table.to_csv(index=False, lineterminator="\n").encode()

    @classmethod
    def read(cls, path: Path) -> Runs:
        """Read what `to_csv` wrote."""
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
        numbers = {str(key): [float(text or "nan") for text in table[key]] for key in table if key not in TEXTS}
        return cls(table.assign(**numbers))


def known(column: pd.Series) -> list[float | None]:
    """Return a column's values, None for NaN."""
    return [None if math.isnan(value) else float(value) for value in column]
