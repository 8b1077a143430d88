"""``torquebench preflight``: whether a law would trip, saturate or shake on a robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import Number, argument, option, refuse, suggest
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell
from torquebench.errors import Problem

if TYPE_CHECKING:
    from torquebench.preflight import Finding, Report

CONFIGS = (".yaml", ".yml")


@command(example="torquebench preflight joint-impedance --robot fr3")
@argument("law", help="a law, a Python file of laws as for --plugin, or a config")
@option("--robot", required=True, metavar="NAME", help="the arm, and its chain if one has the same name")
@option("--chain", metavar="NAME", help="another chain than the robot's")
@option("--gain", "gains", multiple=True, metavar="NAME=X[,X..]", help="a gain; those not given suit the arm")
@option(
    "--payload", type=Number(float, 0.0), default=1.0, show_default=True, metavar="KG", help="load of half the motions"
)
def preflight(law: str, robot: str, chain: str | None, gains: tuple[str, ...], payload: float) -> int:
    """Ask before a law moves a robot: would it trip, saturate or shake?

    Small motions are flown with the robot's chain, with and without a load. The exit status is 0 when the law passes,
    1 when it is refused: then the largest share of its gains that would pass is said.
    """
    from torquebench.chain import CHAINS
    from torquebench.experiment.config import load_experiment
    from torquebench.laws import law_names
    from torquebench.laws.plugin import load_plugin
    from torquebench.preflight import experiment_of
    from torquebench.preflight import preflight as fly
    from torquebench.robot.library import model_names

    given, problems = _numbers(gains)
    chain = robot if chain is None else chain
    if robot not in model_names():
        problems.append(Problem("--robot", text=f"got '{robot}'", **suggest(robot, model_names())))
    elif chain not in CHAINS:
        text = f"got '{chain}', which is no chain" + (" (--robot's name; wanted --chain)" if chain == robot else "")
        problems.append(Problem("--chain", text=text, **suggest(chain, tuple(CHAINS))))
    names: tuple[str, ...] = ()
    if law.endswith(".py"):
        names = load_plugin(Path(law), "LAW")
    elif not law.endswith(CONFIGS):
        names = (law,)
        if law not in law_names():
            problems.append(Problem("LAW", text=f"got '{law}'", **suggest(law, law_names())))
    elif given:
        problems.append(Problem("--gain", text="a config has its own gains", wanted="a law, or no --gain"))
    refuse(problems)
    if names:
        experiments = [experiment_of(name, robot, chain, given) for name in names]
    else:
        experiments = [load_experiment(Path(law), [f"plant.model={robot}", f"chain={chain}"], outside=True)]
    reports = []
    with progress_bar(0, "motion", "starting") as bar:
        for experiment in experiments:
            reports += fly(experiment, payload, bar.describe)
    passed = all(report.passed for report in reports)
    tell(
        passed=passed,
        robot=robot,
        chain=chain,
        payload=payload,
        laws=[
            {
                "controller": report.controller,
                "passed": report.passed,
                "flights": report.flights,
                "findings": [finding._asdict() for finding in report.findings],
                "scaled_gains": report.scaled,
                "largest_share": report.share,
            }
            for report in reports
        ],
    )
    say("\n\n".join(_text(report, robot) for report in reports))
    return 0 if passed else 1


def _numbers(gains: tuple[str, ...]) -> tuple[dict[str, float | list[float]], list[Problem]]:
    """Return gains given as NAME=X,X.., and what is wrong with them."""
    found: dict[str, float | list[float]] = {}
    problems = []
    for text in gains:
        name, _, numbers = text.partition("=")
        try:
            values = [float(word) for word in numbers.split(",")]
        except ValueError:
            problems.append(Problem("--gain", text=f"got '{text}'", wanted="NAME=X, or one X for each joint"))
            continue
        found[name] = values[0] if len(values) == 1 else values
    return found, problems


def _text(report: Report, robot: str) -> str:
    """Return a row of dots, one a motion, then what was found, then what to change."""
    from torquebench.preflight import REMEDIES

    refused = {finding.flight for finding in report.findings}
    lines = [f"{report.controller} on {robot}: {'passes' if report.passed else 'REFUSED'}", ""]
    motions: dict[str, str] = {}
    for flight in report.flights:
        motion = flight.partition(",")[0]
        motions[motion] = motions.get(motion, "") + ("x" if flight in refused else "o")
    lines += [f"  {motion:<10}  {dots}" for motion, dots in motions.items()]
    if report.passed:
        return "\n".join([*lines, "", f"  o: nothing found; all {len(report.flights)} motions are flown"])
    lines += ["", "  x: something a robot would not stand; o: nothing", ""]
    worst: dict[tuple[str, str | None], Finding] = {}
    for finding in report.findings:
        worst.setdefault((finding.reason, finding.joint), finding)
    rows = [
        [
            bad(one.reason),
            one.joint or "-",
            f"{one.t:.3g} s",
            f"{one.value:.3g}",
            f"{one.limit:.3g}",
            one.unit,
            one.flight,
        ]
        for one in worst.values()
    ]
    lines.append(table(["reason", "joint", "at", "value", "limit", "unit", "in"], rows, left=2, prose=True))
    gains = ", ".join(report.scaled)
    if report.share is None:
        lines += ["", f"no share of {gains or 'its gains'} passes: it is not their size"]
    else:
        lines += ["", str(good(f"{100.0 * report.share:.2g} % of {gains} would pass"))]
    return "\n".join([*lines, *(f"{reason}: {REMEDIES[reason]}" for reason in dict.fromkeys(k for k, _ in worst))])
