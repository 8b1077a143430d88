"""The figures of an audit: a line a claim with a dot for each condition, and a forest plot for each claim."""

from __future__ import annotations

import math
import textwrap
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from torquebench.audit.judge import Case, Judged, measure_words, unit_of
from torquebench.audit.study import Measure, Pair, Study
from torquebench.audit.verdicts import Interval, Verdict
from torquebench.report.figures.layout import has_headings, is_narrow, least_font, page_width
from torquebench.report.figures.style import journal_style
from torquebench.report.looks import looks, series_colour

COLOURS = {Verdict.HOLDS: "#0072B2", Verdict.UNDECIDED: "#8c8c8c", Verdict.FAILS: "#D55E00", Verdict.DEPENDS: "#6b4fa0"}
"""Blue and vermilion differ for every eye; the fill of a dot says the same without colour."""
KEY = (Verdict.HOLDS, Verdict.UNDECIDED, Verdict.FAILS)
ALIKE = 0.1
"""Half-width of the grey band in which two laws count as alike [1]."""
ROW, PITCH = 0.19, 0.105
"""Least height of a row of a forest plot, and of an interval in it [in]."""


def overview(study: Study, judged: Sequence[Judged]) -> Figure:
    """Draw a line for each claim: verdict, a dot for each case in groups of the first axis, one sentence.

    Args:
        study: The study.
        judged: Its claims.
    """
    width = page_width()
    blocks = [_dot_lines(study, claim) for claim in judged]
    says, ends = (
        [textwrap.wrap(text, int((width - INDENT) / size)) for text in texts]
        for texts, size in (
            ([claim.claim.says for claim in judged], 0.064),
            ([claim.sentence for claim in judged], 0.053),
        )
    )
    heights = [LINE * (0.6 + len(s) + len(lines) + len(e)) for s, lines, e in zip(says, blocks, ends, strict=True)]
    title = textwrap.wrap(f"Claims: {study.audit.paper.title}" if study.audit.paper else "Claims", 54)[:2]
    title = title if has_headings() else []
    top = 0.25 + 0.19 * max(len(title), 1)
    with journal_style():
        fig = Figure(figsize=(width, top + sum(heights) + 0.1))
        FigureCanvasAgg(fig)
        ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
        ax.set_axis_off()
        ax.set_xlim(0.0, width)
        ax.set_ylim(top + sum(heights) + 0.1, 0.0)
        for i, text in enumerate(title):
            ax.text(LEFT, 0.2 + 0.19 * i, text, fontsize=10.0, fontweight="bold", va="center")
        _key(ax)
        y, drawn = top, defaultdict[Verdict, list[tuple[float, float]]](list)
        small = {"fontsize": least_font(6.5), "va": "center"}
        for claim, own, lines, end, height in zip(judged, says, blocks, ends, heights, strict=True):
            ax.plot((LEFT, width - LEFT), (y, y), color="0.85", linewidth=0.5)
            verdict = ax.text(LEFT, y + 0.8 * LINE, str(claim.verdict).upper(), fontsize=8.0, va="center")
            verdict.set(color=COLOURS[claim.verdict], fontweight="bold")
            at = y + 0.8 * LINE
            for line in own:
                ax.text(INDENT, at, line, fontsize=8.0, va="center")
                at += LINE
            for groups in lines:
                for x, label, cases in groups:
                    ax.text(x, at, label, color="0.3", **small)  # type: ignore[arg-type]
                    for i, case in enumerate(cases):
                        drawn[case.verdict].append((x + _label_width(label) + DOT * i, at))
                at += LINE
            for line in end:
                ax.text(INDENT, at, line, color="0.4", **small)  # type: ignore[arg-type]
                at += LINE
            y += height
        for verdict_, places in drawn.items():
            _dots(ax, places, verdict_, 4.6)
    return fig


LEFT, INDENT, LINE, DOT = 0.1, 1.0, 0.16, 0.088
"""Margin, start of sentences, height of a line, and width of a dot in the overview [in]."""


def _label_width(label: str) -> float:
    return 0.1 + 0.056 * len(label)


def _dot_lines(study: Study, claim: Judged) -> list[list[tuple[float, str, list[Case]]]]:
    """Return the lines of a claim's dots: where each group begins [in], its name, and its cases."""
    groups = list(next(iter(study.axes.values()))) if study.axes else ["all"]
    lines: list[list[tuple[float, str, list[Case]]]] = [[]]
    x = INDENT
    for group in groups:
        cases = [case for case in claim.cases if (case.condition[0] if study.axes else "all") == group]
        most = int((page_width() - INDENT - _label_width(group)) / DOT)
        for first in range(0, len(cases), most):
            width = _label_width(group) + DOT * len(cases[first : first + most]) + 0.12
            if lines[-1] and x + width > page_width() + 0.12:
                lines.append([])
                x = INDENT
            lines[-1].append((x, group, cases[first : first + most]))
            x += width
    return lines


