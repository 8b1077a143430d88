"""The table of claims: every one judged from the table of runs, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable

from paper import figure_claims, theory_claims
from paper.runs_table import Runs
from paper.verdicts import Claim

CLAIMS: tuple[Callable[[Runs], Claim], ...] = (
    figure_claims.removes_chattering,
    figure_claims.removes_chattering_as_printed,
    figure_claims.negligible_error,
    figure_claims.conventional_is_faster,
    figure_claims.rejects_noise,
    theory_claims.fuzzy_estimates_dynamics,
    theory_claims.insensitive_to_model,
    theory_claims.conventional_is_stable,
    theory_claims.proposed_is_stable,
    theory_claims.workable_as_printed,
)
"""How each claim is judged."""


def claims(runs: Runs) -> list[Claim]:
    """Judge every claim; nothing but the runs decides."""
    return [judge(runs) for judge in CLAIMS]
