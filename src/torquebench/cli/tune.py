"""``torquebench tune``: every law of a study tuned alike, and judged on draws that none was tuned on."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.cli.app import command
from torquebench.cli.falsify import scale
from torquebench.cli.parameters import (
    Config,
    allow_outside,
    argument,
    model,
    option,
    out_folder,
    plugins,
    refuse,
    settings,
    with_arm,
)
from torquebench.cli.parameters import workers as workers_option
from torquebench.cli.terminal import complain, following, progress_bar, say, table, tell

if TYPE_CHECKING:
    from torquebench.sweep.tune import Evaluation, Judgement
    from torquebench.tunings import Tuning


@command(example="torquebench tune studies/tuning")
@argument("config", type=Config(), help="experiment with a section `tune`: a file, or a shipped one")
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@option("--resume", is_flag=True, help="go on in the folder of --out, where this study was begun")
@workers_option(help="how many runs are made at once (default: one per core)")
@settings(help="change one key, for example tune.evaluations=50")
@model
@allow_outside
@plugins
def tune(
    config: Path,
    out: Path | None,
    resume: bool,
    workers: int | None,
    overrides: Sequence[str],
    model: Path | None,
    allow_outside: bool,
    plugin: Sequence[Path],
) -> int:
    """Tune every law alike, and judge it on other draws.

    Each law has the evaluations, conditions, draws and seeds of a file's section `tune`, in a box of gains by one rule.
    What comes out is an experiment with the gains that were found, tuned.yaml, and what they are worth in draws that no
    law was tuned on.
    A law for which no gains keep the constraints makes the exit status 1.
    """
    if resume and out is None:
        refuse([("--resume", "needs --out, the folder in which the study was begun")])
    from torquebench.experiment.store import claim_folder, release_folder
    from torquebench.tunings import TUNED, read_study
    from torquebench.tunings import tune as run

    study = read_study(config, with_arm(overrides, model), allow_outside, plugin)
    folder = out
    if folder is None:
        folder = claim_folder(None, study.base.name)
        release_folder(folder)
    words = ["torquebench", "tune", str(config), "--out", str(folder), "--resume"]
    words += [word for text in overrides for word in ("--set", text)]
    words += [word for file in plugin for word in ("--plugin", str(file))]
    try:
        with progress_bar(0, "evaluation", "starting (compiles on first use)") as bar:
            found = run(study, workers=workers, folder=folder, resume=resume, progress=following(bar))
    except KeyboardInterrupt as error:  # SIGTERM is one too
        hint = f"what was evaluated is kept, with the best gains so far in {TUNED}, go on with: {shlex.join(words)}"
        raise type(error)(hint) from error
    tell(directory=folder, **found.to_json())
    report(found)
    say(f"results: {folder}; the tuned laws side by side:")
    say(f"torquebench run {shlex.quote(str(folder / TUNED))}", fold=False)
    lost = [own.controller.name for own in found.laws if not own.best.feasible]
    for name in lost:
        complain(f"torquebench: controller '{name}': no gains were found that keep the constraints")
    return 1 if lost else 0


def report(found: Tuning) -> None:
    """Say what came out: where each law was and is, what that is worth on other draws, and the gains."""
    info, asked = found.info, found.study.asked
    ranks = [found.ranking(judged) for judged in (found.untuned, found.tuned)]
    means = {name: [judged[name].mean() for judged in (found.untuned, found.tuned)] for name in ranks[1]}
    known = [mean.ratio for pair in means.values() for mean in pair if mean is not None]
    low, high = (min(known), max(known)) if known else (1.0, 1.0)
    unit = "" if info.shown_unit in ("", "1") else f" [{info.shown_unit}]"

    def number(value: float) -> str:
        return f"{info.scale * value:.3g}"

    def evaluated(one: Evaluation) -> str:
        if not math.isfinite(one.objectives[0]):
            return "fails"
        return number(one.objectives[0]) if one.feasible else f"({number(one.objectives[0])})"

    def judged(one: Judgement) -> str:
        mean = one.mean()
        if mean is None:
            return "fails"
        wrong = [
            f", {count} of {one.runs} {verb}" for count, verb in ((one.failed, "fail"), (one.broken, "break")) if count
        ]
        return f"{number(mean.ratio)} [{number(mean.low)}, {number(mean.high)}]{''.join(wrong)}"

    def share(value: float) -> float:
        return math.log(value / low) / math.log(high / low) if high > low else 0.5

    lines, rows = [], []
    for place, name in enumerate(ranks[1], 1):
        own, (before, after) = found.law(name), means[name]
        bests = [evaluated(one) for one in (min(own.bests, key=_first), max(own.bests, key=_first))]
        line = scale(-1.0 if before is None else share(before.ratio), 1.0 if after is None else share(after.ratio))
        lines.append([name, f"{ranks[0].index(name) + 1} -> {place}", line, judged(found.tuned[name])])
        spread = f"{evaluated(own.best)} [{' .. '.join(bests)}]"
        gains = ", ".join(f"{key} {_text(value)}" for key, value in own.best.gains.items())
        rows.append([name, evaluated(own.start), spread, judged(found.untuned[name]), gains])
    say(f"{info.title} in draws that no law was tuned on, {number(low)} to {number(high)}{unit}: ○ untuned, ● tuned")
    say()
    say(table(["law", "rank", "untuned -> tuned", f"test{unit}"], lines, left=3))
    say()
    spread = f"tuned [{asked.seeds} seeds]"
    say(table(["law", f"untuned{unit}", spread, f"untuned, test{unit}", "gains"], rows, prose=True))
    kept = ", ".join(claim.text for claim in asked.constraints)
    bracket = f"; in round brackets, and so many runs of the test: break {kept}" if kept else ""
    say()
    say(
        f"{asked.evaluations} evaluations x {asked.seeds} seeds of each law, {found.seconds:g} s of closed loop; "
        "geometric means over conditions and draws, of the test with 95 % intervals over "
        f"{asked.test.draws} draws{bracket}"
    )


def _first(one: Evaluation) -> float:
    return one.scores[0]


def _text(value: float | tuple[float, ...]) -> str:
    return " ".join(f"{x:g}" for x in (value if isinstance(value, tuple) else (value,)))
