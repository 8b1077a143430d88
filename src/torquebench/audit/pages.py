"""The files of a finished audit: claims.json, claims.md, figures, and a page that stands alone."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.audit.judge import Figure as Shown
from torquebench.audit.judge import Judged, measure_words, shown
from torquebench.audit.run import CONDITIONS, Part
from torquebench.audit.study import Measure, Study
from torquebench.audit.verdicts import Verdict
from torquebench.experiment.store import json_bytes, machine, versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS = {Verdict.HOLDS: "●", Verdict.UNDECIDED: "◐", Verdict.FAILS: "○"}


def dots(study: Study, claim: Judged) -> list[tuple[str, str]]:
    """Return the levels of the first axis, each with a dot for each case there."""
    groups = list(next(iter(study.axes.values()))) if study.axes else ["all"]
    of = [(case.condition[0] if study.axes else "all", DOTS[case.verdict]) for case in claim.cases]
    found = [(group, "".join(dot for own, dot in of if own == group)) for group in groups]
    return [(group, text) for group, text in found if text]


def markdown(study: Study, judged: Sequence[Judged]) -> str:
    """Return the claims as Markdown: a line each, then what each was judged by."""
    lines = [f"{DOTS[Verdict.HOLDS]} holds, {DOTS[Verdict.UNDECIDED]} undecided, {DOTS[Verdict.FAILS]} fails", ""]
    lines += ["| claim | verdict | where | what came out |", "|---|---|---|---|"]
    for claim in judged:
        where = "; ".join(f"{group} {text}" for group, text in dots(study, claim))
        lines.append(f"| {claim.claim.says} | **{claim.verdict}** | {where} | {claim.sentence} |")
    for claim in judged:
        lines += ["", f"### {claim.claim.says}", "", f"Source: {claim.source}."]
        for measure in claim.claim.measures:
            lines.append(f"* {measure_words(measure)}. {measure.why}.")
        if claim.vacuous:
            lines.append(
                f"* {claim.vacuous} cases are left out: no joint leaves its layer, so that nothing is certified."
            )
        lines += ["", "| pair | condition | verdict | " + " | ".join(m.figure for m in claim.claim.measures) + " |"]
        lines.append("|---|---|---|" + "---|" * len(claim.claim.measures))
        for case in (*claim.cases, *claim.shown):
            verdict = str(case.verdict) if case.pair.like else "not judged"
            cells = " | ".join(figure_text(one) for one in case.figures)
            lines.append(f"| {case.pair.label} | {case.where} | {verdict} | {cells} |")
    return "\n".join(lines).replace("|S|", "\\|S\\|") + "\n"


def figure_text(figure: Shown) -> str:
    """Return a figure with its interval, the number of draws, and the absolute figures behind it."""
    interval, measure = figure.interval, figure.measure
    failed = "".join(
        f"; {count} {who} failed" for count, who in zip(interval.failed, ("", "beside"), strict=True) if count
    )
    if math.isnan(interval.value):
        return f"none{failed}"
    text = shown(interval.value, measure)
    if interval.n == 1 and math.isinf(interval.low):
        text += " [unknown]"
    elif interval.n > 1:
        text += f" [{_bare(interval.low, measure)}, {_bare(interval.high, measure)}]"
    text += f", n = {interval.n}{failed}"
    if measure.relation in ("ratio", "difference") and figure.of is not None and figure.beside is not None:
        absolute = replace(measure, relation="value")
        text += f" ({shown(figure.of, absolute)} beside {shown(figure.beside, absolute)})"
    return text


def _bare(value: float, measure: Measure) -> str:
    return shown(value, measure).lstrip("x").split(" ")[0]


def write_files(
    study: Study,
    judged: Sequence[Judged],
    parts: Sequence[Part],
    folder: Path,
    figures: bool = True,
    progress: Callable[[str], None] = lambda what: None,
) -> Iterator[tuple[str, bytes]]:
    """Yield the files of an audit: name and content of each.

    Args:
        study: The study.
        judged: Its claims.
        parts: The sweeps that were run.
        folder: Where the files go, for the commands that the page shows.
        figures: Whether to draw.
        progress: Called with what is done next.
    """
    from torquebench.report.figures.files import figure_bytes
    from torquebench.report.render import PAGE, Picture, render

    run = {part.condition: f"torquebench sweep {CONDITIONS}/{part.folder}/sweep.yaml" for part in parts}
    yield "claims.json", json_bytes([claim.to_json(run) for claim in judged])
    yield "claims.md", markdown(study, judged).encode()
    pictures: dict[str, Picture] = {}
    for name, (title, draw) in figures_of(study, judged).items() if figures else ():
        progress(f"drawing {name}")
        figure = draw()
        if figure is None:
            continue
        svg = figure_bytes(figure, "svg")
        yield f"figures/{name}.svg", svg
        pictures[name] = Picture(title, svg)
    commands = {
        part.condition: f"torquebench sweep {folder / CONDITIONS / part.folder / 'sweep.yaml'}" for part in parts
    }
    audit = study.audit
    yield (
        PAGE,
        render(
            "audit",
            figures=list(pictures.values()),
            scripts=["page"],
            title=str(study.document.root["name"]),
            lead=str(audit.paper) if audit.paper else str(study.document.root.get("description") or ""),
            overview=pictures.get("claims"),
            claims=[
                {
                    "key": claim.key,
                    "says": claim.claim.says,
                    "verdict": str(claim.verdict),
                    "moved": claim.moved,
                    "expect": claim.claim.expect,
                    "source": claim.source,
                    "quoted": claim.claim.quoted,
                    "implied": claim.claim.implied,
                    "sentence": claim.sentence,
                    "vacuous": claim.vacuous,
                    "dots": dots(study, claim),
                    "measures": [(measure_words(measure), measure.why) for measure in claim.claim.measures],
                    "columns": [measure.figure for measure in claim.claim.measures],
                    "cases": [
                        {
                            "pair": case.pair.label,
                            "group": case.condition[0] if case.condition else "all",
                            "where": case.where,
                            "verdict": str(case.verdict) if case.pair.like else "not judged",
                            "cells": [figure_text(one) for one in case.figures],
                            "command": commands.get(case.condition, ""),
                        }
                        for case in (*claim.cases, *claim.shown)
                    ],
                    "pictures": [pictures[name] for name in pictures if name.startswith(f"{claim.key}.")],
                }
                for claim in judged
            ],
            classes={"holds": "holds", "fails": "fails", "depends": "only", "undecided": "only", "not judged": "soft"},
            open=audit.open,
            groups=list(next(iter(study.axes.values()))) if study.axes else ["all"],
            draws=audit.draws,
            facts=json.dumps(versions() | machine(), indent=2),
        ),
    )


def figures_of(study: Study, judged: Sequence[Judged]) -> dict[str, tuple[str, Callable[[], Figure | None]]]:
    """Return title and maker of each figure by name: ``claims``; ``CLAIM.1``, ``CLAIM.ablations`` of each claim."""
    from torquebench.audit.figures import ablation_plot, forest, overview

    found: dict[str, tuple[str, Callable[[], Figure | None]]] = {
        "claims": ("The claims", partial(overview, study, judged))
    }
    for claim in judged:
        for i, measure in enumerate(claim.claim.measures):
            found[f"{claim.key}.{i + 1}"] = (measure.figure, partial(forest, claim, study.laws, i))
        if claim.ablations:
            found[f"{claim.key}.ablations"] = ("Ablations", partial(ablation_plot, claim))
    return found
