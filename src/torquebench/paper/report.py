"""The study as one page of HTML without links to anything outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torquebench.paper.checks import Chattering
from torquebench.paper.runs import Apart
from torquebench.paper.verdicts import FAILS, HOLDS, ONLY_IF, Claim
from torquebench.report.render import Picture, render

CLASSES = {HOLDS: "holds", FAILS: "fails", ONLY_IF: "only"}
AGREE = 1e-12
"""Difference of the two plants up to which they agree [rad]."""


def page(
    claims: Sequence[Claim], pictures: Sequence[Picture], apart: Mapping[tuple[str, str, str], Apart],
    chattering: Sequence[Chattering], noise: Mapping[str, Any], workload: str, software: str,
) -> bytes:  # fmt: skip
    """Return the page; the same arguments give the same bytes.

    Args:
        claims: The table.
        pictures: Figures, as SVG documents.
        apart: How far the plants are from one another, by config, chain and controller.
        chattering: Chattering indices by control period.
        noise: What `checks.noise_spectrum` found, and the ``definition``.
        workload: What was run, in words.
        software: Versions and machine.
    """
    rows = [(*key, value.position, value.torques) for key, value in apart.items()]
    return render(
        "paper", figures=list(pictures), title="The paper's claims, measured",
        lead="Each claim is judged from stored metrics, at two gain sets, on three chains of sensors and actuators, "
        "with and without model error and noise. An interval that reaches the other side does not count as true.",
        claims=claims, classes=CLASSES, agreement={"rows": rows, "text": agreement_text(apart)},
        chattering=chattering, noise=noise, workload=workload, software=software,
    )  # fmt: skip


def agreement_text(apart: Mapping[tuple[str, str, str], Apart]) -> str:
    """Return how far the two plants are from one another, in words."""
    beyond = {key: value for key, value in apart.items() if not value.position <= AGREE}
    close = [value.position for value in apart.values() if value.position <= AGREE]
    text = (
        f"{len(close)} of {len(apart)} runs agree within {AGREE:g} rad, at most {max(close, default=0.0):.2g} rad apart"
    )
    if not beyond:
        return text + "."
    names = sorted({controller for _, _, controller in beyond})
    torques = sum(value.torques for value in beyond.values())
    worst = max(value.position for value in beyond.values())
    return (
        f"{text}; the others ({', '.join(names)}) at most {worst:.2g} rad. "
        f"In those {torques} of the commanded torques differ."
    )
