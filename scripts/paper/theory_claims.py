"""The claims that the paper argues for, each a pure function of the runs: estimation, insensitivity, stability."""

from __future__ import annotations

from collections.abc import Mapping

from paper.figure_claims import UNCERTAIN_STEP, WRONG_MODEL
from paper.runs_table import Runs, known, ratio_of
from paper.verdicts import NO_CHANGE, Case, Claim, ablated, above, as_well, average, below, judged, text
from paper.workload import CHAINS, FEW_DRAWS, FRICTION, MISMATCH, NOMINAL, PAYLOAD, UNCERTAIN
from torquebench.statistics import Ratio

AN_ESTIMATE = 0.5
"""Share of the equivalent dynamics from which the fuzzy part counts as its estimate [1]."""
BORNE_OUT = 0.0
"""Least eta over K outside the layer above which (124) is borne out [1]."""


def fuzzy_estimates_dynamics(x: Runs) -> Claim:
    """The fuzzy part estimates the equivalent dynamics."""
    cases = [
        above(
            f"set {name[-1].upper()}",
            ("sine", "ideal", UNCERTAIN),
            average(x.values("fuzzy_share", name, "sine", "ideal", UNCERTAIN)),
            AN_ESTIMATE,
        )
        for name in ("proposed-l", "proposed-m")
    ]
    tried = {
        "with clip(x + y) for the 49 rules": ablated(x, "l-clipped-sum", "ideal"),
        "without them": ablated(x, "l-no-fuzzy", "ideal"),
    }
    return judged(
        "the fuzzy part estimates the arm's equivalent dynamics",
        "(150), (151)",
        f"share of the inverse dynamics that the fuzzy torque supplies; true above {AN_ESTIMATE:g}",
        cases,
        ablation=f"RMSE over the proposed law's, set L, ideal chain: {as_well(tried)}",
        config="configs/paper/fig11-noise.yaml",
        overrides=(WRONG_MODEL,),
    )


def insensitive_to_model(x: Runs) -> Claim:
    """The proposed law reduces the sensitivity to the dynamic formulation."""

    def growth(name: str, condition: str) -> Ratio:
        drawn = x.values("rmse", name, "sine", "ideal", condition)
        return ratio_of(drawn, x.values("rmse", name, "sine", "ideal", NOMINAL) * len(drawn))

    names = ("proposed-m-model", "proposed-l-model", "proposed-m", "proposed-l")
    cases = [
        below(
            f"set {name.split('-')[1].upper()}{' with model' if name.endswith('model') else ''}",
            ("sine", "ideal", condition),
            growth(name, condition),
            NO_CHANGE,
        )
        for condition in (MISMATCH, PAYLOAD, FRICTION)
        for name in names
    ]
    better = x.ratio("rmse", "proposed-m-model", "proposed-m", "sine", "ideal", MISMATCH)
    return judged(
        "the proposed law is insensitive to the dynamic model",
        "(150), (151)",
        f"RMSE with a wrong model, a payload or friction over RMSE without; true below {NO_CHANGE:g}",
        cases,
        ablation="a law without a model cannot notice a wrong one; RMSE of set M with the wrong model "
        f"x{text(better)} of set M without",
        config="configs/paper/fig11-noise.yaml",
        overrides=(WRONG_MODEL, "disturbances=[]"),
    )


def conventional_is_stable(x: Runs) -> Claim:
    """Conventional sliding mode is stable: dV/dt <= -sum eta |S|."""
    cases, idle = _etas(x, {"conventional": "conventional"})
    drawn = x.values("eta", "conventional", "sine", "ideal", UNCERTAIN)[:FEW_DRAWS]
    fell = sum(value is not None and value > BORNE_OUT for value in drawn)
    return judged(
        "conventional sliding mode control is stable by dV/dt <= -sum eta |S|",
        "(108)-(124)",
        ETA + idle,
        cases,
        ablation=f"{UNCERTAIN}, ideal chain: all eta_i are positive in {fell} of {len(drawn)} draws; {_failed(x)}",
        config="configs/paper/fig10-step.yaml",
        overrides=UNCERTAIN_STEP,
    )


def proposed_is_stable(x: Runs) -> Claim:
    """The proposed law is stable: dV/dt <= -sum zeta |S|."""
    cases, idle = _etas(
        x,
        {
            "set M": "proposed-m",
            "set L": "proposed-l",
            "set M with model": "proposed-m-model",
            "set L with model": "proposed-l-model",
        },
    )
    rising = x.values("rising", "proposed-m", "step", "ideal", NOMINAL)[0] or 0.0
    return judged(
        "the proposed law is stable by dV/dt <= -sum zeta |S|",
        "(143)-(144)",
        ETA + idle,
        cases,
        ablation=f"set M, step, ideal chain: V grew in {100.0 * rising:.3g} % of the instants outside the layer; "
        f"{_failed(x)}",
        config="configs/paper/fig10-step.yaml",
        overrides=UNCERTAIN_STEP,
    )


ETA = "least eta_i / K_i of (124), as it came out, of a joint outside its layer; true above 0"


def _etas(x: Runs, names: Mapping[str, str]) -> tuple[list[Case], str]:
    """Return a case for each place in which a joint left its layer, and how many there were without, in words."""
    places = [(ref, "ideal", UNCERTAIN) for ref in ("step", "sine")]
    places += [(ref, chain, NOMINAL) for ref in ("step", "sine") for chain in CHAINS]
    cases: list[Case] = []
    idle = 0
    for place in places:
        for who, name in names.items():
            runs = x.of(name, *place)[:FEW_DRAWS]
            runs = runs[runs["outside"] != 0.0]
            if len(runs):
                cases.append(above(who, place, average(known(runs["eta"])), BORNE_OUT))
            else:
                idle += 1
    places_tried = len(places) * len(names)
    return cases, f"; in {idle} of {places_tried} conditions no joint leaves its layer: no case" if idle else ""


def _failed(x: Runs) -> str:
    failed = int((x.table["outcome"] != "COMPLETED").sum())
    return f"{failed} of the study's {len(x.table)} runs failed" if failed else "no run of the study failed"


def workable_as_printed(x: Runs) -> Claim:
    """Equation (98) with the measured acceleration."""
    cases = [
        below(
            "(98) as printed",
            ("sine", chain, NOMINAL),
            x.ratio("rmse", "equation-98", "conventional", "sine", chain, NOMINAL),
            NO_CHANGE,
        )
        for chain in CHAINS
    ]
    hf = x.values("hf", "equation-98", "sine", "ideal", NOMINAL)[0]
    ringing = "the run failed" if hf is None else f"HF {hf:.3g} % of the limit"
    return judged(
        "the equivalent control works as printed, with the measured acceleration",
        "(98), (106), (151)",
        f"RMSE of (98) as printed over that of conventional control; true below {NO_CHANGE:g}",
        cases,
        ablation=f"ideal chain: {ringing}; qdd_ref + lambda de for the measured acceleration works",
        config="configs/paper/literal.yaml",
    )
