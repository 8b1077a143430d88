"""``torquebench preflight``: whether a law would trip, saturate or shake on a robot."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.parameters import Number, argument, option, plugins, refuse, suggest
from torquebench.cli.terminal import bad, good, progress_bar, say, table, tell, warn
from torquebench.errors import ConfigError, Problem

if TYPE_CHECKING:
    from torquebench.experiment.controllers import Controller
    from torquebench.experiment.schema import Experiment
    from torquebench.preflight import Finding, Report

CONFIGS = (".yaml", ".yml")
CONTROLLER, GAINS = "controllers[0]", "controllers[0].gains"
BAR, WIDTH = 30, 16
"""Characters of a bar that is at its limit, and of what it is of."""


@command(example="torquebench preflight joint-impedance --robot fr3")
@argument("law", help="a law, a Python file of laws as for --plugin, or a config")
@option("--robot", required=True, metavar="NAME", help="the arm, by name or file; its chain has the same name")
@option("--chain", metavar="NAME", help="another chain than the robot's")
@option("--gain", "gains", multiple=True, metavar="NAME=X[,X..]", help="a gain; those not given suit the arm")
@option("--option", "options", multiple=True, metavar="NAME=VALUE", help="an option of the law, switching=saturation")
@option(
    "--payload", type=Number(float, 0.0), default=1.0, show_default=True, metavar="KG", help="load of half the motions"
)
@plugins
def preflight(
    law: str,
    robot: str,
    chain: str | None,
    gains: tuple[str, ...],
    options: tuple[str, ...],
    payload: float,
    plugin: tuple[Path, ...],
) -> int:
    """Say whether a law would trip, saturate or shake on a robot.

    Small motions are flown with the robot's chain, with and without a load. The exit status is 0 when the law passes, 1
    when it is refused: then a share of its gains that would pass is said.
    """
    from torquebench.chain import CHAINS, rate_remarks
    from torquebench.experiment.config import load_experiment
    from torquebench.laws import law_names
    from torquebench.laws.plugin import load_plugin
    from torquebench.preflight import experiment_of
    from torquebench.preflight import preflight as fly
    from torquebench.robot import load_model
    from torquebench.robot.library import is_path, model_names

    given, problems = _numbers(gains)
    chosen, more = _choices(options)
    problems += more
    chain = robot if chain is None else chain
    if robot not in model_names() and not is_path(robot):
        problems.append(Problem("--robot", got=f"'{robot}'", **suggest(robot, model_names())))
    elif chain not in CHAINS:
        text = "" if chain != robot else "this robot has no chain of its name: choose one by --chain"
        problems.append(Problem("--chain", text=text, got=f"'{chain}'", **suggest(chain, tuple(CHAINS))))
    for file in plugin:
        load_plugin(file)
    names: tuple[str, ...] = ()
    if law.endswith(".py"):
        names = load_plugin(Path(law), "LAW")
        if not names:
            problems.append(Problem("LAW", text=f"{law} registers no law", wanted="a function with @controller"))
    elif not law.endswith(CONFIGS):
        names = (law,)
        if law not in law_names():
            problems.append(Problem("LAW", got=f"'{law}'", **suggest(law, law_names())))
    else:
        for flag, its, what in (("--gain", given, "gains"), ("--option", chosen, "options")):
            if its:
                problems.append(Problem(flag, text=f"a config has its own {what}", wanted=f"a law, or no {flag}"))
    refuse(problems)
    if names:
        arm = Path(robot) if robot not in model_names() else robot
        experiments = [
            _of_flags(lambda name=name: experiment_of(name, arm, chain, given, chosen))  # type: ignore[misc]
            for name in names
        ]
    else:
        experiments = [load_experiment(Path(law), [f"plant.model={robot}", f"chain={chain}"], outside=True)]
    reports = []
    with progress_bar(0, "trial", "starting (compiles on first use)") as bar:

        def told(what: str) -> None:
            bar.describe(what)
            bar.update(1)

        for experiment in experiments:
            reports += fly(experiment, payload, told)
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
                "closest": [finding._asdict() for finding in report.closest],
                "scaled_gains": report.scaled,
                "largest_share": report.share,
                "layer": _as_keys(report.layer),
                "margins": None if report.margins is None else report.margins.to_json() | {"where": report.where},
                "margins_left": None if report.left is None else report.left.to_json(),
                "calmer_share": report.calmer,
                "margins_left_by_calmer": None if report.calmer_left is None else report.calmer_left.to_json(),
                "margins_left_by_layer": None if report.layer_left is None else report.layer_left.to_json(),
            }
            for report in reports
        ],
    )
    joints = load_model(experiments[0].plant.model).joint_names
    tried = [keys for experiment in experiments for keys in experiment.controllers]
    texts = (_text(report, robot, joints, keys, bool(names)) for report, keys in zip(reports, tried, strict=True))
    say("\n\n".join(texts))
    for remark in rate_remarks(CHAINS[chain], experiments[0].run.control_period):
        warn(remark)
    return 0 if passed else 1


def _of_flags(make: Callable[[], Experiment]) -> Experiment:
    """Return an experiment; what is wrong with its gains or the law's options is said of --gain or --option."""

    def said(one: Problem) -> Problem:
        for prefix, flag in ((GAINS, "--gain"), (CONTROLLER, "--option")):
            if one.key.startswith(prefix):
                return replace(one, source=flag, key=one.key.removeprefix(prefix).lstrip("."))
        return one

    try:
        return make()
    except ConfigError as error:
        raise ConfigError([said(one) for one in error.problems]) from error


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


