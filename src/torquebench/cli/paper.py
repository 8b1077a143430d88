"""``torquebench paper``: Figs 9 to 11, every claim judged, and one report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.errors import ConfigError, Problem
from torquebench.experiment.describe import conditions_text, noise_text
from torquebench.experiment.store import RunDirectory, claim_folder, json_bytes, machine, versions
from torquebench.paper.claims import claims
from torquebench.paper.report import agreement_text, lost_text, page
from torquebench.paper.runs import Study, run_study, steps_of
from torquebench.paper.verdicts import FAILS, HOLDS, Claim
from torquebench.paper.workload import NOISE, NOMINAL, PAIRED_DRAWS, RELATIVE
from torquebench.report.render import PAGE, Picture

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
TONES = {HOLDS: good, FAILS: bad}


def paper(options: Any) -> int:
    """Run the study and write what came out; return 0.

    Args:
        options: Arguments of the command; see ``torquebench paper --help``.

    Raises:
        ConfigError: bad arguments.
    """
    if options.workers < 1:
        raise ConfigError([Problem("--workers", str(options.workers), "wanted at least 1")])
    draws = PAIRED_DRAWS["quick" if options.quick else "full"]
    directory = RunDirectory(claim_folder(options.out, "paper"))
    with progress_bar(steps_of(draws), "step", "starting (compiles on first use)") as bar:

        def report(what: str, steps: int) -> None:
            bar.describe(what)
            bar.update(steps)

        study = run_study(draws, options.workers, report)
    directory.write("runs.json", json_bytes(study.records.to_json()))
    table_of = claims(study.records)
    directory.write("claims.json", json_bytes([claim.to_json() for claim in table_of]))
    directory.write("claims.md", markdown(table_of).encode())
    pictures = write_pages(study, directory)
    write_report(study, table_of, pictures, directory, draws)
    directory.finish({"name": "paper", "draws": draws, "mismatch_redraws": study.redraws})
    tell(
        directory=directory.folder,
        draws=draws,
        claims=[claim.to_json() for claim in table_of],
        plants_apart=agreement_facts(study),
    )
    say(claims_table(table_of))
    say()
    say(f"two plants: {agreement_text(study.apart)}")
    say(lost_text(study.records))
    say(f"results: {directory.folder}")
    return 0


def write_pages(study: Study, directory: RunDirectory) -> list[Picture]:
    """Draw Figs 9 to 11 and write them as SVG and PNG.

    Args:
        study: What was run.
        directory: Where.
    """
    from torquebench.experiment.run import metrics_of
    from torquebench.report.figures.paper_pages import comparison_page
    from torquebench.report.figures.style import figure_bytes

    pictures = []
    with progress_bar(2 * len(PAGES), "figure", "drawing") as bar:
        for name, (title, places, caption) in PAGES.items():
            kept = {place[2]: study.kept[place] for place in places}
            experiment, loop, _ = next(iter(kept.values()))
            metrics = {}
            for controller, (own, there, run) in kept.items():
                keys = next(keys for keys in own.controllers if keys.name == controller)
                if run.completed:
                    metrics[controller] = metrics_of(own, there, keys, run)
            figure = comparison_page(
                {controller: run for controller, (_, _, run) in kept.items()},
                metrics,
                title,
                conditions_text(experiment),
                joint_names=loop.joint_names,
                tau_max=loop.plant.tau_max,
                metrics_from=experiment.run.metrics_from,
                control_period=experiment.run.control_period,
            )
            content = {}
            for fmt in ("svg", "png"):
                content[fmt] = figure_bytes(figure, fmt)
                directory.write(f"figures/{name}.{fmt}", content[fmt])
                bar.update(1)
            pictures.append(Picture(title, content["svg"], caption))
    return pictures


def write_report(
    study: Study, table_of: list[Claim], pictures: list[Picture], directory: RunDirectory, draws: int
) -> None:
    """Measure what the study rests on, and write the page and the numbers it shows.

    Args:
        study: What was run.
        table_of: The claims.
        pictures: The figures.
        directory: Where.
        draws: Draws behind each interval.
    """
    from torquebench.paper.checks import chattering_by_period, noise_spectrum

    noisy = study.kept["fig11-noise", NOISE, "proposed-m"][0]
    with progress_bar(2, "check", "chattering by control period") as bar:
        chattering = chattering_by_period()
        bar.describe("spectrum of the noise")
        bar.update(1)
        noise = noise_spectrum(1_000_000) | {"definition": noise_text(noisy)}
    facts: Mapping[str, Any] = {
        "agreement": agreement_facts(study),
        "chattering": [row._asdict() for row in chattering],
        "noise": noise,
    }
    directory.write("checks.json", json_bytes(facts))
    workload = (
        f"{len(study.records.all):,} closed loops. A wrong model: the controllers' constants wrong by "
        f"{100 * RELATIVE:g} % each, signs drawn; {draws} draws, the same for every law. "
        f"{study.redraws} draws of the model were rejected."
    )
    software = json.dumps(versions() | machine(), indent=2)
    directory.write(PAGE, page(table_of, study.records, pictures, study.apart, chattering, noise, workload, software))


def agreement_facts(study: Study) -> list[dict[str, Any]]:
    """Return how far the two plants are apart, a mapping for each closed loop."""
    return [
        {"config": config, "chain": chain, "condition": condition, "controller": name, **value._asdict()}
        for (config, chain, condition, name), value in study.apart.items()
    ]


def markdown(table_of: list[Claim]) -> str:
    """Return the table of claims as Markdown."""
    lines = ["| claim | verdict | figure [95 %] | conditions | what does as well |", "|---|---|---|---|---|"]
    for claim in table_of:
        cells = (
            f"{claim.claim}, {claim.where}",
            f"**{claim.verdict}**",
            f"{claim.figure_text}: {claim.measure} ({claim.cases[0].who}; {claim.cases[0].where})",
            claim.condition,
            claim.ablation,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def claims_table(table_of: list[Claim]) -> str:
    """Return the table of claims for the terminal, conditions under it."""
    rows = [
        [claim.claim, claim.where, TONES.get(claim.verdict, str)(claim.verdict), claim.figure_text]
        for claim in table_of
    ]
    lines = [table(["claim", "where", "verdict", "figure [95 %]"], rows, left=3, keys=2), ""]
    for claim in table_of:
        lines.append(f"{claim.claim}: {claim.verdict}, {claim.condition}")
        lines.append(f"  figure: {claim.measure}; {claim.cases[0].who}, {claim.cases[0].where}")
        lines += [f"  {claim.ablation}", f"  {claim.command}"]
    return "\n".join(lines)