def _dots(
    ax: Axes, places: Sequence[tuple[float, float]], verdict: Verdict, size: float, series: Series | None = None
) -> None:
    """Draw dots of one kind: full where something holds, half full where it is undecided, empty where it fails."""
    colour, like = (COLOURS[verdict], True) if series is None else (series.colour, series.like)
    ax.plot(
        *zip(*places, strict=True),
        marker="o" if like else "D",
        markersize=size if like else 0.75 * size,
        color=colour,
        markeredgecolor=colour,
        markerfacecoloralt="white",
        markerfacecolor="white" if verdict == Verdict.FAILS else colour,
        fillstyle="left" if verdict == Verdict.UNDECIDED else "full",
        markeredgewidth=0.9,
        linestyle="none",
        zorder=3.0,
    )


def _key(ax: Axes) -> None:
    x = page_width() - 2.2
    for verdict in KEY:
        _dots(ax, [(x, 0.22)], verdict, 5.2)
        ax.text(x + 0.09, 0.22, str(verdict), fontsize=7.5, va="center")
        x += 0.22 + 0.066 * len(verdict)


class Series(NamedTuple):
    """A row of dots with a colour of its own in a plot of intervals."""

    label: str
    colour: str
    like: bool = True
    """Whether it is judged; else it is drawn as diamonds."""


class Point(NamedTuple):
    """One interval of a plot, in the unit of its axis."""

    row: str
    series: Series
    interval: Interval
    verdict: Verdict


def _dot_plot(title: str, subtitle: str, points: Sequence[Point], place: Callable[[Axes], None]) -> Figure:
    """Draw intervals: a row for each name, a colour for each series; numbers beside the rows of a single series.

    Args:
        title, subtitle: What stands above.
        points: The intervals.
        place: Sets scale, label and threshold of the axis.
    """
    rows, series = (list(dict.fromkeys(column)) for column in zip(*((p.row, p.series) for p in points), strict=True))
    step = max((1.6 if is_narrow() else 1.0) * ROW, PITCH * len(series) + 0.05)
    lines = textwrap.wrap(title, 84)[:2] if has_headings() else []
    labels = [textwrap.fill(own.label, int(14.0 * page_width())) for own in series]
    keys = sum(1 + label.count("\n") for label in labels)
    top = 0.30 + 0.16 * len(lines) + 0.17 * keys
    bottom = 0.66 if is_narrow() else 0.44
    height = step * len(rows) + top + bottom + 0.06
    names = [textwrap.fill(row, 18) if is_narrow() else row for row in rows]
    left = min(0.5, (0.25 + 0.062 * max(len(part) for name in names for part in name.split("\n"))) / page_width())
    numbers = len(series) == 1 and not is_narrow()  # one column of a journal has no room for them
    with journal_style():
        fig = Figure(figsize=(page_width(), height))
        FigureCanvasAgg(fig)
        ax = fig.add_axes((left, bottom / height, (0.74 if numbers else 0.98) - left, step * len(rows) / height))
        for y in range(1, len(rows), 2):
            ax.axhspan(y - 0.5, y + 0.5, color="0.965", zorder=-1.0)
        lines_of = defaultdict[Series, list[tuple[float, float]]](list)
        dots_of = defaultdict[tuple[Verdict, Series], list[tuple[float, float]]](list)
        for point in points:
            middle = rows.index(point.row)
            at = middle + (series.index(point.series) - 0.5 * (len(series) - 1)) * PITCH / step
            if not math.isnan(point.interval.value):
                dots_of[point.verdict, point.series].append((point.interval.value, at))
                if math.isfinite(point.interval.low):  # of one draw that is left of several there are no ends
                    low, high = point.interval[1:3]
                    lines_of[point.series] += [(low, at), (high, at), (math.nan, math.nan)]
            if numbers:
                words = {"fontsize": least_font(6.5), "va": "center", "color": "0.25", "annotation_clip": False}
                ax.annotate(_numbers(point.interval), (1.02, at), xycoords=("axes fraction", "data"), **words)  # type: ignore[arg-type]
        for own, ends in lines_of.items():
            ax.plot(*zip(*ends, strict=True), color=own.colour, linewidth=1.1, zorder=2.5)
        for (verdict, own), places in dots_of.items():
            _dots(ax, places, verdict, 4.6, own)
        place(ax)
        below = textwrap.wrap(ax.get_xlabel(), int(16.0 * page_width() * (0.98 - left)))
        ax.set_xlabel("\n".join(below), fontsize=7.5)
        ax.set_ylim(len(rows) - 0.5, -0.5)
        ax.set_yticks(range(len(rows)), names, fontsize=7.0)
        ax.tick_params(axis="y", length=0.0)
        ax.grid(visible=False, axis="y")
        for i, line in enumerate(lines):
            fig.text(0.012, 1.0 - (0.16 + 0.16 * i) / height, line, fontsize=9.0, fontweight="bold", va="center")
        down = 0.18 + 0.16 * len(lines)
        if has_headings():
            fig.text(0.012, 1.0 - down / height, subtitle, fontsize=7.5, va="center", color="0.3")
        for own, label in zip(series, labels, strict=True):
            down += 0.17
            look = {"marker": "o" if own.like else "D", "markersize": 4.5 if own.like else 3.5, "color": own.colour}
            fig.add_artist(
                Line2D(
                    [0.144 / page_width()], [1.0 - down / height], linestyle="none", transform=fig.transFigure, **look
                )
            )
            fig.text(0.23 / page_width(), 1.0 - (down - 0.06) / height, label, fontsize=7.0, va="top")
            down += 0.17 * label.count("\n")
    return fig


