"""The `@figure` decorator, and the registry of the figures of a run. Importing this loads no matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar

from torquebench.registry import Registry

Drawing: TypeAlias = Callable[..., Any]
"""From a `RunView` to a matplotlib figure, to several by the rest of their names, or to None."""
_F = TypeVar("_F", bound=Drawing)


class FigureInfo(NamedTuple):
    """Declaration of a figure."""

    name: str
    """Name of its files, without ending."""
    title: str
    """What it shows, in words."""
    order: float
    """Place among the others."""
    draw: Drawing | str
    """Draws it; of a built-in one, the module of ``report.figures`` that has the function ``draw_NAME``."""


FIGURES: Registry[FigureInfo] = Registry("figure")
"""Every figure of a run."""

for _name, _title, _module in (
    ("position", "Position", "signals"),
    ("error", "Tracking error", "signals"),
    ("torque", "Torque", "torque"),
    ("sliding", "Sliding variable", "signals"),
    ("spectrum", "Spectrum of the torque", "spectrum"),
    ("certificates", "Stability certificates over time", "certificates"),
    ("rules", "Fuzzy rules that fired", "fuzzy_rules"),
):
    FIGURES.register(_name, FigureInfo(_name, _title, 10.0 * (len(FIGURES) + 1), _module), maker=FigureInfo)


def figure(name: str, *, title: str, order: float = 100.0) -> Callable[[_F], _F]:
    """Register a figure of a run: a function of a `RunView` that returns a matplotlib figure.

    It may return None where a run has nothing to show, or several figures by the rest of their names.

    Args:
        name: Slug; the figure is written as ``figures/NAME.svg`` and ``.png``, one of several as ``NAME-REST.svg``.
        title: What it shows, in words.
        order: Place among the others; the built-in figures have 10 (position) to 70 (rules).

    Raises:
        RegistryError: the name is taken or is not a slug.
    """

    def register(draw: _F) -> _F:
        FIGURES.register(name, FigureInfo(name, title, order, draw), maker=draw)
        return draw

    return register


def figures_in_order() -> list[FigureInfo]:
    """Return every figure in order."""
    return sorted(FIGURES.values(), key=lambda info: info.order)
