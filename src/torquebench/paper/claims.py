"""The table of claims: every one judged from the records, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable

from torquebench.paper import figure_claims, theory_claims
from torquebench.paper.records import Records
from torquebench.paper.verdicts import Claim

CLAIMS: tuple[Callable[[Records], Claim], ...] = (
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


def claims(records: Records) -> list[Claim]:
    """Judge every claim; nothing but the records decides."""
    return [judge(records) for judge in CLAIMS]
