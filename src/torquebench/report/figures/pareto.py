"""Error against chattering: every choice of gains with its intervals, and the front of the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from torquebench.report.figures import style
from torquebench.report.figures.layout import finish_page, new_page
from torquebench.statistics import Ratio


class Spot(NamedTuple):
    """One choice of gains."""

    family: str
    """Choices that are joined by a line, in the order given."""
    label: str
    """Written beside the spot."""
    error: Ratio
    """RMS error [rad, or m]."""
    chattering: Ratio
    """HF [% of the torque limit]."""
    best: bool
    """Whether it is on the front."""


PHI = "its phi [rad/s]"


def draw_pareto(
    spots: Sequence[Spot],
    title: str,
    subtitle: str,
    labels: str = PHI,
    order: Sequence[str] = (),
    joined: bool = True,
    unit: str = "mrad",
    names: Mapping[str, str] | None = None,
) -> Figure:
    """Draw RMS error over chattering index on logarithmic axes, 95 % intervals as bars, the front ringed.

    Args:
        spots: Choices of gains.
        title, subtitle: Headings.
        labels: What the spots' labels are; empty without labels.
        order: Families whose places set colour and dash; empty for those of the spots.
        joined: Whether a line joins the spots of a family.
        unit: Unit of a thousandth of the error.
        names: Family -> how the legend calls it; one without spots is named there all the same.
    """
    families = list(dict.fromkeys((*order, *(spot.family for spot in spots))))
    with style.journal_style():
        fig = new_page(1, 4.6, 4.6)
        ax = fig.add_subplot()
        for axis, figures in ((ax.xaxis, [s.chattering for s in spots]), (ax.yaxis, [s.error for s in spots])):
            style.fit_scale(axis, [figure.low for figure in figures] + [figure.high for figure in figures])
        keys = []
        for index, family in enumerate(families):
            own = [spot for spot in spots if spot.family == family]
            if not own:
                continue
            look = style.spot_look(index) | {"markersize": 4.0, "linewidth": 0.9}
            look |= {} if joined else {"linestyle": "none"}
            x, y = [s.chattering.ratio for s in own], [1e3 * s.error.ratio for s in own]
            ax.errorbar(
                x,
                y,
                elinewidth=0.9,
                capsize=1.5,
                **look,
                xerr=[
                    [a - s.chattering.low for a, s in zip(x, own, strict=True)],
                    [s.chattering.high - a for a, s in zip(x, own, strict=True)],
                ],
                yerr=[
                    [b - 1e3 * s.error.low for b, s in zip(y, own, strict=True)],
                    [1e3 * s.error.high - b for b, s in zip(y, own, strict=True)],
                ],
            )
            keys.append(Line2D([], [], label=(names or {}).get(family, family), **look))
        gone = [name for family, name in (names or {}).items() if family not in {spot.family for spot in spots}]
        keys += [Line2D([], [], linestyle="none", label=name) for name in gone]
        best = [spot for spot in spots if spot.best]
        ring: dict[str, Any] = {
            "marker": "o",
            "markersize": 10.0,
            "markerfacecolor": "none",
            "markeredgecolor": "black",
            "markeredgewidth": 0.8,
            "linestyle": "none",
        }
        ax.plot([s.chattering.ratio for s in best], [1e3 * s.error.ratio for s in best], **ring)
        ax.set_xlabel("chattering index HF [% of tau_max]")
        ax.set_ylabel(f"RMS error [{unit}]")
        keys.append(Line2D([], [], label="no choice is better in both" + (f"; {labels}" if labels else ""), **ring))
        finish_page(fig, title, subtitle, keys)
        _label(ax, best)  # now that the panel has its place
    return fig


BESIDE = ((6.0, -7.0), (-6.0, -7.0), (6.0, 4.0), (-6.0, 4.0), (6.0, -16.0), (-6.0, -16.0), (6.0, 13.0), (-6.0, 13.0))
"""Where a label may stand beside its spot, the first first [pt]; at the left it ends there."""


def _label(ax: Axes, spots: Sequence[Spot]) -> None:
    """Write each spot's label where it meets no earlier one, and stays within the panel, if there is such a place."""
    taken: list[Bbox] = []
    for spot in sorted(spots, key=lambda spot: spot.chattering.ratio):
        label = ax.annotate(
            spot.label,
            (spot.chattering.ratio, 1e3 * spot.error.ratio),
            BESIDE[0],
            textcoords="offset points",
            fontsize=6.5,
            color="0.25",
        )
        for x, y in (*BESIDE, BESIDE[1]):  # at the left, if it meets another one everywhere
            label.set_position((x, y))
            label.set_horizontalalignment("left" if x > 0.0 else "right")
            box = label.get_window_extent()
            inside = ax.bbox.x0 <= box.x0 and box.x1 <= ax.bbox.x1
            if inside and not any(box.overlaps(other) for other in taken):
                break
        taken.append(box)
