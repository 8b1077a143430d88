"""``torquebench sweep``: many runs of one experiment, begun or continued, and a table of what came out."""

from __future__ import annotations

import contextlib
import os
import shlex
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.cli.app import command
from torquebench.cli.parameters import (
    Choice,
    Config,
    File,
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
from torquebench.cli.terminal import complain, following, height, progress_bar, say, table, tell, warn
from torquebench.errors import Problem, ResultError, TorquebenchError

if TYPE_CHECKING:
    from torquebench.sweep.checking import Survey
    from torquebench.sweep.estimate import Estimate
    from torquebench.sweep.executors import Executor
    from torquebench.sweep.folder import StoredSweep
    from torquebench.sweep.plan import Plan, Source
    from torquebench.sweep.run import State
    from torquebench.sweep.summary import Summary

LEAST_TOLD, AROUND = 5, 16
"""Choices that the terminal shows however small it is, and lines around them, which stand in two tables."""
FAR_TOO_MANY = 3
"""Multiple of the cap that is refused before anything is checked: to check so many draws takes long too."""


@dataclass(frozen=True)
class Options:
    """Arguments of the command."""

    config: Path | None
    out: Path | None
    resume: Path | None
    workers: int | None
    executor: str | None
    cluster: str | None
    overrides: Sequence[str]
    model: Path | None
    allow_outside: bool
    plugin: Sequence[Path]
    no_cap: bool
    dry_run: bool
    show_config: bool

    def check(self) -> None:
        """Refuse what does not go together."""
        problems: list[Problem | tuple[str, str]] = [
            (f"--{name}", "has no effect with --cluster, whose workers run the sweep")
            for name in ("workers", "executor")
            if self.cluster is not None and getattr(self, name) is not None
        ]
        if self.config is None and self.resume is None:
            wanted = "a sweep's file, or --resume with a sweep's folder"
            problems.append(Problem("CONFIG", text="missing", wanted=wanted))
        if self.resume is not None and self.out is not None:
            problems.append(("--out", "has no effect with --resume, which goes on in the sweep's own folder"))
        if self.resume is not None and self.config is None and (self.overrides or self.model):
            problems.append(("--set", "has no effect with --resume alone: what was set is stored"))
        refuse(problems)


@command(example="torquebench sweep sweep --dry-run")
@argument("config", type=Config(), required=False, help="experiment with a section `sweep`: a file, or a shipped one")
@out_folder(help="folder for the results, new or empty (default: runs/NAME-UTC)")
@option("--resume", type=File(folders=True), metavar="DIR", help="go on with the sweep in this folder")
@workers_option(help="how many run (default: one per core)")
@option("--executor", type=Choice(["processes", "threads"]), help="what the workers are (default: processes)")
@option(
    "--cluster",
    metavar="ADDRESS",
    help="run on a Dask cluster: tcp://HOST:PORT or tls://HOST:PORT of its scheduler; local or local:N makes one here",
)
@settings(help="change one key, for example sweep.draws=10 or run.duration=2")
@model
@allow_outside
@plugins
@option("--no-cap", is_flag=True, help="start whatever it takes")
@option("--dry-run", is_flag=True, help="check and estimate only")
@option("--show-config", is_flag=True, help="print the config, with what it extends written out; run nothing")
def sweep(**given: Any) -> int:
    """Run grids and random draws over any keys of an experiment.

    Every case of a file's section `sweep` is run in every draw for every controller, and a table of their metrics is
    stored. The work is estimated and shown first.
    """
    options = Options(**given)
    options.check()
    from torquebench.experiment.store import check_run
    from torquebench.laws.plugin import load_plugin
    from torquebench.report.sweep import summary_of, sweep_facts, unexpected_outcomes

    for file in options.plugin:
        load_plugin(file)
    stored = _start(options) if options.resume is None else _resume(options, options.resume)
    if stored is None:
        return 0
    outcomes = check_run(stored.folder)["outcomes"]
    summary = summary_of(stored)
    tell(directory=stored.folder, **sweep_facts(stored, outcomes, summary))
    if summary is not None:
        _say_border(stored)
        _say_best(stored, summary)
    say(f"results: {stored.folder}")
    wrong = unexpected_outcomes(stored, outcomes)
    for name, text in wrong.items():
        complain(f"torquebench: controller '{name}': {text}")
    return 1 if wrong else 0


def _start(options: Options) -> StoredSweep | None:
    """Check, estimate and run a sweep; None if only the estimate is wanted."""
    from torquebench.experiment.build import build
    from torquebench.experiment.certify import planned
    from torquebench.experiment.dump import dump_tree
    from torquebench.experiment.store import RunDirectory, claim_folder, runs_folder
    from torquebench.sweep.checking import check_plan
    from torquebench.sweep.estimate import MOST_STEPS, shard_size
    from torquebench.sweep.folder import create_sweep
    from torquebench.sweep.plan import Plan
    from torquebench.sweep.run import state_of

    begun = time.perf_counter() - time.process_time()  # with the time of the imports, which a worker needs too
    plan = Plan(_source(options))
    if options.show_config:
        tell(experiment=plan.raw)
        say(dump_tree(plan.raw).rstrip("\n"), fold=False)
        return None
    ready = time.process_time()
    steps = plan.rows * plan.first.n_steps
    if steps > FAR_TOO_MANY * MOST_STEPS and not options.no_cap:
        message = f"needs about {steps:.2g} steps, at most {MOST_STEPS:.0e} are run: --no-cap lifts the caps"
        refuse([("sweep", message)])
    with progress_bar(plan.cases, "case", "checking") as bar:
        survey = check_plan(plan, bar.update)
    with _executor(options) as executor:
        work = _print_estimate(plan, survey, executor, begun, ready)
        for remark in planned(plan.first, build(plan.first)):
            warn(f"torquebench: first case: {remark}")
        if not options.no_cap:
            refusals = work.refusals((options.out or runs_folder()).absolute())
            refuse([("sweep", f"needs {text}: --no-cap lifts the caps") for text in refusals])
        if options.dry_run:
            return None
        _prepare(executor, plan.source)
        directory = RunDirectory(claim_folder(options.out, plan.first.name))
        stored = create_sweep(directory, plan, shard_size(plan, survey.steps))
        _run_rest(stored, state_of(stored), executor, options)
    return stored


def _resume(options: Options, folder: Path) -> StoredSweep:
    """Run what is missing of a stored sweep, which the file, if one is given, must still describe."""
    from torquebench.sweep.checking import check_plan
    from torquebench.sweep.folder import open_sweep, refuse_changes, verify
    from torquebench.sweep.plan import Plan
    from torquebench.sweep.run import state_of

    stored = open_sweep(folder, tuple(options.plugin), "--resume")
    if options.config is not None:
        plan = Plan(_source(options))
        check_plan(plan)
        refuse_changes(stored, plan, "--resume")
    if stored.finished:
        verify(stored)
    state = state_of(stored)
    damaged, there = len(state.damaged), f"{len(state.complete)} of {stored.shards} shards are there"
    if stored.finished:
        if state.missing:
            what = f"{damaged} of {stored.shards} shards are damaged, {len(state.missing) - damaged} missing"
            warn(f"torquebench: {what}; the tables, which were made from them, are as they were written")
        say(f"finished already: {there}")
        return stored
    say(f"{there}{f', {damaged} damaged' * bool(damaged)}; {len(state.missing)} to run")
    with _executor(options) as executor:
        _prepare(executor, stored.plan.source)
        _run_rest(stored, state, executor, options)
    return stored


def _source(options: Options) -> Source:
    """Return the file and the changes that the arguments name."""
    from torquebench.experiment.source import read_bytes
    from torquebench.sweep.plan import Source

    path = options.config or Path()
    overrides, plugins = with_arm(options.overrides, options.model), tuple(p.absolute() for p in options.plugin)
    return Source(read_bytes(path), str(path), overrides, plugins, outside=options.allow_outside)


def _print_estimate(plan: Plan, survey: Survey, executor: Executor, begun: float, ready: float) -> Estimate:
    """Say how much work a sweep is, and return it; arguments as of `estimate`."""
    from torquebench.sweep.estimate import duration, estimate, size

    with progress_bar(0, "run", "timing a few runs (compiles on first use)"):
        work = estimate(plan, survey.steps, executor, begun, ready)
    tell(estimate=work)
    if plan.draws > 1 and not survey.is_drawn:
        warn(f"torquebench: nothing is random: all {plan.draws} draws are the same run, sweep.draws=1 would do")
    counts = {"case": plan.cases, "draw": plan.draws, "controller": len(plan.controllers)}
    say(f"{plan.first.name}: " + " x ".join(f"{count:,} {what}{'s' * (count != 1)}" for what, count in counts.items()))
    say(
        f"{work.runs:,} runs, {work.steps:,} steps: about {duration(work.seconds)} in all, "
        f"{duration(work.so_far)} so far and {duration(work.running)} on {executor}; "
        f"{size(work.memory)} of memory, {size(work.disk)} on disk"
    )
    return work


@contextlib.contextmanager
def _executor(options: Options) -> Iterator[Executor]:
    """Have what runs the shards."""
    from torquebench.sweep.executors import Processes, Threads

    if options.cluster is None:
        count = options.workers or os.cpu_count() or 1
        yield Threads(count) if options.executor == "threads" else Processes(count)
        return
    from torquebench.sweep.cluster import open_cluster

    with contextlib.ExitStack() as stack:
        with progress_bar(0, "worker", f"waiting for the cluster {options.cluster}"):
            cluster = stack.enter_context(open_cluster(options.cluster))
        say(str(cluster))
        yield cluster


def _prepare(executor: Executor, source: Source) -> None:
    """Have the workers ready."""
    with progress_bar(0, "worker", "preparing the workers (compiles on first use)"):
        executor.prepare(source)


def _run_rest(stored: StoredSweep, state: State, executor: Executor, options: Options) -> None:
    """Run what is missing and write the tables; if something comes in between, the error says how to go on."""
    from torquebench.report.sweep import MOST_ROWS
    from torquebench.sweep.run import finish

    def more(done: StoredSweep) -> Iterator[tuple[str, bytes]]:
        if done.plan.rows > MOST_ROWS:
            warn(f"torquebench: no summary and page of more than {MOST_ROWS:,} runs; the tables are there")
        return report_with_bar(done)

    try:
        with progress_bar(stored.plan.rows, "run", "running", state.rows) as bar:
            finish(stored, state, executor, bar.update, more)
    except KeyboardInterrupt as error:  # SIGTERM is one too
        raise type(error)(_resume_hint(stored, options)) from error
    except (OSError, TorquebenchError) as error:
        raise ResultError(f"{error}; {_resume_hint(stored, options)}") from error
    say(f"{len(state.missing)} shards run, {len(state.complete)} were there")


def report_with_bar(stored: StoredSweep) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of the files about a sweep's table, with a progress bar."""
    from torquebench.report.sweep import report_files

    with progress_bar(0, "file", "summing up") as bar:
        yield from report_files(stored, following(bar))


def _resume_hint(stored: StoredSweep, options: Options) -> str:
    """Return what to type to go on."""
    words = ["torquebench", "sweep", "--resume", str(stored.folder)]
    words += [word for plugin in options.plugin for word in ("--plugin", str(plugin))]
    return f"what is stored is kept, go on with: {shlex.join(words)}"


def _say_border(stored: StoredSweep) -> None:
    """Say as bars and a table where each law starts to shake, if it was searched."""
    from torquebench.metrics.chattering import STILL
    from torquebench.report.sweep_tables import border_table
    from torquebench.sweep.folder import TABLE
    from torquebench.sweep.table import read_table

    border = stored.plan.keys.border
    if border is None:
        return
    header, rows = border_table(read_table(stored.folder / TABLE))
    say(f"First {border.key} at which each law shakes: chattering of {STILL:g} % of the torque limit or more")
    say(f"\n{table(header, rows, left=next(i for i, x in enumerate(header) if x.endswith(':')) + 1)}\n")
    say(
        "medians over the draws; none: at no value searched; all: at every one; ~: predicted by describing functions; "
        "the figure has the 95 % intervals"
    )
    say(f"drawn by: torquebench figures {stored.folder} --only border\n")


def _say_best(stored: StoredSweep, summary: Summary) -> None:
    """Say what came out, in sentences and as a table of the best choices, and where the page is."""
    from torquebench.experiment.schema import slide_joints
    from torquebench.report.render import PAGE
    from torquebench.report.sweep_tables import answer, best_table, columns_of, dot_rows, told_choices
    from torquebench.report.tables import headlines
    from torquebench.sweep.best import best_choices, conditions, short_names

    titles = headlines(slide_joints(stored.plan.first.plant.model), tool=True)
    for sentence in answer(summary, titles):
        say(sentence)
    choices = told_choices(summary, titles, max(LEAST_TOLD, (height() - AROUND) // 2))
    if choices:
        header, dots = dot_rows(choices, summary, titles)
        if len(header) > 1 and len(dots) > 1:
            say(f"\n{table(header, dots, left=len(header))}")
        header, rows = best_table(choices, summary, titles)
        say(f"\n{table(header, rows, keys=1 + len(summary.grid))}\n")
        every = len(best_choices(summary, summary.metrics[0]))
        say(
            f"{f'the best {len(choices)} of {every:,}' if len(choices) < every else f'all {every}'} choices; "
            "means over the draws, with their 95 % intervals where draws differ"
        )
    apart = [short_names(summary.grid)[key] for key in conditions(summary)]
    if apart and choices:
        say(f"each figure in the worst of all values of {', '.join(apart)}; those shown are the worst for the error")
        each = sorted(best_choices(summary, columns_of(summary, titles)[0], over=()), key=lambda one: one.worst.case)
        if len(each) <= max(LEAST_TOLD, height() - AROUND):
            header, rows = best_table(each, summary, titles)
            say(f"\nEach case by itself\n{table(header, rows, keys=1 + len(summary.grid))}\n")
    say(f"all cases, with constraints: {stored.folder / PAGE}")
