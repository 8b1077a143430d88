"""``torquebench sweep``: many runs of one experiment, begun or continued, and a table of what came out."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
from collections.abc import Iterator
from pathlib import Path

from torquebench.cli.sweep_outcomes import summary
from torquebench.cli.terminal import complain, following, progress_bar, say, tell, warn
from torquebench.errors import ConfigError, Problem, ResultError, TorquebenchError
from torquebench.experiment.store import RunDirectory, check_run, claim_folder
from torquebench.experiment.yaml_source import read_bytes
from torquebench.laws.plugin import load_plugin
from torquebench.report.sweep import MOST_ROWS, report_files, sweep_facts, unexpected_outcomes
from torquebench.sweep.checking import Survey, check_plan
from torquebench.sweep.estimate import MOST_STEPS, Estimate, duration, estimate, shard_size, size
from torquebench.sweep.executors import Executor, Processes, Threads
from torquebench.sweep.folder import StoredSweep, create_sweep, lock_folder, open_sweep, refuse_changes, verify
from torquebench.sweep.plan import Plan, Source
from torquebench.sweep.run import State, conclude, rows_in, run_missing, state_of

DONE, FAILED = 0, 1
FAR_TOO_MANY = 3
"""How many times the cap is refused before anything is checked: to check so many draws takes long too."""


def sweep(options: argparse.Namespace) -> int:
    """Begin or continue a sweep and return the exit status.

    Args:
        options: Arguments of the command; see ``torquebench sweep --help``.

    Raises:
        ConfigError: bad input; nothing has been written.
        ResultError, KeyboardInterrupt: something came in between; the message says how to go on.
    """
    check_options(options)
    for plugin in options.plugin:
        load_plugin(plugin)
    if options.resume is None:
        plan = Plan(source_of(options))
        if plan.rows * plan.first.n_steps > FAR_TOO_MANY * MOST_STEPS and not options.no_cap:
            message = f"needs about {plan.rows * plan.first.n_steps:.2g} steps, at most {MOST_STEPS:.0e} are run"
            raise ConfigError([Problem("sweep", "", f"{message}: --no-cap lifts the caps")])
        with progress_bar(plan.cases, "case", "checking") as bar:
            survey = check_plan(plan, bar.update)
        with open_executor(options) as executor:
            stored = start(plan, survey, executor, options)
            if stored is None:
                return DONE
            run_rest(stored, state_of(stored), executor, options)
    else:
        stored = resume(options)
        if stored.finished:
            verify_finished(stored)
        else:
            finish(stored, options)
    outcomes = check_run(stored.folder)["outcomes"]
    found = sweep_facts(stored, outcomes)
    tell(directory=stored.folder, **found)
    say(summary(stored, found))
    say()
    say(f"results: {stored.folder}")
    wrong = unexpected_outcomes(stored, outcomes)
    for name, text in wrong.items():
        complain(f"torquebench: controller '{name}': {text}")
    return FAILED if wrong else DONE


def check_options(options: argparse.Namespace) -> None:
    """Refuse arguments that make no sense.

    Raises:
        ConfigError: there are some.
    """
    problems = []
    for option in ("workers", "executor"):
        if options.cluster is not None and getattr(options, option) is not None:
            problems.append(Problem(f"--{option}", "", "has no effect with --cluster, whose workers run the sweep"))
    if options.workers is not None and options.workers < 1:
        problems.append(Problem("--workers", "", f"got {options.workers}, wanted at least 1"))
    if options.config is None and options.resume is None:
        problems.append(Problem("CONFIG", "", "missing: wanted a sweep's file, or --resume with a sweep's folder"))
    if options.resume is not None and options.out is not None:
        problems.append(Problem("--out", "", "has no effect with --resume, which goes on in the sweep's own folder"))
    if options.resume is not None and options.config is None and options.overrides:
        problems.append(Problem("--set", "", "has no effect with --resume alone: what was set is stored"))
    if problems:
        raise ConfigError(problems)


def start(plan: Plan, survey: Survey, executor: Executor, options: argparse.Namespace) -> StoredSweep | None:
    """Say how much work a sweep is, and make its folder; None when the former was all that was wanted.

    Args:
        plan: The sweep.
        survey: What checking it has found.
        executor: What will run it.
        options: Arguments of the command.

    Raises:
        ConfigError: the work is more than the caps allow, or a worker cannot take part.
    """
    work = print_estimate(plan, survey, executor)
    refusals = work.refusals((options.out or Path("runs")).absolute())
    if refusals and not options.no_cap:
        raise ConfigError([Problem("sweep", "", f"needs {text}: --no-cap lifts the caps") for text in refusals])
    if options.dry_run:
        return None
    prepare(executor, plan.source)
    directory = RunDirectory(claim_folder(options.out, plan.first.name))
    return create_sweep(directory, plan, shard_size(plan, survey))


def resume(options: argparse.Namespace) -> StoredSweep:
    """Return the sweep of a folder, which the file, if one is given, must still describe.

    Raises:
        ConfigError: there is none, or something that decides results has changed.
    """
    stored = open_sweep(options.resume, tuple(options.plugin), "--resume")
    if options.config is not None:
        plan = Plan(source_of(options))
        check_plan(plan)
        refuse_changes(stored, plan, "--resume")
    return stored


def verify_finished(stored: StoredSweep) -> None:
    """Verify the files of a finished sweep.

    Raises:
        ResultError: one is missing or altered.
    """
    verify(stored)
    state = state_of(stored)
    gone = len(state.missing) - len(state.damaged)
    if state.missing:
        what = f"{len(state.damaged)} of {stored.shards} shards are damaged, {gone} missing"
        warn(f"torquebench: {what}; the tables, which were made from them, are as they were written")
    say(f"finished already: {len(state.complete)} of {stored.shards} shards are there")


def finish(stored: StoredSweep, options: argparse.Namespace) -> None:
    """Say how far a sweep is, and run the rest.

    Raises:
        ConfigError: a worker cannot take part.
    """
    state = state_of(stored)
    damaged = f", {len(state.damaged)} damaged" if state.damaged else ""
    say(f"{len(state.complete)} of {stored.shards} shards are there{damaged}; {len(state.missing)} to run")
    with open_executor(options) as executor:
        prepare(executor, stored.plan.source)
        run_rest(stored, state, executor, options)


def prepare(executor: Executor, source: Source) -> None:
    """Have the workers ready.

    Raises:
        ConfigError: one cannot take part.
    """
    with progress_bar(0, "worker", "preparing the workers (compiles on first use)"):
        executor.prepare(source)


def source_of(options: argparse.Namespace) -> Source:
    """Return the file and the changes that the arguments name."""
    text = read_bytes(options.config)
    return Source(text, str(options.config), tuple(options.overrides), tuple(p.absolute() for p in options.plugin))


def print_estimate(plan: Plan, survey: Survey, executor: Executor) -> Estimate:
    """Say how much work a sweep is, and return it."""
    with progress_bar(0, "run", "timing a few runs (compiles on first use)"):
        work = estimate(plan, survey, executor.count, executor.processes, executor.here)
    tell(estimate=work)
    say(
        f"{plan.first.name}: {plan.cases:,} case{'s' * (plan.cases != 1)} x {plan.draws:,} draw"
        f"{'s' * (plan.draws != 1)} x {len(plan.controllers)} controller{'s' * (len(plan.controllers) != 1)}"
    )
    say(
        f"{work.runs:,} runs, {work.steps:,} steps: about {duration(work.seconds)} of running on {executor}, "
        f"{size(work.memory)} of memory, {size(work.disk)} on disk"
    )
    return work


@contextlib.contextmanager
def open_executor(options: argparse.Namespace) -> Iterator[Executor]:
    """Have what runs the shards.

    Raises:
        ConfigError: there is no such cluster.
    """
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


def run_rest(stored: StoredSweep, state: State, executor: Executor, options: argparse.Namespace) -> None:
    """Run what is missing and conclude.

    Args:
        stored: The sweep.
        state: How far it is.
        executor: What runs the shards.
        options: Arguments of the command.

    Raises:
        ResultError, KeyboardInterrupt: something came in between; the message says how to go on.
    """
    done = sum(rows_in(stored, shard) for shard in state.complete)
    ran = 0
    try:
        with lock_folder(stored), progress_bar(stored.plan.rows, "run", "running", done) as bar:

            def report(rows: int) -> None:
                nonlocal ran
                ran += 1
                bar.update(rows)

            run_missing(stored, state, executor, report)
            bar.set_description_str("writing the tables")
            if stored.plan.rows > MOST_ROWS:
                warn(f"torquebench: no summary, figures and page of more than {MOST_ROWS:,} runs; the tables are there")
            conclude(stored, lambda done: report_with_bar(done, not options.no_figures))
    except KeyboardInterrupt as error:  # SIGTERM is one too
        raise type(error)(resume_hint(stored, options)) from error
    except (OSError, TorquebenchError) as error:
        raise ResultError(f"{error}; {resume_hint(stored, options)}") from error
    say(f"{ran} shards run, {len(state.complete)} were there")


def report_with_bar(stored: StoredSweep, figures: bool) -> Iterator[tuple[str, bytes]]:
    """Yield what `report_files` makes of a sweep, with a progress bar; arguments as there."""
    with progress_bar(0, "figure", "drawing") as bar:
        yield from report_files(stored, figures, following(bar))


def resume_hint(stored: StoredSweep, options: argparse.Namespace) -> str:
    """Return what to type to go on."""
    words = ["torquebench", "sweep", "--resume", str(stored.folder)]
    words += [word for plugin in options.plugin for word in ("--plugin", str(plugin))]
    return f"what is stored is kept, go on with: {shlex.join(words)}"
