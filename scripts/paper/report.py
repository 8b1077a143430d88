"""What the study writes: its runs, claims and checks, Figs 9 to 11, and a page without links to anything outside."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from paper.checks import Chattering, chattering_by_period, noise_spectrum
from paper.claims import claims
from paper.pages import comparison_page
from paper.runs_table import LOST, Runs, known
from paper.study import Apart, Study
from paper.verdicts import FAILS, HOLDS, ONLY_IF, Claim
from paper.workload import CHAINS, NOISE, NOMINAL, RELATIVE
from torquebench.experiment.describe import conditions_text, noise_text
from torquebench.experiment.store import RunDirectory, json_bytes, machine, versions
from torquebench.report.figures.style import figure_bytes
from torquebench.report.render import PAGE, Picture, render
from torquebench.report.tables import number

PAGES: dict[str, tuple[str, tuple[tuple[str, str, str], ...], str]] = {
    "fig9": (
        "Fig 9: chattering",
        (("fig10-following", NOMINAL, "conventional"), ("fig9-chattering", NOMINAL, "linear-band")),
        "Conventional sliding mode and the linear band at the same K, lambda and model.",
    ),
    "fig10": (
        "Fig 10: trajectory following",
        tuple(("fig10-following", NOMINAL, name) for name in ("conventional-m", "proposed-m", "proposed-m-model")),
        "Conventional sliding mode and the proposed law, set M, without and with the model.",
    ),
    "fig11": (
        "Fig 11: 30 % band-limited noise",
        tuple(("fig11-noise", NOISE, name) for name in ("conventional-m", "proposed-m", "proposed-m-model")),
        "The same under the noise, draw 0.",
    ),
}
"""Pages: title, what is drawn, caption."""
CLASSES = {HOLDS: "holds", FAILS: "fails", ONLY_IF: "only"}
AGREE = 1e-12
"""Difference of the two plants up to which they agree [rad]."""


def write_study(
    study: Study, directory: RunDirectory, draws: int, progress: Callable[[str], None] = lambda what: None
) -> list[Claim]:
    """Judge the claims, draw the figures, and write everything to a folder; return the claims.

    Args:
        study: What was run.
        directory: The folder.
        draws: Draws behind each interval.
        progress: Called with what is done next.
    """
    judged = claims(study.runs)
    directory.write("runs.csv", study.runs.to_csv())
    directory.write("claims.json", json_bytes([claim.to_json() for claim in judged]))
    directory.write("claims.md", markdown(judged).encode())
    progress("drawing")
    pictures = [_write_page(study, directory, name) for name in PAGES]
    progress("chattering by control period, spectrum of the noise")
    noisy = study.kept["fig11-noise", NOISE, "proposed-m"].experiment
    chattering, noise = chattering_by_period(), noise_spectrum(1_000_000) | {"definition": noise_text(noisy)}
    facts = {
        "agreement": agreement_facts(study),
        "chattering": [row._asdict() for row in chattering],
        "noise": noise,
    }
    directory.write("checks.json", json_bytes(facts))
    workload = (
        f"{len(study.runs.table):,} closed loops. A wrong model: the controllers' constants wrong by "
        f"{100 * RELATIVE:g} % each, signs drawn; {draws} draws, the same for every law. "
        f"{study.redraws} draws of the model were rejected."
    )
    software = json.dumps(versions() | machine(), indent=2)
    directory.write(PAGE, page(judged, study.runs, pictures, study.apart, chattering, noise, workload, software))
    directory.finish({"name": "paper", "draws": draws, "mismatch_redraws": study.redraws})
    return judged


def _write_page(study: Study, directory: RunDirectory, name: str) -> Picture:
    """Draw one of Figs 9 to 11 and write it as SVG and PNG."""
    title, places, caption = PAGES[name]
    results = {place[2]: study.kept[place] for place in places}
    first = next(iter(results.values()))
    figure = comparison_page(
        {controller: result.runs[controller] for controller, result in results.items()},
        {controller: m for result in results.values() for controller, m in result.metrics.items()},
        title,
        conditions_text(first.experiment),
        joint_names=first.loop.joint_names,
        tau_max=first.loop.plant.tau_max,
        metrics_from=first.experiment.run.metrics_from,
        control_period=first.experiment.run.control_period,
    )
    svg = figure_bytes(figure, "svg")
    directory.write(f"figures/{name}.svg", svg)
    directory.write(f"figures/{name}.png", figure_bytes(figure, "png"))
    return Picture(title, svg, caption)


def page(
    judged: Sequence[Claim],
    runs: Runs,
    pictures: Sequence[Picture],
    apart: Mapping[tuple[str, str, str, str], Apart],
    chattering: Sequence[Chattering],
    noise: Mapping[str, Any],
    workload: str,
    software: str,
) -> bytes:
    """Return the page; the same arguments give the same bytes.

    Args:
        judged: The claims.
        runs: The table of runs.
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
        folder=Path(__file__).parent,
        title="The paper's claims, measured",
        lead="Each claim is judged from stored metrics, at two gain sets, on three chains of sensors and actuators, "
        "with and without model error and noise. An interval that reaches the other side does not count as true.",
        claims=judged,
        lost=lost_text(runs),
        classes=CLASSES,
        agreement={"rows": rows, "text": agreement_text(apart)},
        controllers=controller_rows(runs),
        chains=CHAINS,
        chattering=chattering,
        noise=noise,
        workload=workload,
        software=software,
    )


def controller_rows(runs: Runs) -> list[list[str]]:
    """Return a row for each controller that follows the sine with nothing in its way: RMSE [mrad] and HF by chain."""
    table = runs.table[
        (runs.table["reference"] == "sine") & (runs.table["condition"] == NOMINAL) & (runs.table["plant"] == "mujoco")
    ]
    rows = []
    for name, group in table.groupby("controller", sort=False):
        chains = group[group["draw"] == 0].set_index("chain").loc[list(CHAINS)]
        figures = zip(known(chains["rmse"]), known(chains["hf"]), strict=True)
        rows.append([str(name), *(text for rmse, hf in figures for text in (number(rmse, 1e3), number(hf)))])
    return rows


def lost_text(runs: Runs) -> str:
    """Return which runs completed, but nowhere near their reference, in words."""
    places = [
        f"{name} ({reference}, {chain} chain, {condition}: {count})"
        for (reference, chain, condition, name), count in runs.lost().items()
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


def agreement_facts(study: Study) -> list[dict[str, Any]]:
    """Return how far the two plants are apart, a mapping for each closed loop."""
    return [
        {"config": config, "chain": chain, "condition": condition, "controller": name, **value._asdict()}
        for (config, chain, condition, name), value in study.apart.items()
    ]


def markdown(judged: Sequence[Claim]) -> str:
    """Return the table of claims as Markdown."""
    lines = ["| claim | verdict | figure [95 %] | conditions | what does as well |", "|---|---|---|---|---|"]
    for claim in judged:
        cells = (
            f"{claim.claim}, {claim.where}",
            f"**{claim.verdict}**",
            f"{claim.figure_text}: {claim.measure} ({claim.cases[0].who}; {claim.cases[0].where})",
            claim.condition,
            claim.ablation,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"
