"""Figures of runs and sweeps; one of a run registers itself with `@figure`. Importing this loads no matplotlib."""

from torquebench.report.figures.declare import FIGURES, figure

__all__ = ["FIGURES", "figure"]
