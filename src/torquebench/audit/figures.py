"""The figures of an audit: a line a claim with a dot for each condition, and a forest plot for each claim."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from torquebench.audit.judge import Case, Judged, measure_words, unit_of
from torquebench.audit.study import Measure, Study
from torquebench.audit.verdicts import Interval, Verdict
from torquebench.report.figures.layout import PAGE_WIDTH
from torquebench.report.figures.style import journal_style

COLOURS = {Verdict.HOLDS: "#0072B2", Verdict.UNDECIDED: "#8c8c8c", Verdict.FAILS: "#D55E00", Verdict.DEPENDS: "#6b4fa0"}
"""Blue and vermilion differ for every eye; the fill of a dot says the same without colour."""
KEY = (Verdict.HOLDS, Verdict.UNDECIDED, Verdict.FAILS)
ALIKE = 0.1
"""Half-width of the grey band in which two laws count as alike [1]."""
ROW = 0.19
"""Height of a row of a forest plot [in]."""


def overview(study: Study, judged: Sequence[Judged]) -> Figure:
    """Draw a line for each claim: verdict, a dot for each case in groups of the first axis, one sentence.

    Args:
        study: The study.
        judged: Its claims.
    """
    groups = list(next(iter(study.axes.values()))) if study.axes else ["all"]
    widths = [max((_count(claim, group, study) for claim in judged), default=1) for group in groups]
    per_row = 12
    columns = [min(max(width, 3), per_row) for width in widths]
    heights = [
        max(1.0, *(math.ceil(_count(claim, group, study) / per_row) for group in groups)) * 0.16 + 0.34
        for claim in judged
    ]
    with journal_style():
        fig = Figure(figsize=(PAGE_WIDTH, sum(heights) + 0.95))
        FigureCanvasAgg(fig)
        ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
        ax.set_axis_off()
        ax.set_xlim(0.0, PAGE_WIDTH)
        ax.set_ylim(sum(heights) + 0.95, 0.0)
        title = f"Claims: {study.audit.paper.title}" if study.audit.paper else "Claims"
        for i, line in enumerate(textwrap.wrap(title, 62)[:2]):
            ax.text(0.1, 0.2 + 0.19 * i, line, fontsize=10.0, fontweight="bold", va="center")
        dots = 0.115
        left = PAGE_WIDTH - 0.1 - sum(columns) * dots - 0.16 * len(columns)
        starts = [left + sum(columns[:i]) * dots + 0.16 * i for i in range(len(columns))]
        for start, group in zip(starts, groups, strict=True):
            ax.text(start, 0.62, group, fontsize=7.5, color="0.3", va="center")
        _key(ax)
        y = 0.80
        for claim, height in zip(judged, heights, strict=True):
            ax.plot((0.1, PAGE_WIDTH - 0.1), (y, y), color="0.85", linewidth=0.5)
            room = int((left - 1.15) / 0.062)
            says = textwrap.shorten(claim.claim.says, 2 * room, placeholder=" ...")
            lines = textwrap.wrap(says, room)[:2]
            ax.text(
                0.1,
                y + 0.13,
                str(claim.verdict).upper(),
                fontsize=8.0,
                fontweight="bold",
                va="center",
                color=COLOURS[claim.verdict],
            )
            for i, line in enumerate(lines):
                ax.text(0.98, y + 0.13 + 0.15 * i, line, fontsize=8.0, va="center")
            ax.text(
                0.98,
                y + 0.13 + 0.15 * len(lines),
                textwrap.shorten(claim.sentence, int(room * 1.2), placeholder=" ..."),
                fontsize=6.5,
                color="0.4",
                va="center",
            )
            for start, group in zip(starts, groups, strict=True):
                own = [case for case in claim.cases if _group(case, study) == group]
                for i, case in enumerate(own):
                    row, column = divmod(i, per_row)
                    _dot(ax, start + dots * (column + 0.4), y + 0.13 + 0.16 * row, case.verdict)
            y += height
    return fig


def _count(claim: Judged, group: str, study: Study) -> int:
    return sum(_group(case, study) == group for case in claim.cases)


def _group(case: Case, study: Study) -> str:
    return case.condition[0] if study.axes else "all"


def _dot(ax: Axes, x: float, y: float, verdict: Verdict, size: float = 5.2, like: bool = True) -> None:
    colour = COLOURS[verdict] if like else "0.55"
    ax.plot(
        [x],
        [y],
        marker="o" if like else "D",
        markersize=size if like else 0.75 * size,
        color=colour,
        markeredgecolor=colour,
        markerfacecoloralt="white",
        markerfacecolor="white" if verdict == Verdict.FAILS or not like else colour,
        fillstyle="left" if verdict == Verdict.UNDECIDED and like else "full",
        markeredgewidth=0.9,
        linestyle="none",
        zorder=3.0,
    )


def _key(ax: Axes) -> None:
    x = PAGE_WIDTH - 2.35
    for verdict in KEY:
        _dot(ax, x, 0.22, verdict)
        ax.text(x + 0.09, 0.22, str(verdict), fontsize=7.5, va="center")
        x += 0.22 + 0.066 * len(verdict)


def forest(claim: Judged, index: int = 0) -> Figure:
    """Draw a figure of a claim in every case: value, 95 % interval, threshold; unlike pairs hollow and grey.

    Args:
        claim: The claim.
        index: Which of its measures.
    """
    measure = claim.claim.measures[index]
    rows = _rows([*claim.cases, *claim.shown])
    height = ROW * len(rows) + 1.15
    with journal_style():
        fig = Figure(figsize=(PAGE_WIDTH, height))
        FigureCanvasAgg(fig)
        ax = fig.add_axes((0.36, 0.48 / height, 0.38, ROW * len(rows) / height))
        labels = []
        for y, row in enumerate(rows):
            if isinstance(row, str):
                labels.append((y, row, True))
                continue
            figure = row.figures[index]
            labels.append((y, row.where, False))
            _whisker(ax, y, figure.interval, figure.verdict, measure, row.pair.like)
            ax.annotate(
                _numbers(figure.interval, measure),
                (1.02, y),
                xycoords=("axes fraction", "data"),
                fontsize=6.5,
                va="center",
                color="0.25",
                annotation_clip=False,
            )
        _axis(ax, rows, index, measure)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_yticks([y for y, _, _ in labels], [text for _, text, _ in labels], fontsize=7.0)
        for tick, (_, _, bold) in zip(ax.get_yticklabels(), labels, strict=True):
            tick.set_fontweight("bold" if bold else "normal")
        ax.tick_params(axis="y", length=0.0)
        ax.grid(visible=False, axis="y")
        title = textwrap.wrap(claim.claim.says, 84)[:2]
        for i, line in enumerate(title):
            fig.text(0.012, 1.0 - (0.14 + 0.16 * i) / height, line, fontsize=9.0, fontweight="bold", va="center")
        fig.text(
            0.012,
            1.0 - (0.14 + 0.16 * len(title)) / height,
            measure_words(measure),
            fontsize=7.5,
            va="center",
            color="0.3",
        )
    return fig


def _rows(cases: Sequence[Case]) -> list[Case | str]:
    """Return the cases under a heading for each pair."""
    rows: list[Case | str] = []
    for pair in dict.fromkeys(case.pair for case in cases):
        names = f"{pair.of} / {pair.over}" if pair.over else pair.of
        label = pair.label if pair.label == names else f"{pair.label}: {names}"
        rows.append(label if pair.like else f"{label} (unlike, not judged)")
        rows += [case for case in cases if case.pair == pair]
    return rows


def _whisker(ax: Axes, y: float, interval: Interval, verdict: Verdict, measure: Measure, like: bool) -> None:
    if math.isnan(interval.value):
        return
    scale = 1.0 if measure.relation in ("ratio", "share") else unit_of(measure.figure)[1]
    colour = COLOURS[verdict] if like else "0.55"
    ax.plot([interval.low * scale, interval.high * scale], [y, y], color=colour, linewidth=1.1, zorder=2.5)
    _dot(ax, interval.value * scale, y, verdict, 4.6, like)


def _axis(ax: Axes, rows: Sequence[Case | str], index: int, measure: Measure) -> None:
    """Set scale, threshold and label of a forest plot."""
    unit, scale = unit_of(measure.figure)
    threshold = measure.threshold
    if measure.relation == "ratio":
        ax.axvspan(1.0 - ALIKE, 1.0 + ALIKE, color="0.93", zorder=0.0)
        values = [x for row in rows if not isinstance(row, str) for x in row.figures[index].interval[:3] if x > 0.0]
        values += [threshold.limit, 0.9, 1.1]
        ax.set_xscale("log")
        ax.set_xlim(0.8 * min(values), 1.25 * max(values))
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        label, limit = f"ratio of {measure.figure} [1]", threshold.limit
    elif measure.relation == "share":
        ax.set_xlim(-0.03, 1.03)
        label, limit = "share of draws [1]", threshold.limit
    else:
        label, limit = f"{measure.figure} [{unit}]", threshold.limit * scale
        known = [
            x * scale for row in rows if not isinstance(row, str) for x in row.figures[index].interval[:3] if x == x
        ]
        low, high = min([*known, limit, 0.0]), max([*known, limit])
        margin = 0.06 * ((high - low) or 1.0)
        ax.set_xlim(low - margin, high + margin)
    ax.axvline(limit, color="0.2", linewidth=0.9, linestyle=(0, (4.0, 2.0)), zorder=1.0)
    ax.set_xlabel(f"{label}; dashed: holds {threshold.side}", fontsize=7.5)


def _numbers(interval: Interval, measure: Measure) -> str:
    """Return value, interval and number of draws; in the unit of the axis."""
    if math.isnan(interval.value):
        return f"no figure; {interval.failed[0]} failed"
    scale = 1.0 if measure.relation in ("ratio", "share") else unit_of(measure.figure)[1]
    text = f"{interval.value * scale:.3g}"
    if interval.n > 1:
        text += f" [{interval.low * scale:.3g}, {interval.high * scale:.3g}]"
    failed = sum(interval.failed)
    return f"{text}  n = {interval.n}" + (f", {failed} failed" if failed else "")


def ablation_plot(claim: Judged) -> Figure | None:
    """Draw the laws that may do as well beside the one that is judged; None for a claim without any."""
    if not claim.ablations:
        return None
    measure = claim.claim.measures[0]
    height = ROW * len(claim.ablations) + 1.0
    with journal_style():
        fig = Figure(figsize=(PAGE_WIDTH, height))
        FigureCanvasAgg(fig)
        ax = fig.add_axes((0.36, 0.48 / height, 0.38, ROW * len(claim.ablations) / height))
        ax.axvspan(1.0 - ALIKE, 1.0 + ALIKE, color="0.93", zorder=0.0)
        for y, one in enumerate(claim.ablations):
            if math.isnan(one.interval.value):
                continue
            colour = COLOURS[Verdict.HOLDS] if one.as_well else "0.4"
            ax.plot([one.interval.low, one.interval.high], [y, y], color=colour, linewidth=1.1)
            ax.add_line(Line2D([one.interval.value], [y], marker="s", markersize=4.2, color=colour, linestyle="none"))
            ax.annotate(
                f"{one.interval.value:.3g} [{one.interval.low:.3g}, {one.interval.high:.3g}]",
                (1.02, y),
                xycoords=("axes fraction", "data"),
                fontsize=6.5,
                va="center",
                annotation_clip=False,
            )
        ax.axvline(1.0, color="0.2", linewidth=0.9)
        ax.set_xscale("log")
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0), numticks=12))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_ylim(len(claim.ablations) - 0.4, -0.6)
        ax.set_yticks(
            range(len(claim.ablations)),
            [f"{one.label}; {', '.join(one.condition)}" for one in claim.ablations],
            fontsize=7.0,
        )
        ax.tick_params(axis="y", length=0.0)
        ax.grid(visible=False, axis="y")
        ax.set_xlabel(f"{measure.figure} over that of the law judged [1]; blue: as well, within a tenth", fontsize=7.5)
        fig.text(
            0.012,
            1.0 - 0.16 / height,
            "What carries it? Simpler laws beside it",
            fontsize=9.0,
            fontweight="bold",
            va="center",
        )
    return fig