def _choices(options: tuple[str, ...]) -> tuple[dict[str, str | bool], list[Problem]]:
    """Return options of a law given as NAME=VALUE, and what is wrong with them."""
    found: dict[str, str | bool] = {}
    problems = []
    for text in options:
        name, _, value = text.partition("=")
        if value:
            found[name] = {"true": True, "false": False}.get(value, value)
        else:
            problems.append(Problem("--option", got=f"'{text}'", wanted="NAME=VALUE"))
    return found, problems


def _as_keys(pairs: Iterable[tuple[str, str]], before: str = "") -> str:
    """Return keys and values as a config has them."""
    return ", ".join(f"{before}{name}: {value}" for name, value in pairs)


def _as_flags(pairs: Iterable[tuple[str, str]], options: Collection[str] = ()) -> str:
    """Return keys and values as ``--gain`` takes them, or ``--option`` those of a law's options."""
    return " ".join(
        f"--{'option' if name in options else 'gain'} {name}={value.strip('[]').replace(' ', '')}"
        for name, value in pairs
    )


def _text(report: Report, robot: str, joints: Sequence[str], keys: Controller, as_gain: bool) -> str:
    """Return a row of dots for each motion, a bar for each limit, then what was found and what to change.

    Args:
        report: What came of the controller.
        robot: Name of the arm.
        joints: Names of its joints.
        keys: The controller.
        as_gain: Whether gains are said as ``--gain`` takes them.
    """
    import numpy as np

    from torquebench.diagnosis.parts import as_yaml, with_share
    from torquebench.laws import find_law
    from torquebench.preflight import REMEDIES

    refused = {finding.flight for finding in report.findings}
    motions: dict[str, str] = {}
    for flight in report.flights:
        motion = flight.partition(",")[0]
        motions[motion] = motions.get(motion, "") + ("x" if flight in refused else "o")
    lines = [f"{report.controller} on {robot}: {'passes' if report.passed else 'REFUSED'}", ""]
    lines += [f"  {motion:<{WIDTH}}  {' '.join(dots)}" for motion, dots in motions.items()]
    lines += ["", "  o: nothing a robot would not stand; x: something", ""]
    for one in report.closest:
        share = one.value / one.limit
        bar = "█" * min(BAR, round(BAR * share)) + ("▶" if one.beyond else "")
        size = f"{100.0 * share:.0f} %" if share < 10.0 else f"{share:.0f} times"
        where = f", {one.joint}" if one.joint and one.value else ""
        lines.append(f"  {one.reason:<{WIDTH}}  {bar:<{BAR + 1}}  {size} of {one.limit:.4g} {one.unit}{where}")
    if report.margins is not None:
        told = f"{report.margins.words(joints)} ({report.where})", report.margins.rule, report.margins.costs
        lines += ["", *(f"  {line}" for line in told if line)]
    if report.passed:
        return "\n".join(lines)
    first: dict[str, Finding] = {}
    for finding in report.findings:
        first.setdefault(finding.reason, finding)
    rows = [
        [
            bad(one.reason),
            one.joint or "-",
            "-" if one.t is None else f"{one.t:.3g} s",
            f"{one.value:.4g}",
            f"{one.limit:.4g}",
            one.unit,
            one.flight or "the law itself",
        ]
        for one in first.values()
    ]
    lines += ["", str(table(["reason", "joint", "at", "value", "limit", "unit", "in"], rows, left=2, prose=True)), ""]
    gains = ", ".join(report.scaled)
    passes = []
    for part, left in ((report.share, report.left), (report.calmer, report.calmer_left)):
        if part is not None:
            fewer = with_share(keys, report.scaled, part).gains
            made = [(name, as_yaml(fewer[name])) for name in report.scaled if np.any(keys.gains[name])]
            typed = _as_flags(made) if as_gain else _as_keys(made, f"controllers.{keys.name}.gains.")
            passes.append((f"{100.0 * part:.2g} % of {gains}, {typed},", left))
    if report.layer:
        typed = _as_flags(report.layer, find_law(keys.law).options) if as_gain else _as_keys(report.layer)
        passes.append((typed, report.layer_left))
    for what, left in passes:
        lines.append(str(good(f"{what} would pass")) + (f": {left.words(joints)}" if left is not None else ""))
    if report.share is None:
        lines.append(f"no smaller share of {gains or 'its gains'} passes: it is not their size")
    return "\n".join([*lines, *(f"{reason}: {REMEDIES[reason]}" for reason in first)])