def forest(claim: Judged, laws: Mapping[str, str], index: int = 0) -> Figure | None:
    """Draw a figure of a claim: a row for each condition, a dot and its 95 % interval for each pair, the threshold.

    Dots are full where the case holds by this figure, half full where it is undecided, empty where it fails; those of
    unlike pairs, which are not judged, are grey diamonds. None for a claim without a case.

    Args:
        claim: The claim.
        laws: Controller -> name of its law, which sets the colours of pairs.
        index: Which of its measures.
    """
    measure, cases = claim.claim.measures[index], [*claim.cases, *claim.shown]
    like = list(dict.fromkeys(case.pair for case in claim.cases))
    colours = looks({str(pair): laws[pair.of] for pair in like})
    scale = 1.0 if measure.relation in ("ratio", "share") else unit_of(measure.figure)[1]

    def series(pair: Pair) -> Series:
        names = f"{pair.of} / {pair.over}" if pair.over and measure.relation == "ratio" else pair.of
        names = f"{pair.of} - {pair.over}" if pair.over and measure.relation == "difference" else names
        if pair.like:
            return Series(f"{pair.label}: {names}", colours[str(pair)].colour)
        return Series(f"{pair.label}: {names} (not alike, not judged)", "0.55", like=False)

    if not cases:
        return None
    points = [
        Point(case.where, series(case.pair), _scaled(case.figures[index].interval, scale), case.figures[index].verdict)
        for case in cases
    ]
    return _dot_plot(claim.claim.says, measure_words(measure), points, lambda ax: _axis(ax, points, measure, scale))


def ablation_plot(claim: Judged) -> Figure | None:
    """Draw the laws that may do as well beside the one that is judged; None for a claim without any."""
    if not claim.ablations:
        return None
    figure, where = claim.claim.measures[0].figure, list(dict.fromkeys(one.where for one in claim.ablations))
    points = [
        Point(
            one.label,
            Series(one.where, series_colour(where.index(one.where))),
            one.interval,
            Verdict.HOLDS if one.as_well else Verdict.FAILS,
        )
        for one in claim.ablations
    ]

    def place(ax: Axes) -> None:
        _ratios(ax, points, 1.0)
        ax.set_xlabel(f"{figure} over that of the law judged [1]", fontsize=7.5)

    text = "Simpler laws beside the one that is judged; full where it does as well, within a tenth"
    return _dot_plot(f"What carries it? {claim.claim.says}", text, points, place)


def _scaled(interval: Interval, scale: float) -> Interval:
    return interval._replace(value=interval.value * scale, low=interval.low * scale, high=interval.high * scale)


def _axis(ax: Axes, points: Sequence[Point], measure: Measure, scale: float) -> None:
    """Set scale, threshold and label of a forest plot."""
    threshold = measure.threshold
    label, limit = f"{measure.figure} [{unit_of(measure.figure)[0]}]", threshold.limit * scale
    if measure.relation == "ratio":
        _ratios(ax, points, limit)
        label = f"ratio of {measure.figure} [1]; grey: alike within a tenth"
    elif measure.relation == "share":
        ax.set_xlim(-0.03, 1.03)
        label = "share of draws [1]"
    else:
        known = [x for point in points for x in point.interval[:3] if math.isfinite(x)]
        low, high = min([*known, limit, 0.0]), max([*known, limit])
        margin = 0.06 * ((high - low) or 1.0)
        ax.set_xlim(low - margin, high + margin)
    ax.axvline(limit, color="0.2", linewidth=0.9, linestyle=(0, (4.0, 2.0)), zorder=1.0)
    ax.set_xlabel(f"{label}; dashed: holds {threshold.side}", fontsize=7.5)


def _ratios(ax: Axes, points: Sequence[Point], limit: float) -> None:
    """Set a logarithmic axis of ratios, with a grey band in which two laws count as alike."""
    known = [x for point in points for x in point.interval[:3] if 0.0 < x < math.inf]
    low, high = 0.8 * min([*known, limit, 0.9]), 1.25 * max([*known, limit, 1.1])
    ax.axvspan(1.0 - ALIKE, 1.0 + ALIKE, color="0.9", zorder=-0.5)
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 500.0 * low else (1.0,), numticks=12))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))


def _numbers(interval: Interval) -> str:
    """Return value, interval and number of draws; in the unit of the axis."""
    if math.isnan(interval.value):
        return f"no figure; {interval.failed[0]} failed"
    text = f"{interval.value:.3g}"
    if interval.n == 1 and math.isinf(interval.low):
        text += " [unknown]"
    elif interval.n > 1:
        text += f" [{interval.low:.3g}, {interval.high:.3g}]"
    failed = sum(interval.failed)
    return f"{text}  n = {interval.n}" + (f", {failed} failed" if failed else "")
