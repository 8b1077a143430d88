"""The `@figure` decorator, and the registry of the figures of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

from torquebench.registry import Registry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torquebench.report.figures.run_view import RunView

Drawing: TypeAlias = "Callable[[RunView], Figure | Mapping[str, Figure] | None]"
_F = TypeVar("_F", bound="Drawing")

BUILT_IN = ("signals", "torque", "spectrum", "certificates", "fuzzy")
"""Modules of this folder whose figures every run has; they import matplotlib, and are imported when one is drawn."""


class FigureInfo(NamedTuple):
    """What a figure declares of itself."""

    name: str
    """Name of its files, without ending."""
    title: str
    """Heading on the page."""
    order: float
    """Place on the page."""
    draw: Drawing


FIGURES: Registry[FigureInfo] = Registry("figure")
"""Every figure of a run; `figures_in_order` has the built-in ones too where none has been drawn yet."""


def figure(name: str, *, title: str, order: float = 100.0) -> Callable[[_F], _F]:
    """Register a figure of a run: a function of a `RunView` that returns a matplotlib figure.

    It may return None where a run has nothing to show, or several figures by the rest of their names.

    Args:
        name: Slug; the figure is written as ``figures/NAME.svg`` and ``.png``, one of several as ``NAME-REST.svg``.
        title: Heading on the page.
        order: Place on the page; the built-in figures have 10 (position) to 70 (fuzzy systems).

    Raises:
        RegistryError: the name is taken or is not a slug.
    """

    def register(draw: _F) -> _F:
        if not draw.__module__.startswith("torquebench."):
            load_built_in()  # so that a taken name is refused here
        FIGURES.register(name, FigureInfo(name, title, order, draw), maker=draw)
        return draw

    return register


def load_built_in() -> None:
    """Register the built-in figures."""
    for module in BUILT_IN:
        import_module(f"{__package__}.{module}")


def figures_in_order() -> list[FigureInfo]:
    """Return every figure in page order."""
    load_built_in()
    return sorted(FIGURES.values(), key=lambda info: info.order)


def figure_title(name: str) -> str:
    """Heading of the figure in a file; the file's own name where no single figure has that name."""
    return next((info.title for info in figures_in_order() if info.name == name), name)
