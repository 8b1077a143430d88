"""The study as one page of HTML without links to anything outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torquebench.paper.checks import Chattering
from torquebench.paper.records import LOST, Record, Records
from torquebench.paper.runs import Apart
from torquebench.paper.verdicts import FAILS, HOLDS, ONLY_IF, Claim
from torquebench.paper.workload import CHAINS, NOMINAL
from torquebench.report.render import Picture, render
from torquebench.report.tables import number

CLASSES = {HOLDS: "holds", FAILS: "fails", ONLY_IF: "only"}
AGREE = 1e-12
"""Difference of the two plants up to which they agree [rad]."""


def page(
    claims: Sequence[Claim],
    records: Records,
    pictures: Sequence[Picture],
    apart: Mapping[tuple[str, str, str, str], Apart],
    chattering: Sequence[Chattering],
    noise: Mapping[str, Any],
    workload: str,
    software: str,
) -> bytes:
    """Return the page; the same arguments give the same bytes.

    Args:
        claims: The table.
        records: The runs.
        pictures: Figures, as SVG documents.
        apart: How far the plants are from one another, by config, chain, condition and controller.
        chattering: Chattering indices by control period.
        noise: What `checks.noise_spectrum` found, and the ``definition``.
        workload: What was run, in words.
        software: Versions and machine.
    """
    rows = [(*key, value.position, value.torques) for key, value in apart.items()]
    return render(
        "paper",
        figures=list(pictures),
        title="The paper's claims, measured",
        lead="Each claim is judged from stored metrics, at two gain sets, on three chains of sensors and actuators, "
        "with and without model error and noise. An interval that reaches the other side does not count as true.",
        claims=claims,
        lost=lost_text(records),
        classes=CLASSES,
        agreement={"rows": rows, "text": agreement_text(apart)},
        controllers=controller_rows(records),
        chains=CHAINS,
        chattering=chattering,
        noise=noise,
        workload=workload,
        software=software,
    )


def controller_rows(records: Records) -> list[list[str]]:
    """Return a row for each controller that follows the sine with nothing in its way: RMSE [mrad] and HF by chain."""
    found: dict[str, dict[str, Record]] = {}
    for record in records.all:
        if (record.reference, record.condition, record.plant) == ("sine", NOMINAL, "mujoco"):
            found.setdefault(record.controller, {})[record.chain] = record
    rows = []
    for name, chains in found.items():
        values = [chains[chain].values for chain in CHAINS]
        figures = [(value.get("rmse"), value.get("hf")) for value in values]
        rows.append([name, *(text for rmse, hf in figures for text in (number(rmse, 1e3), number(hf)))])
    return rows


def lost_text(records: Records) -> str:
    """Return which runs completed, but nowhere near their reference, in words."""
    places = [
        f"{name} ({reference}, {chain} chain, {condition}: {count})"
        for (reference, chain, condition, name), count in records.lost().items()
    ]
    if not places:
        return f"every run that completed kept within an RMSE of {LOST:g} rad on the sine"
    return f"completed, but lost the sine by an RMSE above {LOST:g} rad: {', '.join(places)}"


def agreement_text(apart: Mapping[tuple[str, str, str, str], Apart]) -> str:
    """Return how far the two plants are from one another, in words."""
    beyond = {key: value for key, value in apart.items() if not value.position <= AGREE}
    close = [value.position for value in apart.values() if value.position <= AGREE]
    text = (
        f"{len(close)} of {len(apart)} runs agree within {AGREE:g} rad, at most {max(close, default=0.0):.2g} rad apart"
    )
    if not beyond:
        return text + "."
    names = sorted({controller for _, _, _, controller in beyond})
    torques = sum(value.torques for value in beyond.values())
    worst = max(value.position for value in beyond.values())
    return (
        f"{text}; the others ({', '.join(names)}) at most {worst:.2g} rad. "
        f"In those {torques} of the commanded torques differ."
    )
