"""The claims that the paper reads off Figs 9 to 11, each a pure function of the runs."""

from __future__ import annotations

from paper.runs_table import Runs
from paper.verdicts import (
    ATTENUATED,
    NO_CHANGE,
    Claim,
    ablated,
    as_well,
    below,
    judged,
    text,
    typical,
)
from paper.workload import (
    BIAS,
    CHAINS,
    EQUAL,
    EXACT,
    LIMIT_NOISE,
    NOISE,
    NOMINAL,
    SINUSOID,
    SLOW_NOISE,
    STRONG,
    UNCERTAIN,
)

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


WRONG_MODEL = "model.mismatch={relative: 0.3}"
"""The error of the model in uncertain conditions, as an override."""
UNCERTAIN_STEP = (
    WRONG_MODEL,
    "disturbances=[{kind: band-limited-noise, channel: torque, sigma: [5.066, 16.59, 3.299, 0.5444, 0.6161, 0.8083], "
    "hold: 0.01}]",
)
"""Model error and the paper's noise, as overrides of a config without."""


def removes_chattering(x: Runs) -> Claim:
    """Fig 9: the linear band removes chattering."""
    places = [(ref, "ideal", NOMINAL) for ref in ("sine", "step", "ramp")]
    places += [("sine", "ideal", condition) for condition in (NOISE, UNCERTAIN)]
    places += [("sine", chain, EXACT) for chain in ("fast", "slow")]
    places += [(ref, chain, NOMINAL) for chain in ("fast", "slow") for ref in ("sine", "step", "ramp")]
    places += [("sine", chain, NOISE) for chain in ("fast", "slow")]
    cases = [
        below("linear band", place, typical(x.values("hf", "linear-band", *place)), NO_CHATTERING) for place in places
    ]
    left = {
        chain: text(x.ratio("hf", "linear-band", "conventional", "sine", chain, NOMINAL)) for chain in ("fast", "slow")
    }
    band = x.ratio("hf", "band", "linear-band", "sine", "slow", NOISE)
    return judged(
        "linear band control removes the chattering of conventional sliding mode control",
        "Fig 9, (148)",
        f"HF of the linear band [% of the limit]; true below {NO_CHATTERING:g}",
        cases,
        ablation=f"with the encoders' noise HF is x{left['fast']} (fast chain) and x{left['slow']} (slow) of "
        f"conventional; the band alone, slow chain with torque noise: x{text(band)} of the linear band",
        config="configs/paper/fig9-chattering.yaml",
    )


def removes_chattering_as_printed(x: Runs) -> Claim:
    """Equation (149) keeps sgn(S)."""
    cases = [
        below(
            "(149) with sgn",
            ("sine", chain, NOMINAL),
            x.ratio("hf", "equation-149", "conventional", "sine", chain, NOMINAL),
            ATTENUATED,
        )
        for chain in CHAINS
    ]
    return judged(
        "the linear term beside sgn(S) attenuates chattering, as printed",
        "(149)",
        f"HF of K sgn(s) + Kd s over that of K sgn(s), both with tau_eq; true below {ATTENUATED:g}",
        cases,
        ablation="none: it is the conventional law with a term more",
        config="configs/paper/literal.yaml",
    )


def negligible_error(x: Runs) -> Claim:
    """Fig 9: with negligible tracking error."""
    cases = [
        below(
            "linear band",
            (ref, chain, condition),
            x.ratio("rmse", "linear-band", "conventional", ref, chain, condition),
            NO_CHANGE,
        )
        for condition, refs, chains in (
            (NOISE, ("sine",), CHAINS),
            (UNCERTAIN, ("sine",), ("ideal",)),
            (NOMINAL, ("sine", "step", "ramp"), CHAINS),
        )
        for chain in chains
        for ref in refs
    ]
    band = x.ratio("rmse", "band", "conventional", "sine", "ideal", NOISE)
    return judged(
        "the band costs a negligible tracking error",
        "Fig 9",
        f"RMSE of the linear band over that of conventional control; true below {NO_CHANGE:g}",
        cases,
        ablation=f"the band alone, ideal chain with noise: x{text(band)}",
        config="configs/paper/fig9-noise.yaml",
    )


def conventional_is_faster(x: Runs) -> Claim:
    """Fig 10: conventional sliding mode is faster than the proposed law."""
    strong = {
        "set L against all torque switching": ("proposed-l", STRONG),
        "set M against all torque switching": ("proposed-m", STRONG),
    }
    cases = [
        below(
            name if key == "rise_time" else f"{name}, settling",
            ("step", chain, condition),
            x.ratio(key, conventional, proposed, "step", chain, condition),
        )
        for key in ("rise_time", "settling_time")
        for condition, chains in ((UNCERTAIN, ("ideal",)), (NOMINAL, CHAINS))
        for chain in chains
        for name, (proposed, conventional) in (SETS | strong).items()
    ]
    over = [
        x.values("overshoot", name, "step", "ideal", NOMINAL)[0] or 0.0
        for name in ("proposed-m", "conventional-m", STRONG)
    ]
    return judged(
        "conventional control is faster than the proposed law",
        "Fig 10",
        "rise time 10-90 % of conventional control over that of the proposed law, or settling time where named; true "
        "below 1",
        cases,
        ablation=f"overshoot, ideal chain: proposed, set M {over[0]:.3g} %; conventional, set M {over[1]:.3g} %; "
        f"with all torque switching, lambda 40, no model {over[2]:.3g} %",
        config="configs/paper/fig10-step.yaml",
        overrides=UNCERTAIN_STEP,
    )


def rejects_noise(x: Runs) -> Claim:
    """Fig 11: the proposed law rejects the noise better."""
    cases = [
        below(name, ("sine", chain, condition), x.ratio("rmse", proposed, conventional, "sine", chain, condition))
        for condition in (NOISE, UNCERTAIN)
        for chain in CHAINS
        for name, (proposed, conventional) in SETS.items()
    ]
    cases += [
        below(name, ("sine", "ideal", condition), x.ratio("rmse", *SETS[name], "sine", "ideal", condition))
        for condition in (SLOW_NOISE, LIMIT_NOISE, BIAS, SINUSOID)
        for name in ("set L", "set M")
    ]
    cases += [
        below(
            f"{name} against as much torque",
            ("sine", "ideal", LIMIT_NOISE),
            x.ratio("rmse", SETS[name][0], rival, "sine", "ideal", LIMIT_NOISE),
        )
        for name, rival in zip(("set L", "set M"), EQUAL, strict=True)
    ]
    tried = {
        "without the fuzzy part": ablated(x, "m-no-fuzzy", "slow"),
        "with clip(x + y) for it": ablated(x, "m-clipped-sum", "slow"),
        "without the integral": ablated(x, "m-no-integral", "slow"),
        "with sgn for the band": ablated(x, "m-no-band", "slow"),
        "computed torque with an integral": ablated(x, "m-computed-torque", "slow"),
        "PID": ablated(x, "m-pid", "slow"),
    }
    return judged(
        "the proposed law rejects the 30 % noise better than conventional control",
        "Fig 11",
        "RMSE of the proposed law over that of conventional control under noise; true below 1",
        cases,
        ablation=f"RMSE over the proposed law's, set M, slow chain, {UNCERTAIN}: {as_well(tried)}",
        config="configs/paper/fig11-noise.yaml",
    )
