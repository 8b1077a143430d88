"""The page of a diagnosis: the sentence, joint and loop drawn, then each cause with its bar and its remedy."""

from __future__ import annotations

import itertools
from pathlib import Path

from torquebench.diagnosis import Diagnosis
from torquebench.diagnosis.owners import OWNERS
from torquebench.report.figures.diagnosis import diagnosis_figure
from torquebench.report.figures.files import figure_bytes
from torquebench.report.render import Picture, render
from torquebench.report.tables import number

WHY_PAGE = "why.html"
"""Name of the page in a run's folder."""


def free_page(folder: Path, page: bytes) -> Path:
    """Return where a run's folder has room for a page: ``why.html``, ``why-2.html`` ..; where it is already, that."""
    names = itertools.chain([WHY_PAGE], (f"why-{n}.html" for n in itertools.count(2)))
    return next(path for name in names if not (path := folder / name).exists() or path.read_bytes() == page)


def why_page(found: Diagnosis, try_it: str = "") -> bytes:
    """Return the page of a diagnosis, which stands alone; the same diagnosis gives the same bytes.

    Args:
        found: The diagnosis.
        try_it: Command that runs it with the cure.
    """
    fig = diagnosis_figure(found)
    title = "The joint as it is and without the first cause, and the loop's frequency response"
    pictures = [] if fig is None else [Picture(title, figure_bytes(fig, "svg"))]
    margins = found.margins
    facts = []
    if margins is not None and margins.crossover is not None:
        facts = [
            ("crossover", f"{number(margins.crossover)} Hz"),
            ("phase margin", f"{number(margins.phase or 0.0)} deg"),
            ("delay margin", "none" if margins.delay is None else f"{number(1e3 * margins.delay)} ms"),
        ]
        for name, x in sorted(margins.lost.items(), key=lambda one: -one[1]):
            whose = OWNERS[margins.owners[name]]
            facts.append((f"phase lost to {name.replace('_', ' ')}", f"{number(x)} deg, {whose}"))
    return render(
        "why",
        scripts=["page"],
        figures=pictures,
        title=f"Why {found.controller} does what it does",
        lead=f"{found.experiment}, law {found.law}; {found.runs} closed loops run.",
        found=found,
        try_it=try_it,
        cures=[one for one in found.cures if one.text != found.advice],
        facts=facts,
    )
