"""``torquebench why``: what makes a controller shake, fail, err or saturate, each with its number and a remedy."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.cli.app import command
from torquebench.cli.parameters import Config, allow_outside, argument, check_out, option, out_file, plugins, settings
from torquebench.cli.run_folder import read_run
from torquebench.cli.terminal import following, progress_bar, say, table, tell

if TYPE_CHECKING:
    from torquebench.diagnosis import Diagnosis

BAR = 30
"""Characters of a bar of 100 %."""


class ConfigOrRun(Config):
    """A config, or the folder of a run."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return its path."""
        path = Path(str(value))
        return path if path.is_dir() else super().convert(value, param, ctx)


@command(example="torquebench why fig9-chattering --controller conventional")
@argument("source", type=ConfigOrRun(), metavar="CONFIG|RUN", help="an experiment, or the folder of a run")
@option("--controller", metavar="NAME", help="controller that is looked at (default: the one whose run is worst)")
@out_file(help="page to write, with the figure (default: none; RUN/why.html for a run)")
@settings(help="change one key of a config, for example chain=fast")
@allow_outside
@plugins
def why(
    source: Path,
    controller: str | None,
    out: Path | None,
    overrides: Sequence[str],
    allow_outside: bool,
    plugin: Sequence[Path],
) -> int:
    """Name what makes a run shake, fail, err or saturate.

    Each imperfection is taken away, and left alone, in a run of its own; what cures is a number that was tried.
    """
    check_out(out)
    from torquebench.cli.parameters import refuse
    from torquebench.diagnosis import diagnose
    from torquebench.experiment import load_experiment
    from torquebench.experiment.folder import read_result
    from torquebench.experiment.store import EXPERIMENT, add_to_run, atomic_write
    from torquebench.laws.plugin import load_plugin
    from torquebench.report.why_page import free_page, why_page

    for file in plugin:
        load_plugin(file)
    is_run = source.is_dir()
    if is_run:
        if overrides:
            refuse([("--set", f"has no effect on a run: give its config, {source / EXPERIMENT}")])
        experiment = read_run(source, "why", read_result).experiment
    else:
        experiment = load_experiment(source, overrides, allow_outside)
    with progress_bar(0, "run", "starting (compiles on first use)") as bar:
        found = diagnose(experiment, controller, following(bar))
    changes = found.remedy.settings
    given = [word for text in (*overrides, *changes) for word in ("--set", text)]
    given += [word for file in plugin for word in ("--plugin", str(file))] + ["--allow-outside"] * allow_outside
    config = str(source / EXPERIMENT if is_run else source)
    try_it = shlex.join(["torquebench", "run", config, *given]) if changes else ""
    tell(**found.to_json(), try_it=try_it)
    show(found, try_it)
    page = why_page(found, try_it)
    if out is not None:
        atomic_write(out, page)
    elif is_run:
        out = free_page(source, page)
        add_to_run(source, {out.name: page})
    if out is not None:
        tell(page=out)
        say(f"page: {out}")
    return 0


def show(found: Diagnosis, try_it: str) -> None:
    """Say a diagnosis: the sentence, the cure, a bar for each cause, the table, the loop.

    Args:
        found: The diagnosis.
        try_it: Command that runs it with the cure; empty where that is words.
    """
    say(found.sentence)
    if found.advice:
        say(f"{'Cure' if found.remedy.cures else 'Helps'}: {found.advice}.")
    if try_it:
        say(f"try it: {try_it}", fold=False)
    if found.causes:
        say()
        name = max(len(cause.key) for cause in found.causes)
        for cause in found.causes:
            bar = "█" * max(1, round(BAR * cause.effect))
            say(f"{cause.key:<{name}}  {bar:<{BAR}} {100 * cause.effect:.0f} %", fold=False)
        say()
        header = ["cause", "it", "without", "alone", "remedy"]
        say(
            table(
                header,
                [
                    [c.title.rstrip(","), c.symptom, c.without or "-", c.alone, found.cure_of(c) or "-"]
                    for c in found.causes
                ],
                left=5,
                prose=True,
            )
        )
        say()
        for cause in found.causes:
            whose = "" if cause.owner == cause.key else cause.whose
            if told := "; ".join(filter(None, (cause.detail, whose))):
                say(f"{cause.key}: {told}")
    for one in found.cures:
        if one.text != found.advice:
            say(f"in the law: {one.text}")
    if found.margins is not None and found.margins.crossover is not None:
        for line in filter(None, (found.margins.words(found.joints), found.margins.rule, found.margins.costs)):
            say(line)
    say(f"{found.runs} closed loops run")


def hint(folder: Path, shaking: Sequence[str], of: int) -> str:
    """Return the line that ends a run of which controllers shake.

    Args:
        folder: The run's folder.
        shaking: Names of those that do.
        of: How many controllers the run has.
    """
    verb, which = "shakes" if len(shaking) == 1 else "shake", ["--controller", shaking[0]] if of > 1 else []
    return f"{', '.join(shaking)} {verb}: {shlex.join(['torquebench', 'why', str(folder), *which])}"
