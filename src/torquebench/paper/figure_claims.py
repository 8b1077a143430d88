"""The claims that the paper reads off Figs 9 to 11, each a pure function of the records."""

from __future__ import annotations

from torquebench.paper.records import Records
from torquebench.paper.verdicts import Claim, ablated, below, judged, text
from torquebench.paper.workload import BIAS, CHAINS, LIMIT_NOISE, NOMINAL, SINUSOID, SLOW_NOISE, STRONG, UNCERTAIN
from torquebench.statistics import geometric_mean

NO_CHATTERING = 1.0
"""HF below which chattering counts as removed [% of the torque limit]."""
SETS = {
    "set L": ("proposed-l", "conventional"),
    "set L with model": ("proposed-l-model", "conventional"),
    "set L, no model on either side": ("proposed-l", "conventional-blind"),
    "set M": ("proposed-m", "conventional-m"),
    "set M with model": ("proposed-m-model", "conventional-m"),
}
"""Proposed and conventional controllers by gain set."""


def removes_chattering(x: Records) -> Claim:
    """Fig 9: the linear band removes chattering."""
    cases = [
        below("linear band", (ref, chain, condition),
              geometric_mean(x.values("hf", "linear-band", ref, chain, condition)), NO_CHATTERING)
        for condition, refs in ((NOMINAL, ("sine", "step", "ramp")), (UNCERTAIN, ("sine",)))
        for chain in CHAINS for ref in refs
    ]  # fmt: skip
    band = x.ratio("hf", "band", "linear-band", "sine", "slow", UNCERTAIN)
    less = x.ratio("hf", "linear-band", "conventional", "sine", "slow", UNCERTAIN)
    return judged(
        "linear band control removes the chattering of conventional sliding mode control", "Fig 9, (148)",
        f"HF of the linear band [% of the limit], the ramp's own corner included; true below {NO_CHATTERING:g}", cases,
        ablation=f"slow chain with noise: HF x{text(less)} of conventional; the band alone x{text(band)} of that",
        config="configs/paper/fig9-chattering.yaml",
    )  # fmt: skip


def removes_chattering_as_printed(x: Records) -> Claim:
    """Equation (149) keeps sgn(S)."""
    cases = [
        below("(149) with sgn", ("sine", chain, NOMINAL),
              x.ratio("hf", "equation-149", "conventional", "sine", chain, NOMINAL))
        for chain in CHAINS
    ]  # fmt: skip
    return judged(
        "the linear term beside sgn(S) attenuates chattering, as printed", "(149)",
        "HF of K sgn(s) + Kd s over that of K sgn(s), both with tau_eq; true below 1", cases,
        ablation="none: it is the conventional law with a term more", config="configs/paper/literal.yaml",
    )  # fmt: skip


def negligible_error(x: Records) -> Claim:
    """Fig 9: with negligible tracking error."""
    cases = [
        below("linear band", (ref, chain, condition),
              x.ratio("rmse", "linear-band", "conventional", ref, chain, condition))
        for condition, refs in ((UNCERTAIN, ("sine",)), (NOMINAL, ("sine", "step", "ramp")))
        for chain in CHAINS for ref in refs
    ]  # fmt: skip
    band = x.ratio("rmse", "band", "conventional", "sine", "ideal", UNCERTAIN)
    return judged(
        "the band costs a negligible tracking error", "Fig 9",
        "RMSE of the linear band over that of conventional control; true below 1", cases,
        ablation=f"the band alone, ideal chain with noise: x{text(band)}", config="configs/paper/fig9-noise.yaml",
    )  # fmt: skip


def conventional_is_faster(x: Records) -> Claim:
    """Fig 10: conventional sliding mode is faster than the proposed law."""
    strong = {
        "set L against all torque switching": ("proposed-l", STRONG),
        "set M against all torque switching": ("proposed-m", STRONG),
    }
    cases = [
        below(name if key == "rise_time" else f"{name}, settling", ("step", chain, condition),
              x.ratio(key, conventional, proposed, "step", chain, condition))
        for key in ("rise_time", "settling_time")
        for condition, chains in ((UNCERTAIN, ("ideal",)), (NOMINAL, CHAINS))
        for chain in chains for name, (proposed, conventional) in (SETS | strong).items()
    ]  # fmt: skip
    over = [
        x.values("overshoot", name, "step", "ideal", NOMINAL)[0] or 0.0
        for name in ("proposed-m", "conventional-m", STRONG)
    ]
    return judged(
        "conventional control is faster than the proposed law", "Fig 10",
        "rise time 10-90 % of conventional control over that of the proposed law, or settling time where named; true "
        "below 1", cases,
        ablation=f"overshoot, ideal chain: proposed, set M {over[0]:.3g} %; conventional, set M {over[1]:.3g} %; "
        f"with all torque switching, lambda 40, no model {over[2]:.3g} %",
        config="configs/paper/fig10-step.yaml",
    )  # fmt: skip


def rejects_noise(x: Records) -> Claim:
    """Fig 11: the proposed law rejects the noise better."""
    places = [(chain, UNCERTAIN) for chain in CHAINS]
    cases = [
        below(name, ("sine", chain, condition), x.ratio("rmse", proposed, conventional, "sine", chain, condition))
        for chain, condition in places for name, (proposed, conventional) in SETS.items()
    ]  # fmt: skip
    cases += [
        below(name, ("sine", "ideal", condition), x.ratio("rmse", *SETS[name], "sine", "ideal", condition))
        for condition in (SLOW_NOISE, LIMIT_NOISE, BIAS, SINUSOID) for name in ("set L", "set M")
    ]  # fmt: skip
    return judged(
        "the proposed law rejects the 30 % noise better than conventional control", "Fig 11",
        "RMSE of the proposed law over that of conventional control under model error and noise; true below 1", cases,
        ablation="RMSE over the proposed law's, set M, slow chain: without the fuzzy part "
        f"x{text(ablated(x, 'm-no-fuzzy', 'slow'))}; "
        f"with clip(x + y) for it x{text(ablated(x, 'm-clipped-sum', 'slow'))}; "
        f"without the integral x{text(ablated(x, 'm-no-integral', 'slow'))}",
        config="configs/paper/fig11-noise.yaml",
    )  # fmt: skip
