"""The claims that the paper argues for: estimation, insensitivity, stability; each a pure function of the records."""

from __future__ import annotations

from torquebench.paper.records import Records
from torquebench.paper.verdicts import Case, Claim, ablated, above, average, below, judged, text
from torquebench.paper.workload import CHAINS, FRICTION, MISMATCH, NOMINAL, PAYLOAD, UNCERTAIN
from torquebench.statistics import Ratio, paired_ratio

NO_CHANGE = 1.1
"""Growth of the error up to which a law counts as insensitive, or as no worse [1]."""
AN_ESTIMATE = 0.5
"""Share of the equivalent dynamics from which the fuzzy part counts as its estimate [1]."""
PROVEN = 0.0
"""Least margin of K over (123), as a share of K, from which stability is proven [1]."""


def fuzzy_estimates_dynamics(x: Records) -> Claim:
    """The fuzzy part estimates the equivalent dynamics."""
    cases = [
        above(f"set {name[-1].upper()}", ("sine", "ideal", UNCERTAIN),
              average(x.values("fuzzy_share", name, "sine", "ideal", UNCERTAIN)), AN_ESTIMATE)
        for name in ("proposed-l", "proposed-m")
    ]  # fmt: skip
    return judged(
        "the fuzzy part estimates the arm's equivalent dynamics", "(150), (151)",
        f"share of the inverse dynamics that the fuzzy torque supplies; true above {AN_ESTIMATE:g}", cases,
        ablation="RMSE over the proposed law's, set L, ideal chain: with clip(x + y) for the 49 rules "
        f"x{text(ablated(x, 'l-clipped-sum', 'ideal'))}, "
        f"without them x{text(ablated(x, 'l-no-fuzzy', 'ideal'))}",
        config="configs/paper/ablations.yaml",
    )  # fmt: skip


def insensitive_to_model(x: Records) -> Claim:
    """The proposed law reduces the sensitivity to the dynamic formulation."""

    def growth(name: str, condition: str) -> Ratio:
        drawn = x.values("rmse", name, "sine", "ideal", condition)
        return paired_ratio(drawn, x.values("rmse", name, "sine", "ideal", NOMINAL) * len(drawn))

    names = ("proposed-m-model", "proposed-l-model", "proposed-m", "proposed-l")
    cases = [
        below(f"set {name.split('-')[1].upper()}{' with model' if name.endswith('model') else ''}",
              ("sine", "ideal", condition), growth(name, condition), NO_CHANGE)
        for condition in (MISMATCH, PAYLOAD, FRICTION) for name in names
    ]  # fmt: skip
    better = x.ratio("rmse", "proposed-m-model", "proposed-m", "sine", "ideal", MISMATCH)
    return judged(
        "the proposed law is insensitive to the dynamic model", "(150), (151)",
        f"RMSE with a wrong model, a payload or friction over RMSE without; true below {NO_CHANGE:g}", cases,
        ablation="a law without a model cannot notice a wrong one; yet the wrong model still helps: set M with it "
        f"x{text(better)} of set M without",
        config="configs/paper/fig9-mismatch.yaml",
    )  # fmt: skip


def conventional_is_stable(x: Records) -> Claim:
    """Conventional sliding mode is stable: dV/dt <= -sum eta |S|."""
    return judged(
        "conventional sliding mode control is stable by dV/dt <= -sum eta |S|", "(108)-(124)", MARGIN,
        _margins(x, "conventional"),
        ablation=f"least margin with the band and the linear term in its place: {text(_margin(x, 'linear-band'))}",
        config="configs/paper/fig9-chattering.yaml",
    )  # fmt: skip


def proposed_is_stable(x: Records) -> Claim:
    """The proposed law is stable: dV/dt <= -sum zeta |S|."""
    rising = x.values("rising", "proposed-m", "step", "ideal", NOMINAL)[0] or 0.0
    return judged(
        "the proposed law is stable by dV/dt <= -sum zeta |S|", "(143)-(144)", MARGIN,
        [*_margins(x, "proposed-m"), *_margins(x, "proposed-l")],
        ablation=f"set M, step, ideal chain: V grew in {100.0 * rising:.3g} % of the instants outside the layer; no "
        "run diverged for it",
        config="configs/paper/fig10-following.yaml",
    )  # fmt: skip


MARGIN = "least margin of K over (123) on the run, as a share of K; true above 0"


def _margin(x: Records, name: str) -> Ratio:
    return average(x.values("least_margin", name, "sine", "ideal", UNCERTAIN))


def _margins(x: Records, name: str) -> list[Case]:
    places = [(ref, chain, NOMINAL) for ref in ("sine", "step") for chain in CHAINS]
    nominal = [above(name, place, average(x.values("least_margin", name, *place)), PROVEN) for place in places]
    return [above(name, ("sine", "ideal", UNCERTAIN), _margin(x, name), PROVEN), *nominal]


def workable_as_printed(x: Records) -> Claim:
    """Equation (98) with the measured acceleration."""
    cases = [
        below("(98) as printed", ("sine", chain, NOMINAL),
              x.ratio("rmse", "equation-98", "conventional", "sine", chain, NOMINAL), NO_CHANGE)
        for chain in CHAINS
    ]  # fmt: skip
    hf = x.values("hf", "equation-98", "sine", "ideal", NOMINAL)[0]
    ringing = "the run failed" if hf is None else f"HF {hf:.3g} % of the limit"
    return judged(
        "the equivalent control works as printed, with the measured acceleration", "(98), (106), (151)",
        f"RMSE of (98) as printed over that of conventional control; true below {NO_CHANGE:g}", cases,
        ablation=f"ideal chain: {ringing}; qdd_ref + lambda de for the measured acceleration works",
        config="configs/paper/literal.yaml",
    )  # fmt: skip
