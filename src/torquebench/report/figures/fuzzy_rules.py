"""Rules of a law's fuzzy system that fired in a run: their shares, and the rule table of each joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from torquebench.errors import ResultError
from torquebench.fuzzy import Fis, FuzzySystem, Prepared
from torquebench.fuzzy.inference import fill_activations
from torquebench.kernel import Array
from torquebench.report.figures.layout import finish_page, panel_grid
from torquebench.report.figures.run_view import RunView
from torquebench.sim.trajectory import Trajectory

SEQUENTIAL = LinearSegmentedColormap.from_list("share", ["#FFFFFF", "#0072B2", "#00263D"])


def rule_shares(gains: Any, fis: Fis, inputs: Callable[..., tuple[float, float]] | None, run: Trajectory) -> Array:
    """Return the share of each rule in a run, (n, n1, n2); the shares of a joint add up to 1.

    A rule's share is the mean over the control instants of its activation over the sum of all rules' activations.
    Where no rule fires, or the state is not finite, no rule gets anything.

    Args:
        gains: The gains the law received.
        fis: The fuzzy system in it.
        inputs: The law's own scaling of the system's inputs, `Rules.inputs`.
        run: The run; the inputs follow from what the law measured.

    Raises:
        ResultError: the law does not say how it scales the inputs.
    """
    if inputs is None:
        raise ResultError("the law's Rules do not say how it scales the inputs of its fuzzy system")
    e: Array = run.q_ref - run.q_meas
    de: Array = run.qd_ref - run.qd_meas
    shares = np.zeros((run.q.shape[1], *fis.rules.shape))
    fired: Array = np.zeros(fis.rules.shape)
    columns = 1 if fis.inputs == 1 else fired.shape[1]
    for k, i in np.argwhere(np.isfinite(e) & np.isfinite(de)).tolist():
        fill_activations(fis, *inputs(gains, i, float(e[k, i]), float(de[k, i])), fired)
        total = fired[:, :columns].sum()
        if total > 0.0:
            shares[i] += fired / (total * len(e))
    return shares


def draw_rules(x: RunView) -> dict[str, Figure]:
    """Draw which rules of its fuzzy system fired in the run of each controller that has one."""
    return {
        name: rule_tables(
            x.fuzzy[fired.system],
            fired.shares,
            x.joint_names,
            f"{x.title}: rules of {fired.system} that fired under {name}",
            x.subtitle,
        )
        for name, fired in x.fired.items()
    }


def rule_tables(prepared: Prepared, shares: Array, joint_names: Sequence[str], title: str, subtitle: str) -> Figure:
    """Draw how much each rule took part in a run: a panel with the rule table for each joint.

    Args:
        prepared: The system.
        shares: Share of each rule in the firing of all, see `rule_shares`, (n, n1, n2).
        joint_names: One for each joint, n of them.
        title, subtitle: Heading of the page.
    """
    system = prepared.system
    columns = len(system.columns[1]) if len(system.inputs) == 2 else 1
    second = "input 2 [term]" if columns > 1 else ""
    fig, panels = panel_grid(joint_names, "input 1 [term]", [second] * len(joint_names))
    top = max(float(shares.max()), 1e-12)
    for ax, share in zip(panels, shares, strict=True):
        _table(ax, system, share[:, :columns], top)
    handles = [
        Patch(color=SEQUENTIAL(0.6), label="share of the rule in the firing of all, mean over the run [%]"),
        Patch(facecolor="0.93", label="did not fire"),
    ]
    finish_page(fig, title, subtitle, handles)
    return fig


def _table(ax: Axes, system: FuzzySystem, share: Array, top: float) -> None:
    ax.set_facecolor("0.93")
    norm = PowerNorm(0.5, 0.0, top)  # roots: one rule often has nearly all of it
    ax.pcolormesh(np.ma.masked_equal(share, 0.0).T, cmap=SEQUENTIAL, norm=norm, edgecolors="white", lw=0.8)
    for i, j in np.ndindex(share.shape):
        if share[i, j] > 0.0:
            light = norm(share[i, j]) > 0.4
            percent = 100.0 * share[i, j]
            text = f"{percent:.0f}" if percent >= 9.95 else f"{percent:.2g}" if percent >= 0.1 else "<0.1"
            ax.text(i + 0.5, j + 0.5, text, ha="center", va="center", fontsize=6.0, color="white" if light else "0.2")
    ax.grid(False)
    ax.set_xticks(np.arange(share.shape[0]) + 0.5, system.columns[0])
    second = system.columns[1] if len(system.inputs) == 2 else ()
    ax.set_yticks(np.arange(len(second)) + 0.5, second)
    ax.tick_params(length=0.0)
